"""Candidates: fits linearised on their runs, and two of them compared by how likely they make the data.

Gusts reach the commands through the feedback, and with them every residual. So sensitivities and predictions that a
residual is asked with are those to the commands as the logged excitation alone moved them (instruments); the residual
itself is that of the commands as flown. Where no excitation is logged, what is new in the residual is asked instead
(`sysid.fit.innovations`), on bins beyond the band: `Candidate.asked` and its `metric`.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache

import numpy as np

from sysid.data.dataset import Dataset
from sysid.data.preprocess import ComplexArray, gusts_kept_out
from sysid.diagnose import growing_modes
from sysid.diagnose.shown import Shown, as_loud_as_it_is, shown_by
from sysid.errors import FitError
from sysid.fit.bursts import Envelope
from sysid.fit.estimate import Estimate, estimate
from sysid.fit.identifiable import structural
from sysid.fit.innovations import Innovations, innovations
from sysid.fit.noise import Division, divide, surprise
from sysid.fit.output_error import OutputError
from sysid.fit.rows import project
from sysid.fit.scaled import instrumental_inverse, scaled_solve
from sysid.fit.whitening import Whitening, noise_whitening
from sysid.model.acting import jumping, linear_dynamics
from sysid.model.compose import compose
from sysid.model.predict import respond
from sysid.model.relaxation import RelaxationError
from sysid.model.structure import FloatArray, Model, Structure

WORST_SETTLING, MOST_MOVES = 1.01, 3
DAMPED = 1e-2
"""Of each parameter's own weight: what the runs hardly determine does not run away."""
SHY = 0.9
"""Of the way to a bound, that a move may go."""
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
    jumps: tuple[str, ...]
    """What the runs determined, neither held nor at a bound: with a slope to follow, as the rows of J, or with none."""
    dataset: Dataset
    Y: list[ComplexArray]
    """Predicted from the commands as flown, for every stack (k, bins)."""
    Y_imposed: list[ComplexArray]
    """Predicted from the imposed commands."""
    J: list[ComplexArray]
    """Sensitivities of Y to the free parameters, for every stack (free, k, bins)."""
    J_imposed: list[ComplexArray]
    """Of Y_imposed; J itself where nothing but the commands as flown is asked."""
    _asked_in: dict[Whitening, Candidate] = field(default_factory=dict, init=False)

    @property
    def model(self) -> Model:
        return self.estimate.model

    @property
    def fitted(self) -> int:
        """How many parameters the runs determined."""
        return len(self.free) + len(self.jumps)

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
        return candidate(self.estimate, self.held, self.dataset.wider, self.added) if self.dataset.in_a_loop else self

    def asked_in(self, metric: Whitening) -> Candidate:
        """`asked`, in innovations moved to where it predicts best, for feedback biases fits; once for each metric."""
        if metric not in self._asked_in:
            moves = linear_dynamics(self.model.structure) and isinstance(metric, Innovations)
            self._asked_in[metric] = self._moved_in(metric) if moves else self.asked
        return self._asked_in[metric]

    def _moved_in(self, metric: Whitening) -> Candidate:
        assert isinstance(metric, Innovations)
        here, (low, high) = self.asked, self.model.structure.bounds
        # A step may not lead there. An unstable vehicle can foretell anything that its pilot and controller hold.
        known = metric.model.structure == self.model.structure and metric.model.stable
        if known and (told := here.at(metric.model.values)) is not None:
            here = min(here, told, key=lambda one: power_left(one, metric))
        for _ in range(MOST_MOVES):
            loose = [self.model.structure.names.index(name) for name in here.free]  # elsewhere others may jump
            J, e = metric(here.J), metric(_residual(here))[0]
            least = float(e @ e) + growing_modes.cost(here.estimate, metric) - LITTLE_MOVED
            for step in _steps(J, e, growing_modes.cost_slopes(here.estimate, metric, here.free)):
                before, values = here.model.values, here.model.values.copy()
                values[loose] += step
                # a bound itself may have no response
                values = np.clip(values, before + SHY * (low - before), before + SHY * (high - before))
                rest = residual_at(here, values, metric)  # derivatives cost many times as much
                if rest is None:
                    continue
                left = float(rest @ rest) + growing_modes.cost(here.estimate, metric, values)
                there = here.at(values) if left < least else None
                if there is not None:
                    here = there
                    break
            else:
                break
        return here

    def at(self, values: FloatArray) -> Candidate | None:
        """With other values; None where they have no response."""
        try:
            with np.errstate(all="ignore"):
                moved = replace(self.estimate, model=Model(self.model.structure, values))
                return candidate(moved, self.held, self.dataset, self.added)
        except (np.linalg.LinAlgError, RelaxationError):
            return None

    @cached_property
    def told(self) -> tuple[Model, dict[str, float]]:
        """The numbers to tell of it and their standard errors, 0 of those held or at a bound: in a loop those that
        foretell best what is new; else, and where no move of what is simulated leads there, as fitted."""
        if not self.dataset.in_a_loop:
            return self.model, self.standard_errors
        metric, linear = self.metric, linear_dynamics(self.model.structure)
        there = self.asked_in(metric) if linear else self._moved_in(metric)
        if there is self.asked and not linear:
            return self.model, self.standard_errors
        errors = np.sqrt(np.maximum(np.diag(covariance(there, metric)), 0.0))  # not determined: below 0 by rounding
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
        return nrmse_percent(self.estimate.error, self.model.structure)


