"""Output-error fits in the Fourier domain: bare bases without start values, compositions from their parents.

The measured samples enter once, as Fourier bins up to 15 Hz. The base's equation error, linear in its coefficients
and reweighted by its own last denominator (Sanathanan and Koerner), gives a start; Gauss-Newton steps with halving
minimise the output error. Each segment's difference between first and last state is an extra linear unknown,
projected out, so that the bins are exact for records that are not periodic.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from sysid.data.preprocess import ComplexArray, Spectrum
from sysid.errors import SysidError
from sysid.fit import fast
from sysid.fit.identifiable import alike
from sysid.fit.instrument import instruments
from sysid.fit.search import Trial, cleft
from sysid.model.polynomial import FORMS, Form, Regressors, inverse, regressors, through
from sysid.model.predict import (
    Ends,
    RelaxationError,
    Response,
    Stack,
    behind,
    divided,
    jumping,
    linear_dynamics,
    respond,
    stack,
)
from sysid.model.structure import AnyArray, FloatArray, Model, Structure

REWEIGHTINGS = 3
OTHER_SLOPES = (-1.0, 0.5, 2.0)
SETTLED = 0.02
"""Relative change of residual power from which on the outputs are weighed anew."""
POOR_SHARE = 0.25  # of the measured power: NRMSE below 50 %
MOST_BEGINNINGS = 8
START_THINNING = 4
FIRST_SLOPES = (0.0, 1.0)
"""Powers of frequency that weigh the first equation error down: gusts ask for none, sensor noise for more."""
CORNER = 3.0  # rad/s
MAXIMUM_STEPS = 60
TOLERANCE = 3e-6  # of the summed logarithms of residual power: at most 0.1 standard errors
SMALLEST_LENGTH = 1e-5
TRIAL_STEPS = 3
STABILITY_PUSHES = (0.03, 0.3, 3.0, 30.0)
STABILITY_MARGIN = 0.1  # 1/s
SMOOTHING_HZ = 1.0
LEAST_COMMAND = 2e-4  # rms of full command in the band: one step of a 12-bit servo
LEAST_INDEPENDENT_SHARE = 0.002
LARGEST_RELATIVE_ERROR = 0.25
SHARE_BAND_HZ = 0.5
LEAST_SHARE = 1e-9  # below which a command counts as following the others
ENDS_RANK = 1e-10
LARGEST_SEARCH = 24
SEARCH_ROUNDS = 2
MOST_PROMISING = 2
NEAR_NULL = 0.9
UNBIASING_STEPS = 8
WORST_UNBIASING = 1.1  # of the residual power at the least-squares optimum


class FitError(SysidError):
    """The data cannot identify the structure; the message names the axis and what to do."""


@dataclass(frozen=True, eq=False)
class OutputError:
    """What a model leaves unexplained, end states projected out."""

    residuals: list[ComplexArray]
    """For every segment (k, bins)."""
    measured_power: FloatArray
    """(k,), mean square times samples, summed over all segments."""
    residual_power: FloatArray
    """(k,)"""

    @property
    def nrmse_percent(self) -> FloatArray:
        """Eq. 10 per output, pooled over runs; 100 is perfect."""
        return 100 * (1 - np.sqrt(self.residual_power / self.measured_power))


@dataclass(frozen=True, eq=False)
class Estimate:
    """The best values, and how far the data bind them."""

    model: Model
    covariance: FloatArray
    """(parameters, parameters), honest under coloured residuals; zero for held parameters."""
    error: OutputError
    at_bound: tuple[str, ...] = field(default=())
    instrumented: bool = False
    """The logged excitation served as instrument, so that feedback does not bias the values."""


@dataclass(frozen=True, eq=False)
class _Normal:
    """Normal equations of one weighted linearisation, end states projected out."""

    power: FloatArray
    """(k,), of the residual, as if unweighted; the weights are constant over frequency."""
    curvature: FloatArray
    gradient: FloatArray
    ends: list[list[FloatArray]]
    """For every stack and segment, the differences of first and last state."""


def rows(x: ComplexArray) -> FloatArray:
    """(r, k, bins) complex -> (r, 2 k bins) real, so that real products are real parts."""
    real: FloatArray = np.ascontiguousarray(x).reshape(x.shape[0], -1).view(float)
    return real


def _orthonormaliser(E: FloatArray) -> FloatArray:
    """T (r, n) that turns the rows of E (n, N) into an orthonormal basis T E; weak combinations stay out."""
    size = np.sqrt(np.einsum("ij,ij->i", E, E))
    size = np.where(size > 0, size, 1.0)
    scaled = E / size[:, None]
    inner, axes = np.linalg.eigh(scaled @ scaled.T)
    keep = inner > ENDS_RANK * inner[-1]
    return np.asarray((axes[:, keep] / np.sqrt(inner[keep])).T / size)


def _project(E: FloatArray, others: FloatArray) -> FloatArray:
    """Rows of `others` (r, N) less what the rows of E (n, N) explain of them."""
    basis = _orthonormaliser(E) @ E
    rest: FloatArray = others - (others @ basis.T) @ basis
    return rest


def output_error(model: Model, stacks: Sequence[Stack]) -> OutputError:
    """What the model leaves of each segment after its own trim and end states."""
    residuals = []
    measured, left = np.zeros(2), np.zeros(2)
    for group in stacks:
        response = respond(model.structure, model.values, group, False)
        e = group.Y - response.Y
        for part in group.slices:
            scale = group.scale[part.start]
            rest = _project(rows(response.E[..., part]), rows(e[None, :, part]))
            left_over: ComplexArray = rest.view(complex).reshape(e.shape[0], -1)
            residuals.append(left_over)
            left += scale**2 * np.sum(np.abs(left_over) ** 2, axis=1)
            measured += scale**2 * np.sum(np.abs(group.Y[:, part]) ** 2, axis=1)
    return OutputError(residuals, measured, left)


def _normal(
    structure: Structure,
    values: FloatArray,
    stacks: Sequence[Stack],
    weights: Sequence[FloatArray],
    full: bool,
    ends: Sequence[Ends] | None = None,
) -> _Normal:
    """Curvature J J^T, gradient J r and what is left, with weights (k, bins), end states projected out."""
    count = values.size if full else 0
    curvature, gradient, power = np.zeros((count, count)), np.zeros(count), np.zeros(2)
    found: list[list[FloatArray]] = []
    for number, (group, weight) in enumerate(zip(stacks, weights, strict=True)):
        response = respond(structure, values, group, full, None, None if ends is None else ends[number])
        found.append([])
        e, E = weight * (group.Y - response.Y), weight * response.E
        if response.J is not None:
            np.multiply(response.J, weight, out=response.J)
        for part in group.slices:
            columns = rows(E[..., part])
            left_over = rows(e[None, :, part])
            T = _orthonormaliser(columns)
            difference = T.T @ (T @ (columns @ left_over[0]))
            rest = left_over - difference @ columns
            found[-1].append(difference)
            power += np.sum(rest.reshape(2, -1) ** 2, axis=1) * (group.scale[part.start] / weight[:, part.start]) ** 2
            if response.J is not None:
                gram = _gram(T, columns, np.concatenate([rest, rows(response.J[..., part])]))
                if response.to is not None:
                    gram[1:] = response.to @ gram[1:]
                    gram[:, 1:] = gram[:, 1:] @ response.to.T
                curvature += gram[1:, 1:]
                gradient += gram[1:, 0]
    return _Normal(power, curvature, gradient, found)


def start(structure: Structure, stacks: Sequence[Stack]) -> Model:
    """The optimum on these bins from the data alone, of a bare base.

    It begins at the equation error, reweighted by its own last denominator; the end states are polynomials in s, one
    set for each segment.
    """
    form = FORMS[structure.base]
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
    begins = [_equation_error(form, structure, blocks, stacks, None, slope) for slope in FIRST_SLOPES]
    found = sorted((one for one in begins if one is not None), key=lambda one: one[0])
    if not found:
        raise FitError("the data do not determine the model: the commands hardly move, or move together")
    found += _reweighted(form, structure, blocks, stacks, found[0][1], REWEIGHTINGS)
    best = Model(structure, form.to_parameters(min(found, key=lambda one: one[0])[1]))
    power = output_error(best, stacks).residual_power
    best, left = minimise(best, stacks, power)
    if np.all(left < POOR_SHARE * output_error(best, stacks).measured_power):
        return best
    # a poor fit may be a poor valley: begin from every other solution as well
    for slope in OTHER_SLOPES:
        again = _equation_error(form, structure, blocks, stacks, None, slope)
        if again is not None:
            found += [again, *_reweighted(form, structure, blocks, stacks, again[1], 2 * REWEIGHTINGS)]
    for _, coefficients in sorted(found, key=lambda one: one[0])[:MOST_BEGINNINGS]:
        other, rest = minimise(Model(structure, form.to_parameters(coefficients)), stacks, power)
        if np.sum(np.log(rest)) < np.sum(np.log(left)):
            best, left = other, rest
    return best


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
        again = _equation_error(form, structure, blocks, stacks, last, 0.0)
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
        gram += _gram(_orthonormaliser(columns), columns, rows(scale * weighed))
    size = np.sqrt(np.diag(gram))
    if not np.all(np.isfinite(size)) or np.any(size == 0):
        return None
    gram = gram / np.outer(size, size)
    coefficients = np.linalg.lstsq(gram[1:, 1:], gram[1:, 0], rcond=1e-13)[0] * size[0] / size[1:]
    with np.errstate(all="ignore"):
        values = form.to_parameters(coefficients)
    if not np.all(np.isfinite(values)):
        return None
    cost = float(np.sum(np.log(_normal(structure, values, stacks, axis_weights(stacks, np.ones(2)), False).power)))
    return (cost, coefficients) if np.isfinite(cost) else None


def _gram(T: FloatArray, ends: FloatArray, block: FloatArray) -> FloatArray:
    """Inner products of the rows of `block`, less what the rows of `ends`, orthonormal by T, explain of them."""
    cross = T @ (ends @ block.T)
    found: FloatArray = block @ block.T - cross.T @ cross
    return found


def minimise(
    model: Model,
    stacks: Sequence[Stack],
    power: FloatArray,
    held: Sequence[str] = (),
    steps: int = MAXIMUM_STEPS,
) -> tuple[Model, FloatArray]:
    """Gauss-Newton with step halving and hard bounds on sum log(residual power) over the outputs.

    After every step the outputs are weighed anew by what is left of them; `power` (k,) weighs the first. `held`
    parameters stay. Returns the model and its residual power.
    """
    structure = model.structure
    low = np.array([parameter.bounds[0] for parameter in structure.parameters])
    high = np.array([parameter.bounds[1] for parameter in structure.parameters])
    movable = np.array([name not in held for name in structure.names])
    values = np.clip(model.values, low, high)
    here, weighed_by = _normal(structure, values, stacks, axis_weights(stacks, power), True), power
    for _ in range(steps):
        if not np.allclose(weighed_by, here.power, rtol=SETTLED):
            weights = axis_weights(stacks, here.power)
            here, weighed_by = _normal(structure, values, stacks, weights, True, here.ends), here.power
        free = movable & ~((values <= low) & (here.gradient < 0)) & ~((values >= high) & (here.gradient > 0))
        if not np.any(free):
            break
        move = _step(here, free)
        if float(here.gradient @ move) < TOLERANCE:  # what the step promises, in summed logarithms
            break
        weights = axis_weights(stacks, here.power)
        goal = float(np.sum(np.log(here.power)))
        length = 1.0
        while length > SMALLEST_LENGTH:
            trial = np.clip(values + length * move, low, high)
            there = _try(structure, trial, stacks, weights, here.ends)
            reached = np.inf if there is None else float(np.sum(np.log(there.power)))
            if there is not None and np.isfinite(reached) and reached < goal:
                break
            length /= 2
        else:
            break
        values, here, weighed_by = trial, there, here.power
        if goal - reached < TOLERANCE:
            break
    return Model(structure, values), here.power


def _step(here: _Normal, free: NDArray[np.bool_]) -> FloatArray:
    """The Gauss-Newton step of the free parameters, (parameters,)."""
    H, g = here.curvature[np.ix_(free, free)], here.gradient[free]
    size = np.sqrt(np.maximum(np.diag(H), 0))  # rounding leaves less than nothing where nothing is
    size = np.where(size > 0, size, 1.0)
    move = np.zeros(free.size)
    move[free] = np.linalg.lstsq(H / np.outer(size, size), g / size, rcond=1e-12)[0] / size
    return move


def _try(
    structure: Structure,
    values: FloatArray,
    stacks: Sequence[Stack],
    weights: Sequence[FloatArray],
    ends: Sequence[Ends],
) -> _Normal | None:
    """The normal equations there, or None where there is no response."""
    if not np.all(np.isfinite(values)):
        return None
    try:
        with np.errstate(all="ignore"):  # a time constant of zero has no response: what comes out is not finite
            return _normal(structure, values, stacks, weights, True, ends)
    except (RelaxationError, np.linalg.LinAlgError):
        return None


def axis_weights(stacks: Sequence[Stack], power: FloatArray) -> list[FloatArray]:
    """One over the residual's standard deviation, (k, bins), every sample of every run counting the same."""
    floor = 1e-12 * max(float(power.max()), 1e-300)
    scale = 1 / np.sqrt(np.maximum(power, floor))
    return [scale[:, None] * group.scale for group in stacks]


