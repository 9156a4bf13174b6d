"""The bare bases as matrix polynomials D(s) Y = N U: linear in their coefficients, and closed in the frequency domain.

Eliminating the flapping leaves two second-order equations; their nine coefficients map one to one to the parameters:
  p'' = -L_b p - p'/tau_f + c_p q' + L_b/tau_f (B_lat delta_x + B_lon delta_y),   c_p = B_a L_b/(M_a tau_f)
  q'' = -M_a q - q'/tau_f + c_q p' + M_a/tau_f (A_lat delta_x + A_lon delta_y),   c_q = A_b M_a/(L_b tau_f)
Cylinder Dynamics is of first order and its coefficients are its parameters. So a fit needs no start values, and its
steps need no matrices. Held commands and sampling are accounted for in closed form, up to
images of the response's second term (below 1e-7 of it at 500 Hz), so slow sampling goes through the matrices instead.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from sysid.data.preprocess import ComplexArray
from sysid.data.stacks import Stack
from sysid.model.response import Ends, Response
from sysid.model.structure import COMPLEX_STEP, AnyArray, FloatArray, Structure, stepped

SLOWEST_RATIO = 20.0
"""Sample rate over highest frequency from which on the closed form is exact enough."""
Entries = tuple[AnyArray, AnyArray, AnyArray, AnyArray]
Places = tuple[tuple[tuple[int, int, int], ...], ...]
Regressors = tuple[tuple[tuple[int, ComplexArray], ...], ...]


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


def signals(form: Form, s: ComplexArray, Y: ComplexArray, U: ComplexArray) -> list[ComplexArray]:
    """What the coefficients multiply, each of the shape of s: Y (2, ...) and its derivatives, then U (2, ...)."""
    return [*Y, *(s * Y if form.order == 2 else ()), *U]


def regressors(form: Form, s: ComplexArray, Y: ComplexArray, U: ComplexArray) -> Regressors:
    """For every coefficient the equations it is in, and its factor there."""
    known = signals(form, s, Y, U)
    return tuple(
        tuple((equation, known[row] if sign > 0 else -known[row]) for equation, row, sign in places)
        for places in form.places
    )


_P, _Q, _P_DOT, _Q_DOT = range(4)


def _tpp_denominator(s: ComplexArray, c: FloatArray) -> Entries:
    common = s * s + c[2] * s
    return common + c[0], -c[3] * s, -c[4] * s, common + c[1]


def _tpp_parameters(c: FloatArray) -> FloatArray:
    L_b, M_a, rate, c_p, c_q, p_x, p_y, q_x, q_y = c
    roll, pitch = 1 / (rate * L_b), 1 / (rate * M_a)
    return np.array(
        [
            L_b,
            M_a,
            1 / rate,
            c_q * L_b * pitch,
            c_p * M_a * roll,
            q_x * pitch,
            q_y * pitch,
            p_x * roll,
            p_y * roll,
        ]
    )


def _tpp_coefficients(values: AnyArray) -> AnyArray:
    L_b, M_a, tau_f, A_b, B_a, A_lat, A_lon, B_lat, B_lon = np.moveaxis(values, -1, 0)
    roll, pitch = L_b / tau_f, M_a / tau_f
    return np.stack(
        [
            L_b,
            M_a,
            1 / tau_f,
            B_a * roll / M_a,
            A_b * pitch / L_b,
            roll * B_lat,
            roll * B_lon,
            pitch * A_lat,
            pitch * A_lon,
        ],
        axis=-1,
    )


def _cd_denominator(s: ComplexArray, c: FloatArray) -> Entries:
    return s - c[0], -c[1] + 0 * s, -c[2] + 0 * s, s - c[3]


FORMS = {
    "tpp": Form(
        order=2,
        coefficients=9,
        places=(
            ((0, _P, -1),),
            ((1, _Q, -1),),
            ((0, _P_DOT, -1), (1, _Q_DOT, -1)),
            ((0, _Q_DOT, 1),),
            ((1, _P_DOT, 1),),
            *(((equation, row, 1),) for equation in (0, 1) for row in (4, 5)),
        ),
        denominator=_tpp_denominator,
        to_parameters=_tpp_parameters,
        of_parameters=_tpp_coefficients,
        second=lambda c: np.array([[-c[2], c[3]], [c[4], -c[2]]]),
    ),
    "cd": Form(
        order=1,
        coefficients=8,
        places=tuple(((equation, row, 1),) for rows in ((0, 1), (2, 3)) for equation in (0, 1) for row in rows),
        denominator=_cd_denominator,
        to_parameters=lambda c: c,
        of_parameters=lambda values: values,
        second=lambda c: c[:4].reshape(2, 2),
    ),
}


def exact_enough(stack: Stack) -> bool:
    return bool(SLOWEST_RATIO * stack.frequency_hz[-1] < 1 / stack.dt)


def inverse(D: Entries) -> ComplexArray:
    """D(s)^-1, (2, 2, ...)."""
    d00, d01, d10, d11 = D
    scale = 1 / (d00 * d11 - d01 * d10)
    found = np.empty((2, 2, *scale.shape), dtype=complex)
    np.multiply(d11, scale, out=found[0, 0])
    np.multiply(d00, scale, out=found[1, 1])
    np.negative(scale, out=scale)
    np.multiply(d01, scale, out=found[0, 1])
    np.multiply(d10, scale, out=found[1, 0])
    return found


def through(D: ComplexArray, regressors: Regressors, out: ComplexArray) -> ComplexArray:
    """D(s)^-1 (2, 2, bins) times every regressor, into `out` (coefficients, 2, bins)."""
    for row, parts in zip(out, regressors, strict=True):
        axis, factor = parts[0]
        np.multiply(D[:, axis], factor, out=row)
        for axis, factor in parts[1:]:
            row += D[:, axis] * factor
    return out


def respond(
    structure: Structure,
    values: FloatArray,
    stack: Stack,
    sensitivities: bool,
    U: ComplexArray,
    ends: Ends | None = None,
) -> Response:
    """As `predict.respond`, of a bare base; sensitivities are to the coefficients, `to` turns them to parameters."""
    form = FORMS[structure.base]
    at = stack.sampling(form.order)
    c = form.of_parameters(values)
    D = inverse(form.denominator(at.s, c))
    held = U * at.hold
    N = c[-4:].reshape(2, 2)
    driven = N @ held
    Y = D[:, 0] * driven[0]
    Y += D[:, 1] * driven[1]
    E = np.empty((2 * form.order, 2, at.s.size), dtype=complex)
    E[:2] = D.transpose(1, 0, 2)
    if form.order == 2:
        np.multiply(E[:2], at.s, out=E[2:])
    E[-2, 0] += at.jump
    E[-1, 1] += at.jump
    E[-2:] += form.second(c).T[:, :, None] * at.bend
    if form.order == 2:
        E[0, 0] += at.bend
        E[1, 1] += at.bend
    images = at.images * U
    if not sensitivities:
        return Response(Y + N @ images, E, None, None)
    to = form.of_parameters(stepped(values)).imag / COMPLEX_STEP
    moved = Y
    if ends is not None:
        moved = Y.copy()
        for part, difference in zip(stack.slices, ends, strict=True):
            moved[:, part] += np.einsum("e,ekf->kf", difference, E[..., part])
    J = through(D, regressors(form, at.s, moved, held), np.empty((form.coefficients, 2, at.s.size), dtype=complex))
    J[-4:-2, 0] += images
    J[-2:, 1] += images
    return Response(Y + N @ images, E, J, to)
