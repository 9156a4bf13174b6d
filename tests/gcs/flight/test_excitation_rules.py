"""The rules of `gcs.flight.rules` over histories of messages, and that the checker sees when a rule is gone.

`tests/study/study_excitation.py` does the same over 100,000 histories, and tells how soon each rule is missed.
"""

from __future__ import annotations

import itertools
import math
from collections import Counter

import pytest
from excitation_rules import (
    MUTATIONS,
    Act,
    History,
    Mutation,
    guards,
    history_of,
    mutated,
    needed_in,
    play,
    random_history,
    short_histories,
    shown_by,
    shrunk,
    told,
)
from more_of_a_kind import thorough


def hold(history: History) -> None:
    """That no rule is broken in it; or its story."""
    if play(history).breaches:
        simpler = shrunk(history)
        pytest.fail(told(simpler, play(simpler, story=True)))


def test_no_rule_is_broken_in_random_histories() -> None:
    counts: Counter[str] = Counter()
    for seed in range(110):
        outcome = play(random_history(seed))
        counts += outcome.counts
        if outcome.breaches:
            hold(random_history(seed))
    # They exercise something.
    assert counts["starts that arrived"] > 80
    assert counts["ways back that arrived"] > 40
    assert counts["starts over a second late"] > 15


def test_no_rule_is_broken_where_strangers_talk_and_half_is_lost() -> None:
    for seed in range(70):
        hold(history_of("hard", seed))


def test_no_rule_is_broken_without_the_logs_stream() -> None:
    counts: Counter[str] = Counter()
    for seed in range(60):
        outcome = play(history_of("card", seed))
        counts += outcome.counts
        if outcome.breaches:
            hold(history_of("card", seed))
    assert counts["starts that arrived"] > 15
    assert counts["ended: telemetry stopped"]


def test_no_rule_is_broken_where_an_end_is_sent_unheard() -> None:
    counts: Counter[str] = Counter()
    for seed in range(70):
        outcome = play(history_of("blind", seed))
        counts += outcome.counts
        if outcome.breaches:
            hold(history_of("blind", seed))
    assert counts["sent unheard, and arrived in the excitation"] > 100


@pytest.mark.parametrize(
    ("guard", "history"),
    [
        ("a dead log does not end a run", History(card=True, runs=(3,), acts=(Act(2.0, "log", math.inf),))),
        ("started on a dead log", history_of("card", 846)),
    ],
)
def test_dead_telemetry_that_ends_nothing_is_found(guard: str, history: History) -> None:
    removed = next(mutation for mutation in MUTATIONS if mutation.name == guard)
    assert not play(history).breaches
    assert play(history, mutated(removed)).breaches


def test_no_rule_is_broken_in_whole_flights() -> None:
    counts: Counter[str] = Counter()
    for seed in range(40):
        outcome = play(random_history(seed, whole=True))
        counts += outcome.counts
        if outcome.breaches:
            hold(random_history(seed, whole=True))
    assert counts["starts that arrived"] > 5


@pytest.mark.parametrize("rest", [0, *thorough(range(1, 6))], ids="every sixth, from {}".format)
def test_no_rule_is_broken_in_any_short_history(rest: int) -> None:
    for history in itertools.islice(short_histories(2), rest, None, 6):
        hold(history)


@pytest.mark.parametrize(
    ("kind", "seed"),
    [("hard", 7000261), ("random", 9036066), ("twin", 9005235)],
    ids=[
        "a stranger's heartbeats after the log has ended",
        "an acceptance behind an earlier order's refusal",
        "a late link while a twin talks",
    ],
)
def test_no_rule_is_broken_where_one_was_once(kind: str, seed: int) -> None:
    hold(history_of(kind, seed))


def test_a_history_happens_the_same_way_again() -> None:
    history = random_history(7)
    assert play(history, story=True).story == play(history, story=True).story


@pytest.mark.parametrize("mutation", [m for m in MUTATIONS if shown_by(m.name)], ids=lambda mutation: mutation.name)
def test_a_guard_removed_is_seen(mutation: Mutation) -> None:
    """Where this fails though the rules hold, histories go another way now: `study_every_guard_removed_is_found`."""
    shown = shown_by(mutation.name)
    assert shown is not None
    history, names = shown
    hold(history)
    removed = [other for other in MUTATIONS if other.name in names]
    assert needed_in(history, removed)[0] == tuple(other.name for other in removed), "another set breaks a rule"


def test_every_guard_is_shown_to_be_needed_or_has_another_beside_it() -> None:
    assert [m.name for m in MUTATIONS if not (shown_by(m.name) or m.beside)] == []


def test_every_mutation_still_has_its_guard() -> None:
    assert [mutation.name for mutation in MUTATIONS if guards(mutation) != 1] == []