def grow(parent: Model, structure: Structure, stacks: Sequence[Stack], held: Mapping[str, float]) -> Model:
    """The best model of a composition that begins at its parent's fit.

    Every new effect begins at its typical size and at each point of its grids; a few steps show which valley is
    deepest, and that one is followed to the bottom. What the parent knows already is taken from it; `held` parameters
    stay at their values.
    """
    known = dict(zip(parent.structure.names, map(float, parent.values), strict=True))
    first, choices = _beginnings(structure, known)
    first |= held
    choices = {name: values for name, values in choices.items() if name not in held}
    power = output_error(parent, stacks).residual_power
    linear = linear_dynamics(structure)
    front, rest = divided(structure) if linear else ((), structure)
    # which valley is deepest shows on some of the bins; a relaxation costs the same for few as for all
    few = [group.thinned(START_THINNING) for group in stacks] if linear else stacks
    without = [behind(parent.structure, parent.values, group).thinned(START_THINNING) for group in stacks if front]

    def acted(begin: Mapping[str, float]) -> list[Stack]:
        return [behind(structure, structure.vector({**known, **begin}), group) for group in stacks]

    def tried(begin: Mapping[str, float], groups: Sequence[Stack] | None = None) -> Trial:
        """What acts on samples stays as it begins, simulated once; the rest is fitted."""
        values = {**known, **begin}
        if groups is None:
            groups = [group.thinned(START_THINNING) for group in acted(begin)] if front else few
        try:
            # first the new parameters alone, then all: the parent's stay where they were fitted until it pays
            model, left = minimise(Model(rest, rest.vector(values)), groups, power, [*known, *held], TRIAL_STEPS)
            model, left = minimise(model, groups, left, tuple(held), TRIAL_STEPS)
        except (RelaxationError, np.linalg.LinAlgError):
            return np.inf, None
        cost = float(np.sum(np.log(left)))
        # where no sample is touched there is no derivative either, and nothing to begin at
        idle = bool(without) and all(np.array_equal(a.U[:2], b.U[:2]) for a, b in zip(groups, without, strict=True))
        whole = Model(structure, structure.vector({**values, **rest.named(model.values)}))
        return (cost if np.isfinite(cost) and not idle else np.inf), whole

    def promised(begin: Mapping[str, float]) -> float:
        """The cost that one step from there would reach if the response were linear in the parameters."""
        try:
            values = structure.vector({**known, **begin})
            with np.errstate(all="ignore"):
                here = _normal(structure, values, few, axis_weights(few, power), True)
        except (RelaxationError, np.linalg.LinAlgError):
            return np.inf
        loose = np.array([name not in held for name in structure.names])
        cost = float(np.sum(np.log(here.power)) - here.gradient @ _step(here, loose))
        return cost if np.isfinite(cost) else np.inf

    jumps = jumping(structure, structure.vector({**known, **first}), stacks[0]) if front else []
    rough = [name for name in jumps if name in choices and min(choices[name]) > 0]
    ends = {name: (min(choices[name]), max(choices.pop(name))) for name in rough}
    if not choices and not rough:
        return minimise(Model(structure, structure.vector({**known, **first})), stacks, power, tuple(held))[0]
    best = tried(first)
    if math.prod(len(values) for values in choices.values()) <= LARGEST_SEARCH:
        for values in itertools.product(*choices.values()):
            begin = {**first, **dict(zip(choices, values, strict=True))}
            if begin != first:
                best = min(best, tried(begin), key=lambda one: one[0])
    else:  # too many together: one parameter after the other, the others where they were best, and round again
        for _ in range(SEARCH_ROUNDS):
            before = best[0]
            for name, values in choices.items():
                others = [{**first, name: value} for value in values if value != first[name]]
                for begin in others if front else sorted(others, key=promised)[:MOST_PROMISING]:
                    again = tried(begin)
                    if again[0] < best[0]:
                        best, first = again, begin
            if best[0] == before:
                break
    if best[1] is None:
        raise FitError(f"no start of {', '.join(structure.effects)} has a response that settles on these runs")
    found = best[1]
    for name in rough:
        found = cleft(found, name, ends[name], acted, tried)
    return minimise(found, stacks, power, [*held, *rough])[0]


