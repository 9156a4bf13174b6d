"""Effects that the model may lack: every testable entry scored; what was refitted, validated and ranked."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from statistics import NormalDist
from typing import Any

import numpy as np

from sysid.data.airframe import Airframe
from sysid.data.dataset import Dataset
from sysid.diagnose.evidence import Candidate, Stepped, gain, instrumental_step, nrmse_percent
from sysid.diagnose.initial_states import validation_error
from sysid.diagnose.plausible import of_the_wrong_sign, out_of_reach
from sysid.diagnose.progress import Asking, Heard, Known, Listener, Stage
from sysid.diagnose.score import INDEPENDENT, Score, log_chance, score
from sysid.diagnose.slow_modes import SlowMode
from sysid.diagnose.term_search import Selection, Term
from sysid.fit.identify import beyond_responses
from sysid.fit.noise import Division
from sysid.fit.output_error import OutputError
from sysid.fit.result import finite
from sysid.fit.whitening import Whitening
from sysid.model.airframe import not_offered
from sysid.model.compose import acts_on, adapted, compose, not_testable
from sysid.model.effect import Effect, EffectError, catalogue
from sysid.model.parameter import SURELY
from sysid.model.predict import respond
from sysid.model.relaxation import RelaxationError
from sysid.model.structure import FloatArray, Structure

SHOWN_IN_BURSTS = math.log(1e-7)
"""Chance of the best of all entries, where noise comes in bursts, from which on windows of frequency count."""
WINDOWS_ALONE = math.log(1e-7)
"""Chance by windows of frequency, above which an entry has to show something, too: of two clean strangers, one of
chirps of 8 s and one in slow gusts, windows showed 8e-5 and 4e-5 so, and no entry 0.07."""
SIGNIFICANT = math.log(1e-4)
"""Of all questions asked together; logarithm of the nominal chance that noise alone answers so. On clean flights one in
a hundred is found below it: the noise is not quite what the questions take it for."""
IN_A_LOOP = math.log(100)
"""Less surely than that nothing is told where no excitation is logged: short of many runs slow effects, which remember
the gusts of half a run, are shown by noise more often than chance has it."""
QUESTIONS = 4
"""Kinds of them: the commands against the residual, the catalogue, slow modes, candidate terms."""
REMAINDER = 0.05
"""Share of what can be explained, left by the best effect, from which on a second one is looked for."""
FORWARD = frozenset({"airspeed", "alpha", "beta"})
"""Signals of forward flight: where none moves, and the structure has no effect of it, none of its effects is asked."""
HOVERING = "nothing says that these runs flew forward: log airspeed, or fit the elevator"
CRUMBS = 0.1
"""Points of NRMSE: where an effect leaves no output more to explain, nothing slow and no chain is looked for. A stiff
mode beside a lag that stood in for most of it was worth 0.15."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Ranked:
    """One candidate with all that is known of it."""

    effects: tuple[str, ...]
    """Added to the parent."""
    score: Score | None
    not_testable: str | None
    """Why it was not asked, or not answered; None where it was."""
    not_offered: bool = False
    """Whether that is because the airframe cannot have it, or because it is of more than the one axis of the base."""
    fit: Candidate | None = None
    stepped: Stepped | None = None
    chi_squared: float = 0.0
    """How much likelier than the parent it makes the fitted runs."""
    added: int = 0
    """Parameters more than the parent's."""
    explained_share: float | None = None
    validation_nrmse_percent: Mapping[str, float] | None = None
    validation_error: OutputError | None = None
    validation_share: float | None = None
    validation_slack: float = 0.0
    """By which chance alone may make that share too small."""
    implausible: tuple[str, ...] = ()
    """Parameters outside what physics allows that were not so in the parent."""
    outside: tuple[str, ...] = ()
    """The same whatever their standard errors, and those at a bound of what an effect may be: doubtful values."""
    resolved: tuple[str, ...] = ()
    """Parameters of the parent that were implausible and are not any more."""
    bounded: Mapping[str, float] = field(default_factory=dict)
    """Its parameters at a bound: what their standard errors were, if they might move on."""
    rows: int = 1
    foretells: float = 0.0
    """Chi squared by which it foretells more than its first effect, of a chain, or than the structure itself does, if
    asked: where what was imposed tells little."""

    @property
    def effect(self) -> str:
        return self.effects[-1]

    @property
    def delta_bic(self) -> float:
        """Negative where it pays for its parameters."""
        return self.added * math.log(self.rows) - self.chi_squared

    @property
    def values(self) -> dict[str, float]:
        """Its parameters: refitted, else one step from the parent, else none."""
        if self.fit is not None:
            return {name: self.fit.told[0][name] for name in self.names}
        return {} if self.score is None else dict(self.score.at)

    @property
    def names(self) -> tuple[str, ...]:
        """Its parameters in the refit; all of the model, where it is another base."""
        if self.fit is None:
            return ()
        return tuple(name for one in self.own for name in one.names) if self.own else self.fit.model.structure.names

    @property
    def own(self) -> tuple[Effect, ...]:
        """What it adds to the parent, as composed in the refit; nothing where there is none."""
        composed = () if self.fit is None else self.fit.model.structure.composed
        return tuple(one for one in composed if (one.path or one.id) in self.effects)

    def own_of(self, half: str) -> tuple[Effect, ...]:
        """The same of one of its effects."""
        return tuple(one for one in self.own if half == (one.path or one.id))

    @property
    def standard_errors(self) -> dict[str, float]:
        """Of `values`, where the refit gives any; of those at a bound as if they might move on."""
        if self.fit is None:
            return {} if self.score is None else dict(self.score.errors)
        errors = {**self.fit.told[1], **self.bounded}
        return {name: errors[name] for name in self.values if errors[name] > 0}

    def to_json(self) -> dict[str, Any]:
        fitted = self.fit is not None
        return {
            "effect": "+".join(self.effects),
            "explained_share": None if self.explained_share is None else finite(self.explained_share),
            "delta_bic": finite(self.delta_bic) if fitted else None,
            "nrmse_percent": self.fit.nrmse_percent if self.fit is not None else None,
            "validation_nrmse_percent": None
            if self.validation_nrmse_percent is None
            else dict(self.validation_nrmse_percent),
            "parameters": {name: finite(value) for name, value in self.values.items()},
            "standard_errors": {name: finite(value) for name, value in self.standard_errors.items()},
            "implausible": bool(self.implausible),
            "implausible_parameters": list(self.implausible),
            "resolves": list(self.resolved),
            "not_testable": self.not_testable,
            "chi_squared": finite(self.chi_squared) if fitted else None,
            "score": None
            if self.score is None
            else {"chi_squared": finite(self.score.chi_squared), "degrees": self.score.degrees},
            "validation_share": None if self.validation_share is None else finite(self.validation_share),
        }


