"""Rows of real numbers over bins: inner products, orthonormal bases, projections, smoothing over frequency."""

from __future__ import annotations

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


def orthonormaliser(E: AnyArray, rank: float = ENDS_RANK) -> AnyArray:
    """T (r, n) that turns the rows of E (n, N) into an orthonormal basis T E; weak combinations stay out."""
    T, size = _directions(E, rank)
    return np.asarray(T / size)


def orthonormal(E: AnyArray, rank: float = ENDS_RANK) -> AnyArray:
    """The rows of E (n, N) as an orthonormal basis (r, N) of what they span; rows that follow from others drop out."""
    T, size = _directions(E, rank)
    return np.asarray(T @ (E / size[:, None]))


def _directions(E: AnyArray, rank: float) -> tuple[AnyArray, FloatArray]:
    """What makes an orthonormal basis of the rows of E, each over its size; and these sizes, 1 for a row of zeros."""
    size = np.sqrt(np.sum(np.abs(E) ** 2, axis=1) if np.iscomplexobj(E) else np.einsum("ij,ij->i", E, E))
    size = np.where(size > 0, size, 1.0)
    scaled = E / size[:, None]
    inner, axes = np.linalg.eigh(scaled @ scaled.conj().T)
    keep = inner > rank * np.max(inner, initial=0.0)
    return (axes[:, keep] / np.sqrt(inner[keep])).conj().T, size


def project(E: FloatArray, others: FloatArray) -> FloatArray:
    """Rows of `others` (r, N) less what the rows of E (n, N) explain of them."""
    basis = orthonormaliser(E) @ E
    rest: FloatArray = others - (others @ basis.T) @ basis
    return rest


def inner_products(T: FloatArray, ends: FloatArray, block: FloatArray) -> FloatArray:
    """Inner products of the rows of `block`, less what the rows of `ends`, orthonormal by T, explain of them."""
    cross = T @ (ends @ block.T)
    found: FloatArray = block @ block.T - cross.T @ cross
    return found


def smooth(values: AnyArray, frequency_hz: FloatArray, width_hz: float = SMOOTHING_HZ) -> AnyArray:
    """Moving average over frequency of (bins, columns), reflected at the ends."""
    # heavier than NumPy itself to load: only where it is needed
    from scipy.ndimage import uniform_filter1d

    step = float(frequency_hz[1] - frequency_hz[0]) if frequency_hz.size > 1 else width_hz
    bins = max(5, int(width_hz / step) | 1)
    real = uniform_filter1d(values.real, bins, axis=0, mode="reflect")
    if not np.iscomplexobj(values):
        return np.asarray(real)
    return np.asarray(real + 1j * uniform_filter1d(values.imag, bins, axis=0, mode="reflect"))
