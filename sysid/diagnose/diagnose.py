"""Which physical effect is missing: every testable entry of the catalogue asked, the serious refitted, one verdict.

`complete`: what the model leaves is noise, as far as these runs can tell. `missing`: one effect, or a chain of two,
explains at least EXPLAINED of what can be explained, on fitted and validation runs, at plausible values. `unexplained`:
there is something to explain, and nothing known does it; an effect that does so at values that physics does not allow
stands in for something else.

Ranking is by how much more likely an effect makes the data under the noise's own spectrum (`sysid.diagnose.evidence`),
less a penalty for its parameters. The thresholds below were set on flights with known answers and are frozen (`make
study`).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from typing import Any

import numpy as np

from sysid.data.preprocess import DEFAULT_BAND_HZ
from sysid.data.record import Record
from sysid.diagnose.evidence import (
    Candidate,
    Ground,
    Metric,
    Score,
    Settled,
    candidate,
    error_share,
    gain,
    ground,
    log_chance,
    metric,
    refit,
    score,
    settle,
)
from sysid.diagnose.initial_states import judged
from sysid.diagnose.size_check import Size, sizes
from sysid.diagnose.terms import Selection, search, select
from sysid.errors import FitError
from sysid.fit.estimate import estimate
from sysid.fit.noise import Division
from sysid.fit.output_error import OutputError
from sysid.fit.result import finite
from sysid.model.bases import adapted, compose, not_testable
from sysid.model.effect import Effect, EffectError, catalogue
from sysid.model.relaxation import RelaxationError
from sysid.model.structure import FloatArray, Model, Structure

FORMAT = "tippath.diagnosis/1"
EXPLAINED = 0.8
"""Of what can be explained, on the fitted runs;"""
VALIDATED = 0.5
"""and on validation runs alone: another amplitude shows a nonlinear effect that is only nearly the right one."""
UNHELD = 0.16
"""Share by which a size surely differs on the validation runs, from which on the entry only resembles what is there. On
flights with seeds below 100 right answers reached 0.13 (three worn links, which are no one play) and mostly 0; plays
and limits that only resembled 0.20 to 0.47, but for one of 0.05."""
SIGNIFICANT = math.log(1e-4)
"""Of all questions asked together; logarithm of the nominal chance that noise alone answers so. On clean flights one in
a hundred is found below it: the noise is not quite what the questions take it for."""
QUESTIONS = 3
"""Kinds of them: the commands against the residual, the catalogue, the library of terms."""
SERIOUS = 0.02
"""Share of the best score from which on a candidate is refitted,"""
SERIOUS_SLOW = 0.1
"""and where a refit takes simulations or a long search."""
FEW_POINTS = 8
NEAR = 0.7
"""Of what the best linear entry explains, that the score of another must reach to be refitted all the same."""
PARENTS_OF_PAIRS = 3
MOST_FIRSTS = 5
ALIKE = 0.2
"""Of what two effects explain, by which their answers must differ to begin two chains."""
SECONDS = 4
"""How many effects are refitted on each of them."""
REMAINDER = 0.05
"""Share of what can be explained, left by the best effect, from which on a second one is looked for."""
SAME = 10.0
"""Chi squared by which one candidate must be likelier than another to be told from it, or what it leaves itself;"""
TIED = 1.0
"""and below which the more usual one is named first."""
SURE = 0.9
"""Confidence from which on an answer counts as sure."""
LITTLE = 0.05
"""Explainable power over noise, below which powers are too uncertain to divide."""
SLACK = 2.0
"""Standard deviations."""
LEAD_SCALE = 20.0
"""Chi squared of lead or misfit that counts as none."""
CONFIDENCE = (-1.2, 2.8, -5.0)
"""Logit of being right: constant, per unit of lead, per share left unexplained; set on flights with seeds below 100."""
UNEXPLAINED_RIGHT, COMPLETE_RIGHT = 0.85, 0.98
"""How often these verdicts were right there."""
IN_A_LOOP_RIGHT = 0.5
"""At most, where the model that was found is unstable: a loop that nothing excited made the data what they are."""
Progress = Callable[[str], None]
Simple = Callable[[Candidate], Selection]
"""The simple terms beside a candidate; each is asked once."""


def _quiet(_: str) -> None:
    return None


@dataclass(frozen=True, eq=False)
class Judged:
    """One candidate with all that is known of it."""

    effects: tuple[str, ...]
    """Added to the parent."""
    score: Score | None
    not_testable: str | None
    """Why it was not asked, or not answered; None where it was."""
    fit: Candidate | None = None
    settled: Settled | None = None
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
    resolved: tuple[str, ...] = ()
    """Parameters of the parent that were implausible and are not any more."""
    rows: int = 1

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
            model = self.fit.model
            own = [one for one in model.structure.composed if (one.path or one.id) in self.effects]
            names = [name for one in own for name in one.names] or list(model.structure.names)
            return {name: model[name] for name in names}
        return {} if self.score is None else dict(self.score.at)

    @property
    def standard_errors(self) -> dict[str, float]:
        """Of `values`, where the refit gives any."""
        if self.fit is None:
            return {} if self.score is None else dict(self.score.errors)
        names = self.fit.model.structure.names
        errors = np.sqrt(np.diag(self.fit.estimate.covariance))
        return {name: float(errors[names.index(name)]) for name in self.values if errors[names.index(name)] > 0}

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


@dataclass(frozen=True, eq=False)
class Diagnosis:
    """The verdict and what it stands on."""

    verdict: str
    """`complete`, `missing` or `unexplained`."""
    effect: str | None
    stands_in: bool
    chain: tuple[str, ...]
    """The best one or two effects, the larger first; empty where the model is complete."""
    indistinguishable: tuple[str, ...]
    confidence: float
    explained_share: float | None
    candidates: tuple[Judged, ...]
    """Best first, those that could not be asked last."""
    pairs: tuple[Judged, ...]
    parent: Candidate
    settled: Settled
    metric: Metric
    division: Division
    noise_share: float
    """N: the part of the parent's error share that nothing recorded explains."""
    noise_floor_percent: Mapping[str, float]
    """NRMSE that a perfect model would reach on the fitted runs."""
    validation: Ground | None
    validation_nrmse_percent: Mapping[str, float] | None
    log_chance: float
    """That noise alone shows as much; all questions counted in."""
    terms: Selection | None
    """Simple terms beside the best candidate, where something is missing."""
    lead: float | None
    """Logarithm of how far the winner is ahead, which the confidence is made from; None where nothing is named."""
    sizes: tuple[Size, ...] = ()
    """The winner's on fitted and validation runs, where both determine them; the most different first."""

    @property
    def unheld(self) -> tuple[Size, ...]:
        """Sizes that the validation runs contradict."""
        return tuple(one for one in self.sizes if one.off > UNHELD)

    @property
    def winner(self) -> Judged | None:
        """The effect, or the chain of two, that explains most; None where the model is complete."""
        return next((one for one in (*self.candidates, *self.pairs) if set(one.effects) == set(self.chain)), None)

    @property
    def placebo(self) -> Judged | None:
        """The best wrong effect: told from the winner by the data, with at most as many parameters."""
        return None if self.winner is None else _placebo(self.winner, self.candidates)

    @property
    def runner_up(self) -> Judged | None:
        """The plausible single effect next to the winner."""
        for one in self.candidates:
            if one.fit is not None and not one.implausible and not set(one.effects) & set(self.chain):
                return one
        return None

    def simple(self) -> Selection:
        """The simple terms that explain most beside the structure itself, without any effect of the catalogue."""
        return select(self.parent, self.metric)

    def placebo_of(self, effect: str) -> Judged | None:
        """The best wrong effect beside this one, taken for the right one; None where nothing was refitted."""
        right = next((one for one in self.candidates if one.effects == (effect,)), None)
        return None if right is None else _placebo(right, self.candidates)

    def to_json(self) -> dict[str, Any]:
        """The `tippath.diagnosis/1` document, but for what could hide, the character and the next maneuver."""
        placebo = self.placebo
        return {
            "format": FORMAT,
            "verdict": self.verdict,
            "effect": self.effect,
            "chain": list(self.chain),
            "stands_in": self.stands_in,
            "indistinguishable": list(self.indistinguishable),
            "confidence": finite(self.confidence),
            "explained_share": None if self.explained_share is None else finite(self.explained_share),
            "candidates": [one.to_json() for one in self.candidates],
            "pairs": [one.to_json() for one in self.pairs],
            "placebo": None if placebo is None else placebo.effect,
            "nrmse_percent": self.parent.nrmse_percent,
            "validation_nrmse_percent": None
            if self.validation_nrmse_percent is None
            else dict(self.validation_nrmse_percent),
            "noise_floor_percent": {name: finite(value) for name, value in self.noise_floor_percent.items()},
            "lead": None if self.lead is None else finite(self.lead),
            "sizes": [one.to_json() for one in self.sizes],
            "log10_chance": finite(self.log_chance / math.log(10)),
        }


