"""The verdict: complete, missing or unexplained, with how sure it is and what it stands on."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from sysid.data.airframe import Airframe
from sysid.data.dataset import Dataset
from sysid.diagnose.candidates import REMAINDER, SIGNIFICANT, Ranked, Reference, noise_shares, residual_shares
from sysid.diagnose.chains import Unsearched
from sysid.diagnose.evidence import Candidate, Stepped, error_share, gain
from sysid.diagnose.initial_states import validation_error
from sysid.diagnose.score import log_chance
from sysid.diagnose.size_check import Size, sizes
from sysid.diagnose.term_search import Selection, select
from sysid.fit.check_kinds import CommandsThinned
from sysid.fit.noise import WINDOW_HZ, Division, divide
from sysid.fit.output_error import OutputError
from sysid.fit.result import finite
from sysid.fit.whitening import Whitening
from sysid.model.structure import FloatArray

FORMAT = "tippath.diagnosis/1"
EXPLAINED = 0.8
"""Of what can be explained, on the fitted runs;"""
VALIDATED = 0.5
"""and on validation runs alone: another amplitude shows a nonlinear effect that is only nearly the right one."""
LARGEST_DIFFERENCE = 0.16
"""Share by which a size surely differs on the validation runs, from which on the entry only resembles what is there. On
flights with seeds below 100 right answers reached 0.13 (three worn links, which are no one play) and mostly 0; plays
and limits that only resembled 0.20 to 0.47, but for one of 0.05."""
ALMOST = 0.05
"""Of what can be explained, by which a simpler entry may explain less than one of doubtful values and be named."""
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
BINS_FOR_EACH = 3
"""Of validation runs, for each unknown of a window where their noise is measured."""
LEAD_SCALE = 20.0
"""Chi squared of lead or misfit that counts as none."""
CONFIDENCE = (-1.2, 2.8, -5.0)
"""Logit of being right: constant, per unit of lead, per share left unexplained; set on flights with seeds below 100."""
UNEXPLAINED_RIGHT, COMPLETE_RIGHT = 0.85, 0.98
"""How often these verdicts were right there, where nothing speaks against them."""
VETO_RIGHT = 0.5
"""Of an effect that would be named, how likely a veto against it is right."""
IN_A_LOOP_RIGHT = 0.5
"""At most, where the model that was found is unstable, or where something unexplained is left and no excitation was
logged: a loop made the data what they are."""
BY_FEEDBACK = 0.15
"""Share of an output's error up to which commands seem to explain it by feedback alone, where their excitation is not
logged: doubled gusts and loops of double gain made up to 0.08 on clean flights, four times the gusts 0.145, and effects
of usual size 0.25 and more."""


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
    confidence: float
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
    """Simple terms beside the best candidate, where something is missing."""
    lead: float | None
    """Logarithm of how far the winner is ahead, which the confidence is made from; None where nothing is named."""
    sizes: tuple[Size, ...] = ()
    """The winner's on fitted and validation runs, where both determine them; the most different first."""
    unsearched: Unsearched | None = None
    """Why chains were not looked for, or not all of them."""
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
        return select(self.parent, self.whitening)

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
    shares = _Shares.of([*singles, *pairs], significant, reference)
    singles, pairs = [shares.told(one) for one in singles], [shares.told(one) for one in pairs]
    answer = _answer(singles, pairs, shares, reference) if significant else _Answer(confidence=COMPLETE_RIGHT)
    return Diagnosis(
        verdict=answer.verdict,
        reason=shares.reason(answer.verdict, parent.division),
        effect=answer.effect,
        stands_in=answer.stands_in,
        chain=answer.chain,
        indistinguishable=answer.indistinguishable,
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
        validation_nrmse_percent=None if shares.validation is None else shares.validation.nrmse_percent,
        log_chance=chance,
        terms=shares.terms,
        lead=answer.lead,
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
    confidence: float
    explained_share: float | None = None
    lead: float | None = None
    sizes: tuple[Size, ...] = ()


def _answer(singles: Sequence[Ranked], pairs: Sequence[Ranked], shares: _Shares, reference: Reference) -> _Answer:
    """Where there is something to explain: whether an effect, or a chain of two, does it."""
    winner = _winner(singles, pairs)
    most = UNEXPLAINED_RIGHT if reference.parent.division.measured else IN_A_LOOP_RIGHT
    if winner is None or winner.fit is None:
        return _Answer(verdict="unexplained", explained_share=0.0, confidence=most)
    chain, enough = _larger_first(winner, singles), shares.enough(winner)
    stands_in = bool(winner.implausible) and enough
    missing, compared = enough and not stands_in, tuple[Size, ...]()
    if missing and reference.validation is not None:
        compared = sizes(winner.fit, winner.effects, reference.validation)
        missing = all(one.off <= LARGEST_DIFFERENCE for one in compared)
    alike = _alike(winner, singles if len(chain) == 1 else pairs)
    lead, short = _lead(winner, alike, singles)
    confidence = _logistic(CONFIDENCE, lead, short)
    if not missing:  # right unless it is the winner after all
        confidence = min(most, 1 - (1 - VETO_RIGHT) * confidence)
    if not winner.fit.model.stable:
        confidence = min(confidence, IN_A_LOOP_RIGHT)
    return _Answer(
        verdict="missing" if missing else "unexplained",
        effect=chain[0] if missing or stands_in else None,
        stands_in=stands_in,
        chain=chain,
        indistinguishable=alike,
        confidence=confidence,
        explained_share=winner.explained_share or 0.0,
        lead=lead if missing else None,
        sizes=compared,
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class _Shares:
    """Of the parent's error, what is noise and what can be explained; on the validation runs too."""

    error_share: float
    """E0, the parent's."""
    noise_share: float
    """N, of it what nothing recorded explains."""
    noise_floor_percent: dict[str, float]
    terms: Selection | None
    validation: _Validation | None

    @classmethod
    def of(cls, candidates: Sequence[Ranked], significant: bool, reference: Reference) -> _Shares:
        parent = reference.parent
        fits = [one for one in candidates if one.fit is not None]
        likeliest = min(fits, key=lambda one: one.delta_bic, default=None)
        if likeliest is not None and likeliest.delta_bic >= 0:
            likeliest = None
        best = parent if likeliest is None or likeliest.fit is None else likeliest.fit
        terms = reference.simple(best) if significant else None
        noise = noise_shares(best, terms) if significant else residual_shares(best)
        floor = dict(zip(parent.model.structure.outputs, map(float, 100 * (1 - np.sqrt(noise))), strict=True))
        on = reference.validation
        return cls(
            error_share=parent.error_share,
            noise_share=float(np.sum(noise)),
            noise_floor_percent=floor,
            terms=terms,
            validation=None if on is None else _Validation.of(parent, fits, on),
        )

    def reason(self, verdict: str, left: Division) -> str | None:
        """`feedback` where what is left unexplained is what the loop alone could make."""
        if verdict != "unexplained" or left.measured:
            return None
        explained = [*(1 - left.noise_share), 1 - self.noise_share / max(self.error_share, 1e-300)]
        return "feedback" if max(explained) <= BY_FEEDBACK else None

    def told(self, one: Ranked) -> Ranked:
        """The candidate with the shares that it explains."""
        if one.fit is None:
            return one
        E0, N = self.error_share, self.noise_share
        share = float(np.clip((E0 - one.fit.error_share) / max(E0 - N, 1e-300), 0, 1))
        if self.validation is None:
            return replace(one, explained_share=share)
        on = self.validation
        return replace(one, explained_share=share, validation_share=on.share(one), validation_slack=on.slack)

    def enough(self, one: Ranked) -> bool:
        """Whether it explains what can be explained; by the noise's own measure where that is little beside the
        noise."""
        assert one.fit is not None
        share = one.explained_share or 0.0
        if self.error_share - self.noise_share < LITTLE * self.noise_share:
            left = one.fit.division
            rest = max(0.0, left.chi_squared - left.degrees)
            share = max(share, one.chi_squared / max(one.chi_squared + rest, 1e-300))
        if one.validation_share is None:
            return share >= EXPLAINED
        there = min(1.0, one.validation_share + one.validation_slack)
        return share >= EXPLAINED and there >= VALIDATED


@dataclass(frozen=True, eq=False)
class _Validation:
    """Validation runs: what can be explained there, by the same measure as on the fitted runs."""

    nrmse_percent: dict[str, float]
    """The parent's."""
    before: float
    """The parent's error share."""
    noise: float
    scatter: float
    """Of the noise's share from run to run, one standard deviation."""
    divisions: tuple[tuple[OutputError, Division], ...]
    """What each leaves there, divided: the parent, then the candidates."""

    @classmethod
    def of(cls, parent: Candidate, fits: Sequence[Ranked], on: Dataset) -> _Validation:
        """The noise is what the excitation does not explain of the least that anything leaves of these very runs: the
        air was another when they were flown."""
        error = validation_error(parent.model, on)
        outputs = parent.model.structure.outputs
        before, window_hz = error_share(error), _window_hz(on)
        left = [one.validation_error for one in fits if one.validation_error is not None]
        divisions = [(each, divide(each, on.stacks, on.causes, window_hz)) for each in (error, *left)]
        noise, least, division = min(
            ((float(np.sum(_shares(each) * division.noise_share)), each, division) for each, division in divisions),
            key=lambda one: one[0],
        )
        level = [np.real(np.einsum("fkk->fk", division.at(group.frequency_hz))) for group in on.stacks]
        air = np.concatenate(level)  # (bins, k)
        scatter = float(np.sqrt(np.sum(np.sum(air**2, axis=0) / least.measured_power**2)))
        nrmse = dict(zip(outputs, map(float, error.nrmse_percent), strict=True))
        return cls(nrmse, before, min(noise, before), scatter, tuple(divisions))

    @property
    def slack(self) -> float:
        """How far off a share may be by the chance of the noise in these runs alone."""
        return SLACK * self.scatter / max(self.before - self.noise, 1e-300)

    def share(self, one: Ranked) -> float | None:
        """Of what can be explained there; None where the runs cannot tell.

        All of it, where the commands explain nothing of what is left: in gusts that is the sharper question.
        """
        if self.slack > 1 or one.validation_error is None:
            return None
        left = next(division for error, division in self.divisions if error is one.validation_error)
        if left.measured and log_chance(left.chi_squared, left.degrees) >= SIGNIFICANT:
            return 1.0
        error = error_share(one.validation_error)
        return float(np.clip((self.before - error) / max(self.before - self.noise, 1e-300), -1, 1))


def _shares(error: OutputError) -> FloatArray:
    """Residual over measured power by output."""
    return np.asarray(error.residual_power / error.measured_power)


def _window_hz(on: Dataset) -> float:
    """Of windows that have bins enough to tell noise from an answer, however short the runs."""
    unknown = 2 * len(on.causes.commands) + len(on.spectra)
    return max(WINDOW_HZ, BINS_FOR_EACH * unknown / sum(one.segment.duration_s for one in on.spectra))


def _winner(singles: Sequence[Ranked], pairs: Sequence[Ranked]) -> Ranked | None:
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


def _lead(winner: Ranked, alike: Sequence[str], singles: Sequence[Ranked]) -> tuple[float, float]:
    """How far the winner is ahead of the best rival, beside what it leaves itself; and how far from explaining all, on
    fitted or on validation runs."""
    assert winner.stepped is not None
    misfit = _misfit(winner)
    leads = [
        gain(winner.stepped, one.stepped)[0] + one.added - winner.added
        for one in singles
        if one.stepped is not None and not set(one.effects) & {*winner.effects, *alike} and not one.implausible
    ]
    lead = max(0.0, min([*leads, winner.chi_squared]))
    ratio = math.log((misfit + lead + LEAD_SCALE) / (misfit + LEAD_SCALE))
    shares = [winner.explained_share or 0.0, *([] if (on := winner.validation_share) is None else [on])]
    return ratio, min(1.0, max(0.0, 1 - min(shares)))


def _logistic(weights: Sequence[float], lead: float, short: float) -> float:
    return 1 / (1 + math.exp(-(weights[0] + weights[1] * lead + weights[2] * short)))


def _misfit(one: Ranked) -> float:
    """Chi squared that a candidate leaves beyond noise: real vehicles are built of no entry exactly."""
    assert one.fit is not None
    left = one.fit.division
    return max(0.0, left.chi_squared - left.degrees)


def _likeliest_in_practice(winner: Ranked, others: Sequence[Ranked]) -> Ranked:
    """Of candidates that the data cannot tell from the winner: a plausible one, of the most usual size; else a simpler
    one that is plainly plausible and explains as much."""
    assert winner.stepped is not None
    stepped = winner.stepped
    near = max(SAME, 2 * _misfit(winner))
    alike = [
        one
        for one in others
        if one.stepped is not None and _stands_beside(one, winner, gain(stepped, one.stepped)[0], near)
    ]
    best = min(alike, key=_unusual, default=winner)
    if not best.outside:
        return best
    simpler = [one for one in others if _explains_as_much(one, best)]
    return min(simpler, key=lambda one: one.delta_bic, default=best)


def _explains_as_much(one: Ranked, winner: Ranked) -> bool:
    """Whether it does, with fewer parameters and none that is not plausible: physics weighs more than a hair."""
    if one.fit is None or one.outside or one.added >= winner.added or one.explained_share is None:
        return False
    shares = [(one.explained_share, winner.explained_share), (one.validation_share, winner.validation_share)]
    return all(his is None or (own is not None and own >= his - ALMOST) for own, his in shares)


def _stands_beside(one: Ranked, winner: Ranked, behind: float, near: float) -> bool:
    """Whether it may be named instead: as likely with as many parameters, or nearly so where only it is plausible."""
    if winner.implausible and not one.implausible:
        return behind < near
    return abs(behind) < TIED and one.added == winner.added


def _unusual(one: Ranked) -> tuple[bool, float]:
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


def _larger_first(winner: Ranked, singles: Sequence[Ranked]) -> tuple[str, ...]:
    alone = {one.effect: one.chi_squared for one in singles if one.fit is not None}
    return tuple(sorted(winner.effects, key=lambda name: -alone.get(name, 0.0)))


def _alike(winner: Ranked, others: Sequence[Ranked]) -> tuple[str, ...]:
    """Effects that may stand in the winner's place, or in that of one of its two."""
    assert winner.stepped is not None
    near = max(SAME, _misfit(winner))
    same = [
        one
        for one in others
        if one.stepped is not None
        and set(one.effects) != set(winner.effects)
        and not one.implausible
        and gain(winner.stepped, one.stepped)[0] + (one.added - winner.added) < near
    ]
    return tuple(dict.fromkeys(name for one in same for name in one.effects if name not in winner.effects))
