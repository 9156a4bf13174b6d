"""How a base declares itself a second time, as a matrix polynomial D(s) Y = N U that is linear in its coefficients.

Only two outputs, p and q, answered by two commands have this closed form; `sysid.model.polynomial` works with it.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

from numpy.typing import NDArray

from sysid.data.preprocess import ComplexArray
from sysid.data.record import FloatArray

AnyArray = NDArray[Any]
Entries = tuple[AnyArray, AnyArray, AnyArray, AnyArray]
Places = tuple[tuple[tuple[int, int, int], ...], ...]
P, Q, P_DOT, Q_DOT = range(4)
"""Rows of `sysid.model.polynomial.signals`, for a form of second order; the commands follow."""


class Form(NamedTuple):
    """s^order y_i = sum_j coefficient_j regressor_ij; the last four coefficients are those of the commands."""

    order: int
    coefficients: int
    places: Places
    """For every coefficient the equations it is in, the signal it multiplies there (row of `signals`), and the sign."""
    denominator: Callable[[ComplexArray, FloatArray], Entries]
    """(s, coefficients) -> the entries of D(s) by rows."""
    to_parameters: Callable[[FloatArray], FloatArray]
    of_parameters: Callable[[AnyArray], AnyArray]
    """(..., parameters) -> (..., coefficients), analytic."""
    second: Callable[[FloatArray], FloatArray]
    """M (2, 2) in s^(order-1) D(s)^-1 = 1/s + M/s^2 + ..., from the coefficients."""
