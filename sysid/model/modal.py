"""A linear system's modes over a sample, and how they move with its matrix.

In modal form the matrix exponential is one number for each mode, and its derivative to the matrix, element by element,
what two modes do over the sample together (Daleckii and Krein): exact, without any exponential of matrices.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from sysid.data.preprocess import ComplexArray
from sysid.model.structure import FloatArray

WORST_CONDITION = 1e7
NUDGE = 1e-9
SHORT = 1e-3
"""Of a time constant, a sample within which differences lose digits and a series serves; its terms:"""
TERMS = 5


@dataclass(frozen=True, eq=False)
class Modes:
    """x' = A x + B u with A = V diag(poles) W, over one sample in which u is held: W x goes to factor * W x + held *
    W B u."""

    poles: ComplexArray
    """(n,), 1/s."""
    V: ComplexArray
    W: ComplexArray
    dt: float
    """s."""

    @classmethod
    def of(cls, A: FloatArray, dt: float) -> Modes:
        """Raises LinAlgError where A is not finite."""
        poles, V = np.linalg.eig(A)
        W = _inverse(V)
        if W is None or _nearly_singular(V, W):
            # equal poles that do not part: nudge the matrix by far less than any estimate resolves
            poles, V = np.linalg.eig(A + np.diag(np.arange(len(A))) * NUDGE / dt)
            W = np.linalg.inv(V)
        return cls(poles.astype(complex), V, W, dt)

    def sampled(self, dt: float) -> Modes:
        """The same modes over another sample."""
        return Modes(self.poles, self.V, self.W, dt)

    @cached_property
    def factor(self) -> ComplexArray:
        """(n,)"""
        return np.asarray(np.exp(self.poles * self.dt))

    @cached_property
    def held(self) -> ComplexArray:
        """(n,), s."""
        return self.dt * _mean(self.poles * self.dt)

    @cached_property
    def moved(self) -> ComplexArray:
        """(n, n): times W dA V what dA does to the motion over the sample."""
        x, factor = self.poles * self.dt, self.dt * self.factor
        swap = x.real[:, None] < x.real
        apart = x - x[:, None]
        faster_less_slower = np.negative(apart, out=apart, where=swap)
        return np.asarray(np.where(swap, factor, factor[:, None]) * _mean(faster_less_slower))

    @cached_property
    def held_moved(self) -> ComplexArray:
        """(n, n): times W dA V what it does to `held`, the differences of that over those of the poles."""
        x = self.poles * self.dt
        size = np.abs(x)
        swap = size[:, None] < size
        further = np.where(swap, x, x[:, None])
        of_nearer = np.where(swap, self.held[:, None], self.held)
        far = np.maximum(size[:, None], size) > SHORT
        if far.all():
            return np.asarray(self.dt * (self.moved - of_nearer) / further)
        closed = (self.moved - of_nearer) / self.dt / np.where(far, further, 1.0)
        a, b = np.where(far, 0.0, x[:, None]), np.where(far, 0.0, x)
        series, power = np.zeros_like(a), np.ones_like(a)
        for k in range(TERMS):
            series, power = series + power / math.factorial(k + 2), a * power + b ** (k + 1)
        return np.asarray(self.dt**2 * np.where(far, closed, series))


def _nearly_singular(V: ComplexArray, W: ComplexArray) -> bool:
    """Columns of V have the length 1, so that the largest of its inverse W bounds the condition, and costs nothing."""
    return not len(V) ** 1.5 * np.max(np.abs(W)) < WORST_CONDITION and bool(np.linalg.cond(V) > WORST_CONDITION)


def _inverse(V: ComplexArray) -> ComplexArray | None:
    try:
        return np.asarray(np.linalg.inv(V))
    except np.linalg.LinAlgError:
        return None


def _mean(x: ComplexArray) -> ComplexArray:
    """(exp(x) - 1) / x."""
    still = x == 0
    if not still.any():
        return np.asarray(np.expm1(x) / x)
    return np.asarray(np.where(still, 1.0, np.expm1(x) / np.where(still, 1.0, x)))
