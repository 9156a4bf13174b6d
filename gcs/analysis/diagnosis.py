"""A fit is asked what it lacks: the verdict, what it stands on, and what is told beside it.

The mathematics is `sysid.diagnose.diagnose`; here the answer is added and the question asked again, and what else is to
be known is brought together. `gcs.analysis.text.diagnosis` puts it into words. Both serve the command line and the app.

A repeated question stops where the answer is not sure, or, added, takes the fit to values that physics does not allow:
what is asked of such a fit is answered about the wrong vehicle.
"""

from __future__ import annotations

import contextlib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from gcs.analysis.ladder import SLIGHT, Step, together
from gcs.analysis.refit import Band, as_answered, made_from, newly_implausible, refitted
from gcs.vehicle.sweeps import chirps_only, flies_cards
from sysid.compare.compare import compare
from sysid.compare.values import Comparison
from sysid.data.dataset import Dataset, Runs, prepared
from sysid.data.preprocess import RESPONSE
from sysid.data.record import Record
from sysid.diagnose.candidates import Ranked
from sysid.diagnose.clocks import clocks
from sysid.diagnose.could_hide import could_hide
from sysid.diagnose.diagnose import diagnose
from sysid.diagnose.evidence import Candidate, instrumental_step
from sysid.diagnose.explain import Explanation, explain
from sysid.diagnose.hidden import CouldHide
from sysid.diagnose.loop_change import Limit, MarginChange, held_gains
from sysid.diagnose.matters import Remainder, judged, may_not_matter, remainder, shift, winner_change
from sysid.diagnose.next_maneuver import NextManeuver, linear_or_not, next_maneuver
from sysid.diagnose.progress import Asking, Listener, Stage, unheard
from sysid.diagnose.suggest import Suggestion, SuggestionError, suggest
from sysid.diagnose.unsearched import BudgetSpent, Unsearched
from sysid.diagnose.verdict import SURE, Diagnosis
from sysid.fit.check_kinds import CommandsLate, CommandsThinned
from sysid.fit.identify import on_runs
from sysid.fit.result import Fit, finite
from sysid.model.effect import Effect, named_effect

MOST_RUNGS = 6
NEARLY = 0.8
"""Of what the answer explains, that another explains to be its rival."""
UNSURE = 0.5
"""Confidence below which a repeated question stops: what is asked beside a guess is answered about the guess."""


@dataclass(frozen=True, slots=True)
class NoValidation:
    """No run judged the answer that was not fitted."""


@dataclass(frozen=True, slots=True)
class OneRun:
    """What differs from run to run cannot show."""


@dataclass(frozen=True, slots=True)
class NotAdded:
    """With the answer added the fit goes to values that physics does not allow."""

    effect: str
    values: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class NotSure:
    """An answer that is more likely wrong than right; nothing is asked beside it."""

    effect: str
    confidence: float


@dataclass(frozen=True, slots=True)
class StoppedAsking:
    """So many questions are enough."""

    questions: int


@dataclass(frozen=True, slots=True)
class InALoop:
    """The best model is unstable: feedback, and not the vehicle alone, made these data."""

    effects: tuple[str, ...]
    """Of the answer; empty where there is none."""
    pole: float
    """1/s, the fastest growing."""


@dataclass(frozen=True, slots=True)
class ClocksDiffer:
    """Not the vehicle, but the time of its commands explains what the model leaves."""

    early: CommandsLate | CommandsThinned


@dataclass(frozen=True, slots=True)
class LoopUntold:
    """The log thinned commands; they were taken as held for as short as these runs show."""

    thinned: CommandsThinned


@dataclass(frozen=True, slots=True)
class StepsLost:
    """Validation runs that did not judge: a log slower than the loop does not tell when their commands stepped."""

    runs: tuple[str, ...]
    """Their ids."""


@dataclass(frozen=True, slots=True)
class NoExcitation:
    """The commands stand for themselves: with gusts, feedback alone lets them explain some of the error."""


@dataclass(frozen=True, slots=True)
class NoMargins:
    """A limit was asked for, and no gains hold this fit, so that nothing could be held against it."""


Remark = (
    NoExcitation
    | NoMargins
    | NoValidation
    | OneRun
    | NotAdded
    | NotSure
    | StoppedAsking
    | InALoop
    | ClocksDiffer
    | LoopUntold
    | StepsLost
    | Unsearched
)


