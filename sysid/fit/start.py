"""Where a fit of a bare base begins: at its equation error, from the data alone.

The base's equation error, linear in its coefficients and reweighted by its own last denominator (Sanathanan and
Koerner), gives a start from which the output error is minimised."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from sysid.data.preprocess import ComplexArray
from sysid.data.record import RATES
from sysid.data.stacks import Stack
from sysid.errors import FitError
from sysid.fit.gauss_newton import minimise, normal_equations
from sysid.fit.output_error import axis_weights, output_error
from sysid.fit.rows import inner_products, orthonormaliser, rows
from sysid.model.form import Form
from sysid.model.polynomial import Regressors, closed_form, inverse, regressors, through
from sysid.model.structure import FloatArray, Model, Structure

REWEIGHTINGS = 3
OTHER_SLOPES = (-1.0, 0.5, 2.0)
POOR_SHARE = 0.25  # of the measured power: NRMSE below 50 %
MOST_BEGINNINGS = 8
START_THINNING = 4
FIRST_SLOPES = (0.0, 1.0)
"""Powers of frequency that weigh the first equation error down: gusts ask for none, sensor noise for more."""
CORNER = 3.0  # rad/s


def start(structure: Structure, stacks: Sequence[Stack]) -> Model:
    """The optimum on these bins from the data alone, of a bare base.

    It begins at the equation error, reweighted by its own last denominator; the end states are polynomials in s, one
    set for each segment. A base without a matrix polynomial begins at its stable point without coupling.
    """
    form = closed_form(structure)
    if form is None:
        begin = _without_form(structure, stacks)
        return minimise(begin, stacks, output_error(begin, stacks).residual_power)[0]
    measured = np.sqrt(sum(np.sum(np.abs(group.Y) ** 2, axis=1) for group in stacks))
    blocks = []
    for group in stacks:
        at = group.sampling(form.order)
        held = group.U[: len(structure.inputs)] * at.hold
        for part in group.slices:
            s, Y = at.s[part], group.Y[:, part]
            target = ((0, Y[0] * s**form.order), (1, Y[1] * s**form.order))
            known = (target, *regressors(form, s, Y, held[:, part]))
            blocks.append((s, known, group.scale[part.start] / measured[:, None]))
    begins = [_equation_error(form, structure, blocks, stacks=stacks, last=None, slope=slope) for slope in FIRST_SLOPES]
    found = sorted((one for one in begins if one is not None), key=lambda one: one[0])
    if not found:
        raise FitError("the data do not determine the model: the commands hardly move, or move together")
    found += _reweighted(form, structure, blocks, stacks=stacks, last=found[0][1], times=REWEIGHTINGS)
    best = Model(structure, form.to_parameters(min(found, key=lambda one: one[0])[1]))
    power = output_error(best, stacks).residual_power
    best, left = minimise(best, stacks, power)
    if np.all(left < POOR_SHARE * output_error(best, stacks).measured_power):
        return best
    # a poor fit may be a poor valley: begin from every other solution as well
    for slope in OTHER_SLOPES:
        again = _equation_error(form, structure, blocks, stacks=stacks, last=None, slope=slope)
        if again is not None:
            found += [
                again,
                *_reweighted(form, structure, blocks, stacks=stacks, last=again[1], times=2 * REWEIGHTINGS),
            ]
    for _, coefficients in sorted(found, key=lambda one: one[0])[:MOST_BEGINNINGS]:
        other, rest = minimise(Model(structure, form.to_parameters(coefficients)), stacks, power)
        if np.sum(np.log(rest)) < np.sum(np.log(left)):
            best, left = other, rest
    return best


def _without_form(structure: Structure, stacks: Sequence[Stack]) -> Model:
    """Where p and q alone begin, which may have a form; else the base's stable point without coupling."""
    rates = replace(structure, outputs=RATES)
    if structure.outputs == RATES or not set(RATES) <= set(structure.outputs) or closed_form(rates) is None:
        return Model(structure, np.array(structure.base_.uncoupled, dtype=float))
    at = [structure.outputs.index(name) for name in RATES]
    return Model(structure, start(rates, [replace(group, Y=group.Y[at]) for group in stacks]).values)


def _reweighted(
    form: Form,
    structure: Structure,
    blocks: Sequence[tuple[ComplexArray, Regressors, FloatArray]],
    stacks: Sequence[Stack],
    last: FloatArray,
    times: int,
) -> list[tuple[float, FloatArray]]:
    """Solutions of the equation error, each weighted by the denominator of the one before."""
    found = []
    for _ in range(times):
        again = _equation_error(form, structure, blocks, stacks=stacks, last=last, slope=0.0)
        if again is None:
            break
        found.append(again)
        last = again[1]
    return found


def _equation_error(
    form: Form,
    structure: Structure,
    blocks: Sequence[tuple[ComplexArray, Regressors, FloatArray]],
    stacks: Sequence[Stack],
    last: FloatArray | None,
    slope: float,
) -> tuple[float, FloatArray] | None:
    """One linear solution, weighted by the last denominator or a power of frequency: its cost and coefficients.

    The cost is that of the output error, so that solutions can be compared.
    """
    gram = np.zeros((form.coefficients + 1, form.coefficients + 1))
    for s, known, scale in blocks:
        if last is None:
            weight = np.zeros((2, 2, s.size), dtype=complex)
            weight[0, 0] = weight[1, 1] = (CORNER + np.abs(s)) ** -slope
        else:
            weight = inverse(form.denominator(s, last))
        ends = np.concatenate([weight.transpose(1, 0, 2) * s**power for power in range(form.order)])
        weighed = through(weight, known, np.empty((form.coefficients + 1, 2, s.size), dtype=complex))
        columns = rows(scale * ends)
        gram += inner_products(orthonormaliser(columns), columns, rows(scale * weighed))
    size = np.sqrt(np.diag(gram))
    if not np.all(np.isfinite(size)) or np.any(size == 0):
        return None
    gram = gram / np.outer(size, size)
    coefficients = np.linalg.lstsq(gram[1:, 1:], gram[1:, 0], rcond=1e-13)[0] * size[0] / size[1:]
    with np.errstate(all="ignore"):
        values = form.to_parameters(coefficients)
    if not np.all(np.isfinite(values)):
        return None
    cost = float(
        np.sum(
            np.log(
                normal_equations(
                    structure, values, stacks, axis_weights(stacks, np.ones(len(structure.outputs))), False
                ).power
            )
        )
    )
    return (cost, coefficients) if np.isfinite(cost) else None
