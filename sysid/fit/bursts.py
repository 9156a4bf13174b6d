"""Gusts that come in bursts: how likely chance is where noise is not stationary.

A chirp passes some frequencies in the rough and others in the calm, and what falls together there looks like an answer.
So the power of what a model leaves is followed over time, and tests are held against noise of that power.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np

from sysid.data.preprocess import ComplexArray, Spectrum
from sysid.data.stacks import Stack
from sysid.model.structure import FloatArray

BURST_S = 0.8
"""Over which power is averaged,"""
FEWEST = 6
"""and over how many bins' worth of time at least;"""
LOUD = 4.0
"""Times the average power, from which on a stretch of noise counts as one burst;"""
BAND_HZ = 4.0
"""in bands about so wide."""
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
    """Power of white rows over time, 1 on average, in bands: what blows in a burst has a colour of its own, loud where
    gusts are and not where the gyro's noise is."""

    power: tuple[tuple[FloatArray, ...], ...]
    """Of every segment and band (n,), at as many times as it has bins,"""
    widths: tuple[tuple[int, ...], ...]
    """each averaged over so many."""
    outputs: int
    rough: bool
    """Whether it comes and goes more than chance makes it."""
    _known: list[tuple[FloatArray, list[list[ComplexArray]]]] = field(default_factory=list)
    """Rows that were asked of last, and what they are in time: each question asks more than once."""

    @classmethod
    def of(cls, rows: FloatArray, stacks: Sequence[Stack]) -> Envelope:
        """Of what is left, (N,), in the rows of a whitening on these stacks."""
        outputs = stacks[0].Y.shape[0]
        spectra = [one for group in stacks for one in group.spectra]
        sizes = [_bands(one) for one in spectra]
        widths = tuple(tuple(_width(one, size) for size in each) for one, each in zip(spectra, sizes, strict=True))
        power = tuple(
            tuple(
                _around(np.mean(np.abs(part[0]) ** 2, axis=0), width) for part, width in zip(parts, each, strict=True)
            )
            for parts, each in zip(_in_time(rows[None], outputs, sizes), widths, strict=True)
        )
        cells = [one for each in power for one in each]
        whole = sum(float(np.sum(one)) for one in cells) / sum(one.size for one in cells)
        power = tuple(tuple(one / max(whole, 1e-300) for one in each) for each in power)
        scatter = [
            (one - np.mean(one)) ** 2 * (width * outputs)
            for each, wide in zip(power, widths, strict=True)
            for one, width in zip(each, wide, strict=True)
        ]
        return cls(power, widths, outputs, float(np.mean(np.concatenate(scatter))) > ROUGH**2)

    def gram(self, rows: FloatArray) -> FloatArray:
        """The covariance of inner products of rows (c, N) with such noise, (c, c)."""
        count = len(rows)
        found = np.zeros((count, count))
        for power, _, part in self._cells(rows):
            found += np.real((part * power).reshape(count, -1) @ part.reshape(count, -1).conj().T)
        return found

    def covariance(self, rows: FloatArray, residual: FloatArray) -> FloatArray:
        """The same, but that a loud burst of the residual (N,) counts as one draw: what the excitation did to commands
        while it blew holds some of it, too, so that it meets itself, by more than its power says."""
        found = self.gram(rows)
        for (power, width, part), (_, _, left) in zip(self._cells(rows), self._cells(residual[None]), strict=True):
            met = np.real(np.einsum("ckt,kt->ct", part, left[0].conj()))
            starts = np.arange(0, power.size, width)
            loud = np.add.reduceat(power, starts) > LOUD * np.diff([*starts, power.size])
            bursts = np.add.reduceat(met, starts, axis=1)[:, loud]
            found += bursts @ bursts.T
        return found

    def surely(self, chi_squared: float, degrees: int, rows: FloatArray) -> float:
        """The chi squared that noise of known power would exceed as often as noise of this power does this one, along
        rows (c, N): power followed over little time is known badly, and what meets few bursts hangs on few of those."""
        whole, spread = 0.0, 0.0
        size = np.maximum(np.einsum("ij,ij->i", rows, rows), 1e-300)
        for power, width, part in self._cells(rows):
            met = power * np.einsum("ckt,c->t", np.abs(part) ** 2, 1 / size)
            each = np.add.reduceat(met, np.arange(0, met.size, width))
            whole += float(np.sum(each))
            spread += float(np.sum(each**2)) / (width * self.outputs)
        return as_known(chi_squared, degrees, 2 * whole**2 / max(spread, 1e-300))

    def _cells(self, rows: FloatArray) -> Iterator[tuple[FloatArray, int, ComplexArray]]:
        """Of every segment and band power (n,), averaged over how many times, and rows in time (c, outputs, n)."""
        found = next((found for known, found in self._known if known is rows), None)
        if found is None:
            sizes = [tuple(one.size for one in each) for each in self.power]
            found = list(_in_time(rows, self.outputs, sizes))
            self._known[:] = [*self._known[-1:], (rows, found)]
        for power, widths, parts in zip(self.power, self.widths, found, strict=True):
            yield from zip(power, widths, parts, strict=True)


def _bands(one: Spectrum) -> tuple[int, ...]:
    """Bins of each band of a segment."""
    bins, low, high = one.frequency_hz.size, float(one.frequency_hz[0]), float(one.frequency_hz[-1])
    count = max(1, min(round((high - low) / BAND_HZ), bins // FEWEST))
    edges = np.linspace(0, bins, count + 1).round().astype(int)
    return tuple(np.diff(edges).tolist())


def _width(one: Spectrum, bins: int) -> int:
    """Times over which the power of so many bins of a segment is averaged."""
    return min(bins, max(FEWEST, round(BURST_S * bins / (one.samples * one.dt))))


def _in_time(rows: FloatArray, outputs: int, sizes: Sequence[Sequence[int]]) -> Iterator[list[ComplexArray]]:
    """Rows of a whitening (c, N) in time, (c, outputs, n) of every segment and band with so many bins."""
    edges = np.cumsum([0, *(2 * outputs * sum(each) for each in sizes)])
    for i, j, each in zip(edges[:-1], edges[1:], sizes, strict=True):
        bins = np.ascontiguousarray(rows[:, i:j]).view(complex).reshape(len(rows), outputs, -1)
        parts = np.split(bins, np.cumsum(each)[:-1], axis=2)
        yield [np.fft.ifft(part, axis=2, norm="ortho") for part in parts]


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
