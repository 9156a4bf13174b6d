"""How much of a residual a recorded signal explains, and what is left as noise.

Whatever linear dynamics a structure lacks, its residual is then a response to the commands. In narrow windows of
frequency, all runs together, any such response is nearly a straight line over frequency, so a few complex numbers a
window find it without a model. What they do not find is noise, and what a nonlinearity makes of the commands.

Gusts reach the commands through the feedback. Only what the logged excitation caused in a command explains a residual
here; where no excitation is logged the commands stand for themselves, and what they explain is an upper bound.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from copy import deepcopy
from dataclasses import dataclass, field
from functools import cached_property, lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sysid.data.instrument import Causes
from sysid.data.preprocess import ComplexArray, gusts_kept_out
from sysid.data.stacks import Stack, Windows
from sysid.fit.bursts import as_steady_by
from sysid.fit.output_error import OutputError
from sysid.fit.rows import orthonormal_each
from sysid.model.structure import FloatArray

WINDOW_HZ = 0.5
NEIGHBOURS = 1
"""Windows to either side that share in a window's noise spectrum where it weighs residuals."""
FEWEST_FOR_ENDS = 6
"""Bins of a segment in a window from which on its ends are taken out."""
REFERENCES_RANK = 1e-9
LEAST_FREEDOM = 4
"""Bins beyond the unknowns that a window needs."""
WORTH_A_LOOK = 2.0
"""Standard deviations of chi squared, from which on it is asked what chance alone would make of it,"""
SHIFTS = 60
"""by so many draws of when each run's references were, at most;"""
FOUND = 1.5
"""Times what noise alone would have explained, that what is explained counts as noise at most: to references at another
time it is noise, too, and what is surely none would make itself small;"""
NO_CHANCE = 5.0
"""and standard deviations from which on it is none, and chi squared as large as it is."""
LEAST_LEVEL = 1e-12
FINER = 2 / 3
"""Lower edge over upper of the lowest windows where white rows are looked at,"""
BINS_FOR_EACH = 2
"""that have so many bins for each unknown."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Division:
    """A residual's power by window and output, divided; every sample of every run counts the same."""

    edges_hz: FloatArray
    """(w + 1,), of the windows."""
    power: FloatArray
    """(w, k), (rad/s)^2 summed over samples."""
    explained: FloatArray
    """(w, k), of it what the commands explain, less what they would seem to explain of noise; may be negative."""
    by_command: FloatArray
    """(w, k, m), what each command alone explains, in the same way."""
    commands: tuple[str, ...]
    references: tuple[str, ...]
    """For each command the channel that gusts do not reach, or the command itself where none is logged."""
    level: ComplexArray
    """(w, k, k), the noise's spectral matrix in each window, scaled as a stack's residual is."""
    asked: Callable[[], tuple[float, int]]
    """For chi squared and its degrees of freedom: a question that takes longer than all else, and is often not put."""

    @cached_property
    def _surprise(self) -> tuple[float, int]:
        return self.asked()

    @property
    def chi_squared(self) -> float:
        """Of all windows together against the noise spectrum: whether anything is explained at all."""
        return self._surprise[0]

    @property
    def degrees(self) -> int:
        """Of freedom, of that."""
        return self._surprise[1]

    def at(self, frequency_hz: FloatArray) -> ComplexArray:
        """The noise's spectral matrix at these frequencies, (f, k, k), scaled as a stack's residual is."""
        centres = 0.5 * (self.edges_hz[:-1] + self.edges_hz[1:])
        k = self.level.shape[1]
        return np.stack(
            [
                np.stack([_between(frequency_hz, centres, self.level[:, i, j]) for j in range(k)], axis=-1)
                for i in range(k)
            ],
            axis=-2,
        )

    @property
    def noise_share(self) -> FloatArray:
        """(k,), of the residual's power, 0..1."""
        whole = np.maximum(np.sum(self.power, axis=0), 1e-300)
        return np.asarray(np.clip(1 - np.sum(self.explained, axis=0) / whole, 0, 1))

    @property
    def measured(self) -> bool:
        """Whether logged excitation kept the gusts out; else what is explained is an upper bound."""
        return gusts_kept_out(self.references)