@dataclass(frozen=True, slots=True)
class Slight:
    """What an effect would do that gains little fit."""

    effect: str
    points: float
    """Of NRMSE fit, all outputs as one."""
    shift: float
    """Of a number of the base that gains hang on, relative, at most."""
    change: MarginChange | None
    """Of the loop that is designed without it; None where no loop tells."""
    limit: Limit

    @property
    def matters(self) -> bool | None:
        """Whether that is beyond the limit; None where no loop tells."""
        return None if self.change is None else self.change.over(self.limit) > 1

    def to_json(self) -> dict[str, Any]:
        """`effect`, `points`, `shift`, `gain_db`, `phase_deg`, `matters`."""
        change = self.change
        return {
            "effect": self.effect,
            "points": finite(self.points),
            "shift": finite(self.shift),
            "gain_db": None if change is None else finite(change.gain_db),
            "phase_deg": None if change is None else finite(change.phase_deg),
            "matters": self.matters,
        }


@dataclass(frozen=True, eq=False, kw_only=True)
class FitDiagnosis:
    """A diagnosis with all that is told beside it."""

    fit: Fit
    """The fit that the last question was about."""
    runs: Dataset
    """Those that were fitted."""
    last: Diagnosis
    comparison: Comparison
    """Of the last fit with its runs: where it fails."""
    rungs: tuple[Step, ...]
    added: Fit | None
    """With the winner, where one is missing."""
    explanation: Explanation
    hiding: CouldHide
    remainder: Remainder | None
    """What is left, and what it could do, where nothing is missing by name."""
    next: NextManeuver | None
    suggestion: Suggestion | None
    """The simple terms that explain most beside the structure, where something is left; asked for only."""
    remarks: tuple[Remark, ...] = ()
    """What these runs cost the answer."""
    slight: Slight | None = None
    """What is missing by name and gains little fit, or would be if it mattered."""
    as_usual: bool = True
    """Whether it was asked by itself: of the catalogue alone, with the usual limits, to the end."""

    @property
    def interrupted(self) -> bool:
        """Whether Ctrl-C ended the search, and this is what was found until then."""
        return _interrupted(self.last)

    @property
    def grown(self) -> Fit | None:
        """The fit with what was found added; None where nothing was."""
        return self.added or (self.fit if len(self.rungs) > 1 else None)


def diagnose_fit(
    fit: Fit,
    records: Runs,
    validation: Runs = (),
    quiet: Sequence[Record] = (),
    *,
    effects: Sequence[Effect] = (),
    band_hz: Band | None = None,
    repeat: bool = False,
    suggesting: bool = False,
    limit: Limit | None = None,
    say: Listener = unheard,
) -> FitDiagnosis:
    """Ask what a fit lacks; with `repeat`, add the answer and ask again until it is another one than `missing`.

    `effects` are a user's own, asked beside the catalogue's; `suggesting` looks for simple terms too; `limit` says
    which changes of margins matter, of what has a name as well. Raises SysidError where the runs do not identify the
    structure.
    """
    band = band_hz or fit.band_hz
    fitted, judging = prepared(records, band), prepared(validation, band)
    question = _Question(fitted, judging, effects, limit, say)
    composed: Sequence[Effect] = [*fit.model.structure.composed]
    if not made_from(fit, fitted, judging):
        fit = refitted(fit, composed, fitted, judging, band)
    rungs: list[Step] = []
    while True:
        answer, hiding, left = question.weighed(whole := question.ask(fit, composed))
        rungs.append(_step(answer))
        grown = question.grown(fit, composed, answer)
        wild = () if grown is None else newly_implausible(fit, grown)
        if not repeat or grown is None or wild or _unsure(answer) or len(rungs) >= MOST_RUNGS or _interrupted(answer):
            break
        fit, composed = grown, [*grown.model.structure.composed]
    remarks = _remarks(answer, fitted.records, judging.records)
    remarks += [NoMargins()] if limit is not None and held_gains(answer.parent.model) is None else []
    if repeat and grown is not None:
        remarks.append(_stopped(answer, wild))
        grown = grown if isinstance(remarks[-1], StoppedAsking) else None
    say(Asking(stage=Stage.FAILS))
    comparison = compare(answer.parent.model, answer.parent.dataset, fit.band_hz, quiet)
    say(Asking(stage=Stage.REASONS))
    explanation, slight = _explained(answer), _slight(whole, limit or Limit())
    say(Asking(stage=Stage.MANEUVER))
    return FitDiagnosis(
        fit=fit,
        runs=fitted,
        last=answer,
        comparison=comparison,
        rungs=tuple(rungs),
        added=grown,
        explanation=explanation,
        hiding=hiding or _hiding(answer, effects),
        remainder=left,
        suggestion=_suggested(answer, fit, len(fitted.records)) if suggesting else None,
        next=_by_card_or_hand(answer),
        remarks=tuple(remarks),
        slight=slight,
        as_usual=_as_usual(answer, effects, limit, repeat),
    )


