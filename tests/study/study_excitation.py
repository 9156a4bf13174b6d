"""The rules of the excitation over 100,000 random histories, and every guard removed until a history finds it.

    python tests/study/study_excitation.py [FIRST [COUNT [random|hard|twin|whole|card]]]

prints what happened in the histories, so that one sees that they exercise something. Half an hour of one core.
"""

from __future__ import annotations

import sys
from collections import Counter
from collections.abc import Iterable, Sequence
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

ROOT = Path(__file__).parents[2]
sys.path[:0] = [str(ROOT)]  # before tests/, which has a folder of the same name
sys.path.append(str(ROOT / "tests"))

from excitation_rules import (  # noqa: E402
    MUTATIONS,
    Mutation,
    history_of,
    in_words,
    mutated,
    needed_in,
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
"""So many histories of each kind are tried on guards that nothing has shown yet to be needed."""
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


def study_no_rule_is_broken_where_a_twin_talks() -> None:
    _study(0, HARD, "twin")


def study_no_rule_is_broken_without_the_logs_stream() -> None:
    _study(0, HARD, "card")


def study_no_rule_is_broken_where_an_end_is_sent_unheard() -> None:
    _study(0, HARD, "blind")


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
    """By the history that is known to show it (`SEEN_IN`, `SEEN_TOGETHER`, `MADE_FOR`); those that have none are
    removed together, and what breaks a rule then is traced to the fewest of them: such a seed belongs into a table."""
    by_name = {mutation.name: mutation for mutation in MUTATIONS}
    unknown = []
    for mutation in MUTATIONS:
        shown = shown_by(mutation.name)
        needed = () if shown is None else needed_in(shown[0], [by_name[name] for name in shown[1]])[0]
        print(f"    {mutation.name}: {'seen' if needed else mutation.beside or 'NOT SEEN'}", flush=True)
        if not needed and not mutation.beside:
            unknown.append(mutation)
    if unknown:
        _search(unknown)
    assert not unknown, [mutation.name for mutation in unknown]


def _search(unknown: Sequence[Mutation]) -> None:
    code, seen = mutated(*unknown), set()
    for seed in range(MOST):
        for kind in ("random", "hard", "twin"):
            history = history_of(kind, seed)
            if not play(history, code).breaches:
                continue
            names, breach = needed_in(history, unknown)
            if names not in seen and breach is not None:
                seen.add(names)
                print(f'    {names}: ("{kind}", {seed}),  # {breach.rule}: {breach.words}', flush=True)


if __name__ == "__main__":
    given = [int(word) for word in sys.argv[1:3]]
    _study(*(given + [0, HISTORIES][len(given) :]), *sys.argv[3:4])
