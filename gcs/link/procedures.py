"""Conversations with the vehicle as pure values: (event, now) in, what to send out.

None of them knows a socket, a clock or a thread, so that minutes of loss and retries are tested in milliseconds. The
session feeds a procedure only what its own vehicle said, and what the vehicle's version is before `start`.

Two decisions that other stations make differently. A write is done when the echoed 32 bits equal the sent ones, and
refused only after the vehicle, asked again, still holds another value: a stray echo of an earlier read is no refusal.
And the receiver of log blocks never gives up a block before the sender does.
"""

from __future__ import annotations

import zlib
from array import array
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from typing import Generic, Protocol, TypeVar

from gcs.errors import TippathError
from gcs.link.encode import (
    AUTOPILOT_VERSION,
    DO_SET_MODE,
    REQUEST_MESSAGE,
    SET_MESSAGE_INTERVAL,
    START_BLOCKS,
    STOP_BLOCKS,
    BlockStatus,
    Command,
    ParamList,
    ParamRead,
    ParamWrite,
    Send,
)
from gcs.link.events import (
    Attitude,
    AutopilotVersion,
    CommandAck,
    Encoding,
    Event,
    Heartbeat,
    LogBlock,
    ParamError,
    ParameterType,
    ParamValue,
    StatusText,
    SystemTime,
    bits_of_float,
    parameter_bits,
    parameter_value,
)
from gcs.link.log_end import NOT_JUDGED, LogEnd, end_of_asked, end_of_followed, end_of_restarted

T = TypeVar("T")
T_co = TypeVar("T_co", covariant=True)

FIRST_RETRY_S = 0.2
"""What a lost packet costs on a fast link; each repetition waits twice as long, up to `RETRY_S`."""
RETRY_S = 0.5
"""Twice a slow radio's round trip."""
TRIES = 6
TEXT_WAIT_S = 0.3
"""How long after a refusal its reason, a text of its own, may still be under way."""


class ProcedureError(TippathError):
    """The vehicle refused, or did not answer; the message says which and, where it told, why."""


class RefusedError(ProcedureError):
    """The vehicle answered: no."""


class NoAnswerError(ProcedureError):
    """The vehicle did not answer."""


@dataclass(frozen=True, slots=True)
class Done(Generic[T_co]):
    """The procedure reached its end."""

    value: T_co


@dataclass(frozen=True, slots=True)
class Failed:
    """The procedure cannot reach its end."""

    reason: str
    answered: bool
    """Whether the vehicle said no, as against nothing."""

    def error(self) -> ProcedureError:
        return RefusedError(self.reason) if self.answered else NoAnswerError(self.reason)


Outcome = Done[T] | Failed


class Procedure(Protocol[T_co]):
    """One conversation. `outcome` is None while it goes on."""

    def start(self, now: float) -> list[Send]:
        """Say the first thing."""
        ...

    def on_event(self, event: Event, now: float) -> list[Send]:
        """Hear something, and answer it."""
        ...

    def poll(self, now: float) -> list[Send]:
        """Time has passed: say again what was not answered, or give up."""
        ...

    @property
    def outcome(self) -> Done[T_co] | Failed | None: ...


@dataclass(frozen=True, slots=True)
class Parameter:
    """A parameter as the vehicle holds it."""

    name: str
    value: float
    bits: int
    """The 32 bits that travelled."""
    kind: int
    """MAV_PARAM_TYPE."""


class _Conversation(Generic[T]):
    """What the small procedures share: repeating until answered, and waiting for the text that explains a refusal."""

    def __init__(self, tries: int = TRIES, retry_s: float = RETRY_S) -> None:
        self.outcome: Done[T] | Failed | None = None
        self._encoding = Encoding.C_CAST
        self._tries_left = tries
        self._retry_s = retry_s
        self._tries = tries
        self._next = 0.0
        self._since = 0.0
        self._texts: list[str] = []
        self._refusal: str | None = None
        self._started = False

    def start(self, now: float) -> list[Send]:
        self._started = True
        return self._say(now)

    def on_event(self, event: Event, now: float) -> list[Send]:
        if isinstance(event, AutopilotVersion):
            self._encoding = event.encoding
        if not self._started or self.outcome is not None:
            return []
        if isinstance(event, StatusText):
            self._texts.append(event.text)
            return []
        return self._hear(event, now)

    def poll(self, now: float) -> list[Send]:
        if self.outcome is not None or now < self._next:
            return []
        if self._refusal is not None:
            said = f"; it says: {' / '.join(list(dict.fromkeys(self._texts))[-3:])}" if self._texts else ""
            self.outcome = Failed(self._refusal + said, answered=True)
            return []
        if self._tries_left <= 0:
            self._unanswered(now)
            return []
        return self._say(now)

    def _say(self, now: float) -> list[Send]:
        attempt = self._tries - self._tries_left
        self._tries_left -= 1
        first = FIRST_RETRY_S if self._tries > 1 else self._retry_s
        self._next = now + min(first * 2.0**attempt, self._retry_s)
        self._since = now if attempt == 0 else self._since
        return self._sends(attempt)

    def _refused(self, reason: str, now: float) -> None:
        self._refusal = reason
        self._next = now + TEXT_WAIT_S

    def _unanswered(self, now: float) -> None:
        self.outcome = Failed(f"{self._about()}: no answer in {now - self._since:.1f} s", answered=False)

    def _sends(self, attempt: int) -> list[Send]:
        raise NotImplementedError

    def _hear(self, event: Event, now: float) -> list[Send]:
        raise NotImplementedError

    def _about(self) -> str:
        raise NotImplementedError


