"""One recording: the vehicle's log on its way to disk and to the live view, and how well it arrives."""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable
from typing import Any

from gcs.flight.live import LiveLog, LiveWindow
from gcs.flight.log_health import LogHealth, Tally, capacity
from gcs.flight.recorder import Recorder, RecordingSummary
from gcs.link.encode import Send
from gcs.link.log_answer import LogAnswer
from gcs.link.log_blocks import LogBlocks

TALLY_EVERY_S = 0.2
KEPT_TALLIES = 64
"""More than two times what a rate is counted over."""


class Recording:
    """Begins at once, with an empty live log. Its caller guards it against two threads, but for `over`.

    `blocks` is the conversation that brings the log; its caller lets it start, stop and hear events.
    """

    def __init__(
        self,
        recorder: Recorder,
        live: LiveLog,
        clock: Callable[[], float],
        station: tuple[int, int] | None = None,
        lag_s: Callable[[], float | None] = lambda: None,
    ) -> None:
        """`station` is (system, component) of ours; `lag_s` as `LogBlocks`'."""
        live.restart()
        self.recorder = recorder
        self.blocks = LogBlocks(self._store, live.end_s, station, lag_s)
        self.over = threading.Event()
        """The vehicle has sent the rest, or has nothing more."""
        self._live = live
        self._live_file = 0
        self._clock = clock
        self._tallies = deque([self._tally(clock())], maxlen=KEPT_TALLIES)

    def poll(self, now: float) -> list[Send]:
        """What is due to be said of the blocks."""
        sends = self.blocks.poll(now)
        if self.blocks.outcome is not None:
            self.over.set()
        return sends

    def health(self) -> LogHealth:
        """How the log arrives, at this moment."""
        now, blocks = self._clock(), self.blocks
        present = self._tally(now)
        return LogHealth(
            file=blocks.file,
            blocks=blocks.received,
            open=blocks.open,
            silent_s=None if blocks.kept_at is None else max(0.0, now - blocks.kept_at),
            log_s=present.log_s,
            clock_s=blocks.vehicle_clock_s(now),
            capacity=capacity([*self._tallies, present]),
            reported=blocks.reported,
            problem=self.recorder.problem,
            another=blocks.another_at is not None and now - blocks.another_at < LogAnswer.ANOTHER_FOR_S,
        )

    def seen(self) -> dict[str, Any]:
        """What a snapshot tells of it, by the snapshot's fields."""
        return {
            "recording": self.recorder.log_path or self.recorder.directory / "flight.BIN",
            "log_on_card": False,
            "blocks_received": self.blocks.received,
            "blocks_open": self.blocks.open,
            "duplicates": self.blocks.duplicates,
            "recording_problem": self.recorder.problem,
        }

    def window(self, last_s: float) -> LiveWindow:
        """The last seconds of the log."""
        return self._live.window(last_s)

    def finish(self) -> RecordingSummary:
        """Close the files."""
        return self.recorder.finish(self.blocks.results(self._clock()))

    def _store(self, file: int, number: int, data: bytes) -> bool:
        if file != self._live_file:
            self._live.restart()
            self._live_file = file
            self._tallies.clear()
        self._live.feed(number, data)
        now = self._clock()
        if not self._tallies or now - self._tallies[-1].at_s >= TALLY_EVERY_S:
            self._tallies.append(self._tally(now))
        return self.recorder.store(file, number, data)

    def _tally(self, now: float) -> Tally:
        log_s, read = self._live.progress()
        return Tally(at_s=now, kept=self.blocks.received, numbered=self.blocks.numbered, read=read, log_s=log_s)
