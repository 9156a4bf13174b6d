"""Gusts that come in bursts: how likely chance is where noise is not stationary.

A chirp passes some frequencies in the rough and others in the calm, and what falls together there looks like an answer.
So the power of what a model leaves is followed over time, and tests are held against noise of that power.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Iterator, Sequence
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
LOOKS = (8, 16, 32)
"""Draws of what chance makes, after which it is asked whether more of them could change the answer,"""
UNLIKELY = 1e-3
"""but for this chance that these scatter so much more, or less, than all would."""
SURE = 3.0
"""Standard errors of their mean that it may be off by."""


@dataclass(frozen=True, eq=False)
class Envelope:
    """Power of white rows over time, 1 on average."""

    power: tuple[FloatArray, ...]
    """Of every segment (n,), at as many times as it has bins,"""
    widths: tuple[int, ...]
    """each averaged over so many."""
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
        return cls(tuple(power), tuple(widths), outputs, float(np.mean(np.concatenate(scatter))) > ROUGH**2)

    def gram(self, rows: FloatArray) -> FloatArray:
        """The covariance of inner products of rows (c, N) with such noise, (c, c)."""
        count = len(rows)
        found = np.zeros((count, count))
        for power, part in zip(self.power, self._in_time(rows), strict=True):
            found += np.real((part * power).reshape(count, -1) @ part.reshape(count, -1).conj().T)
        return found

    def surely(self, chi_squared: float, degrees: int, rows: FloatArray) -> float:
        """The chi squared that noise of known power would exceed as often as noise of this power does this one, along
        rows (c, N): power followed over little time is known badly, and what meets few bursts hangs on few of those."""
        whole, spread = 0.0, 0.0
        size = np.maximum(np.einsum("ij,ij->i", rows, rows), 1e-300)
        for power, width, part in zip(self.power, self.widths, self._in_time(rows), strict=True):
            met = power * np.einsum("ckt,c->t", np.abs(part) ** 2, 1 / size)
            each = np.add.reduceat(met, np.arange(0, met.size, width))
            whole += float(np.sum(each))
            spread += float(np.sum(each**2)) / (width * self.outputs)
        return as_known(chi_squared, degrees, 2 * whole**2 / max(spread, 1e-300))

    def _in_time(self, rows: FloatArray) -> Iterator[ComplexArray]:
        return _in_time(rows, self.outputs, [one.size for one in self.power])


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


def as_steady_by(draws: Iterable[float], chi_squared: float, degrees: int, within: float, beyond: float) -> float:
    """The same by draws of what such noise makes of it, which are made while it may still be between `within` and
    `beyond`: what is surely less, or more, is known well enough by the first of them."""
    seen: list[float] = []
    for one in draws:
        seen.append(one)
        if len(seen) in LOOKS:
            least, most = _steady_between(chi_squared, degrees, seen)
            if least >= beyond or most < within:
                break
    return as_steady(chi_squared, degrees, float(np.mean(seen)), float(np.std(seen)))


def _steady_between(chi_squared: float, degrees: int, seen: Sequence[float]) -> tuple[float, float]:
    """What it may be at least and at most by many more draws, which may be larger and scatter more than those seen."""
    # heavier than NumPy itself to load: only where it is needed
    from scipy.special import chdtri

    mean, square, count = float(np.mean(seen)), float(np.var(seen)) * len(seen), len(seen)
    narrow, wide = (float(np.sqrt(square / chdtri(count - 1, chance))) for chance in (UNLIKELY, 1 - UNLIKELY))
    off = SURE / np.sqrt(count)
    least = as_steady(chi_squared, degrees, mean + off * wide, wide)
    return least, as_steady(chi_squared, degrees, max(mean - off * wide, 0.5 * mean), narrow)


def as_known(chi_squared: float, degrees: int, freedom: float) -> float:
    """The chi squared that is exceeded as often where noise is known as this one where it is estimated with so many
    degrees of freedom, by Snedecor's F."""
    # heavier than NumPy itself to load: only where it is needed
    from scipy.special import chdtri, fdtrc

    chance = float(fdtrc(degrees, freedom, chi_squared / degrees))
    return min(chi_squared, float(chdtri(degrees, chance))) if 0 < chance < 1 else chi_squared
