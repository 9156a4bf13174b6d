"""One flown maneuver with its data, or why there is none."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field

from gcs.logs.runs.health import Health
from sysid.data.record import Record

Window = tuple[float | None, float | None]
"""Start and stop in seconds of the log's own time; an open end is None."""


@dataclass(frozen=True)
class FromStart:
    """A window in seconds from where a run's maneuver starts."""

    start_s: float | None
    stop_s: float | None
    """An open end is None."""

    def after(self, start_s: float) -> Window:
        """In the log's own time, for a run that starts there."""
        ends = (self.start_s, self.stop_s)
        low, high = (None if end is None else start_s + end for end in ends)
        return low, high

    @property
    def mark(self) -> str:
        """`@5:25`, what stands behind a run's id."""
        return "@" + ":".join("" if end is None else f"{end:g}" for end in (self.start_s, self.stop_s))


AnyWindow = Window | FromStart

_MARK = re.compile(r"(.+)@(\d*\.?\d*):(\d*\.?\d*)")


def split_mark(word: str) -> tuple[str, FromStart | None]:
    """`flight.BIN#2@5:25` -> (`flight.BIN#2`, its window); a word without one as it is. Raises ValueError."""
    match = _MARK.fullmatch(word)
    if match is None:
        return word, None
    start, stop = (float(end) if end else None for end in match.groups()[1:])
    return match[1], FromStart(start, stop)


@dataclass(frozen=True, kw_only=True)
class Run:
    """One flown maneuver with its data, or why there is none."""

    record: Record | None
    id: str
    """`flight.BIN#2`."""
    path: str
    maneuver: str
    axis: str | None
    start_s: float
    """Of the maneuver, in the log's own time; the record also holds a little before and after."""
    duration_s: float
    """Of the maneuver."""
    rate_hz: float | None
    gaps: tuple[tuple[float, float], ...]
    usable: bool
    reasons: tuple[str, ...]
    """Why it is not usable, and what to do; empty where it is."""
    notes: tuple[str, ...] = ()
    """What else the user should know."""
    rate_source: str | None = None
    swept_band_hz: tuple[float, float] | None = None
    """First and last frequency that were flown, where known."""
    sources: Mapping[str, str] = field(default_factory=dict)
    """Channel -> field of the log."""
    absent: Mapping[str, str] = field(default_factory=dict)
    """Channel of the profile -> why the run does not have it."""
    health: Health | None = None
    entered_s: float | None = None
    """When the excitation mode was entered, in the log's own time, where the log tells."""
    verdict: str | None = None
    """What the flight's own verdict has against it, see `gcs.logs.runs.verdicts`; a reason then tells it."""

    @property
    def usable_to_hz(self) -> int | None:
        """Up to which frequency it is usable, where nothing but a band that reaches too high stands against it."""
        if self.usable or self.health is None or self.reasons != self.health.reasons:
            return None
        return self.health.usable_to_hz


def unread(id: str, path: str, maneuver: str, reason: str) -> Run:
    """A run of which nothing was read, and why."""
    return Run(
        record=None,
        id=id,
        path=path,
        maneuver=maneuver,
        axis=None,
        start_s=0.0,
        duration_s=0.0,
        rate_hz=None,
        gaps=(),
        usable=False,
        reasons=(reason,),
    )
