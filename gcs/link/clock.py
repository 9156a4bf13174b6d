"""How late the link is, and what has certainly reached the vehicle: told by the vehicle's own clock.

A ping is answered with the moment, on the vehicle's clock, at which it arrived. From that follow the offset between the
two clocks, and how late each way is. And it is a fence: whatever was sent before the ping has reached the vehicle by
then, or was lost, and whatever the vehicle stamps later it says knowing of it. Silence and old messages prove nothing.

Taken for granted of a link: it may hold everything back for any time, lose it, and repeat it, but it swaps only what is
less than `SWAP_S` apart. Queues of radios, routers and operating systems keep their order; neighbours change places.
"""

from __future__ import annotations

import math
from collections import deque

from gcs.link.encode import Ping, Send
from gcs.link.events import Attitude, Event, LocalPosition, SystemTime, TimeReply

PING_EVERY_S = 0.2
SWAP_S = 0.5
"""The farthest apart that two messages can be sent and still arrive in the wrong order."""
PATIENCE_S = 60.0
"""An answer later than this is not waited for; the clocks' offset is the best of the answers of this time."""
LOST_AFTER_S = 3.5
"""A link on which nothing was heard for this long is shown as lost: one heartbeat a second, three missed."""
REBOOT_STEP_S = 1.0
"""A vehicle's clock that goes back by more than this has started again; less is packets out of order."""
UNKNOWN = -math.inf


class LinkClock:
    """Sends pings and hears stamps. All times are the session's clock, s, but for those named `boot_s`."""

    def __init__(self) -> None:
        self.known_s = UNKNOWN
        """What the vehicle says now, it says after all that was sent up to this moment had reached it or was lost."""
        self.answered_s = UNKNOWN
        """When the newest ping that was answered was sent."""
        self.restarts = 0
        """How often the vehicle's clock jumped: a reboot, or two vehicles that take turns."""
        self._sent: dict[int, float] = {}
        self._next = UNKNOWN
        self._boot_s: float | None = None
        self._fences: deque[tuple[float, float]] = deque()
        """Sent, arrived (boot_s): answered pings that nothing was stamped later than yet."""
        self._replies: deque[tuple[float, float, float]] = deque()
        """Heard, round trip, offset at least."""
        self._offset: float | None = None
        """Most likely: the ping with the shortest round trip was answered in the middle of it."""
        self._earliest: float | None = None
        """At least: no ping was answered before it was sent."""
        self._down_s = 0.0
        self._up_s = 0.0

    def poll(self, now: float) -> list[Send]:
        """The ping that is due."""
        if now < self._next:
            return []
        self._next = now + PING_EVERY_S
        for nonce in [nonce for nonce, sent in self._sent.items() if now - sent > PATIENCE_S]:
            del self._sent[nonce]
        nonce = int(now * 1e9) + 1
        self._sent[nonce] = now
        return [Ping(nonce)]

    def on_event(self, event: Event, now: float) -> None:
        """Anything that the vehicle stamped."""
        match event:
            case TimeReply():
                sent = self._sent.pop(event.nonce, None)
                if sent is None or not math.isfinite(event.boot_s):
                    return
                self._stamp(event.boot_s, now)
                self._answer(sent, event.boot_s, now)
            case Attitude() | SystemTime() | LocalPosition():
                self._stamp(event.boot_s, now)

    @property
    def lag_s(self) -> float | None:
        """How late the link was when last heard, the worse way: the newest stamp's age on arrival, or how long the last
        answered ping took to get there. Silence is no lag. None while no ping was answered."""
        return None if self._offset is None else max(self._down_s, self._up_s)

    def vehicle_s(self, now: float) -> float | None:
        """What the vehicle's clock shows now, most likely; None as in `lag_s`."""
        offset = self._offset  # may be asked for from another thread
        return None if offset is None else now - offset

    def stamp_age_s(self, now: float) -> float | None:
        """How long ago the newest stamp was made, at most; None as in `lag_s`."""
        boot_s, earliest = self._boot_s, self._earliest  # may be asked for from another thread
        return None if earliest is None or boot_s is None else max(0.0, now - boot_s - earliest)

    def _stamp(self, boot_s: float, now: float) -> None:
        back = self._boot_s is not None and boot_s < self._boot_s - REBOOT_STEP_S
        ahead = self._earliest is not None and boot_s + self._earliest > now + REBOOT_STEP_S  # not made yet
        if back or ahead:
            self.restarts += 1
            self._fences.clear()
            self._replies.clear()
            self._offset, self._earliest, self._boot_s = None, None, boot_s
        if self._boot_s is None or boot_s >= self._boot_s:
            self._boot_s = boot_s
            self._down_s = 0.0 if self._offset is None else max(0.0, now - boot_s - self._offset)
        while self._fences and self._fences[0][1] + SWAP_S <= self._boot_s:
            self.known_s = max(self.known_s, self._fences.popleft()[0] - SWAP_S)

    def _answer(self, sent: float, boot_s: float, now: float) -> None:
        self._replies.append((now, now - sent, sent - boot_s))
        while now - self._replies[0][0] > PATIENCE_S:
            self._replies.popleft()
        _, trip_s, least = min(self._replies, key=lambda reply: reply[1])
        self._offset = least + 0.5 * trip_s
        self._earliest = max(least for _, _, least in self._replies)
        if sent > self.answered_s:
            self.answered_s = sent
            self._up_s = max(0.0, boot_s + self._offset - sent)
            self._down_s = max(self._down_s, now - boot_s - self._offset)
            self._fences.append((sent, boot_s))