def nrmse_percent(error: OutputError, structure: Structure) -> dict[str, float]:
    """By output."""
    return dict(zip(structure.outputs, map(float, error.nrmse_percent), strict=True))


def error_share(error: OutputError) -> float:
    """Residual over measured power, summed over the outputs."""
    return float(np.sum(error.shares))


def candidate(found: Estimate, held: Collection[str], on: Dataset, added: Sequence[str] = ()) -> Candidate:
    """Linearise a fit on its runs."""
    structure, values = found.model.structure, found.model.values
    fixed = {*held, *found.at_bound}
    jumps = [name for name in jumping(structure, values, on.stacks[0]) if name not in fixed]
    loose = [i for i, name in enumerate(structure.names) if name not in {*fixed, *jumps}]
    flown = [respond(structure, values, group, True) for group in on.stacks]
    J = [one.slopes for one in flown]
    Y_imposed, J_imposed = imposed_answers(structure, values, on, [one.Y for one in flown], J)
    moving = _of(J, loose)
    return Candidate(
        estimate=found,
        added=tuple(added),
        held=tuple(held),
        free=tuple(structure.names[i] for i in loose),
        jumps=tuple(jumps),
        dataset=on,
        Y=[one.Y for one in flown],
        Y_imposed=Y_imposed,
        J=moving,
        J_imposed=moving if on.beyond else _of(J_imposed, loose),
    )


def _of(J: Sequence[ComplexArray], numbers: Sequence[int]) -> list[ComplexArray]:
    """Some rows of each, which are many times the size of all else: copied only where they are not all."""
    return [one if len(numbers) == len(one) else one[numbers] for one in J]


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
    rows = [structure.names.index(name) for name in smooth.names]
    Ys, Js = [], []
    for number, (group, blown) in enumerate(zip(on.surrogate, on.gusts, strict=True)):
        if group is on.stacks[number]:  # nothing but what was imposed
            Ys.append(Y[number])
            Js += [] if J is None else [J[number]]
            continue
        answer = respond(structure, values, group, J is not None)
        gusts = respond(smooth, values[rows], blown, J is not None)
        Ys.append(answer.Y - gusts.Y)
        if J is not None:
            changed = answer.slopes.copy()
            changed[rows] -= gusts.slopes
            Js.append(changed)
    return Ys, Js


def _steps(J: FloatArray, e: FloatArray, dear: FloatArray | float = 0.0) -> Iterator[FloatArray]:
    """Moves of parameters whose rows are J, to try one after the other: the second where what the runs hardly
    determine runs away with the first. Half of what growing modes cost has the slopes `dear`."""
    if not len(J):
        return
    with np.errstate(over="ignore", invalid="ignore"):
        information, slope = J @ J.T, J @ e - dear
    if not (np.isfinite(information).all() and np.isfinite(slope).all()):
        return  # of a model that is not stable, and leads nowhere
    yield scaled_solve(information, slope)
    scale = np.maximum(np.linalg.norm(J, axis=1), 1e-300)
    rows = J / scale[:, None]
    yield np.asarray(np.linalg.solve(rows @ rows.T + DAMPED * np.eye(len(rows)), slope / scale) / scale)


def as_loud(one: Candidate, metric: Whitening) -> Whitening:
    """The metric with its lowest frequencies as loud as what the candidate leaves is there."""
    if not one.division.measured:
        return metric
    return as_loud_as_it_is(metric, white_residual(one, metric), one.dataset.causes)


def power_left(one: Candidate, metric: Whitening) -> float:
    """Of what it leaves, the power in white rows, and what its growing modes cost."""
    return float(np.sum(white_residual(one, metric) ** 2)) + growing_modes.cost(one.estimate, metric)


