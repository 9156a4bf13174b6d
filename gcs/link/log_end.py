"""Where a log ended, and what shows it: a log whose blocks are all there may still have been cut at its end.

Block numbers tell of gaps below the highest that came, and nothing of what should have followed. Time does: every
message of a log carries the vehicle's clock, and so does its telemetry. A log has reached its end when its newest stamp
is where the vehicle's own clock stood as the recording was ended. That clock must have been heard after the end was
asked for: one from before may be of a vehicle that has gone.

What this cannot see: telemetry comes late by the link's lag, so the clock at the stop is known too low by that much,
and a log cut within lag and tolerance before the stop passes for whole, unless the vehicle says that it stopped.

A log that another one followed has no such moment. The vehicle stopped sending it, so it is cut, by however little;
only where the vehicle restarted can it have ended by itself, and then its stamps must reach the restart.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

TOLERANCE_S = 0.5
"""Between a log's newest stamp and the clock at the stop. A vehicle sends whole blocks of 200 bytes, which fill in
10 ms at 20 kB/s, and ArduPilot's buffer of 8 kB, which it forgets at the stop, holds 0.35 s of such a log."""


class EndState(Enum):
    """Whether a log goes to its end."""

    REACHED = "reached"
    CUT = "cut"
    NOT_KNOWN = "not known"


class Cause(Enum):
    """What ended the recording of one log."""

    GOING_ON = "going on"
    ASKED = "asked"
    """The vehicle was asked to stop."""
    NEXT_LOG = "next log"
    """The vehicle began another one."""
    RESTART = "restart"
    """The vehicle's clock began anew."""


@dataclass(frozen=True, slots=True, kw_only=True)
class LogEnd:
    """What is known about the end of one log. All times are on the vehicle's clock, s since it booted."""

    state: EndState = EndState.NOT_KNOWN
    cause: Cause = Cause.GOING_ON
    log_s: float | None = None
    """The newest time stamp that was read from the log, None where none was."""
    clock_s: float | None = None
    """What the clock showed when the recording of this log ended, None where the vehicle did not tell."""
    reported: str = ""
    """The vehicle's own words about having stopped the stream."""

    @property
    def short_s(self) -> float | None:
        """By how much the log ends too early, None where that is not known."""
        if self.log_s is None or self.clock_s is None:
            return None
        return max(0.0, self.clock_s - self.log_s)

    def words(self, name: str) -> str:
        """What to tell about the log `name`; empty where its end is there."""
        why = f" (the vehicle: {self.reported})" if self.reported else ""
        if self.state is EndState.REACHED:
            return ""
        if self.state is EndState.NOT_KNOWN:
            return f"{name}: whether it is whole at its end is not known, {self._unknown()}{why}"
        if self.short_s is None:
            return f"{name} is cut at its end; by how much is not known{why}"
        before = {
            Cause.NEXT_LOG: "the vehicle's next log began",
            Cause.RESTART: "the vehicle restarted",
        }.get(self.cause, "the recording did")
        return f"{name} ends {self.short_s:.1f} s before {before}{why}"

    def _unknown(self) -> str:
        if self.log_s is None:
            return "it holds no time stamp"
        if self.clock_s is None:
            return "the vehicle did not tell its clock"
        if self.cause is Cause.RESTART:
            return "the vehicle restarted while it was not heard"
        if self.log_s > self.clock_s + TOLERANCE_S:
            return "its time stamps are not of the vehicle's clock"
        return "the vehicle was not heard after the recording was ended"


NOT_JUDGED = LogEnd()
"""Nothing was shown yet."""


def end_of_asked(
    log_s: float | None, clock_s: float | None, clock_now_s: float | None, heard: bool, reported: str
) -> LogEnd:
    """The end of the log that was being recorded when the vehicle was asked to stop.

    `clock_s` is the vehicle's clock at that moment, `clock_now_s` what it must show by now, and `heard` says whether
    it was heard after that moment.
    """
    state = EndState.NOT_KNOWN
    if log_s is not None and clock_s is not None and clock_now_s is not None:
        if reported or log_s < clock_s - TOLERANCE_S:
            state = EndState.CUT
        elif heard and log_s <= clock_now_s + TOLERANCE_S:
            state = EndState.REACHED
    elif reported:
        state = EndState.CUT
    return LogEnd(state=state, cause=Cause.ASKED, log_s=log_s, clock_s=clock_s, reported=reported)


def end_of_followed(log_s: float | None, clock_s: float | None, reported: str) -> LogEnd:
    """The end of a log that another followed without a restart; `clock_s` when that one began."""
    return LogEnd(state=EndState.CUT, cause=Cause.NEXT_LOG, log_s=log_s, clock_s=clock_s, reported=reported)


def end_of_restarted(log_s: float | None, last_s: float, latest_s: float) -> LogEnd:
    """The end of a log whose vehicle restarted: its clock was heard at `last_s` and may have gone on to `latest_s`."""
    if log_s is None:
        return LogEnd(cause=Cause.RESTART, clock_s=last_s)
    if log_s < last_s - TOLERANCE_S:
        state = EndState.CUT
    elif log_s >= latest_s - TOLERANCE_S:
        state = EndState.REACHED
    else:
        state = EndState.NOT_KNOWN
    return LogEnd(state=state, cause=Cause.RESTART, log_s=log_s, clock_s=last_s)
