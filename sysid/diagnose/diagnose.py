"""Which physical effect is missing: every testable entry of the catalogue asked, the serious refitted, one verdict.

`complete`: what the model leaves is noise, as far as these runs can tell. `missing`: one effect, or a chain of two,
explains at least `shares.least` of what can be explained, on fitted and validation runs, at plausible values.
`unexplained`: there is something to explain, and nothing known does it; an effect that does so at values that physics
does not allow stands in for something else.

Ranking is by how much more likely an effect makes the data under the noise's own spectrum (`sysid.diagnose.evidence`),
less a penalty for its parameters. The thresholds below were set on flights with known answers and are frozen (`make
study`).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache

import numpy as np

from sysid.data.dataset import Dataset, Runs, dataset, prepared
from sysid.data.preprocess import DEFAULT_BAND_HZ
from sysid.diagnose.beside_known import chance_beside_known
from sysid.diagnose.candidates import (
    SIGNIFICANT,
    Ranked,
    Reference,
    chance_of_an_alarm,
    compared,
    entries,
    heard,
    of_all_questions,
    rank,
    ranked,
    score_effects,
)
from sysid.diagnose.chains import ChainSearch, chains_of_two
from sysid.diagnose.evidence import Candidate, Stepped, candidate, gain, instrumental_step
from sysid.diagnose.growing_modes import likeliest
from sysid.diagnose.halves import halves_alone
from sysid.diagnose.held_anew import held_anew
from sysid.diagnose.initial_states import validation_error
from sysid.diagnose.likely import SAME
from sysid.diagnose.loop_change import Limit
from sysid.diagnose.on_samples import on_samples_alone
from sysid.diagnose.progress import Asking, FirstAnswer, Listener, Stage, unheard
from sysid.diagnose.reach import in_reach
from sysid.diagnose.refits import refit_or_reason, refit_serious
from sysid.diagnose.resting import chance_of_rest
from sysid.diagnose.slow_modes import SlowMode, slow_mode
from sysid.diagnose.term_search import Selection, Term, search, select
from sysid.diagnose.thinned import TakenAs, as_held, by_a_usual_loop, noise_folded, telling
from sysid.diagnose.unsearched import BudgetSpent, Unsearched
from sysid.diagnose.validated import divided
from sysid.diagnose.verdict import Diagnosis, verdict_on
from sysid.errors import FitError, NotShownError
from sysid.fit.estimate import best_values, refuse_vague
from sysid.fit.innovations import Innovations
from sysid.fit.noise import Division
from sysid.fit.output_error import OutputError
from sysid.fit.whitening import Whitening
from sysid.model.effect import Effect
from sysid.model.structure import Model, Structure

TINY = 1e-300
FEW = 3
"""How many of the best entries are refitted to see whether any is likelier than the answer by a usual loop."""


def diagnose(
    structure: Structure,
    records: Runs,
    validation: Runs = (),
    band_hz: tuple[float, float] = DEFAULT_BAND_HZ,
    *,
    effects: Sequence[Effect] = (),
    fixed: Mapping[str, float] | None = None,
    begin: Model | None = None,
    say: Listener = unheard,
    chains: bool = True,
    limit: Limit | None = None,
) -> Diagnosis:
    """Diagnose a structure on runs. `effects` are a user's own, asked beside the catalogue's; `chains` of two too.

    `begin` is where the structure was fitted to, if it was; `limit` changes of margins from which on it matters what a
    chain could explain more. How long a loop that nobody told of held commands is found anew: it hangs on what lacks.
    Raises FitError where the runs do not identify the structure itself.
    """
    judging = prepared(validation, band_hz).held(None)
    on = dataset(records, band_hz, outputs=structure.outputs).held(None)
    if judging.records:  # where a signal is not logged, nothing can be judged that hangs on it
        unread = sorted({*structure.inputs} - judging.common)
        if unread:
            raise FitError(f"{', '.join(unread)} is not logged on every validation run, and the fit reads it")
        on = on.without(on.available - judging.common)
    validated_on = dataset(judging, band_hz, on, structure.outputs) if judging.records else None
    fixed = fixed or {}
    say(Asking(stage=Stage.NOISE, of=1 + len(entries(structure, on, effects))))

    def refitted(runs: Dataset, near: Model) -> Candidate:
        return _parent(structure, runs, fixed, near)

    def scored_as(held: TakenAs) -> tuple[_Scored, Dataset | None]:
        return _scored(held.parent, effects, say), _judging(validated_on, held.parent, held.loop_s)

    parent, thinned, loop_s = as_held(_parent(structure, on, fixed, begin), fixed, refitted)
    scored = _scored(parent, effects, say)
    usual = by_a_usual_loop(parent, refitted) if scored.significant else None
    there = None if usual is None else scored_as(usual)
    asked, by_usual = _by_either(scored, _judging(validated_on, parent, loop_s), there, say)
    if usual is not None and by_usual:
        thinned = usual.what
    anew = _held_anew(asked, asked.answer, fixed, refitted)
    if anew is not None:
        asked, thinned = _asked(*scored_as(anew), say), anew.what
    answer = _with_chains(asked, say, limit) if chains else asked.finished(ChainSearch())
    try:
        anew = _held_anew(asked, answer, fixed, refitted) if _searched(answer) else None
        alone = None if anew is None else _asked(*scored_as(anew), say)
    except KeyboardInterrupt:  # what was found until then is the answer
        anew = alone = None
    if anew is not None and alone is not None and alone.answer.verdict == "missing":
        answer, thinned = _with_chains(alone, say, limit), anew.what
    if answer.verdict != "missing":  # of an axis that is hardly known only the effect is told that would make it known
        last = answer.parent
        refuse_vague(last.estimate, last.dataset.viewed(last.model.structure.inputs))
    return replace(answer, thinned=thinned)


def _judging(runs: Dataset | None, parent: Candidate, loop_s: float | None) -> Dataset | None:
    """The validation runs that judge, their commands held as the parent's."""
    if runs is not None and loop_s is not None:
        runs = runs.held(loop_s).beside(parent.dataset)
    return None if runs is None else telling(runs)


