"""The values that the rules of an excitation work on: what is seen in a tick, what is asked for, where a run stands."""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import Enum

from gcs.link.clock import UNKNOWN
from gcs.vehicle.snapshot import Beat


class Phase(Enum):
    """Where a run stands."""

    STARTING = "starting"
    FLYING = "flying"
    RETURNING = "returning"
    WATCHING = "watching"
    """Out of the excitation mode; an order of ours that came late might bring it back."""
    ENDED = "ended"


class Ending(Enum):
    """Why a run ended."""

    FINISHED = "finished"
    STOPPED = "stopped by the vehicle"
    REFUSED = "refused"
    PILOT = "taken over"
    LIMIT = "limit exceeded"
    LINK = "link lost"
    LATE = "link too late"
    LOG = "log stopped"
    TELEMETRY = "telemetry stopped"
    SETTINGS = "other settings"
    PROBE = "the probe says no"
    ABORTED = "aborted"
    STUCK = "stuck"


@dataclass(frozen=True, slots=True)
class Answer:
    """What became of the mode that was asked for."""

    accepted: bool | None
    """None: no answer."""
    reason: str = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class Seen:
    """All that the step is told, once a tick. Times are those of the session's clock, s."""

    now: float
    mode: int
    mode_name: str
    heartbeats: int
    """Heard so far; the mode is the last one's."""
    beats: tuple[Beat, ...] = ()
    """New since the last tick."""
    armed: bool = True
    lost: bool = False
    link_age_s: float = 0.0
    lag_s: float | None = None
    """None: not known."""
    answer_age_s: float = 0.0
    """Since the newest question was sent that the vehicle answered."""
    log_age_s: float | None = None
    """Since the last new block of the log, or attitude where the log stays on the card; None where none came."""
    log_on_card: bool = False
    """The log stays on the vehicle's card: telemetry stands for it."""
    log_taken: bool = False
    """Another station answers the vehicle's log."""
    log_stopped: str = ""
    """The vehicle's own words about having stopped its log."""
    log_mode: int | None = None
    """The mode by the vehicle's own log, which no stranger writes; None where that is old, or not told."""
    texts: tuple[str, ...] = ()
    """New since the last tick."""
    answer: Answer | None = None
    """To the order of the last tick."""
    sweep_s: float | None = None
    """The vehicle's own time in this maneuver, from its log."""
    violations: tuple[str, ...] = ()
    other_settings: str = ""
    """How what the vehicle flies differs from what was planned; empty where it does not, or is not known."""
    abort: str | None = None
    """Why somebody wants the end."""
    given_up: bool = False
    """Somebody no longer wants to wait for a lost link."""
    blind: bool = False
    """Somebody wants the maneuver's size set to 0 while the vehicle is not heard."""


@dataclass(frozen=True, slots=True)
class Order:
    """A mode to ask for, once."""

    mode: int


@dataclass(frozen=True, slots=True)
class Still:
    """The maneuver's size to 0, once, to a vehicle that is not heard: whatever mode it is in stays."""


@dataclass(frozen=True, slots=True, kw_only=True)
class RunState:
    """One run, between two ticks."""

    mode_before: int
    """What the pilot flew before; the only mode that is ever commanded besides the excitation's."""
    phase: Phase = Phase.STARTING
    asks: int = 0
    """Times the excitation mode was asked for."""
    deaf_until: float = UNKNOWN
    """On the way back: until then it was heard, and answered nothing."""
    asked_at: float = UNKNOWN
    accepted_after: int | None = None
    """Heartbeats heard when the vehicle said that it starts; None while it did not, and after a silence."""
    flying_since: float | None = None
    ending: Ending | None = None
    reason: str = ""

    excited: bool = False
    """The vehicle's last word: the last heartbeat that can be believed showed the excitation mode."""
    excited_number: int = -1
    """That heartbeat's."""
    confirmed: bool = False
    """A heartbeat showed the excitation mode."""
    others: int = 0
    """Heartbeats in a row with another mode that do not date from before the start."""
    known_s: float = UNKNOWN
    """Of the last one of them: what was sent up to then had reached the vehicle."""
    proved_at: float | None = None
    """Since when they are known to be later than every order of ours, without silence or contradiction since."""
    mode_shown: str = ""
    """By the last heartbeat that can be believed."""
    contradictions: int = 0
    """Times the excitation mode showed again after another mode."""

    ticked_at: float = math.inf
    heard_at: float = math.inf
    """When anything was heard last."""
    settled_at: float = UNKNOWN
    """Until then a heartbeat counts only if the vehicle's clock says that it is new."""
    lost_since: float | None = None
    heard_since: float = UNKNOWN
    """There was no silence since then, neither of the link nor of ourselves."""
    late_since: float | None = None
    """The link's lag is beyond the limit since then."""
    log_silent_since: float | None = None
    """The link is heard and its log is not, since then."""
    failsafe: str = ""
    """What the vehicle said about one; its heartbeat follows up to a second later."""

    returning_since: float = 0.0
    fresh_after: int = 0
    """Returning: only a heartbeat after this many decides."""
    held: int = -1
    """Heartbeats heard when the way back was accepted; -1 while it was not."""
    accepted: int = 0
    """Times it was accepted: more than once, and the vehicle does not do what it accepts, or the answer was another's.
    """
    returned_at: float = UNKNOWN
    """When the way back was last asked for."""
    stilled_at: float = UNKNOWN
    """When the maneuver's size was last set to 0 unheard."""
    left_at: float = 0.0
    cleared: bool = False
    """The vehicle is known to be out of the excitation mode, and no start of ours is under way any more."""
    mode_after: str = ""
    """What the heartbeat that ended the run showed; `unknown` where none did."""

    @property
    def ordered_at(self) -> float:
        """When anything was last sent that moves the vehicle: a mode, either one, or the size of 0."""
        return max(self.asked_at, self.returned_at, self.stilled_at)
