"""The vehicle's log, block by block while it is written: a procedure (`gcs.link.procedures`) that goes on for a flight.

Other stations give a block up after some time; this receiver never does before the sender does.
"""

from __future__ import annotations

import math
import zlib
from array import array
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field

from gcs.link.encode import START_BLOCKS, STOP_BLOCKS, BlockStatus, Send
from gcs.link.events import Attitude, Event, LogBlock, LogReceipt, StatusText, SystemTime
from gcs.link.log_end import NOT_JUDGED, LogEnd, end_of_asked, end_of_followed, end_of_restarted
from gcs.link.procedures import Done, Failed


@dataclass(frozen=True, slots=True, kw_only=True)
class StreamResult:
    """One log as its blocks came."""

    file: int
    """From 0; a vehicle that starts again begins the next."""
    blocks: int
    """Blocks kept."""
    expected: int
    """One more than the highest number seen."""
    missing: tuple[tuple[int, int], ...]
    """First and last block of each stretch below `expected` that never came."""
    duplicates: int
    end: LogEnd = NOT_JUDGED
    """Whether anything should have followed the highest block seen."""
    in_two_versions: int = 0
    """Blocks that came again with other bytes; the first version is kept."""
    impossible: int = 0
    """Blocks refused for a number that no sender can have come to."""


@dataclass(kw_only=True)
class _Stream:
    """The blocks of one log of the vehicle, by number."""

    file: int
    kept: bytearray = field(default_factory=bytearray)
    """One byte a block: 1 where it is kept."""
    checks: array[int] = field(default_factory=lambda: array("I"))
    """CRC-32 of every kept block: a block that comes twice is the same block."""
    blocks: int = 0
    highest: int = -1
    duplicates: int = 0
    want: dict[int, tuple[float, float]] = field(default_factory=dict)
    """Missing block -> (when to ask next, how long to wait after that)."""
    reported: str = ""
    """The vehicle's words about having stopped this stream."""
    reported_at: float = 0.0
    versions: dict[int, bytes] = field(default_factory=dict)
    """Other bytes of blocks that are kept: a new log's, if more of them come."""
    twice: set[int] = field(default_factory=set)
    """Blocks of this log that came with other bytes, and the log went on."""
    far: tuple[int, float] | None = None
    """The last number that was too far away, and when it came."""
    impossible: int = 0
    restarted: tuple[float, float] | None = None
    """The vehicle's clock as it was last heard before it began anew, and what it may have shown by then."""
    settled_at: float = -math.inf
    """Until then a block far ahead is rather one of the log before, still on its way when this one began."""

    def check(self, number: int) -> int | None:
        return self.checks[number] if number < len(self.kept) and self.kept[number] else None

    def keep(self, number: int, check: int) -> None:
        short = number + 1 - len(self.kept)
        if short > 0:
            self.kept.extend(bytes(short))
            self.checks.extend([0] * short)
        self.kept[number] = 1
        self.checks[number] = check
        self.blocks += 1
        self.want.pop(number, None)
        self.highest = max(self.highest, number)

    def result(self, end: LogEnd) -> StreamResult:
        missing = tuple(_stretches(sorted(self.want)))
        return StreamResult(
            file=self.file,
            blocks=self.blocks,
            expected=self.highest + 1,
            missing=missing,
            duplicates=self.duplicates,
            end=end,
            in_two_versions=len(self.twice),
            impossible=self.impossible,
        )


@dataclass
class _VehicleClock:
    """The vehicle's clock by its telemetry, against ours."""

    boot_s: float | None = None
    heard_at: float = 0.0
    stopped_at: float | None = None
    """When, on our clock, the recording was ended."""
    at_stop_s: float | None = None
    """The vehicle's at that moment, by what was heard since; the least delayed word counts."""

    def at(self, now: float) -> float | None:
        return None if self.boot_s is None else self.boot_s + now - self.heard_at

    def hear(self, boot_s: float, now: float) -> tuple[float, float] | None:
        """Where it went back: what it was, and what it may have been as it began anew."""
        before = None
        if self.boot_s is not None and boot_s < self.boot_s - 1.0:
            silent_s = max(0.0, now - boot_s - self.heard_at)
            before = (self.boot_s, self.boot_s + silent_s)
            self.at_stop_s = None
        if before is not None or self.boot_s is None or boot_s > self.boot_s:
            self.boot_s, self.heard_at = boot_s, now
        if self.stopped_at is not None and before is None:
            at_stop_s = boot_s - (now - self.stopped_at)
            self.at_stop_s = at_stop_s if self.at_stop_s is None else max(self.at_stop_s, at_stop_s)
        return before


