"""The verdict: complete, missing or unexplained, with how sure it is and what it stands on."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from sysid.data.airframe import Airframe
from sysid.data.dataset import Dataset
from sysid.diagnose import choice
from sysid.diagnose.candidates import SIGNIFICANT, Ranked, Reference
from sysid.diagnose.confidence import (
    CHAIN_NAMED,
    CHAIN_TOLD,
    IN_A_LOOP_RIGHT,
    LEFT_OF_A_FORM,
    NAMED_IN_A_LOOP,
    NARROW,
    SHOWN_IN_A_LOOP,
    SURE_OF_A_MODE,
    TOLD_IN_A_LOOP,
    UNEXPLAINED_IN_A_LOOP_RIGHT,
    UNSTABLE_RIGHT,
    lead,
    leaves_more,
    of_chain,
    of_complete,
    of_named,
    of_single,
    of_unexplained,
)
from sysid.diagnose.evidence import Candidate, Stepped, gain, nrmse_percent
from sysid.diagnose.likely import (
    PERHAPS_BETWEEN_SAMPLES,
    SAME,
    Class,
    declared,
    misfit,
    near,
    where_samples_are_lost,
    with_late,
    with_tethers,
    with_twins,
    with_unasked,
)
from sysid.diagnose.opposed import cancel_each_other
from sysid.diagnose.progress import FirstAnswer
from sysid.diagnose.shares import A_LOOP_MAKES, Shares, least
from sysid.diagnose.size_check import Size, sizes
from sysid.diagnose.slow_modes import SlowMode
from sysid.diagnose.term_search import Selection, Term, select
from sysid.diagnose.thinned import samples_lost
from sysid.diagnose.unsearched import Unsearched
from sysid.fit.check_kinds import CommandsThinned
from sysid.fit.clocks import untold_sample_s
from sysid.fit.noise import Division
from sysid.fit.result import finite
from sysid.fit.whitening import Whitening
from sysid.model.effect import parts_of

FORMAT = "tippath.diagnosis/1"
LARGEST_DIFFERENCE = 0.16
"""Share by which a size surely differs on the validation runs, from which on the entry only resembles what is there. On
flights with seeds below 100 right answers reached 0.13 (three worn links, which are no one play) and mostly 0; plays
and limits that only resembled 0.20 to 0.47, but for one of 0.05."""
SURE = 0.9
"""Confidence from which on an answer counts as sure."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Diagnosis:
    """The verdict and what it stands on."""

    verdict: str
    """`complete`, `missing` or `unexplained`."""
    reason: str | None
    """Why something is left unexplained, where that is the data's fault: `feedback`, of what the loop alone could
    make."""
    effect: str | None
    stands_in: bool
    chain: tuple[str, ...]
    """The best one or two effects, the larger first; empty where the model is complete."""
    indistinguishable: tuple[str, ...]
    """The others of the class, the likeliest first."""
    indistinguishable_pairs: tuple[tuple[str, ...], ...]
    """Of the class, pairs of entries that do together what a single one does that is the answer."""
    equivalent: Mapping[str, tuple[str, ...]]
    """Of the answer, and of those: entries that predict the same on these runs, and are no other answer."""
    confidence: float
    """That the effect, or one of a class of at most three, is right; of a longer class, that the effect is."""
    explained_share: float | None
    candidates: tuple[Ranked, ...]
    """Best first, those that could not be asked last."""
    pairs: tuple[Ranked, ...]
    parent: Candidate
    stepped: Stepped
    whitening: Whitening
    division: Division
    noise_share: float
    """N: the part of the parent's error share that nothing recorded explains."""
    noise_floor_percent: Mapping[str, float]
    """NRMSE that a perfect model would reach on the fitted runs."""
    validation: Dataset | None
    validation_nrmse_percent: Mapping[str, float] | None
    log_chance: float
    """That noise alone shows as much; all questions counted in."""
    terms: Selection | None
    """Simple terms beside the best candidate, where something is missing;"""
    mode: SlowMode | None
    """and a slow mode beside it, where there surely is one."""
    lead: float | None
    """Logarithm of how far the winner is ahead, which the confidence is made from; None where nothing is named."""
    outdone: bool = False
    """Whether the winner only resembles what is there: others, or simple terms, explain so much more; or a chain of two
    is little ahead of others, or leaves too much."""
    term: Term | None = None
    """The simple term that explains so much more than the winner, where one does."""
    sizes: tuple[Size, ...] = ()
    """The winner's on fitted and validation runs, where both determine them; the most different first."""
    unsearched: Unsearched | None = None
    """Why chains were not looked for, or not all of them."""
    first: FirstAnswer | None = None
    """What single effects made of it, where chains were searched after that."""
    thinned: CommandsThinned | None = None
    """Where the log thinned commands and does not tell of its loop: they were taken as held as these runs show it."""

    @property
    def airframe(self) -> Airframe | None:
        """Of the fitted runs: what it cannot have was not asked."""
        return self.parent.dataset.airframe

    @property
    def noise_left(self) -> bool:
        """Whether nothing significant is left: else a complete model leaves what does not matter."""
        return self.log_chance >= SIGNIFICANT

    @property
    def sizes_that_differ(self) -> tuple[Size, ...]:
        """Sizes that the validation runs contradict."""
        return tuple(one for one in self.sizes if one.off > LARGEST_DIFFERENCE)

    @property
    def not_told(self) -> tuple[str, ...]:
        """Every entry that may stand in the answer's place: the class, and what predicts the same."""
        same = [name for others in self.equivalent.values() for name in others]
        return tuple(dict.fromkeys((*self.indistinguishable, *same)))

    @property
    def winner(self) -> Ranked | None:
        """The effect, or the chain of two, that explains most; None where the model is complete."""
        return next((one for one in (*self.candidates, *self.pairs) if set(one.effects) == set(self.chain)), None)

    @property
    def placebo(self) -> Ranked | None:
        """The best wrong effect: told from the winner by the data, with at most as many parameters."""
        return None if self.winner is None else _placebo(self.winner, self.candidates)

    @property
    def runner_up(self) -> Ranked | None:
        """The plausible single effect next to the winner."""
        for one in self.candidates:
            if one.fit is not None and not one.implausible and not set(one.effects) & set(self.chain):
                return one
        return None

    def simple(self) -> Selection:
        """The simple terms that explain most beside the structure itself, without any effect of the catalogue."""
        return select(self.parent.asked, self.whitening)

    def placebo_of(self, effect: str) -> Ranked | None:
        """The best wrong effect beside this one, taken for the right one; None where nothing was refitted."""
        right = next((one for one in self.candidates if one.effects == (effect,)), None)
        return None if right is None else _placebo(right, self.candidates)

    def to_json(self) -> dict[str, Any]:
        """The `tippath.diagnosis/1` document, but for what could hide, the character and the next maneuver."""
        placebo = self.placebo
        return {
            "format": FORMAT,
            "airframe": self.airframe,
            "verdict": self.verdict,
            "reason": self.reason,
            "instrument": "prediction error" if self.parent.dataset.in_a_loop else self.parent.estimate.instrument,
            "effect": self.effect,
            "chain": list(self.chain),
            "stands_in": self.stands_in,
            "indistinguishable": list(self.indistinguishable),
            "indistinguishable_pairs": [list(pair) for pair in self.indistinguishable_pairs],
            "equivalent": {name: list(others) for name, others in self.equivalent.items()},
            "confidence": finite(self.confidence),
            "explained_share": None if self.explained_share is None else finite(self.explained_share),
            "needed_share": least(self.division),
            "candidates": [one.to_json() for one in self.candidates],
            "pairs": [one.to_json() for one in self.pairs],
            "placebo": None if placebo is None else placebo.effect,
            "nrmse_percent": self.parent.nrmse_percent,
            "validation_nrmse_percent": None
            if self.validation_nrmse_percent is None
            else dict(self.validation_nrmse_percent),
            "noise_floor_percent": {name: finite(value) for name, value in self.noise_floor_percent.items()},
            "lead": None if self.lead is None else finite(self.lead),
            "term_ahead": None
            if self.term is None
            else {"equation": self.term.entry.equation, "chi_squared": finite(self.term.chi_squared)},
            "sizes": [one.to_json() for one in self.sizes],
            "log10_chance": finite(self.log_chance / math.log(10)),
            "first_answer": None
            if self.first is None
            else {
                "verdict": self.first.verdict,
                "chain": list(self.first.chain),
                "confidence": finite(self.first.confidence),
            },
            "unsearched_chains": None if self.unsearched is None else self.unsearched.to_json(),
        }