@dataclass(frozen=True, kw_only=True, eq=False)
class Reference:
    """What all candidates of one diagnosis are held against."""

    parent: Candidate
    """The structure as it is;"""
    stepped: Stepped
    """in the white rows of"""
    whitening: Whitening
    """the noise that the likeliest candidate leaves."""
    users: Sequence[Effect]
    """Effects beside the catalogue's."""
    validation: Dataset | None
    simple: Callable[[Candidate], Selection]
    """The simple terms beside a candidate,"""
    term: Callable[[Candidate], Term | None]
    """the one that explains most,"""
    mode: Callable[[Candidate], SlowMode | None]
    """and the slow mode;"""
    left: Callable[[OutputError], Division]
    """what is left of the validation runs, divided; each is asked once."""
    error: OutputError | None
    """The parent's on the validation runs."""


def composed_with(parent: Structure, effect: Effect, on: Dataset) -> Structure:
    constants = {**on.constants, **dict(parent.constants)}
    return compose(parent.base_, [*parent.composed, effect], on.available, constants, outputs=parent.outputs)


def entries(structure: Structure, on: Dataset, users: Sequence[Effect]) -> list[Effect]:
    """What may be asked of a structure on these runs: entries that it does not have, and that are not measured."""
    present = {one.id for one in structure.composed}
    found = []
    for effect in (*catalogue().values(), *users):
        if (effect.path or effect.id) in structure.effects:
            continue
        if effect.id in present or effect.id in structure.base_.contains:
            continue
        if not on.common.isdisjoint(effect.unless_logged):
            continue  # it is measured
        if not_offered(effect, on.airframe) is not None and not effect.can_be_on(Airframe.HELICOPTER):
            continue  # a multirotor's own, which has another name here
        found.append(effect)
    return found