def divide(error: OutputError, stacks: Sequence[Stack], by: Causes, window_hz: float | None = None) -> Division:
    """Divide what a model leaves of the stacks into what the commands explain and noise.

    A window is WINDOW_HZ wide, or `window_hz` where short runs have too few bins in so narrow a one.
    """
    scale = np.concatenate([group.scale for group in stacks])
    asked = _Asked.of(scale * np.concatenate(error.residuals, axis=1), stacks, by, window_hz or WINDOW_HZ)
    explained, count = asked.explained, asked.on.edges_hz.size - 1
    around = np.array([_neighbours(explained.rest, number) for number in range(count)])
    freedom = np.array([max(_neighbours(explained.free, number), 1.0) for number in range(count)])
    S = around / freedom[:, None, None]
    own = np.real(np.einsum("wkk->wk", S))
    tiny = LEAST_LEVEL * np.max(own, initial=1e-300)
    unknown = explained.unknown
    return Division(
        edges_hz=asked.on.edges_hz,
        power=explained.power,
        explained=np.real(np.einsum("wkk->wk", explained.found)) - unknown[:, None] * own,
        by_command=explained.by_command - np.minimum(2, unknown)[:, None, None] * own[:, :, None],
        commands=by.commands,
        references=by.references,
        level=S + tiny * np.eye(S.shape[1]),
        asked=lambda: asked.surprise(tiny),
    )


def surprise(white: ComplexArray, stacks: Sequence[Stack], by: Causes) -> tuple[float, int]:
    """What the commands explain of white rows (k, bins), all stacks': chi squared, and its degrees of freedom."""
    return _Asked.of(white, stacks, by, WINDOW_HZ).surprise(LEAST_LEVEL)


@dataclass(frozen=True, eq=False, kw_only=True)
class Caused:
    """What the references span of white rows: there what was commanded shows, and little of the gusts."""

    order: NDArray[np.intp]
    """(bins,), window after window;"""
    span: _Span

    @classmethod
    @lru_cache(maxsize=8)
    def by(cls, by: Causes, stacks: tuple[Stack, ...], below_hz: float = math.inf) -> Caused:
        """Of bins below a frequency alone. Kept: every whitening asks it of the same runs."""
        frequency, segment, edges = _laid_out(stacks, WINDOW_HZ)
        edges = _finer_below(edges, frequency, 2 * len(by.commands) + segment[-1] + 1)
        scale = np.concatenate([group.scale for group in stacks])
        order, starts = _cut(frequency, edges)
        count = max(1, int(np.searchsorted(edges[1:], below_hz, side="right")))
        edges, starts = edges[: count + 1], starts[: count + 1]
        order = order[: starts[-1]]
        z = (scale * np.concatenate(by.reference, axis=1))[:, order]
        return cls(order=order, span=_Span.of(z, _places(frequency[order], edges, starts), segment[order], starts))

    def of(self, white: ComplexArray) -> FloatArray:
        """Of white rows (k, bins), all stacks', what lies in that span: real numbers whose noise is white, too."""
        there = self.span.windows.of(white[:, self.order]) @ self.span.basis.conj().swapaxes(1, 2)
        return np.ascontiguousarray(there).view(float).ravel()

    def beyond(self, white: ComplexArray) -> ComplexArray:
        """Of white rows (k, bins) what does not lie there."""
        rest = white.copy()
        rest[:, self.order] = self.beyond_there(white[:, self.order])
        return rest

    def beyond_there(self, white: ComplexArray) -> ComplexArray:
        """The same of rows (r, bins) whose bins are in this order."""
        windows, basis = self.span.windows, self.span.basis
        Y = windows.of(white)
        return windows.back(Y - (Y @ basis.conj().swapaxes(1, 2)) @ basis)

    def power_beyond(self, white: ComplexArray) -> FloatArray:
        """(bins,), of white rows (k, bins) the power that does not lie there, all outputs together: about 2 k, were it
        white noise."""
        span, rest = self.span, self.beyond_there(white[:, self.order])
        bins = span.unknown + span.free + span.ends.unknown
        power = np.empty(self.order.size)
        power[self.order] = np.sum(np.abs(rest) ** 2, axis=0) * np.repeat(
            bins / np.maximum(bins - span.unknown, 1), bins
        )
        return power


