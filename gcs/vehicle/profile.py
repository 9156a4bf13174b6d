"""What a vehicle makes of a maneuver: which parameters to write, and in words what will really be flown.

A vehicle is known by the parameters it has, not by what it calls itself. The words matter: a card that asks for
Table 1 and meets a vehicle that flies its own law without noise says so before, and in the flight's file.
A maneuver that a vehicle cannot fly is found here, before anything is written to it.

Vehicle profiles are TOML files in `gcs/vehicle/profiles`; those of logs (`gcs/logs/profile`) are another matter.
"""

from __future__ import annotations

import math
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from importlib import resources
from typing import Any

from gcs.cards.maneuver import KINDS, Maneuver
from gcs.errors import TippathError

STARTING = "SystemID Starting"
FINISHED = "SystemID Finished"
STOPPED = "SystemID Stopped"
PARAMETER_ERROR = "SystemID Parameter Error"
"""What ArduPilot says about a sweep; its only word on progress."""

_RATE_UNIT = math.degrees(1.0)  # ArduPilot counts its rate axes in deg/s


class CannotFlyError(TippathError):
    """This vehicle cannot fly that; the message says why and what it can."""


@dataclass(frozen=True, slots=True)
class Plan:
    """One maneuver as one vehicle will fly it."""

    maneuver: Maneuver
    writes: tuple[tuple[str, float], ...]
    """Parameters and values, in the order to write them."""
    asked: Mapping[str, float]
    """Our word for each of them and its value, in the vehicle's unit."""
    words: str
    """What is really flown: `Table 1`, or `ArduPilot's law, no noise`."""
    axis_number: int
    """What the vehicle will say it starts."""
    mode: int
    """The excitation mode."""
    lead_s: float
    """From entering the mode to the first excitation."""
    over_s: float
    """From entering the mode to the last excitation."""
    finished_s: float
    """From entering the mode to the vehicle's word that it has finished."""


@dataclass(frozen=True, eq=False)
class VehicleProfile:
    """How one kind of vehicle is told to fly a maneuver."""

    name: str
    file: str
    chirp_law: str
    """`table 1` or `ardupilot`."""
    needs: tuple[str, ...]
    """Parameters by which the vehicle is recognised."""
    autopilot: int
    excitation_mode: int
    manual_throttle_modes: tuple[int, ...]
    axes: Mapping[str, int]
    rate_axes: Mapping[str, int]
    kinds: Mapping[str, int]
    """Empty where the vehicle flies nothing but chirps."""
    parameters: Mapping[str, str]
    """Our word -> the vehicle's parameter, in the order of writing."""
    constants: Mapping[str, float]
    largest_magnitude: Mapping[int, float]
    """Axis number -> magnitude, in the axis' own unit, beyond which a maneuver on it would be dangerous."""
    lead_s: float
    tail_s: float

    def dangerous(self, axis: float, magnitude: float) -> bool:
        """Whether a maneuver with this magnitude must not be left ready on this axis, however it came there."""
        largest = self.largest_magnitude.get(int(axis))
        return largest is not None and not abs(magnitude) <= largest

    @property
    def settings(self) -> tuple[str, ...]:
        """Every parameter that a maneuver writes."""
        return tuple(self.parameters.values())

    def plan(self, maneuver: Maneuver) -> Plan:
        """What to write and what will be flown. Raises CannotFlyError."""
        problem = maneuver.problem()
        if problem is not None:
            raise CannotFlyError(f"{maneuver.words}: {problem}")
        if self.kinds:
            able = tuple(kind for kind in KINDS if kind in self.kinds)
        else:
            able = ("chirp",)
        if maneuver.kind not in able:
            raise CannotFlyError(
                f"{maneuver.words}: this vehicle ({self.name}) flies {_list(able)} by itself, no {maneuver.kind}; "
                f"leave it out of the card{' and let the pilot fly it' if maneuver.kind == 'doublet' else ''}"
            )
        axes = self.rate_axes if maneuver.target == "rate" else self.axes
        if maneuver.axis not in axes:
            raise CannotFlyError(
                f"{maneuver.words}: this vehicle ({self.name}) excites {_list(tuple(axes))} on board, "
                f"not {maneuver.axis}; choose another axis"
            )
        values = self._values(maneuver, axes[maneuver.axis])
        asked = {word: values[word] for word in self.parameters if word in values}
        writes = tuple((self.parameters[word], value) for word, value in asked.items())
        over_s = self.lead_s + maneuver.duration_s
        finished_s = over_s + self.tail_s
        if self.chirp_law == "ardupilot":
            finished_s += maneuver.fade_in_s + maneuver.fade_out_s + 2 / maneuver.f_start_hz
        return Plan(
            maneuver,
            writes,
            asked,
            self._words(maneuver),
            axes[maneuver.axis],
            self.excitation_mode,
            self.lead_s,
            over_s,
            finished_s,
        )

    def _values(self, maneuver: Maneuver, axis: int) -> dict[str, float]:
        unit = _RATE_UNIT if maneuver.target == "rate" else 1.0
        values = {"axis": float(axis), "amplitude": maneuver.amplitude * unit, "duration_s": maneuver.duration_s}
        for word in ("f_start_hz", "f_stop_hz", "fade_in_s", "fade_out_s", "c1", "noise_fraction", "pulse_s"):
            values[word] = getattr(maneuver, word)
        if self.kinds:
            values["kind"] = float(self.kinds[maneuver.kind])
        return {**values, **self.constants}

    def _words(self, maneuver: Maneuver) -> str:
        if maneuver.kind == "quiet":
            return "nothing added"
        if maneuver.kind == "doublet":
            return "doublets of the vehicle's own, no noise"
        if self.chirp_law == "ardupilot":
            return "ArduPilot's law, no noise"
        if maneuver.is_table_1:
            return "Table 1"
        faded = ", faded" if maneuver.fade_in_s or maneuver.fade_out_s else ""
        return (
            f"Table 1's law with {maneuver.f_start_hz:g}-{maneuver.f_stop_hz:g} Hz, "
            f"noise {maneuver.noise_fraction:g}, C1 {maneuver.c1:g}{faded}"
        )


