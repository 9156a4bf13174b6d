"""Output-error fits in the Fourier domain: bare bases without start values, compositions from their parents.

The measured samples enter once, as Fourier bins up to 15 Hz. Each segment's difference between first and last state is
an extra linear unknown, projected out, so that the bins are exact for records that are not periodic. Where the
excitation was logged it serves as instrument, so that feedback does not bias the values."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Literal

import numpy as np

from sysid.data.dataset import Bins
from sysid.data.instrument import Causes
from sysid.data.preprocess import ComplexArray, excitation_of
from sysid.data.stacks import Stack
from sysid.errors import FitError, NotShownError
from sysid.fit.axes import VagueAxis, refuse_still_channels, vague_axis
from sysid.fit.gauss_newton import SETTLED, minimise, normal_equations
from sysid.fit.grow import grow, looks
from sysid.fit.identifiable import alike
from sysid.fit.noise import divide
from sysid.fit.output_error import OutputError, axis_weights, output_error
from sysid.fit.rows import project, rows, smoothed_spectrum
from sysid.fit.start import POOR_SHARE, START_THINNING, start
from sysid.fit.weights import inflation, spectral_weights
from sysid.fit.whitening import weighed
from sysid.model.acting import divided, jumping, linear_dynamics
from sysid.model.predict import respond
from sysid.model.relaxation import RelaxationError
from sysid.model.structure import AnyArray, FloatArray, Model, Structure

REWEIGHTINGS = 5
"""Times that the residual's own spectrum weighs, at most;"""
ROUGH = 1e-5
"""and where each of them ends, in weighted power."""
MOST_LEFT = 2 * POOR_SHARE
"""Of the measured power, behind a fit that its own residual's spectrum weighed."""
UNBIASING_STEPS = 8
WORST_UNBIASING = 1.1  # of the residual power at the least-squares optimum
SHORT = 0.3  # standard errors of white noise: the next step is far shorter
WORST_OF_ONE_AXIS = 4.0
WORTH_A_LOOK = 1.0
"""Standard deviations beyond chance that the excitation explains of what a fit leaves, to look into other valleys;"""
DEEPER = 10.0
"""chi squared, by which one of these must leave less."""
LEFT_OPEN = 0.5
"""Of what the excitation explains of what least squares leaves, beyond noise,"""
PLAINLY = 6.0
"""where that is so many standard deviations of chance."""


Weights = Literal["residual spectrum", "constant"]
Instrument = Literal["excitation logged", "excitation rebuilt", "prediction error", "commands"]
"""What keeps feedback out of the values: the excitation, or the noise predicted from its past; nothing does where the
commands stand for themselves."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Estimate:
    """The best values, and how far the data bind them."""

    model: Model
    covariance: FloatArray
    """(parameters, parameters), honest under coloured residuals; zero for held parameters."""
    error: OutputError
    at_bound: tuple[str, ...] = field(default=())
    instrument: Instrument = "commands"
    weights: Weights = "constant"
    """What of the residual weighed: its spectrum, or each output's power alone."""

    @property
    def instrumented(self) -> bool:
        """The excitation served as instrument, so that feedback does not bias the values."""
        return self.instrument in ("excitation logged", "excitation rebuilt")

    @cached_property
    def vague(self) -> VagueAxis | None:
        """An axis whose control effectiveness is known only vaguely."""
        return vague_axis(self.model, self.covariance)


def estimate(
    structure: Structure,
    bins: Bins,
    parent: Model | None = None,
    fixed: Mapping[str, float] | None = None,
    weights: Weights = "residual spectrum",
) -> Estimate:
    """Fit a structure to the bins of all segments together.

    It begins with the paper's least squares over the low-passed samples, each output weighed by its own residual power
    (repeated until that power has settled). From there what is left is weighed by its `weights`, the spectrum of its
    noise. A composition grows from `parent`, or from its bare base. `fixed` parameters are held. Raises FitError where
    the data do not determine the parameters.
    """
    found = best_values(structure, bins, parent, fixed, weights)
    refuse_vague(found, bins)
    return found


