"""A stock autopilot's own loops of roll and pitch: an angle asks for a rate, and a rate controller follows it.

Written from ArduCopter's documentation, and from nothing that this project fits or designs with. A loop first answers
the rate that was asked for in the loop before, then asks for the next: what it logs as wanted is the next loop's, and a
sweep acts one loop after it is logged.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from sitl.autopilot.parameters import Parameters
from sitl.autopilot.systemid import Added
from sitl.plants import Plant
from sitl.plants.actuators import clip

LEAK = 0.02
"""Of what an integrator is beyond its leak minimum, in every loop."""


class Smooth:
    """A low-pass of first order, as a fixed weight on what is new."""

    def __init__(self, corner_hz: float, dt: float) -> None:
        self._weight = 1.0 if corner_hz <= 0 else dt / (dt + 0.5 / (math.pi * corner_hz))
        self.value: float | None = None

    def step(self, new: float, first: float) -> float:
        """`first` is what it begins with."""
        self.value = first if self.value is None else self.value + self._weight * (new - self.value)
        return self.value


@dataclass(frozen=True, slots=True, kw_only=True)
class RateGains:
    """Of one axis, as its parameters are called."""

    p: float
    i: float
    d: float
    ff: float
    d_ff: float
    imax: float
    pdmx: float
    ilmi: float | None
    """None where the integrator does not leak."""


class RateController:
    """One axis: rad/s asked for and measured -> command. Its filters begin anew when its settings change."""

    def __init__(self, gains: RateGains, corners_hz: tuple[float, float, float], dt: float, trim: float = 0.0) -> None:
        """`corners_hz` of target, error and derivative; `trim` is what the integrator begins with."""
        self._gains, self._dt = gains, dt
        self._target, self._error, self._slope = (Smooth(corner, dt) for corner in corners_hz)
        self.trim = trim

    def step(self, asked: float, measured: float, held_back: bool) -> float:
        """`held_back`: the output reached its limit in the loop before, so that the integrator may only shrink."""
        gains, dt = self._gains, self._dt
        target_before, error_before = self._target.value, self._error.value
        target = self._target.step(asked, asked)
        error = self._error.step(target - measured, target - measured)
        rise = 0.0 if error_before is None else (error - error_before) / dt
        target_rise = 0.0 if target_before is None else (target - target_before) / dt
        slope = self._slope.step(rise, 0.0)
        self._accumulate(error, held_back)
        push = gains.p * error + gains.d * slope
        if gains.pdmx > 0:
            push = min(max(push, -gains.pdmx), gains.pdmx)
        return push + self.trim + gains.ff * target + gains.d_ff * target_rise

    def _accumulate(self, error: float, held_back: bool) -> None:
        gains = self._gains
        if gains.i == 0:
            self.trim = 0.0
            return
        if gains.ilmi is not None and abs(self.trim) > gains.ilmi:
            self.trim -= LEAK * (self.trim - math.copysign(gains.ilmi, self.trim))
        if not held_back or self.trim * error < 0:
            self.trim = min(max(self.trim + gains.i * error * self._dt, -gains.imax), gains.imax)


class StockControllers:
    """Roll and pitch under the vehicle's parameters as they are at the time."""

    has_lqr = False
    elevator = 0.0

    def __init__(self, parameters: Parameters, dt: float) -> None:
        self._parameters, self._dt = parameters, dt
        self._written = -1
        self._loops: list[RateController] = []
        self._angle_p = (0.0, 0.0)
        self._asked = self._injected = (0.0, 0.0)
        self._held_back = [False, False]

    def take_bank(self, bank: Sequence[float] | None) -> None:
        """It has no bank."""

    def step(
        self, plant: Plant, gyro: tuple[float, float, float], added: Added, lqr_selected: bool
    ) -> tuple[float, float, float, float]:
        """Commands really sent, excitation and limits included, and the rates that the next loop is asked for."""
        self._keep_gains()
        sent = []
        for axis, loop in enumerate(self._loops):
            whole = loop.step(self._asked[axis], gyro[axis], self._held_back[axis]) + self._injected[axis]
            sent.append(clip(whole))
            self._held_back[axis] = sent[axis] != whole
        roll, pitch, _ = added.angle
        p, q, _ = added.rate
        of_roll, of_pitch = self._angle_p
        self._asked = (of_roll * (roll - plant.phi) + p, of_pitch * (pitch - plant.theta) + q)
        self._injected = (added.x, added.y)
        return sent[0], sent[1], *self._asked

    def _keep_gains(self) -> None:
        if self._parameters.writes == self._written:
            return
        before = [loop.trim for loop in self._loops] or [0.0, 0.0]
        self._written = self._parameters.writes
        self._loops = [self._loop(axis, trim) for axis, trim in zip(("RLL", "PIT"), before, strict=True)]
        self._angle_p = (self._parameters["ATC_ANG_RLL_P"], self._parameters["ATC_ANG_PIT_P"])

    def _loop(self, axis: str, trim: float) -> RateController:
        def value(name: str) -> float:
            return self._parameters[f"ATC_RAT_{axis}_{name}"]

        leaks = f"ATC_RAT_{axis}_ILMI" in self._parameters
        gains = RateGains(
            p=value("P"),
            i=value("I"),
            d=value("D"),
            ff=value("FF"),
            d_ff=value("D_FF"),
            imax=value("IMAX"),
            pdmx=value("PDMX"),
            ilmi=value("ILMI") if leaks else None,
        )
        return RateController(gains, (value("FLTT"), value("FLTE"), value("FLTD")), self._dt, trim)
