"""The logs on board by LOG_REQUEST_LIST and LOG_REQUEST_DATA, as procedures (`gcs.link.procedures`).

An ArduPilot serves one request at a time and drops others without a word while it sends, so a stretch is asked for, its
gaps after it, and after silence the vehicle is told to end before it is asked again. What was begun is always ended
(`farewell`): a download that nobody ends goes on and starves the link. Gaps that lie closer together than a round trip
costs are asked for as one. There is no checksum here.
"""

from __future__ import annotations

from collections.abc import Callable

from gcs.link.decode import LOG_PIECE
from gcs.link.encode import LogDataRequest, LogEnd, LogListRequest, Send
from gcs.link.events import Event, LogData, LogEntry, StatusText
from gcs.link.patience import Patience
from gcs.link.pieces import Pieces
from gcs.link.procedures import Done, Failed

NAME = "LOG_REQUEST_DATA"
ARMED = "Disarm for log download"
BUSY = "Log download in progress"
"""How ArduPilot refuses."""
NO_ANSWER_S = 8.0
GIVE_UP_S = 60.0
TRIES = 8


def _refusal(event: Event) -> str | None:
    """What the vehicle says against fetching, None where this is no such text."""
    if isinstance(event, StatusText):
        return next((event.text for words in (ARMED, BUSY) if words.lower() in event.text.lower()), None)
    return None


class ListLogs:
    """The logs on board, in their order; empty where there are none."""

    QUIET_S = 0.7

    def __init__(self) -> None:
        self.outcome: Done[tuple[LogEntry, ...]] | Failed | None = None
        self._held: dict[int, LogEntry] = {}
        self._count: int | None = None
        self._began = self._next = 0.0
        self._rounds = 0
        self._busy = 0
        self._sending_here = False

    def start(self, now: float) -> list[Send]:
        self._began = now
        self._next = now + self.QUIET_S
        return [LogListRequest()]

    def farewell(self) -> list[Send]:
        """What ends it, whatever became of it."""
        return [LogEnd()]

    def on_event(self, event: Event, now: float) -> list[Send]:
        if self.outcome is not None:
            return []
        if (text := _refusal(event)) is not None:
            return self._on_refusal(text)
        if isinstance(event, LogData):
            self._sending_here = True  # a download that nobody ended: it must end before anything is answered
        elif isinstance(event, LogEntry):
            return self._on_entry(event, now)
        return []

    def poll(self, now: float) -> list[Send]:
        if self.outcome is not None or now < self._next:
            return []
        self._next = now + self.QUIET_S
        self._rounds += 1
        limit_s = GIVE_UP_S if self._held else NO_ANSWER_S
        if self._rounds > TRIES and now - self._began > limit_s:
            heard = f"{len(self._held)} of {self._count} came" if self._held else "no answer"
            self.outcome = Failed(f"the list of the vehicle's logs: {heard}", answered=bool(self._held))
            return [LogEnd()]
        return [LogEnd(), self._ask()]

    def _ask(self) -> LogListRequest:
        gaps = [id for id in range(1, (self._count or 0) + 1) if id not in self._held]
        return LogListRequest(gaps[0], gaps[-1]) if self._held and gaps else LogListRequest()

    def _on_refusal(self, text: str) -> list[Send]:
        self._busy += 1
        if ARMED.lower() in text.lower() or (self._busy > 2 and not self._sending_here):
            self.outcome = Failed(f"the vehicle gives no logs: {text}", answered=True)
        return []

    def _on_entry(self, event: LogEntry, now: float) -> list[Send]:
        self._next = now + self.QUIET_S
        if event.count != self._count:
            self._held.clear()  # one more, or one less: numbers may have moved
            self._count = event.count
        if event.count and event.id <= event.count:
            if event.id not in self._held:
                self._rounds = 0
                self._began = now
            self._held[event.id] = event
        if len(self._held) < event.count:
            return []
        self.outcome = Done(tuple(self._held[id] for id in sorted(self._held)))
        return [LogEnd()]


