"""Chains of two effects fitted, each once at its best, while a budget lasts: prices in base fits that are known before
anything is fitted, so that the same runs give the same answer on every machine."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

from sysid.diagnose.candidates import Ranked, Reference, composed_with, heard, ranked, score_effects
from sysid.diagnose.evidence import Candidate
from sysid.diagnose.levelled import as_alone, as_their_twins, begun_at_rest, levelled, near_another
from sysid.diagnose.likely import SAME, do_else, impossible, twins
from sysid.diagnose.progress import Asking, Listener, Stage, unheard
from sysid.diagnose.refits import PRICES, as_scored, does_nothing, goes_by_its_score, refitted
from sysid.diagnose.unsearched import BudgetSpent, MuchLeft
from sysid.fit.grow import looks
from sysid.model.acting import divided, linear_dynamics
from sysid.model.effect import EffectError, named_effect
from sysid.model.structure import Model, Structure

BUDGET = 300.0
"""Base fits that all chains of one diagnosis may cost (right ones had taken 22 to 156 when they were found, but what
stands in a half's place is exchanged at the end: with 200 a lag beside play was told as servos), by these prices:"""
KEPT_BACK = 50.0
"""beside that, for what a half of the best chain contains: it is cheap, and last;"""
DEAREST = 100.0
"""of one refit at most: a mode of four numbers, looked for beside a damping in time, took all of it and ten minutes;"""
ASKED = 20.0
"""of the catalogue's scores on one first effect;"""
SECONDS = 4
"""How many second effects are fitted beside each first one, or in the place of a half."""
LOOKS = {"linear": 0.6, "samples": 2.0, "in time": 15.0}
"""of a look at each beginning before a refit, by what has to be simulated, beside PRICES of that."""
OPPOSED = 2
"""Of what the runs show the opposite, so many are fitted all the same."""
DEAR = PRICES["in time"]
"""Price of a refit from which on it is for no crumbs."""


def price(composed: Structure, begin: Model) -> float:
    """Of a refit that grows from this model, in base fits."""
    if not linear_dynamics(composed):
        kind = "in time"
    else:
        kind = "samples" if divided(composed)[0] else "linear"
    return PRICES[kind] + LOOKS[kind] * looks(composed, begin.by_name)


class FittedChains:
    """Chains that were fitted, each pair of effects once, at its best; and what the search may yet cost."""

    def __init__(
        self, singles: Sequence[Ranked], reference: Reference, say: Listener, budget: float | None, answered: bool
    ) -> None:
        self.reference, self.say = reference, say
        self.budget = self.left = BUDGET if budget is None else budget
        self.kept_back = KEPT_BACK if budget is None else 0.0
        self.tried = 0
        self.answered = answered
        self.scored = {one.effect: one.score for one in singles if one.score is not None and one.not_testable is None}
        """What was asked of the structure itself, fitted or not."""
        self.single = {one.effect: one for one in singles if one.fit is not None}
        """Effects that were fitted alone;"""
        self.alone = {name: one for name, one in self.single.items() if not impossible(one)}
        """of them the plausible ones, and what a tether would be."""
        self.seconds: dict[str, list[Ranked]] = {}
        """What was asked beside each first effect, the most promising first."""
        self.found: dict[tuple[str, ...], Ranked] = {}
        self.replaced: set[tuple[str, str]] = set()
        """Doubtful halves that plausible effects were tried in the place of, each with the half beside it."""
        self.interrupted = False
        self.not_asked: dict[str, None] = {}
        self.not_fitted: dict[tuple[str, ...], tuple[str, str]] = {}
        self.given_up: MuchLeft | None = None

    @property
    def unsearched(self) -> BudgetSpent | MuchLeft | None:
        """What the budget, or who ended the search, left out; else why no other was looked for."""
        pairs = tuple(pair for names, pair in self.not_fitted.items() if names not in self.found)
        if pairs or self.not_asked or self.interrupted:
            return BudgetSpent(pairs, tuple(self.not_asked), self.interrupted)
        return self.given_up

    def interrupt(self) -> None:
        """Try nothing more; who wants the end at once interrupts once more."""
        self.left, self.interrupted = -math.inf, True

    def paid(self, cost: float) -> bool:
        """Whether the budget has this left, and one thing may cost so much; it is taken from it then."""
        if cost > min(self.left, DEAREST):
            return False
        self.left -= cost
        return True

    @property
    def best(self) -> Ranked:
        return min(self.found.values(), key=lambda one: one.delta_bic)

    def ask_beside(self, first: Ranked) -> Sequence[Ranked] | None:
        """What promises most beside an effect first, asked once; None where the budget, or who waits, has no time."""
        assert first.fit is not None
        assert first.stepped is not None
        if first.effect in self.seconds:
            return self.seconds[first.effect]
        if not self.paid(ASKED):
            self.not_asked[first.effect] = None
            return None
        self.say(Asking(stage=Stage.SECONDS, effects=first.effects))
        whitening, users = self.reference.whitening, self.reference.users
        try:
            seconds = score_effects(first.fit.asked_in(whitening), first.stepped, whitening, users, unheard)
        except KeyboardInterrupt:
            self.interrupt()
            self.not_asked[first.effect] = None
            return None
        self.seconds[first.effect] = sorted((one for one in seconds if one.not_testable is None), key=_promise)
        return self.seconds[first.effect]

    def alike(self, one: str, other: str) -> bool:
        """Whether two plausible effects explain the same alone."""
        return one in self.alone and other in self.alone and not do_else(self.alone[one], self.alone[other])

    def twins(self, one: str, other: str) -> bool:
        """Whether two plausible effects are the same one under two names."""
        return one in self.alone and other in self.alone and twins(self.alone[one], self.alone[other])

    def fit(self, first: Ranked, second: Ranked, exchanged: bool = False) -> None:
        """Fit the second beside the first, or the first beside the second where that is dear and this cheaper; and the
        other way round where the one is not plausible. What is `exchanged` for a half begins near a chain that was
        found."""
        self.tried += 1
        spent = min(1.0, 1 - self.left / self.budget) if self.budget > 0 else 1.0
        chain = (first.effect, second.effect)
        self.say(Asking(stage=Stage.CHAINS, effects=chain, number=self.tried, done=spent, at_most=True))
        ways = [(second, first)]
        turned = self.turned(first, second)
        if turned is not None:
            ways.insert(0, turned)
        for number, (more, begin) in enumerate(ways):
            assert begin.fit is not None
            there = near_another(more, begin, self.found, self.single, self.reference.users) if exchanged else None
            if not self.paid(self.price_of(more, begin.fit, there)):
                self.not_fitted[names_of(first.effect, second.effect)] = (first.effect, second.effect)
                return
            try:
                both = self._fitted(first, second, more, begin, there)
                if there is None and (both is None or both.chi_squared < begin.chi_squared - SAME):
                    both = self._fitted_as_alone(first, second, more, begin) or both
            except KeyboardInterrupt:
                self.interrupt()
                self.not_fitted[names_of(first.effect, second.effect)] = (first.effect, second.effect)
                return
            if both is not None and not impossible(both):
                return
            if number == 0 and turned is None:
                # alone, the first one stands in for the second too, and may not come away from there
                other = self.fitted_alone(second) if both is None else self.cheap_to_begin_with(first, second)
                ways += [] if other is None else [(first, other)]

    def cheap_to_begin_with(self, first: Ranked, second: Ranked) -> Ranked | None:
        """The second as it was fitted alone; where it is not plausible so, for the first is missing there, only to fit
        that cheaply."""
        other = self.single.get(second.effect)
        if other is None or other.fit is None or other.effect in self.alone:
            return other
        return other if 0 < self.price_of(first, other.fit) < DEAR else None

    def turned(self, first: Ranked, second: Ranked) -> tuple[Ranked, Ranked] | None:
        """The first to be fitted beside the second, where that was fitted alone and it is cheaper so: what is linear
        has to look for its valley, and each look is simulated beside what is not."""
        other = self.alone.get(second.effect)
        if other is None or other.fit is None or first.fit is None:
            return None
        price = self.price_of(second, first.fit)
        return (first, other) if price >= DEAR and self.price_of(first, other.fit) < price else None

    def fitted_alone(self, one: Ranked) -> Ranked | None:
        """The effect by itself, fitted now where it was not; None where it is not plausible there, or too dear."""
        parent = self.reference.parent
        if one.effect not in self.single and self.paid(self.price_of(one, parent)):
            try:
                alone = ranked(refitted(one, parent, self.reference.users), self.reference)
            except KeyboardInterrupt:
                self.interrupt()
                return None
            if alone.fit is not None:
                self.single[one.effect] = alone
                self.alone |= {} if impossible(alone) else {one.effect: alone}
        return self.alone.get(one.effect)

    def price_of(self, more: Ranked, begin: Candidate, near: Model | None = None) -> float:
        """Of one more effect fitted to what it begins with; nothing where it cannot act there."""
        structure, effect = begin.model.structure, named_effect(more.effect, self.reference.users)
        try:
            composed = composed_with(structure, effect, begin.dataset)
            if near is None and goes_by_its_score(more, composed, self.reference.users):
                return PRICES["in time"] if as_scored(more, composed, begin) is not None else 0.0
            return price(composed, near or begin.model)
        except EffectError:
            return 0.0

    def _fitted(self, first: Ranked, second: Ranked, more: Ranked, begin: Ranked, near: Model | None) -> Ranked | None:
        """The chain, one more effect fitted to what it begins with; None where that has no fit. Kept where it is the
        best of its pair."""
        assert begin.fit is not None
        names = names_of(first.effect, second.effect)
        again = refitted(more, begin.fit, self.reference.users, near)
        if again.fit is None or does_nothing(again.fit, begin.effects):
            return None
        both = replace(again, effects=(first.effect, second.effect), fit=replace(again.fit, added=names))
        both = ranked(both, self.reference)
        if both.fit is None:
            return None
        self.say(heard(both, self.reference.parent))
        if names not in self.found or both.delta_bic < self.found[names].delta_bic:
            self.found[names] = both
        return both

    def _fitted_as_alone(self, first: Ranked, second: Ranked, more: Ranked, begin: Ranked) -> Ranked | None:
        """The chain begun at both halves' values as they are alone, where it left more than one of them does: a dead
        band had stayed at twice its width, where its score was. None where that is not known, or too dear."""
        assert begin.fit is not None
        there = as_alone(more, begin, self.single, self.reference.users)
        if there is None or not self.paid(self.price_of(more, begin.fit, there)):
            return None
        return self._fitted(first, second, more, begin, there)

    def is_new(self, one: Ranked, other: str) -> bool:
        return one.effect != other and names_of(one.effect, other) not in self.found

    def able_beside(self, begun: Candidate, seconds: Sequence[Ranked]) -> list[Ranked]:
        """Of these what may be fitted to what is begun, or explains something alone, for that to be fitted to it. Those
        of which the runs show the opposite there, or a size that they cannot have, last but for the first OPPOSED: what
        is begun may be far from right."""
        able = [one for one in seconds if self.price_of(one, begun) > 0 or self.explains_alone(one.effect)]
        last = [one.effect for one in able if self._opposed(one, begun)][OPPOSED:]
        return sorted(able, key=lambda one: one.effect in last)

    def explains_alone(self, name: str) -> bool:
        """Whether it does surely, and is plausible."""
        return name in self.alone and self.alone[name].delta_bic < -SAME

    def _opposed(self, one: Ranked, begun: Candidate) -> bool:
        effect = named_effect(one.effect, self.reference.users)
        if one.score is None or not effect.linear:
            return False
        try:
            return as_scored(one, composed_with(begun.model.structure, effect, begun.dataset), begun) is None
        except EffectError:
            return True

    def level(self) -> None:
        """Fit once more what fell behind the best chain by where it ended; nothing after Ctrl-C."""
        if self.interrupted:
            return
        try:
            self.found |= levelled(self.best, self.found, self.alone, self.reference)
            self.found |= as_their_twins(self.best, self.found, self.single, self.reference)
            self.found |= begun_at_rest(self.found, self.reference)
        except KeyboardInterrupt:
            self.interrupt()


def names_of(first: str, second: str) -> tuple[str, ...]:
    """Of a pair of effects, whichever came first."""
    return tuple(sorted((first, second)))


def _promise(one: Ranked) -> float:
    return -math.inf if one.score is None else -one.score.chi_squared
