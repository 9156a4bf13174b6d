"""Spread between days told from the errors within: a line through values of which each has its own error.

The variance between is that of Paule and Mandel (J. Res. NBS 87, 1982, p. 377): with it the weighted squares of what is
left are as many as their degrees of freedom. Nothing is taken for granted of its distribution.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sysid.data.record import FloatArray

MOST_HALVINGS = 60


@dataclass(frozen=True, eq=False, slots=True, kw_only=True)
class Line:
    """Coefficients over columns, with what is left between days."""

    at: FloatArray
    """(k,)"""
    covariance: FloatArray
    """(k, k), by the errors and the spread between."""
    between: float
    """Standard deviation between days, beyond the errors; 0 where these explain all."""
    left: FloatArray
    """(n,) values less the line."""
    weight: FloatArray
    """(n,) 1 / (error^2 + between^2)."""

    @property
    def log_likelihood(self) -> float:
        """Of the values, their spread normal."""
        return float(0.5 * np.sum(np.log(self.weight / (2 * np.pi)) - self.weight * self.left**2))


def line(columns: FloatArray, value: FloatArray, error: FloatArray) -> Line:
    """Weighted least squares of (n,) values on (n, k) columns. Raises ValueError where n <= k: no spread is left."""
    n, k = columns.shape
    if n <= k:
        raise ValueError(f"{n} days for {k} coefficients: no spread is left")
    low, high = 0.0, float(np.ptp(value) ** 2)
    fitted = _weighted(columns, value, error, 0.0)
    if _squares(fitted) > n - k:
        for _ in range(MOST_HALVINGS):
            middle = 0.5 * (low + high)
            fitted = _weighted(columns, value, error, middle)
            low, high = (middle, high) if _squares(fitted) > n - k else (low, middle)
    return fitted


def _weighted(columns: FloatArray, value: FloatArray, error: FloatArray, between: float) -> Line:
    weight = 1 / (error**2 + between)
    covariance = np.asarray(np.linalg.inv((columns.T * weight) @ columns), dtype=np.float64)
    at = covariance @ (columns.T @ (weight * value))
    return Line(at=at, covariance=covariance, between=between**0.5, left=value - columns @ at, weight=weight)


def _squares(one: Line) -> float:
    return float(one.weight @ one.left**2)
