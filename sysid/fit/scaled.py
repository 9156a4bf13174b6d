"""Linear equations of parameters whose sizes are many powers of ten apart: solved as if each were of size one.

A time constant is known to microseconds and a limit of acceleration to thousands of rad/s^2, so that of their normal
equations as they stand the second is lost in what rounding leaves of the first.
"""

from __future__ import annotations

import numpy as np

from sysid.model.structure import FloatArray

DETERMINED, ASKED = 1e-10, 1e-9
"""Of the most, from which on a direction counts as determined by normal equations, or as asked for by instruments."""


def scaled_solve(H: FloatArray, g: FloatArray, rank: float = DETERMINED) -> FloatArray:
    """x (n,) of H x = g, the least of all x where some directions of H (n, n) have less than `rank` of the most."""
    size = _sizes(np.diag(H))
    return np.asarray(np.linalg.lstsq(H / np.outer(size, size), g / size, rcond=rank)[0] / size)


def scaled_inverse(curvature: FloatArray, worst: float) -> FloatArray | None:
    """(n, n); None where it determines nothing, or its condition in these units is worse than that."""
    size = np.sqrt(np.abs(np.diag(curvature)))
    if not np.all(np.isfinite(curvature)) or np.any(size == 0):
        return None
    scaled = curvature / np.outer(size, size)
    if np.linalg.cond(scaled) > worst:
        return None
    return np.asarray(np.linalg.inv(scaled) / np.outer(size, size))


def instrumental_inverse(asked: FloatArray, moved: FloatArray) -> FloatArray:
    """(b, b): of asked moved^T, both (b, N); of what they ask in no direction, none."""
    sizes = [_sizes(np.einsum("ij,ij->i", one, one)) for one in (moved, asked)]
    return np.asarray(np.linalg.pinv((asked @ moved.T) / np.outer(sizes[1], sizes[0]), ASKED) / np.outer(*sizes))


def _sizes(squares: FloatArray) -> FloatArray:
    """Of what does nothing, or less than that by rounding, one, which leaves it nothing."""
    return np.sqrt(np.where(squares > 0, squares, 1.0))
