"""The rules of the excitation over 100,000 random histories, and every guard removed until a history finds it.

    python tests/study/study_excitation.py [FIRST [COUNT [random|hard|whole]]]

prints what happened in the histories, so that one sees that they exercise something. Half an hour of one core.
"""

from __future__ import annotations

import sys
from collections import Counter
from collections.abc import Iterable
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

ROOT = Path(__file__).parents[2]
sys.path[:0] = [str(ROOT)]  # before tests/, which has a folder of the same name
sys.path.append(str(ROOT / "tests"))

from excitation_rules import (  # noqa: E402
    MUTATIONS,
    Mutation,
    found_by,
    history_of,
    in_words,
    mutated,
    play,
    short_histories,
    shown_by,
    shrunk,
    told,
)

HISTORIES = 100_000
HARD = 20_000
WHOLE = 5_000
MOST = 20_000
"""So many histories are tried on a mutation."""
CHUNK = 500


def _chunk(job: tuple[int, int, str]) -> tuple[Counter[str], list[int]]:
    first, count, kind = job
    counts: Counter[str] = Counter()
    broken = []
    for seed in range(first, first + count):
        outcome = play(history_of(kind, seed))
        counts += outcome.counts
        if outcome.breaches:
            broken.append(seed)
    return counts, broken


NOT_SHOWN = frozenset(
    {
        "a proof outlives a silence",
        "a late start's own word does not undo the proof",
        "an acceptance that changed nothing is believed",
        "cleared at once after a silence",
        "cleared against the vehicle's own log",
        "cleared at once without a word of the log",
        "cleared with the start's proof alone",
        "shown again between two ticks is not seen",
        "what was written need not have landed",
        "a heartbeat beside the acceptance is not heard",
        "a heartbeat ages only on its way",
        "an abort after a silence does not settle",
        "an abort believes what was heard before a silence",
        "the clock does not know what was written",
        "started on a dead log",
        "no room for swaps at the vehicle",
        "no room for swaps on the way there",
        "a heartbeat's age is the likely one",
        "a stamp from the future is believed",
    }
)
"""No history has shown yet that these guards are needed: either they are not, or the checker is too weak for them."""


def _many(first: int, count: int, kind: str) -> tuple[Counter[str], list[int]]:
    jobs = [(at, min(CHUNK, first + count - at), kind) for at in range(first, first + count, CHUNK)]
    counts: Counter[str] = Counter()
    broken: list[int] = []
    with ProcessPoolExecutor() as pool:
        for more, seeds in pool.map(_chunk, jobs):
            counts += more
            broken += seeds
    return counts, broken


def _told(seeds: Iterable[int], kind: str) -> str:
    stories = []
    for seed in list(seeds)[:3]:
        history = shrunk(history_of(kind, seed))
        stories.append(told(history, play(history, story=True)))
    return "\n\n".join(stories)


def study_no_rule_is_broken_in_random_histories() -> None:
    _study(0, HISTORIES)


def study_no_rule_is_broken_in_hard_histories() -> None:
    _study(0, HARD, "hard")


def study_no_rule_is_broken_in_whole_flights() -> None:
    _study(0, WHOLE, "whole")


def _study(first: int, count: int, kind: str = "random") -> None:
    counts, broken = _many(first, count, kind)
    print(f"\n{count} {kind} histories from {first}: {len(broken)} with a broken rule")
    print(in_words(counts))
    assert not broken, f"{len(broken)} histories: {broken}\n{_told(broken, kind)}"


def study_no_rule_is_broken_in_any_short_history() -> None:
    histories = tuple(short_histories(3))
    broken = [history for history in histories if play(history).breaches]
    print(f"\n{len(histories)} short histories, all that there are: {len(broken)} with a broken rule")
    assert not broken, told(broken[0], play(broken[0], story=True))


def study_every_guard_removed_is_found() -> None:
    """By the history that is known to show it, or else by the first that does, which then belongs into `SEEN_IN`."""
    survived = []
    with ProcessPoolExecutor() as pool:
        for mutation, seen in zip(MUTATIONS, pool.map(_shown, MUTATIONS), strict=True):
            print(f"    {mutation.name}: {seen or mutation.beside or 'SURVIVED'}", flush=True)
            if not seen and not mutation.beside and mutation.name not in NOT_SHOWN:
                survived.append(mutation.name)
    assert not survived, survived


def _shown(mutation: Mutation) -> str:
    history = shown_by(mutation.name)
    breaches = () if history is None else play(history, mutated(mutation)).breaches
    if breaches:
        return f"known, {breaches[0].rule}: {breaches[0].words}"
    seen = None if mutation.name in NOT_SHOWN else found_by(mutation, MOST)
    return "" if seen is None else f'("{seen[0]}", {seen[1]}),  # {seen[2].rule}: {seen[2].words}'


if __name__ == "__main__":
    given = [int(word) for word in sys.argv[1:3]]
    _study(*(given + [0, HISTORIES][len(given) :]), *sys.argv[3:4])
