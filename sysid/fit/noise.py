"""How much of a residual a recorded signal explains, and what is left as noise.

Whatever linear dynamics a structure lacks, its residual is then a response to the commands. In narrow windows of
frequency, all runs together, any such response is nearly a straight line over frequency, so a few complex numbers a
window find it without a model. What they do not find is noise, and what a nonlinearity makes of the commands.

Gusts reach the commands through the feedback. Only what the logged excitation caused in a command explains a residual
here; where no excitation is logged the commands stand for themselves, and what they explain is an upper bound.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sysid.data.instrument import Causes
from sysid.data.preprocess import EXCITATIONS, ComplexArray
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
        return all(name in EXCITATIONS for name in self.references)


def divide(error: OutputError, stacks: Sequence[Stack], by: Causes) -> Division:
    """Divide what a model leaves of the stacks into what the commands explain and noise."""
    scale = np.concatenate([group.scale for group in stacks])
    frequency = np.concatenate([group.frequency_hz for group in stacks])
    e = scale * np.concatenate(error.residuals, axis=1)
    u = scale * np.concatenate(by.caused, axis=1)
    r = scale * np.concatenate(by.reference, axis=1)
    k, m = e.shape[0], u.shape[0]
    segment = np.concatenate([np.full(one.shape[1], number) for number, one in enumerate(error.residuals)])
    windows = max(1, round((float(frequency.max()) - float(frequency.min())) / WINDOW_HZ))
    edges = np.linspace(float(frequency.min()), float(frequency.max()), windows + 1)
    window = np.clip(np.searchsorted(edges, frequency, side="right") - 1, 0, windows - 1)
    order = np.argsort(window, kind="stable")
    starts = np.searchsorted(window[order], np.arange(windows + 1))
    power, explained = np.zeros((windows, k)), np.zeros((windows, k))
    each = np.zeros((windows, k, m))
    rest = np.zeros((windows, k, k), dtype=complex)
    free = np.zeros(windows)
    unknown = np.zeros(windows)
    found = np.zeros((windows, k, k), dtype=complex)
    for number in range(windows):
        at = order[starts[number] : starts[number + 1]]
        if not at.size:
            continue
        y, x, z = e[:, at], u[:, at], r[:, at]
        whole = y @ y.conj().T
        power[number] = np.diag(whole).real
        half = 0.5 * (edges[1] - edges[0])
        place = (frequency[at] - edges[number] - half) / half
        ends = _ends(segment[at])
        y, x, z = (_less(rows, ends) for rows in (y, x, z))
        left = y @ y.conj().T
        # what the references span: nothing of the gusts has a share in it
        basis = orthonormal(_less(np.concatenate([z, place * z]), ends), REFERENCES_RANK)
        if at.size < basis.shape[0] + ends.shape[0] + LEAST_FREEDOM:
            basis = basis[:0]
        there = y @ basis.conj().T
        found[number] = there @ there.conj().T
        rest[number] = left - found[number]
        unknown[number], free[number] = basis.shape[0], at.size - basis.shape[0] - ends.shape[0]
        for column in range(m if basis.size else 0):
            alone = y @ orthonormal(np.stack([x[column], place * x[column]]), REFERENCES_RANK).conj().T
            each[number, :, column] = np.sum(np.abs(alone) ** 2, axis=1)
    around = np.array([_neighbours(rest, number) for number in range(windows)])
    freedom = np.array([max(_neighbours(free, number), 1.0) for number in range(windows)])
    S = around / freedom[:, None, None]
    own = np.real(np.einsum("wkk->wk", S))
    explained = np.real(np.einsum("wkk->wk", found)) - unknown[:, None] * own
    each -= np.minimum(2, unknown)[:, None, None] * own[:, :, None]
    tiny = 1e-12 * np.max(own, initial=1e-300)
    chi_squared, degrees = _surprise(found, rest, unknown, free, tiny)
    level = S + tiny * np.eye(k)
    return Division(
        edges_hz=edges,
        power=power,
        explained=explained,
        by_command=each,
        commands=by.commands,
        references=by.references,
        chi_squared=chi_squared,
        degrees=degrees,
        level=level,
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
