"""A vehicle with what it hides, in its air, in its loop: `planted`'s integrator, all runs side by side."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from planted import SIGNALS, Array, _Flight, in_numbers, integrated

from strangers.hiding import Hidden
from strangers.vehicles import Vehicle

TRIM = (0.02, -0.03, 0.0)
FASTEST = 12.0
"""rad/s, beyond which nothing holds."""
COLLECTIVE = 0.2


@dataclass(frozen=True, kw_only=True)
class Air:
    """All that does not depend on the vehicle's answer; arrays (n, ..., runs)."""

    excitation: Array
    """(n, 3, runs)"""
    gust: Array
    """(n, 2, runs), rad/s^2"""
    noise: Array
    """(n, 2, runs), rad/s, on the gyros"""
    r: Array
    omega: Array
    delta_c: Array
    delta_r: Array

    @property
    def still(self) -> Air:
        """Without gusts and noise."""
        return replace(self, gust=np.zeros_like(self.gust), noise=np.zeros_like(self.noise))

    def runs(self, which: slice) -> Air:
        return Air(**{name: getattr(self, name)[..., which] for name in self.__dataclass_fields__})


@dataclass(frozen=True, kw_only=True)
class Loop:
    """How it is flown."""

    dt: float
    fitted: int
    """Runs, the first ones: their mean is what effects compare with."""
    closed: bool = True

    def trim_of(self, commands: Array) -> Array:
        return np.asarray(np.broadcast_to(np.array(TRIM)[:, None], commands.shape[1:]))


@dataclass(frozen=True, kw_only=True)
class Flown:
    """(n, ..., runs)"""

    commands: Array
    measured: Array
    """p, q as the gyros show them, without their noise."""

    @property
    def holds(self) -> bool:
        """Whether it stayed where a vehicle stays."""
        return bool(np.all(np.isfinite(self.measured)) and np.max(np.abs(self.measured)) < FASTEST)


def flown(vehicle: Vehicle, hidden: Hidden, air: Air, loop: Loop) -> Flown:
    """Fly all runs."""
    E = hidden.equations(vehicle)
    A, B, C = in_numbers(E)
    states = list(E.rows)
    trim = loop.trim_of(air.excitation)
    feedback, command = np.zeros_like(C), trim + air.excitation
    if loop.closed:
        feedback = vehicle.rate_gain @ C
        feedback[:, [states.index("phi"), states.index("theta")]] += vehicle.attitude_gain
        command[:, :2] -= np.einsum("ij,njr->nir", vehicle.rate_gain, air.noise)
    nothing = np.zeros_like(air.r)
    others = hidden.others(np.stack([air.delta_c - COLLECTIVE, air.delta_r], axis=1), loop.dt)
    outside = {
        "c": others[:, 0],
        "r_command": others[:, 1],
        "gust_p": air.gust[:, 0],
        "gust_q": air.gust[:, 1],
        "r": air.r,
    }
    outside["omega"] = hidden.rotor_speed(air.omega, air.delta_c - COLLECTIVE, loop.dt)
    mean = {"omega": np.full(air.r.shape[1], air.omega[:, : loop.fitted].mean()), "airspeed": np.ones(air.r.shape[1])}
    flight = _Flight(
        E,
        A,
        B,
        feedback,
        command,
        np.stack([outside.get(name, nothing) for name in SIGNALS[3:]], axis=1),
        mean,
        trim,
        1 if loop.dt <= 0.002 and E.nonlinear is not None else 2,
        loop.dt,
    )
    with np.errstate(all="ignore"):
        commands, seen = integrated(flight, hidden.actuators(trim, loop.dt))
    return Flown(commands=commands, measured=np.einsum("ij,njr->nir", C, seen))
