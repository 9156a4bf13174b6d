"""Candidates: fits linearised on their runs, and two of them compared by how likely they make the data.

Gusts reach the commands through the feedback, and with them every residual. So sensitivities and predictions that a
residual is asked with are those to the commands as the logged excitation alone moved them (instruments); the residual
itself is that of the commands as flown. Where no excitation is logged, what is new in the residual is asked instead
(`sysid.fit.innovations`), on bins beyond the band: `Candidate.asked` and its `metric`.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from sysid.data.dataset import Dataset
from sysid.data.preprocess import ComplexArray
from sysid.errors import FitError
from sysid.fit.bursts import Envelope
from sysid.fit.estimate import Estimate, estimate
from sysid.fit.identifiable import structural
from sysid.fit.innovations import Innovations, innovations
from sysid.fit.noise import Division, divide, surprise
from sysid.fit.output_error import OutputError, output_error
from sysid.fit.whitening import Whitening, noise_whitening
from sysid.model.acting import jumping
from sysid.model.compose import compose
from sysid.model.predict import respond
from sysid.model.relaxation import RelaxationError
from sysid.model.structure import FloatArray, Model, Structure

WORST_SETTLING = 1.01
MOST_MOVES = 3
DAMPED = 1e-2
"""Of each parameter's own weight: what the runs hardly determine does not run away."""
MOST_MOVES_BY_NOISE = 8
PARTS = (1.0, 0.5, 0.25)
"""Of a step, tried one after the other."""
SHY = 0.9
"""Of the way to a bound, that a move may go."""
SURELY_BETTER = 4.0
"""Chi squared by which other values must foretell better than those of least squares to take their place."""
LITTLE_MOVED = 0.5
"""Chi squared: a move that gains less is the last."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Candidate:
    """A fit on the ground's runs, linearised: the parent, or what it becomes with effects added."""

    estimate: Estimate
    added: tuple[str, ...]
    """Effects beyond the parent's."""
    held: tuple[str, ...]
    free: tuple[str, ...]
    """Parameters that have a slope to follow: neither held, nor at a bound, nor a jump. The rows of J are theirs."""
    dataset: Dataset
    Y: list[ComplexArray]
    """Predicted from the commands as flown, for every stack (k, bins)."""
    Y_imposed: list[ComplexArray]
    """Predicted from the imposed commands."""
    J: list[ComplexArray]
    """Sensitivities of Y to the free parameters, for every stack (free, k, bins)."""
    J_imposed: list[ComplexArray]
    _asked_in: dict[Whitening, Candidate] = field(default_factory=dict, init=False)

    @property
    def model(self) -> Model:
        return self.estimate.model

    @cached_property
    def standard_errors(self) -> dict[str, float]:
        """Of each parameter; 0 of those held, or at a bound."""
        errors = np.sqrt(np.maximum(np.diag(self.estimate.covariance), 0))
        return dict(zip(self.model.structure.names, map(float, errors), strict=True))

    @cached_property
    def _divided(self) -> Division:
        return divide(self.estimate.error, self.dataset.stacks, self.dataset.causes)

    @cached_property
    def division(self) -> Division:
        """What it leaves, divided into what the commands explain and noise.

        Whether they explain any is asked in its metric, of what one step leaves there: where noise is weak, numbers by
        constant weights are off by more than it, and that is no error of the structure.
        """
        return replace(self._divided, asked=self._surprise)

    def _surprise(self) -> tuple[float, int]:
        """What the commands explain of it in its metric: chi squared, and its degrees of freedom."""
        new, commands, stepped = self.metric, self._divided.commands, self.stepped
        if isinstance(new, Innovations):
            return new.surprise(stepped.residual, stepped.J, commands)
        chi_squared, degrees = surprise(new.bins(stepped.residual), new.stacks, self.dataset.causes)
        return chi_squared, max(1, degrees - len(stepped.J))

    @cached_property
    def asked(self) -> Candidate:
        """The same fit on the bins that its metric is of."""
        if not self.dataset.in_a_loop:
            return self
        return candidate(self.estimate, self.held, self.dataset.wider, self.added)

    def asked_in(self, metric: Whitening) -> Candidate:
        """`asked`, where innovations are asked moved to where it predicts best: feedback biases what commands alone
        are fitted to. Worked out once for each metric."""
        if metric not in self._asked_in:
            self._asked_in[metric] = self._moved_in(metric)
        return self._asked_in[metric]

    def _moved_in(self, metric: Whitening) -> Candidate:
        here = self.asked
        if not isinstance(metric, Innovations) or not self.model.structure.linear:
            return here
        low, high = self.model.structure.bounds
        loose = [self.model.structure.names.index(name) for name in here.free]
        # A step may not lead there. An unstable vehicle can foretell anything that its pilot and controller hold.
        known = metric.model.structure == self.model.structure and metric.model.stable
        if known and (told := here._at(metric.model.values)) is not None:
            here = min(here, told, key=lambda one: _new(one, metric))
        for _ in range(MOST_MOVES):
            J, e = metric(here.J), metric(_residual(here))[0]
            for step in _steps(J, e):
                before, values = here.model.values, here.model.values.copy()
                values[loose] += step
                # a bound itself may have no response
                values = np.clip(values, before + SHY * (low - before), before + SHY * (high - before))
                there = here._at(values)
                if there is not None and _new(there, metric) < float(e @ e) - LITTLE_MOVED:
                    here = there
                    break
            else:
                break
        return here

    def _at(self, values: FloatArray) -> Candidate | None:
        """With other values; None where they have no response."""
        moved = replace(self.estimate, model=Model(self.model.structure, values))
        try:
            with np.errstate(all="ignore"):
                return candidate(moved, self.held, self.dataset, self.added)
        except np.linalg.LinAlgError:
            return None

    @cached_property
    def told(self) -> tuple[Model, dict[str, float]]:
        """The numbers to tell of it and their standard errors, 0 of those held or at a bound: as fitted where the
        excitation keeps feedback out, else those that foretell best what is new."""
        if not self.dataset.in_a_loop:
            return self.model, self.standard_errors
        there = self.asked_in(self.metric)
        variances = np.diag(_covariance(there, self.metric))
        errors = np.sqrt(np.maximum(variances, 0.0))  # what is not determined comes out below 0 by rounding
        return there.model, dict(zip(there.model.structure.names, map(float, errors), strict=True))

    @cached_property
    def metric(self) -> Whitening:
        """White rows by the noise that it leaves: for `asked`, and for that of every other candidate."""
        if self.dataset.in_a_loop:
            return innovations(self.model, self.dataset.wider, self.asked.free)
        return noise_whitening(self.model, self.dataset.stacks, self._divided)

    @cached_property
    def stepped(self) -> Stepped:
        """In its own metric."""
        return instrumental_step(self.asked_in(self.metric), self.metric)

    @property
    def error_share(self) -> float:
        """Residual over measured power, summed over the outputs."""
        return error_share(self.estimate.error)

    @property
    def nrmse_percent(self) -> dict[str, float]:
        outputs = self.model.structure.outputs
        return dict(zip(outputs, map(float, self.estimate.error.nrmse_percent), strict=True))


