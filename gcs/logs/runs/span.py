"""Where a maneuver lies in a log, before its data are looked at."""

from __future__ import annotations

from dataclasses import dataclass

from gcs.logs.formats.tables import FloatArray
from sysid.data.chirp import Chirp
from sysid.data.onboard_model import OnboardModel


@dataclass(frozen=True, slots=True)
class Known:
    """A chirp whose law is known."""

    chirp: Chirp
    within_s: float
    """By which its start may be off."""
    source: str
    """Who tells."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Span:
    """Where a maneuver lies in a log, before its data are looked at."""

    start_s: float
    stop_s: float
    first_s: float
    """The record may begin here at the earliest..."""
    last_s: float
    """... and end here at the latest."""
    maneuver: str = "unknown"
    axis: str | None = None
    swept_band_hz: tuple[float, float] | None = None
    chirp_noise: float | None = None
    """As `Record.chirp_noise`."""
    planned_s: float | None = None
    excites_command: bool = True
    reasons: tuple[str, ...] = ()
    explained: bool = False
    """Whether the reasons are why everything else about it is wrong: nothing further is then held against it."""
    notes: tuple[str, ...] = ()
    entered_s: float | None = None
    track: tuple[FloatArray, FloatArray] | None = None
    """Times (s) and frequencies (Hz) of a chirp that was found by its excitation, both of shape (n,)."""
    law: Known | None = None
    """The chirp by its law, where it is known."""
    onboard: OnboardModel | None = None
    """What the vehicle identified in it."""