@dataclass(frozen=True, eq=False, kw_only=True)
class _Layout:
    """Bins in windows, and what the references span there: all that no residual has a part in."""

    edges_hz: FloatArray
    order: NDArray[np.int64]
    """Of the bins, window after window,"""
    place: FloatArray
    """(bins,), where each is within its window, -1..1,"""
    segment: NDArray[np.int64]
    """(bins,), that it belongs to,"""
    starts: NDArray[np.int64]
    """(w + 1,), where windows begin,"""
    turns: FloatArray
    """(bins,), and how often the bin's frequency turns in the time of its segment."""
    reference: ComplexArray
    """(m, bins), the references there,"""
    span: _Span
    """what they span,"""
    lines: tuple[ComplexArray, ...]
    """and what was caused in each command alone does, (w, 2, bins of the largest window)."""
    rank: NDArray[np.int64]
    """(segments,), each one's place by its log and its time there: which draw is its, in whatever order runs came."""
    _draws: list[np.random.Generator] = field(default_factory=lambda: np.random.default_rng(1).spawn(SHIFTS))
    _late: list[_Span] = field(default_factory=list)

    @classmethod
    def of(cls, stacks: Sequence[Stack], by: Causes, window_hz: float) -> _Layout:
        scale = np.concatenate([group.scale for group in stacks])
        frequency, segment, edges = _laid_out(stacks, window_hz)
        x, z = (scale * np.concatenate(each, axis=1) for each in (by.caused, by.reference))
        order, starts = _cut(frequency, edges)
        place = _places(frequency[order], edges, starts)
        x, z = x[:, order], z[:, order]
        spectra = [one for group in stacks for one in group.spectra]
        seconds = np.array([one.samples * one.dt for one in spectra])
        logged = [(one.segment.record.sha256, one.segment.start_s) for one in spectra]
        span = _Span.of(z, place, segment[order], starts)
        return cls(
            edges_hz=edges,
            order=order,
            place=place,
            segment=segment[order],
            starts=starts,
            turns=(frequency * seconds[segment])[order],
            reference=z,
            span=span,
            lines=tuple(
                orthonormal_each(span.windows.of(np.stack([row, place * row])), REFERENCES_RANK)
                for row in span.ends.less(x)
            ),
            rank=np.argsort(sorted(range(len(logged)), key=logged.__getitem__)),
        )

    def late(self) -> Iterator[_Span]:
        """What references span that were at another time in each run: they explain nothing, and meet the noise as it
        comes and goes. Each draw is made once, whatever is held against it."""
        for number, rng in enumerate(self._draws):
            if number == len(self._late):
                late = deepcopy(rng).uniform(0.0, 1.0, self.rank.size)[self.rank]  # the same after an interrupt
                shifted = self.reference * np.exp(-2j * np.pi * self.turns * late[self.segment])
                self._late.append(_Span.of(shifted, self.place, self.segment, self.starts))
            yield self._late[number]


@lru_cache(maxsize=4)
def _layout(stacks: tuple[Stack, ...], by: Causes, window_hz: float) -> _Layout:
    """Kept: every candidate's residual is asked on the same bins."""
    return _Layout.of(stacks, by, window_hz)


@dataclass(frozen=True, eq=False, kw_only=True)
class _Asked:
    """A residual held against what the references span, window by window."""

    on: _Layout
    residual: ComplexArray
    """(k, bins), window after window."""
    explained: _Explained

    @classmethod
    def of(cls, y: ComplexArray, stacks: Sequence[Stack], by: Causes, window_hz: float) -> _Asked:
        on = _layout(tuple(stacks), by, window_hz)
        y = y[:, on.order]
        return cls(on=on, residual=y, explained=_explained(y, on))

    def surprise(self, tiny: float) -> tuple[float, int]:
        """Chi squared of all windows, and its degrees of freedom; `tiny` is a power that all noise has."""
        asked = self.explained
        chi_squared, degrees = _surprise(asked.found, asked.rest, asked.unknown, asked.free, tiny)
        if chi_squared > degrees + WORTH_A_LOOK * np.sqrt(2 * degrees):
            noise = self._noise()
            draws = (_by_chance(noise, span, tiny) for span in self.on.late())
            within, beyond = (float(degrees + times * np.sqrt(2 * degrees)) for times in (WORTH_A_LOOK, NO_CHANCE))
            steady = as_steady_by(draws, chi_squared, degrees, within, beyond)
            if steady < beyond:
                chi_squared = steady
        return chi_squared, degrees

    def _noise(self) -> ComplexArray:
        """The residual's bins (w, k, bins of the largest window), what is explained counting as much as noise may."""
        span, explained = self.on.span, self.explained
        Y = span.windows.of(span.ends.less(self.residual))
        by_chance = explained.unknown * _power(explained.rest) / np.maximum(explained.free, 1.0)
        kept = np.sqrt(np.minimum(1.0, FOUND * by_chance / np.maximum(_power(explained.found), 1e-300)))
        return np.asarray(Y - (1 - kept)[:, None, None] * (Y @ span.basis.conj().swapaxes(1, 2)) @ span.basis)