def error_share(error: OutputError) -> float:
    """Residual over measured power, summed over the outputs."""
    return float(np.sum(error.residual_power / error.measured_power))


def candidate(found: Estimate, held: Collection[str], on: Dataset, added: Sequence[str] = ()) -> Candidate:
    """Linearise a fit on its runs."""
    structure, values = found.model.structure, found.model.values
    fixed = {*held, *found.at_bound, *jumping(structure, values, on.stacks[0])}  # a jump has no slope to follow
    loose = [i for i, name in enumerate(structure.names) if name not in fixed]
    flown = [respond(structure, values, group, True) for group in on.stacks]
    J = [one.slopes for one in flown]
    Y_imposed, J_imposed = imposed_answers(structure, values, on, [one.Y for one in flown], J)
    return Candidate(
        estimate=found,
        added=tuple(added),
        held=tuple(held),
        free=tuple(structure.names[i] for i in loose),
        dataset=on,
        Y=[one.Y for one in flown],
        Y_imposed=Y_imposed,
        J=[one[loose] for one in J],
        J_imposed=[one[loose] for one in J_imposed],
    )


def imposed_answers(
    structure: Structure,
    values: FloatArray,
    on: Dataset,
    Y: Sequence[ComplexArray],
    J: Sequence[ComplexArray] | None = None,
) -> tuple[list[ComplexArray], list[ComplexArray]]:
    """Answers to the imposed commands, beside those to the commands as flown; and their sensitivities where J is given.

    Play, limits and dead bands do to small commands what the large ones that go with them decide. So there it is the
    answer in surrogate gusts, less the linear answer to these: what gusts as flown would do is in the residual too.
    """
    if on.beyond:  # what is new knows no command, whatever made it
        return list(Y), list(J or ())
    if all(effect.samples is None for effect in structure.composed):
        found = [respond(structure, values, group, J is not None) for group in on.imposed]
        return [one.Y for one in found], [] if J is None else [one.slopes for one in found]
    steady = [one for one in structure.composed if one.linear and one.samples is None]
    smooth = compose(structure.base_, steady, on.available, dict(structure.constants), outputs=structure.outputs)
    inner = np.array([values[structure.names.index(name)] for name in smooth.names])
    rows = [structure.names.index(name) for name in smooth.names]
    Ys, Js = [], []
    for number, (group, imposed) in enumerate(zip(on.surrogate, on.imposed, strict=True)):
        if group is on.stacks[number]:  # nothing but what was imposed
            Ys.append(Y[number])
            Js += [] if J is None else [J[number]]
            continue
        answer = respond(structure, values, group, J is not None)
        gusts = respond(smooth, inner, replace(group, U=group.U - imposed.U), J is not None)
        Ys.append(answer.Y - gusts.Y)
        if J is not None:
            changed = answer.slopes.copy()
            changed[rows] -= gusts.slopes
            Js.append(changed)
    return Ys, Js