class ReadParameter(_Conversation[Parameter]):
    """Ask for one parameter by name."""

    def __init__(self, name: str, tries: int = TRIES) -> None:
        super().__init__(tries)
        self.name = name

    def _sends(self, attempt: int) -> list[Send]:
        return [ParamRead(self.name)]

    def _hear(self, event: Event, now: float) -> list[Send]:
        if isinstance(event, ParamValue) and event.name == self.name:
            self.outcome = Done(_parameter(event, self._encoding))
        elif isinstance(event, ParamError) and event.name == self.name:
            self.outcome = Failed(f"parameter {self.name}: {event.reason}", answered=True)
        return []

    def _about(self) -> str:
        return f"parameter {self.name} was asked for (the vehicle may not have it)"


class WriteParameter(_Conversation[Parameter]):
    """Set one parameter; done when the echoed 32 bits equal the sent ones.

    `value` becomes the float32 nearest to it. On a vehicle that packs integers bytewise the parameter is read first,
    to learn its type. `repeat=False` is for parameters that do something when written, where a lost echo must not
    make it happen twice: it is sent once, and whoever asked finds out by other means whether it arrived.
    """

    def __init__(self, name: str, value: float, *, repeat: bool = True) -> None:
        super().__init__(TRIES if repeat else 1, RETRY_S if repeat else RETRY_S * 3)
        self.name = name
        self.value = value
        self._kind: int | None = None
        self._bits: int | None = None
        self._differing = 0

    def start(self, now: float) -> list[Send]:
        if self._encoding is Encoding.C_CAST:
            self._settle(ParameterType.REAL32)
        return [] if self.outcome is not None else super().start(now)

    def _settle(self, kind: int) -> None:
        try:
            self._bits = parameter_bits(self.value, kind, self._encoding)
        except (ValueError, OverflowError) as error:
            self.outcome = Failed(f"parameter {self.name} cannot be set to {self.value!r}: {error}", answered=True)
        self._kind = kind

    def _sends(self, attempt: int) -> list[Send]:
        if self._bits is None or self._kind is None:
            return [ParamRead(self.name)]
        return [ParamWrite(self.name, self._bits, self._kind)]

    def _hear(self, event: Event, now: float) -> list[Send]:
        if isinstance(event, ParamError) and event.name == self.name:
            self._refused(f"the vehicle refuses {self.name}: {event.reason}", now)
        if not isinstance(event, ParamValue) or event.name != self.name:
            return []
        if self._bits is None:
            self._settle(event.kind)
            if self.outcome is not None:
                return []
            self._tries_left = self._tries
            return self._say(now)
        if event.bits == self._bits:
            self.outcome = Done(_parameter(event, self._encoding))
            return []
        # Another value may be the late answer to somebody's read, and our own write may have been lost: ask, write
        # once more, and only then call it a refusal.
        self._differing += 1
        if self._refusal is not None:
            return []
        if self._differing == 1:
            self._next = now + self._retry_s
            return [ParamRead(self.name)]
        if self._differing == 2 and self._tries > 1:
            return self._say(now)
        held = event.value(self._encoding)
        self._refused(f"the vehicle refuses {self.name} = {self.value:.9g} and holds {held:.9g}", now)
        return []

    def _about(self) -> str:
        return f"parameter {self.name} was set to {self.value:.9g} (the vehicle may not have it, or not take the value)"


