"""One flown maneuver with its data, or why there is none."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from gcs.logs.runs.health import Health
from sysid.data.record import Record

Window = tuple[float | None, float | None]
"""Start and stop in seconds of the log's own time; an open end is None."""


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