@dataclass(frozen=True, eq=False, kw_only=True)
class _Scored:
    """Every entry asked of a structure as it was fitted, by one step."""

    parent: Candidate
    candidates: Sequence[Ranked]
    chance: float
    """That noise alone shows as much, a logarithm."""
    elsewhere: float
    """Chi squared that something outside the catalogue explains."""
    users: Sequence[Effect]

    @property
    def significant(self) -> bool:
        return self.chance < SIGNIFICANT

    def refitted(self, some: Sequence[Ranked], say: Listener) -> list[Ranked]:
        return refit_serious(some, self.parent, self.users, say, self.elsewhere) if self.significant else list(some)


@dataclass(frozen=True, eq=False, kw_only=True)
class _Asked:
    """The same, the serious ones refitted; chains not yet."""

    scored: _Scored
    candidates: Sequence[Ranked]
    reference: Reference
    answer: Diagnosis

    @property
    def likeliest(self) -> Candidate:
        return self.candidates[0].fit or self.reference.parent

    def finished(self, chained: ChainSearch, say: Listener = unheard) -> Diagnosis:
        """The answer with the chains that were found."""
        candidates, pairs, reference, answer = self.candidates, chained.pairs, self.reference, self.answer
        chance = self.scored.chance
        if pairs:
            pairs = tuple(_best_first(pairs, reference))
            answer = verdict_on(candidates, pairs, chance, reference)
            if answer.winner is not None and len(answer.chain) == 2:
                try:
                    alone = halves_alone(answer.winner, candidates, reference, say)
                except KeyboardInterrupt:
                    alone, chained = [], chained.interrupted
                if alone:
                    fitted = {one.effects: one for one in alone}
                    candidates = sorted((fitted.get(one.effects, one) for one in candidates), key=rank)
                    answer = verdict_on(candidates, pairs, chance, reference)
        likelier = _likelier(answer, reference)
        if likelier is not None:
            candidates = _best_first([compared(one, likelier) for one in candidates], likelier)
            pairs = tuple(sorted((compared(one, likelier) for one in pairs), key=rank))
            answer = verdict_on(candidates, pairs, chance, likelier)
        return replace(answer, first=_first(self.answer) if pairs else None, unsearched=chained.unsearched)


