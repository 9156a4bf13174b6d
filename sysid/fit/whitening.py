"""Outputs on the bins as rows whose noise is white: what fits are weighed by and candidates are compared in."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property, partial

import numpy as np
from numpy.typing import NDArray

from sysid.data.preprocess import ComplexArray
from sysid.data.stacks import Stack
from sysid.fit.noise import Division
from sysid.fit.rows import bins, orthonormal, rows
from sysid.model.predict import respond
from sysid.model.structure import AnyArray, FloatArray, Model


def whitener_of(spectrum: ComplexArray) -> ComplexArray:
    """Lower triangular matrices (bins, k, k) that turn noise of this spectral matrix (bins, k, k) into rows of unit
    variance."""
    return np.asarray(math.sqrt(2) * np.linalg.inv(np.linalg.cholesky(spectrum)))


def weighed(weight: AnyArray, columns: ComplexArray) -> ComplexArray:
    """Columns (c, k, bins) by weights: a number for each output and bin, (k, bins), or a matrix for each bin,
    (k, k, bins)."""
    return weighing(weight)(columns, np.empty(columns.shape, dtype=complex))


def weighing(weight: AnyArray) -> Callable[[ComplexArray, ComplexArray], ComplexArray]:
    """As `weighed`, for many columns by the same weights: of columns and where they go."""
    if weight.ndim != 2:
        return partial(_weighed, _parts_of(weight))
    twice = np.repeat(weight, 2, axis=1)

    def by_numbers(columns: ComplexArray, out: ComplexArray) -> ComplexArray:
        # of real numbers, which would else be made complex ones first
        np.multiply(np.ascontiguousarray(columns).view(float), twice, out=out.view(float))
        return out

    return by_numbers


_Parts = tuple[tuple[tuple[int, ComplexArray], ...], ...]
"""Of matrices for each bin, row after row, numbers of columns and what is there, (bins,)."""


def _parts_of(weight: ComplexArray) -> _Parts:
    """The diagonal first, and of the rest what is not zero: most are lower triangular."""
    return tuple(
        ((row, parts[row]), *((i, part) for i, part in enumerate(parts) if i != row and part.any()))
        for row, parts in enumerate(weight)
    )


def _weighed(weight: _Parts, columns: ComplexArray, found: ComplexArray) -> ComplexArray:
    for row, ((_, own), *others) in enumerate(weight):
        np.multiply(own, columns[:, row], out=found[:, row])
        for column, part in others:
            found[:, row] += part * columns[:, column]
    return found


@dataclass(frozen=True, eq=False)
class Whitening:
    """Turns outputs on the bins into rows whose noise is white, of unit variance, end states projected out."""

    stacks: tuple[Stack, ...]
    whitener: list[ComplexArray]
    """For every stack (bins, k, k)."""
    ends: list[list[FloatArray]]
    """For every stack and segment an orthonormal basis (r, 2 k bins) of whitened end states."""

    @cached_property
    def _weights(self) -> list[list[_Parts]]:
        """For every stack and segment, of unscaled outputs."""
        whole = [
            group.scale * white.transpose(1, 2, 0) for group, white in zip(self.stacks, self.whitener, strict=True)
        ]
        return [
            [_parts_of(np.ascontiguousarray(weight[..., part])) for part in group.slices]
            for group, weight in zip(self.stacks, whole, strict=True)
        ]

    def __call__(self, outputs: Sequence[ComplexArray]) -> FloatArray:
        """For every stack (columns, k, bins), unscaled -> (columns, N)."""
        columns, k = len(outputs[0]), len(self.stacks[0].Y)
        found = np.empty((columns, k * sum(Y.shape[2] for Y in outputs)), dtype=complex)
        end = 0
        for group, weights, bases, Y in zip(self.stacks, self._weights, self.ends, outputs, strict=True):
            for part, weight, basis in zip(group.slices, weights, bases, strict=True):
                bins = part.stop - part.start
                begin, end = end, end + k * bins
                some = found[:, begin:end]
                _weighed(weight, Y[..., part], some.reshape(columns, k, bins))
                real = some.view(float)
                real -= (real @ basis.T) @ basis
        return found.view(float)

    def louder(self, times: FloatArray) -> Whitening:
        """By noise that is so many times as loud, (bins,), all stacks', in standard deviations."""
        parts = np.split(times, np.cumsum([group.frequency_hz.size for group in self.stacks])[:-1])
        ends = [
            [
                orthonormal(basis / np.tile(np.repeat(some[part], 2), len(group.Y)))
                for part, basis in zip(group.slices, bases, strict=True)
            ]
            for group, some, bases in zip(self.stacks, parts, self.ends, strict=True)
        ]
        whitener = [white / some[:, None, None] for white, some in zip(self.whitener, parts, strict=True)]
        return Whitening(self.stacks, whitener, ends)

    def row(self, white: ComplexArray) -> FloatArray:
        """Of white bins (k, bins), stack after stack, the row (N,) that they are."""
        edges = np.cumsum([0, *(part.stop - part.start for group in self.stacks for part in group.slices)])
        return np.concatenate([rows(white[None, :, i:j])[0] for i, j in itertools.pairwise(edges)])

    def less(self, rows: FloatArray, of: NDArray[np.intp], part: Callable[[ComplexArray], ComplexArray]) -> FloatArray:
        """Rows (r, N) less a part of the bins of these numbers: of (r, bins) of one output at a time (r, bins)."""
        found, k = rows.copy(), len(self.stacks[0].Y)
        sizes = np.array([one.stop - one.start for group in self.stacks for one in group.slices])
        begins = np.cumsum(sizes) - sizes
        segment = np.searchsorted(begins, of, side="right") - 1
        first = k * begins[segment] + of - begins[segment]
        complex_rows = found.view(complex)
        for output in range(k):
            there = first + output * sizes[segment]
            complex_rows[:, there] -= part(complex_rows[:, there])
        return found

    def bins(self, row: FloatArray) -> ComplexArray:
        """Of a row (N,) its bins, (k, bins), stack after stack."""
        sizes = [part.stop - part.start for group in self.stacks for part in group.slices]
        return np.asarray(bins(row[None], sizes, len(self.stacks[0].Y))[0])


def noise_whitening(model: Model, stacks: Sequence[Stack], division: Division) -> Whitening:
    """By the noise's spectrum and the model's end states."""
    whitener: list[ComplexArray] = []
    ends = []
    for group in stacks:
        white = whitener_of(division.at(group.frequency_hz))
        E = np.concatenate([respond(model.structure, model.values, group, False).E, jumps(group)])
        E = weighed(group.scale * white.transpose(1, 2, 0), E)
        whitener.append(white)
        ends.append([orthonormal(rows(E[..., part])) for part in group.slices])
    return Whitening(tuple(stacks), whitener, ends)


def jumps(group: Stack) -> ComplexArray:
    """A jump and a bend of each output alone at a segment's ends, which gusts leave there, (2 k, k, bins)."""
    k = group.Y.shape[0]
    step = 1 / (group.z - 1)
    return np.concatenate([column * np.eye(k)[:, :, None] for column in (step, group.z * step**2)])