def _by_chance(noise: ComplexArray, span: _Span, tiny: float) -> float:
    """Chi squared of noise (w, k, bins of the largest window) held against what explains nothing."""
    found, rest = span.shares(noise)
    return _surprise(found, rest, span.unknown.astype(float), span.free.astype(float), tiny)[0]


def _laid_out(stacks: Sequence[Stack], window_hz: float) -> tuple[FloatArray, NDArray[np.int64], FloatArray]:
    """Frequencies of all bins, the segments that they belong to, and the windows' edges."""
    frequency = np.concatenate([group.frequency_hz for group in stacks])
    sizes = [part.stop - part.start for group in stacks for part in group.slices]
    low, high = float(frequency.min()), float(frequency.max())
    count = max(1, round((high - low) / window_hz))
    return frequency, np.repeat(np.arange(len(sizes)), sizes), np.linspace(low, high, count + 1)


def _finer_below(edges_hz: FloatArray, frequency_hz: FloatArray, unknowns: int) -> FloatArray:
    """Windows' edges with the lowest two cut where a third of the frequency fits, as far as each has bins for so many
    unknowns: slow answers turn within them, and slow noise is steep."""
    high = edges_hz[min(2, edges_hz.size - 1)]
    found, ordered = [high], np.sort(frequency_hz)
    while True:
        next_down = min(found[-1] * FINER, ordered[np.searchsorted(ordered, found[-1]) - 1])
        below = np.searchsorted(ordered, next_down)
        if np.searchsorted(ordered, found[-1]) - below < BINS_FOR_EACH * unknowns:
            next_down = ordered[max(np.searchsorted(ordered, found[-1]) - BINS_FOR_EACH * unknowns, 0)]
            below = np.searchsorted(ordered, next_down)
        if below < BINS_FOR_EACH * unknowns:
            break
        found.append(float(next_down))
    return np.array([edges_hz[0], *found[::-1], *edges_hz[edges_hz > high]])


def _places(frequency_hz: FloatArray, edges_hz: FloatArray, starts: NDArray[np.int64]) -> FloatArray:
    """Where each bin, window after window, is within its window, -1..1."""
    half, count = 0.5 * np.diff(edges_hz), np.diff(starts)
    return np.asarray((frequency_hz - np.repeat(edges_hz[:-1] + half, count)) / np.repeat(half, count))


def _cut(frequency_hz: FloatArray, edges_hz: FloatArray) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """The bins in the order of the windows, and where each window begins and the last ends, (w + 1,)."""
    count = edges_hz.size - 1
    window = np.clip(np.searchsorted(edges_hz, frequency_hz, side="right") - 1, 0, count - 1)
    order = np.argsort(window, kind="stable")
    return order, np.searchsorted(window[order], np.arange(count + 1))


class _Span(NamedTuple):
    """What the references span in each window: nothing of the gusts has a share in it."""

    windows: Windows
    ends: _Ends
    basis: ComplexArray
    """(w, unknowns, bins of the largest window)"""
    unknown: NDArray[np.int64]
    """(w,), unknowns for each output,"""
    free: NDArray[np.int64]
    """(w,), and bins beyond these."""

    @classmethod
    def of(cls, z: ComplexArray, place: FloatArray, segment: NDArray[np.int64], starts: NDArray[np.int64]) -> _Span:
        """References (m, n), window after window, with the place of each bin within its window, -1..1, and the segment
        that it belongs to."""
        windows, ends = Windows(starts[:-1], place.size), _Ends.of(segment, starts)
        z = ends.less(z)
        basis = orthonormal_each(windows.of(ends.less(np.concatenate([z, place * z]))), REFERENCES_RANK)
        unknown, bins = np.count_nonzero(np.any(basis, axis=2), axis=1), np.diff(starts)
        enough = bins >= unknown + ends.unknown + LEAST_FREEDOM
        unknown = unknown * enough
        return cls(windows, ends, basis * enough[:, None, None], unknown, bins - unknown - ends.unknown)

    def shares(self, Y: ComplexArray) -> tuple[ComplexArray, ComplexArray]:
        """Of rows in windows (w, k, bins) the spectral matrices (w, k, k) of what is explained and of what is left."""
        there = Y @ self.basis.conj().swapaxes(1, 2)
        found = there @ there.conj().swapaxes(1, 2)
        return found, Y @ Y.conj().swapaxes(1, 2) - found