def _scored(parent: Candidate, effects: Sequence[Effect], say: Listener) -> _Scored:
    asked_of, stepped = parent.asked_in(parent.metric), parent.stepped
    candidates = score_effects(asked_of, stepped, parent.metric, effects, say)
    scores = [one.score for one in candidates if one.score is not None]
    chance = chance_of_an_alarm(parent, scores)
    chance, elsewhere = _beyond_the_catalogue(chance, asked_of, stepped, parent, say)
    if chance >= SIGNIFICANT:
        chance = min(chance, chance_of_rest(candidates, parent, effects, say))
    if chance >= SIGNIFICANT:
        chance = min(chance, chance_beside_known(candidates, parent, effects, say))
    return _Scored(parent=parent, candidates=candidates, chance=chance, elsewhere=elsewhere, users=effects)


def _asked(scored: _Scored, validation: Dataset | None, say: Listener) -> _Asked:
    candidates = scored.refitted(scored.candidates, say)
    reference = _reference(scored.parent, candidates, scored.users, validation)
    candidates = _best_first(_held_against(reference, candidates, say), reference)
    say(Asking(stage=Stage.WEIGHING))
    answer = verdict_on(candidates, (), scored.chance, reference)
    if scored.significant and answer.winner is None:
        foretold = {one.effects: one for one in on_samples_alone(reference, say)}
        candidates = [foretold.get(one.effects, one) for one in candidates]
        answer = verdict_on(candidates, (), scored.chance, reference) if foretold else answer
    return _Asked(scored=scored, candidates=candidates, reference=reference, answer=answer)


def _by_either(
    scored: _Scored, validation: Dataset | None, usual: tuple[_Scored, Dataset | None] | None, say: Listener
) -> tuple[_Asked, bool]:
    """The answer, or that by a usual loop where that is as likely; and whether it is the latter."""
    if usual is None:
        return _asked(scored, validation, say), False
    other = _asked(*usual, say)
    # most often a usual loop it was: what is likeliest by the other is then known long before all of its answer
    if other.answer.verdict == "missing" and _as_likely(other, _the_likeliest(scored, other, say)):
        return other, True
    asked = _asked(scored, validation, say)
    # where nothing explains the runs either way, what is wrong is not how long commands were held
    nothing = asked.answer.verdict == other.answer.verdict == "unexplained"
    return (asked, False) if nothing or not _as_likely(other, asked.likeliest) else (other, True)


def _held_anew(
    asked: _Asked, answer: Diagnosis, fixed: Mapping[str, float], fitted: Callable[[Dataset, Model], Candidate]
) -> TakenAs | None:
    """The hold that the likeliest of an answer shows, where that is likelier by it than the answer; None where none is.
    A single effect that was named stays where it is as likely."""
    reference, winner = asked.reference, answer.winner
    shown = held_anew(answer.candidates, answer.pairs, reference, fixed) if asked.scored.significant else None
    if shown is None:
        return None
    hold, effects = shown
    try:
        parent = fitted(reference.parent.dataset.held(hold.loop_s), reference.parent.model)
    except FitError:
        return None
    there = refit_or_reason(hold.near.structure, parent, effects, hold.near)[0]
    here = asked.likeliest if winner is None or winner.fit is None else winner.fit
    named = answer.verdict == "missing" and len(answer.chain) == 1
    if there is None or _ahead(there, here) <= (SAME if named else -SAME):
        return None
    return TakenAs(parent, hold.loop_s, hold.what)


