"""Answering the vehicle's log while nobody records it, so that the vehicle can be armed.

An ArduPilot that streams its log (LOG_BACKEND_TYPE with bit 2) is not armed before somebody asked for that log and
acknowledges it ("Logging failed"). This asks, acknowledges, and keeps nothing but counts. A vehicle answers a START
only while it sends to nobody, so asking takes the log from nobody; but it believes an acknowledgement from anybody, so
blocks that are meant for another station are left to that one, and while another is heard nothing is said at all.

A recording begins with the formats only if the stream that went before it was ended: see `hand_over`.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from enum import Enum

from gcs.link.clock import LOST_AFTER_S, LinkClock
from gcs.link.encode import START_BLOCKS, STOP_BLOCKS, BlockStatus, Send
from gcs.link.events import Event, LogBlock, LogReceipt

BLOCK_BYTES = 200


class LogClient(Enum):
    """Who answers the vehicle's log while it is not recorded."""

    NOBODY = "nobody"
    """Nothing is answered: the vehicle does not stream its log, or it does not matter now."""
    ASKED = "asked"
    """Asked for, and no block came yet: a vehicle that logs nothing before it is armed sends none."""
    OURS = "ours"
    ANOTHER = "another"
    """Another station answers it, or is sent it: ours stays silent."""
    SHED = "shed"
    """The link was too late with the log on it: given up until the next connection."""


@dataclass(frozen=True, slots=True, kw_only=True)
class AnsweredRate:
    """What the link carried of the log, over the last `over_s` seconds."""

    over_s: float
    carried: float
    """Bytes a second that came for the first time."""
    numbered: float
    """Bytes a second by the blocks' numbers: the vehicle wrote at least so much."""