def _beginnings(
    structure: Structure, known: Mapping[str, float]
) -> tuple[dict[str, float], dict[str, tuple[float, ...]]]:
    """Where the new parameters begin, and what to try for each whose cost may have several valleys."""
    first: dict[str, float] = {}
    choices: dict[str, tuple[float, ...]] = {}
    for effect in structure.composed:
        new = [parameter for parameter in effect.parameters if parameter.name not in known]
        if effect.start is not None and new:
            first.update(effect.start(known, dict(structure.constants)))
        for parameter in new:
            if parameter.name in first:
                continue
            first[parameter.name] = parameter.typical
            if parameter.grid:
                choices[parameter.name] = tuple(dict.fromkeys((*parameter.grid, parameter.typical)))
            elif parameter.null is not None and np.isfinite(parameter.null):
                # one valley that reaches to the null, where the parent stands
                first[parameter.name] += NEAR_NULL * (parameter.null - parameter.typical)
    return first, choices


def estimate(
    structure: Structure,
    spectra: Sequence[Spectrum],
    parent: Model | None = None,
    fixed: Mapping[str, float] | None = None,
) -> Estimate:
    """Fit a structure to the bins of all segments together.

    The criterion is the paper's least squares over the low-passed samples, each output weighed by its own residual
    power (repeated until that power has settled). A composition grows from `parent`, or from its bare base. `fixed`
    parameters are held. Raises FitError where the data do not determine the parameters.
    """
    held = dict(fixed or {})
    unknown = [name for name in held if name not in structure.names]
    if unknown:
        raise FitError(f"no parameter {', '.join(unknown)} to hold; there are {', '.join(structure.names)}")
    refuse_still_channels(structure, spectra)
    stacks = stack(spectra)
    causes = instruments(stacks, structure.commands)
    names = tuple(held)
    if parent is None and not held and fast.applies(structure, stacks):
        quick = fast.fit(structure, stacks[0])
        if quick is not None and np.all(quick.residual_power < POOR_SHARE * quick.measured_power):
            parent = Model(structure, quick.values)
            if causes is None:
                _refuse_vagueness(structure, quick.vagueness)
                return Estimate(
                    parent, quick.covariance, OutputError(quick.residuals, quick.measured_power, quick.residual_power)
                )
    if parent is None:
        bare = Structure(structure.base_) if structure.composed else structure
        parent = start(bare, [group.thinned(START_THINNING) for group in stacks])
    model = _hold(parent, held)
    if parent.structure == structure:
        model, _ = minimise(model, stacks, output_error(model, stacks).residual_power, names)
    else:
        model = grow(model, structure, stacks, held)
    bound = tuple(
        parameter.name
        for parameter, value in zip(structure.parameters, model.values, strict=True)
        if parameter.name not in held and not parameter.bounds[0] < value < parameter.bounds[1]
    )
    loose = [i for i, name in enumerate(structure.names) if name not in held and name not in bound]
    asking = None  # where least squares has the last word, in the estimate and in its errors
    if causes is not None and loose and not jumping(structure, model.values, stacks[0]):
        try:
            unbiased = _unbias(model, stacks, loose, causes)
        except RelaxationError:
            unbiased = None
        if unbiased is not None:
            model, asking = unbiased
    error = output_error(model, stacks)
    weights = axis_weights(stacks, error.residual_power)
    covariance = np.zeros((model.values.size, model.values.size))
    covariance[np.ix_(loose, loose)] = _covariance(model, stacks, weights, loose, asking)
    found = Estimate(model, covariance, error, bound, asking is not None)
    _refuse_vague_axes(found)
    return found


