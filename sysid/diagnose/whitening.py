"""Outputs on the bins as rows whose noise is white, end states projected out: what candidates are compared in."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sysid.data.preprocess import ComplexArray
from sysid.data.stacks import Stack
from sysid.fit.noise import Division
from sysid.fit.rows import orthonormal, rows
from sysid.model.predict import respond
from sysid.model.structure import FloatArray, Model


@dataclass(frozen=True, eq=False)
class Whitening:
    """Turns outputs on the bins into rows whose noise is white, of unit variance, end states projected out."""

    stacks: tuple[Stack, ...]
    whitener: list[ComplexArray]
    """For every stack (bins, k, k)."""
    ends: list[list[FloatArray]]
    """For every stack and segment an orthonormal basis (r, 2 k bins) of whitened end states."""

    def __call__(self, outputs: Sequence[ComplexArray]) -> FloatArray:
        """For every stack (columns, k, bins), unscaled -> (columns, N)."""
        parts = []
        for group, whitener, bases, Y in zip(self.stacks, self.whitener, self.ends, outputs, strict=True):
            white = np.einsum("fij,cjf->cif", whitener, group.scale * Y)
            for part, basis in zip(group.slices, bases, strict=True):
                some = rows(white[..., part])
                parts.append(some - (some @ basis.T) @ basis)
        return np.concatenate(parts, axis=1)


def noise_whitening(model: Model, stacks: Sequence[Stack], division: Division) -> Whitening:
    """By the noise's spectrum and the model's end states."""
    whitener: list[ComplexArray] = []
    ends = []
    for group in stacks:
        white = np.asarray(math.sqrt(2) * np.linalg.inv(np.linalg.cholesky(division.at(group.frequency_hz))))
        E = np.concatenate([respond(model.structure, model.values, group, False).E, _jumps(group)])
        E = np.einsum("fij,cjf->cif", white, group.scale * E)
        whitener.append(white)
        ends.append([orthonormal(rows(E[..., part])) for part in group.slices])
    return Whitening(tuple(stacks), whitener, ends)


def _jumps(group: Stack) -> ComplexArray:
    """A jump and a bend of each output alone at a segment's ends, which gusts leave there, (2 k, k, bins)."""
    k = group.Y.shape[0]
    step = 1 / (group.z - 1)
    return np.concatenate([column * np.eye(k)[:, :, None] for column in (step, group.z * step**2)])
