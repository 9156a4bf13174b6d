"""Bare bases as matrix polynomials D(s) Y = N U: linear in their coefficients, and closed in the frequency domain.

So a fit needs no start values, and its steps need no matrices. A base declares its form beside its equations. Held
commands and sampling are accounted for in closed form, up to images of the response's second term (below 1e-7 of it at
500 Hz), so slow sampling goes through the matrices instead; so do other outputs than p and q, and other commands than
delta_x and delta_y.
"""

from __future__ import annotations

import numpy as np

from sysid.data.preprocess import ComplexArray
from sysid.data.record import CYCLIC, RATES
from sysid.data.stacks import Stack
from sysid.model.form import Entries, Form
from sysid.model.response import Ends, Response
from sysid.model.structure import COMPLEX_STEP, FloatArray, Structure, stepped

SLOWEST_RATIO = 20.0
"""Sample rate over highest frequency from which on the closed form is exact enough."""
Regressors = tuple[tuple[tuple[int, ComplexArray], ...], ...]


def closed_form(structure: Structure) -> Form | None:
    """That of a bare base with the outputs p, q and the inputs delta_x, delta_y; None where matrices must serve."""
    if structure.composed or structure.outputs != RATES or structure.inputs != CYCLIC:
        return None
    return structure.base_.form


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
    form = structure.base_.form
    assert form is not None
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
        return Response(Y + N @ images, lambda: E, None)
    to = form.of_parameters(stepped(values)).imag / COMPLEX_STEP
    moved = Y
    if ends is not None:
        moved = Y.copy()
        for part, difference in zip(stack.slices, ends, strict=True):
            moved[:, part] += np.einsum("e,ekf->kf", difference, E[..., part])
    J = through(D, regressors(form, at.s, moved, held), np.empty((form.coefficients, 2, at.s.size), dtype=complex))
    J[-4:-2, 0] += images
    J[-2:, 1] += images
    return Response(Y + N @ images, lambda: E, J, to)