def _list(words: tuple[str, ...]) -> str:
    return " and ".join(filter(None, (", ".join(words[:-1]), words[-1]))) if words else "nothing"


@cache
def bundled_profiles() -> tuple[VehicleProfile, ...]:
    """The vehicle profiles of the package, the most particular first."""
    folder = resources.files("gcs.vehicle") / "profiles"
    names = [e.name for e in folder.iterdir() if e.name.endswith(".toml")]
    profiles = [parse_profile((folder / name).read_text("utf-8"), name) for name in sorted(names)]
    return tuple(sorted(profiles, key=lambda profile: -len(profile.needs)))


def parse_profile(text: str, source: str) -> VehicleProfile:
    """A vehicle profile from TOML. Raises TippathError that names the key at fault."""
    try:
        table: dict[str, Any] = tomllib.loads(text)
        modes, timing = table["modes"], table["timing"]
        profile = VehicleProfile(
            name=str(table["name"]),
            file=source,
            chirp_law=str(table["chirp_law"]),
            needs=tuple(map(str, table["needs"])),
            autopilot=int(table["autopilot"]),
            excitation_mode=int(modes["excitation"]),
            manual_throttle_modes=tuple(map(int, modes["manual_throttle"])),
            axes={str(k): int(v) for k, v in table["axes"].items()},
            rate_axes={str(k): int(v) for k, v in table.get("rate_axes", {}).items()},
            kinds={str(k): int(v) for k, v in table.get("kinds", {}).items()},
            parameters={str(k): str(v) for k, v in table["parameters"].items()},
            constants={str(k): float(v) for k, v in table.get("constants", {}).items()},
            largest_magnitude={int(k): float(v) for k, v in table.get("largest_magnitude", {}).items()},
            lead_s=float(timing["lead_s"]),
            tail_s=float(timing["tail_s"]),
        )
    except tomllib.TOMLDecodeError as error:
        raise TippathError(f"{source}: not TOML: {error}") from error
    except KeyError as error:
        raise TippathError(f"{source}: {error.args[0]} is missing from the vehicle's profile") from error
    except (TypeError, ValueError, AttributeError) as error:
        raise TippathError(f"{source}: {error}") from error
    if profile.chirp_law not in ("table 1", "ardupilot"):
        raise TippathError(f'{source}: chirp_law is "table 1" or "ardupilot", not {profile.chirp_law!r}')
    return profile


def wanted_parameters() -> tuple[tuple[str, ...], ...]:
    """What must be asked of a vehicle to recognise it: each profile's needs, the most particular first."""
    return tuple(profile.needs for profile in bundled_profiles())


def choose_profile(parameters: Mapping[str, float], autopilot: int) -> VehicleProfile:
    """The profile for a vehicle with these parameters. Raises CannotFlyError where none fits."""
    for profile in bundled_profiles():
        if profile.autopilot == autopilot and all(name in parameters for name in profile.needs):
            return profile
    raise CannotFlyError(
        "this vehicle offers no excitation on board: it has no SID_AXIS. On ArduPilot that is firmware built without "
        "the SystemID mode; other autopilots are not supported yet"
    )