def _searched(answer: Diagnosis) -> bool:
    """Whether pairs were found, and nobody ended the search."""
    return bool(answer.pairs) and not _called_off(answer.unsearched)


def _called_off(unsearched: Unsearched | None) -> bool:
    return isinstance(unsearched, BudgetSpent) and unsearched.interrupted


def _the_likeliest(scored: _Scored, other: _Asked, say: Listener) -> Candidate:
    """Of the entries that score best, and of those that are best in the other answer, the likeliest refit."""
    best = sorted((one for one in scored.candidates if one.score is not None), key=rank)
    names = {one.effects for one in (*best[:FEW], *other.candidates[:FEW])}
    few = scored.refitted([one for one in scored.candidates if one.effects in names], say)
    reference = _reference(scored.parent, few, scored.users, None)
    return min((compared(one, reference) for one in few), key=rank).fit or scored.parent


def _with_chains(asked: _Asked, say: Listener, limit: Limit | None) -> Diagnosis:
    if not asked.scored.significant:
        return asked.finished(ChainSearch())
    answer = asked.answer
    say(_first(answer))
    named = answer.winner if answer.verdict == "missing" else None
    chained = chains_of_two(answer.candidates, asked.reference, say, limit=limit, named=named)
    try:
        return asked.finished(chained, say)
    except KeyboardInterrupt:  # what single effects explain was known before
        if _called_off(chained.unsearched):
            raise
        return asked.finished(ChainSearch(unsearched=chained.interrupted.unsearched))


def _as_likely(other: _Asked, here: Candidate) -> bool:
    """Whether the best that explains the runs as the other takes them is no less likely than this."""
    return _ahead(other.likeliest, here) > -SAME


def _ahead(there: Candidate, here: Candidate) -> float:
    """By how much one is likelier than another, their numbers paid, whatever hold the runs are taken by."""
    metric = min(here, there, key=_error).metric
    steps = [instrumental_step(one.asked_in(metric), metric) for one in (there, here)]
    return gain(*steps)[0] - (there.fitted - here.fitted) * math.log(steps[0].residual.size)


def _beyond_the_catalogue(
    chance: float, asked_of: Candidate, stepped: Stepped, parent: Candidate, say: Listener
) -> tuple[float, float]:
    """The chance once a slow mode and simple terms are asked for, too, where nothing was significant before; and chi
    squared of the slow mode, where that is what shows."""
    if chance < SIGNIFICANT:
        return chance, 0.0
    say(Asking(stage=Stage.SLOW))
    mode = slow_mode(asked_of, stepped, parent.metric)
    if mode is not None:
        chance = min(chance, of_all_questions(mode.log_p, parent.division))
        if chance < SIGNIFICANT:
            return chance, mode.chi_squared
    if parent.division.measured and noise_folded(parent.dataset):
        return chance, 0.0
    say(Asking(stage=Stage.TERMS))
    simple = search(asked_of, stepped, parent.metric, most=1)
    return min([chance, *(of_all_questions(one.log_p_surely, parent.division) for one in simple)]), 0.0


def _held_against(reference: Reference, candidates: Sequence[Ranked], say: Listener) -> list[Ranked]:
    """The candidates held against what they may explain, and the validation runs."""
    refits = sum(one.fit is not None for one in candidates)
    found: list[Ranked] = []
    number = 0
    for one in candidates:
        if one.fit is not None:
            number += 1
            done = (number - 1) / refits
            say(Asking(stage=Stage.VALIDATION, effects=one.effects, number=number, of=refits, done=done))
        found.append(ranked(one, reference))
        if one.fit is not None:
            say(heard(found[-1], reference.parent))
    return found


def _best_first(candidates: Sequence[Ranked], reference: Reference) -> list[Ranked]:
    """The candidates where physics allows them, ranked."""
    return sorted(in_reach(candidates, reference), key=rank)


