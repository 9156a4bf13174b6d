"""Rows of real numbers over bins: inner products, orthonormal bases, projections, smoothing over frequency."""

from __future__ import annotations

import itertools
from collections.abc import Sequence

import numpy as np

from sysid.data.preprocess import ComplexArray
from sysid.model.structure import AnyArray, FloatArray

SMOOTHING_HZ = 1.0
ENDS_RANK = 1e-10
"""Of the largest eigenvalue of the rows' inner products: what is weaker adds no direction of its own."""


def rows(x: ComplexArray) -> FloatArray:
    """(r, k, bins) complex -> (r, 2 k bins) real, so that real products are real parts."""
    real: FloatArray = np.ascontiguousarray(x).reshape(x.shape[0], -1).view(float)
    return real


def bins(vectors: FloatArray, sizes: Sequence[int], k: int) -> ComplexArray:
    """Rows (v, N), segments of so many bins one after the other, back to bins (v, k, bins)."""
    edges = np.cumsum([0, *(2 * k * size for size in sizes)])
    return np.concatenate(
        [
            np.ascontiguousarray(vectors[:, i:j]).view(complex).reshape(len(vectors), k, -1)
            for i, j in itertools.pairwise(edges)
        ],
        axis=2,
    )


def orthonormal(E: AnyArray, rank: float = ENDS_RANK) -> AnyArray:
    """The rows of E (n, N) as an orthonormal basis (r, N) of what they span; rows that follow from others drop out."""
    size = np.sqrt(np.sum(np.abs(E) ** 2, axis=1) if np.iscomplexobj(E) else np.einsum("ij,ij->i", E, E))
    scaled = E / np.where(size > 0, size, 1.0)[:, None]
    inner, axes = np.linalg.eigh(scaled @ scaled.conj().T)
    keep = inner > rank * np.max(inner, initial=0.0)
    return np.asarray((axes[:, keep] / np.sqrt(inner[keep])).conj().T @ scaled)


def orthonormal_each(E: ComplexArray, rank: float) -> ComplexArray:
    """The same for many E at once, (w, n, N); rows that drop out become zeros."""
    size = np.sqrt(np.sum(np.abs(E) ** 2, axis=2))
    scaled = E / np.where(size > 0, size, 1.0)[:, :, None]
    inner, axes = np.linalg.eigh(scaled @ scaled.conj().swapaxes(1, 2))
    keep = inner > rank * np.max(inner, axis=1, initial=0.0, keepdims=True)
    along = axes * (keep / np.sqrt(np.where(keep, inner, 1.0)))[:, None, :]
    return np.asarray(along.conj().swapaxes(1, 2) @ scaled)


def less_ends(grams: FloatArray, n: int) -> tuple[FloatArray, FloatArray]:
    """Inner products of rows, less what the first n, the ends' of each segment, explain of the others.

    `grams` (segments, n + r, n + r) has all inner products. Returns their sum over segments, (r, r), and how much of
    each row every end state explains, (segments, n, r). Weak combinations of ends explain nothing.
    """
    size = np.sqrt(grams.diagonal(axis1=1, axis2=2)[:, :n])
    size = np.where(size > 0, size, 1.0)
    inner, axes = np.linalg.eigh(grams[:, :n, :n] / (size[:, :, None] * size[:, None, :]))
    keep = inner > ENDS_RANK * np.maximum(inner[:, -1:], 0.0)  # in ascending order
    weight = keep / np.sqrt(np.where(keep, inner, 1.0))
    T = (weight[:, :, None] / size[:, None, :]) * axes.transpose(0, 2, 1)
    cross = T @ grams[:, :n, n:]
    left = grams[:, n:, n:] - cross.transpose(0, 2, 1) @ cross
    return np.asarray(np.sum(left, axis=0)), np.asarray(T.transpose(0, 2, 1) @ cross)


def project(E: FloatArray, others: FloatArray) -> FloatArray:
    """Rows of `others` (r, N) less what the rows of E (n, N) explain of them."""
    basis = orthonormal(E)
    rest: FloatArray = others - (others @ basis.T) @ basis
    return rest


def smoothed_spectrum(left: ComplexArray, frequency_hz: FloatArray) -> ComplexArray:
    """Spectral matrices (k, k, bins) of a residual (k, bins): a moving average over SMOOTHING_HZ, reflected at the
    ends."""
    cross = left[:, None] * left[None].conj()
    return np.asarray(_smooth(cross.reshape(-1, cross.shape[-1]).T, frequency_hz).T.reshape(cross.shape))


def _smooth(values: ComplexArray, frequency_hz: FloatArray) -> ComplexArray:
    """(bins, columns)."""
    # heavier than NumPy itself to load: only where it is needed
    from scipy.ndimage import uniform_filter1d

    step = float(frequency_hz[1] - frequency_hz[0]) if frequency_hz.size > 1 else SMOOTHING_HZ
    bins = max(5, int(SMOOTHING_HZ / step) | 1)
    real, imag = (uniform_filter1d(part, bins, axis=0, mode="reflect") for part in (values.real, values.imag))
    return np.asarray(real + 1j * imag)