def _unbias(
    model: Model, stacks: Sequence[Stack], loose: Sequence[int], causes: Sequence[ComplexArray]
) -> tuple[Model, list[ComplexArray]] | None:
    """From the least-squares optimum to where the residual has nothing left that the excitation caused.

    A few Newton steps; None where they do not settle, or leave the bounds or the optimum far behind: the data have no
    good instrument and the least-squares estimate stays. With the model comes what the residual was asked with: for
    every stack the sensitivities (loose, k, bins) at the optimum to what the excitation caused.
    """
    structure, values = model.structure, model.values.copy()
    low = np.array([parameter.bounds[0] for parameter in structure.parameters])
    high = np.array([parameter.bounds[1] for parameter in structure.parameters])
    error = output_error(model, stacks)
    weights = axis_weights(stacks, error.residual_power)
    asking = [
        _to_parameters(respond(structure, values, group, True, U))[list(loose)]
        for group, U in zip(stacks, causes, strict=True)
    ]
    # when a servo turns back or lags depends on every gust: to its own parameters the caused part says too little
    own = {name for effect in divided(structure)[0] for name in effect.names}
    at = [row for row, i in enumerate(loose) if structure.names[i] in own]
    if at:
        for group, asked in zip(stacks, asking, strict=True):
            asked[at] = _to_parameters(respond(structure, values, group, True))[[loose[row] for row in at]]
    for _ in range(UNBIASING_STEPS):
        curvature, gradient, _ = _linearised(Model(structure, values), stacks, weights, loose, asking)
        size = np.sqrt(np.abs(np.diag(curvature)))
        if not np.all(np.isfinite(size)) or np.any(size == 0):
            return None
        scaled = curvature / np.outer(size, size)
        if np.linalg.cond(scaled) > 1e10:
            return None
        move = np.linalg.solve(scaled, gradient / size) / size
        values[list(loose)] += move
        if not np.all(np.isfinite(values)) or np.any(values < low) or np.any(values > high):
            return None
        if np.max(np.abs(move) * size) < 1e-3 * np.sqrt(len(stacks) * stacks[0].z.size):
            break
    found = Model(structure, values)
    if divided(structure)[0]:  # a limit may be out of reach now
        curvature, _, _ = _linearised(found, stacks, weights, loose, asking)
        if np.any(np.diag(curvature) == 0):
            return None
    after = output_error(found, stacks).residual_power
    return (found, asking) if np.all(after < WORST_UNBIASING * error.residual_power) else None


