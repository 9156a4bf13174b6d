"""In what order chains of two effects are looked for: the best second ones on the best first, where those leave what is
not noise. They are not searched for crumbs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from sysid.diagnose.candidates import (
    CRUMBS,
    REMAINDER,
    SIGNIFICANT,
    Ranked,
    Reference,
    chance_of_noise,
    rank,
)
from sysid.diagnose.choice import both_surely
from sysid.diagnose.evidence import Candidate
from sysid.diagnose.exchanged_halves import ExchangedHalves, as_much, unasked
from sysid.diagnose.fitted_chains import ASKED, DEAR, SECONDS, names_of
from sysid.diagnose.left_by_one import MUCH_BY_NOISE, harmless, left_by_noise, points_left, share_left
from sysid.diagnose.likely import do_else, impossible, misfit
from sysid.diagnose.loop_change import Limit
from sysid.diagnose.on_samples import on_samples_beside
from sysid.diagnose.progress import Listener
from sysid.diagnose.refits import NEAR, acts_on_samples
from sysid.diagnose.score import log_chance
from sysid.diagnose.unsearched import BudgetSpent, LittleLeft, MuchLeft, Unsearched
from sysid.model.acting import linear_dynamics
from sysid.model.effect import parts_of

PARENTS_OF_PAIRS = 3
MOST_FIRSTS = 5
LEAST_OF_BEST = 0.1
"""Of what the best effect explains, that another explains to begin a chain: what is less is found beside the best."""
HOPEFUL, HOPEFUL_IN_A_LOOP = 0.88, 0.8
"""Of the chi squared that there is, that the best chain from the first effect explains at least for others to be looked
for: on strangers that judgements had spent it explained 0.94 by then where a chain of two was the answer (28 of
28, and 12 of 13 later ones; 0.89 of the last), and less than this in 17 of 25 searches of what the catalogue does not
have. Such as went on from 0.8 found one wrong answer, in up to four seconds more. Where no excitation is logged what is
left is told less well: there a limit beside a hub was found that had less."""
HOPELESS = 0.5
"""The same of the effect that promises most beside it, below which no other is tried beside it: of 24 right chains of
two the least explained 0.59 by then, and 22 of 70 others less than half. Nor is anything put in a doubtful half's place
there, or beside another effect."""
NEARLY_ALL = 0.9
"""Of the chi squared that there is, that an effect and what scores most beside it promise together for others to be
looked for all the same, beside it: in four searches that gave up with the right chain of two not fitted 1.03 to 1.1; of
13 of what the catalogue does not have one more than 0.85."""
NEAR_ON_SAMPLES = 0.5
"""As NEAR, of what acts on samples of the commands beside another effect, where an excitation is logged: it is scored
at a few sizes, and a dead band that explained 165 beside a hub had scored 70."""
AS_WELL = 0.9
"""Of what something not linear explains alone, that something linear does for chains to be begun with it: limits of
acceleration stood for lags, and a square of the rates for their damping. (Of 10,040 strangers this is so in the
searches of 18; ten hid two effects, of which three had not been found.)"""
SURELY_BESIDE = 30.0
"""Chi squared that an effect scores beside one that leaves crumbs by power, no excitation logged, to be looked for
there: of 57 right single names of strangers that a judgement had spent two had one; of six names of one half of two,
five."""
LEFT_BESIDE = 5.0
"""Chi squared beyond noise that such a name leaves, for that to be asked: of those 37 left less, of the six none."""


@dataclass(frozen=True, slots=True)
class ChainSearch:
    """What was found, best first, and what was not looked for."""

    pairs: tuple[Ranked, ...] = ()
    unsearched: Unsearched | None = None

    @property
    def interrupted(self) -> ChainSearch:
        """The same, ended by Ctrl-C."""
        spent = self.unsearched if isinstance(self.unsearched, BudgetSpent) else BudgetSpent(())
        return replace(self, unsearched=replace(spent, interrupted=True))


def chains_of_two(
    singles: Sequence[Ranked],
    reference: Reference,
    say: Listener,
    budget: float | None = None,
    limit: Limit | None = None,
    named: Ranked | None = None,
) -> ChainSearch:
    """The best second effects on the best first ones, where those leave something that is not noise; best first.

    `budget`: base fits that this may cost, BUDGET where none is named; `limit`: changes of margins from which on what
    is left matters. Where one effect is `named`, nothing is looked for where it explains nearly all or leaves crumbs,
    but for what is surely beside it without showing by power; else what is significant beside the best is tried,
    however little it is by power, and with the best the one that explains most on the validation runs.
    """
    able = [one for one in singles if one.fit is not None and one.delta_bic < 0]
    if not able:
        return ChainSearch()
    chains = _Chains(singles, reference, say, budget, named is not None)
    try:
        no_need = chains.look(able, named, limit or Limit())
        parts = chains.parts_of(named or able[0], singles)
    except KeyboardInterrupt:
        if chains.interrupted:
            raise
        chains.interrupt()
        return chains.told()
    if no_need is None:
        return chains.told()
    unsearched = chains.unsearched if chains.interrupted else no_need.unsearched
    return ChainSearch(tuple(sorted(parts, key=rank)), unsearched)


def _of_little(named: Ranked, reference: Reference, limit: Limit) -> ChainSearch | None:
    """What a search of no chains says, where an effect explains nearly all or leaves crumbs; else None."""
    if share_left(named, reference) < REMAINDER:
        return ChainSearch()
    if left_by_noise(named, reference) >= MUCH_BY_NOISE:
        return None
    points = points_left(named, reference)
    little = points < CRUMBS or harmless(named, points, limit)
    return ChainSearch(unsearched=LittleLeft(points)) if little else None


def _best_elsewhere(able: Sequence[Ranked]) -> Ranked | None:
    """What explains clearly more of the validation runs than the best of these, and is plausible: the other half of
    what no single effect is."""
    told = [one for one in able if one.validation_share is not None and not one.implausible]
    best = max(told, key=lambda one: one.validation_share or 0.0, default=None)
    if best is None or best is able[0]:
        return None
    return best if (best.validation_share or 0.0) > (able[0].validation_share or 0.0) + REMAINDER else None


class _Chains(ExchangedHalves):
    """In what order they are looked for."""

    def look(self, able: Sequence[Ranked], named: Ranked | None, limit: Limit) -> ChainSearch | None:
        """Look for chains; what to say where there is no need to, else None."""
        # an effect may leave something that powers need not show: play, limits, what rotor speed changes
        little = None if named is None else _of_little(named, self.reference, limit)
        if little is None:
            if named is None and (other := _best_elsewhere(able)) is not None:
                self.fit(able[0], other)
            if self.search(able):
                return None
            little = ChainSearch()  # the best one alone leaves noise
        return None if named is not None and self.surely_beside(named) else little

    def parts_of(self, whole: Ranked, singles: Sequence[Ranked]) -> list[Ranked]:
        """The pairs of other effects that may do together what this one does, fitted."""
        testable = {one.effect for one in singles if one.not_testable is None}
        pairs = [pair for pair in parts_of(whole.effect) if testable.issuperset(pair)]
        for one, other in pairs:
            if names_of(one, other) not in self.found and (beside := self.fitted_alone(unasked(one))) is not None:
                self.fit(beside, unasked(other))
        return [self.found[names_of(*pair)] for pair in pairs if names_of(*pair) in self.found]

    def search(self, able: Sequence[Ranked]) -> bool:
        """Begin with the best of the able, then with the halves of the best chain; False where the very best alone
        leaves noise."""
        different, done = _different(able), set[str]()
        begin = _begun_with(different, able)
        waiting = _first_of(begin, different)
        hopeful = HOPEFUL if self.measured else HOPEFUL_IN_A_LOOP
        while waiting and len(done) < MOST_FIRSTS:
            first = waiting.pop(0)
            done.add(first.effect)
            if not self.begin_with(first):
                if first is able[0] and not first.implausible and not self.found:
                    return False
                continue
            if self.found and first is begin and not self.goes_on(done, waiting, hopeful):
                other = _enough_by_power(begin, waiting)
                if other is None:
                    self.given_up = MuchLeft(self.best.effects, _explained(self.best))
                    return True
                begin, waiting = other, _first_of(other, waiting)
                continue
            if self.found and self.leaves_noise(self.best):
                break
            if not waiting and self.found:
                # each half of the best chain may have another partner that does better still
                waiting = self.halves_of_the_best(done)
        self.improve()
        return True

    def goes_on(self, done: set[str], waiting: Sequence[Ranked], hopeful: float) -> bool:
        """Whether the best chain explains so much that others are looked for: if not that from the first effect, then
        what may stand in its halves' places, or what promises nearly all beside another."""
        if HOPELESS <= _explained(self.best) < hopeful:
            self.exchange_resting()
            self.exchange_doubtful()
            self.exchange_for_a_tether()
            if _explained(self.best) < hopeful:
                self.begin_with_promising([*self.halves_of_the_best(done), *waiting], done, hopeful)
        return _explained(self.best) >= hopeful

    def begin_with_promising(self, firsts: Sequence[Ranked], done: set[str], hopeful: float) -> None:
        """Begin with those of them that promise nearly all; exchange halves where what is found is not yet hopeful."""
        promising = self.promising_nearly_all(firsts)
        for first in promising:
            self.begin_with(first)
            done.add(first.effect)
        if promising and _explained(self.best) < hopeful:
            self.exchange_halves()

    def promising_nearly_all(self, firsts: Sequence[Ranked]) -> list[Ranked]:
        """Of these the ones that, with what scores most beside them, promise nearly all that there is; the most
        promising first."""
        whole = self.best.chi_squared + misfit(self.best)
        promised: dict[str, float] = {}
        for first in firsts:
            asked = self.ask_beside(first) or ()
            most = max((one.score.chi_squared for one in asked if one.score is not None), default=0.0)
            promised[first.effect] = first.chi_squared + most
        able = {one.effect: one for one in firsts if promised[one.effect] >= NEARLY_ALL * whole}
        return sorted(able.values(), key=lambda one: -promised[one.effect])

    @property
    def measured(self) -> bool:
        """Whether an excitation is logged."""
        return self.reference.parent.division.measured

    def surely_beside(self, named: Ranked) -> bool:
        """Whether a second effect is surely beside one that leaves crumbs, where that need not show by power: in a loop
        whose excitation is not logged, and what acts on samples where one is. Looked for now."""
        assert named.fit is not None
        left = named.fit.division
        if left.measured:
            return self.foretold_beside(named)
        if not linear_dynamics(named.fit.model.structure) or misfit(named) < LEFT_BESIDE:
            return False
        asked = self.ask_beside(named) or ()
        for second in self.without_twins(self.able_beside(named.fit, asked))[:SECONDS]:
            if second.score is not None and second.score.chi_squared >= SURELY_BESIDE:
                self.fit(named, second)
        self.improve()
        return any(both_surely(one, named) for one in self.found.values())

    def foretold_beside(self, named: Ranked) -> bool:
        """Whether what acts on samples is, where what was imposed tells little of it; looked for now."""
        if not self.paid(ASKED):
            return False
        try:
            both = on_samples_beside(named, self.reference, self.say)
        except KeyboardInterrupt:
            self.interrupt()
            return False
        self.found |= {names_of(*one.effects): one for one in both}
        if both:
            self.exchange_for_a_tether()
            self.exchange_larger()
        return bool(both)

    def told(self) -> ChainSearch:
        """What was found, best first."""
        return ChainSearch(tuple(sorted(self.found.values(), key=rank)), self.unsearched)

    def improve(self) -> None:
        """Exchange halves of the best chain, if there is one, and fit once more what fell behind it."""
        if not self.found:
            return
        self.exchange_doubtful()
        self.exchange_halves()
        if self.exchange_doubtful():
            self.exchange_halves()
        self.exchange_larger()
        self.level()

    def halves_of_the_best(self, done: set[str]) -> list[Ranked]:
        """Those of them that were not begun with; fitted alone now, where they scored too little to be before."""
        names = [name for name in self.best.effects if name not in done]
        for name in names:
            self.fitted_alone(unasked(name))
        return [self.single[name] for name in names if name in self.single]

    def leaves_noise(self, chain: Ranked) -> bool:
        """Whether a chain of no doubtful values explains all: then others can but take its halves' places."""
        assert chain.fit is not None
        left = chain.fit.division
        return not chain.outside and log_chance(left.chi_squared, left.degrees) >= SIGNIFICANT

    def begin_with(self, first: Ranked) -> bool:
        """Fit the most promising second effects beside the first; False where the first alone leaves noise."""
        begun, asked = first.fit, self.ask_beside(first)
        assert begun is not None
        assert first.stepped is not None
        if asked is None:
            return True
        scores = [one.score for one in asked if one.score is not None]
        if chance_of_noise(begun.division, scores) >= SIGNIFICANT:
            return False
        # what is dear last: the best of the others may be out of its reach by then
        chosen, told = self.of_each_kind(self.without_twins(self.able_beside(begun, asked)), begun)[:SECONDS], False
        for second, promise in sorted(chosen, key=lambda each: self.price_of(each[0], begun) >= DEAR):
            if names_of(first.effect, second.effect) not in self.found and self.promising(first, promise):
                self.fit(first, second)
                # what has no fit there stands for none: its response, or a size of it, went beyond all bounds
                if promise is not second and names_of(first.effect, second.effect) not in self.found:
                    self.fit(first, promise)
            if not told and self.held_its_promise(first, second):
                told = True
                if self.found and _explained(self.best) < HOPELESS:
                    break
        return True

    def held_its_promise(self, first: Ranked, second: Ranked) -> bool:
        """Whether a chain explains, beyond its first effect, half of what the second's score promised, as linear ones
        do: a limit far from where it was scored may turn out to be none."""
        both = self.found.get(names_of(first.effect, second.effect))
        if both is None or both.fit is None or second.score is None or both.fit.model.structure.linear:
            return True
        return both.chi_squared - first.chi_squared >= HOPELESS * second.score.chi_squared

    def of_each_kind(self, seconds: Sequence[Ranked], begun: Candidate) -> list[tuple[Ranked, Ranked]]:
        """Each with itself; but of those that are dear to fit and alone explain the same, as lags and filters do, the
        one that alone explains most with the one that promises most. It stands for the others, which are exchanged for
        it at the end, and the budget reaches other kinds."""
        kept: list[tuple[Ranked, Ranked]] = []
        for one in seconds:
            dear = one.effect in self.alone and self.price_of(one, begun) >= DEAR
            like = next((k for k, other in enumerate(kept) if dear and self.alike(one.effect, other[0].effect)), None)
            if like is None:
                kept.append((one, one))
            elif self.alone[one.effect].chi_squared > self.alone[kept[like][0].effect].chi_squared:
                kept[like] = one, kept[like][1]
        return kept

    def promising(self, first: Ranked, second: Ranked) -> bool:
        """Whether the second is significant beside the first, and comes near to what the best answer (a chain, or a
        plausible effect alone) explains more; beside an answer, where it is dear, that it is no crumb."""
        if second.score is None:
            return True
        if second.score.log_p > SIGNIFICANT:
            return False
        crumb = self.answered and second.score.chi_squared < REMAINDER * first.chi_squared
        assert first.fit is not None
        if crumb and self.price_of(second, first.fit) >= DEAR:
            return False
        best = max((one.chi_squared for one in (*self.alone.values(), *self.found.values())), default=0.0)
        near = NEAR_ON_SAMPLES if self.measured and acts_on_samples(second) else NEAR
        return second.score.chi_squared >= near * (best - first.chi_squared)


