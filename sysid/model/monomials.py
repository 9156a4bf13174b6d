"""Matrices of structures, and their derivatives, by the monomials of the parameters that they are sums of.

Equations of physics are mostly sums of products. Gone through once with symbols for parameters and signals, they are
tables, and a fit's many values cost a few operations on these each. What is more, a sine or a power that is a parameter
itself, goes through its equations every time, by complex steps.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from sysid.model.structure import COMPLEX_STEP, FloatArray, Matrices, Structure, stepped

BASE = 2**20
"""Of the number that stands for a monomial: its digits, which may be negative, are the exponents."""
HIGHEST = 16
"""Power that equations take at once, which leaves digits far from full."""
MOST_TERMS = 500
"""Of one signal, from which on products of sums grow beyond all use."""


def linearised(structure: Structure, values: FloatArray) -> tuple[Matrices, Matrices]:
    """Matrices at these values (parameters,), and their derivatives to each, (parameters, rows, columns)."""
    table = _table(structure)
    if table is not None:
        return table.at(values)
    matrices = structure.matrices(stepped(values))
    here = Matrices(*(x[0].real for x in matrices))
    return here, Matrices(*(x.imag / COMPLEX_STEP for x in matrices))


class _Table(NamedTuple):
    """Sums of monomials: those of every entry of the matrices first, then those of every derivative."""

    base: NDArray[np.intp]
    exponent: FloatArray
    """Powers of parameters, (powers,), each of this one to this exponent."""
    factors: NDArray[np.intp]
    """(most factors, terms), numbers of powers; the one beyond them is 1."""
    coefficients: FloatArray
    """(terms,)"""
    entries: NDArray[np.intp]
    """(terms,), where each is added."""
    shape: tuple[int, int, int]
    """(1 + parameters, states + outputs, states + inputs)"""
    states: int

    def at(self, values: FloatArray) -> tuple[Matrices, Matrices]:
        powers = np.append(values[self.base] ** self.exponent, 1.0)
        terms = self.coefficients.copy()
        for factor in self.factors:
            terms *= powers[factor]
        count, rows, columns = self.shape
        every = np.bincount(self.entries, terms, count * rows * columns).reshape(self.shape)
        n = self.states
        parts = every[:, :n, :n], every[:, :n, n:], every[:, n:, :n], every[:, n:, n:]
        return Matrices(*(part[0] for part in parts)), Matrices(*(part[1:] for part in parts))


class _Sum:
    """A sum of monomials while equations are gone through: coefficients by the numbers that stand for monomials."""

    __array_ufunc__ = None  # NumPy's numbers leave operations to this class, and its functions refuse it
    __slots__ = ("terms",)

    def __init__(self, terms: dict[int, float]) -> None:
        if len(terms) > MOST_TERMS:
            raise ValueError("too many terms")
        self.terms = terms

    def __bool__(self) -> bool:
        raise TypeError("equations do not branch on values")

    def __add__(self, other: Any) -> _Sum:
        found = dict(self.terms)
        for key, value in _terms(other).items():
            found[key] = found.get(key, 0.0) + value
        return _Sum(found)

    __radd__ = __add__

    def __neg__(self) -> _Sum:
        return _Sum({key: -value for key, value in self.terms.items()})

    def __pos__(self) -> _Sum:
        return self

    def __sub__(self, other: Any) -> _Sum:
        return self + -_Sum(_terms(other))

    def __rsub__(self, other: Any) -> _Sum:
        return _Sum(_terms(other)) + -self

    def __mul__(self, other: Any) -> _Sum:
        found: dict[int, float] = {}
        for key, value in _terms(other).items():
            for own, times in self.terms.items():
                found[key + own] = found.get(key + own, 0.0) + value * times
        return _Sum(found)

    __rmul__ = __mul__

    def __truediv__(self, other: Any) -> _Sum:
        return self * (other**-1 if isinstance(other, _Sum) else 1 / float(other))

    def __rtruediv__(self, other: Any) -> _Sum:
        return _Sum(_terms(other)) * self**-1

    def __pow__(self, exponent: Any) -> _Sum:
        whole = int(exponent)
        if whole != exponent or abs(whole) > HIGHEST:
            raise TypeError("no whole power, or a high one")
        if whole >= 0:
            found = _Sum({0: 1.0})
            for _ in range(whole):
                found = found * self
            return found
        ((key, value),) = self.terms.items()  # raises ValueError where it is a sum
        return _Sum({whole * key: value**whole})

    def __rpow__(self, base: Any) -> float:
        if float(base) != 1:
            raise TypeError("a power that is a parameter")
        return 1.0


def _terms(x: Any) -> dict[int, float]:
    return x.terms if isinstance(x, _Sum) else {0: float(x)}


@lru_cache(maxsize=256)
def _table(structure: Structure) -> _Table | None:
    """None where the equations are more than sums of monomials."""
    names, count = structure.names, len(structure.names)
    signals = (*structure.states, *structure.inputs)
    symbols = {name: _Sum({BASE**number: 1.0}) for number, name in enumerate((*names, *signals))}
    means = structure.mean_channels
    try:
        rates, outputs = structure.evaluate(
            {name: symbols[name] for name in names}, {name: symbols[name] for name in signals} | means
        )
        rows = [_terms(rates[f"{state}_dot"]) for state in structure.states]
        rows += [_terms(outputs[name]) for name in structure.outputs]
        made = [
            (row * len(signals) + column, value, powers)
            for row, terms in enumerate(rows)
            for column, value, powers in _decoded(terms, count)
        ]
    except (TypeError, ValueError, ArithmeticError, AttributeError):
        return None
    return _tabulated(made, (1 + count, len(rows), len(signals)), len(structure.states))


def _decoded(terms: Mapping[int, float], count: int) -> list[tuple[int, float, dict[int, int]]]:
    """For each term the number of its signal, its coefficient, and exponents by parameter. What is a product of signals
    vanishes in small motion. Raises ValueError for a term that has no signal."""
    found = []
    for key, value in terms.items():
        powers: dict[int, int] = {}
        number, rest = 0, key
        while rest:
            digit = (rest + BASE // 2) % BASE - BASE // 2
            if digit:
                powers[number] = digit
            number, rest = number + 1, (rest - digit) // BASE
        driving = {one: powers.pop(one) for one in list(powers) if one >= count}
        if sum(driving.values()) > 1 and min(driving.values()) > 0:
            continue
        if value and list(driving.values()) != [1]:
            raise ValueError("no small motion about rest")
        if value:
            found.append((next(iter(driving)) - count, value, powers))
    return found


def _tabulated(made: list[tuple[int, float, dict[int, int]]], shape: tuple[int, int, int], states: int) -> _Table:
    """Terms (entry, coefficient, exponents by parameter) and their derivatives, as a table."""
    whole = list(made)
    for entry, value, powers in made:
        for one, exponent in powers.items():
            less = {**powers, one: exponent - 1}
            whole.append(((1 + one) * shape[1] * shape[2] + entry, exponent * value, less))
    numbers: dict[tuple[int, int], int] = {}
    factors = [[numbers.setdefault(one, len(numbers)) for one in powers.items() if one[1]] for _, _, powers in whole]
    most = max(map(len, factors), default=0)
    return _Table(
        base=np.array([one for one, _ in numbers], dtype=int),
        exponent=np.array([float(exponent) for _, exponent in numbers]),
        factors=np.array([[*each, *[len(numbers)] * (most - len(each))] for each in factors], dtype=int).T,
        coefficients=np.array([value for _, value, _ in whole]),
        entries=np.array([entry for entry, _, _ in whole], dtype=int),
        shape=shape,
        states=states,
    )