def _placebo(right: Judged, candidates: Sequence[Judged]) -> Judged | None:
    if right.settled is None:
        return None
    for one in candidates:
        told = one.settled is not None and gain(right.settled, one.settled)[0] >= SAME
        if told and one.added <= right.added and one.effect not in right.effects:
            return one
    return None


def diagnose(
    structure: Structure,
    records: Sequence[Record],
    validation: Sequence[Record] = (),
    band_hz: tuple[float, float] = DEFAULT_BAND_HZ,
    *,
    effects: Sequence[Effect] = (),
    fixed: Mapping[str, float] | None = None,
    begin: Model | None = None,
    say: Progress = _quiet,
    chains: bool = True,
) -> Diagnosis:
    """Diagnose a structure on runs. `effects` are a user's own, asked beside the catalogue's; `chains` of two too.

    `begin` is where the structure was fitted to, if it was. Raises FitError where the runs do not identify the
    structure itself.
    """
    on = ground(records, band_hz)
    judging = ground(validation, band_hz, on) if validation else None
    held = dict(fixed or {})
    if begin is not None:
        begin = Model(structure, begin.values) if begin.structure.names == structure.names else None
    found = estimate(structure, on.viewed(structure), begin, held)
    parent = candidate(found, tuple(held), on)
    by = metric(parent.model, on.stacks, parent.division)
    settled = settle(parent, by)
    say("the structure as it is")

    asked = _ask_all(parent, settled, by, effects, say)
    chance = _chance(parent.division, [one.score for one in asked if one.score is not None])
    if chance >= SIGNIFICANT:
        simple = search(parent, settled, by, most=1)
        chance = min([chance, *(one.log_p + math.log(QUESTIONS) for one in simple)])
        say("simple terms")
    refitted = _refit_serious(asked, parent, effects, say) if chance < SIGNIFICANT else asked
    fits = [one for one in refitted if one.fit is not None]
    best_fit = min([parent, *(one.fit for one in fits if one.fit is not None)], key=lambda one: one.error_share)
    by = metric(best_fit.model, on.stacks, best_fit.division)
    settled = settle(parent, by)
    refitted = [_weighed(one, parent, settled, by, judging) for one in refitted]
    refitted.sort(key=_order)

    @cache
    def beside(one: Candidate) -> Selection:
        return select(one, by)

    pairs = []
    if chains and chance < SIGNIFICANT:
        pairs = _pairs(refitted, parent, settled, by, effects, judging, beside, say)
    return _verdict(parent, settled, by, refitted, pairs, chance, judging, beside)


