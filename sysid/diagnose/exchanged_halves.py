"""What may stand in the place of a half of a chain: of the best one, where its other half stays."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

from sysid.diagnose.candidates import SIGNIFICANT, Ranked, rank
from sysid.diagnose.fitted_chains import DEAR, SECONDS, FittedChains
from sysid.diagnose.likely import ALIKE, SAME, do_else, doubtful, impossible
from sysid.diagnose.refits import PRICES
from sysid.model.acting import linear_dynamics
from sysid.model.effect import catalogue, tied

NEARLY_AS_MUCH = 0.8
"""Of the chi squared of the likeliest effect, where that is not plausible, that a plausible one explains which chains
are begun with instead: of 35 strangers that hid two, 13 had a half in that one, and 5 in the likeliest, two of them a
tether."""


class ExchangedHalves(FittedChains):
    """Chains that were fitted, and what else may stand in their halves' places."""

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
                if half in self.single and as_much(one, self.single[half]) and self.is_new(one, other):
                    self.fit(one, unasked(other), exchanged=True)

    def exchange_larger(self) -> None:
        """Put what a half contains in its place, in the likeliest chains, where that is cheap: a lag of each axis with
        a hub explained a hair more than a lag of all with a damping, which no exchange of one half alone came to."""
        self.left, self.kept_back = self.left + self.kept_back, 0.0
        near = [one for one in self.found.values() if one.delta_bic < self.best.delta_bic + SAME]
        for chain in sorted(near, key=rank):
            for half, other in (chain.effects, chain.effects[::-1]):
                for one in self.contained_in(half):
                    if self.is_new(one, other) and one.fit and 0 < self.price_of(unasked(other), one.fit) < DEAR:
                        self.fit(one, unasked(other), exchanged=True)

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
                if (beside := self.fitted_alone(unasked(other))) is not None:
                    for one in self.plausible_beside(beside)[:SECONDS]:
                        self.fit(beside, one, exchanged=True)
        return self.best.effects != best.effects

    def plausible_beside(self, other: Ranked) -> list[Ranked]:
        """Plausible effects that alone explain most and do something else, and are linear beside this one."""
        begin = other.fit
        assert begin is not None
        return [
            unasked(one.effect)
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
            for one in self.promisedas_much(half):
                if self.is_new(one, other) and (beside := self.fitted_alone(one)) is not None:
                    yield beside, unasked(other)
        for half, other in (chain.effects, chain.effects[::-1]):
            again = unasked(other)
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
        whole = next((unasked(name) for name, one in known if any(half in parts for parts in one.made_of)), None)
        if whole is not None and self.is_new(whole, other) and 0 < self.price_of(whole, beside.fit) < DEAR:
            yield beside, whole

    def promisedas_much(self, half: str) -> list[Ranked]:
        """What by itself scored as much as this half, and nearly the most of all, and was not fitted, for others left
        noise: beside another half these may leave much. (A damping of squared rates, for one of rates in its place.)"""
        if half not in self.scored:
            return []
        least = max((1 - ALIKE) * max(one.chi_squared for one in self.scored.values()), self.scored[half].chi_squared)
        promised = (name for name, one in self.scored.items() if one.chi_squared >= least)
        return [unasked(name) for name in promised if name not in self.single]

    def resting_in_place(self, chain: Ranked) -> Iterator[tuple[Ranked, Ranked]]:
        """What rests as a half of it does, after the other half, beside which it is to be fitted."""
        for half, other in (chain.effects, chain.effects[::-1]):
            if other in self.single:
                yield from ((self.single[other], one) for one in self.rests_as(half) if self.is_new(one, other))

    def rests_as(self, half: str) -> list[Ranked]:
        """A dead band for play and the other way round, which beside a lag only fits tell apart."""
        resting = [one.id for one in (*catalogue().values(), *self.reference.users) if one.rests_within is not None]
        return [unasked(name) for name in resting if half in resting and name != half]

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

    def without_twins(self, seconds: Sequence[Ranked]) -> list[Ranked]:
        """Of those that alone answer the same to the last digits the first: the others are exchanged for it at the
        end."""
        kept: list[Ranked] = []
        for one in seconds:
            if not any(self.twins(one.effect, other.effect) for other in kept):
                kept.append(one)
        return kept


def unasked(name: str) -> Ranked:
    return Ranked(effects=(name,), score=None, not_testable=None)


def _doubtful(chain: Ranked, half: str) -> bool:
    """Whether values of this half are outside what physics allows, or at a bound."""
    own = {name for one in chain.own_of(half) for name in one.names}
    return not own.isdisjoint(doubtful(chain))


def as_much(one: Ranked, best: Ranked) -> bool:
    """Whether it explains nearly as much as the best."""
    return one.chi_squared > NEARLY_AS_MUCH * best.chi_squared
