"""Of what a model leaves: what is noise, what can be explained, and how much of that each candidate explains."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from sysid.diagnose.candidates import SIGNIFICANT, Ranked, Reference, noise_shares
from sysid.diagnose.evidence import Candidate
from sysid.diagnose.likely import misfit
from sysid.diagnose.score import log_chance
from sysid.diagnose.slow_modes import SlowMode
from sysid.diagnose.term_search import Selection, Term
from sysid.diagnose.thinned import noise_lost
from sysid.diagnose.validated import SLACK, ByPower, ByWhatIsNew, validation_of
from sysid.fit.innovations import Innovations
from sysid.fit.noise import Division
from sysid.fit.whitening import Whitening

EXPLAINED, EXPLAINED_IN_A_LOOP = 0.9, 0.8
"""Of what can be explained, on the fitted runs, where the excitation is logged and where it is not: of 250 names of
strangers with it, judged before, all five below 0.9 were wrong (three hid servos that the catalogue does not have), of
the others 6 %;"""
EXPLAINED_BY_NOISE, BY_NOISE_IN_A_LOOP, OF_A_NAME = 0.88, 0.75, 1.0
"""Of what can be explained, by the noise's own measure, that a name explains, too, powers or none: where an excitation
is logged, and of what others explain; of what is left in a loop; and standard deviations of chance that are taken off
that. Logged, 164 right names of strangers that judgements had spent explained 0.92 and more, of eight that hid what the
catalogue does not have two 0.74 and 0.75. In a loop right ones left a fifth at most, and what else does mostly leaves
much to a simple term."""
NEARLY = 0.7
"""Of what can be explained, by power, from which the noise's own measure has the last word, where an excitation is
logged: of 50 answers of strangers that judgements had spent, which explained 0.5 to 0.9 by power, five explained 0.9
by the noise and were not outdone, from 0.76 by power on. All five were right; of the others one was. Where none is
logged, of 19 plays, limits and dead bands that explained too little the one that was right explained 0.74, the others
half at most (or were vetoed for something else)."""
DOUBTFUL, NEARLY_ALL = 0.4, 0.95
"""The same by power, where an excitation is logged, from which a single effect is judged by the noise where it leaves
hardly anything by that: slow gusts, or few bins, left 0.39 to 0.55 of the power of three right answers, which explained
0.98 and more by the noise. Of 50 flights that hid what the catalogue does not have and were best explained so far, by
one effect or two, one effect did that and was not outdone: the damping nearest to one by the cube of the rates."""
VAGUE = 0.2
"""Of what can be explained, that a fit's own numbers may leave by chance, above which powers do not tell;"""
VALIDATED = 0.5
"""and on validation runs alone: another amplitude shows a nonlinear effect that is only nearly the right one."""
HALF = 0.5
"""Of what can be explained, that is in doubt at most where powers mean little: six of nine such names on strangers that
judgements had spent were right; and that play, a limit or a dead band explains by power, to be judged by the noise
where no excitation is logged."""
LITTLE = 0.05
"""Explainable power over noise, below which powers are too uncertain to divide."""
OF_MOST = 0.75
"""Of the chi squared that others explain and pay for, or simple terms beside the likeliest do, that an answer explains:
right answers on training strangers from 3000 to 8300 explained 0.78 and more (play beside a dead band; else 0.8), what
only resembled something outside the catalogue 0.16 to 0.69, or all."""
BY_CHANCE = 2.0
"""Chi squared that a parameter explains by chance, one of many entries' being chosen."""
TERM_TAKES = SIGNIFICANT
"""Chance, a logarithm, by which a term is significant that takes a name away: beside one right name in a hundred noise
makes one that is so at 0.01, and where little shows that is a third of it."""
OF_A_TERM, MORE_BY_A_TERM = 0.9, 15.0
"""Of the chi squared that one simple term explains beside the structure itself, that an answer explains, or so little
less;"""
BESIDE_IT, OF_IT_BESIDE = 25.0, 0.06
"""or, beside the answer, one explains less than so much, or less than that share of it. Of 410 right names of strangers
that judgements had spent five were so far behind (what yaw or collective moves is known by its score better than by
what is foretold where the chirp shows) and left 11, 14 and shares of 0.003 to 0.036 to a term; of 27 names that hid
what the catalogue does not have 22 were, and left 27 and 0.07 or more. Mostly the term was what was there."""
OF_A_BEND = 0.9
"""Of the chi squared that a limit of the commands explains, that a power of theirs explains at least for the limit only
to resemble it: of links that give way, named as limits at 0.99, it explained 1.0 to 1.4 of 74 to 228; of six limits
with 62 to 357 it was the likeliest term of two, with 0.6 at most."""
BY_FEEDBACK = 0.15
"""Share of an output's error up to which commands seem to explain it by feedback alone, where their excitation is not
logged: doubled gusts and loops of double gain made up to 0.08 on clean flights, four times the gusts 0.145, and effects
of usual size 0.25 and more."""
A_LOOP_MAKES, NO_LOOP_MAKES = math.log(1e-12), math.log(1e-40)
"""Logarithms of the chance of noise. 46 clean strange flights of 8 to 25 s showed at most 1e-4; of 23 in loops of
double gain, fourfold gusts and chirps of less than half, 20 more than the first, and the others 1e-16, 1e-23 and 1e-24.
Of 19 flights as drawn that hid what they could show, 11 showed less than the second."""
NEW_BY_FEEDBACK = 0.025
"""The same of what is new in every sample, where a short past foretells the noise: fourfold gusts in chirps of less
than half, in a loop of double gain, made up to 0.022."""

