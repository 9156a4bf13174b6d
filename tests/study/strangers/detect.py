"""How well a flight could show what is hidden: by the truth, without any fit.

The vehicle with the effect flies its maneuvers in its loop in still air; the base answers to the same commands, and
what is left is divided by the spectrum of what gusts and gyro noise leave of the base, and of what folds back into the
band where the log has not every sample of the loop: noise on the excitation between samples moves the vehicle, and
nobody knows it. What the base's own parameters could make of it, at the values where they make most, is taken away, and
so is lateness of all commands that the log leaves open: where it does not tell its loop, commands held for a sample of
the log act later than they did. The sum is chi squared, expected above the noise; DETECTABLE of it counts 1. Of two,
each is measured beside the other: the vehicle with the other alone answers, and what the base and the other's sizes
could make, at the values where they make most, is taken away.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache

import numpy as np
from numpy.typing import NDArray
from planted import Array, in_numbers
from scipy.optimize import least_squares, minimize_scalar

from strangers.flying import Air, Loop, flown
from strangers.hiding import LARGEST, LEAST, NOTHING, Hidden
from strangers.vehicles import Vehicle, base_of

DETECTABLE = 45.0
"""Chi squared that a test of four numbers at a chance of 1e-4 finds in 95 of 100 flights."""
SMOOTH_HZ = 1.0
A_LITTLE = 0.01
"""Of each parameter, to difference by."""
MOVES = 60
"""Of the base's parameters, to where they make most of what is hidden."""
MOVES_BESIDE, SETTLED, HARDLY_ANY = 15, 1e-3, 0.01
"""The same beside another effect, each of which flies once for every number; the gain in cost that is none; and of that
effect's sizes how much there is of it at least."""
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

    def chi_squared(self, hidden: Hidden) -> float:
        """Of what is hidden, beyond what slopes of the base at the truth imitate: sizes are drawn by it. Infinite where
        the vehicle does not hold."""
        flight = self._flown(hidden)
        if flight is None:
            return float("inf")
        commanded, seen = flight
        expected, weight = self.answered(self.vehicle, NOTHING, commanded), self.weight
        moved = np.fft.rfft(commanded.excitation[:, :2], axis=0)[self.bins]
        slopes = [
            np.einsum("kij,kjr->kir", slope, moved) * weight for slope in self._slopes(self.vehicle.table, self._little)
        ]
        rows = np.stack([_real(one) for one in slopes], axis=1)
        own = np.linalg.qr(rows / (np.linalg.norm(rows, axis=0) + 1e-300))[0]

        def left(late_s: float) -> float:
            wanted = _real((seen - self.late(late_s) * expected) * weight)
            return float(np.sum((wanted - own @ (own.T @ wanted)) ** 2))

        if not self.untold_s:
            return left(0.0)
        return float(minimize_scalar(left, bounds=(0.0, self.untold_s), method="bounded").fun)

    def shown(self, hidden: Hidden) -> float:
        """Chi squared of what is hidden, beyond all that the base imitates, wherever its parameters have to go for it;
        infinite where the vehicle does not hold."""
        flight = self._flown(hidden)
        if flight is None:
            return float("inf")
        commanded, seen = flight
        here = np.zeros(len(self.vehicle.parameters))
        low, high = np.full(here.size, -np.inf), np.full(here.size, np.inf)
        if self.untold_s:
            here, low, high = np.append(here, 0.5), np.append(low, 0.0), np.append(high, 1.0)

        @lru_cache(maxsize=2)
        def beside(moved: tuple[float, ...]) -> tuple[Array, Array]:
            with np.errstate(all="ignore"):  # a base that is not stable
                left, slopes = self.left_by_base(np.array(moved), seen, commanded)
            return _bounded(left), np.nan_to_num(slopes)

        found = least_squares(
            lambda x: beside(tuple(x.tolist()))[0],
            here,
            lambda x: beside(tuple(x.tolist()))[1],
            bounds=(low, high),
            x_scale="jac",
            max_nfev=MOVES,
        )
        return 2 * float(found.cost)

    def shown_beside(self, known: Hidden, hidden: Hidden) -> float:
        """The same of what is hidden, beyond all that the base with what is `known` of it by name imitates, wherever
        those sizes have to go, too, that vehicles have and that are of the same sign. From where they are: what is less
        in another valley is not found, and counts for more than it shows."""
        flight = self._flown(hidden)
        if flight is None:
            return float("inf")
        beside = _Beside(ground=self, known=known, commanded=flight[0], seen=flight[1])
        return 2 * float(
            least_squares(
                beside.left,
                beside.begin,
                beside.slopes,
                bounds=beside.bounds,
                x_scale="jac",
                ftol=SETTLED,
                max_nfev=MOVES_BESIDE,
            ).cost
        )

    def _flown(self, hidden: Hidden) -> tuple[Air, NDArray[np.complex128]] | None:
        """The commands that its loop gives the vehicle with what is hidden, for its excitation, and the spectra
        (bins, 2, runs) of what is seen of it; None where it does not hold."""
        effect = flown(self.vehicle, hidden, self.still, self.loop)
        if not effect.holds:
            return None
        commanded = replace(self.still, excitation=effect.commands - self.loop.trim_of(effect.commands))
        return commanded, np.fft.rfft(effect.measured, axis=0)[self.bins]

    def answered(self, vehicle: Vehicle, known: Hidden, commanded: Air) -> NDArray[np.complex128]:
        """What a vehicle answers to these commands, (bins, 2, runs)."""
        answer = flown(vehicle, known, commanded, replace(self.loop, closed=False)).measured
        return np.asarray(np.fft.rfft(answer, axis=0)[self.bins])

    @property
    def weight(self) -> Array:
        """(bins, 2, 1): one over the noise."""
        return np.sqrt(2 / self.noise)[..., None]

    def late(self, late_s: float) -> NDArray[np.complex128]:
        return np.exp(-self._s * late_s)[:, None, None]

    def left_by_base(self, moved: Array, seen: NDArray[np.complex128], commanded: Air) -> tuple[Array, Array]:
        """What the base, its parameters moved by so many times A_LITTLE, leaves of the rates seen (bins, 2, runs), in
        units of noise, (N,), at a share of the lateness that the log leaves open; and its derivatives (N, moved)."""
        table, little = dict(self.vehicle.table), self._little
        for name, step in zip(self.vehicle.parameters, moved.tolist(), strict=False):
            table[name] += step * little[name]
        late = self.late(moved[-1] * self.untold_s if self.untold_s else 0.0) * self.weight
        expected = self.answered(replace(self.vehicle, table=table), NOTHING, commanded) * late
        command = np.fft.rfft(commanded.excitation[:, :2], axis=0)[self.bins]
        made = [np.einsum("kij,kjr->kir", slope, command) * late for slope in self._slopes(table, little)]
        if self.untold_s:
            made.append(-self.untold_s * self._s[:, None, None] * expected)
        return _real(seen * self.weight - expected), -np.stack([_real(one) for one in made], axis=1)

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