class LogBlocks:
    """Receives the vehicle's log while it is written: asks for it, keeps each block, asks again for gaps.

    `store(file, number, data)` keeps one block of 200 bytes and says whether it could; only a kept block is
    acknowledged, so that a full disk leaves the block with its sender as long as that can hold it.

    A vehicle that reboots, or drops the stream, starts a new log whose numbers begin at 0 again: `file` counts up, and
    nothing is ever written over. It is recognised by our own START having been sent again, or by `OTHER_LOG` blocks
    that differ from those kept under their numbers while nothing new of the old log comes: one alone was damaged on its
    way, or is somebody else's, and is counted. Formats at a log's beginning are the same in every log of a vehicle, so
    blocks that came twice since the last new one are remembered and go along into the new file.

    `log_end_s()` gives the newest time stamp of the log as it is stored, on the vehicle's clock; it is asked when a log
    has ended, and compared with the vehicle's clock in its telemetry: see `gcs.link.log_end`. The vehicle's own text
    that it stopped the stream is kept for the user; what follows from silence follows without it.

    The outcome, one result per log, comes after `stop`.
    """

    START_EVERY_S = 1.0
    REORDER_S = 0.03
    """A gap this young may be two packets out of order."""
    MOST_WAIT_S = 5.0
    AT_ONCE = 32
    SPACING_S = 0.02
    """Between two volleys of nacks, so that asking does not crowd out the answers."""
    JUMP = 100_000
    """A step of more blocks (20 MB) than any sender buffers is no block number;"""
    NEAR = 2000
    """and one of more than these, which is more than ArduPilot's buffer holds, needs a second block beside it."""
    FAR_S = 5.0
    """So long it may take to come."""
    OTHER_LOG = 4
    """Blocks with other bytes than those kept make a new log."""
    LATE_FACTOR = 2.5
    """START is said again after so many times the link's lag: a vehicle that hears it twice begins twice."""
    SILENCE_S = 11.0
    """The sender drops a stream 10 s after our last word."""
    SETTLED_S = 1.0
    """Ten of the sender's resends without a new block after STOP: there is no more."""
    GIVEN_UP_S = 4.0
    """After STOP, gaps that are asked for and not answered for so long by a vehicle that is heard: it has let go."""
    STOP_EVERY_S = 0.3
    LOW = 64
    """A block below this, after START was sent again, begins a new log."""
    LATE_START = 1024
    """Blocks that may be lost before the first one heard."""
    STOPPED = "Log stream stopped"
    """How the vehicle's text begins when it gives up a stream."""
    LEFT_OVER_S = 10.0
    """So long after a new log began blocks of the one before may still be on their way."""
    STRAY_S = 1.0
    """Blocks of a stopped stream that were under way come so long after that text at most."""

    def __init__(
        self,
        store: Callable[[int, int, bytes], bool],
        log_end_s: Callable[[], float | None] = lambda: None,
        station: tuple[int, int] | None = None,
        lag_s: Callable[[], float | None] = lambda: None,
    ) -> None:
        """`station` is (system, component) of ours; None takes every block for ours. `lag_s()` is the link's, the worse
        way, None while it is not known."""
        self.another_at: float | None = None
        """When it was heard last that another station answers the vehicle's log."""
        self._station = station
        self.outcome: Done[tuple[StreamResult, ...]] | Failed | None = None
        self._store = store
        self._log_end_s = log_end_s
        self._lag_s = lag_s
        self._clock = _VehicleClock()
        self._kept_at: float | None = None
        self._stream = _Stream(file=0)
        self._finished: list[StreamResult] = []
        self._doubles: dict[int, bytes] = {}
        self._renewed = False
        self._started = False
        self._stopping = False
        self._last_block = 0.0
        self._last_new = 0.0
        self._last_heard = 0.0
        self._next_start = 0.0
        self._next_nacks = 0.0
        self._next_stop = 0.0

    @property
    def started(self) -> bool:
        """Whether the log was asked for."""
        return self._started

    @property
    def file(self) -> int:
        return self._stream.file

    @property
    def received(self) -> int:
        return self._stream.blocks

    @property
    def open(self) -> int:
        """Blocks known to exist and not kept."""
        return len(self._stream.want)

    @property
    def duplicates(self) -> int:
        return self._stream.duplicates

    @property
    def numbered(self) -> int:
        """One more than the highest number seen: the vehicle has written at least so many blocks."""
        return self._stream.highest + 1

    @property
    def kept_at(self) -> float | None:
        """When the last new block was kept, None before the first."""
        return self._kept_at

    @property
    def reported(self) -> str:
        """The vehicle's words about having stopped the stream, empty while it goes on."""
        return self._stream.reported

    def vehicle_clock_s(self, now: float) -> float | None:
        """What the vehicle's clock must show now, None while it was not heard."""
        return self._clock.at(now)

    def results(self, now: float) -> tuple[StreamResult, ...]:
        """One result per log, as it stands now; the last one's end is judged once `stop` was called."""
        return (*self._finished, self._stream.result(self._end_of_last(now)))

    def start(self, now: float) -> list[Send]:
        self._started = True
        self._last_block = self._last_new = self._last_heard = now
        return self._ask(now)

    def _ask(self, now: float) -> list[Send]:
        self._next_start = now + max(self.START_EVERY_S, self.LATE_FACTOR * (self._lag_s() or 0.0))
        return [BlockStatus(START_BLOCKS, True)]

    def stop(self, now: float) -> list[Send]:
        """Ask the vehicle to end its log; the outcome follows when the rest has come."""
        self._stopping = True
        self._clock.stopped_at = now
        self._clock.at_stop_s = None
        self._last_new = max(self._last_new, now)
        self._next_stop = now + self.STOP_EVERY_S
        return [BlockStatus(STOP_BLOCKS, True)]

    def on_event(self, event: Event, now: float) -> list[Send]:
        if not self._started or self.outcome is not None:
            return []
        if isinstance(event, LogReceipt):
            self._note_another((event.system, event.component), now)
            return []
        if self._stopping and now - self._last_heard > 1.0:
            self._last_new = now  # found again, it may have more
        self._last_heard = now
        if isinstance(event, LogBlock):
            theirs = self._note_another((event.target_system, event.target_component), now)
            sends = self._on_block(event.number, event.data, now)
            return [] if theirs else sends  # kept all the same; their receipts are theirs to give
        if isinstance(event, Attitude | SystemTime):
            return self._on_clock(event.boot_s, now)
        if isinstance(event, StatusText) and event.text.startswith(self.STOPPED):
            self._stream.reported, self._stream.reported_at = event.text, now
        return []

    def _note_another(self, station: tuple[int, int], now: float) -> bool:
        """Whether it is another station that takes the log."""
        if self._station is None or station in ((0, 0), self._station):
            return False
        self.another_at = now
        return True

    def _on_clock(self, boot_s: float, now: float) -> list[Send]:
        before = self._clock.hear(boot_s, now)
        if before is None or not self._stream.blocks:
            return []
        self._stream.restarted = self._stream.restarted or before
        return [] if self._stopping else self._ask_anew(now)

    def _ask_anew(self, now: float) -> list[Send]:
        self._renewed = True
        return self._ask(now)

    def _on_block(self, number: int, data: bytes, now: float) -> list[Send]:
        if number >= STOP_BLOCKS or not self._is_near(number, now):
            return []
        self._last_block = now
        check = zlib.crc32(data)
        stream = self._stream
        kept = stream.check(number)
        settled: list[Send] = []
        if self._renewed and number <= self.LOW:
            settled = self._begin_next_log(number, now)
        elif kept is not None and kept != check:
            stream.versions[number] = data
            if len(stream.versions) < self.OTHER_LOG:
                return []  # not acknowledged, so it comes again
            settled = self._begin_next_log(number, now)
        elif kept is not None:
            stream.duplicates += 1
            if number <= self.LOW * 16:
                self._doubles[number] = data
            return [BlockStatus(number, True)]
        else:
            self._doubles.clear()
            self._renewed = False  # the log goes on where it was
            settled = [BlockStatus(earlier, True) for earlier in stream.versions]
            stream.twice.update(stream.versions)
            stream.versions.clear()
        return [*settled, *self._keep(number, data, check, now)]

    def _is_near(self, number: int, now: float) -> bool:
        """Whether a sender can have come to this number; counted where not."""
        stream = self._stream
        # A first block far from 0 is of a stream that somebody else began: unacknowledged it ends, and ours begins.
        reach = self.JUMP if stream.blocks else self.LATE_START
        step, far = number - stream.highest, stream.far
        if step > self.LOW and now < stream.settled_at:
            return False  # if it is this log's, it is sent again when those below it have come
        if step <= min(reach, self.NEAR):
            return True
        if step <= reach:
            stream.far = (number, now)
            if far is not None and 0 < abs(number - far[0]) <= self.NEAR and now - far[1] < self.FAR_S:
                return True
        stream.impossible += stream.blocks > 0
        return False

    def _begin_next_log(self, number: int, now: float) -> list[Send]:
        self._finished.append(self._stream.result(self._end_of_followed(now)))
        versions = self._stream.versions
        self._stream = _Stream(file=self._stream.file + 1, settled_at=now + self.LEFT_OVER_S)
        self._renewed = False
        alike = min(versions, default=number + self.LOW)  # beyond it what came twice was the log's before
        formats = {earlier: data for earlier, data in self._doubles.items() if earlier < alike}
        self._doubles = {}
        sends: list[Send] = []
        for earlier, data in sorted((formats | versions).items()):
            if earlier < number + self.LOW and earlier != number:
                sends += self._keep(earlier, data, zlib.crc32(data), now)
        return [send for send in sends if isinstance(send, BlockStatus) and send.number in versions]

    def _keep(self, number: int, data: bytes, check: int, now: float) -> list[Send]:
        if not self._store(self._stream.file, number, data):
            self._note_gaps(number + 1, now)
            return []
        self._last_new = self._kept_at = now
        self._note_gaps(number, now)
        self._stream.keep(number, check)
        if self._stream.reported and now > self._stream.reported_at + self.STRAY_S:
            self._stream.reported = ""  # it goes on after all
        return [BlockStatus(number, True)]

    def _note_gaps(self, end: int, now: float) -> None:
        """Blocks from the highest so far up to, not including, `end` exist and are wanted."""
        for missing in range(self._stream.highest + 1, end):
            self._stream.want[missing] = (now + self.REORDER_S, 0.1)
        self._stream.highest = max(self._stream.highest, end - 1)

    def poll(self, now: float) -> list[Send]:
        if not self._started or self.outcome is not None:
            return []
        sends: list[Send] = []
        if self._stopping:
            if self._is_over(now):
                self.outcome = Done(self.results(now))
                return []
            if now >= self._next_stop:
                self._next_stop = now + self.STOP_EVERY_S
                sends.append(BlockStatus(STOP_BLOCKS, True))
        elif not self._stream.blocks or self._renewed:
            if now >= self._next_start:
                sends += self._ask(now)
        elif now - self._last_block > self.SILENCE_S and now - self._last_heard < 1.0:
            sends += self._ask_anew(now)
        return sends + self._nacks(now)

    def _nacks(self, now: float) -> list[Send]:
        if now < self._next_nacks or not self._stream.want:
            return []
        due = [number for number, (when, _) in self._stream.want.items() if when <= now][: self.AT_ONCE]
        for number in due:
            wait = self._stream.want[number][1]
            self._stream.want[number] = (now + wait, min(2.0 * wait, self.MOST_WAIT_S))
        if due:
            self._next_nacks = now + self.SPACING_S
        return [BlockStatus(number, False) for number in due]

    def _is_over(self, now: float) -> bool:
        heard = now - self._last_heard < 1.0
        # Without the vehicle's clock since the stop nobody could say whether the log goes to its end.
        clocked = self._clock.boot_s is None or self._clock.at_stop_s is not None
        if not self._stream.want and heard and clocked:
            return now - self._last_new > self.SETTLED_S
        return now - self._last_new > (self.GIVEN_UP_S if heard else self.SILENCE_S)

    def _end_of_followed(self, now: float) -> LogEnd:
        stream = self._stream
        if stream.restarted is not None:
            return end_of_restarted(self._log_end_s(), *stream.restarted)
        return end_of_followed(self._log_end_s(), self._clock.at(now), stream.reported)

    def _end_of_last(self, now: float) -> LogEnd:
        stream, clock = self._stream, self._clock
        if clock.stopped_at is None or not stream.blocks:
            return NOT_JUDGED
        if stream.restarted is not None:
            return end_of_restarted(self._log_end_s(), *stream.restarted)
        heard = clock.at_stop_s is not None
        at_stop_s = clock.at_stop_s if heard else clock.at(clock.stopped_at)
        return end_of_asked(self._log_end_s(), at_stop_s, clock.at(now), heard, stream.reported)


def _stretches(numbers: Iterable[int]) -> list[tuple[int, int]]:
    """Sorted numbers as (first, last) of consecutive stretches."""
    out: list[tuple[int, int]] = []
    for number in numbers:
        if out and number == out[-1][1] + 1:
            out[-1] = (out[-1][0], number)
        else:
            out.append((number, number))
    return out
