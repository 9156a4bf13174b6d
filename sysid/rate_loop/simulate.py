"""What a rate loop puts out for the targets and rates it saw, loop by loop, limits included."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from sysid.data.record import FloatArray
from sysid.rate_loop.settings import LEAK, AxisLoop, Notch, low_pass


@dataclass(frozen=True, eq=False, kw_only=True)
class Loops:
    """What one axis saw, one value a loop; all of shape (n,)."""

    dt: FloatArray
    """s, from the loop before."""
    target: FloatArray
    """rad/s, what this loop is to follow."""
    rate: FloatArray
    """rad/s, as this loop measured it."""
    injected: FloatArray
    """Full command, added to its output."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Simulated:
    """What the loop does; shape (n,), full command."""

    output: FloatArray
    """What is injected included."""
    integrator: FloatArray
    limited: int
    """Loops in which the output was held to its limit, or P and D to theirs."""


def simulate(loop: AxisLoop, seen: Loops, *, began: int = 0, output: FloatArray | None = None) -> Simulated:
    """The loop over what it saw, its filters at rest at the first value.

    With `output`, shape (n,), the integrator takes at loop `began` the value that makes the output of that loop what it
    was; before, and without, it begins at 0. Raises ValueError where `began` is none of the loops.
    """
    n = seen.dt.size
    if not 0 <= began < max(n, 1):
        raise ValueError(f"loop {began} of {n} is none of them")
    filters = _Filters(loop, seen)
    out, integrators, limited = np.zeros(n), np.zeros(n), 0
    integrator = 0.0
    frozen = False
    given = seen.injected.tolist()
    for k, dt in enumerate(seen.dt.tolist()):
        error, derivative, target, target_slope = filters.step(k, dt)
        integrator = _integrated(loop, integrator, error, dt, frozen)
        pd = loop.p * error + loop.d * derivative
        held = max(-loop.pd_max, min(loop.pd_max, pd))
        rest = held + loop.ff * target + loop.d_ff * target_slope + given[k]
        if output is not None and k == began:
            integrator = max(-loop.i_max, min(loop.i_max, float(output[k]) - rest))
        whole = rest + integrator
        out[k] = max(-loop.output_max, min(loop.output_max, whole))
        frozen = out[k] != whole
        integrators[k] = integrator
        limited += frozen or held != pd
    return Simulated(output=out, integrator=integrators, limited=limited)


def _integrated(loop: AxisLoop, integrator: float, error: float, dt: float, frozen: bool) -> float:
    """The integrator after a loop; `frozen` where the output before was limited, so that it may only shrink."""
    if loop.i == 0:
        return 0.0
    if loop.leak_min is not None:
        beyond = max(0.0, abs(integrator) - loop.leak_min)
        integrator -= math.copysign(LEAK * beyond, integrator)
    if frozen and integrator * error >= 0:
        return integrator
    return max(-loop.i_max, min(loop.i_max, integrator + loop.i * dt * error))


class _Filters:
    """Target, error and derivative behind their filters."""

    def __init__(self, loop: AxisLoop, seen: Loops) -> None:
        self._loop = loop
        self._target, self._rate = seen.target.tolist(), seen.rate.tolist()
        dt = float(np.median(seen.dt)) if seen.dt.size else 1.0
        self._target_notch, self._error_notch = _notch(loop.target_notch, dt), _notch(loop.error_notch, dt)
        self._T = self._E = self._D = 0.0

    def step(self, k: int, dt: float) -> tuple[float, float, float, float]:
        """Error, its derivative, target and its slope in loop k."""
        loop, T, E = self._loop, self._T, self._E
        asked = self._target_notch(self._target[k])
        if k == 0:
            self._T = asked
            self._E = self._error_notch(asked - self._rate[0])
            return self._E, 0.0, self._T, 0.0
        self._T = T + low_pass(dt, loop.target_hz) * (asked - T)
        self._E = E + low_pass(dt, loop.error_hz) * (self._error_notch(self._T - self._rate[k]) - E)
        self._D += low_pass(dt, loop.derivative_hz) * ((self._E - E) / dt - self._D)
        return self._E, self._D, self._T, (self._T - T) / dt


def _notch(notch: Notch | None, dt: float) -> Callable[[float], float]:
    """A filter that begins at rest at its first value; its coefficients are those of the loop's usual length."""
    if notch is None:
        return lambda x: x
    (b0, b1, b2), (a1, a2) = notch.coefficients(dt)
    before: list[float] = []

    def step(x: float) -> float:
        if not before:
            before.extend((x, x, x, x))
        x1, x2, y1, y2 = before
        y = b0 * x + b1 * x1 + b2 * x2 - a1 * y1 - a2 * y2
        before[:] = (x, x1, y, y1)
        return y

    return step