OLDER = 0.3
"""Of what commands explain beyond chance, that those before the latest sample must. Outputs and commands are known up
to a band's edge: what a controller makes of an output rings at that frequency, before it, too, so that the latest
command knows a little of what is new. Of 18 false alarms in loops of double gain or fourfold gusts 13 had less, 0.26 at
most, of 266 strangers with an effect two, and 95 in 100 more than 0.56."""


def latest_alone(parent: Candidate) -> bool:
    """Whether what the latest sample of the commands seems to do is nearly all that explains what the parent leaves."""
    new, step, left = parent.metric, parent.stepped, parent.division
    if not isinstance(new, Innovations) or log_chance(left.chi_squared, left.degrees) >= SIGNIFICANT:
        return False
    older, degrees = new.surprise(step.residual, step.J, left.commands, youngest=2)
    return older - degrees < OLDER * (left.chi_squared - left.degrees)


def least(left: Division) -> float:
    """Of what can be explained, that an answer explains, by how what is left was divided."""
    return EXPLAINED if left.measured else EXPLAINED_IN_A_LOOP


def contradicted(one: Ranked) -> bool:
    """Whether it explains too little of the validation runs, chance taken off."""
    return one.validation_share is not None and min(1.0, one.validation_share + one.validation_slack) < VALIDATED


def _surely_shows(one: Ranked) -> bool:
    """Whether it explains enough of the validation runs, whatever chance does."""
    return one.validation_share is not None and one.validation_share - one.validation_slack >= VALIDATED


def _steady(fit: Candidate) -> bool:
    """Whether nothing in it acts on samples of the commands."""
    return all(effect.samples is None for effect in fit.model.structure.composed)


