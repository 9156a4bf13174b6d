"""The rules of `gcs.flight.rules` over histories of messages, and that the checker sees when a rule is gone.

`tests/study/study_excitation.py` does the same over 100,000 histories, and tells how soon each rule is missed.
"""

from __future__ import annotations

from collections import Counter

import pytest
from excitation_rules import (
    MUTATIONS,
    SEEN_IN,
    History,
    Mutation,
    found_by,
    mutated,
    play,
    random_history,
    short_histories,
    shrunk,
    told,
)

NEAR = 25
"""So many histories, from the one that a mutation names, are tried on it; see the study for how soon it is found."""


def hold(history: History) -> None:
    """That no rule is broken in it; or its story."""
    if play(history).breaches:
        simpler = shrunk(history)
        pytest.fail(told(simpler, play(simpler, story=True)))


def test_no_rule_is_broken_in_random_histories() -> None:
    counts: Counter[str] = Counter()
    for seed in range(250):
        outcome = play(random_history(seed))
        counts += outcome.counts
        if outcome.breaches:
            hold(random_history(seed))
    # They exercise something.
    assert counts["starts that arrived"] > 100
    assert counts["ways back that arrived"] > 50
    assert counts["starts over a second late"] > 20


def test_no_rule_is_broken_in_whole_flights() -> None:
    for seed in range(40):
        hold(random_history(seed, whole=True))


def test_no_rule_is_broken_in_any_short_history() -> None:
    for history in short_histories(2):
        hold(history)


def test_a_history_happens_the_same_way_again() -> None:
    history = random_history(7)
    assert play(history, story=True).story == play(history, story=True).story


@pytest.mark.parametrize("mutation", [m for m in MUTATIONS if m.name in SEEN_IN], ids=lambda mutation: mutation.name)
def test_a_guard_removed_is_seen(mutation: Mutation) -> None:
    _, breach = found_by(mutation, NEAR, first=SEEN_IN[mutation.name])
    assert breach is not None, f"without the guard, {NEAR} histories from {SEEN_IN[mutation.name]} break no rule"


def test_every_mutation_still_has_its_guard() -> None:
    for mutation in MUTATIONS:
        mutated(mutation)