class ReadAllParameters:
    """Ask for the whole list, then for the gaps by index; the count may change under way, which starts it again.

    The outcome maps names to parameters, in the vehicle's order.
    """

    QUIET_S = 0.7
    """No parameter for this long: what is missing was lost."""
    AT_ONCE = 25
    ROUNDS = 8
    """Rounds without one new parameter before giving up."""

    def __init__(self) -> None:
        self.outcome: Done[dict[str, Parameter]] | Failed | None = None
        self._encoding = Encoding.C_CAST
        self._held: dict[int, ParamValue] = {}
        self._count: int | None = None
        self._next = 0.0
        self._idle_rounds = 0
        self._started = False
        self._renewed = 0

    @property
    def progress(self) -> tuple[int, int]:
        """Parameters held, and how many there are (0 while not known)."""
        return len(self._held), self._count or 0

    def start(self, now: float) -> list[Send]:
        self._started = True
        self._next = now + self.QUIET_S
        return [ParamList()]

    def on_event(self, event: Event, now: float) -> list[Send]:
        if isinstance(event, AutopilotVersion):
            self._encoding = event.encoding
        if not self._started or self.outcome is not None or not isinstance(event, ParamValue):
            return []
        if event.index >= event.count:
            return []  # 65535: an answer to somebody's write
        if self._count is not None and event.count != self._count and self._renewed < 5:
            # Indices have moved: what is held may sit at another index now.
            self._renewed += 1
            self._held = {}
            self._count = event.count
            self._next = now + self.QUIET_S
            return [ParamList()]
        self._count = event.count
        if event.index not in self._held:
            self._idle_rounds = 0
        self._held[event.index] = event
        self._next = now + self.QUIET_S
        if len(self._held) >= self._count:
            values = (self._held[index] for index in sorted(self._held))
            self.outcome = Done({value.name: _parameter(value, self._encoding) for value in values})
        return []

    def poll(self, now: float) -> list[Send]:
        if not self._started or self.outcome is not None or now < self._next:
            return []
        self._next = now + self.QUIET_S
        self._idle_rounds += 1
        if self._idle_rounds > self.ROUNDS:
            heard = f"{len(self._held)} of {self._count} came" if self._count else "none came"
            self.outcome = Failed(f"the list of parameters is incomplete: {heard}", answered=bool(self._held))
            return []
        if self._count is None:
            return [ParamList()]
        gaps = [index for index in range(self._count) if index not in self._held]
        return [ParamRead("", index) for index in gaps[: self.AT_ONCE]]


class SendCommand(_Conversation[CommandAck]):
    """Send a COMMAND_LONG until it is acknowledged; a refusal carries what the vehicle said about it."""

    RESULTS = {
        1: "not now",
        2: "denied",
        3: "not supported",
        4: "failed",
        6: "cancelled",
    }

    def __init__(self, command: int, parameters: tuple[float, ...], about: str, tries: int = TRIES) -> None:
        super().__init__(tries)
        self.command = command
        self.parameters = parameters
        self.about = about

    def _sends(self, attempt: int) -> list[Send]:
        return [Command(self.command, self.parameters, attempt)]

    def _hear(self, event: Event, now: float) -> list[Send]:
        if not isinstance(event, CommandAck) or event.command != self.command or self._refusal is not None:
            return []
        if event.result == 0:
            self.outcome = Done(event)
        elif event.result == 5:
            self._tries_left = max(self._tries_left, 1)
            self._next = now + 2.0
        else:
            why = self.RESULTS.get(event.result, f"result {event.result}")
            self._refused(f"the vehicle refuses {self.about} ({why})", now)
        return []

    def _about(self) -> str:
        return self.about


class SetMode(SendCommand):
    """Ask for a flight mode; done when acknowledged, or, with the acknowledgement lost, when heartbeats show it."""

    def __init__(self, mode: int, tries: int = TRIES) -> None:
        super().__init__(DO_SET_MODE, (1.0, float(mode)), f"mode {mode}", tries)
        self.mode = mode
        self._shown = -1

    def _hear(self, event: Event, now: float) -> list[Send]:
        if isinstance(event, Heartbeat):
            self._shown = event.mode
        return super()._hear(event, now)

    def _unanswered(self, now: float) -> None:
        if self._shown == self.mode:
            self.outcome = Done(CommandAck(0, 0, DO_SET_MODE, 0, 0, 0))
        else:
            super()._unanswered(now)


class SetMessageInterval(SendCommand):
    """Ask for a message every `interval_s`; 0 restores the vehicle's own rate."""

    def __init__(self, message_id: int, interval_s: float, tries: int = TRIES) -> None:
        super().__init__(
            SET_MESSAGE_INTERVAL, (float(message_id), interval_s * 1e6), f"message {message_id} at an interval", tries
        )


