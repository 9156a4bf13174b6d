"""How well a flight could show what is hidden: by the truth, without any fit.

The vehicle with the effect flies its maneuvers in its loop in still air; the base answers to the same commands, and
what is left is divided by the spectrum of what gusts and gyro noise leave of the base, and of what folds back into the
band where the log has not every sample of the loop: noise on the excitation between samples moves the vehicle, and
nobody knows it. What the base's own parameters could make of it, at the values where they make most, is taken away, and
so is lateness of all commands that the log leaves open: where it does not tell its loop, commands held for a sample of
the log act later than they did. The sum is chi squared, expected above the noise; DETECTABLE of it counts 1. Of two,
each is measured beside the other: the vehicle with the other alone answers, and what slopes of the base and of the
other's sizes could make is taken away.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from planted import Array, in_numbers
from scipy.optimize import least_squares, minimize_scalar

from strangers.flying import Air, Loop, flown
from strangers.hiding import NOTHING, Hidden
from strangers.vehicles import Vehicle, base_of

DETECTABLE = 45.0
"""Chi squared that a test of four numbers at a chance of 1e-4 finds in 95 of 100 flights."""
SMOOTH_HZ = 1.0
A_LITTLE = 0.01
"""Of each parameter, to difference by."""
MOVES = 60
"""Of the base's parameters, to where they make most of what is hidden."""
HUGE = 1e9
"""What a base leaves that runs away, in units of noise."""


@dataclass(frozen=True, kw_only=True)
class Ground:
    """What an effect is measured against on one flight; runs are the fitted ones."""

    vehicle: Vehicle
    still: Air
    """The maneuvers without gusts and noise."""
    loop: Loop
    bins: NDArray[np.intp]
    """Of the spectra, inside the band."""
    noise: Array
    """(bins, 2): power of what gusts and gyro noise leave, and of what folds back."""
    untold_s: float
    """By which commands may have acted later than they did, for all that the log tells."""

    @classmethod
    def of(
        cls, vehicle: Vehicle, air: Air, loop: Loop, high_hz: float, *, every: int = 1, untold_s: float = 0.0
    ) -> Ground:
        """`every`: samples of the loop for each that is logged."""
        n = air.excitation.shape[0]
        frequencies = np.fft.rfftfreq(n, loop.dt)
        inside = np.flatnonzero((frequencies >= vehicle.band_hz[0]) & (frequencies <= high_hz))
        rest = replace(air, excitation=np.zeros_like(air.excitation))
        left = flown(vehicle, NOTHING, rest, replace(loop, closed=False)).measured + air.noise
        power = np.mean(np.abs(np.fft.rfft(left - left.mean(axis=0), axis=0)) ** 2, axis=2)
        if every > 1:
            power[inside] += _folded(vehicle, air, loop, inside, every)
        width = max(1, round(SMOOTH_HZ * n * loop.dt))
        kernel = np.ones(width) / width
        smooth = np.stack([np.convolve(power[:, i], kernel, mode="same") for i in range(2)], axis=1)
        return cls(vehicle=vehicle, still=air.still, loop=loop, bins=inside, noise=smooth[inside], untold_s=untold_s)

    def chi_squared(self, hidden: Hidden, known: Hidden = NOTHING) -> float:
        """Of what is hidden, beyond what is `known` of it by name and what slopes of the base at the truth imitate:
        sizes are drawn by it. Infinite where the vehicle does not hold."""
        effect = flown(self.vehicle, hidden, self.still, self.loop)
        if not effect.holds:
            return float("inf")
        commanded = replace(self.still, excitation=effect.commands - self.loop.trim_of(effect.commands))
        openly = replace(self.loop, closed=False)
        base = flown(self.vehicle, known, commanded, openly)
        weight = np.sqrt(2 / self.noise)[..., None]
        seen, expected = (np.fft.rfft(one.measured, axis=0)[self.bins] for one in (effect, base))
        moved = np.fft.rfft(commanded.excitation[:, :2], axis=0)[self.bins]
        slopes = [
            np.einsum("kij,kjr->kir", slope, moved) * weight for slope in self._slopes(self.vehicle.table, self._little)
        ]
        for other in _other_sizes(known):
            answer = flown(self.vehicle, other, commanded, openly).measured
            slopes.append(np.fft.rfft(answer - base.measured, axis=0)[self.bins] * weight)
        rows = np.stack([_real(one) for one in slopes], axis=1)
        own = np.linalg.qr(rows / (np.linalg.norm(rows, axis=0) + 1e-300))[0]

        def left(late_s: float) -> float:
            wanted = _real((seen - np.exp(-self._s * late_s)[:, None, None] * expected) * weight)
            return float(np.sum((wanted - own @ (own.T @ wanted)) ** 2))

        if not self.untold_s:
            return left(0.0)
        return float(minimize_scalar(left, bounds=(0.0, self.untold_s), method="bounded").fun)

    def shown(self, hidden: Hidden) -> float:
        """Chi squared of what is hidden, beyond all that the base imitates, wherever its parameters have to go for it;
        infinite where the vehicle does not hold."""
        effect = flown(self.vehicle, hidden, self.still, self.loop)
        if not effect.holds:
            return float("inf")
        commanded = replace(self.still, excitation=effect.commands - self.loop.trim_of(effect.commands))
        seen = np.fft.rfft(effect.measured, axis=0)[self.bins]
        here = np.zeros(len(self.vehicle.parameters))
        low, high = np.full(here.size, -np.inf), np.full(here.size, np.inf)
        if self.untold_s:
            here, low, high = np.append(here, 0.5), np.append(low, 0.0), np.append(high, 1.0)

        @lru_cache(maxsize=2)
        def beside(moved: tuple[float, ...]) -> tuple[Array, Array]:
            with np.errstate(all="ignore"):  # a base that is not stable
                left, slopes = self._beside(np.array(moved), seen, commanded)
            return np.nan_to_num(left, nan=HUGE, posinf=HUGE, neginf=-HUGE), np.nan_to_num(slopes)

        found = least_squares(
            lambda x: beside(tuple(x.tolist()))[0],
            here,
            lambda x: beside(tuple(x.tolist()))[1],
            bounds=(low, high),
            x_scale="jac",
            max_nfev=MOVES,
        )
        return 2 * float(found.cost)

    def _beside(self, moved: Array, seen: NDArray[np.complex128], commanded: Air) -> tuple[Array, Array]:
        """What the base, its parameters moved by so many times A_LITTLE, leaves of the rates seen (bins, 2, runs), in
        units of noise, (N,), at a share of the lateness that the log leaves open; and its derivatives (N, moved)."""
        table, little = dict(self.vehicle.table), self._little
        for name, step in zip(self.vehicle.parameters, moved.tolist(), strict=False):
            table[name] += step * little[name]
        there, weight = replace(self.vehicle, table=table), np.sqrt(2 / self.noise)[..., None]
        base = flown(there, NOTHING, commanded, replace(self.loop, closed=False)).measured
        late_s = moved[-1] * self.untold_s if self.untold_s else 0.0
        late = np.exp(-self._s * late_s)[:, None, None] * weight
        expected = np.fft.rfft(base, axis=0)[self.bins] * late
        command = np.fft.rfft(commanded.excitation[:, :2], axis=0)[self.bins]
        made = [np.einsum("kij,kjr->kir", slope, command) * late for slope in self._slopes(table, little)]
        if self.untold_s:
            made.append(-self.untold_s * self._s[:, None, None] * expected)
        return _real(seen * weight - expected), -np.stack([_real(one) for one in made], axis=1)

    @property
    def _s(self) -> NDArray[np.complex128]:
        """(bins,), 1/s."""
        return np.asarray(2j * np.pi * self.bins / (self.still.excitation.shape[0] * self.loop.dt))

    @property
    def _little(self) -> dict[str, float]:
        """A_LITTLE of each of the base's parameters."""
        table = self.vehicle.table
        return {name: A_LITTLE * table[name] or A_LITTLE for name in self.vehicle.parameters}

    def _slopes(self, table: Mapping[str, float], little: Mapping[str, float]) -> list[NDArray[np.complex128]]:
        """Of the base's response (bins, 2, 2) to so little of each parameter."""
        s, dt = self._s, self.loop.dt
        here = _response(dict(table), s, dt)
        return [_response({**table, name: table[name] + step}, s, dt) - here for name, step in little.items()]


