"""Chains of two effects: the best second ones on the best first, where those leave something that is not noise."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from sysid.data.dataset import Dataset
from sysid.diagnose.candidates import (
    REMAINDER,
    SIGNIFICANT,
    Progress,
    Ranked,
    Simple,
    chance_of_noise,
    noise_shares,
    rank,
    ranked,
    refitted,
    score_effects,
    silent,
)
from sysid.diagnose.evidence import Candidate, Stepped, gain
from sysid.diagnose.term_search import Selection
from sysid.diagnose.whitening import Whitening
from sysid.model.effect import Effect

PARENTS_OF_PAIRS = 3
MOST_FIRSTS = 5
ALIKE = 0.2
"""Of what two effects explain, by which their answers must differ to begin two chains."""
SECONDS = 4
"""How many effects are refitted on each of them."""


def chains_of_two(
    singles: Sequence[Ranked],
    parent: Candidate,
    stepped: Stepped,
    whitening: Whitening,
    users: Sequence[Effect],
    judging: Dataset | None,
    simple: Simple,
    say: Progress,
) -> list[Ranked]:
    """The best second effects on the best first ones, where those leave something that is not noise."""
    found: dict[tuple[str, ...], Ranked] = {}
    fitted = [one for one in singles if one.fit is not None]
    able = [one for one in fitted if one.delta_bic < 0]
    if not able or _remainder(able[0], parent, simple) < REMAINDER:
        return []
    alone = {one.effect: one for one in fitted if not one.implausible}

    def chained(first: Ranked, second: Ranked) -> None:
        """Fit the second beside the first."""
        names = tuple(sorted((first.effect, second.effect)))
        say(" + ".join((first.effect, second.effect)))
        ends = [(second, first)]
        while ends:
            more, begin = ends.pop()
            assert begin.fit is not None
            again = refitted(more, begin.fit, users)
            if again.fit is None:
                continue
            both = replace(again, effects=(first.effect, second.effect), fit=replace(again.fit, added=names))
            weighed = ranked(both, parent, stepped, whitening, judging)
            if weighed.fit is not None and (names not in found or weighed.delta_bic < found[names].delta_bic):
                found[names] = weighed
            if begin is first and weighed.implausible and second.effect in alone:
                # alone, the first one stands in for the second too, and may not come away from there
                ends.append((first, alone[second.effect]))

    waiting, done = _different(able), set[str]()
    while waiting and len(done) < MOST_FIRSTS:
        first = waiting.pop(0)
        done.add(first.effect)
        assert first.fit is not None
        assert first.stepped is not None
        seconds = score_effects(first.fit, first.stepped, whitening, users, silent)
        if chance_of_noise(first.fit.division, [one.score for one in seconds if one.score is not None]) >= SIGNIFICANT:
            if first is able[0]:
                return []  # the best one alone leaves noise
            continue
        chosen = sorted((one for one in seconds if one.not_testable is None), key=_promise)[:SECONDS]
        for second in chosen:
            names = tuple(sorted((first.effect, second.effect)))
            if names in found or (second.score is not None and second.score.log_p > SIGNIFICANT):
                continue
            chained(first, second)
        if not waiting and found:
            # each half of the best chain may have another partner that does better still
            best = min(found.values(), key=lambda one: one.delta_bic)
            waiting = [one for one in fitted if one.effect in best.effects and one.effect not in done]
    if found:
        best = min(found.values(), key=lambda one: one.delta_bic)
        for half, other in (best.effects, best.effects[::-1]):
            # what alone explains the same as a half may stand in its place
            for one in [one for one in alone.values() if half in alone and not _apart(one, alone[half])]:
                if one.effect not in best.effects and tuple(sorted((one.effect, other))) not in found:
                    chained(one, Ranked(effects=(other,), score=None, not_testable=None))
    return sorted(found.values(), key=rank)


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


def _remainder(one: Ranked, parent: Candidate, simple: Simple) -> float:
    """Share of what can be explained that this effect leaves, as far as the commands or a simple term explain it."""
    assert one.fit is not None
    fit = one.fit

    def left(terms: Selection | None) -> float:
        rest = fit.error_share - float(np.sum(noise_shares(fit, terms)))
        return rest / max(parent.error_share - fit.error_share + rest, 1e-300)

    linear = left(None)
    return linear if linear >= REMAINDER else left(simple(fit))  # a limit leaves nothing linear


def _promise(one: Ranked) -> float:
    return -math.inf if one.score is None else -one.score.chi_squared
