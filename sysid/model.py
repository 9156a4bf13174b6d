"""Linear structures and models: state equations in continuous time, and what follows from their matrices.

A structure is the equations without numbers; a model is a structure with numbers. Commands are held between
samples, so discretisation by the matrix exponential is exact, at 50 Hz as at 1 kHz.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from sysid.parameter import Parameter

FloatArray = NDArray[np.float64]
AnyArray = NDArray[Any]


class Matrices(NamedTuple):
    """x' = A x + B u, y = C x + D u. Shapes (n, n), (n, m), (k, n), (k, m)."""

    A: AnyArray
    B: AnyArray
    C: AnyArray
    D: AnyArray


@dataclass(frozen=True)
class Mode:
    """One natural mode: a complex pair, or a real pole (damping ratio +1 or -1)."""

    frequency_hz: float
    damping_ratio: float
    pole: complex


class EquationError(NamedTuple):
    """The structure written as s^order y_i = sum_j coefficient_j regressor_ij, linear in its coefficients.

    regressors: (bins, k, coefficients) complex, times 1; solve gives `coefficients`; `to_parameters` maps them.
    """

    order: int
    regressors: Callable[[AnyArray, AnyArray, AnyArray], AnyArray]
    """(s (bins,), Y (bins, k), U (bins, m)) -> (bins, k, coefficients)."""
    denominator: Callable[[AnyArray, FloatArray], AnyArray]
    """(s, coefficients) -> the matrix D(s) of D Y = N U, shape (bins, k, k)."""
    to_parameters: Callable[[FloatArray], FloatArray]


@dataclass(frozen=True)
class Structure:
    """Equations without numbers."""

    base: str
    """`cd` or `tpp`."""
    states: tuple[str, ...]
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    parameters: tuple[Parameter, ...]
    matrices: Callable[[AnyArray], Matrices]
    """Parameter values (real or complex, in order) -> matrices. Analytic, so that complex steps differentiate it."""
    equation_error: EquationError
    uncoupled: tuple[float, ...]
    """A stable point without coupling or control, to begin from where the poles are to be held stable."""
    effects: tuple[str, ...] = ()

    @property
    def names(self) -> tuple[str, ...]:
        return tuple(parameter.name for parameter in self.parameters)

    def vector(self, values: Mapping[str, float]) -> FloatArray:
        """Values by name -> values in order, shape (parameters,). Raises KeyError for a missing name."""
        return np.array([values[name] for name in self.names], dtype=float)


@dataclass(frozen=True, eq=False)
class Model:
    """A structure with numbers."""

    structure: Structure
    values: FloatArray
    """Shape (parameters,), in the structure's order and units."""

    def __getitem__(self, name: str) -> float:
        return float(self.values[self.structure.names.index(name)])

    @property
    def matrices(self) -> Matrices:
        return self.structure.matrices(self.values)

    @property
    def modes(self) -> tuple[Mode, ...]:
        return modes(self.matrices.A)

    @property
    def stable(self) -> bool:
        return bool(np.all(np.linalg.eigvals(self.matrices.A).real < 0))


def modes(A: AnyArray) -> tuple[Mode, ...]:
    """Natural modes of x' = A x, ascending in frequency, one entry for each complex pair."""
    found = []
    for pole in np.linalg.eigvals(A):
        if pole.imag < -1e-9 * max(1.0, abs(pole)):
            continue
        magnitude = abs(pole)
        ratio = -pole.real / magnitude if magnitude > 0 else 0.0
        found.append(Mode(float(magnitude / (2 * np.pi)), float(ratio), complex(pole)))
    return tuple(sorted(found, key=lambda mode: (mode.frequency_hz, mode.damping_ratio)))


def discretise(A: AnyArray, B: AnyArray, dt: float) -> tuple[AnyArray, AnyArray]:
    """Exact zero-order-hold equivalent over one sample of dt seconds.

    A (..., n, n) and B (..., n, m), real or complex, stacks allowed; returns arrays of the same shapes.
    """
    from scipy.linalg import expm

    n, m = B.shape[-2:]
    block = np.zeros((*A.shape[:-2], n + m, n + m), dtype=np.result_type(A, B))
    block[..., :n, :n] = A * dt
    block[..., :n, n:] = B * dt
    power = expm(block)
    return power[..., :n, :n], power[..., :n, n:]


COMPLEX_STEP = 1e-30


def discrete_sensitivities(
    structure: Structure, values: FloatArray, dt: float
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Discretised A, B and their derivatives to every parameter, exact to rounding by complex steps.

    Returns Ad (n, n), Bd (n, m), dAd (parameters, n, n), dBd (parameters, n, m).
    """
    count = values.size
    stepped = np.repeat(values.astype(complex)[None, :], count, axis=0)
    stepped[np.arange(count), np.arange(count)] += 1j * COMPLEX_STEP
    stacks = [structure.matrices(row) for row in stepped]
    Ad, Bd = discretise(np.stack([m.A for m in stacks]), np.stack([m.B for m in stacks]), dt)
    return Ad[0].real, Bd[0].real, Ad.imag / COMPLEX_STEP, Bd.imag / COMPLEX_STEP
