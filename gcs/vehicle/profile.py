"""What a vehicle makes of a maneuver: which parameters to write, and in words what will really be flown.

A vehicle is known by the parameters it has, not by what it calls itself. The words matter: a card that asks for
Table 1 and meets a vehicle that flies its own law without noise says so before, and in the flight's file.
A maneuver that a vehicle cannot fly is found here, before anything is written to it.

Vehicle profiles are TOML files in `gcs/vehicle/profiles`, or a user's own by path; those of logs (`gcs/logs/profile`)
are another matter. What a profile may hold stands once, in the structs below.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from importlib import resources
from pathlib import Path
from typing import Annotated, Literal

from msgspec import Meta

from gcs import documents
from gcs.cards.maneuver import KINDS, Maneuver
from gcs.document_faults import nearest
from gcs.errors import TippathError
from gcs.vehicle.autopilots import NO_EXCITATION, rotorcraft

_RATE_UNIT = math.degrees(1.0)  # ArduPilot counts its rate axes in deg/s


# --------------------------------------------------------------------------------------------- what a profile may hold

Axis = Literal["roll", "pitch", "elevator", "yaw", "thrust"]
Kind = Literal["chirp", "doublet", "quiet"]
Word = Literal[
    "axis",
    "amplitude",
    "f_start_hz",
    "f_stop_hz",
    "fade_in_s",
    "duration_s",
    "fade_out_s",
    "kind",
    "law",
    "c1",
    "noise_fraction",
    "pulse_s",
    "seed",
]
Small = Annotated[int, Meta(ge=0, le=255)]
Parameter = Annotated[str, Meta(pattern="^[A-Za-z0-9_]{1,16}$")]
Seconds = Annotated[float, Meta(ge=0.0, le=60.0)]


class _Modes(documents.Strict, frozen=True, kw_only=True):
    excitation: Small
    manual_throttle: Annotated[tuple[Small, ...], Meta(min_length=1)]
    """Modes from which a maneuver may start."""


class _Timing(documents.Strict, frozen=True, kw_only=True):
    lead_s: Seconds
    """From entering the mode to the first excitation."""
    tail_s: Seconds
    """From the last excitation to the vehicle's word that it has finished."""


class ProfileDocument(documents.Strict, frozen=True, kw_only=True):
    """A vehicle profile's TOML; what the keys mean stands at `VehicleProfile`."""

    name: Annotated[str, Meta(min_length=1, max_length=100)]
    chirp_law: Literal["table 1", "ardupilot"]
    needs: Annotated[tuple[Parameter, ...], Meta(min_length=1)]
    autopilot: Small
    modes: _Modes
    axes: Annotated[dict[Axis, Small], Meta(min_length=1)]
    rate_axes: dict[Axis, Small] = {}
    kinds: dict[Kind, Small] = {}
    parameters: dict[Word, Parameter]
    constants: dict[Word, float] = {}
    largest_magnitude: dict[int, Annotated[float, Meta(gt=0.0)]]
    timing: _Timing
    cards: dict[Literal["helicopter", "multirotor"], str] = {}

    def problem(self) -> str | None:
        """What does not go together; None where all does."""
        missing = [word for word in ("axis", "amplitude") if word not in self.parameters]
        if missing:
            return f"[parameters]: {missing[0]} is missing"
        unbounded = {*self.axes.values(), *self.rate_axes.values()} - set(self.largest_magnitude)
        if unbounded:
            return (
                f"[largest_magnitude]: {min(unbounded)} is missing: beyond which magnitude a maneuver on that axis "
                "would be dangerous"
            )
        if self.kinds and "kind" not in self.parameters:
            return "[parameters]: kind is missing, which chooses among [kinds]"
        unknown = [word for word in self.constants if word not in self.parameters]
        return f"[constants]: {unknown[0]} is none of [parameters]" if unknown else None


# ------------------------------------------------------------------------------------------------ how it is flown


class CannotFlyError(TippathError):
    """This vehicle cannot fly that; the message says why and what it can."""

    reason = "cannot fly"


@dataclass(frozen=True, slots=True, kw_only=True)
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

    @property
    def size(self) -> str | None:
        """The parameter that scales it; None where nothing is flown."""
        return next(
            (name for word, (name, _) in zip(self.asked, self.writes, strict=True) if word == "amplitude"), None
        )


