"""Parts of runs: a run cut anew by a window from its start, as `LOG#2@5:25` does in a command."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from gcs.desk.saved import windowed
from gcs.errors import TippathError
from gcs.logs import FromStart, Run, ingest
from gcs.logs.runs.run import split_mark

DIGITS = 1
"""Of a window's ends in seconds: a hand sets no finer ones."""
SHORTEST_S = 1.0
"""Of a window; what a fit needs is more, and is told of the run."""


def plain(id: str) -> str:
    """A run's id without its window."""
    return split_mark(id)[0]


def window_of(id: str) -> FromStart | None:
    """The window that an id tells of."""
    return split_mark(id)[1]


def cut(run: Run, window: FromStart | None) -> Run:
    """The whole run, or a part of it. Raises TippathError where the window leaves nothing, or the log is gone."""
    wanted = plain(run.id)
    for one in ingest([Path(run.path)], None, window).runs:
        if plain(one.id) == wanted:
            return one
    raise TippathError(f"{wanted}: nothing of it lies in {window.mark if window else 'its log'}; W takes all of it")


def narrowed(id: str, start_s: float | None, stop_s: float | None) -> FromStart:
    """The window of a run with another begin or end, s from the start of its maneuver; None leaves one as it is.

    Raises TippathError where nothing would be left.
    """
    now = window_of(id) or FromStart(None, None)
    start = now.start_s if start_s is None else max(0.0, round(start_s, DIGITS))
    stop = now.stop_s if stop_s is None else max(0.0, round(stop_s, DIGITS))
    if stop is not None and stop - (start or 0.0) < SHORTEST_S:
        raise TippathError(f"from {start or 0.0:g} to {stop:g} s nothing is left of {plain(id)}; W takes all of it")
    return FromStart(start or None, stop)


def halves(run: Run) -> tuple[FromStart, FromStart]:
    """Windows of the first and the second half of what is used of a run."""
    now = window_of(run.id)
    start = (now.start_s if now else None) or 0.0
    middle = round(start + run.duration_s / 2, DIGITS)
    return FromStart(start or None, middle), FromStart(middle, now.stop_s if now else None)


def as_kept(runs: Sequence[Run], folder: Path) -> list[Run]:
    """Runs with those parts of them that the newest fit in a folder was made of in their place."""
    parts: dict[str, list[FromStart]] = {}
    for id in windowed(folder):
        whole, window = split_mark(id)
        if window is not None:
            parts.setdefault(whole, []).append(window)
    found: list[Run] = []
    for run in runs:
        try:
            found += [cut(run, window) for window in parts.get(run.id, [None]) if window is not None] or [run]
        except TippathError:  # the log is another one now: the fit is not opened, and says so
            found.append(run)
    return found