def best_values(
    structure: Structure,
    bins: Bins,
    parent: Model | None = None,
    fixed: Mapping[str, float] | None = None,
    weights: Weights = "residual spectrum",
) -> Estimate:
    """As `estimate`, also where what commands do is known only vaguely: what the model lacks may make it so.

    Without a parent it is fitted once more from the base's stable point where the data do not determine it: in a loop,
    or in strong gusts, least squares may run away to where commands follow from rates, whatever the vehicle does.
    """
    fixed = dict(fixed or {})
    unknown = [name for name in fixed if name not in structure.names]
    if unknown:
        raise FitError(f"no parameter {', '.join(unknown)} to hold; there are {', '.join(structure.names)}")
    refuse_still_channels(structure, bins.spectra)
    if parent is not None:
        return _grown(structure, bins, parent, fixed, weights)
    begin = start(structure.bare, [group.thinned(START_THINNING) for group in bins.stacks])
    try:
        return _grown(structure, bins, begin, fixed, weights)
    except FitError:
        stable = Model(structure.bare, np.array(structure.base_.uncoupled, dtype=float))
        with suppress(FitError, RelaxationError, np.linalg.LinAlgError):  # what was wrong first is told
            again = _grown(structure, bins, stable, fixed, weights)
            if again.vague is None:
                return again
        raise


def _grown(structure: Structure, bins: Bins, parent: Model, fixed: Mapping[str, float], weights: Weights) -> Estimate:
    parent = _hold(parent, fixed)
    found = _weighed(_least_squares(structure, bins.stacks, parent, fixed), bins, fixed, weights)
    return _deeper(found, parent, bins, fixed)


def refuse_vague(found: Estimate, bins: Bins) -> None:
    """Raises FitError where an axis is known only vaguely, and nothing shows that it is the model which lacks."""
    if found.vague is not None and not lacks(found, bins):
        raise FitError(found.vague.refusal)


def lacks(found: Estimate, bins: Bins) -> bool:
    """Whether a logged excitation plainly explains something of what the fit leaves, that of a vaguely known axis among
    it: the model lacks an effect, and not the runs a maneuver."""
    if bins.instruments(found.model.structure.commands) is None:
        return False
    if found.vague is not None and not _excited(found.vague.command, bins.stacks):
        return False
    left = divide(found.error, bins.stacks, bins.causes(found.model.structure.commands))
    return left.chi_squared > left.degrees + PLAINLY * math.sqrt(2 * left.degrees)


def _least_squares(structure: Structure, stacks: Sequence[Stack], parent: Model, fixed: Mapping[str, float]) -> Model:
    """The optimum, from the parent."""
    if parent.structure != structure:
        return grow(parent, structure, stacks, fixed)
    return minimise(parent, stacks, output_error(parent, stacks).residual_power, tuple(fixed))[0]


def _weighed(model: Model, bins: Bins, fixed: Mapping[str, float], kind: Weights) -> Estimate:
    """From the least-squares optimum to that of these weights, freed of the bias of feedback where the excitation was
    logged, with its covariance."""
    structure, stacks = model.structure, bins.stacks
    error = output_error(model, stacks)
    weights: Sequence[AnyArray] = axis_weights(stacks, error.residual_power)
    if jumping(structure, model.values, stacks[0]):  # a jump has no slope to follow: least squares has the last word
        return _with_errors(model, stacks, weights, fixed)
    caused, Z = bins.instruments(structure.commands), None
    if kind == "residual spectrum" and caused is not None:
        weights = spectral_weights(error, stacks, bins.causes(structure.commands))
    if kind == "residual spectrum" and caused is None:
        reweighed = _reweighed(model, stacks, error, fixed)
        if reweighed is None:
            kind = "constant"
        else:
            model, weights = reweighed
    if caused is not None:
        try:
            unbiased = _unbias(model, stacks, weights, free_of(model, fixed), caused, bins.causes(structure.commands))
        except RelaxationError:
            unbiased = None
        if unbiased is not None:
            model, Z = unbiased
        elif kind == "residual spectrum":
            model = minimise(model, stacks, error.residual_power, tuple(fixed), spectral=weights)[0]
    found = _with_errors(model, stacks, weights, fixed, Z)
    if kind == "constant":
        return found
    wider = inflation(stacks, len(structure.outputs), caused is not None)
    return replace(found, covariance=wider * found.covariance, weights=kind)


