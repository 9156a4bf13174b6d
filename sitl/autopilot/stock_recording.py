"""A stock autopilot's two logs: the file on its card, and the stream to the ground, which may miss what the file has.

Both get the same messages, each from its own beginning: the file when the vehicle is armed, the stream when a ground
station asks for it. Nothing is written before the vehicle is armed, and for a while after it was disarmed it goes on.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping
from typing import Any

from sitl.autopilot.blocks import BlockStream
from sitl.autopilot.logger import BLOCK_BYTES, DataFlashLog, FileSink, Format
from sitl.autopilot.modes import Severity
from sitl.autopilot.recording import TO_GROUND, Recording

_AFTER_DISARMING_US = 15_000_000
_STATISTICS_US = 1_000_000
_BLOCK_IN_MEMORY = 212  # 200 bytes, number, time of sending, and a pointer
_COUNTER_BITS = 0xFF  # blocks are counted in a byte: more than 53 kB become few


class DroppingStream(BlockStream):
    """A small buffer in front of the link: a message that does not fit is dropped whole, and counted.

    What a log begins with waits until there is room; what comes meanwhile is dropped uncounted, as on ArduPilot.
    """

    def __init__(self, buffer_kb: int, now_s: float, lengths: Mapping[int, int]) -> None:
        """`lengths` has the bytes of a message by its number."""
        super().__init__(0, now_s)
        self._room = max(1, buffer_kb * 1024 // _BLOCK_IN_MEMORY & _COUNTER_BITS)
        self._lengths = lengths
        self._first: deque[bytes] = deque()
        self._beginning = True
        self._newest = -1  # block that was ever sent
        self.dropped = 0
        """Messages."""
        self.resent = 0
        """Blocks, since this was last set to 0."""

    def write(self, data: bytes) -> None:
        at = 0
        while at < len(data):
            size = self._lengths[data[at + 2]]
            self._take(data[at : at + size])
            at += size

    def begun(self) -> None:
        """What a log begins with has been written."""
        self._beginning = False

    def due(self, now_s: float) -> list[tuple[int, bytes]]:
        while self._first and self._fits(self._first[0]):
            super().write(self._first.popleft())
        blocks = super().due(now_s)
        self.resent += sum(number <= self._newest for number, _ in blocks)
        self._newest = max([self._newest, *(number for number, _ in blocks)])
        return blocks

    @property
    def started(self) -> int:
        """Blocks that have been begun."""
        return self._next

    @property
    def counts(self) -> tuple[int, int, int]:
        """Blocks that are free, waiting to be sent, and waiting for a receipt."""
        waiting = len(self._fresh) + len(self._refused)
        return max(0, self._room - len(self._data)), waiting, max(0, len(self._data) - waiting)

    def _fits(self, message: bytes) -> bool:
        return len(message) <= (self._room - len(self._data)) * BLOCK_BYTES - len(self._rest)

    def _take(self, message: bytes) -> None:
        if self._beginning:
            self._first.append(message)
        elif self._first:
            return
        elif self._fits(message):
            super().write(message)
        else:
            self.dropped += 1


class StockRecording(Recording):
    """`log` is there while the vehicle logs, whoever takes it."""

    def __init__(self, *words: Any, **options: Any) -> None:
        super().__init__(*words, **options)
        self._all = DataFlashLog((), self._time_us(), self._dialect)
        self._all.flush()
        self._card_sink: FileSink | None = None
        self._disarmed_us = -_AFTER_DISARMING_US
        self._was_armed = False
        self._statistics_us = 0
        self._told = False  # that the card takes no file
        self._formats: dict[str, Format] = {f.name: f for f in self._dialect.formats}

    @property
    def refuses_arming(self) -> bool:
        return bool(int(self._parameters.acting("LOG_BACKEND_TYPE")) & TO_GROUND) and self.stream is None

    def start_stream(self) -> BlockStream | None:
        """The log as it is now also goes out as blocks, from its formats on."""
        if not self.offered or not int(self._parameters.acting("LOG_BACKEND_TYPE")) & TO_GROUND:
            return None
        self._end_stream()
        lengths = {f.number: f.length for f in self._dialect.formats}
        stream = DroppingStream(int(self._parameters["LOG_MAV_BUFSIZE"]), self._time_us() * 1e-6, lengths)
        self._attach(stream)
        stream.begun()
        self.stream = stream
        self.keep_on()
        return stream

    def stop_stream(self) -> None:
        self._end_stream()
        self.keep_on()

    def drop_stream(self, reason: str | None) -> None:
        """Nothing is said: the ground sees no more blocks."""
        stream = self.stream
        self._end_stream()
        if stream is not None:
            stream.abandon()
        self.keep_on()

    def keep_on(self) -> None:
        armed = self._armed()
        if self._was_armed and not armed:
            self._disarmed_us = self._time_us()
        self._was_armed = armed
        due = armed or self._parameters["LOG_DISARMED"] != 0
        due = due or self._time_us() - self._disarmed_us < _AFTER_DISARMING_US
        if due and self._card_sink is None:
            self._open_card()
        elif not due and self._card_sink is not None:
            self._close_card()
        self._all.flush()
        self.log = self._all if due else None

    def flush(self) -> None:
        self.keep_on()
        super().flush()
        stream = self.stream
        if isinstance(stream, DroppingStream) and self._time_us() - self._statistics_us >= _STATISTICS_US:
            self._statistics_us = self._time_us()
            self._tell_statistics(stream)

    def close(self) -> None:
        self._end_stream()
        self._close_card()
        self.log = None

    def _tell_statistics(self, stream: DroppingStream) -> None:
        """DMS, into the stream alone, as on ArduPilot."""
        form = self._formats.get("DMS")
        if form is None:
            return
        free, waiting, sent = (min(255, count) for count in stream.counts)
        values = (self._time_us(), stream.started, stream.dropped, 0, stream.resent)
        stream.resent = 0
        stream.write(form.struct.pack(0xA3, 0x95, form.number, *values, *(free,) * 3, *(waiting,) * 3, *(sent,) * 3))

    def _open_card(self) -> None:
        card, trouble = self._card()
        if card is not None:
            self._card_sink = card
            self._attach(card)
        if trouble is not None and not self._told:
            self._told = True
            self._say(Severity.CRITICAL, f"Logging failed: {trouble}")

    def _attach(self, sink: FileSink | DroppingStream) -> None:
        """The log, which begins anew for this sink."""
        log, self.log = self.log, self._all
        self._all.attach(sink, self._time_us(), self._write_first)
        self.log = log

    def _end_stream(self) -> None:
        if self.stream is not None:
            self._all.flush()
            self._all.detach(self.stream)
        self.stream = None

    def _close_card(self) -> None:
        if self._card_sink is not None:
            self._all.flush()
            self._all.detach(self._card_sink)
        self._card_sink = None