class RequestAutopilotVersion(_Conversation[AutopilotVersion]):
    """Ask what the vehicle is and can do."""

    def _sends(self, attempt: int) -> list[Send]:
        return [Command(REQUEST_MESSAGE, (float(AUTOPILOT_VERSION),), attempt)]

    def _hear(self, event: Event, now: float) -> list[Send]:
        if isinstance(event, AutopilotVersion):
            self.outcome = Done(event)
        elif isinstance(event, CommandAck) and event.command == REQUEST_MESSAGE and event.result not in (0, 5):
            self._refused("the vehicle does not tell its version", now)
        return []

    def _about(self) -> str:
        return "the vehicle's version was asked for"


def _parameter(event: ParamValue, encoding: Encoding) -> Parameter:
    return Parameter(event.name, parameter_value(event.bits, event.kind, encoding), event.bits, event.kind)


@dataclass(frozen=True, slots=True)
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


@dataclass
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
    restarted: tuple[float, float] | None = None
    """The vehicle's clock as it was last heard before it began anew, and what it may have shown by then."""

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
        return StreamResult(self.file, self.blocks, self.highest + 1, missing, self.duplicates, end)


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
    nothing is ever written over. It is recognised by our own START having been sent again, or by a block that
    differs from the one kept under its number. Formats at a log's beginning are the same in every log of a vehicle,
    so blocks that came twice since the last new one are remembered and go along into the new file.

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
    """A step of more blocks (20 MB) than any sender buffers is no block number."""
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
    STRAY_S = 1.0
    """Blocks of a stopped stream that were under way come so long after that text at most."""

    def __init__(
        self, store: Callable[[int, int, bytes], bool], log_end_s: Callable[[], float | None] = lambda: None
    ) -> None:
        self.outcome: Done[tuple[StreamResult, ...]] | Failed | None = None
        self._store = store
        self._log_end_s = log_end_s
        self._clock = _VehicleClock()
        self._kept_at: float | None = None
        self._stream = _Stream(0)
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
        self._next_start = now + self.START_EVERY_S
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
        if self._stopping and now - self._last_heard > 1.0:
            self._last_new = now  # found again, it may have more
        self._last_heard = now
        if isinstance(event, LogBlock):
            return self._on_block(event.number, event.data, now)
        if isinstance(event, Attitude | SystemTime):
            return self._on_clock(event.boot_s, now)
        if isinstance(event, StatusText) and event.text.startswith(self.STOPPED):
            self._stream.reported, self._stream.reported_at = event.text, now
        return []

    def _on_clock(self, boot_s: float, now: float) -> list[Send]:
        before = self._clock.hear(boot_s, now)
        if before is None or not self._stream.blocks:
            return []
        self._stream.restarted = self._stream.restarted or before
        return [] if self._stopping else self._ask_anew(now)

    def _ask_anew(self, now: float) -> list[Send]:
        self._renewed = True
        self._next_start = now + self.START_EVERY_S
        return [BlockStatus(START_BLOCKS, True)]

    def _on_block(self, number: int, data: bytes, now: float) -> list[Send]:
        # A first block far from 0 is of a stream that somebody else began: unacknowledged it ends, and ours begins.
        reach = self.JUMP if self._stream.blocks else self.LATE_START
        if number >= STOP_BLOCKS or number > self._stream.highest + reach:
            return []
        self._last_block = now
        check = zlib.crc32(data)
        kept = self._stream.check(number)
        if (kept is not None and kept != check) or (self._renewed and number <= self.LOW):
            self._begin_next_log(number, now)
        elif kept is not None:
            self._stream.duplicates += 1
            if number <= self.LOW * 16:
                self._doubles[number] = data
            return [BlockStatus(number, True)]
        else:
            self._doubles.clear()
            self._renewed = False  # the log goes on where it was
        return self._keep(number, data, check, now)

    def _begin_next_log(self, number: int, now: float) -> None:
        self._finished.append(self._stream.result(self._end_of_followed(now)))
        self._stream = _Stream(self._stream.file + 1)
        self._renewed = False
        doubles, self._doubles = self._doubles, {}
        for earlier, data in sorted(doubles.items()):
            if earlier < number + self.LOW and earlier != number:
                self._keep(earlier, data, zlib.crc32(data), now)

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
                self._next_start = now + self.START_EVERY_S
                sends.append(BlockStatus(START_BLOCKS, True))
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


__all__ = [
    "Done",
    "Failed",
    "LogBlocks",
    "LogEnd",
    "NoAnswerError",
    "Outcome",
    "Parameter",
    "Procedure",
    "ProcedureError",
    "ReadAllParameters",
    "ReadParameter",
    "RefusedError",
    "RequestAutopilotVersion",
    "SendCommand",
    "SetMessageInterval",
    "SetMode",
    "StreamResult",
    "WriteParameter",
    "bits_of_float",
]