@dataclass(frozen=True, kw_only=True, eq=False)
class Shares:
    """Of the parent's error, what is noise and what can be explained; on the validation runs too."""

    least: float
    """Of what can be explained, that an answer explains."""
    error_share: float
    """E0, the parent's."""
    noise_share: float
    """N, of it what nothing recorded explains."""
    noise_floor_percent: dict[str, float]
    terms: Selection | None
    mode: SlowMode | None
    """A slow mode beside the likeliest candidate, where it is surely no noise."""
    validation: ByPower | ByWhatIsNew | None
    new_share: float
    """Of what past noise does not foretell, what is no noise: by the commands, or by the likeliest candidate."""
    noise_lost: bool
    """Whether noise was flown with the chirps, in a log that has not every sample of it."""
    latest_alone: bool
    """Whether the latest sample of the commands is all that explains anything, where no excitation is logged."""
    most_explained: float
    """Chi squared, by any candidate, less what its parameters explain BY_CHANCE;"""
    most_paid: float
    """and by any, less what its parameters cost;"""
    paid_with: float
    """the same of the likeliest candidate, or of the structure itself where none is likelier, with what simple terms
    or a slow mode explain beside it."""
    beside: Callable[[Candidate], float]
    """Chi squared of what simple terms or a slow mode explain beside a candidate."""
    parent: Candidate
    whitening: Whitening
    """The noise that the likeliest candidate leaves."""
    term: Callable[[Candidate], Term | None]
    """The simple term that explains most beside a candidate."""

    @classmethod
    def of(cls, candidates: Sequence[Ranked], significant: bool, reference: Reference) -> Shares:
        parent = reference.parent
        fits = [one for one in candidates if one.fit is not None]
        likeliest = min(fits, key=lambda one: one.delta_bic, default=None)
        paid = 0.0 if likeliest is None else max(0.0, -likeliest.delta_bic)
        best = parent if likeliest is None or likeliest.fit is None or paid == 0 else likeliest.fit
        terms = reference.simple(best) if significant else None
        mode = _sure_mode(best, reference) if significant else None
        beside = partial(_beside, reference=reference) if significant else _nothing
        noise = noise_shares(best, terms) if significant else best.estimate.error.shares
        floor = dict(zip(parent.model.structure.outputs, map(float, 100 * (1 - np.sqrt(noise))), strict=True))
        return cls(
            least=least(parent.division),
            error_share=parent.error_share,
            noise_share=float(np.sum(noise)),
            noise_floor_percent=floor,
            terms=terms,
            mode=mode,
            validation=validation_of(fits, best, reference),
            new_share=_new_share(candidates, reference),
            noise_lost=noise_lost(parent.dataset),
            latest_alone=significant and latest_alone(parent),
            most_explained=max((one.chi_squared - BY_CHANCE * one.added for one in fits), default=0.0),
            most_paid=max([0.0, *(-one.delta_bic for one in fits)]),
            paid_with=paid + beside(best),
            beside=beside,
            parent=parent,
            whitening=reference.whitening,
            term=reference.term,
        )

    def by_feedback(self, left: Division, chance: float) -> bool:
        """Whether what can be explained is what the loop alone could make; `chance`, a logarithm, is that of noise.

        Noise on the chirps that a log lost goes around the loop with the rest, and how much of it nobody knows: clean
        flights logged at 50 of 400 and 500 Hz showed 1e-44 to 1e-142.
        """
        if left.measured or self.mode is not None:
            return False
        if self.latest_alone:
            return True
        if chance < NO_LOOP_MAKES and not self.noise_lost:
            return False
        if chance > A_LOOP_MAKES or self.noise_lost:
            return True
        explained = [*(1 - left.noise_share), 1 - self.noise_share / max(self.error_share, 1e-300)]
        return bool(max(explained) <= BY_FEEDBACK or self.new_share <= NEW_BY_FEEDBACK)

    def told(self, one: Ranked) -> Ranked:
        """The candidate with the shares that it explains."""
        if one.fit is None:
            return one
        share = self._by_power(one)
        if share < self.least and one.fit.division.measured and self._powers_mean_little(one.fit):
            share = self._by_the_noise(one)
        if self.validation is None or one.validation_error is None:
            return replace(one, explained_share=share)
        there, slack = self.validation.share(one)
        return replace(one, explained_share=share, validation_share=there, validation_slack=slack)

    def _powers_mean_little(self, fit: Candidate) -> bool:
        """Whether powers do not tell what it left: the parent's least squares took gusts of the loop for answers, or
        its own numbers are known too vaguely."""
        wrong = fit.error_share > self.error_share
        return wrong or _left_by_chance(fit) > VAGUE * (self.error_share - self.noise_share)

    def enough(self, one: Ranked) -> bool:
        """Whether it explains what can be explained, on fitted and on validation runs."""
        return not contradicted(one) and self._share(one) >= self.least and not self.outdone(one)

    def may_be(self, one: Ranked) -> bool:
        """Whether it may be the answer in place of one that is: it explains enough, or does by the noise's own measure,
        where powers tell gusts: a filter whose corner the noise alone tells left as much power as its parent."""
        if self.enough(one):
            return True
        assert one.fit is not None
        if contradicted(one) or self.outdone(one):
            return False
        return _steady(one.fit) and one.fit.division.measured and self._by_the_noise(one) >= self.least

    def leaves_much(self, one: Ranked) -> bool:
        """Whether it leaves so much of what the commands explain beyond noise, or another explains so much more, that
        it only resembles what is there, whatever powers say; a pair, by its powers alone where these tell."""
        assert one.fit is not None
        if one.fit.division.measured:
            return len(one.effects) == 1 and self._by_the_noise(one) < EXPLAINED_BY_NOISE
        by_noise = self._by_the_noise(one, in_a_loop=OF_A_NAME)
        return by_noise < BY_NOISE_IN_A_LOOP or self._of_most(one) < EXPLAINED_BY_NOISE

    def by_a_term(self, one: Ranked) -> Term | None:
        """The simple term that explains so much more than an answer that this can only resemble what is there; than a
        limit, nearly as much, if it bends the commands."""
        assert one.fit is not None
        term = self.term(self.parent)
        if term is not None and term.entry.bends and _limits(one):
            return term if term.chi_squared >= OF_A_BEND * max(one.chi_squared, one.foretells) else None
        if term is None or one.chi_squared > min(OF_A_TERM * term.chi_squared, term.chi_squared - MORE_BY_A_TERM):
            return None
        beside = self.term(one.fit)  # asked last: it is of the few that are so far behind
        least = max(BESIDE_IT, OF_IT_BESIDE * term.chi_squared)
        return None if beside is None or beside.chi_squared < least else term

    def outdone(self, one: Ranked) -> bool:
        """Whether others, or simple terms beside the likeliest and beside itself, explain so much more at the same cost
        that it can only resemble what is there: powers need not show that beside the noise."""
        assert one.fit is not None
        own, cost = max(0.0, one.chi_squared), one.delta_bic + one.chi_squared
        if own < OF_MOST * (self.most_paid + cost):
            return True
        # what stands beside it is dear to look for, and only spares it
        return own < OF_MOST * (self.paid_with + cost) and own < OF_MOST * (own + self.beside(one.fit))

    def short(self, one: Ranked) -> float:
        """How far it is from explaining all that can be explained, on fitted runs or, chance taken off, on validation
        runs."""
        there = 1.0 if one.validation_share is None else one.validation_share + one.validation_slack
        return min(1.0, max(0.0, 1 - min(self._share(one), there)))

    def left(self, one: Ranked) -> float:
        """What it leaves of what can be explained: by power on the fitted runs, HALF at most where powers mean little,
        or `short`, whichever is more."""
        assert one.fit is not None
        by_power = 1 - self._by_power(one)
        if by_power > HALF and self._powers_mean_little(one.fit):
            told = one.fit.division.measured or self._by_the_noise(one) >= NEARLY_ALL
            by_power = HALF if told else by_power
        return max(self.short(one), by_power)

    def _by_power(self, one: Ranked) -> float:
        assert one.fit is not None
        E0, N = self.error_share, self.noise_share
        return float(np.clip((E0 - one.fit.error_share) / max(E0 - N, 1e-300), 0, 1))

    def _share(self, one: Ranked) -> float:
        """What it explains on the fitted runs; by the noise's own measure where that is little beside the noise, where
        powers nearly say that it is enough, or where feedback lets commands explain gusts, too. (Play, limits and dead
        bands follow gusts there: of these only what explains half by power, and surely shows on the validation runs, or
        NEARLY all.) Where an excitation is logged a single effect may be DOUBTFUL by powers, and leave hardly anything
        by the noise.
        """
        assert one.fit is not None
        measured, share = one.fit.division.measured, one.explained_share or 0.0
        told = _steady(one.fit) or share >= NEARLY or (share >= HALF and _surely_shows(one))
        little = self.error_share - self.noise_share < LITTLE * self.noise_share
        nearly = share >= NEARLY if measured else told
        doubtful = measured and len(one.effects) == 1 and share >= DOUBTFUL
        if share >= self.least or not (little or nearly or doubtful):
            return share
        most = self._of_most(one)
        # what it leaves is dear to measure, and only makes the share less
        by_noise = self._by_the_noise(one) if most >= self.least else most
        return by_noise if little or nearly or by_noise >= NEARLY_ALL else share

    def _by_the_noise(self, one: Ranked, in_a_loop: float = 0.0) -> float:
        """Of what can be explained, by chi squared: of what it leaves to the commands beyond chance, or another
        explains; standard deviations of that, taken off where no excitation is logged, are `in_a_loop`."""
        assert one.fit is not None
        own, chance = max(0.0, one.chi_squared), SLACK if one.fit.division.measured else in_a_loop
        most = self._of_most(one)
        left = misfit(one, chance) if most < DOUBTFUL else self._beyond_noise(one, chance)  # no answer either way
        return min(own / max(own + left, 1e-300), most)

    def _beyond_noise(self, one: Ranked, chance: float) -> float:
        """Chi squared that it leaves; where noise comes in bursts no more than simple terms or a slow mode explain of
        that, for by windows of frequency alone bursts do."""
        assert one.fit is not None
        assert one.stepped is not None
        left = misfit(one, chance)
        if left <= (1 - EXPLAINED_BY_NOISE) * one.chi_squared or not one.fit.division.measured:
            return left
        return min(left, self.beside(one.fit)) if one.stepped.envelope(self.whitening).rough else left

    def _of_most(self, one: Ranked) -> float:
        """By chi squared, of what the candidate explains that explains most with as many parameters."""
        own = max(0.0, one.chi_squared)
        return own / max(own, self.most_explained + BY_CHANCE * one.added, 1e-300)