# ------------------------------------------------------------------------------------------------ asking


def _compositions(parent: Structure, effect: Effect, on: Ground) -> Structure:
    return compose(parent.base, [*parent.composed, effect], on.available, {**on.constants, **dict(parent.constants)})


def _ask_all(parent: Candidate, settled: Settled, by: Metric, users: Sequence[Effect], say: Progress) -> list[Judged]:
    """Every entry that the parent does not have, with its score or why there is none."""
    structure, on = parent.model.structure, parent.ground
    present = {one.id for one in structure.composed}
    found = []
    for effect in (*catalogue().values(), *users):
        name = effect.path or effect.id
        if name in structure.effects or effect.id in present or (effect.id == "flapping" and structure.base == "tpp"):
            continue
        reason = _reason(effect, parent)
        if reason is not None:
            found.append(Judged((name,), None, reason))
            continue
        try:
            composed = _compositions(structure, effect, on)
        except EffectError as error:
            found.append(Judged((name,), None, str(error)))
            continue
        if composed.base != structure.base:
            found.append(Judged((name,), None, None))
            continue
        answer = score(effect, composed, parent, settled, by)
        reason = None if answer is not None else "it does nothing on these runs that the structure could not do itself"
        found.append(Judged((name,), answer, reason))
        say(name)
    return found