def _steps(J: FloatArray, e: FloatArray) -> Iterator[FloatArray]:
    """Moves of parameters whose rows are J, to try one after the other: the second where what the runs hardly
    determine runs away with the first."""
    if not len(J):
        return
    with np.errstate(over="ignore", invalid="ignore"):
        information, slope = J @ J.T, J @ e
    if not (np.isfinite(information).all() and np.isfinite(slope).all()):
        return  # of a model that is not stable, and leads nowhere
    yield np.asarray(np.linalg.lstsq(information, slope, rcond=1e-10)[0])
    scale = np.maximum(np.linalg.norm(J, axis=1), 1e-300)
    rows = J / scale[:, None]
    yield np.asarray(np.linalg.solve(rows @ rows.T + DAMPED * np.eye(len(rows)), rows @ e) / scale)


def _new(one: Candidate, metric: Whitening) -> float:
    """Of what it leaves, the power in white rows."""
    return float(np.sum(metric(_residual(one)) ** 2))


def _residual(one: Candidate) -> list[ComplexArray]:
    """For every stack (1, k, bins)."""
    return [(group.Y - Y)[None] for group, Y in zip(one.dataset.stacks, one.Y, strict=True)]


def refit(composed: Structure, parent: Candidate, added: Sequence[str], near: Model | None = None) -> Candidate:
    """Fit a composition that grows from the parent, or goes on from `near`. Raises FitError where the runs do not
    determine it, RelaxationError where its response does not settle."""
    fixed = {name: parent.model[name] for name in parent.held}
    open_to_all = structural(composed, fixed)
    if open_to_all is not None:
        raise FitError(open_to_all)
    begin = near or (parent.model if composed.base == parent.model.structure.base else None)
    found = estimate(composed, parent.dataset.viewed(composed.inputs), begin, fixed, parent.estimate.weights)
    made = candidate(found, parent.held, parent.dataset, added)
    _ = made.asked  # what does not settle on the bins of its metric is no candidate
    return made


def predicting(fit: Candidate, parent: Candidate) -> Candidate:
    """In a loop the values that foretell best what is new, from typical ones of the effects that were added; the fit
    where these do not foretell it better. Feedback may take least squares into another valley, and far off."""
    structure, metric = fit.model.structure, parent.metric
    if not (fit.dataset.in_a_loop and structure.linear and isinstance(metric, Innovations)):
        return fit
    begin = {one.name: one.typical for one in structure.parameters} | metric.model.by_name
    model = Model(structure, structure.vector({name: begin[name] for name in structure.names}))
    there = replace(fit, estimate=replace(fit.estimate, at_bound=()))._at(model.values)
    if there is None:
        return fit
    try:
        with np.errstate(all="ignore"):  # from where a model is not stable
            there = there.asked_in(metric)
            if not (there.model.stable and _new(there, metric) < _new(fit.asked_in(metric), metric) - SURELY_BETTER):
                return fit
        found = replace(
            fit.estimate,
            model=there.model,
            at_bound=(),
            error=output_error(there.model, fit.dataset.stacks),
            covariance=_covariance(there, metric),
            instrument="prediction error",
        )
        return candidate(found, fit.held, fit.dataset, fit.added)
    except (RelaxationError, np.linalg.LinAlgError):
        return fit


