"""In what order chains of two effects are looked for: the best second ones on the best first, where those leave what is
not noise. They are not searched for crumbs."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
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
from sysid.diagnose.fitted_chains import ASKED, DEAR, FittedChains, names_of
from sysid.diagnose.left_by_one import MUCH_BY_NOISE, harmless, left_by_noise, points_left, share_left
from sysid.diagnose.likely import ALIKE, SAME, do_else, doubtful, impossible, misfit
from sysid.diagnose.loop_change import Limit
from sysid.diagnose.on_samples import on_samples_beside
from sysid.diagnose.progress import Listener
from sysid.diagnose.refits import NEAR, PRICES
from sysid.diagnose.score import log_chance
from sysid.diagnose.unsearched import BudgetSpent, LittleLeft, MuchLeft, Unsearched
from sysid.model.acting import linear_dynamics
from sysid.model.effect import catalogue, parts_of, tied

PARENTS_OF_PAIRS = 3
MOST_FIRSTS = 5
LEAST_OF_BEST = 0.1
"""Of what the best effect explains, that another explains to begin a chain: what is less is found beside the best."""
SECONDS = 4
"""How many effects are refitted on each of them."""
HOPEFUL, HOPEFUL_IN_A_LOOP = 0.88, 0.8
"""Of the chi squared that there is, that the best chain from the first effect explains at least for others to be looked
for: on strangers that judgements had spent it explained 0.94 by then where a chain of two was the answer (28 of
28, and 12 of 13 later ones; 0.89 of the last), and less than this in 17 of 25 searches of what the catalogue does not
have. Such as went on from 0.8 found one wrong answer, in up to four seconds more. Where no excitation is logged what is
left is told less well: there a limit beside a hub was found that had less."""
HOPELESS = 0.5
"""The same of the effect that promises most beside it, below which no other is tried beside it: of 24 right chains of
two the least explained 0.59 by then, and 22 of 70 others less than half. Nor is anything put in a doubtful half's place
there."""
NEARLY_AS_MUCH = 0.8
"""Of the chi squared of the likeliest effect, where that is not plausible, that a plausible one explains which chains
are begun with instead: of 35 strangers that hid two, 13 had a half in that one, and 5 in the likeliest, two of them a
tether."""
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
    no_need = chains.look(able, named, limit or Limit())
    parts = chains.parts_of(named or able[0], singles)
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


class _Chains(FittedChains):
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
            if names_of(one, other) not in self.found and (beside := self.fitted_alone(_unasked(one))) is not None:
                self.fit(beside, _unasked(other))
        return [self.found[names_of(*pair)] for pair in pairs if names_of(*pair) in self.found]

    def search(self, able: Sequence[Ranked]) -> bool:
        """Begin with the best of the able, then with the halves of the best chain; False where the very best alone
        leaves noise."""
        waiting, done = _different(able), set[str]()
        # what only stands in may be far from any half: what is plausible and explains nearly as much is begun with
        begin = next((one for one in waiting if not impossible(one) and _as_much(one, able[0])), able[0])
        waiting.sort(key=lambda one: one is not begin)
        hopeful = HOPEFUL if self.measured else HOPEFUL_IN_A_LOOP
        while waiting and len(done) < MOST_FIRSTS:
            first = waiting.pop(0)
            done.add(first.effect)
            if not self.begin_with(first):
                if first is able[0] and not first.implausible and not self.found:
                    return False
                continue
            if self.found and first is begin and _explained(self.best) < hopeful:
                if _explained(self.best) >= HOPELESS:
                    self.exchange_resting()
                    self.exchange_doubtful()
                    self.exchange_for_a_tether()
                if (explained := _explained(self.best)) < hopeful:
                    self.given_up = MuchLeft(self.best.effects, explained)
                    return True
            if self.found and self.leaves_noise(self.best):
                break
            if not waiting and self.found:
                # each half of the best chain may have another partner that does better still
                waiting = self.halves_of_the_best(done)
        self.improve()
        return True

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
        asked = self.seconds.get(named.effect) or self.ask_beside(named) or ()
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
            self.fitted_alone(_unasked(name))
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
        chosen = self.of_each_kind(self.without_twins(self.able_beside(begun, asked)), begun)[:SECONDS]
        for second, promise in sorted(chosen, key=lambda each: self.price_of(each[0], begun) >= DEAR):
            if names_of(first.effect, second.effect) not in self.found and self.promising(first, promise):
                self.fit(first, second)
                # what has no fit there stands for none: its response, or a size of it, went beyond all bounds
                if promise is not second and names_of(first.effect, second.effect) not in self.found:
                    self.fit(first, promise)
            if second is chosen[0][0] and self.found and _explained(self.best) < HOPELESS:
                break
        return True

    def without_twins(self, seconds: Sequence[Ranked]) -> list[Ranked]:
        """Of those that alone answer the same to the last digits the first: the others are exchanged for it at the
        end."""
        kept: list[Ranked] = []
        for one in seconds:
            if not any(self.twins(one.effect, other.effect) for other in kept):
                kept.append(one)
        return kept

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
        return second.score.chi_squared >= NEAR * (best - first.chi_squared)

    def exchange_halves(self) -> None:
        """Put what may stand there in the place of each half of the best chain, until none is better."""
        while True:
            best = self.best
            for first, second in self.exchanges(best):
                self.fit(first, second, exchanged=True)
                if self.best.effects != best.effects:
                    break
            else:
                return

    def exchange_resting(self) -> None:
        """Put what rests as a half of the best chain does in its place, beside the other half as that is alone."""
        for other, one in self.resting_in_place(self.best):
            self.fit(other, one, exchanged=True)

    def exchange_for_a_tether(self) -> None:
        """Put a tether in the place of a half of the best chain that explains hardly more alone: what else is plausible
        is begun with, and a weathercock beside play had explained two thirds of what a stand did."""
        tethers = [one for one in self.alone.values() if tied(one.effects)]
        for half, other in (self.best.effects, self.best.effects[::-1]):
            for one in tethers:
                if half in self.single and _as_much(one, self.single[half]) and self.is_new(one, other):
                    self.fit(one, _unasked(other), exchanged=True)

    def exchange_larger(self) -> None:
        """Put what a half contains in its place, in the likeliest chains, where that is cheap: a lag of each axis with
        a hub explained a hair more than a lag of all with a damping, which no exchange of one half alone came to."""
        near = [one for one in self.found.values() if one.delta_bic < self.best.delta_bic + SAME]
        for chain in sorted(near, key=rank):
            for half, other in (chain.effects, chain.effects[::-1]):
                for one in self.contained_in(half):
                    if self.is_new(one, other) and one.fit and 0 < self.price_of(_unasked(other), one.fit) < DEAR:
                        self.fit(one, _unasked(other), exchanged=True)

    def contained_in(self, half: str) -> list[Ranked]:
        """Single effects that this one contains, however implausible they are alone: that hangs on what else there
        is."""
        known = catalogue()
        return [self.single[name] for name in (known[half].contains if half in known else ()) if name in self.single]

    def exchange_doubtful(self) -> bool:
        """Put plausible effects in the place of what has doubtful values in the likeliest chains, where the very best
        is not plausible: what only resembles explains much beside everything, and nothing was begun with what is there.
        Whether one is better than the best then."""
        best = self.best
        if not impossible(best):
            return False
        near = [one for one in self.found.values() if one.chi_squared > best.chi_squared - SAME]
        for chain in sorted(near, key=rank):
            for half, other in (chain.effects, chain.effects[::-1]):
                if (half, other) in self.replaced or not _doubtful(chain, half) or _doubtful(chain, other):
                    continue
                self.replaced.add((half, other))
                if (beside := self.fitted_alone(_unasked(other))) is not None:
                    for one in self.plausible_beside(beside)[:SECONDS]:
                        self.fit(beside, one, exchanged=True)
        return self.best.effects != best.effects

    def plausible_beside(self, other: Ranked) -> list[Ranked]:
        """Plausible effects that alone explain most and do something else, and are linear beside this one."""
        begin = other.fit
        assert begin is not None
        return [
            _unasked(one.effect)
            for one in self.without_twins(sorted(self.alone.values(), key=rank))
            if self.is_new(one, other.effect)
            and do_else(one, other)
            and 0 < self.price_of(one, begin) < PRICES["samples"]
        ]

    def exchanges(self, chain: Ranked) -> Iterator[tuple[Ranked, Ranked]]:
        """What rests as a half of it does, promised as much alone and was not fitted, explains the same alone, or by
        its score as much beside the other half; each with what it is to be fitted beside."""
        yield from self.resting_in_place(chain)
        for half, other in (chain.effects, chain.effects[::-1]):
            for one in self.promised_as_much(half):
                if self.is_new(one, other) and (beside := self.fitted_alone(one)) is not None:
                    yield beside, _unasked(other)
        for half, other in (chain.effects, chain.effects[::-1]):
            again = _unasked(other)
            for one in self.like_alone(half):
                if self.is_new(one, other) and self.not_too_dear(one, half, again):
                    yield one, again
            for one in self.like_beside(other, half):
                if self.is_new(one, other):
                    yield self.single[other], one
            yield from self.made_with(half, other)

    def made_with(self, half: str, other: str) -> Iterator[tuple[Ranked, Ranked]]:
        """What may be made of this half and something: of what is late a second order, which alone took up the other
        half, too. One for those that predict the same."""
        beside = self.single.get(other)
        if beside is None or beside.fit is None:
            return
        known = catalogue().items()
        whole = next((_unasked(name) for name, one in known if any(half in parts for parts in one.made_of)), None)
        if whole is not None and self.is_new(whole, other) and 0 < self.price_of(whole, beside.fit) < DEAR:
            yield beside, whole

    def promised_as_much(self, half: str) -> list[Ranked]:
        """What by itself scored as much as this half, and nearly the most of all, and was not fitted, for others left
        noise: beside another half these may leave much. (A damping of squared rates, for one of rates in its place.)"""
        if half not in self.scored:
            return []
        least = max((1 - ALIKE) * max(one.chi_squared for one in self.scored.values()), self.scored[half].chi_squared)
        promised = (name for name, one in self.scored.items() if one.chi_squared >= least)
        return [_unasked(name) for name in promised if name not in self.single]

    def resting_in_place(self, chain: Ranked) -> Iterator[tuple[Ranked, Ranked]]:
        """What rests as a half of it does, after the other half, beside which it is to be fitted."""
        for half, other in (chain.effects, chain.effects[::-1]):
            if other in self.single:
                yield from ((self.single[other], one) for one in self.rests_as(half) if self.is_new(one, other))

    def rests_as(self, half: str) -> list[Ranked]:
        """A dead band for play and the other way round, which beside a lag only fits tell apart."""
        resting = [one.id for one in (*catalogue().values(), *self.reference.users) if one.rests_within is not None]
        return [_unasked(name) for name in resting if half in resting and name != half]

    def not_too_dear(self, one: Ranked, half: str, other: Ranked) -> bool:
        """Whether a refit is cheap, or may be worth it: what alone explains less than a half of the best chain by more
        than the other half adds does not make up for it beside that."""
        assert one.fit is not None
        best = self.best
        alone = self.single[half].chi_squared
        return one.chi_squared >= 2 * alone - best.chi_squared or self.price_of(other, one.fit) < DEAR

    def like_alone(self, half: str) -> list[Ranked]:
        """Single effects that explain the same as this one, and are as plausible; twins, which tell nothing, last."""
        if half not in self.single:
            return []
        here = self.single[half]
        fair = self.single.values() if here.implausible else self.alone.values()
        like = [one for one in fair if one.chi_squared > 0 and not do_else(one, here)]
        return sorted(like, key=lambda one: self.twins(one.effect, half))

    def like_beside(self, other: str, half: str) -> list[Ranked]:
        """What is significant and scores nearly as much as this half beside the other one, and is cheap to fit there;
        the first SECONDS of them."""
        if other not in self.single:
            return []
        begin, seconds = self.single[other].fit, self.seconds_beside(other)
        promised = next((one.score.chi_squared for one in seconds if one.effect == half and one.score), math.inf)
        like = [
            one
            for one in seconds
            if one.score is not None
            and one.score.log_p <= SIGNIFICANT
            and one.score.chi_squared >= (1 - ALIKE) * promised
        ]
        return [one for one in like if begin is not None and 0 < self.price_of(one, begin) < DEAR][:SECONDS]

    def seconds_beside(self, other: str) -> Sequence[Ranked]:
        """What was asked beside an effect that was fitted alone; asked now, where an excitation is logged and nothing
        there is simulated in time: something else may explain still more beside it. (In a loop errors do, too.)"""
        alone = self.single[other]
        assert alone.fit is not None
        if other not in self.seconds and alone.fit.division.measured and linear_dynamics(alone.fit.model.structure):
            self.ask_beside(alone)
        return self.seconds.get(other, [])


def _unasked(name: str) -> Ranked:
    return Ranked(effects=(name,), score=None, not_testable=None)


def _doubtful(chain: Ranked, half: str) -> bool:
    """Whether values of this half are outside what physics allows, or at a bound."""
    own = {name for one in chain.own_of(half) for name in one.names}
    return not own.isdisjoint(doubtful(chain))


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


def _as_much(one: Ranked, best: Ranked) -> bool:
    """Whether it explains nearly as much as the best."""
    return one.chi_squared > NEARLY_AS_MUCH * best.chi_squared


def _explained(chain: Ranked) -> float:
    """Share of all chi squared beyond noise."""
    explained = max(0.0, chain.chi_squared)
    return explained / max(explained + misfit(chain), 1e-300)
