"""Where a fit of a bare base begins: at its equation error, from the data alone.

The base's equation error, linear in its coefficients and reweighted by its own last denominator (Sanathanan and
Koerner), gives a start from which the output error is minimised."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from sysid.data.preprocess import ComplexArray
from sysid.data.record import RATES
from sysid.data.stacks import Stack
from sysid.errors import FitError
from sysid.fit.gauss_newton import minimise, normal_equations
from sysid.fit.output_error import axis_weights, output_error
from sysid.fit.rows import less_ends, rows
from sysid.model.form import Form
from sysid.model.polynomial import Regressors, closed_form, inverse, regressors, through
from sysid.model.structure import FloatArray, Model, Structure

REWEIGHTINGS = 3
FIRST_SLOPES = (1.0, 0.0)
"""Powers of frequency that weigh the first equation error down: gusts ask for none, sensor noise for more."""
OTHER_SLOPES = (-1.0, 0.5, 2.0)
GOOD_SHARE = 0.1
"""Of the measured power, that the first solution may leave to be taken unasked;"""
POOR_SHARE = 0.25
"""and the optimum, to be believed: NRMSE above 50 %."""
MOST_BEGINNINGS = 8
START_THINNING = 4
CORNER = 3.0  # rad/s
AS_GOOD = 0.01
"""In summed logarithms of residual power: what optima that were not followed to their ends may differ by."""
ROUGH = 1e-3
"""Where Gauss-Newton ends, in summed logarithms of residual power: on all bins it goes on from there."""


def start(structure: Structure, stacks: Sequence[Stack], thorough: bool = True) -> Model:
    """Nearly the optimum on these bins from the data alone, of a bare base.

    It begins at the equation error, reweighted by its own last denominator; where that ends in a poor fit, or an
    unstable one, and the search is `thorough`, at others as well. A base without a matrix polynomial begins at its
    stable point without coupling and at each point of its parameters' grids. Raises FitError where the commands hardly
    move, or move together.
    """
    form = closed_form(structure)
    if form is None:
        return _best(_without_form(structure, stacks, thorough), stacks)
    equations = _Equations.of(form, structure, stacks)
    found = equations.first()
    first = min(found, key=lambda one: one.cost)
    best, left = minimise(first.model, stacks, first.power, tolerance=ROUGH)
    if not thorough or (best.stable and np.all(left < POOR_SHARE * equations.measured_power)):
        return best
    # a poor fit may be a poor valley, and so may one that runs away
    for slope in OTHER_SLOPES:
        found += equations.solutions(slope, 2 * REWEIGHTINGS)
    for one in sorted(found, key=lambda one: one.cost)[:MOST_BEGINNINGS]:
        other, rest = minimise(one.model, stacks, first.power, tolerance=ROUGH)
        if np.sum(np.log(rest)) < np.sum(np.log(left)):
            best, left = other, rest
    return best


def _best(beginnings: Sequence[Model], stacks: Sequence[Stack]) -> Model:
    """The optimum that least is left of, followed to its end. Of optima as good as it (poles may change places) the one
    of most plausible values."""
    if len(beginnings) == 1:
        return minimise(beginnings[0], stacks, output_error(beginnings[0], stacks).residual_power)[0]
    found = [minimise(one, stacks, output_error(one, stacks).residual_power, tolerance=ROUGH) for one in beginnings]
    costs = [float(np.sum(np.log(left))) for _, left in found]
    near = [one for one, cost in zip(found, costs, strict=True) if cost <= min(costs) + AS_GOOD]
    best, left = min(near, key=lambda one: _implausible(one[0]))
    return minimise(best, stacks, left)[0]


def _implausible(model: Model) -> int:
    """How many of its values physics does not allow."""
    parameters = model.structure.parameters
    return sum(one.implausible(float(value)) for one, value in zip(parameters, model.values, strict=True))


def _without_form(structure: Structure, stacks: Sequence[Stack], thorough: bool) -> list[Model]:
    """Where p and q alone begin, which may have a form; else the base's stable point without coupling, and beside it
    each point of its grids."""
    rates = replace(structure, outputs=RATES)
    if structure.outputs == RATES or not set(RATES) <= set(structure.outputs) or closed_form(rates) is None:
        base = structure.base_
        grids = [(one.grid or (value,)) for one, value in zip(base.parameters, base.uncoupled, strict=True)]
        points = dict.fromkeys((base.uncoupled, *itertools.product(*grids)))
        return [Model(structure, np.array(point, dtype=float)) for point in points]
    at = [structure.outputs.index(name) for name in RATES]
    return [Model(structure, start(rates, [replace(group, Y=group.Y[at]) for group in stacks], thorough).values)]


@dataclass(frozen=True, eq=False)
class _Solution:
    """A solution of the equation error, and what its model leaves of the outputs."""

    coefficients: FloatArray
    model: Model
    power: FloatArray
    """(k,)"""

    @property
    def cost(self) -> float:
        """That of the output error, so that solutions can be compared."""
        return float(np.sum(np.log(self.power)))


@dataclass(frozen=True, eq=False)
class _Equations:
    """A bare base's equations on the bins: linear in its coefficients, end states being polynomials in s, one set for
    each segment."""

    form: Form
    structure: Structure
    stacks: Sequence[Stack]
    measured_power: FloatArray
    """(k,)"""
    segments: list[tuple[ComplexArray, Regressors, FloatArray]]
    """s (bins,), what the coefficients multiply, the target first, and the weight of each output (k, 1)."""

    @classmethod
    def of(cls, form: Form, structure: Structure, stacks: Sequence[Stack]) -> _Equations:
        power = np.sum([np.sum(np.abs(group.scale * group.Y) ** 2, axis=1) for group in stacks], axis=0)
        size = np.sqrt(np.sum([np.sum(np.abs(group.Y) ** 2, axis=1) for group in stacks], axis=0))
        segments = []
        for group in stacks:
            at = group.sampling(form.order)
            held = group.U[: len(structure.inputs)] * at.hold
            for part in group.slices:
                s, Y = at.s[part], group.Y[:, part]
                target = ((0, Y[0] * s**form.order), (1, Y[1] * s**form.order))
                known = (target, *regressors(form, s, Y, held[:, part]))
                segments.append((s, known, group.scale[part.start] / size[:, None]))
        return cls(form, structure, stacks, power, segments)

    def first(self) -> list[_Solution]:
        """The first good solution, or all where none is. Raises FitError where there is none."""
        found: list[_Solution] = []
        for slope in FIRST_SLOPES:
            found += self.solutions(slope, REWEIGHTINGS)
            if found and np.all(found[-1].power < GOOD_SHARE * self.measured_power):
                return found[-1:]
        if not found:
            raise FitError("the data do not determine the model: the commands hardly move, or move together")
        return found

    def solutions(self, slope: float, times: int) -> list[_Solution]:
        """Weighted by a power of frequency, then so many times by the denominator of the one before."""
        found: list[_Solution] = []
        for _ in range(1 + times):
            again = self._solved(slope, found[-1].coefficients if found else None)
            if again is None:
                break
            found.append(again)
        return found

    def _solved(self, slope: float, last: FloatArray | None) -> _Solution | None:
        """One linear solution, weighted by the last denominator or, without one, a power of frequency."""
        ends, count = 2 * self.form.order, self.form.coefficients
        grams = []
        for s, known, scale in self.segments:
            if last is None:
                weight = np.zeros((2, 2, s.size), dtype=complex)
                weight[0, 0] = weight[1, 1] = (CORNER + np.abs(s)) ** -slope
            else:
                weight = inverse(self.form.denominator(s, last))
            weighed = np.empty((ends + 1 + count, 2, s.size), dtype=complex)
            for power in range(self.form.order):
                np.multiply(weight.transpose(1, 0, 2), s**power, out=weighed[2 * power : 2 * power + 2])
            through(weight, known, weighed[ends:])
            weighed *= scale
            block = rows(weighed)
            grams.append(block @ block.T)
        gram, _ = less_ends(np.array(grams), ends)
        size = np.sqrt(np.diag(gram))
        if not np.all(np.isfinite(size)) or np.any(size == 0):
            return None
        gram = gram / np.outer(size, size)
        coefficients = np.linalg.lstsq(gram[1:, 1:], gram[1:, 0], rcond=1e-13)[0] * size[0] / size[1:]
        return self._judged(coefficients)

    def _judged(self, coefficients: FloatArray) -> _Solution | None:
        with np.errstate(all="ignore"):
            values = self.form.to_parameters(coefficients)
        if not np.all(np.isfinite(values)):
            return None
        weights = axis_weights(self.stacks, np.ones(len(self.structure.outputs)))
        power = normal_equations(self.structure, values, self.stacks, weights, False).power
        model = Model(self.structure, values)
        return _Solution(coefficients, model, power) if np.all(np.isfinite(np.log(power))) else None