def _reason(effect: Effect, parent: Candidate) -> str | None:
    structure, on = parent.model.structure, parent.ground
    ids = [one.id for one in structure.composed]
    reason = not_testable(effect, structure.base, [*ids, effect.id], on.available)
    if reason is None:
        return None
    without = not_testable(effect, structure.base, [*ids, effect.id], on.available | on.still)
    if without is None:
        read = adapted(effect, structure.base, [*ids, effect.id], on.available | on.still).channels
        still = sorted({name for said in read for name in said.split("|")} & on.still)
        return f"{', '.join(still)} hardly moves on these runs, so it is not testable on these"
    return reason


def _chance(division: Division, scores: Sequence[Score]) -> float:
    """Logarithm of the chance that noise alone shows as much as the best of all questions."""
    linear = log_chance(division.chi_squared, division.degrees)
    best = min((one.log_p for one in scores), default=0.0) + math.log(max(len(scores), 1))
    return min(0.0, min(linear, best) + math.log(QUESTIONS))


def _refit_serious(asked: Sequence[Judged], parent: Candidate, users: Sequence[Effect], say: Progress) -> list[Judged]:
    """Refits of what may be the answer: the linear entries first, which take milliseconds.

    An entry that takes simulations is refitted where the linear ones leave more than noise, or where its score alone
    comes near to what the best of them explains.
    """
    top = max((one.score.chi_squared for one in asked if one.score is not None), default=0.0)
    found: dict[tuple[str, ...], Judged] = {}
    for one in asked:
        share = math.inf if one.score is None else one.score.chi_squared / max(top, 1e-300)
        if one.not_testable is None and _quick(one) and share >= SERIOUS:
            found[one.effects] = _refitted(one, parent, users)
            say(one.effect)
    fits = [one.fit for one in found.values() if one.fit is not None]
    best = min(fits, key=lambda one: one.error_share, default=parent)
    left = best.division
    before = parent.error_share - best.error_share
    open_question = (
        before <= 0
        or float(
            np.sum((1 - left.noise_share) * best.estimate.error.residual_power / best.estimate.error.measured_power)
        )
        > REMAINDER * before
    )
    by = metric(best.model, parent.ground.stacks, left)
    explained = gain(settle(best, by), settle(parent, by))[0] if best is not parent else 0.0
    for one in asked:
        if one.not_testable is not None or _quick(one) or one.score is None:
            continue
        near = one.score.chi_squared > NEAR * explained
        if one.score.chi_squared >= SERIOUS_SLOW * top and (near or open_question):
            found[one.effects] = _refitted(one, parent, users)
            say(one.effect)
    return [found.get(one.effects, one) for one in asked]


def _quick(one: Judged) -> bool:
    """Whether a refit takes milliseconds: a linear entry without many valleys to search."""
    known = catalogue()
    return one.effect in known and known[one.effect].linear and (one.score is None or one.score.tried <= FEW_POINTS)


def _refitted(one: Judged, parent: Candidate, users: Sequence[Effect]) -> Judged:
    try:
        composed = _compositions(parent.model.structure, _effect(one.effect, users), parent.ground)
        fit = refit(composed, parent, one.effects)
    except (FitError, EffectError, RelaxationError, np.linalg.LinAlgError) as error:
        return replace(one, not_testable=str(error))
    return replace(one, fit=fit)


def _effect(name: str, users: Sequence[Effect]) -> Effect:
    known = catalogue()
    return known[name] if name in known else next(one for one in users if one.path == name)


