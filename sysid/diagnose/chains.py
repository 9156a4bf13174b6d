"""Chains of two effects: the best second ones on the best first, where those leave something that is not noise."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from sysid.diagnose.candidates import (
    REMAINDER,
    SIGNIFICANT,
    Progress,
    Ranked,
    Reference,
    chance_of_noise,
    noise_shares,
    rank,
    ranked,
    refitted,
    score_effects,
    silent,
)
from sysid.diagnose.evidence import gain
from sysid.diagnose.term_search import Selection

PARENTS_OF_PAIRS = 3
MOST_FIRSTS = 5
ALIKE = 0.2
"""Of what two effects explain, by which their answers must differ to begin two chains."""
SECONDS = 4
"""How many effects are refitted on each of them."""


def chains_of_two(singles: Sequence[Ranked], reference: Reference, say: Progress) -> list[Ranked]:
    """The best second effects on the best first ones, where those leave something that is not noise; best first."""
    fitted = [one for one in singles if one.fit is not None]
    able = [one for one in fitted if one.delta_bic < 0]
    if not able or _remainder(able[0], reference) < REMAINDER:
        return []
    chains = _Chains(fitted, reference, say)
    waiting, done = _different(able), set[str]()
    while waiting and len(done) < MOST_FIRSTS:
        first = waiting.pop(0)
        done.add(first.effect)
        if not chains.begin_with(first):
            if first is able[0]:
                return []  # the best one alone leaves noise
            continue
        if not waiting and chains.found:
            # each half of the best chain may have another partner that does better still
            best = chains.best
            waiting = [one for one in fitted if one.effect in best.effects and one.effect not in done]
    if chains.found:
        chains.exchange_halves()
    return sorted(chains.found.values(), key=rank)


class _Chains:
    """Chains that were fitted, each pair of effects once, at its best."""

    def __init__(self, fitted: Sequence[Ranked], reference: Reference, say: Progress) -> None:
        self.reference, self.say = reference, say
        self.alone = {one.effect: one for one in fitted if not one.implausible}
        """Plausible single effects."""
        self.found: dict[tuple[str, ...], Ranked] = {}

    @property
    def best(self) -> Ranked:
        return min(self.found.values(), key=lambda one: one.delta_bic)

    def begin_with(self, first: Ranked) -> bool:
        """Fit the most promising second effects beside the first; False where the first alone leaves noise."""
        assert first.fit is not None
        assert first.stepped is not None
        whitening, users = self.reference.whitening, self.reference.users
        seconds = score_effects(first.fit, first.stepped, whitening, users, silent)
        scores = [one.score for one in seconds if one.score is not None]
        if chance_of_noise(first.fit.division, scores) >= SIGNIFICANT:
            return False
        chosen = sorted((one for one in seconds if one.not_testable is None), key=_promise)[:SECONDS]
        for second in chosen:
            if _names(first.effect, second.effect) in self.found:
                continue
            if second.score is None or second.score.log_p <= SIGNIFICANT:
                self.fit(first, second)
        return True

    def fit(self, first: Ranked, second: Ranked) -> None:
        """Fit the second beside the first; and the first beside the second, where the one is not plausible."""
        self.say(" + ".join((first.effect, second.effect)))
        waiting = [(second, first)]
        while waiting:
            more, begin = waiting.pop()
            both = self._fitted(first, second, more, begin)
            if both is not None and begin is first and both.implausible and second.effect in self.alone:
                # alone, the first one stands in for the second too, and may not come away from there
                waiting.append((first, self.alone[second.effect]))

    def _fitted(self, first: Ranked, second: Ranked, more: Ranked, begin: Ranked) -> Ranked | None:
        """The chain, one more effect fitted to what it begins with; None where that has no fit. Kept where it is the
        best of its pair."""
        assert begin.fit is not None
        names = _names(first.effect, second.effect)
        again = refitted(more, begin.fit, self.reference.users)
        if again.fit is None:
            return None
        both = replace(again, effects=(first.effect, second.effect), fit=replace(again.fit, added=names))
        both = ranked(both, self.reference)
        if both.fit is not None and (names not in self.found or both.delta_bic < self.found[names].delta_bic):
            self.found[names] = both
        return both

    def exchange_halves(self) -> None:
        """What alone explains the same as a half of the best chain may stand in its place."""
        best = self.best
        for half, other in (best.effects, best.effects[::-1]):
            if half not in self.alone:
                continue
            same = [one for one in self.alone.values() if not _apart(one, self.alone[half])]
            for one in same:
                if one.effect not in best.effects and _names(one.effect, other) not in self.found:
                    self.fit(one, Ranked(effects=(other,), score=None, not_testable=None))


def _names(first: str, second: str) -> tuple[str, ...]:
    """Of a pair of effects, whichever came first."""
    return tuple(sorted((first, second)))


def _different(able: Sequence[Ranked]) -> list[Ranked]:
    """The best effects to begin a chain with: the best, then plausible ones that do something else than those."""
    chosen = [able[0]]
    for one in able[1:]:
        if len(chosen) == PARENTS_OF_PAIRS:
            break
        if not one.implausible and all(other.implausible or _apart(one, other) for other in chosen):
            chosen.append(one)
    return chosen


def _apart(one: Ranked, other: Ranked) -> bool:
    """Whether two effects explain different things: how far their answers are apart, beside what they explain."""
    assert one.stepped is not None
    assert other.stepped is not None
    return gain(one.stepped, other.stepped)[1] > ALIKE * min(one.chi_squared, other.chi_squared)


def _remainder(one: Ranked, reference: Reference) -> float:
    """Share of what can be explained that this effect leaves, as far as the commands or a simple term explain it."""
    assert one.fit is not None
    fit, parent = one.fit, reference.parent

    def left(terms: Selection | None) -> float:
        rest = fit.error_share - float(np.sum(noise_shares(fit, terms)))
        return rest / max(parent.error_share - fit.error_share + rest, 1e-300)

    linear = left(None)
    return linear if linear >= REMAINDER else left(reference.simple(fit))  # a limit leaves nothing linear


def _promise(one: Ranked) -> float:
    return -math.inf if one.score is None else -one.score.chi_squared