def score_effects(
    parent: Candidate,
    stepped: Stepped,
    whitening: Whitening,
    users: Sequence[Effect],
    say: Listener,
    which: Callable[[Effect], bool] = lambda _: True,
) -> list[Ranked]:
    """Every entry, or those of some kind, that the parent does not have, with its score or why there is none."""
    structure, on = parent.model.structure, parent.dataset
    asked = [one for one in entries(structure, on, users) if which(one)]
    found = []
    for number, effect in enumerate(asked, 2):  # the first question is what of the structure's own error is noise
        name = effect.path or effect.id
        elsewhere = not_offered(effect, on.airframe)
        if elsewhere is not None:
            found.append(Ranked(effects=(name,), score=None, not_testable=elsewhere, not_offered=True))
            continue
        reason = _reason(effect, parent)
        if reason is not None:
            beyond = len(structure.base_.axes) == 1 and effect.path is None and not acts_on(effect, structure.base_)
            found.append(Ranked(effects=(name,), score=None, not_testable=reason, not_offered=beyond))
            continue
        try:
            composed = composed_with(structure, effect, on)
        except EffectError as error:
            found.append(Ranked(effects=(name,), score=None, not_testable=str(error)))
            continue
        if composed.base != structure.base:
            found.append(Ranked(effects=(name,), score=None, not_testable=None))
            continue
        say(Asking(stage=Stage.SCORES, effects=(name,), number=number, of=1 + len(asked)))
        answer = score(effect, composed, parent, stepped, whitening)
        reason = None if answer is not None else "it does nothing on these runs that the structure could not do itself"
        found.append(Ranked(effects=(name,), score=answer, not_testable=reason))
        if answer is not None:
            say(Heard(effects=(name,), known=Known.SCORED, promise=answer.chi_squared))
    return found


LINEAR = "not testable on measured frequency responses: they are linear"


def _reason(effect: Effect, parent: Candidate) -> str | None:
    structure, on = parent.model.structure, parent.dataset
    ids = [one.id for one in structure.composed]
    reason = not_testable(effect, structure.base_, [*ids, effect.id], on.available)
    if reason is None and effect.group == "forward" and not flies_forward(structure, on):
        return HOVERING
    if reason is None:
        return LINEAR if beyond_responses(effect, on.records) else None
    without = not_testable(effect, structure.base_, [*ids, effect.id], on.available | on.still)
    if without is None:
        read = adapted(effect, structure.base_, [*ids, effect.id], on.available | on.still).channels
        still = sorted({name for said in read for name in said.split("|")} & on.still)
        return f"{', '.join(still)} hardly moves on these runs, so it is not testable on these"
    return reason


def flies_forward(structure: Structure, on: Dataset) -> bool:
    """Whether anything says that the runs are of forward flight: a signal of it that moves, or an effect of it that the
    structure has. In a hover what only forward flight brings stands for something else."""
    return not FORWARD.isdisjoint(on.available) or any(one.group == "forward" for one in structure.composed)


def chance_of_noise(division: Division, scores: Sequence[Score]) -> float:
    """Logarithm of the chance that noise alone shows as much as the best of all questions."""
    linear = log_chance(division.chi_squared, division.degrees)
    return of_all_questions(min(linear, _of_the_best([one.log_p_surely for one in scores])), division)


def chance_of_an_alarm(parent: Candidate, scores: Sequence[Score]) -> float:
    """The same of a structure that nothing was found beside yet.

    Where noise comes in bursts, windows of frequency alone tell nothing: a short chirp passes some in a burst and
    others in the calm. An entry has to show it, too, before its bursts are taken off. (Four clean flights of 8 to 16 s
    showed as much by windows at 1e-25 to 1e-47; no entry did in three, and one in the fourth, at 2e-6. Of 130 that hid
    something, and came in bursts, every one had an entry that did at 4e-8 and less, but for three slung loads.) So it
    has in steady noise where windows show little.
    """
    chance = chance_of_noise(parent.division, scores)
    if chance >= SIGNIFICANT or not parent.division.measured:
        return chance
    by_entries = of_all_questions(_of_the_best([one.log_p_surely for one in scores]), parent.division)
    if chance > WINDOWS_ALONE and by_entries >= SIGNIFICANT:
        return by_entries
    shown = _of_the_best([one.log_p for one in scores])
    if shown < SHOWN_IN_BURSTS or not parent.stepped.envelope(parent.metric).rough:
        return chance
    return by_entries


