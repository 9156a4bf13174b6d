"""The bins of all segments of one sample rate side by side, and what holding and sampling do on them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from sysid.data.preprocess import ComplexArray, Spectrum
from sysid.data.record import FloatArray

FEWEST_BINS = 60
SAME_CLOCK = 3e-5
"""Of a sample, that two may differ by and be taken for one: a log's clock wanders as much from run to run, and poles
that are off by less than it no flight resolves."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Stack:
    """The bins of all segments of one sample rate, side by side."""

    spectra: tuple[Spectrum, ...]
    dt: float
    slices: tuple[slice, ...]
    """Where each segment's bins lie."""
    frequency_hz: FloatArray
    """(bins,)"""
    z: ComplexArray
    """(bins,)"""
    U: ComplexArray
    """(m, bins)"""
    Y: ComplexArray
    """(k, bins)"""
    inputs: tuple[str, ...]
    """Names of the rows of U."""
    scale: FloatArray
    """(bins,): sqrt(2/n) of each bin's segment, which makes every sample of every run count the same."""
    _known: dict[int, Sampling] = field(default_factory=dict)

    @property
    def samples(self) -> int:
        return sum(one.samples for one in self.spectra)

    @cached_property
    def thinned_log(self) -> bool:
        """Whether the vehicle's loop held commands for less than a sample."""
        return self.spectra[0].segment.held_s < self.spectra[0].dt

    @cached_property
    def held_s(self) -> float:
        """How long a command was held, s."""
        return self.spectra[0].segment.held_s if self.thinned_log else self.dt

    @cached_property
    def z_held(self) -> ComplexArray:
        """exp(j omega held_s), (bins,)."""
        return np.asarray(np.exp(2j * np.pi * self.held_s * self.frequency_hz)) if self.thinned_log else self.z

    def kept_of(self, every: int) -> list[NDArray[np.intp]]:
        """Numbers of every so many bins of each segment, at least FEWEST_BINS."""
        return [
            np.arange(part.start, part.stop, max(1, min(every, (part.stop - part.start) // FEWEST_BINS)))
            for part in self.slices
        ]

    def thinned(self, every: int) -> Stack:
        """Every so many bins of each segment, at least FEWEST_BINS: enough for a first look."""
        return self._with(self.kept_of(every))

    def above(self, frequency_hz: float) -> Stack:
        """The bins from a frequency on."""
        return self._with(
            [part.start + np.flatnonzero(self.frequency_hz[part] >= frequency_hz) for part in self.slices]
        )

    def _with(self, kept: Sequence[NDArray[np.intp]]) -> Stack:
        """These bins of each segment alone; segments without any are left out."""
        sizes = [some.size for some in kept if some.size]
        ends, at = np.cumsum(sizes), np.concatenate(kept)
        return Stack(
            spectra=tuple(one for one, some in zip(self.spectra, kept, strict=True) if some.size),
            dt=self.dt,
            slices=tuple(slice(int(end) - size, int(end)) for end, size in zip(ends, sizes, strict=True)),
            frequency_hz=self.frequency_hz[at],
            z=self.z[at],
            U=self.U[:, at],
            Y=self.Y[:, at],
            inputs=self.inputs,
            scale=self.scale[at],
        )

    def sampling(self, order: int) -> Sampling:
        """What holding and sampling do on these bins; worked out once."""
        if order not in self._known:
            self._known[order] = sampling(self, order)
        return self._known[order]


def stack(spectra: Sequence[Spectrum]) -> list[Stack]:
    """Segments of equal sample spacing, and commands held equally long, together."""
    groups: list[list[Spectrum]] = []
    for one in spectra:
        for group in groups:
            if _alike(group[0], one):
                group.append(one)
                break
        else:
            groups.append([one])
    return [_stacked(group) for group in groups]


def _alike(one: Spectrum, other: Spectrum) -> bool:
    near = abs(one.dt - other.dt) < SAME_CLOCK * other.dt
    return near and abs(one.segment.held_s - other.segment.held_s) < SAME_CLOCK * other.dt


def _stacked(group: Sequence[Spectrum]) -> Stack:
    ends = np.cumsum([one.frequency_hz.size for one in group])
    slices = tuple(slice(int(end) - one.frequency_hz.size, int(end)) for end, one in zip(ends, group, strict=True))
    return Stack(
        spectra=tuple(group),
        dt=float(np.mean([one.dt for one in group])),
        slices=slices,
        frequency_hz=np.concatenate([one.frequency_hz for one in group]),
        z=np.concatenate([one.z for one in group]),
        U=np.concatenate([one.U for one in group], axis=1),
        Y=np.concatenate([one.Y for one in group], axis=1),
        inputs=group[0].inputs,
        scale=np.concatenate([np.full(one.frequency_hz.size, np.sqrt(2 / one.samples)) for one in group]),
    )


class Windows:
    """Bins in windows of frequency, the windows side by side; zeros fill up those that have fewer bins than others."""

    def __init__(self, starts: NDArray[np.int64], size: int) -> None:
        """starts (w,): where each window begins among `size` bins in the order of the windows."""
        counts = np.diff(starts, append=size)
        places = np.arange(int(np.max(counts, initial=0)))
        self._there = places < counts[:, None]
        self._at = np.where(self._there, starts[:, None] + places, 0)

    def of(self, rows: NDArray[Any]) -> NDArray[Any]:
        """(r, bins) -> (w, r, bins of the largest window)."""
        return np.asarray(rows[:, self._at].swapaxes(0, 1) * self._there[:, None])

    def back(self, windows: NDArray[Any]) -> NDArray[Any]:
        """(w, r, bins of the largest window) -> (r, bins)."""
        return np.asarray(windows.swapaxes(0, 1)[:, self._there])


class Sampling(NamedTuple):
    """What holding and sampling do on the bins of a stack."""

    s: ComplexArray
    hold: ComplexArray
    """Of a command between samples."""
    images: ComplexArray
    """Of the response's leading term, per unit of its coefficient."""
    jump: ComplexArray
    """Of an end state's leading term 1/s, its first sample included."""
    bend: FloatArray
    """Of its second term, 1/s^2."""


def sampling(stack: Stack, order: int) -> Sampling:
    """Sums over all images of the spectrum, in closed form: trigonometric functions of half a sample."""
    held_s, omega = stack.held_s, 2 * np.pi * stack.frequency_hz
    s = np.asarray(1j * omega, dtype=np.complex128)
    sine, cosine, bend = _half(omega, held_s)
    back = 1 - 1 / stack.z_held
    every = 1j * (cosine / (sine * sine**2) - 1 / (omega * omega**2)) if order == 2 else bend
    images = back / held_s * every
    if stack.thinned_log:  # an end state moves on from sample to sample of the log
        sine, cosine, bend = _half(omega, stack.dt)
    jump = np.asarray(0.5 * stack.dt + 1j * (1 / omega - cosine / sine), dtype=np.complex128)
    return Sampling(s, back / (s * held_s), images, jump, bend)


def _half(omega: FloatArray, dt: float) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Sine over half a sample, and cosine, of half a sample, and what sampling adds to 1/s^2."""
    sine, cosine = np.sin(0.5 * omega * dt) / (0.5 * dt), np.cos(0.5 * omega * dt)
    return sine, cosine, 1 / omega**2 - 1 / sine**2