def _remarks(answer: Diagnosis, fitted: Sequence[Record], judging: Sequence[Record]) -> list[Remark]:
    """What these runs cost this answer."""
    remarks: list[Remark] = [*_clocks_differ(answer), *remarks_on(fitted, judging)]
    remarks += [*(_in_a_loop(answer) or _no_excitation(answer)), *_not_judged(answer, judging)]
    return remarks if answer.unsearched is None else [*remarks, answer.unsearched]


def _as_usual(answer: Diagnosis, effects: Sequence[Effect], limit: Limit | None, repeat: bool) -> bool:
    return not (effects or repeat or limit is not None or _interrupted(answer))


def _slight(answer: Diagnosis, limit: Limit) -> Slight | None:
    """None of what gains much, or is not named."""
    winner = answer.winner
    if answer.verdict != "missing" or winner is None or winner.fit is None:
        return None
    points = together(winner.fit.nrmse_percent) - together(answer.parent.nrmse_percent)
    if points >= SLIGHT:
        return None
    return Slight("+".join(answer.chain), points, shift(answer), winner_change(answer), limit)


def _interrupted(answer: Diagnosis) -> bool:
    return isinstance(answer.unsearched, BudgetSpent) and answer.unsearched.interrupted


@dataclass(frozen=True, eq=False)
class _Question:
    """What is asked of one fit after the other: on which runs, of which effects of a user."""

    fitted: Dataset
    judging: Dataset
    users: Sequence[Effect]
    limit: Limit | None
    say: Listener

    def ask(self, fit: Fit, composed: Sequence[Effect]) -> Diagnosis:
        """What a fit with these effects lacks."""
        fitted, judging, had = self.fitted.records, self.judging.records, fit.model.structure
        structure = on_runs(had.base_, composed, [*fitted, *judging], fitted, had.outputs)
        held = {name: fit.model[name] for name in fit.fixed}
        return diagnose(
            structure,
            self.fitted,
            self.judging,
            self.fitted.band_hz,
            effects=self.users,
            fixed=held,
            begin=fit.model,
            say=self.say,
            limit=self.limit,
        )

    def weighed(self, answer: Diagnosis) -> tuple[Diagnosis, CouldHide | None, Remainder | None]:
        """The answer by what matters, with what could hide beside it; both None where it is missing by name."""
        if self.limit is None and not may_not_matter(answer):
            return answer, None, None
        self.say(Asking(stage=Stage.HIDING))
        hiding = _behind(answer.parent, answer, self.users)
        left = remainder(answer, hiding, self.limit)
        answer = judged(answer, left, asked=self.limit is not None)
        return (answer, None, None) if answer.verdict == "missing" else (answer, hiding, left)

    def grown(self, fit: Fit, composed: Sequence[Effect], answer: Diagnosis) -> Fit | None:
        """The fit with what is missing added; None where nothing is."""
        if answer.verdict != "missing" or answer.effect is None:
            return None
        begin = next(one.fit.model for one in answer.candidates if one.effect == answer.effect and one.fit is not None)
        effects = [*composed, named_effect(answer.effect, self.users)]
        fitted, judging = as_answered(answer, fit, self.fitted, self.judging)
        below = fit if made_from(fit, fitted, judging) else None
        return refitted(fit, effects, fitted, judging, grown=below, begin=begin)


def _unsure(answer: Diagnosis) -> bool:
    return answer.verdict == "missing" and answer.confidence < UNSURE


def _stopped(answer: Diagnosis, wild: tuple[str, ...]) -> NotAdded | NotSure | StoppedAsking:
    """Why a repeated question ends with an answer that could be added."""
    if wild:
        return NotAdded(str(answer.effect), wild)
    return NotSure(str(answer.effect), answer.confidence) if _unsure(answer) else StoppedAsking(MOST_RUNGS)


def _step(answer: Diagnosis) -> Step:
    validated = answer.validation_nrmse_percent
    return Step(
        effects=answer.parent.model.structure.effects,
        nrmse_percent=answer.parent.nrmse_percent,
        validation_nrmse_percent=None if validated is None else dict(validated),
        verdict=answer.verdict,
        effect=answer.effect,
        confidence=answer.confidence,
    )


def _explained(answer: Diagnosis) -> Explanation:
    complete = answer.verdict == "complete"
    return explain(answer.parent, answer.winner, answer.candidates, answer.not_told, complete=complete)