def _deeper(found: Estimate, parent: Model, bins: Bins, fixed: Mapping[str, float]) -> Estimate:
    """The estimate, or one in another valley of what the parent has not, looked for by the noise's weights, that leaves
    less: of what the excitation explains, where that was logged, else by these weights.

    All power is mostly that of gusts, and does not show a narrow mode beside them.
    """
    structure, stacks, kind = found.model.structure, bins.stacks, found.weights
    if kind == "constant" or divided(structure)[0] or not linear_dynamics(structure):
        return found
    if not looks(structure, parent.by_name):
        return found
    causes = None if bins.instruments(structure.commands) is None else bins.causes(structure.commands)
    first = None if causes is None else divide(found.error, stacks, causes)
    if first is not None and first.chi_squared < first.degrees + WORTH_A_LOOK * math.sqrt(2 * first.degrees):
        return found
    weights = weights_at(found.model, bins, kind)
    try:
        other = _weighed(grow(parent, structure, stacks, fixed, weights), bins, fixed, kind)
    except (FitError, RelaxationError, np.linalg.LinAlgError):
        return found  # which stands by itself

    def left(one: Estimate) -> float:
        if causes is not None:
            return divide(one.error, stacks, causes).chi_squared
        rows = 2 * sum(group.Y.size for group in stacks)  # weights make the power of all of them about one
        return rows * normal_equations(structure, one.model.values, stacks, weights, False).cost

    here = left(found) if first is None else first.chi_squared
    return other if here - left(other) > DEEPER else found


def weights_at(model: Model, bins: Bins, kind: Weights) -> Sequence[AnyArray]:
    """What weighs the residual of a fit that ended at this model, for every stack."""
    error, commands = output_error(model, bins.stacks), model.structure.commands
    if kind == "constant":
        return axis_weights(bins.stacks, error.residual_power)
    return spectral_weights(error, bins.stacks, None if bins.instruments(commands) is None else bins.causes(commands))


def _reweighed(
    model: Model, stacks: Sequence[Stack], error: OutputError, fixed: Mapping[str, float]
) -> tuple[Model, list[ComplexArray]] | None:
    """To where the spectrum of what a fit leaves weighs it.

    None where it leaves much: that is the model's error then, and to excuse it would make it larger.
    """
    if np.any(error.residual_power > POOR_SHARE * error.measured_power):
        return None
    weights = spectral_weights(error, stacks, None)
    for _ in range(REWEIGHTINGS):
        before = error.residual_power
        model = minimise(model, stacks, before, tuple(fixed), tolerance=ROUGH, spectral=weights)[0]
        error = output_error(model, stacks)
        if np.allclose(before, error.residual_power, rtol=SETTLED):
            break
        weights = spectral_weights(error, stacks, None)
    return None if np.any(error.residual_power > MOST_LEFT * error.measured_power) else (model, weights)


def free_of(model: Model, fixed: Collection[str]) -> list[int]:
    """Numbers of the parameters that are neither held nor at a bound."""
    return [
        i
        for i, (parameter, value) in enumerate(zip(model.structure.parameters, model.values, strict=True))
        if parameter.name not in fixed and parameter.bounds[0] < value < parameter.bounds[1]
    ]


def _with_errors(
    model: Model,
    stacks: Sequence[Stack],
    weights: Sequence[AnyArray],
    fixed: Mapping[str, float],
    Z: Sequence[ComplexArray] | None = None,
) -> Estimate:
    """The estimate with its covariance; Z are the instruments, if any."""
    free = free_of(model, fixed)
    bound = tuple(name for i, name in enumerate(model.structure.names) if name not in fixed and i not in free)
    covariance = np.zeros((model.values.size, model.values.size))
    covariance[np.ix_(free, free)] = _covariance(model, stacks, weights, free, Z)
    return Estimate(
        model=model,
        covariance=covariance,
        error=output_error(model, stacks),
        at_bound=bound,
        instrument="commands" if Z is None else _kind_of(stacks),
    )


def _kind_of(stacks: Sequence[Stack]) -> Instrument:
    rebuilt = any(one.segment.record.excitation_from for group in stacks for one in group.spectra)
    return "excitation rebuilt" if rebuilt else "excitation logged"


def _unbias(
    model: Model,
    stacks: Sequence[Stack],
    weights: Sequence[AnyArray],
    free: Sequence[int],
    caused: Sequence[ComplexArray],
    causes: Causes,
) -> tuple[Model, list[ComplexArray]] | None:
    """From the least-squares optimum to where the residual has nothing left that the excitation caused.

    A few Newton steps; None where they do not settle, or leave the bounds, or leave the optimum far behind without that
    the excitation explains much less of what is left: the data have no good instrument and the least-squares estimate
    stays. With the model come the instruments.
    """
    structure, values = model.structure, model.values.copy()
    if not free:
        return None
    Z = asked_with(model, stacks, free, caused)
    for _ in range(UNBIASING_STEPS):
        curvature, gradient, _ = _linearised(Model(structure, values), stacks, weights, free, Z, spread=False)
        size = np.sqrt(np.abs(np.diag(curvature)))
        move = _newton_move(curvature, gradient, size)
        if move is None:
            return None
        values[list(free)] += move
        if not in_bounds(structure, values):
            return None
        if np.max(np.abs(move) * size) < SHORT / np.sqrt(2 * sum(group.Y.size for group in stacks)):
            break
    found = Model(structure, values)
    if divided(structure)[0]:  # a limit may be out of reach now
        curvature, _, _ = _linearised(found, stacks, weights, free, Z, spread=False)
        if np.any(np.diag(curvature) == 0):
            return None
    before, after = (normal_equations(structure, x, stacks, weights, False).power for x in (model.values, values))
    near = np.all(after < _worst_unbiasing(structure, stacks) * before)
    return (found, Z) if near or _asks_less(found, model, stacks, causes) else None