def _other_sizes(known: Hidden) -> list[Hidden]:
    """Each size a little larger, those that are none left out."""
    return [
        replace(
            known,
            sizes=tuple({**each, name: (1 + A_LITTLE) * each[name]} if each is size else each for each in known.sizes),
        )
        for size in known.sizes
        for name, value in size.items()
        if value
    ]


def _folded(vehicle: Vehicle, air: Air, loop: Loop, bins: NDArray[np.intp], every: int) -> Array:
    """(bins, 2): power of rates from beyond half the log's rate, folded back, less the answer to such commands."""
    flight = flown(vehicle, NOTHING, air, loop)
    n = air.excitation.shape[0]

    def back(signal: Array) -> NDArray[np.complex128]:
        moving = signal - signal.mean(axis=0)
        whole = moving[: n - n % every]
        thinned = every * np.fft.rfft(whole[::every], axis=0)
        return np.asarray((thinned - np.fft.rfft(whole, axis=0)[: len(thinned)])[bins])

    s = 2j * np.pi * bins / (n * loop.dt)
    answered = np.einsum("kij,kjr->kir", _response(dict(vehicle.table), s, loop.dt), back(flight.commands[:, :2]))
    return np.asarray(np.mean(np.abs(back(flight.measured + air.noise) - answered) ** 2, axis=2))


def _response(table: dict[str, float], s: NDArray[np.complex128], dt: float) -> NDArray[np.complex128]:
    """(bins, 2, 2): p, q from x, y, held for `dt`."""
    A, B, C = in_numbers(base_of(table))
    n = len(A) - 2  # the attitude comes last, and moves nothing
    inside = s[:, None, None] * np.eye(n) - A[:n, :n]
    hold = (1 - np.exp(-s * dt)) / (s * dt)
    found = C[:, :n] @ np.linalg.solve(inside, np.broadcast_to(B[:n, :2].astype(complex), (s.size, n, 2)))
    return np.asarray(found * hold[:, None, None])


def _real(values: NDArray[np.complex128]) -> Array:
    return np.concatenate([values.real.ravel(), values.imag.ravel()])