def _weighed(one: Judged, parent: Candidate, settled: Settled, by: Metric, judging: Ground | None) -> Judged:
    if one.fit is None:
        return one
    own = settle(one.fit, by)
    likelier, _ = gain(own, settled)
    model = one.fit.model
    before = {
        parameter.name
        for parameter, value in zip(parent.model.structure.parameters, parent.model.values, strict=True)
        if parameter.implausible(float(value))
    }
    now = {
        parameter.name
        for parameter, value in zip(model.structure.parameters, model.values, strict=True)
        if parameter.implausible(float(value))
    }
    validated = error = None
    if judging is not None:
        try:
            error = judged(model, judging)
        except (RelaxationError, np.linalg.LinAlgError):
            return replace(one, fit=None, not_testable="its response does not settle on the validation runs")
        validated = dict(zip(model.structure.outputs, map(float, error.nrmse_percent), strict=True))
    return replace(
        one,
        settled=own,
        chi_squared=likelier,
        added=len(one.fit.J[0]) - len(parent.J[0]),
        rows=settled.residual.size,
        implausible=tuple(name for name in model.structure.names if name in now - before),
        resolved=tuple(sorted(before - now)),
        validation_nrmse_percent=validated,
        validation_error=error,
    )


def _order(one: Judged) -> tuple[int, float]:
    if one.fit is not None:
        return (0, one.delta_bic)
    if one.score is not None and one.not_testable is None:
        return (1, -one.score.chi_squared)
    return (2, 0.0)


# ------------------------------------------------------------------------------------------------ chains of two


def _pairs(
    singles: Sequence[Judged],
    parent: Candidate,
    settled: Settled,
    by: Metric,
    users: Sequence[Effect],
    judging: Ground | None,
    simple: Simple,
    say: Progress,
) -> list[Judged]:
    """The best second effects on the best first ones, where those leave something that is not noise."""
    found: dict[tuple[str, ...], Judged] = {}
    fitted = [one for one in singles if one.fit is not None]
    able = [one for one in fitted if one.delta_bic < 0]
    if not able or _remainder(able[0], parent, simple) < REMAINDER:
        return []
    alone = {one.effect: one for one in fitted if not one.implausible}

    def chained(first: Judged, second: Judged) -> None:
        """Fit the second beside the first."""
        names = tuple(sorted((first.effect, second.effect)))
        say(" + ".join((first.effect, second.effect)))
        ends = [(second, first)]
        while ends:
            more, begin = ends.pop()
            assert begin.fit is not None
            again = _refitted(more, begin.fit, users)
            if again.fit is None:
                continue
            both = replace(again, effects=(first.effect, second.effect), fit=replace(again.fit, added=names))
            weighed = _weighed(both, parent, settled, by, judging)
            if weighed.fit is not None and (names not in found or weighed.delta_bic < found[names].delta_bic):
                found[names] = weighed
            if begin is first and weighed.implausible and second.effect in alone:
                # alone, the first one stands in for the second too, and may not come away from there
                ends.append((first, alone[second.effect]))

    waiting, done = _different(able), set[str]()
    while waiting and len(done) < MOST_FIRSTS:
        first = waiting.pop(0)
        done.add(first.effect)
        assert first.fit is not None
        assert first.settled is not None
        seconds = _ask_all(first.fit, first.settled, by, users, _quiet)
        if _chance(first.fit.division, [one.score for one in seconds if one.score is not None]) >= SIGNIFICANT:
            if first is able[0]:
                return []  # the best one alone leaves noise
            continue
        chosen = sorted((one for one in seconds if one.not_testable is None), key=_promise)[:SECONDS]
        for second in chosen:
            names = tuple(sorted((first.effect, second.effect)))
            if names in found or (second.score is not None and second.score.log_p > SIGNIFICANT):
                continue
            chained(first, second)
        if not waiting and found:
            # each half of the best chain may have another partner that does better still
            best = min(found.values(), key=lambda one: one.delta_bic)
            waiting = [one for one in fitted if one.effect in best.effects and one.effect not in done]
    if found:
        best = min(found.values(), key=lambda one: one.delta_bic)
        for half, other in (best.effects, best.effects[::-1]):
            # what alone explains the same as a half may stand in its place
            for one in [one for one in alone.values() if half in alone and not _apart(one, alone[half])]:
                if one.effect not in best.effects and tuple(sorted((one.effect, other))) not in found:
                    chained(one, Judged((other,), None, None))
    return sorted(found.values(), key=_order)