class _Explained(NamedTuple):
    """What the references explain of the residual's bins in each window."""

    power: FloatArray
    """(w, k), of the residual."""
    by_command: FloatArray
    """(w, k, m), of it what each command alone explains;"""
    found: ComplexArray
    """(w, k, k), what they explain together, a spectral matrix;"""
    rest: ComplexArray
    """and what they leave, (w, k, k)."""
    unknown: FloatArray
    """(w,), unknowns that explain, for each output,"""
    free: FloatArray
    """(w,), and bins beyond these."""


def _explained(y: ComplexArray, on: _Layout) -> _Explained:
    """Bins of the residual (k, n), window after window."""
    span = on.span
    power = np.sum(np.abs(span.windows.of(y)) ** 2, axis=2)
    Y = span.windows.of(span.ends.less(y))
    found, rest = span.shares(Y)
    alone = []
    for line in on.lines:
        each = Y @ line.conj().swapaxes(1, 2)
        alone.append(np.sum(np.abs(each) ** 2, axis=2) * (span.unknown > 0)[:, None])
    return _Explained(
        power=power,
        by_command=np.stack(alone, axis=2),
        found=found,
        rest=rest,
        unknown=span.unknown.astype(float),
        free=span.free.astype(float),
    )


def _surprise(
    found: ComplexArray, rest: ComplexArray, unknown: FloatArray, free: FloatArray, tiny: float
) -> tuple[float, int]:
    """What is found in each window against that window's own noise: chi squared and its degrees of freedom.

    Few bins make the noise uncertain, and the sum more scattered than chi squared (Hotelling and Lawley's trace); it is
    drawn in to a chi squared of the same variance. A wider average of the noise would be surer and, where its
    spectrum is steep, wrong.
    """
    k = found.shape[1]
    use = (unknown > 0) & (free > k + 1)
    u, n = unknown[use], free[use]
    if not u.size:
        return 0.0, 1
    inverse = np.linalg.inv(rest[use] + tiny * np.eye(k))
    trace = np.real(np.einsum("wij,wji->w", inverse, found[use]))
    mean = float(np.sum(2 * k * u))
    variance = float(np.sum(4 * k * u * (u + n - 1) / (n - k - 1)))
    beyond = float(np.sum(2 * (n - k) * trace)) - mean
    return max(0.0, mean + beyond * math.sqrt(2 * mean / variance)), int(mean)


class _Ends(NamedTuple):
    """A constant over each window for each segment, which is taken out.

    A run of noise ends elsewhere than it begins, and its bins carry that far up in frequency, in step with each other:
    within a narrow window a constant (the transient term of the local polynomial method, Pintelon and Schoukens).
    """

    starts: NDArray[np.int64]
    """(g,), of the bins of one segment in one window."""
    bins: NDArray[np.int64]
    """(g,), how many these are."""
    unknown: NDArray[np.int64]
    """(w,), constants in each window: segments with bins enough for one."""

    @classmethod
    def of(cls, segment: NDArray[np.int64], starts: NDArray[np.int64]) -> _Ends:
        """Bins window after window, in each segment after segment; starts (w + 1,), of the windows."""
        begins = np.union1d(np.flatnonzero(np.diff(segment)) + 1, starts[:-1][np.diff(starts) > 0])
        bins = np.diff(begins, append=segment.size)
        number = np.searchsorted(starts, begins[bins >= FEWEST_FOR_ENDS], side="right") - 1
        return cls(begins, bins, np.bincount(number, minlength=starts.size - 1))

    def less(self, rows: ComplexArray) -> ComplexArray:
        """(r, bins)"""
        mean = np.add.reduceat(rows, self.starts, axis=1) * ((self.bins >= FEWEST_FOR_ENDS) / self.bins)
        return np.asarray(rows - np.repeat(mean, self.bins, axis=1))


def _neighbours(values: ComplexArray | FloatArray, number: int) -> ComplexArray | FloatArray:
    """The sum over a window and those beside it."""
    return np.asarray(np.sum(values[max(0, number - NEIGHBOURS) : number + NEIGHBOURS + 1], axis=0))


def _between(frequency: FloatArray, centres: FloatArray, values: ComplexArray) -> ComplexArray:
    return np.asarray(np.interp(frequency, centres, values.real) + 1j * np.interp(frequency, centres, values.imag))


def _power(spectra: ComplexArray) -> FloatArray:
    """Of spectral matrices (w, k, k) the sums over the outputs, (w,)."""
    return np.asarray(np.real(np.einsum("wkk->w", spectra)))
