"""Responses of models: on the bins of flown runs, and over frequency.

`transfer` is what an engineer plots beside measured responses: exact for linear structures, that of small motion at
rest for others. `slopes` is how each parameter moves it, which tells what no flight whatever could tell apart.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from sysid.data.preprocess import ComplexArray
from sysid.model.monomials import linearised
from sysid.model.structure import AnyArray, FloatArray, Structure

RELATIVE_STEP = 1e-6


def transfer(structure: Structure, values: FloatArray, frequency_hz: FloatArray) -> ComplexArray:
    """Outputs per input at s = j omega, shape (k, m, frequencies), inputs in the structure's order.

    Delay is exact. Play and limits are left out, products and powers vanish: small motion in the mean condition.
    """
    s = 2j * np.pi * frequency_hz
    A, B, C, D = structure.matrices(values)
    H: ComplexArray = C @ np.linalg.solve(s[:, None, None] * np.eye(A.shape[0]) - A, B.astype(complex)) + D
    return np.asarray((H * _late(structure, values, s)).transpose(1, 2, 0))


def slopes(structure: Structure, values: FloatArray, frequency_hz: FloatArray) -> ComplexArray:
    """Derivatives of `transfer` to each parameter, (parameters, k, m, frequencies)."""
    s = 2j * np.pi * frequency_hz
    (A, B, C, D), moved = linearised(structure, values)
    dA, dB, dC, dD = (x[:, None] for x in moved)
    R = np.linalg.inv(s[:, None, None] * np.eye(A.shape[0]) - A)
    X = R @ B
    found = (C @ R) @ (dA @ X + dB) + dC @ X + dD
    late = _late(structure, values, s)
    found = found * late
    H = C @ X + D
    for effect in structure.composed:
        if effect.response is not None:
            for name in effect.names:
                index = structure.names.index(name)
                step = RELATIVE_STEP * max(abs(float(values[index])), abs(structure.parameters[index].typical))
                move = np.zeros(values.size)
                move[index] = step
                change = _late(structure, values + move, s) - _late(structure, values - move, s)
                found[index] += H * change / (2 * step)
    return np.asarray(found.transpose(0, 2, 3, 1))


def behind_commands(structure: Structure, values: FloatArray, s: AnyArray) -> ComplexArray:
    """What effects that no matrix holds (delay) make of every command, (frequencies,)."""
    factor = np.ones(s.size, dtype=complex)
    named = structure.by_name(values)
    for effect in structure.composed:
        if effect.response is not None:
            factor = factor * np.asarray(effect.response(s, {name: named[name] for name in effect.names}))
    return factor


def _late(structure: Structure, values: FloatArray, s: AnyArray) -> ComplexArray:
    """The same of every input, (frequencies, 1, m); channels pass."""
    factor = np.ones((s.size, 1, len(structure.inputs)), dtype=complex)
    factor[:, 0, : len(structure.commands)] = behind_commands(structure, values, s)[:, None]
    return factor


@dataclass(frozen=True, eq=False)
class Response:
    """Model outputs Y (k, bins), end-state columns E (n, k, bins), sensitivities J (coefficients, k, bins) or None.

    The sensitivities to the parameters are `to` (parameters, coefficients) times J, or J itself where `to` is None.
    """

    Y: ComplexArray
    end_columns: Callable[[], ComplexArray]
    """What works out E, which only fits need."""
    J: ComplexArray | None
    to: FloatArray | None = None

    @cached_property
    def E(self) -> ComplexArray:
        return self.end_columns()

    @property
    def slopes(self) -> ComplexArray:
        """Sensitivities to the parameters, (parameters, k, bins)."""
        assert self.J is not None
        if self.to is None:
            return self.J
        J = self.J
        return np.asarray((self.to @ J.reshape(J.shape[0], -1).view(float)).view(complex).reshape(-1, *J.shape[1:]))


Ends = FloatArray
"""For every segment of a stack the differences of first and last state, one for each of the columns E."""
