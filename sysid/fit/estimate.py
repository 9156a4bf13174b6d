"""Output-error fits in the Fourier domain: bare bases without start values, compositions from their parents.

The measured samples enter once, as Fourier bins up to 15 Hz. Each segment's difference between first and last state is
an extra linear unknown, projected out, so that the bins are exact for records that are not periodic. Where the
excitation was logged it serves as instrument, so that feedback does not bias the values."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from sysid.data.dataset import Bins
from sysid.data.preprocess import ComplexArray, excitation_of
from sysid.data.stacks import Stack
from sysid.errors import FitError
from sysid.fit.axes import refuse_still_channels, refuse_vague_axes
from sysid.fit.gauss_newton import minimise
from sysid.fit.grow import grow
from sysid.fit.identifiable import alike
from sysid.fit.output_error import OutputError, axis_weights, output_error
from sysid.fit.rows import project, rows, smooth
from sysid.fit.start import START_THINNING, start
from sysid.model.acting import divided, jumping
from sysid.model.predict import respond
from sysid.model.relaxation import RelaxationError
from sysid.model.structure import FloatArray, Model, Structure

UNBIASING_STEPS = 8
WORST_UNBIASING = 1.1  # of the residual power at the least-squares optimum
WORST_OF_ONE_AXIS = 4.0


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


def estimate(
    structure: Structure,
    bins: Bins,
    parent: Model | None = None,
    fixed: Mapping[str, float] | None = None,
) -> Estimate:
    """Fit a structure to the bins of all segments together.

    The criterion is the paper's least squares over the low-passed samples, each output weighed by its own residual
    power (repeated until that power has settled). A composition grows from `parent`, or from its bare base. `fixed`
    parameters are held. Raises FitError where the data do not determine the parameters.
    """
    fixed = dict(fixed or {})
    unknown = [name for name in fixed if name not in structure.names]
    if unknown:
        raise FitError(f"no parameter {', '.join(unknown)} to hold; there are {', '.join(structure.names)}")
    refuse_still_channels(structure, bins.spectra)
    model = _least_squares(structure, bins.stacks, parent, fixed)
    found = _with_errors(model, bins.stacks, fixed, bins.instruments(structure.commands))
    refuse_vague_axes(found.model, found.covariance)
    return found


def _least_squares(
    structure: Structure, stacks: Sequence[Stack], parent: Model | None, fixed: Mapping[str, float]
) -> Model:
    """The optimum, from the parent or from the data alone."""
    if parent is None:
        parent = start(structure.bare, [group.thinned(START_THINNING) for group in stacks])
    model = _hold(parent, fixed)
    if parent.structure != structure:
        return grow(model, structure, stacks, fixed)
    return minimise(model, stacks, output_error(model, stacks).residual_power, tuple(fixed))[0]


def _with_errors(
    model: Model, stacks: Sequence[Stack], fixed: Mapping[str, float], causes: Sequence[ComplexArray] | None
) -> Estimate:
    """The optimum freed of the bias of feedback where the excitation was logged, with its covariance."""
    structure = model.structure
    bound = tuple(
        parameter.name
        for parameter, value in zip(structure.parameters, model.values, strict=True)
        if parameter.name not in fixed and not parameter.bounds[0] < value < parameter.bounds[1]
    )
    free = [i for i, name in enumerate(structure.names) if name not in fixed and name not in bound]
    Z = None  # where least squares has the last word, in the estimate and in its errors
    if causes is not None and free and not jumping(structure, model.values, stacks[0]):
        try:
            unbiased = _unbias(model, stacks, free, causes)
        except RelaxationError:
            unbiased = None
        if unbiased is not None:
            model, Z = unbiased
    error = output_error(model, stacks)
    weights = axis_weights(stacks, error.residual_power)
    covariance = np.zeros((model.values.size, model.values.size))
    covariance[np.ix_(free, free)] = _covariance(model, stacks, weights, free, Z)
    return Estimate(model, covariance, error, bound, Z is not None)


def _unbias(
    model: Model, stacks: Sequence[Stack], free: Sequence[int], causes: Sequence[ComplexArray]
) -> tuple[Model, list[ComplexArray]] | None:
    """From the least-squares optimum to where the residual has nothing left that the excitation caused.

    A few Newton steps; None where they do not settle, or leave the bounds or the optimum far behind: the data have no
    good instrument and the least-squares estimate stays. With the model come the instruments.
    """
    structure, values = model.structure, model.values.copy()
    error = output_error(model, stacks)
    weights = axis_weights(stacks, error.residual_power)
    Z = _instruments(model, stacks, free, causes)
    for _ in range(UNBIASING_STEPS):
        curvature, gradient, _ = _linearised(Model(structure, values), stacks, weights, free, Z)
        size = np.sqrt(np.abs(np.diag(curvature)))
        move = _newton_move(curvature, gradient, size)
        if move is None:
            return None
        values[list(free)] += move
        if not _in_bounds(structure, values):
            return None
        if np.max(np.abs(move) * size) < 1e-3 * np.sqrt(len(stacks) * stacks[0].z.size):
            break
    found = Model(structure, values)
    if divided(structure)[0]:  # a limit may be out of reach now
        curvature, _, _ = _linearised(found, stacks, weights, free, Z)
        if np.any(np.diag(curvature) == 0):
            return None
    after = output_error(found, stacks).residual_power
    return (found, Z) if np.all(after < _worst_unbiasing(structure, stacks) * error.residual_power) else None


def _worst_unbiasing(structure: Structure, stacks: Sequence[Stack]) -> float:
    """More where a command has no excitation: there least squares takes feedback for answers, and gusts with it."""
    runs = [one.segment.channels for group in stacks for one in group.spectra]
    excitations = [excitation_of(name) for name in structure.commands]
    excited = all(any(np.any(one[name]) for one in runs if name in one) for name in excitations)
    return WORST_UNBIASING if excited else WORST_OF_ONE_AXIS


def _instruments(
    model: Model, stacks: Sequence[Stack], free: Sequence[int], causes: Sequence[ComplexArray]
) -> list[ComplexArray]:
    """For every stack the sensitivities (free, k, bins) to what the excitation caused."""
    structure, values = model.structure, model.values
    Z = [respond(structure, values, group, True, U).slopes[list(free)] for group, U in zip(stacks, causes, strict=True)]
    # when a servo turns back or lags depends on every gust: to its own parameters the caused part says too little
    own = {name for effect in divided(structure)[0] for name in effect.names}
    rows_of_own = [row for row, i in enumerate(free) if structure.names[i] in own]
    if rows_of_own:
        for group, sensitivities in zip(stacks, Z, strict=True):
            flown = respond(structure, values, group, True).slopes
            sensitivities[rows_of_own] = flown[[free[row] for row in rows_of_own]]
    return Z


def _newton_move(curvature: FloatArray, gradient: FloatArray, size: FloatArray) -> FloatArray | None:
    """None where the curvature, of these sizes, determines none."""
    if not np.all(np.isfinite(size)) or np.any(size == 0):
        return None
    scaled = curvature / np.outer(size, size)
    if np.linalg.cond(scaled) > 1e10:
        return None
    return np.asarray(np.linalg.solve(scaled, gradient / size) / size)


def _in_bounds(structure: Structure, values: FloatArray) -> bool:
    low = np.array([parameter.bounds[0] for parameter in structure.parameters])
    high = np.array([parameter.bounds[1] for parameter in structure.parameters])
    return bool(np.all(np.isfinite(values)) and np.all(values >= low) and np.all(values <= high))


def _linearised(
    model: Model,
    stacks: Sequence[Stack],
    weights: Sequence[FloatArray],
    free: Sequence[int],
    asked_with: Sequence[ComplexArray] | None,
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Z J^T, Z r and the variance of Z r under coloured residuals; Z is `asked_with`, unweighted, or else J.

    The residual spectrum is smoothed over about 1 Hz; residuals of the two outputs may be correlated.
    """
    count = len(free)
    curvature, gradient, variance = np.zeros((count, count)), np.zeros(count), np.zeros((count, count))
    for number, (group, weight) in enumerate(zip(stacks, weights, strict=True)):
        response = respond(model.structure, model.values, group, True)
        parts = [(weight * (group.Y - response.Y))[None], weight * response.slopes[list(free)]]
        if asked_with is not None:
            parts.append(weight * asked_with[number])
        together, E = np.concatenate(parts), weight * response.E
        for part in group.slices:
            block = project(rows(E[..., part]), rows(together[..., part]))
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
    return Model(model.structure, model.structure.vector({**model.by_name, **held}))


def _covariance(
    model: Model,
    stacks: Sequence[Stack],
    weights: Sequence[FloatArray],
    free: Sequence[int],
    Z: Sequence[ComplexArray] | None,
) -> FloatArray:
    """Covariance of the estimate when residuals are coloured and cross-correlated: H^-1 V H^-T.

    Treating the residuals as white makes the bounds too small.
    """
    if not free:
        return np.zeros((0, 0))
    curvature, _, variance = _linearised(model, stacks, weights, free, Z)
    size = np.sqrt(np.abs(np.diag(curvature)))
    if not np.all(np.isfinite(size)) or np.any(size == 0):
        still = ", ".join(model.structure.names[i] for i, x in zip(free, size, strict=True) if not x > 0)
        raise FitError(f"the data do not determine the model: {still} does not show in the response on these runs")
    correlation = curvature / np.outer(size, size)
    if np.linalg.cond(correlation) > 1e12:
        raise FitError(alike(model.structure, model.values, free, 0.5 * (correlation + correlation.T), size))
    inverse = np.linalg.inv(correlation) / np.outer(size, size)
    return np.asarray(inverse @ variance @ inverse.T)