def _different(able: Sequence[Judged]) -> list[Judged]:
    """The best effects to begin a chain with: the best, then plausible ones that do something else than those."""
    chosen = [able[0]]
    for one in able[1:]:
        if len(chosen) == PARENTS_OF_PAIRS:
            break
        if not one.implausible and all(other.implausible or _apart(one, other) for other in chosen):
            chosen.append(one)
    return chosen


def _apart(one: Judged, other: Judged) -> bool:
    """Whether two effects explain different things: how far their answers are apart, beside what they explain."""
    assert one.settled is not None
    assert other.settled is not None
    return gain(one.settled, other.settled)[1] > ALIKE * min(one.chi_squared, other.chi_squared)


def _remainder(one: Judged, parent: Candidate, simple: Simple) -> float:
    """Share of what can be explained that this effect leaves, as far as the commands or a simple term explain it."""
    assert one.fit is not None
    fit = one.fit

    def left(terms: Selection | None) -> float:
        rest = fit.error_share - float(np.sum(_noise(fit, terms)))
        return rest / max(parent.error_share - fit.error_share + rest, 1e-300)

    linear = left(None)
    return linear if linear >= REMAINDER else left(simple(fit))  # a limit leaves nothing linear


def _promise(one: Judged) -> float:
    return -math.inf if one.score is None else -one.score.chi_squared


# ------------------------------------------------------------------------------------------------ the verdict


def _verdict(
    parent: Candidate,
    settled: Settled,
    by: Metric,
    singles: list[Judged],
    pairs: list[Judged],
    chance: float,
    judging: Ground | None,
    simple: Simple,
) -> Diagnosis:
    fits = [one for one in (*singles, *pairs) if one.fit is not None]
    likeliest = min(fits, key=lambda one: one.delta_bic, default=None)
    if likeliest is not None and likeliest.delta_bic >= 0:
        likeliest = None
    best = parent if likeliest is None or likeliest.fit is None else likeliest.fit
    found = chance < SIGNIFICANT
    terms = simple(best) if found else None
    noise = _noise(best, terms) if found else _power(best)
    N, E0 = float(np.sum(noise)), parent.error_share
    outputs = parent.model.structure.outputs
    floor = dict(zip(outputs, map(float, 100 * (1 - np.sqrt(noise))), strict=True))
    judge = None if judging is None else _Judge.of(parent, likeliest, judging)

    def with_share(one: Judged) -> Judged:
        if one.fit is None:
            return one
        share = float(np.clip((E0 - one.fit.error_share) / max(E0 - N, 1e-300), 0, 1))
        if judge is None:
            return replace(one, explained_share=share)
        return replace(one, explained_share=share, validation_share=judge.share(one), validation_slack=judge.slack)

    singles, pairs = [with_share(one) for one in singles], [with_share(one) for one in pairs]
    verdict, stands_in, confidence = "complete", False, -math.expm1(chance) if found else COMPLETE_RIGHT
    effect: str | None = None
    chain: tuple[str, ...] = ()
    share: float | None = None
    alike: tuple[str, ...] = ()
    compared: tuple[Size, ...] = ()
    lead, short = None, 0.0
    if found:
        winner = _winner(singles, pairs)
        verdict, share = "unexplained", 0.0
        if winner is not None:
            chain = _larger_first(winner, singles)
            share = winner.explained_share or 0.0
            enough = _enough(winner, E0, N)
            stands_in = bool(winner.implausible) and enough
            if enough and not stands_in and winner.fit is not None:
                compared = () if judging is None else sizes(winner.fit, winner.effects, judging)
                if all(one.off <= UNHELD for one in compared):
                    verdict = "missing"
            effect = chain[0] if verdict == "missing" or stands_in else None
            alike = _alike(winner, singles if len(chain) == 1 else pairs)
            if verdict == "missing":
                lead, short = _lead(winner, alike, singles)
        confidence = UNEXPLAINED_RIGHT if lead is None else _logistic(CONFIDENCE, lead, short)
        if verdict == "missing" and winner is not None and winner.fit is not None and not winner.fit.model.stable:
            confidence = min(confidence, IN_A_LOOP_RIGHT)
    return Diagnosis(
        verdict,
        effect,
        stands_in,
        chain,
        alike,
        confidence,
        share,
        tuple(singles),
        tuple(pairs),
        parent,
        settled,
        by,
        parent.division,
        N,
        floor,
        judging,
        None if judge is None else judge.nrmse_percent,
        chance,
        terms,
        lead,
        compared,
    )