def _placebo(right: Ranked, candidates: Sequence[Ranked]) -> Ranked | None:
    if right.stepped is None:
        return None
    for one in candidates:
        told = one.stepped is not None and gain(right.stepped, one.stepped)[0] >= SAME
        if told and one.added <= right.added and one.effect not in right.effects:
            return one
    return None


def verdict_on(singles: Sequence[Ranked], pairs: Sequence[Ranked], chance: float, reference: Reference) -> Diagnosis:
    """The verdict on candidates and chains, best first; `chance` is that of noise alone, a logarithm."""
    parent, significant = reference.parent, chance < SIGNIFICANT
    shares = Shares.of([*singles, *pairs], significant, reference)
    singles, pairs = [shares.told(one) for one in singles], [shares.told(one) for one in pairs]
    answer = (
        _answer(singles, pairs, shares, reference, chance)
        if significant
        else _Answer(confidence=of_complete(chance, parent.division.measured))
    )
    return Diagnosis(
        verdict=answer.verdict,
        reason="feedback" if answer.verdict == "unexplained" and shares.by_feedback(parent.division, chance) else None,
        effect=answer.effect,
        stands_in=answer.stands_in,
        chain=answer.chain,
        indistinguishable=answer.indistinguishable,
        indistinguishable_pairs=answer.indistinguishable_pairs,
        equivalent=answer.equivalent,
        confidence=answer.confidence,
        explained_share=answer.explained_share,
        candidates=tuple(singles),
        pairs=tuple(pairs),
        parent=parent,
        stepped=reference.stepped,
        whitening=reference.whitening,
        division=parent.division,
        noise_share=shares.noise_share,
        noise_floor_percent=shares.noise_floor_percent,
        validation=reference.validation,
        validation_nrmse_percent=None
        if reference.error is None
        else nrmse_percent(reference.error, parent.model.structure),
        log_chance=chance,
        terms=shares.terms,
        mode=shares.mode,
        lead=answer.lead,
        outdone=answer.outdone,
        term=answer.term,
        sizes=answer.sizes,
    )