@dataclass(frozen=True, kw_only=True, eq=False)
class _Beside:
    """What the base with something known leaves of a flight, at so many times each of its numbers and of those sizes,
    and one more of the lateness that the log leaves open."""

    ground: Ground
    known: Hidden
    commanded: Air
    seen: NDArray[np.complex128]

    @property
    def begin(self) -> Array:
        begin = np.ones(self.bounds[0].size)
        if self.ground.untold_s:
            begin[-1] = 1.5
        return begin

    @cached_property
    def bounds(self) -> tuple[Array, Array]:
        """What vehicles have of those sizes, and less than all of the lateness."""
        size, count = self.known.sizes[0], len(self.ground.vehicle.parameters)
        least = [LEAST[name] / size[name] if name in LEAST else HARDLY_ANY for name in self._own]
        most = [max(LARGEST.get(name, math.inf) / abs(size[name]), 1 + A_LITTLE) for name in self._own]
        late = self.ground.untold_s > 0
        low, high = [-math.inf] * count + least + [1.0] * late, [math.inf] * count + most + [2.0] * late
        return np.array(low), np.array(high)

    def left(self, scales: Array) -> Array:
        """In units of noise, (N,)."""
        ground, table, sizes = self.ground, dict(self.ground.vehicle.table), dict(self.known.sizes[0])
        numbers = ground.vehicle.parameters
        for name, scale in zip(numbers, scales, strict=False):
            table[name] += (scale - 1) * (table[name] or 1.0)
        for name, scale in zip(self._own, scales[len(numbers) :], strict=False):
            sizes[name] *= scale
        late = ground.late((scales[-1] - 1) * ground.untold_s)
        with np.errstate(all="ignore"):  # a base that is not stable
            there = replace(ground.vehicle, table=table)
            expected = ground.answered(there, replace(self.known, sizes=(sizes,)), self.commanded)
            return _bounded(_real((self.seen - late * expected) * ground.weight))

    def slopes(self, scales: Array) -> Array:
        """Derivatives (N, numbers); beside what moves otherwise than linearly, which takes seconds to fly, those of the
        base alone, and its own from where it begins."""
        numbers = len(self.ground.vehicle.parameters)
        if self.known.equations(self.ground.vehicle).nonlinear is None:
            return self._differences(scales, range(scales.size))
        moved = (scales[:numbers] - 1) / A_LITTLE
        if self.ground.untold_s:
            moved = np.append(moved, scales[-1] - 1)
        with np.errstate(all="ignore"):
            base = np.nan_to_num(self.ground.left_by_base(moved, self.seen, self.commanded)[1])
        return np.concatenate([base[:, :numbers] / A_LITTLE, self._own_slopes, base[:, numbers:]], axis=1)

    @cached_property
    def _own_slopes(self) -> Array:
        numbers = len(self.ground.vehicle.parameters)
        return self._differences(self.begin, range(numbers, numbers + len(self._own)))

    def _differences(self, scales: Array, which: Iterable[int]) -> Array:
        here = self.left(scales)
        steps = [A_LITTLE * (np.arange(scales.size) == i) for i in which]
        return np.stack([(self.left(scales + step) - here) / A_LITTLE for step in steps], axis=1)

    @property
    def _own(self) -> list[str]:
        return [name for name, value in self.known.sizes[0].items() if value]


def _bounded(left: Array) -> Array:
    return np.nan_to_num(left, nan=HUGE, posinf=HUGE, neginf=-HUGE)


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