def _of_the_best(chances: Sequence[float]) -> float:
    """Logarithm of the chance that the best of so many entries is shown by noise."""
    return min(chances, default=0.0) + math.log(max(len(chances), 1))


def of_all_questions(log_p: float, division: Division) -> float:
    """Logarithm of the chance that noise alone shows as much in any kind of question, by that of one kind."""
    return min(0.0, log_p + counted(division))


def counted(division: Division) -> float:
    """Logarithm by which the chance of one kind of question is raised, for all kinds and what a loop may make."""
    return math.log(QUESTIONS) + (0.0 if division.measured else IN_A_LOOP)


def explained_by(fit: Candidate, parent: Candidate, metric: Whitening) -> float:
    """Chi squared by which a fit is likelier than the parent."""
    known = metric is parent.metric
    before = parent.stepped if known else instrumental_step(parent.asked_in(metric), metric)
    return gain(instrumental_step(fit.asked_in(metric), metric), before)[0]


def ranked(one: Ranked, reference: Reference) -> Ranked:
    """The candidate with how much likelier than the parent it is, what of it physics does not allow, and its error on
    the validation runs."""
    if one.fit is None or reference.validation is None:
        return compared(one, reference)
    try:
        error = validation_error(one.fit.model, reference.validation)
    except (RelaxationError, np.linalg.LinAlgError):
        return replace(one, fit=None, not_testable="its response does not settle on the validation runs")
    validated = nrmse_percent(error, one.fit.model.structure)
    return replace(compared(one, reference), validation_nrmse_percent=validated, validation_error=error)


def heard(one: Ranked, parent: Candidate, avoidable: float | None = None) -> Heard:
    """What is known of a candidate that was refitted, or failed."""
    promise = 0.0 if one.score is None else one.score.chi_squared
    if one.fit is None:
        return Heard(effects=one.effects, known=Known.SCORED, promise=promise)
    return Heard(
        effects=one.effects,
        known=Known.REFITTED if one.validation_nrmse_percent is None else Known.VALIDATED,
        promise=promise,
        removed=parent.error_share - one.fit.error_share,
        avoidable=avoidable,
        nrmse_percent=one.fit.nrmse_percent,
        validation_nrmse_percent=one.validation_nrmse_percent,
        implausible=one.implausible,
    )


def compared(one: Ranked, reference: Reference) -> Ranked:
    """The candidate held against this reference, whatever it was before."""
    if one.fit is None:
        return one
    own = instrumental_step(one.fit.asked_in(reference.whitening), reference.whitening)
    likelier, _ = gain(own, reference.stepped)
    model, parent = one.fit.model, reference.parent
    before, outside = values_outside(parent), values_outside(one.fit)
    asked = one.fit.asked
    now = _implausible(asked, reference.whitening)
    at_bound = sorted({*one.names} & {*asked.estimate.at_bound} - {*asked.held})
    bounded = {name: _error_off_bounds(asked, name, (), reference.whitening) for name in at_bound}
    if not now - before and out_of_reach(one.fit, outside - before):
        now |= outside
    for effect in one.own:
        now |= of_the_wrong_sign(effect, one.fit)
    return replace(
        one,
        stepped=own,
        chi_squared=likelier,
        added=one.fit.fitted - parent.fitted,
        rows=reference.stepped.residual.size,
        implausible=tuple(name for name in model.structure.names if name in now - before),
        outside=tuple(name for name in model.structure.names if name in outside - before),
        resolved=tuple(sorted(_implausible(parent.asked, reference.whitening) - outside)),
        bounded={name: error for name, error in bounded.items() if math.isfinite(error)},
    )


def values_outside(one: Candidate) -> set[str]:
    """Parameters outside what physics allows, whatever their errors, or at a bound: what would be more is another
    effect, as a second-order lag of damping ratio 1 would be two lags."""
    parameters = zip(one.model.structure.parameters, one.model.values, strict=True)
    beyond = {parameter.name for parameter, value in parameters if parameter.implausible(float(value))}
    return beyond | set(one.estimate.at_bound)