@dataclass(frozen=True, kw_only=True)
class _Answer:
    """What is said; as it stands where the model is complete."""

    verdict: str = "complete"
    effect: str | None = None
    stands_in: bool = False
    chain: tuple[str, ...] = ()
    indistinguishable: tuple[str, ...] = ()
    indistinguishable_pairs: tuple[tuple[str, ...], ...] = ()
    equivalent: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    confidence: float
    explained_share: float | None = None
    lead: float | None = None
    outdone: bool = False
    doubtful: bool = False
    """Whether it is a chain that likelier only resembles what is there."""
    term: Term | None = None
    sizes: tuple[Size, ...] = ()


def _answer(
    singles: Sequence[Ranked], pairs: Sequence[Ranked], shares: Shares, reference: Reference, chance: float
) -> _Answer:
    """Where there is something to explain: whether an effect, or a chain of two, does it. In a loop, where chains are
    least sure, a single effect stays named where the chain that seems likelier is none to name."""
    answer = _by(_winner(singles, pairs, reference), singles, pairs, shares, reference, chance=chance)
    if answer.doubtful and not reference.parent.division.measured:
        alone = _by(choice.winner(singles, ()), singles, pairs, shares, reference, chance=chance)
        return alone if alone.verdict == "missing" else answer
    return answer