@dataclass(frozen=True, eq=False, kw_only=True)
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
    cards: Mapping[str, str]
    """Kind of rotorcraft -> the card that is flown where none is named."""

    def own_card(self, vehicle_type: int) -> str | None:
        """The name of the card for a vehicle of this MAV_TYPE where none was asked for; None where it has none."""
        return self.cards.get(rotorcraft(vehicle_type))

    def dangerous(self, axis: float, magnitude: float) -> bool:
        """Whether a maneuver with this magnitude must not be left ready on this axis, however it came there."""
        largest = self.largest_magnitude.get(int(axis))
        return largest is not None and not abs(magnitude) <= largest

    @property
    def offers_our_law(self) -> bool:
        """Whether the vehicle is known by the parameter that chooses Table 1's law, as the simulated one is."""
        return self.parameters.get("law") in self.needs

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
            maneuver=maneuver,
            writes=writes,
            asked=asked,
            words=self._words(maneuver),
            axis_number=axes[maneuver.axis],
            mode=self.excitation_mode,
            lead_s=self.lead_s,
            over_s=over_s,
            finished_s=finished_s,
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


# ------------------------------------------------------------------------------------------------ reading


@cache
def _bundled() -> Mapping[str, VehicleProfile]:
    """Name of the file -> profile."""
    folder = resources.files("gcs.vehicle") / "profiles"
    names = sorted(e.name for e in folder.iterdir() if e.name.endswith(".toml"))
    return {n.removesuffix(".toml"): parse_profile((folder / n).read_text("utf-8"), n) for n in names}


def bundled_profiles() -> tuple[VehicleProfile, ...]:
    """The vehicle profiles of the package, the most particular first."""
    return tuple(sorted(_bundled().values(), key=lambda profile: -len(profile.needs)))


def load_profile(word: str) -> VehicleProfile:
    """A vehicle profile by its file, or by the name of one that comes with the package (`arducopter`).

    Raises DocumentError that names the file, the table and the key.
    """
    path = Path(word)
    if path.is_dir() or not path.exists():
        if word in _bundled():
            return _bundled()[word]
        hint = nearest(word, _bundled())
        raise documents.DocumentError(
            f"{word}: no such vehicle profile; {hint + ' ' if hint else ''}Give a TOML file, or one of "
            f"{', '.join(_bundled())}"
        )
    return parse_profile(documents.read_text(path, "vehicle profile"), word)


def parse_profile(text: str, source: str) -> VehicleProfile:
    """A vehicle profile from TOML text; `source` names it in messages. Raises DocumentError."""
    table = documents.parse_toml(text, ProfileDocument, source)
    problem = table.problem()
    if problem is not None:
        raise documents.DocumentError(f"{source}: {problem}")
    return VehicleProfile(
        name=table.name,
        file=source,
        chirp_law=table.chirp_law,
        needs=table.needs,
        autopilot=table.autopilot,
        excitation_mode=table.modes.excitation,
        manual_throttle_modes=table.modes.manual_throttle,
        axes={str(axis): number for axis, number in table.axes.items()},
        rate_axes={str(axis): number for axis, number in table.rate_axes.items()},
        kinds={str(kind): number for kind, number in table.kinds.items()},
        parameters={str(word): name for word, name in table.parameters.items()},
        constants={str(word): value for word, value in table.constants.items()},
        largest_magnitude=table.largest_magnitude,
        lead_s=table.timing.lead_s,
        tail_s=table.timing.tail_s,
        cards={str(kind): name for kind, name in table.cards.items()},
    )


def wanted_parameters(profiles: Sequence[VehicleProfile] = ()) -> tuple[tuple[str, ...], ...]:
    """What must be asked of a vehicle to recognise it: each profile's needs, the most particular first."""
    return tuple(profile.needs for profile in profiles or bundled_profiles())


def choose_profile(
    parameters: Mapping[str, float], autopilot: int, profiles: Sequence[VehicleProfile] = ()
) -> VehicleProfile:
    """The first of the profiles (without any, those of the package) that fits a vehicle with these parameters.

    Raises CannotFlyError where none fits.
    """
    for profile in profiles or bundled_profiles():
        if profile.autopilot == autopilot and all(name in parameters for name in profile.needs):
            return profile
    raise CannotFlyError(_not_ours(profiles[0], parameters, autopilot) if profiles else NO_EXCITATION)


def _not_ours(profile: VehicleProfile, parameters: Mapping[str, float], autopilot: int) -> str:
    lacking = ", ".join(name for name in profile.needs if name not in parameters)
    why = (
        f"its autopilot is number {autopilot}, the profile's {profile.autopilot}"
        if profile.autopilot != autopilot
        else f"it has no {lacking}"
    )
    return f"this vehicle is not the one of {profile.file}: {why}; give its own profile, or leave it out"