def _power(one: Candidate) -> FloatArray:
    """Residual over measured power by output."""
    return np.asarray(one.estimate.error.residual_power / one.estimate.error.measured_power)


def _noise(best: Candidate, terms: Selection | None) -> FloatArray:
    """N by output: what the likeliest candidate leaves, less what of that the commands or a simple term explain.

    What a division seems to find where it finds nothing significant is left where it is.
    """
    whole = _power(best)
    left = best.division
    if log_chance(left.chi_squared, left.degrees) < SIGNIFICANT:
        linear = whole * left.noise_share
    else:
        linear = whole
    if terms is None or not terms.terms:
        return linear
    simple = np.asarray(terms.error.residual_power / terms.error.measured_power)
    return simple if float(np.sum(simple)) < float(np.sum(linear)) else linear


@dataclass(frozen=True, eq=False)
class _Judge:
    """Validation runs: what can be explained there, by the same measure as on the fitted runs."""

    nrmse_percent: dict[str, float]
    """The parent's."""
    before: float
    """The parent's error share."""
    noise: float
    scatter: float
    """Of the noise's share from run to run, one standard deviation."""

    @classmethod
    def of(cls, parent: Candidate, likeliest: Judged | None, judging: Ground) -> _Judge:
        error = judged(parent.model, judging)
        outputs = parent.model.structure.outputs
        before = least = error_share(error)
        level = parent.division
        if likeliest is not None and likeliest.fit is not None and likeliest.validation_error is not None:
            least, level = error_share(likeliest.validation_error), likeliest.fit.division
        air = np.concatenate(
            [np.real(np.einsum("fkk->fk", level.at(group.frequency_hz))) for group in judging.stacks]
        )  # (bins, k), the noise of the fitted runs on these bins
        expected = float(np.sum(np.sum(air, axis=0) / error.measured_power))
        scatter = float(np.sqrt(np.sum(np.sum(air**2, axis=0) / error.measured_power**2)))
        nrmse = dict(zip(outputs, map(float, error.nrmse_percent), strict=True))
        return cls(nrmse, before, min(least, before, expected), scatter)

    @property
    def slack(self) -> float:
        """How far off a share may be by the chance of the noise in these runs alone."""
        return SLACK * self.scatter / max(self.before - self.noise, 1e-300)

    def share(self, one: Judged) -> float | None:
        """Of what can be explained there; None where the runs cannot tell."""
        if self.slack > 1 or one.validation_error is None:
            return None
        error = error_share(one.validation_error)
        return float(np.clip((self.before - error) / max(self.before - self.noise, 1e-300), -1, 1))


def _enough(one: Judged, E0: float, N: float) -> bool:
    """Whether it explains what can be explained; by the noise's own measure where that is little beside the noise."""
    assert one.fit is not None
    share = one.explained_share or 0.0
    if E0 - N < LITTLE * N:
        left = one.fit.division
        rest = max(0.0, left.chi_squared - left.degrees)
        share = max(share, one.chi_squared / max(one.chi_squared + rest, 1e-300))
    if one.validation_share is None:
        return share >= EXPLAINED
    judged = min(1.0, one.validation_share + one.validation_slack)
    return share >= EXPLAINED and judged >= VALIDATED