def _by(
    winner: Ranked | None,
    singles: Sequence[Ranked],
    pairs: Sequence[Ranked],
    shares: Shares,
    reference: Reference,
    *,
    chance: float,
) -> _Answer:
    """What is said where this one is likeliest."""
    if winner is None or winner.fit is None:
        sure = _of_unexplained(None, chance, 0.0, reference, shares)
        return _Answer(verdict="unexplained", explained_share=0.0, confidence=sure)
    chain, enough = choice.larger_first(winner, singles), shares.enough(winner)
    stands_in = bool(winner.implausible) and enough
    compared = _compared(winner, reference) if enough and not stands_in else ()
    missing = enough and not stands_in and _hold(compared)
    peers = singles if len(chain) == 1 else pairs
    among = _declared(winner, _answers([*peers, *_parts_of(winner, pairs)], shares, enough), singles, pairs)
    ratio = lead(winner, near(winner, peers), singles)
    named = of_named(ratio, shares.short(winner), among)
    told = _told(winner, among, ratio, shares, reference, None)
    doubtful = _only_resembles(winner, named, told)
    term = shares.by_a_term(winner) if missing else None
    resembles = doubtful or _resembles(winner, missing, term, shares)
    missing = missing and not resembles and not _made_by_the_loop(winner, named, told, shares, reference, chance)
    right = told if missing else _told(winner, among, ratio, shares, reference, chance)
    return _Answer(
        verdict="missing" if missing else "unexplained",
        effect=chain[0] if missing or stands_in else None,
        stands_in=stands_in,
        chain=chain,
        indistinguishable=among.alike,
        indistinguishable_pairs=among.pairs,
        equivalent=among.equivalent,
        confidence=_sure(winner, right, reference.parent),
        explained_share=winner.explained_share or 0.0,
        lead=ratio if missing else None,
        outdone=resembles or shares.outdone(winner),
        doubtful=doubtful,
        term=term,
        sizes=compared,
    )


def _parts_of(winner: Ranked, pairs: Sequence[Ranked]) -> list[Ranked]:
    """The pairs that a single effect may be made of."""
    made_of = [{*parts} for parts in parts_of(winner.effect)] if len(winner.effects) == 1 else []
    return [one for one in pairs if {*one.effects} in made_of]


def _only_resembles(winner: Ranked, named: float, told: float) -> bool:
    """Whether it is a chain that, by its sureness and what is told of that, likelier only resembles what is there."""
    return len(winner.effects) > 1 and (named < CHAIN_NAMED or told < CHAIN_TOLD or leaves_more(winner))


def _resembles(winner: Ranked, missing: bool, term: Term | None, shares: Shares) -> bool:
    """Whether what would be named only resembles what is there: a simple `term` explains more, or it leaves much."""
    return missing and (term is not None or shares.leaves_much(winner))


def _declared(winner: Ranked, answers: Sequence[Ranked], singles: Sequence[Ranked], pairs: Sequence[Ranked]) -> Class:
    """Also by what the log lost of the commands."""
    assert winner.fit is not None
    among = with_unasked(declared(winner, answers), winner, singles, pairs)
    among = with_tethers(with_twins(among, winner, singles, pairs), winner, singles)
    runs = winner.fit.dataset
    among = with_late(among, winner, singles, pairs)
    among = with_twins(among, winner, singles, pairs)
    if samples_lost(runs):
        return where_samples_are_lost(among, winner, singles, pairs)
    if untold_sample_s(runs) is not None:
        return where_samples_are_lost(among, winner, singles, pairs, PERHAPS_BETWEEN_SAMPLES)
    return among