def white_residual(one: Candidate, metric: Whitening) -> FloatArray:
    """(N,), what it leaves in white rows."""
    return np.asarray(metric(_residual(one))[0])


def residual_at(one: Candidate, values: FloatArray, metric: Whitening) -> FloatArray | None:
    """(N,), what it would leave in white rows with other values; None where they have no response."""
    try:
        return white_left(Model(one.model.structure, values), metric)
    except (np.linalg.LinAlgError, RelaxationError):
        return None


def white_left(model: Model, metric: Whitening) -> FloatArray:
    """(N,), what a model leaves in white rows of the metric's runs. Raises LinAlgError where it has no response, and
    RelaxationError where that does not settle."""
    with np.errstate(all="ignore"):
        left = [(group.Y - respond(model.structure, model.values, group, False).Y)[None] for group in metric.stacks]
        return np.asarray(metric(left)[0])


def _residual(one: Candidate) -> list[ComplexArray]:
    """For every stack (1, k, bins)."""
    return [(group.Y - Y)[None] for group, Y in zip(one.dataset.stacks, one.Y, strict=True)]


def refit(
    composed: Structure,
    parent: Candidate,
    added: Sequence[str],
    near: Model | None = None,
    held: Mapping[str, float] | None = None,
) -> Candidate:
    """Fit a composition that grows from the parent, or goes on from `near`, with what the parent holds and these values
    `held`. Raises FitError where the runs do not determine it, RelaxationError where its response does not settle."""
    fixed = {name: parent.model[name] for name in parent.held} | dict(held or {})
    open_to_all = structural(composed, fixed)
    if open_to_all is not None:
        raise FitError(open_to_all)
    begin = near or (parent.model if composed.base == parent.model.structure.base else None)
    on, bins = parent.dataset, parent.dataset.viewed(composed.inputs)
    found = estimate(composed, bins, begin, fixed, parent.estimate.weights)
    found = growing_modes.likeliest(found, on, bins, fixed)
    made = candidate(found, tuple(fixed), on, added)
    _ = made.asked  # what does not settle on the bins of its metric is no candidate
    return made


@dataclass(frozen=True, eq=False, kw_only=True)
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
    shown: Shown | None = None
    """Where the excitation shows; None where none is logged."""
    taken: bool = True
    """Whether the step was, or there was none to take."""
    growing: float = 0.0
    """Chi squared that its growing modes cost."""
    _envelope: list[Envelope] = field(default_factory=list)

    @cached_property
    def own(self) -> FloatArray:
        """(b, b), of Z J^T the inverse."""
        return instrumental_inverse(self.Z, self.J)

    @cached_property
    def told(self) -> FloatArray:
        """(N,), of `imposed` what tells models apart (`Shown.told`); all of it where no excitation is logged."""
        return self.imposed if self.shown is None else self.shown.told(self.imposed[None])[0]

    @cached_property
    def caused(self) -> FloatArray:
        """What of the residual lies where the excitation shows; nothing where none is logged."""
        return np.empty(0) if self.shown is None else self.shown.caused(self.residual)

    @cached_property
    def beyond(self) -> FloatArray:
        """(N,), what of `told` does not lie there."""
        return self.told if self.shown is None else self.shown.beyond(self.imposed)

    def envelope(self, whitening: Whitening) -> Envelope:
        """Of what is left over time, in the rows of its whitening; worked out once."""
        if not self._envelope:
            self._envelope.append(Envelope.of(self.residual, whitening.stacks))
        return self._envelope[0]

    def envelope_beside(self, rows: FloatArray, whitening: Whitening) -> Envelope:
        """The same of what these rows (c, N) do not explain, where noise comes in bursts: an effect that acts while the
        chirp is at one frequency is none."""
        envelope = self.envelope(whitening)
        if not envelope.rough:
            return envelope
        return Envelope.of(project(rows, self.residual[None])[0], whitening.stacks)


@lru_cache(maxsize=4)
def instrumental_step(one: Candidate, whitening: Whitening) -> Stepped:
    """One Gauss-Newton step of the free parameters, the instruments standing for the sensitivities on one side, as far
    as they tell; none goes beyond its bounds, where a lag would be a lead. Kept: a refit is judged by it repeatedly."""
    white = White.of(one, whitening)
    J, Z, e, shown = white.J, white.Z, white.residual, white.shown
    imposed, taken = whitening([Y[None] for Y in one.Y_imposed])[0], True
    growing = growing_modes.cost(one.estimate, whitening)
    if len(J):
        move = white.move(one)
        there, values = e - move @ J, one.model.values.copy()
        values[[one.model.structure.names.index(name) for name in one.free]] += move
        grows = growing_modes.cost(one.estimate, whitening, values)
        # a jump has no slope to follow; elsewhere gusts that feedback lets commands explain are no reason to stay
        gusts = shown is not None and one.model.structure.linear and white.power(there) < white.power(e)
        taken = gusts or bool(there @ there + grows < WORST_SETTLING * (e @ e + growing))
        if taken:
            e, imposed, growing = there, imposed + move @ Z, grows
    return Stepped(residual=e, imposed=imposed, J=J, Z=Z, shown=shown, taken=taken, growing=growing)


