"""The rules of the excitation over 100,000 random histories, and every guard removed until a history finds it.

    python tests/study/study_excitation.py [FIRST [COUNT]]

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

from excitation_rules import MUTATIONS, found_by, in_words, play, random_history, short_histories, shrunk, told  # noqa: E402

HISTORIES = 100_000
WHOLE = 5_000
MOST = 20_000
"""So many histories are tried on a mutation."""
CHUNK = 500


def _chunk(job: tuple[int, int, bool]) -> tuple[Counter[str], list[int]]:
    first, count, whole = job
    counts: Counter[str] = Counter()
    broken = []
    for seed in range(first, first + count):
        outcome = play(random_history(seed, whole=whole))
        counts += outcome.counts
        if outcome.breaches:
            broken.append(seed)
    return counts, broken


NOT_SHOWN = frozenset(
    {
        "our own silence counts against stuck",
        "after a silence the accepted start still counts",
        "started with an unknown lag",
        "started right after a silence",
        "no end where nothing is known",
        "an abort after a silence does not settle",
        "no room for swaps at the vehicle",
        "no room for swaps on the way there",
    }
)
"""No history has shown yet that these guards are needed: either they are not, or the checker is too weak for them."""


def _many(first: int, count: int, *, whole: bool = False) -> tuple[Counter[str], list[int]]:
    jobs = [(at, min(CHUNK, first + count - at), whole) for at in range(first, first + count, CHUNK)]
    counts: Counter[str] = Counter()
    broken: list[int] = []
    with ProcessPoolExecutor() as pool:
        for more, seeds in pool.map(_chunk, jobs):
            counts += more
            broken += seeds
    return counts, broken


def _told(seeds: Iterable[int], *, whole: bool = False) -> str:
    stories = []
    for seed in list(seeds)[:3]:
        history = shrunk(random_history(seed, whole=whole))
        stories.append(told(history, play(history, story=True)))
    return "\n\n".join(stories)


def study_no_rule_is_broken_in_random_histories() -> None:
    _study(0, HISTORIES)


def study_no_rule_is_broken_in_whole_flights() -> None:
    _study(0, WHOLE, whole=True)


def _study(first: int, count: int, *, whole: bool = False) -> None:
    counts, broken = _many(first, count, whole=whole)
    print(f"\n{count} histories from {first}{' through fly_card' if whole else ''}: {len(broken)} with a broken rule")
    print(in_words(counts))
    assert not broken, f"{len(broken)} histories, such as {broken[:10]}\n{_told(broken, whole=whole)}"


def study_no_rule_is_broken_in_any_short_history() -> None:
    histories = tuple(short_histories(3))
    broken = [history for history in histories if play(history).breaches]
    print(f"\n{len(histories)} short histories, all that there are: {len(broken)} with a broken rule")
    assert not broken, told(broken[0], play(broken[0], story=True))


def study_every_guard_removed_is_found() -> None:
    print("\nhistories until found, and the rule that was broken")
    survived = []
    with ProcessPoolExecutor() as pool:
        for mutation, (count, breach) in zip(
            MUTATIONS, pool.map(found_by, MUTATIONS, [MOST] * len(MUTATIONS)), strict=True
        ):
            if breach is None and not mutation.beside and mutation.name not in NOT_SHOWN:
                survived.append(mutation.name)
            words = f"{breach.rule}: {breach.words}" if breach else f"not found; {mutation.beside or 'SURVIVED'}"
            print(f"  {count:6d}  {mutation.name:62s} {words}")
    assert not survived, survived


if __name__ == "__main__":
    given = [int(word) for word in sys.argv[1:3]]
    _study(*(given + [0, HISTORIES][len(given) :]))
