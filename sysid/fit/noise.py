"""How much of a residual a recorded signal explains, and what is left as noise.

Whatever linear dynamics a structure lacks, its residual is then a response to the commands. In narrow windows of
frequency, all runs together, any such response is nearly a straight line over frequency, so a few complex numbers a
window find it without a model. What they do not find is noise, and what a nonlinearity makes of the commands.

Gusts reach the commands through the feedback. Only what the logged excitation caused in a command explains a residual
here; where no excitation is logged the commands stand for themselves, and what they explain is an upper bound.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sysid.data.instrument import Causes
from sysid.data.preprocess import ComplexArray, gusts_kept_out
from sysid.data.stacks import Stack
from sysid.fit.output_error import OutputError
from sysid.fit.rows import orthonormal
from sysid.model.structure import FloatArray

WINDOW_HZ = 0.5
NEIGHBOURS = 1
"""Windows to either side that share in a window's noise spectrum where it weighs residuals."""
FEWEST_FOR_ENDS = 6
"""Bins of a segment in a window from which on its ends are taken out."""
REFERENCES_RANK = 1e-9
LEAST_FREEDOM = 4
"""Bins beyond the unknowns that a window needs."""


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
    chi_squared: float
    """Of all windows together against the noise spectrum: whether anything is explained at all."""
    degrees: int
    level: ComplexArray
    """(w, k, k), the noise's spectral matrix in each window, scaled as a stack's residual is."""

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


def divide(error: OutputError, stacks: Sequence[Stack], by: Causes) -> Division:
    """Divide what a model leaves of the stacks into what the commands explain and noise."""
    scale = np.concatenate([group.scale for group in stacks])
    frequency = np.concatenate([group.frequency_hz for group in stacks])
    rows = [scale * np.concatenate(each, axis=1) for each in (error.residuals, by.caused, by.reference)]
    segment = np.concatenate([np.full(one.shape[1], number) for number, one in enumerate(error.residuals)])
    count = max(1, round((float(frequency.max()) - float(frequency.min())) / WINDOW_HZ))
    edges = np.linspace(float(frequency.min()), float(frequency.max()), count + 1)
    half = 0.5 * (edges[1] - edges[0])
    windows = [
        _Window.of(*(x[:, at] for x in rows), place=(frequency[at] - edge - half) / half, segment=segment[at])
        for edge, at in zip(edges[:-1], _cut(frequency, edges), strict=True)
    ]
    found, rest = (np.array([getattr(one, name) for one in windows]) for name in ("found", "rest"))
    unknown, free = (np.array([getattr(one, name) for one in windows], float) for name in ("unknown", "free"))
    around = np.array([_neighbours(rest, number) for number in range(count)])
    freedom = np.array([max(_neighbours(free, number), 1.0) for number in range(count)])
    S = around / freedom[:, None, None]
    own = np.real(np.einsum("wkk->wk", S))
    tiny = 1e-12 * np.max(own, initial=1e-300)
    chi_squared, degrees = _surprise(found, rest, unknown, free, tiny)
    each = np.array([one.by_command for one in windows])
    return Division(
        edges_hz=edges,
        power=np.array([one.power for one in windows]),
        explained=np.real(np.einsum("wkk->wk", found)) - unknown[:, None] * own,
        by_command=each - np.minimum(2, unknown)[:, None, None] * own[:, :, None],
        commands=by.commands,
        references=by.references,
        chi_squared=chi_squared,
        degrees=degrees,
        level=S + tiny * np.eye(S.shape[1]),
    )


def _cut(frequency_hz: FloatArray, edges_hz: FloatArray) -> list[NDArray[np.int64]]:
    """Numbers of the bins in each window."""
    count = edges_hz.size - 1
    window = np.clip(np.searchsorted(edges_hz, frequency_hz, side="right") - 1, 0, count - 1)
    order = np.argsort(window, kind="stable")
    starts = np.searchsorted(window[order], np.arange(count + 1))
    return [order[begin:end] for begin, end in itertools.pairwise(starts)]


class _Window(NamedTuple):
    """What the references explain of the residual's bins in one window."""

    power: FloatArray
    """(k,), of the residual."""
    by_command: FloatArray
    """(k, m), of it what each command alone explains;"""
    found: ComplexArray
    """(k, k), what they explain together, a spectral matrix;"""
    rest: ComplexArray
    """and what they leave, (k, k)."""
    unknown: int
    """Unknowns that explain, for each output,"""
    free: int
    """and bins beyond these."""

    @classmethod
    def of(
        cls, y: ComplexArray, x: ComplexArray, z: ComplexArray, *, place: FloatArray, segment: NDArray[np.int64]
    ) -> _Window:
        """Bins of the residual (k, n), of what was caused in the commands (m, n) and of their references, with the
        place of each within the window, -1..1, and the segment that it belongs to."""
        k, m = y.shape[0], x.shape[0]
        power, alone = np.real(np.diag(y @ y.conj().T)), np.zeros((k, m))
        if not place.size:
            nothing = np.zeros((k, k), dtype=complex)
            return cls(power, alone, found=nothing, rest=nothing, unknown=0, free=0)
        ends = _ends(segment)
        y, x, z = (_less(rows, ends) for rows in (y, x, z))
        # what the references span: nothing of the gusts has a share in it
        basis = orthonormal(_less(np.concatenate([z, place * z]), ends), REFERENCES_RANK)
        if place.size < basis.shape[0] + ends.shape[0] + LEAST_FREEDOM:
            basis = basis[:0]
        there = y @ basis.conj().T
        found = there @ there.conj().T
        for column in range(m if basis.size else 0):
            line = orthonormal(np.stack([x[column], place * x[column]]), REFERENCES_RANK)
            alone[:, column] = np.sum(np.abs(y @ line.conj().T) ** 2, axis=1)
        unknown = basis.shape[0]
        free = place.size - unknown - ends.shape[0]
        return cls(power, alone, found=found, rest=y @ y.conj().T - found, unknown=unknown, free=free)


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
    return max(0.0, mean + beyond * np.sqrt(2 * mean / variance)), int(mean)


def _ends(segment: NDArray[np.int64]) -> ComplexArray:
    """A constant over the window for each segment, orthonormal (segments, bins).

    A run of noise ends elsewhere than it begins, and its bins carry that far up in frequency, in step with each other:
    within a narrow window a constant (the transient term of the local polynomial method, Pintelon and Schoukens).
    """
    numbers, counts = np.unique(segment, return_counts=True)
    numbers, counts = numbers[counts >= FEWEST_FOR_ENDS], counts[counts >= FEWEST_FOR_ENDS]
    return np.asarray((segment == numbers[:, None]) / np.sqrt(counts)[:, None] + 0j)


def _less(rows: ComplexArray, basis: ComplexArray) -> ComplexArray:
    return np.asarray(rows - (rows @ basis.conj().T) @ basis)


def _neighbours(values: ComplexArray | FloatArray, number: int) -> ComplexArray | FloatArray:
    """The sum over a window and those beside it."""
    return np.asarray(np.sum(values[max(0, number - NEIGHBOURS) : number + NEIGHBOURS + 1], axis=0))


def _between(frequency: FloatArray, centres: FloatArray, values: ComplexArray) -> ComplexArray:
    return np.asarray(np.interp(frequency, centres, values.real) + 1j * np.interp(frequency, centres, values.imag))
