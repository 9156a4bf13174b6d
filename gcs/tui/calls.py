"""What is called out while a run flies: each moment with a pattern of the bell of its own, and words to be spoken.

Pure: two moments give the calls between them. Whoever cannot look at the screen tells start from half, half from end,
and a limit from an abort.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from gcs.tui.state import Mark, Stage, State
from gcs.tui.top_line import late


@dataclass(frozen=True, slots=True)
class Call:
    """One call."""

    words: str
    pattern: tuple[float, ...]
    """Seconds after the first ring at which the bell rings again; `()` rings once."""


FAST, SLOW, PAIR = 0.15, 0.45, 0.9
START = Call("started", ())
HALF = Call("half", (SLOW,))
COUNT = {3: Call("three", ()), 2: Call("two", ()), 1: Call("one", ())}
END = Call("end", (SLOW, 2 * SLOW))
LIMIT = Call("limit", tuple(FAST * i for i in range(1, 5)))
ABORT = Call("aborted", (FAST, PAIR, PAIR + FAST))
LINK_LOST = Call("link lost", (FAST, PAIR, PAIR + FAST, 2 * PAIR, 2 * PAIR + FAST))
LINK_LATE = Call("link late", LINK_LOST.pattern)
KEEP, AGAIN = Call("keep", ()), Call("fly it again", ())
"""Verdicts: spoken only; the bell has rung for the end."""
SPOKEN_ONLY = (KEEP, AGAIN)


def calls(before: State, after: State) -> list[Call]:
    """What is to be called out between two moments, the most urgent first."""
    found: list[Call] = []
    if after.lost and not before.lost:
        found.append(LINK_LOST)
    elif after.vehicle is not None and before.vehicle is not None and late(after.vehicle) and not late(before.vehicle):
        found.append(LINK_LATE)
    over = after.use is not None and after.use.largest > 100
    if over and not (before.use is not None and before.use.largest > 100) and before.stage is Stage.FLYING:
        found.append(LIMIT)
    if after.stage is Stage.ABORTING and before.stage is Stage.FLYING:
        found.append(ABORT)
    elif before.stage is Stage.FLYING and after.stage is not Stage.FLYING:
        found.append(END)
    elif after.stage is Stage.FLYING:
        found += _on_the_way(before, after)
    return [*found, *_verdict(before, after)]


def _on_the_way(before: State, after: State) -> list[Call]:
    """Start, half, and the last three seconds."""
    if before.progress is None or after.progress is None:
        return []
    began, now, duration = before.progress.elapsed_s, after.progress.elapsed_s, after.progress.duration_s
    moments = [(0.0, START), (duration / 2, HALF), *((duration - left, call) for left, call in COUNT.items())]
    return [call for moment, call in moments if began < moment <= now]


def _verdict(before: State, after: State) -> list[Call]:
    """Of a run that was judged now."""
    marks = {run.number: run.mark for run in before.runs}
    for run in after.runs:
        was = marks.get(run.number, run.mark)
        if run.mark is not was and was is Mark.FLYING and run.mark in (Mark.KEEP, Mark.AGAIN):
            return [KEEP if run.mark is Mark.KEEP else AGAIN]
    return []


def ringing(found: Sequence[Call]) -> Call | None:
    """The one call of several that the bell rings: the first; None where there is nothing to ring for."""
    return next((call for call in found if call not in SPOKEN_ONLY), None)