def _told(
    winner: Ranked, among: Class, ratio: float, shares: Shares, reference: Reference, chance: float | None
) -> float:
    """How sure a name is, or, where there is a `chance` of noise, that it is none."""
    short, single = shares.short(winner), len(winner.effects) == 1
    excited = reference.parent.division.measured
    chain = of_chain(ratio, short, among, excited)
    if chance is None:
        return of_single(ratio, shares.left(winner), among, excited) if single else chain
    return _of_unexplained(winner, chance, of_named(ratio, short, among) if single else chain, reference, shares)


def _sure(winner: Ranked, confidence: float, parent: Candidate) -> float:
    """No surer than answers of unstable models are, where it is one."""
    if winner.fit is None or winner.fit.model.stable:
        return confidence
    return min(confidence, UNSTABLE_RIGHT if parent.division.measured else IN_A_LOOP_RIGHT)


def _winner(singles: Sequence[Ranked], pairs: Sequence[Ranked], reference: Reference) -> Ranked | None:
    """The likeliest; of the single effects alone, where the likeliest chain only stands in for something else."""
    winner = choice.winner(singles, pairs)
    if winner is None or len(winner.effects) == 1:
        return winner
    only_stands_in = cancel_each_other(winner, reference.parent, reference.whitening)
    return choice.winner(singles, ()) if only_stands_in else winner


def _hold(sizes: Sequence[Size]) -> bool:
    """Whether sizes are on validation runs what they are on those that were fitted."""
    return all(one.off <= LARGEST_DIFFERENCE for one in sizes)


def _made_by_the_loop(
    winner: Ranked, confidence: float, as_told: float, shares: Shares, reference: Reference, chance: float
) -> bool:
    """Whether a name is one by chance of what the loop alone could make: what it makes is of no entry's form, so that
    one which leaves hardly any of much is told, however near others come; of doubtful values only where it is sure, of
    little only a narrow mode. What is told to be likelier wrong (`as_told`) and hardly shows by power is no name."""
    much, sure = chance <= A_LOOP_MAKES, confidence >= NAMED_IN_A_LOOP
    formed = misfit(winner) <= LEFT_OF_A_FORM * winner.chi_squared
    if winner.outside:
        told = (sure and much) or (formed and confidence >= SURE_OF_A_MODE and _is_a_narrow_mode(winner))
    else:
        told = sure or (much and formed)
    told = told and (as_told >= TOLD_IN_A_LOOP or (winner.explained_share or 0.0) >= SHOWN_IN_A_LOOP)
    return not told and shares.by_feedback(reference.parent.division, chance)


def _is_a_narrow_mode(winner: Ranked) -> bool:
    assert winner.fit is not None
    model = winner.fit.model
    brought = set(model.modes) - set(model.own_modes)
    return any(abs(mode.damping_ratio) < NARROW for mode in brought)


def _of_unexplained(winner: Ranked | None, chance: float, named: float, reference: Reference, shares: Shares) -> float:
    """No surer, where no excitation is logged, than that no loop made it."""
    sure, left = of_unexplained(winner, chance, named), reference.parent.division
    if left.measured:
        return sure
    return min(sure, IN_A_LOOP_RIGHT if shares.by_feedback(left, chance) else UNEXPLAINED_IN_A_LOOP_RIGHT)


def _compared(winner: Ranked, reference: Reference) -> tuple[Size, ...]:
    """Its sizes on the fitted and the validation runs, where these tell what it explains; where noise drowns that, the
    few bins of a slow channel tell its size no better, whatever their standard errors."""
    if winner.fit is None or winner.validation_share is None or reference.validation is None:
        return ()
    return sizes(winner.fit, winner.effects, reference.validation)


def _answers(peers: Sequence[Ranked], shares: Shares, enough: bool) -> Sequence[Ranked]:
    """What may be named itself: beside a winner that is, no other is an answer."""
    return [one for one in peers if one.fit is not None and shares.may_be(one)] if enough else peers
