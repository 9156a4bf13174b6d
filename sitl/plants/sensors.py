"""The gyro: what its mount makes of the true rates, plus the rotor's vibration and white noise."""

from __future__ import annotations

import math
import random
from collections.abc import Callable, Sequence
from typing import Protocol

import numpy as np
from scipy.linalg import expm

VIBRATION = 0.035  # rad/s at one per revolution; visible beside a chirp, gone after the 15 Hz low-pass
SECOND_HARMONIC = 0.010  # rad/s at two per revolution, from the two blades
YAW_VIBRATION = 0.01  # rad/s; the shaft direction is the stiff one
NOISE = 0.004  # rad/s per sample; a MEMS gyro at 500 Hz with its own filter open


Rates = tuple[float, float, float]


class Mount(Protocol):
    """Between the airframe and the chip: true p, q, r of this instant -> those of the chip."""

    def step(self, p: float, q: float, r: float) -> Rates: ...


class RotatedChip:
    """The chip sits turned against the airframe by small or large angles about x, y and z, rad, in this order."""

    def __init__(self, roll: float, pitch: float, yaw: float) -> None:
        def about(axis: int, angle: float) -> np.ndarray:
            turn = np.eye(3)
            i, j = (axis + 1) % 3, (axis + 2) % 3
            turn[i, i] = turn[j, j] = math.cos(angle)
            turn[i, j], turn[j, i] = math.sin(angle), -math.sin(angle)
            return turn

        self._rows: list[list[float]] = (about(2, yaw) @ about(1, pitch) @ about(0, roll)).tolist()

    def step(self, p: float, q: float, r: float) -> Rates:
        """Components of one vector in the chip's axes."""
        (xx, xy, xz), (yx, yy, yz), (zx, zy, zz) = self._rows
        return xx * p + xy * q + xz * r, yx * p + yy * q + yz * r, zx * p + zy * q + zz * r


class SoftMount:
    """The chip lags: as a first-order filter (`zeta` None, time constant 1/w) or on a rubber mount (w, zeta).

    Exact for rates that go straight from one sample to the next.
    """

    def __init__(self, w: float, zeta: float | None, dt: float) -> None:
        self._p, self._q, self._r = (_Filter(w, zeta, dt) for _ in range(3))

    def step(self, p: float, q: float, r: float) -> Rates:
        return self._p.step(p), self._q.step(q), self._r.step(r)


class _Filter:
    """One rate behind the mount: position and, of second order, its rate."""

    def __init__(self, w: float, zeta: float | None, dt: float) -> None:
        # Of first order the second state is there and stays at zero.
        A = np.array([[-w, 0.0], [0.0, 0.0]] if zeta is None else [[0.0, 1.0], [-w * w, -2 * zeta * w]])
        B = np.array([w, 0.0] if zeta is None else [0.0, w * w])
        block = np.zeros((4, 4))
        block[:2, :2], block[:2, 2], block[2, 3] = A * dt, B * dt, 1.0
        moved = expm(block)
        self._turn: list[list[float]] = moved[:2, :2].tolist()
        self._to: list[float] = moved[:2, 3].tolist()
        self._from: list[float] = (moved[:2, 2] - moved[:2, 3]).tolist()
        self._state = (0.0, 0.0)
        self._before = 0.0

    def step(self, rate: float) -> float:
        (xx, xv), (vx, vv) = self._turn
        (x, v), old = self._state, self._before
        self._before = rate
        position = xx * x + xv * v + self._from[0] * old + self._to[0] * rate
        self._state = (position, vx * x + vv * v + self._from[1] * old + self._to[1] * rate)
        return position


class Gyro:
    """Body rates as the autopilot sees them."""

    def __init__(self, seed: int, mounts: Sequence[Mount] = (), vibration: float = 1.0) -> None:
        """`vibration` is a factor on what the rotor shakes."""
        self._shaken = (vibration * VIBRATION, vibration * SECOND_HARMONIC, vibration * YAW_VIBRATION)
        self._gauss = random.Random(f"gyro {seed}").gauss
        self._mounts = tuple(mounts)
        self.broken = False
        """It gives no numbers."""

    def measure(self, p: float, q: float, r: float, rotor_angle: float) -> tuple[float, float, float]:
        """True rates in rad/s and the rotor's azimuth in rad -> measured rates in rad/s."""
        for mount in self._mounts:
            p, q, r = mount.step(p, q, r)
        if self.broken:
            return math.nan, math.nan, math.nan
        sine, cosine = math.sin(rotor_angle), math.cos(rotor_angle)
        first, twice, yaw = self._shaken
        second = twice * math.sin(2 * rotor_angle)
        gauss = self._gauss
        return (
            p + first * cosine + second + gauss(0.0, NOISE),
            q + first * sine - second + gauss(0.0, NOISE),
            r + yaw * sine + gauss(0.0, NOISE),
        )


class RateFilter:
    """ArduPilot's low-pass on the gyro: of second order, Butterworth, at INS_GYRO_FILTER Hz; 0 filters nothing.

    The parameter is read in every step.
    """

    def __init__(self, parameter: Callable[[str], float], dt: float) -> None:
        self._parameter = parameter
        self._dt = dt
        self._corner_hz = 0.0
        self._c = (0.0, 0.0, 0.0, 0.0, 0.0)
        self._states = [(0.0, 0.0), (0.0, 0.0), (0.0, 0.0)]
        self._last: Rates = (0.0, 0.0, 0.0)

    def step(self, rates: Rates) -> Rates:
        """Measured rates -> filtered ones; the last ones where no numbers were measured."""
        if not math.isnan(rates[0]):
            self._last = self._step(rates)
        return self._last

    def _step(self, rates: Rates) -> Rates:
        corner_hz = self._parameter("INS_GYRO_FILTER")
        if corner_hz <= 0:
            return rates
        if corner_hz != self._corner_hz:
            self._corner_hz = corner_hz
            self._c = self._coefficients(min(corner_hz, 0.45 / self._dt))
        p, q, r = (self._one(axis, rate) for axis, rate in enumerate(rates))
        return p, q, r

    def _coefficients(self, corner_hz: float) -> tuple[float, float, float, float, float]:
        warped = math.tan(math.pi * corner_hz * self._dt)
        c = 1 + 2 * math.cos(math.pi / 4) * warped + warped**2
        b0 = warped**2 / c
        return b0, 2 * b0, b0, 2 * (warped**2 - 1) / c, (1 - 2 * math.cos(math.pi / 4) * warped + warped**2) / c

    def _one(self, axis: int, rate: float) -> float:
        b0, b1, b2, a1, a2 = self._c
        first, second = self._states[axis]
        now = rate - first * a1 - second * a2
        self._states[axis] = (now, first)
        return now * b0 + first * b1 + second * b2