class LogAnswer:
    """A conversation without an end of its own. Times are the session's clock, s.

    `station` is (system, component) of ours. It begins before a disarmed vehicle, or at once where `at_once`; once
    begun it goes on through arming, so that a pilot who waits on the ground is not disturbed.
    """

    START_EVERY_S = 2.0
    """Also the longest silence of a stream that is not asked for again."""
    STOP_EVERY_S = 0.12
    ANOTHER_FOR_S = 10.0
    """So long after another log client was heard nothing is said: the vehicle ends its stream after as much."""
    QUIET_S = 0.3
    """Without a block for so long, and twice the link's lag, a stopped stream has ended."""
    HAND_OVER_S = 3.0
    """A stopped stream is waited for at most so long."""
    LAG_S = 0.5
    LATE_S = 2.0
    """A link later than `LAG_S`, or on which nothing is answered, for so long: the log is given up."""
    TALLY_S = 0.2
    OVER_S = 3.0
    LEAST_S = 1.0

    def __init__(self, station: tuple[int, int], *, at_once: bool = False) -> None:
        self.client = LogClient.NOBODY
        self._station = station
        self._at_once = at_once
        self._next_start = 0.0
        self._last_block: float | None = None
        self._another_at: float | None = None
        self._late_since: float | None = None
        self._stopped_at: float | None = None
        self._next_stop = 0.0
        self._seen: set[int] = set()
        self._blocks = 0
        self._highest = -1
        self._tallies: deque[tuple[float, int, int]] = deque(maxlen=64)

    @property
    def speaking(self) -> bool:
        """Whether the vehicle sends its log to us, or was asked to."""
        return self.client in (LogClient.ASKED, LogClient.OURS)

    def on_event(self, event: Event, now: float) -> list[Send]:
        """A block, or another station's receipt."""
        if isinstance(event, LogReceipt):
            if (event.system, event.component) != self._station:
                self._another(now)
            return []
        if not isinstance(event, LogBlock) or event.number >= STOP_BLOCKS:
            return []
        target = (event.target_system, event.target_component)
        if target not in ((0, 0), self._station):
            self._another(now)
            return []
        if not self.speaking and self._stopped_at is None:
            return []
        self._last_block = now
        self._count(event.number, now)
        if self._stopped_at is None:
            self.client = LogClient.OURS
        return [BlockStatus(event.number, True)]

    def poll(self, now: float, armed: bool, link: LinkClock) -> list[Send]:
        """What is due."""
        if self._stopped_at is not None:
            return self._stop_again(now)
        if self.client is LogClient.SHED or self._heard_another(now):
            return []
        if self.client is LogClient.NOBODY and armed and not self._at_once:
            return []
        late = link.lag_s is not None and (link.lag_s > self.LAG_S or now - link.answered_s > LOST_AFTER_S)
        self._late_since = (self._late_since or now) if late and self.speaking else None
        if self._late_since is not None and now - self._late_since > self.LATE_S:
            self.client = LogClient.SHED
            return [BlockStatus(STOP_BLOCKS, True)]
        silent = self._last_block is None or now - self._last_block > self.START_EVERY_S
        if not silent or now < self._next_start:
            return []
        self._next_start = now + self.START_EVERY_S
        self.client = LogClient.ASKED
        return [BlockStatus(START_BLOCKS, True)]

    def hand_over(self, now: float) -> list[Send]:
        """End the stream, so that the next one begins with the formats; what is under way is still acknowledged."""
        if not self.speaking:
            return []
        self._stopped_at = now
        return self._stop_again(now)

    def handed_over(self, now: float, lag_s: float | None) -> bool:
        """Whether nothing of the stopped stream can come any more; true also where there was none."""
        if self._stopped_at is None:
            return True
        since = max(self._stopped_at, self._last_block or 0.0)
        quiet_s = self.QUIET_S + 2.0 * (lag_s or 0.0)
        return now - since > quiet_s or now - self._stopped_at > self.HAND_OVER_S

    def restart(self) -> None:
        """A recording has ended: from now on as at the beginning, but for a link that was too slow."""
        self._stopped_at = self._last_block = None
        self._next_start = 0.0
        self._seen.clear()
        self._tallies.clear()
        if self.client is not LogClient.SHED:
            self.client = LogClient.NOBODY

    def rate(self, now: float) -> AnsweredRate | None:
        """Over the last seconds; None where too little came to tell."""
        inside = [tally for tally in self._tallies if tally[0] >= now - self.OVER_S]
        if len(inside) < 2 or now - inside[0][0] < self.LEAST_S:
            return None
        began, first, low = inside[0]
        span = now - began
        return AnsweredRate(
            over_s=span,
            carried=(self._blocks - first) * BLOCK_BYTES / span,
            numbered=max(0, self._highest - low) * BLOCK_BYTES / span,
        )

    def _another(self, now: float) -> None:
        self._another_at = now
        if self.client is not LogClient.SHED:
            self.client = LogClient.ANOTHER

    def _heard_another(self, now: float) -> bool:
        if self._another_at is not None and now - self._another_at < self.ANOTHER_FOR_S:
            return True
        if self.client is LogClient.ANOTHER:
            self.client = LogClient.NOBODY
        self._another_at = None
        return False

    def _count(self, number: int, now: float) -> None:
        if number < self._highest - 10_000:  # another log
            self._seen.clear()
            self._tallies.clear()
            self._highest = number
        if number in self._seen:
            return
        self._seen.add(number)
        self._blocks += 1
        self._highest = max(self._highest, number)
        if len(self._seen) > 20_000:
            self._seen = {kept for kept in self._seen if kept > self._highest - 10_000}
        if not self._tallies or now - self._tallies[-1][0] >= self.TALLY_S:
            self._tallies.append((now, self._blocks, self._highest))

    def _stop_again(self, now: float) -> list[Send]:
        if now < self._next_stop:
            return []
        self._next_stop = now + self.STOP_EVERY_S
        return [BlockStatus(STOP_BLOCKS, True)]