@dataclass(frozen=True, eq=False, slots=True)
class White:
    """A candidate in white rows, as it is."""

    residual: FloatArray
    """(N,)"""
    J: FloatArray
    """(b, N)"""
    Z: FloatArray
    """(b, N), by the imposed commands."""
    shown: Shown | None
    """None where no excitation is logged."""
    dear: FloatArray
    """(b,), slopes of half of what growing modes cost."""

    @classmethod
    def of(cls, one: Candidate, whitening: Whitening) -> White:
        by, shown = one.dataset.causes, None
        if not one.dataset.beyond and gusts_kept_out(by.references):
            shown = shown_by(whitening, by)
        J = whitening(one.J)
        Z = J if one.J_imposed is one.J else whitening(one.J_imposed)
        dear = growing_modes.cost_slopes(one.estimate, whitening, one.free)
        return cls(white_residual(one, whitening), J, Z, shown, dear)

    def shows(self, row: FloatArray) -> FloatArray:
        """What of another row (N,) is where the excitation shows, or all of it where none is logged."""
        return row if self.shown is None else self.shown.caused(row)

    def power(self, row: FloatArray) -> float:
        """The same in one number."""
        shown = self.shows(row)
        return float(shown @ shown)

    def move(self, one: Candidate) -> FloatArray:
        """Of the candidate's free parameters, between their bounds, to where the imposed commands leave least."""
        asked, dear = (self.Z, self.dear) if self.shown is None else (self.shown.told(self.Z), 0.0)
        return _within_bounds(one, asked @ self.J.T, asked @ self.residual - dear)


def covariance(one: Candidate, metric: Whitening) -> FloatArray:
    """Of all parameters, (parameters, parameters); zero for those that are not free."""
    names, J = one.model.structure.names, metric(one.J)
    free = [names.index(name) for name in one.free]
    found = np.zeros((len(names), len(names)))
    found[np.ix_(free, free)] = instrumental_inverse(J, J)
    return found


def _within_bounds(one: Candidate, H: FloatArray, g: FloatArray) -> FloatArray:
    """The step H move = g of the free parameters; what would pass its bounds goes there, and the rest follows."""
    known = {each.name: each for each in one.model.structure.parameters}
    here = np.array([one.model[name] for name in one.free])
    low, high, null = np.array([(*known[name].bounds, known[name].null or 0.0) for name in one.free]).T
    high = np.where(np.isposinf(null), np.minimum(high, 2 * here), high)  # by its slope none; beyond, a lag were a lead
    move, held = np.zeros(len(here)), np.zeros(len(here), dtype=bool)
    while not np.all(held):
        rest = ~held
        move[rest] = scaled_solve(H[np.ix_(rest, rest)], (g - H @ np.where(held, move, 0))[rest])
        if not np.any(beyond := rest & ((here + move < low) | (here + move > high))):
            break
        held |= beyond
        move = np.clip(here + move, low, high) - here
    return move


def gain(better: Stepped, worse: Stepped) -> tuple[float, float]:
    """How much more likely one makes the data than the other, in chi squared, and their distance in the same measure.

    |e_2|^2 - |e_1|^2, where the excitation shows: gusts in the commands as flown favour neither there. Beside it, and
    where none is logged, it is the product of what the models differ by and the sum of their residuals, the difference
    taken from the imposed commands. (Where the excitation shows that is no instrument. What acts on samples does in
    other gusts than those flown something else to what was imposed; and what a slow mode answers in a loop hangs on
    more of what was imposed than runs tell: of a helicopter that drifts the product had -1053 for the right model,
    which left 461 there of 3803.) In a loop growing modes have their cost.
    """
    apart, left = better.imposed - worse.imposed, better.residual + worse.residual
    if better.shown is None or worse.shown is None:
        more = apart @ left
    else:
        more = worse.caused @ worse.caused - better.caused @ better.caused + (better.beyond - worse.beyond) @ left
    return float(more) + worse.growing - better.growing, float(apart @ apart)