def _first(answer: Diagnosis) -> FirstAnswer:
    shares = {one.effects: one.explained_share for one in answer.candidates if one.explained_share is not None}
    return FirstAnswer(verdict=answer.verdict, chain=answer.chain, confidence=answer.confidence, shares=shares)


def _parent(structure: Structure, on: Dataset, fixed: Mapping[str, float], begin: Model | None) -> Candidate:
    """The structure fitted as it is, from where it was fitted to before.

    By constant weights, in whose residual the verdict's shares and thresholds were set; candidates are compared in the
    noise's own spectrum all the same.
    """
    if begin is not None:
        begin = Model(structure, begin.values) if begin.structure.names == structure.names else None
    bins = on.viewed(structure.inputs)
    held = dict(fixed)
    try:
        found = best_values(structure, bins, begin, held, "constant")
    except NotShownError as gone:
        held |= {} if begin is None else _as_added(begin, gone.names)
        if held == fixed:
            raise
        try:
            found = best_values(structure, bins, begin, held, "constant")
        except FitError:  # what was wrong first is told
            raise gone from None
    return candidate(likeliest(found, on, bins, held), tuple(held), on)


def _as_added(begin: Model, names: Collection[str]) -> dict[str, float]:
    """Those of what is not linear, where they were fitted to before: of all power, mostly gusts', a limit that was
    added may be gone, and no step finds it again."""
    free = (name for effect in begin.structure.composed if not effect.linear for name in effect.names)
    return {name: begin[name] for name in free if name in names}


def _reference(
    parent: Candidate, candidates: Sequence[Ranked], users: Sequence[Effect], validation: Dataset | None
) -> Reference:
    """The parent under the noise that the candidate of least error leaves."""
    fits = [one.fit for one in candidates if one.fit is not None]
    best = min([parent, *fits], key=_error)
    return _under(best.metric, parent, users, validation)


def _error(one: Candidate) -> float:
    """What a candidate leaves, to find the least: summed logarithms of power, window by window, so that a bit of slow
    gusts counts for no more than all of the rest; all power where feedback makes it."""
    return float(np.sum(np.log(np.maximum(one.division.power, TINY)))) if one.division.measured else one.error_share


def _likelier(answer: Diagnosis, reference: Reference) -> Reference | None:
    """The parent under the noise that the answer leaves; None where that foretells no better, or powers tell.

    In a loop without a logged excitation what leaves least power need not foretell best, and in the metric of a noise
    that commands still foretell an effect that takes up some of that seems likelier than the right one.
    """
    told = None if answer.winner is None or answer.winner.fit is None else answer.winner.fit.metric
    if not isinstance(told, Innovations) or not isinstance(reference.whitening, Innovations):
        return None
    if told.log_likelihood <= reference.whitening.log_likelihood:
        return None
    return _under(told, reference.parent, reference.users, reference.validation)


def _under(whitening: Whitening, parent: Candidate, users: Sequence[Effect], validation: Dataset | None) -> Reference:
    @cache
    def stepped(one: Candidate) -> Stepped:
        return instrumental_step(one.asked_in(whitening), whitening)

    @cache
    def simple(one: Candidate) -> Selection:
        return select(one.asked_in(whitening), whitening)

    @cache
    def term(one: Candidate) -> Term | None:
        return next(iter(search(one.asked_in(whitening), stepped(one), whitening, most=1)), None)

    @cache
    def mode(one: Candidate) -> SlowMode | None:
        return slow_mode(one.asked_in(whitening), stepped(one), whitening)

    @cache
    def left(error: OutputError) -> Division:
        assert validation is not None
        return divided(error, validation)

    return Reference(
        parent=parent,
        stepped=stepped(parent),
        whitening=whitening,
        users=users,
        validation=validation,
        simple=simple,
        term=term,
        mode=mode,
        left=left,
        error=None if validation is None else validation_error(parent.model, validation),
    )