def _asks_less(found: Model, least_squares: Model, stacks: Sequence[Stack], causes: Causes) -> bool:
    """Whether the excitation explains much less of what a model leaves than of what least squares does.

    In a loop least squares may take most of slow gusts for answers of the vehicle: then the truth leaves far more.
    """
    before, after = (divide(output_error(one, stacks), stacks, causes) for one in (least_squares, found))
    excess = [one.chi_squared - one.degrees for one in (before, after)]
    return excess[0] > PLAINLY * math.sqrt(2 * before.degrees) and excess[1] < LEFT_OPEN * excess[0]


def _worst_unbiasing(structure: Structure, stacks: Sequence[Stack]) -> float:
    """More where a command has no excitation: there least squares takes feedback for answers, and gusts with it."""
    excited = all(_excited(name, stacks) for name in structure.commands)
    return WORST_UNBIASING if excited else WORST_OF_ONE_AXIS


def _excited(command: str, stacks: Sequence[Stack]) -> bool:
    """Whether an excitation of this command is logged, and moves."""
    runs = (one.segment.channels for group in stacks for one in group.spectra)
    return any(np.any(one[excitation_of(command)]) for one in runs if excitation_of(command) in one)


def asked_with(
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


def in_bounds(structure: Structure, values: FloatArray) -> bool:
    """Whether values (parameters,) are finite, and between their bounds."""
    low, high = structure.bounds
    return bool(np.all(np.isfinite(values)) and np.all(values >= low) and np.all(values <= high))


def _linearised(
    model: Model,
    stacks: Sequence[Stack],
    weights: Sequence[AnyArray],
    free: Sequence[int],
    asked_with: Sequence[ComplexArray] | None,
    spread: bool = True,
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Z J^T, Z r and the variance of Z r under coloured residuals, zero unless its `spread` is asked; Z is
    `asked_with`, unweighted, or else J.

    The residual spectrum is smoothed over about 1 Hz; residuals of the two outputs may be correlated.
    """
    count = len(free)
    curvature, gradient, variance = np.zeros((count, count)), np.zeros(count), np.zeros((count, count))
    for number, (group, weight) in enumerate(zip(stacks, weights, strict=True)):
        response = respond(model.structure, model.values, group, True)
        parts = [(group.Y - response.Y)[None], response.slopes[list(free)]]
        if asked_with is not None:
            parts.append(asked_with[number])
        together, E = weighed(weight, np.concatenate(parts)), weighed(weight, response.E)
        for part in group.slices:
            block = project(rows(E[..., part]), rows(together[..., part]))
            J, Z = block[1 : 1 + count], block[-count:]
            curvature += Z @ J.T
            gradient += Z @ block[0]
            if not spread:
                continue
            bins = block.view(complex).reshape(block.shape[0], len(group.Y), -1)
            e = bins[0]
            S = smoothed_spectrum(e, group.frequency_hz[part])
            variance += 0.5 * (Z @ rows(weighed(S, bins[-count:])).T)
    return curvature, gradient, variance


def _hold(model: Model, held: Mapping[str, float]) -> Model:
    return Model(model.structure, model.structure.vector({**model.by_name, **held}))


def _covariance(
    model: Model,
    stacks: Sequence[Stack],
    weights: Sequence[AnyArray],
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
        raise NotShownError(tuple(model.structure.names[i] for i, x in zip(free, size, strict=True) if not x > 0))
    correlation = curvature / np.outer(size, size)
    if np.linalg.cond(correlation) > 1e12:
        raise FitError(alike(model.structure, model.values, free, 0.5 * (correlation + correlation.T), size))
    inverse = np.linalg.inv(correlation) / np.outer(size, size)
    return np.asarray(inverse @ variance @ inverse.T)