def _to_parameters(response: Response) -> ComplexArray:
    """Sensitivities to the parameters, (parameters, k, bins)."""
    assert response.J is not None
    if response.to is None:
        return response.J
    J = response.J
    return np.asarray((response.to @ J.reshape(J.shape[0], -1).view(float)).view(complex).reshape(-1, *J.shape[1:]))


def _linearised(
    model: Model,
    stacks: Sequence[Stack],
    weights: Sequence[FloatArray],
    loose: Sequence[int],
    asking: Sequence[ComplexArray] | None,
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Z J^T, Z r and the variance of Z r under coloured residuals; Z is `asking`, unweighted, or else J.

    The residual spectrum is smoothed over about 1 Hz; residuals of the two outputs may be correlated.
    """
    count = len(loose)
    curvature, gradient, variance = np.zeros((count, count)), np.zeros(count), np.zeros((count, count))
    for number, (group, weight) in enumerate(zip(stacks, weights, strict=True)):
        response = respond(model.structure, model.values, group, True)
        parts = [(weight * (group.Y - response.Y))[None], weight * _to_parameters(response)[list(loose)]]
        if asking is not None:
            parts.append(weight * asking[number])
        together, E = np.concatenate(parts), weight * response.E
        for part in group.slices:
            block = _project(rows(E[..., part]), rows(together[..., part]))
            J, Z = block[1 : 1 + count], block[-count:]
            curvature += Z @ J.T
            gradient += Z @ block[0]
            bins = block.view(complex).reshape(block.shape[0], weight.shape[0], -1)
            e = bins[0]
            cross = e[:, None, :] * e[None, :, :].conj()
            S = smooth(cross.reshape(-1, cross.shape[-1]).T, group.frequency_hz[part]).T.reshape(cross.shape)
            variance += 0.5 * (Z @ rows(np.einsum("klf,blf->bkf", S, bins[-count:])).T)
    return curvature, gradient, variance


def _hold(model: Model, held: Mapping[str, float]) -> Model:
    named = dict(zip(model.structure.names, model.values, strict=True))
    named.update({name: value for name, value in held.items() if name in named})
    return Model(model.structure, model.structure.vector(named))


def held_stable(free: Model, stacks: Sequence[Stack]) -> tuple[Model, OutputError]:
    """The best stable model found by pushing an unstable one's poles across the axis; for judging the free fit.

    A penalty on the poles' real parts grows until they have crossed; the outputs count by their measured power.
    """
    from scipy.optimize import least_squares

    structure = free.structure
    weights = axis_weights(stacks, output_error(free, stacks).measured_power)
    best: tuple[float, Model] | None = None
    begins = [free.values]
    if not structure.composed:
        begins.append(np.array(structure.base_.uncoupled))
    for begin in begins:
        values = begin
        scale = np.maximum(np.abs(begin), 1.0)
        for push in STABILITY_PUSHES:

            def residuals(x: FloatArray, push: float = push) -> FloatArray:
                real = np.linalg.eigvals(structure.matrices(x).A).real
                parts = [push * np.maximum(real + STABILITY_MARGIN, 0)]
                for group, weight in zip(stacks, weights, strict=True):
                    response = respond(structure, x, group, False)
                    e, E = weight * (group.Y - response.Y), weight * response.E
                    parts += [_project(rows(E[..., part]), rows(e[None, :, part]))[0] for part in group.slices]
                return np.concatenate(parts)

            values = least_squares(residuals, values, x_scale=scale, max_nfev=40).x
        model = Model(structure, values)
        if model.stable:
            error = output_error(model, stacks)
            cost = float(np.sum(error.residual_power / error.measured_power))
            if best is None or cost < best[0]:
                best = (cost, model)
    if best is None:
        raise FitError("no stable model was found near the data")
    return best[1], output_error(best[1], stacks)


def _covariance(
    model: Model,
    stacks: Sequence[Stack],
    weights: Sequence[FloatArray],
    loose: Sequence[int],
    asking: Sequence[ComplexArray] | None,
) -> FloatArray:
    """Covariance of the estimate when residuals are coloured and cross-correlated: H^-1 V H^-T.

    Treating the residuals as white makes the bounds too small.
    """
    if not loose:
        return np.zeros((0, 0))
    curvature, _, variance = _linearised(model, stacks, weights, loose, asking)
    size = np.sqrt(np.abs(np.diag(curvature)))
    if not np.all(np.isfinite(size)) or np.any(size == 0):
        still = ", ".join(model.structure.names[i] for i, x in zip(loose, size, strict=True) if not x > 0)
        raise FitError(f"the data do not determine the model: {still} does not show in the response on these runs")
    correlation = curvature / np.outer(size, size)
    if np.linalg.cond(correlation) > 1e12:
        raise FitError(alike(model.structure, model.values, loose, 0.5 * (correlation + correlation.T), size))
    inverse = np.linalg.inv(correlation) / np.outer(size, size)
    return np.asarray(inverse @ variance @ inverse.T)


def smooth(values: AnyArray, frequency_hz: FloatArray, width_hz: float = SMOOTHING_HZ) -> AnyArray:
    """Moving average over frequency of (bins, columns), reflected at the ends."""
    from scipy.ndimage import uniform_filter1d

    step = float(frequency_hz[1] - frequency_hz[0]) if frequency_hz.size > 1 else width_hz
    bins = max(5, int(width_hz / step) | 1)
    real = uniform_filter1d(values.real, bins, axis=0, mode="reflect")
    if not np.iscomplexobj(values):
        return np.asarray(real)
    return np.asarray(real + 1j * uniform_filter1d(values.imag, bins, axis=0, mode="reflect"))


AXIS_OF = {
    "delta_x": "roll",
    "delta_y": "pitch",
    "delta_e": "elevator",
    "p": "roll",
    "q": "pitch",
}


def refuse_still_channels(structure: Structure, spectra: Sequence[Spectrum]) -> None:
    """Say which axis has no excitation, or none of its own, before any number is made of it."""
    if not spectra:
        raise FitError("no run has 2 s of gap-free samples: nothing to fit")
    bins = sum(one.frequency_hz.size for one in spectra)
    count = len(structure.parameters)
    if bins < 2 * count:
        raise FitError(f"only {bins} frequencies in the band: too little data for {count} parameters")
    m = len(structure.commands)
    energy = sum(2 / one.samples * np.einsum("ij,ij->i", one.U[:m].conj(), one.U[:m]).real for one in spectra)
    rms_of_commands = np.sqrt(energy / sum(one.samples for one in spectra))
    for name, rms in zip(structure.commands, rms_of_commands, strict=True):
        axis = AXIS_OF.get(name, name)
        if rms < LEAST_COMMAND:
            raise FitError(
                f"{axis} axis not identifiable: {name} hardly moves ({rms:.1e} rms of full command); "
                f"fly a {axis} chirp and add its run"
            )
    for row, name in enumerate(structure.outputs):
        if not any(np.any(one.Y[row]) for one in spectra):
            raise FitError(
                f"{AXIS_OF[name]} axis not identifiable: {name} does not move at all; check the gyro's channel"
            )
    own = independent_share(spectra, m)
    for name, share in zip(structure.commands, own, strict=True):
        axis = AXIS_OF.get(name, name)
        if share < LEAST_INDEPENDENT_SHARE:
            raise FitError(
                f"{axis} axis not identifiable: {name} only follows the other command "
                f"({100 * share:.2g} % of its power is its own); fit it together with a {axis} chirp"
            )


def independent_share(spectra: Sequence[Spectrum], commands: int = 2) -> FloatArray:
    """Share of each command's power, (m,), that the other commands do not explain linearly, pooled over all runs.

    With one noise-free sweep and a controller on, the other axis's command follows the swept one and this is near 0.
    """
    bands = int(max(one.frequency_hz[-1] for one in spectra) / SHARE_BAND_HZ) + 1
    cross = np.zeros((commands, commands, bands), dtype=complex)
    for one in spectra:
        U = one.U[:commands] / np.sqrt(one.samples)
        band = (one.frequency_hz / SHARE_BAND_HZ).astype(int)
        starts = np.concatenate([[0], np.flatnonzero(np.diff(band)) + 1])
        cross[..., band[starts]] += np.add.reduceat(U[:, None] * U.conj(), starts, axis=2)
    power = np.einsum("jjb->jb", cross).real
    size = np.sqrt(np.where(power > 0, power, 1.0))
    unit = (cross / (size[:, None] * size)).transpose(2, 0, 1) + LEAST_SHARE * np.eye(commands)
    own = power / np.einsum("bjj->jb", np.linalg.inv(unit)).real
    return np.asarray(np.sum(own, axis=1) / np.maximum(np.sum(power, axis=1), 1e-300))


def _refuse_vague_axes(found: Estimate) -> None:
    """An axis whose control effectiveness is not known to a quarter of itself is not identified."""
    structure = found.model.structure
    for column, name in enumerate(structure.commands):
        if name not in ("delta_x", "delta_y") and "elevator" not in structure.effects:
            continue  # an effect of its own says how well it is known
        values, slopes = _effectiveness(structure, found.model.values, column)
        spread = np.sqrt(np.maximum(np.einsum("ip,pq,iq->i", slopes, found.covariance, slopes), 0))
        known = np.abs(values) > 0
        best = np.min(spread[known] / np.abs(values[known])) if np.any(known) else np.inf
        _refuse_vagueness(structure, np.array([best]), column)


def _refuse_vagueness(structure: Structure, vagueness: FloatArray, first: int = 0) -> None:
    """Raises FitError for the first command whose effect has too large a relative standard error."""
    for name, relative in zip(structure.commands[first:], vagueness, strict=False):
        if not relative < LARGEST_RELATIVE_ERROR:
            axis = AXIS_OF.get(name, name)
            raise FitError(
                f"{axis} axis not identifiable: the effect of {name} is known only to "
                f"{100 * relative:.0f} % of itself; fly a {axis} chirp, longer or with more amplitude"
            )


def _effectiveness(structure: Structure, values: FloatArray, column: int) -> tuple[FloatArray, FloatArray]:
    """What one command does to the base's states: entries (states,) and their slopes (states, parameters).

    Servo states stand between command and base, so the response at 1 Hz is taken instead of B where there are any.
    """
    from sysid.model.structure import stepped

    matrices = structure.matrices(stepped(values))
    s = 2j * np.pi
    n = matrices.A.shape[-1]

    def reach(A: AnyArray, B: AnyArray) -> AnyArray:
        return np.linalg.solve(s * np.eye(n) - A, B[..., column : column + 1])[..., 0]

    A0, B0 = matrices.A[0].real, matrices.B[0].real
    base = reach(A0, B0)
    R = np.linalg.inv(s * np.eye(n) - A0)
    dA, dB = matrices.A.imag / 1e-30, matrices.B.imag / 1e-30
    slopes = (R @ (dA @ base[:, None] + dB[..., column : column + 1]))[..., 0]
    k = 2
    return np.abs(base[:k]), np.real(slopes[:, :k] * base[:k].conj() / np.maximum(np.abs(base[:k]), 1e-300)).T