def _winner(singles: Sequence[Judged], pairs: Sequence[Judged]) -> Judged | None:
    """The likeliest effect; a chain of two only where it explains clearly more."""
    single = next((one for one in singles if one.fit is not None and one.delta_bic < 0), None)
    pair = next((one for one in pairs if one.delta_bic < 0), None)
    if single is None:
        return pair
    single = _likeliest_in_practice(single, singles)
    if pair is None or pair.delta_bic >= single.delta_bic:
        return single
    more = (pair.explained_share or 0.0) - (single.explained_share or 0.0)
    return _likeliest_in_practice(pair, pairs) if more > REMAINDER else single


def _lead(winner: Judged, alike: Sequence[str], singles: Sequence[Judged]) -> tuple[float, float]:
    """How far the winner is ahead of the best rival, beside what it leaves itself; and how far from explaining all, on
    fitted or on validation runs."""
    assert winner.settled is not None
    misfit = _misfit(winner)
    leads = [
        gain(winner.settled, one.settled)[0] + one.added - winner.added
        for one in singles
        if one.settled is not None and not set(one.effects) & {*winner.effects, *alike} and not one.implausible
    ]
    lead = max(0.0, min([*leads, winner.chi_squared]))
    ratio = math.log((misfit + lead + LEAD_SCALE) / (misfit + LEAD_SCALE))
    shares = [winner.explained_share or 0.0, *([] if (on := winner.validation_share) is None else [on])]
    return ratio, min(1.0, max(0.0, 1 - min(shares)))


def _logistic(weights: Sequence[float], lead: float, short: float) -> float:
    return 1 / (1 + math.exp(-(weights[0] + weights[1] * lead + weights[2] * short)))


def _misfit(one: Judged) -> float:
    """Chi squared that a candidate leaves beyond noise: real vehicles are built of no entry exactly."""
    assert one.fit is not None
    left = one.fit.division
    return max(0.0, left.chi_squared - left.degrees)


def _likeliest_in_practice(winner: Judged, others: Sequence[Judged]) -> Judged:
    """Of candidates that the data cannot tell from the winner: a plausible one, of the most usual size."""
    assert winner.settled is not None
    settled = winner.settled
    near = max(SAME, 2 * _misfit(winner))
    alike = [
        one
        for one in others
        if one.settled is not None and _stands_beside(one, winner, gain(settled, one.settled)[0], near)
    ]
    return min(alike, key=_unusual, default=winner)


def _stands_beside(one: Judged, winner: Judged, behind: float, near: float) -> bool:
    """Whether it may be named instead: as likely with as many parameters, or nearly so where only it is plausible."""
    if winner.implausible and not one.implausible:
        return behind < near
    return abs(behind) < TIED and one.added == winner.added


def _unusual(one: Judged) -> tuple[bool, float]:
    """Implausible ones last; then how far, in powers of e, the sizes are from those met in practice."""
    assert one.fit is not None
    model = one.fit.model
    usual = {parameter.name: parameter.typical for parameter in model.structure.parameters}
    off = [
        abs(math.log(max(abs(value), 1e-300) / abs(usual[name])))
        for name, value in one.values.items()
        if usual.get(name) and math.isfinite(value)
    ]
    return bool(one.implausible), max(off, default=0.0)


def _larger_first(winner: Judged, singles: Sequence[Judged]) -> tuple[str, ...]:
    alone = {one.effect: one.chi_squared for one in singles if one.fit is not None}
    return tuple(sorted(winner.effects, key=lambda name: -alone.get(name, 0.0)))


def _alike(winner: Judged, others: Sequence[Judged]) -> tuple[str, ...]:
    """Effects that may stand in the winner's place, or in that of one of its two."""
    assert winner.settled is not None
    near = max(SAME, _misfit(winner))
    same = [
        one
        for one in others
        if one.settled is not None
        and set(one.effects) != set(winner.effects)
        and not one.implausible
        and gain(winner.settled, one.settled)[0] + (one.added - winner.added) < near
    ]
    return tuple(dict.fromkeys(name for one in same for name in one.effects if name not in winner.effects))