def _hiding(answer: Diagnosis, users: Sequence[Effect]) -> CouldHide:
    """What could hide behind the model with the answer, where one is missing."""
    winner = answer.winner
    missing = answer.verdict == "missing"
    return _behind(
        winner.fit if missing and winner is not None and winner.fit is not None else answer.parent, answer, users
    )


def _behind(last: Candidate, answer: Diagnosis, users: Sequence[Effect]) -> CouldHide:
    return could_hide(
        last.asked, instrumental_step(last.asked, answer.whitening), answer.whitening, answer.division, users
    )


def _suggested(answer: Diagnosis, fit: Fit, runs: int) -> Suggestion | None:
    """None for measured responses, too: most of the terms are not linear, and these know nothing else."""
    if of_responses(answer):
        return None
    structure = fit.model.structure
    with contextlib.suppress(SuggestionError):
        return suggest(answer.simple().terms, structure, runs)
    return None


def of_responses(answer: Diagnosis) -> bool:
    """Whether measured responses were asked: they tell of linear dynamics, and of no size of a command."""
    return any(one.maneuver == RESPONSE for one in answer.parent.dataset.records)


def _by_card_or_hand(found: Diagnosis) -> NextManeuver | None:
    """The next maneuver; without a card for runs of autopilots that fly none."""
    proposed = _next(found)
    if proposed is None or all(flies_cards(one.rate_source) for one in found.parent.dataset.records):
        return proposed
    return replace(proposed, card=None)


def _next(found: Diagnosis) -> NextManeuver | None:
    """Between the winner and what the data cannot tell from it, or the best two; for an unknown, linear or not.

    None for measured responses: nothing tells how large a command flew them.
    """
    winner = found.winner
    if found.verdict == "complete" or of_responses(found):
        return None
    if winner is None or winner.fit is None or (found.verdict == "unexplained" and not found.stands_in):
        return linear_or_not(found.parent, found.division)
    rivals = [one.fit for one in _not_told(found) if one.fit is not None]
    if not rivals and (second := rival(found)) is not None and second.fit is not None:
        rivals = [second.fit]
    if not rivals:
        return None
    asked = [one.asked for one in (winner.fit, *rivals)]
    doublets = not any(chirps_only(one) for one in found.parent.dataset.records)
    unfitted = None if found.thinned is not None else found.validation
    return next_maneuver(asked, winner.fit.division, found.whitening, doublets=doublets, unfitted=unfitted)


def _not_told(found: Diagnosis) -> Iterator[Ranked]:
    """Of the same runs, what the data cannot tell from the winner."""
    others = found.candidates if len(found.chain) == 1 else found.pairs
    yield from (one for one in others if set(one.effects) & {*found.not_told})
    yield from (one for one in found.pairs if one.effects in found.indistinguishable_pairs)


def rival(found: Diagnosis) -> Ranked | None:
    """The next effect, where the answer is not sure and that one explains nearly as much."""
    winner, second = found.winner, found.runner_up
    if winner is None or second is None or (found.verdict == "missing" and found.confidence >= SURE):
        return None
    near = (second.explained_share or 0.0) >= NEARLY * (winner.explained_share or 0.0)
    return second if near else None


def remarks_on(records: Sequence[Record], validation: Sequence[Record]) -> list[Remark]:
    """What these runs cost any answer."""
    return [*([] if validation else [NoValidation()]), *([OneRun()] if len(records) == 1 else [])]


def _clocks_differ(found: Diagnosis) -> list[Remark]:
    if found.thinned is not None:
        return [LoopUntold(found.thinned)]
    early = clocks(found)
    return [] if early is None else [ClocksDiffer(early)]


def _not_judged(found: Diagnosis, validation: Sequence[Record]) -> list[Remark]:
    kept = set() if found.validation is None else {one.id for one in found.validation.records}
    lost = tuple(one.id for one in validation if one.id not in kept)
    return [StepsLost(lost)] if lost else []


def _no_excitation(found: Diagnosis) -> list[Remark]:
    """That none was logged, where something is left that it would have judged."""
    return [] if found.verdict == "complete" or found.parent.division.measured else [NoExcitation()]


def _in_a_loop(found: Diagnosis) -> list[Remark]:
    """That feedback, and not the vehicle alone, made these data, where the best model is unstable."""
    winner = found.winner
    model = found.parent.model if winner is None or winner.fit is None else winner.fit.model
    if model.stable:
        return []
    pole = max(float(pole.real) for pole in np.linalg.eigvals(model.matrices.A))
    return [InALoop(() if winner is None else winner.effects, pole)]