def _different(able: Sequence[Ranked]) -> list[Ranked]:
    """The best effects to begin a chain with: the best, then plausible ones that do something else than those."""
    chosen = [able[0]]
    for one in able[1:]:
        if len(chosen) == PARENTS_OF_PAIRS:
            break
        if impossible(one) or one.chi_squared < LEAST_OF_BEST * able[0].chi_squared:
            continue
        if all(other.implausible or do_else(one, other) for other in chosen):
            chosen.append(one)
    return chosen


def _begun_with(different: Sequence[Ranked], able: Sequence[Ranked]) -> Ranked:
    """The best of the able; where it only stands in, and may be far from any half, what is plausible and explains
    nearly as much."""
    plausible = (one for one in different if not impossible(one) and as_much(one, able[0]))
    return _linear_for(next(plausible, able[0]), able)


def _first_of(one: Ranked, waiting: Sequence[Ranked]) -> list[Ranked]:
    return [one, *(other for other in waiting if other is not one)]


def _linear_for(one: Ranked, able: Sequence[Ranked]) -> Ranked:
    """What is linear and explains as much alone, of no doubtful values, where this one is not: beside it many more can
    be fitted for the same price."""
    if _linear(one):
        return one
    as_well = (other for other in able if _linear(other) and not other.outside and not other.implausible)
    return next((other for other in as_well if other.chi_squared >= AS_WELL * one.chi_squared), one)


def _linear(one: Ranked) -> bool:
    assert one.fit is not None
    return one.fit.model.structure.linear


def _enough_by_power(begun: Ranked, waiting: Sequence[Ranked]) -> Ranked | None:
    """What is plausible and explains alone nearly all that can be explained, by power, where what was begun with is no
    answer in free flight."""
    enough = (one for one in waiting if not one.implausible and (one.explained_share or 0.0) >= NEARLY_ALL)
    return next(enough, None) if begun.implausible else None


def _explained(chain: Ranked) -> float:
    """Share of all chi squared beyond noise."""
    explained = max(0.0, chain.chi_squared)
    return explained / max(explained + misfit(chain), 1e-300)
