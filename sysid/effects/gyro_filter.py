"""A low-pass filter of second order on both gyros, and the notches that a log tells of.

What the log tells of the autopilot's own filter is applied and not fitted: then the entry has no parameters, and no
low-pass where notches alone are told of; one beside them would be `servo_second_order`, whose equations are the same.
Corner and notches come by names of `sysid.data.gyro_settings` among the constants. A filter of first order is
`gyro_lag`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import cache
from math import inf, pi
from typing import Any

from sysid.data.gyro_settings import BUTTERWORTH, CORNER, NOTCHES, notch_names
from sysid.model.effect import Effect, Equations, Signals, Stage, Surroundings
from sysid.model.parameter import Parameter

AS_LOGGED = "gyro filters that the log tells of"


def adapt(around: Surroundings) -> Effect:
    """With the corner and the notches of the log's settings, where it tells any."""
    notches = tuple(number for number in range(1, NOTCHES + 1) if set(notch_names(number)) <= around.known)
    return _of(CORNER in around.known, notches) if CORNER in around.known or notches else EFFECT


@cache
def _of(corner: bool, notches: tuple[int, ...]) -> Effect:
    return replace(
        EFFECT,
        title=AS_LOGGED,
        parameters=(),
        equations=_equations(_logged_corner if corner else None, notches),
        states=_states(corner, notches),
    )


def _logged_corner(s: Signals) -> tuple[Any, float]:
    return getattr(s, CORNER), BUTTERWORTH


def _fitted_corner(s: Signals) -> tuple[Any, Any]:
    return s.corner, s.zeta


def _equations(low: Callable[[Signals], tuple[Any, Any]] | None, notches: tuple[int, ...]) -> Equations:
    """`low` gives corner and damping ratio of the low-pass, if there is one."""

    def equations(s: Signals) -> Mapping[str, Any]:
        changes: dict[str, Any] = {}
        for axis, rate in (("p", s.p_m), ("q", s.q_m)):
            if low is not None:
                rate = _low_pass(s, changes, axis, rate, low(s))
            for number in notches:
                rate = _notch(s, changes, axis, rate, number)
            changes[f"{axis}_m"] = rate
        return changes

    return equations


def _states(low: bool, notches: tuple[int, ...]) -> tuple[str, ...]:
    words = (*(("low",) if low else ()), *(f"notch{number}" for number in notches))
    return tuple(f"{word}_{axis}{rate}" for axis in ("p", "q") for word in words for rate in ("", "_rate"))


def _low_pass(s: Signals, changes: dict[str, Any], axis: str, rate: Any, low: tuple[Any, Any]) -> Any:
    """y'' + 2 zeta w y' + w^2 y = w^2 rate; gives y."""
    w, zeta = 2 * pi * low[0], low[1]
    y, moving = getattr(s, f"low_{axis}"), getattr(s, f"low_{axis}_rate")
    changes[f"low_{axis}_dot"] = moving
    changes[f"low_{axis}_rate_dot"] = w**2 * (rate - y) - 2 * zeta * w * moving
    return y


def _notch(s: Signals, changes: dict[str, Any], axis: str, rate: Any, number: int) -> Any:
    """(s^2 + left wide s + w^2)/(s^2 + wide s + w^2): the rate less a band-pass of it."""
    frequency, width, left = (getattr(s, name) for name in notch_names(number))
    w, wide = 2 * pi * frequency, 2 * pi * width
    x, moving = getattr(s, f"notch{number}_{axis}"), getattr(s, f"notch{number}_{axis}_rate")
    changes[f"notch{number}_{axis}_dot"] = moving
    changes[f"notch{number}_{axis}_rate_dot"] = rate - w**2 * x - wide * moving
    return rate - (1 - left) * wide * moving


EFFECT = Effect(
    id="gyro_filter",
    title="second-order low-pass of the gyros",
    group="sensors",
    equation="y'' + 2 zeta w y' + w^2 y = w^2 p on both rates, w = 2 pi corner; corner and notches that the log tells "
    "of are applied, not fitted",
    source="the autopilot's filter (ArduPilot's INS_GYRO_FILTER, INS_HNTCH_), the sensor's own, soft mounts",
    signature="phase falls nearly as with a delay, gain only close to the corner, alike on both axes for every input",
    parameters=(
        Parameter(
            "corner",
            "Hz",
            "natural frequency of the filter",
            plausible=(5.0, inf),  # below, nothing can be flown behind it; a high one is no filter at all
            null=inf,
            bounds=(0.3, 1e4),
            typical=20.0,
            grid=(10.0, 20.0, 40.0),
        ),
        Parameter(
            "zeta",
            "-",
            "damping ratio of the filter",
            plausible=(0.3, 1.0),  # Butterworth 0.71, Bessel 0.87, two equal lags 1; soft mounts from 0.3
            bounds=(0.05, 1.0),  # beyond, it would be two lags: `gyro_lag` and less
            typical=BUTTERWORTH,
            grid=(BUTTERWORTH,),
        ),
    ),
    same_as=("servo_second_order",),
    made_of=(("transport_delay", "dynamic_inflow"),),
    stage=Stage.MEASUREMENT,
    order=2,
    equations=_equations(_fitted_corner, ()),
    states=_states(True, ()),
    adapt=adapt,
    null_tolerance=1e-6,
)
