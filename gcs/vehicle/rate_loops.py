"""ArduPilot's rate loops of roll and pitch as a vehicle's parameters set them, and what acts besides that no model has.

Of ArduCopter 4.5 to 4.7, multicopter and helicopter, by its documentation and source. Pure: parameters in, loops out.
What lies between the controller's output and the servos or motors (thrust curve, voltage scaling, mixer, swashplate
phase and limits) belongs to the vehicle: a model identified from RATE's outputs has it, as it was in that flight.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Final

from gcs.errors import TippathError
from gcs.vehicle.autopilots import LOOP_RATE
from gcs.vehicle.readiness import GYRO_FILTER
from sysid.rate_loop.settings import AxisLoop, Notch

AXES: Final = {"roll": "RLL", "pitch": "PIT"}
USUAL_LOOP_HZ: Final = 400.0
_GAINS: Final = ("P", "I", "D", "FF", "D_FF", "IMAX", "FLTT", "FLTE", "FLTD")
_NEEDED: Final = ("P", "I", "D", "FLTT", "FLTE", "FLTD")
_SINCE_4_5: Final = "ATC_RAT_RLL_D_FF"
_HELICOPTERS_OWN: Final = "ATC_RAT_RLL_ILMI"
_LEAKY: Final = 1
"""Bit of H_OPTIONS."""
_NOTCH: Final = 1
"""FILTn_TYPE."""
_GYRO_NOTCHES: Final = ("INS_HNTCH", "INS_HNTC2", "INS_HNTC3")
_FIXED: Final = 0
"""INS_HNTCH_MODE of a notch that follows nothing."""


def name_of(axis: str, gain: str) -> str:
    """`ATC_RAT_RLL_P` of `roll` and `P`."""
    return f"ATC_RAT_{AXES[axis]}_{gain}"


@dataclass(frozen=True, kw_only=True)
class RateLoops:
    """Both axes, and what of the vehicle's settings is not in them."""

    roll: AxisLoop
    pitch: AxisLoop
    loop_hz: float
    helicopter: bool
    not_modelled: tuple[str, ...]
    """What is active and not in the loops, a sentence each: gains cannot be designed before it is off."""
    in_the_vehicle: tuple[str, ...]
    """What an identified model has in it, and must find again: it changes the loop's gain."""

    @property
    def without_attitude(self) -> tuple[AxisLoop, AxisLoop]:
        """Roll and pitch, the attitude let go: for targets as they were logged."""
        return replace(self.roll, angle_p=0.0), replace(self.pitch, angle_p=0.0)


def rate_loops(parameters: Mapping[str, float]) -> RateLoops:
    """The loops of these parameters.

    Raises TippathError where they are not those of ArduCopter 4.5 or later, or are no numbers.
    """
    if name_of("roll", "P") not in parameters or _SINCE_4_5 not in parameters:
        if not parameters:
            raise TippathError("no parameters are told, so that the rate loops are not known: take the whole log")
        missing = next(name for name in (name_of("roll", "P"), _SINCE_4_5) if name not in parameters)
        raise TippathError(
            f"no rate loop that is known here: {missing} is not among the {len(parameters)} parameters, which "
            "ArduCopter 4.5 and later have; take a log or a vehicle of such a version"
        )
    if lost := [name for name in _needed() if name not in parameters]:
        raise TippathError(
            f"the parameters are not whole: {', '.join(lost)} not among them, as every such vehicle has; take the "
            "whole log"
        )
    helicopter = _HELICOPTERS_OWN in parameters
    hz = _number(parameters, LOOP_RATE, USUAL_LOOP_HZ)
    if hz <= 0:
        raise TippathError(f"{LOOP_RATE} is {hz:g}: a loop's rate is a positive number of Hz")
    filters: list[str] = []
    roll, pitch = (_axis(parameters, axis, helicopter, filters.append) for axis in AXES)
    return RateLoops(
        roll=roll,
        pitch=pitch,
        loop_hz=hz,
        helicopter=helicopter,
        not_modelled=(*_active(parameters), *filters),
        in_the_vehicle=_in_the_vehicle(parameters, helicopter),
    )


def _needed() -> list[str]:
    """Without which a loop is not known."""
    return [*(name_of(axis, gain) for axis in AXES for gain in _NEEDED), *(f"ATC_ANG_{AXES[axis]}_P" for axis in AXES)]


