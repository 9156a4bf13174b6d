"""Gusts that come in bursts: chance made of the residual itself, moved in time.

Tests take noise as stationary. Where it comes in bursts a chirp passes some frequencies in the rough and others in the
calm, and what falls together by chance looks like an answer. So what a model leaves is moved in time, each run by
itself: its bursts stay what they are, and meet the maneuver elsewhere. What the test finds there is chance.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sysid.data.preprocess import ComplexArray
from sysid.data.stacks import Stack
from sysid.model.structure import FloatArray

MOVED = 60
"""Times that runs are moved;"""
STEADY = 1.25
"""and how much wider than of steady noise the test must scatter then: less is the chance of so few."""
BURST_S = 1.5
"""Over which power is averaged: shorter bursts meet a maneuver as often as not."""
LEAST_BINS = 16
"""Of a segment, in that time."""
ROUGH = 1.5
"""Times the scatter of steady noise's power from one such time to the next, from which on it comes in bursts."""


@dataclass(frozen=True, eq=False)
class Envelope:
    """Power of white rows over time, 1 on average: of every segment (n,), at as many times as it has bins."""

    power: tuple[FloatArray, ...]
    outputs: int
    rough: bool
    """Whether it comes and goes more than chance makes it."""

    @classmethod
    def of(cls, rows: FloatArray, stacks: Sequence[Stack]) -> Envelope:
        """Of what is left, (N,), in the rows of a whitening on these stacks."""
        outputs = stacks[0].Y.shape[0]
        whole = float(np.mean(rows**2)) or 1.0
        segments = [one for group in stacks for one in group.spectra]
        power, scatter = [], []
        for one, part in zip(segments, _parts(rows[None], outputs, [each.frequency_hz.size for each in segments])):
            width = min(part.shape[1], max(LEAST_BINS, round(BURST_S * part.shape[1] / (one.samples * one.dt))))
            mean = np.mean(np.abs(part) ** 2, axis=0) / (2 * whole)
            power.append(_around(mean, width))
            scatter.append((power[-1] - 1) ** 2 * (width * outputs))
        return cls(tuple(power), outputs, float(np.mean(np.concatenate(scatter))) > ROUGH**2)

    def gram(self, rows: FloatArray) -> FloatArray:
        """The covariance of inner products of rows (c, N) with such noise, (c, c)."""
        sizes = [one.size for one in self.power]
        count = len(rows)
        found = np.zeros((count, count))
        parts = zip(*(_parts(row[None], self.outputs, sizes) for row in rows), strict=True)
        for power, some in zip(self.power, parts, strict=True):
            weighed = np.stack(some).reshape(count, -1)
            found += np.real((weighed * np.tile(power, self.outputs)) @ weighed.conj().T)
        return found


def _parts(rows: FloatArray, outputs: int, sizes: Sequence[int]) -> list[ComplexArray]:
    """One row of a whitening, (1, N), in time: (outputs, n) of every segment with so many bins."""
    edges = np.cumsum([0, *(2 * outputs * size for size in sizes)])
    pieces = (np.ascontiguousarray(rows[0, i:j]).view(complex) for i, j in itertools.pairwise(edges))
    return [np.fft.ifft(piece.reshape(outputs, -1), axis=1, norm="ortho") for piece in pieces]


def _around(values: FloatArray, width: int) -> FloatArray:
    """Means over so many values around each, the ends joined."""
    whole = np.cumsum(np.concatenate([[0.0], values, values[:width]]))
    return np.asarray(np.roll((whole[width:-1] - whole[: -width - 1]) / width, width // 2))


def as_steady(chi_squared: float, degrees: int, mean: float, deviation: float) -> float:
    """The chi squared of these degrees that steady noise would exceed as often as noise that has this mean and
    deviation of it.

    By Wilson and Hilferty's cube root, of a chi squared drawn out to those.
    """
    if deviation <= STEADY * np.sqrt(2 * degrees):
        return chi_squared
    there, here = deviation**2 / (9 * mean**2), 2 / (9 * degrees)
    z = ((chi_squared / mean) ** (1 / 3) - (1 - there)) / np.sqrt(there)
    return float(min(chi_squared, degrees * max(0.0, 1 - here + z * np.sqrt(here)) ** 3))


def moved_in_time(
    bins: ComplexArray, frequency_hz: FloatArray, segment: NDArray[np.int64], duration_s: Sequence[float]
) -> Iterator[ComplexArray]:
    """Bins (k, n) of segments of these durations, each moved around within its own time; drawn, the same every time."""
    rng = np.random.default_rng(0)
    longest = np.asarray(duration_s)
    for _ in range(MOVED):
        late_s = rng.random(longest.size) * longest
        yield bins * np.exp(-2j * np.pi * frequency_hz * late_s[segment])