class ReadLog:
    """The bytes `start` up to `stop` of the log `id`, handed to `store` in order; the outcome is `stop`.

    What `store` raises ends the reading.
    """

    STRETCH_S = 4.0
    """How long one request keeps the vehicle sending: what is cut then is lost, at most so much."""
    STRETCHES = (16_384, 4_194_304)
    """Bytes, the least and the most."""

    def __init__(self, id: int, store: Callable[[bytes], None], *, start: int, stop: int) -> None:
        self.outcome: Done[int] | Failed | None = None
        self._id = id
        self._about = f"reading log {id}"
        self._store = store
        self._stop = stop
        self._pieces = Pieces(start, start)
        self._patience = Patience()
        self._asked_to = start
        """Behind the last byte of the request under way."""
        self._rate = 0.0
        self._began = self._came_at = self._heard_at = 0.0
        self._came = 0
        self._unanswered = 0
        self._ends = 0

    @property
    def at(self) -> int:
        """All before it was handed on."""
        return self._pieces.at

    def start(self, now: float) -> list[Send]:
        self._began = self._came_at = self._heard_at = now
        return self._go_on(now)

    def farewell(self) -> list[Send]:
        """What ends it, whatever became of it."""
        return [LogEnd()]

    def on_event(self, event: Event, now: float) -> list[Send]:
        if self.outcome is not None:
            return []
        self._heard_at = now
        text = _refusal(event)
        if text is not None and ARMED.lower() in text.lower():
            self.outcome = Failed(f"{self._about}: the vehicle says {text}", answered=True)
            return [LogEnd()]
        return self._on_piece(event, now) if isinstance(event, LogData) and event.id == self._id else []

    def poll(self, now: float) -> list[Send]:
        if self.outcome is not None or not self._patience.is_over(now):
            return []
        self._unanswered += 1
        heard = now - self._heard_at < 3.0
        silent_s = now - self._came_at
        if (heard and self._unanswered > TRIES and silent_s > NO_ANSWER_S * 2) or silent_s > GIVE_UP_S:
            why = "the vehicle sends nothing of it; is it still there?" if heard else "the vehicle is not heard"
            self.outcome = Failed(f"{self._about}: {why}", answered=False)
            return [LogEnd()]
        return [LogEnd(), *self._go_on(now)]

    def _on_piece(self, event: LogData, now: float) -> list[Send]:
        came = self._pieces.add(event.offset, event.data)
        if came:
            self._store(came)
            self._ends = 0
        self._patience.answered(now)
        self._came_at, self._unanswered = now, 0
        self._came += len(event.data)
        self._rate = self._came / max(1e-3, now - self._began)
        stop = event.offset + len(event.data)
        if len(event.data) < LOG_PIECE and stop < self._asked_to and stop <= self._pieces.highest:
            return self._on_end(stop, now)
        return self._go_on(now) if stop >= self._asked_to or self._pieces.whole else []

    def _on_end(self, at: int, now: float) -> list[Send]:
        """A short piece before the end: the vehicle has stopped there, and perhaps has no more."""
        self._ends += 1
        if self._ends <= TRIES or at > self._pieces.at:
            return []  # asked again after the silence that follows
        self.outcome = Failed(f"{self._about}: it ends at byte {at:,}, before the {self._stop:,} told", answered=True)
        return [LogEnd()]

    def _go_on(self, now: float) -> list[Send]:
        pieces = self._pieces
        if pieces.at >= self._stop:
            self.outcome = Done(self._stop)
            return [LogEnd()]
        if pieces.whole:
            least, most = self.STRETCHES
            pieces.stop = min(self._stop, pieces.at + int(min(most, max(least, self._rate * self.STRETCH_S))))
        pieces.want(pieces.stop)
        first, last = pieces.gaps(int(self._rate * (self._patience.round_trip_s or 0.0)))[0]
        self._asked_to = last
        self._patience.asked(now)
        return [LogDataRequest(self._id, first, last - first)]


class EndLogs:
    """Have whatever the vehicle sends of its logs ended: said again until none of it comes any more."""

    EVERY_S = 0.2
    QUIET_S = 0.5

    def __init__(self) -> None:
        self.outcome: Done[None] | Failed | None = None
        self._quiet_at = self._next = 0.0

    def start(self, now: float) -> list[Send]:
        self._quiet_at, self._next = now + self.QUIET_S, now + self.EVERY_S
        return [LogEnd()]

    def on_event(self, event: Event, now: float) -> list[Send]:
        if isinstance(event, LogData | LogEntry):
            self._quiet_at = now + self.QUIET_S
        return []

    def poll(self, now: float) -> list[Send]:
        if self.outcome is None and now >= self._quiet_at:
            self.outcome = Done(None)
        if self.outcome is not None or now < self._next:
            return []
        self._next = now + self.EVERY_S
        return [LogEnd()]