def by_the_noise(fit: Candidate, begin: Model, metric: Whitening) -> Candidate | None:
    """The fit's structure moved, from these values, to where the imposed commands leave nothing of its parameters in
    the noise's white rows; None where no response leads there.

    Least squares weighs what is small and narrow no more than gusts of the same power, and goes where these are.
    """
    here = replace(fit, estimate=replace(fit.estimate, at_bound=()))._at(begin.values)
    if here is None:
        return None
    for _ in range(MOST_MOVES_BY_NOISE):
        better = _moved(here, _instrumented_move(here, metric), metric)
        if better is None:
            break
        here = better
    moved = replace(
        here.estimate,
        error=output_error(here.model, here.dataset.stacks),
        covariance=_covariance(here, metric),
    )
    return candidate(moved, fit.held, fit.dataset, fit.added)


def _moved(one: Candidate, step: FloatArray, metric: Whitening) -> Candidate | None:
    """So far along a step of the free parameters that it leaves less; None where it does not."""
    loose = [one.model.structure.names.index(name) for name in one.free]
    for part in PARTS:
        values = one.model.values.copy()
        values[loose] += part * step
        there = one._at(values)
        if there is not None and _new(there, metric) < _new(one, metric) - LITTLE_MOVED:
            return there
    return None


def _instrumented_move(one: Candidate, metric: Whitening) -> FloatArray:
    """Of the free parameters, less than all the way to their bounds: a bound itself may have no response."""
    J, Z, e = metric(one.J), metric(one.J_imposed), metric(_residual(one))[0]
    return SHY * _within_bounds(one, Z @ J.T, Z @ e)


def _covariance(one: Candidate, metric: Whitening) -> FloatArray:
    """Of all parameters, (parameters, parameters); zero for those that are not free."""
    names, J = one.model.structure.names, metric(one.J)
    free = [names.index(name) for name in one.free]
    found = np.zeros((len(names), len(names)))
    found[np.ix_(free, free)] = np.linalg.pinv(J @ J.T, hermitian=True)
    return found


@dataclass(frozen=True, eq=False)
class Stepped:
    """A candidate in white rows, its free parameters moved to where the imposed commands leave no residual to them.

    Fits weigh each output as a whole; here the noise's spectrum weighs, and candidates are compared at their best.
    """

    residual: FloatArray
    """(N,)"""
    imposed: FloatArray
    """(N,), predicted from the imposed commands."""
    J: FloatArray
    """(b, N), sensitivities by the commands as flown."""
    Z: FloatArray
    """(b, N), the instruments: sensitivities by the imposed commands."""
    _envelope: list[Envelope] = field(default_factory=list)

    def envelope(self, whitening: Whitening) -> Envelope:
        """Of what is left over time, in the rows of its whitening; worked out once."""
        if not self._envelope:
            self._envelope.append(Envelope.of(self.residual, whitening.stacks))
        return self._envelope[0]


def instrumental_step(one: Candidate, whitening: Whitening) -> Stepped:
    """One Gauss-Newton step of the free parameters, the instruments standing for the sensitivities on one side; none
    goes beyond its bounds, where a lag would be a lead."""
    J, Z = whitening(one.J), whitening(one.J_imposed)
    e = whitening(_residual(one))[0]
    imposed = whitening([Y[None] for Y in one.Y_imposed])[0]
    if len(J):
        move = _within_bounds(one, Z @ J.T, Z @ e)
        if np.sum((e - move @ J) ** 2) < WORST_SETTLING * (e @ e):  # a jump has no slope to follow
            e, imposed = e - move @ J, imposed + move @ Z
    return Stepped(e, imposed, J, Z)


def _within_bounds(one: Candidate, H: FloatArray, g: FloatArray) -> FloatArray:
    """The step H move = g of the free parameters; what would pass its bounds goes there, and the rest follows."""
    bounds = {parameter.name: parameter.bounds for parameter in one.model.structure.parameters}
    low, high = np.array([bounds[name] for name in one.free]).T
    here = np.array([one.model[name] for name in one.free])
    move, held = np.zeros(len(here)), np.zeros(len(here), dtype=bool)
    while not np.all(held):
        rest = ~held
        move[rest] = np.linalg.lstsq(H[np.ix_(rest, rest)], (g - H @ np.where(held, move, 0))[rest], rcond=1e-10)[0]
        beyond = rest & ((here + move < low) | (here + move > high))
        if not np.any(beyond):
            break
        held |= beyond
        move = np.clip(here + move, low, high) - here
    return move


def gain(better: Stepped, worse: Stepped) -> tuple[float, float]:
    """How much more likely one makes the data than the other, in chi squared, and their distance in the same measure.

    |e_2|^2 - |e_1|^2 is the product of what the models differ by and the sum of their residuals; the difference is
    taken from the imposed commands, so that gusts in the commands as flown favour neither.
    """
    apart = better.imposed - worse.imposed
    return float(apart @ (better.residual + worse.residual)), float(apart @ apart)
