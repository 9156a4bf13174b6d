"""Gusts that come in bursts: how likely chance is where noise is not stationary.

A chirp passes some frequencies in the rough and others in the calm, and what falls together there looks like an answer.
So the power of what a model leaves is followed over time, and tests are held against noise of that power.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from sysid.data.preprocess import ComplexArray, Spectrum
from sysid.data.stacks import Stack
from sysid.model.structure import FloatArray

BURST_S = 0.8
"""Over which power is averaged,"""
FEWEST = 6
"""and over how many bins' worth of time at least."""
ROUGH = 1.5
"""Times the scatter of steady noise's power from one such time to the next, from which on it comes in bursts."""


@dataclass(frozen=True, eq=False)
class Envelope:
    """Power of white rows over time, 1 on average."""

    power: tuple[FloatArray, ...]
    """Of every segment (n,), at as many times as it has bins."""
    outputs: int
    rough: bool
    """Whether it comes and goes more than chance makes it."""

    @classmethod
    def of(cls, rows: FloatArray, stacks: Sequence[Stack]) -> Envelope:
        """Of what is left, (N,), in the rows of a whitening on these stacks."""
        outputs = stacks[0].Y.shape[0]
        spectra = [one for group in stacks for one in group.spectra]
        widths = [_width(one) for one in spectra]
        sizes = [one.frequency_hz.size for one in spectra]
        found = [_around(each, width) for each, width in zip(_power(rows, outputs, sizes), widths, strict=True)]
        whole = sum(float(np.sum(one)) for one in found) / sum(sizes)
        power = [one / max(whole, 1e-300) for one in found]
        scatter = [(one - 1) ** 2 * (width * outputs) for one, width in zip(power, widths, strict=True)]
        return cls(tuple(power), outputs, float(np.mean(np.concatenate(scatter))) > ROUGH**2)

    def gram(self, rows: FloatArray) -> FloatArray:
        """The covariance of inner products of rows (c, N) with such noise, (c, c)."""
        count = len(rows)
        found = np.zeros((count, count))
        parts = _in_time(rows, self.outputs, [one.size for one in self.power])
        for power, part in zip(self.power, parts, strict=True):
            found += np.real((part * power).reshape(count, -1) @ part.reshape(count, -1).conj().T)
        return found


def _power(rows: FloatArray, outputs: int, sizes: Sequence[int]) -> list[FloatArray]:
    """Of a row (N,) over time, of every segment (n,)."""
    return [np.mean(np.abs(part[0]) ** 2, axis=0) for part in _in_time(rows[None], outputs, sizes)]


def _width(one: Spectrum) -> int:
    """Times over which the power of a segment is averaged."""
    size = one.frequency_hz.size
    return min(size, max(FEWEST, round(BURST_S * size / (one.samples * one.dt))))


def _in_time(rows: FloatArray, outputs: int, sizes: Sequence[int]) -> Iterator[ComplexArray]:
    """Rows of a whitening (c, N) in time, (c, outputs, n) of every segment with so many bins."""
    edges = np.cumsum([0, *(2 * outputs * size for size in sizes)])
    for i, j in itertools.pairwise(edges):
        bins = np.ascontiguousarray(rows[:, i:j]).view(complex).reshape(len(rows), outputs, -1)
        yield np.fft.ifft(bins, axis=2, norm="ortho")


def _around(values: FloatArray, width: int) -> FloatArray:
    """Means over so many values around each, the ends joined."""
    whole = np.cumsum(np.concatenate([[0.0], values, values[:width]]))
    return np.asarray(np.roll((whole[width:-1] - whole[: -width - 1]) / width, width // 2))


def as_steady(chi_squared: float, degrees: int, mean: float, deviation: float) -> float:
    """The chi squared of these degrees that steady noise would exceed as often as noise that has this mean and
    deviation of it.

    By Wilson and Hilferty's cube root, of a chi squared drawn out to those.
    """
    there, here = deviation**2 / (9 * mean**2), 2 / (9 * degrees)
    z = ((chi_squared / mean) ** (1 / 3) - (1 - there)) / np.sqrt(there)
    return float(min(chi_squared, degrees * max(0.0, 1 - here + z * np.sqrt(here)) ** 3))