def _sure_mode(one: Candidate, reference: Reference) -> SlowMode | None:
    """A slow mode beside a candidate, where it is surely no noise and no loop makes it."""
    mode, least = reference.mode(one), SIGNIFICANT if reference.parent.division.measured else A_LOOP_MAKES
    return None if mode is None or mode.log_p >= least else mode


def _beside(one: Candidate, reference: Reference) -> float:
    """Chi squared of the simple terms, or a slow mode, beside a candidate, where these are as significant as
    TERM_TAKES: how many there were to choose from is paid by that. In a loop terms explain gusts, too."""
    mode = _sure_mode(one, reference)
    shaken = 0.0 if mode is None else mode.chi_squared
    if not reference.parent.division.measured:
        return shaken
    return max(shaken, sum(term.chi_squared for term in reference.simple(one).terms if term.log_p < TERM_TAKES))


def _nothing(_: Candidate) -> float:
    return 0.0


def _new_share(candidates: Sequence[Ranked], reference: Reference) -> float:
    left = reference.parent.division
    explained = [left.chi_squared - left.degrees, *(one.chi_squared - one.added for one in candidates)]
    return max(0.0, *explained) / max(reference.stepped.residual.size, 1)


def _left_by_chance(fit: Candidate) -> float:
    """Error share that the standard errors of its numbers leave to be expected."""
    names = fit.model.structure.names
    free = [names.index(name) for name in fit.free]
    variance, axes = np.linalg.eigh(fit.estimate.covariance[np.ix_(free, free)])
    moves = (axes * np.sqrt(np.maximum(variance, 0))).T
    power = sum(
        np.sum(np.abs(group.scale * np.tensordot(moves, J, 1)) ** 2, axis=(0, 2))
        for group, J in zip(fit.dataset.stacks, fit.J, strict=True)
    )
    return float(np.sum(power / fit.estimate.error.measured_power))


def _limits(one: Ranked) -> bool:
    """Whether it is a limit of the commands: a single effect on their samples, within which no servo rests."""
    return len(one.own) == 1 and one.own[0].samples is not None and one.own[0].rests_within is None