def _axis(parameters: Mapping[str, float], axis: str, helicopter: bool, say: Callable[[str], None]) -> AxisLoop:
    def value(gain: str) -> float:
        return _number(parameters, name_of(axis, gain))

    p, i, d, ff, d_ff, i_max, target, error, derivative = (value(gain) for gain in _GAINS)
    leaks = helicopter and int(_number(parameters, "H_OPTIONS", _LEAKY)) & _LEAKY
    return AxisLoop(
        p=p,
        i=i,
        d=d,
        ff=ff,
        d_ff=d_ff,
        i_max=abs(i_max),
        leak_min=value("ILMI") if leaks else None,
        pd_max=value("PDMX") if value("PDMX") > 0 else math.inf,
        target_hz=target,
        error_hz=error,
        derivative_hz=derivative,
        target_notch=_notch(parameters, name_of(axis, "NTF"), say),
        error_notch=_notch(parameters, name_of(axis, "NEF"), say),
        angle_p=_number(parameters, f"ATC_ANG_{AXES[axis]}_P"),
        output_max=1.0 if helicopter else math.inf,
    )


def _number(parameters: Mapping[str, float], name: str, usual: float = 0.0) -> float:
    value = parameters.get(name, usual)
    if not math.isfinite(value):
        raise TippathError(f"{name} is {value}: set it to a number")
    return value


def _notch(parameters: Mapping[str, float], name: str, say: Callable[[str], None]) -> Notch | None:
    """The filter that a parameter points to; one that is not set up acts on nothing, as on board."""
    number = int(_number(parameters, name))
    if number == 0:
        return None
    kind = _number(parameters, f"FILT{number}_TYPE")
    frequency, quality, attenuation = (
        _number(parameters, f"FILT{number}_NOTCH_{word}") for word in ("FREQ", "Q", "ATT")
    )
    if kind not in (0, _NOTCH):
        say(f"the filter that {name} points to is of a kind that is not known (FILT{number}_TYPE {kind:g}): set 0")
    if kind != _NOTCH or not (frequency > 0 and quality > 0 and attenuation > 0):
        return None
    return Notch(frequency_hz=frequency, quality=quality, attenuation_db=attenuation)


def _active(parameters: Mapping[str, float]) -> list[str]:
    """What acts on roll and pitch and is not in the loops."""
    said = []
    for axis in AXES:
        slew = name_of(axis, "SMAX")
        if _number(parameters, slew) > 0:
            said.append(f"the slew limit takes P and D of {axis} back while they move fast ({slew}): set it to 0")
    for name, words in (
        ("ATC_THR_G_BOOST", "P and D rise while the throttle moves fast"),
        ("ATC_PIRO_COMP", "the integrators are turned with the yaw"),
        ("H_FLYBAR_MODE", "a flybar takes the pilot's stick past the rate loops"),
        ("CC_TYPE", "a custom controller may fly instead"),
        ("FSTRATE_ENABLE", "the rate loops run faster than the main loop, at a rate that nothing tells"),
    ):
        value = _number(parameters, name)
        if value > 0:
            said.append(f"{words} ({name} {value:g}): set it to 0")
    said.extend(
        f"a notch follows throttle, rotor or spectrum ({prefix}_MODE {parameters[f'{prefix}_MODE']:g}), so that its "
        "lag is not one: fix it (0), or switch it off, for the flight that is identified"
        for prefix in _GYRO_NOTCHES
        if _number(parameters, f"{prefix}_ENABLE") > 0 and _number(parameters, f"{prefix}_MODE", _FIXED) != _FIXED
    )
    return said


def _in_the_vehicle(parameters: Mapping[str, float], helicopter: bool) -> tuple[str, ...]:
    def told(*names: str) -> str:
        return ", ".join(f"{name} {parameters[name]:g}" for name in names if name in parameters)

    words = [("swashplate and its limits", told("H_SW_TYPE", "H_SW_PHANG", "H_SW_H3_PHANG", "H_CYC_MAX"))]
    if not helicopter:
        words = [
            ("thrust curve", told("MOT_THST_EXPO", "MOT_SPIN_MIN", "MOT_SPIN_MAX")),
            ("scaling by voltage", told("MOT_BAT_VOLT_MAX", "MOT_BAT_VOLT_MIN")),
        ]
    return tuple(f"{what} ({values})" for what, values in words if values)


def gyro_filter_hz(parameters: Mapping[str, float], rate_source: str) -> float:
    """The corner of the filter between the rates that a model was fitted to and those that the loops get; 0 for none.

    RATE has the rates of the loops, SIDD those before any filter. Raises TippathError where notches act in between.
    """
    if rate_source != "SIDD":
        return 0.0
    notches = [name for name in (f"{prefix}_ENABLE" for prefix in _GYRO_NOTCHES) if _number(parameters, name) > 0]
    if notches:
        raise TippathError(
            f"the rates of SIDD are before the notches that the loops are behind ({', '.join(notches)}): fit the rates "
            "of RATE, with a profile that takes p and q from there"
        )
    return max(0.0, _number(parameters, GYRO_FILTER))