def _implausible(one: Candidate, whitening: Whitening) -> set[str]:
    """Parameters that the data put outside what physics allows; what they do not determine is none of them."""
    found = set()
    for parameter in one.model.structure.parameters:
        name = parameter.name
        if not parameter.implausible(one.model[name]):
            continue
        error = one.standard_errors[name]
        beside = _at_bound_beside(one, name)
        if beside or (name in one.estimate.at_bound and name not in one.held):
            error = _error_off_bounds(one, name, beside, whitening)
        if parameter.sizes:
            error *= _surely(_effect_of(one, name)) / SURELY
        if parameter.implausible(one.model[name], error) and not _means_nothing(one, name):
            found.add(name)
    return found


def _effect_of(one: Candidate, name: str) -> Effect | None:
    """What has this parameter; None of the base's own."""
    return next((each for each in one.model.structure.composed if name in each.names), None)


def _surely(effect: Effect | None) -> float:
    """Standard errors of a size that chance makes as seldom as SURELY of one that was looked for in one place: a mode
    is looked for at every frequency, and noise has a little of either sign at some."""
    places = 1 if effect is None else max(1, *(len(each.grid) for each in effect.parameters))
    normal = NormalDist()
    return -normal.inv_cdf(normal.cdf(-SURELY) / places)


def _means_nothing(one: Candidate, name: str) -> bool:
    """Whether a parameter (a frequency, a time constant) acts only by sizes of its effect that may well be none."""
    structure, values = one.model.structure, one.model.values.copy()
    effect = _effect_of(one, name)
    if effect is None or not effect.linear:
        return False
    none, surely = False, _surely(effect)
    for parameter in effect.parameters:
        null, value = parameter.null, one.model[parameter.name]
        if null is None or not math.isfinite(null) or parameter.name == name:
            continue
        if abs(value - null) <= surely * one.standard_errors[parameter.name]:
            values[structure.names.index(parameter.name)], none = null, True
    if not none:
        return False
    try:
        answers = [respond(structure, values, group, True) for group in one.dataset.stacks]
    except RelaxationError:  # without its sizes the model's own response does not settle
        return False
    moved = [np.linalg.norm(each.slopes[structure.names.index(name)] * one.model[name]) for each in answers]
    return bool(np.linalg.norm(moved) <= INDEPENDENT * np.linalg.norm([np.linalg.norm(each.Y) for each in answers]))


def _at_bound_beside(one: Candidate, name: str) -> tuple[str, ...]:
    """Other parameters of the same effect that are at their bounds: the vehicle's need not be."""
    effect = _effect_of(one, name)
    own = () if effect is None else effect.names
    return tuple(each for each in own if each != name and each in one.estimate.at_bound and each not in one.held)


def _error_off_bounds(one: Candidate, name: str, beside: Sequence[str], whitening: Whitening) -> float:
    """What the standard error of a parameter were, if it and those beside it might move on from their bounds; infinite
    where it does nothing that they could not."""
    structure, values = one.model.structure, one.model.values
    places = [structure.names.index(each) for each in (name, *beside)]
    moved = whitening([respond(structure, values, group, True).slopes[places] for group in one.dataset.stacks])
    others = [*moved[1:], *(row for each, row in zip(one.free, whitening(one.J), strict=True) if each != name)]
    own = moved[0]
    if others:
        J = np.stack(others)
        own = own - np.linalg.lstsq(J.T, own, rcond=1e-10)[0] @ J
    size = float(np.linalg.norm(own))
    return 1 / size if size > INDEPENDENT * float(np.linalg.norm(moved[0])) else math.inf


def rank(one: Ranked) -> tuple[int, float]:
    if one.fit is not None:
        return (0, one.delta_bic)
    if one.score is not None and one.not_testable is None:
        return (1, -one.score.chi_squared)
    return (2, 0.0)


def noise_shares(best: Candidate, terms: Selection | None) -> FloatArray:
    """N by output: what the likeliest candidate leaves, less what of that the commands or a simple term explain.

    What a division seems to find where it finds nothing significant is left where it is.
    """
    whole = best.estimate.error.shares
    left = best.division
    if log_chance(left.chi_squared, left.degrees) < SIGNIFICANT:
        linear = whole * left.noise_share
    else:
        linear = whole
    if terms is None or not terms.terms:
        return linear
    simple = terms.error.shares
    return simple if float(np.sum(simple)) < float(np.sum(linear)) else linear
