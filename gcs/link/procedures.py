"""Conversations with the vehicle as pure values: (event, now) in, what to send out.

None of them knows a socket, a clock or a thread, so that minutes of loss and retries are tested in milliseconds. The
session feeds a procedure only what its own vehicle said, and what the vehicle's version is before `start`.

A decision that other stations make differently: a write is done when the echoed 32 bits equal the sent ones, and
refused only after the vehicle, asked again, still holds another value. A stray echo of an earlier read is no refusal.
The longest conversation, the vehicle's log, stands in `gcs.link.log_blocks`.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Generic, Protocol, TypeVar

from gcs.errors import TippathError
from gcs.link.encode import (
    AUTOPILOT_VERSION,
    DO_SET_MODE,
    REQUEST_MESSAGE,
    SET_MESSAGE_INTERVAL,
    Command,
    ParamList,
    ParamRead,
    ParamWrite,
    Send,
)
from gcs.link.events import (
    AutopilotVersion,
    CommandAck,
    Encoding,
    Event,
    Heartbeat,
    ParamError,
    ParameterType,
    ParamValue,
    StatusText,
    parameter_bits,
    parameter_value,
)

T = TypeVar("T")
T_co = TypeVar("T_co", covariant=True)

FIRST_RETRY_S = 0.2
"""What a lost packet costs on a fast link; each repetition waits twice as long, up to `RETRY_S`."""
RETRY_S = 0.5
"""Twice a slow radio's round trip."""
TRIES = 6
PARAMETER_TRIES = 20
"""Ten seconds. Half of all questions, or their answers, are lost where 30 % are lost each way, and a flight asks some
sixty: six tries were too few in four flights of ten, and these are in one of ten thousand."""
TEXT_WAIT_S = 0.3
"""How long after a refusal its reason, a text of its own, may still be under way; then what is heard next ends it."""
SILENT_S = 1.0
"""How long a vehicle that says nothing more after a refusal is listened to."""


class ProcedureError(TippathError):
    """The vehicle refused, or did not answer; the message says which and, where it told, why."""

    reason = "vehicle"


class RefusedError(ProcedureError):
    """The vehicle answered: no."""

    reason = "refused"


class NoAnswerError(ProcedureError):
    """The vehicle did not answer."""

    reason = "no answer"


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
        self._refused_at = 0.0
        self._started = False

    def start(self, now: float) -> list[Send]:
        self._started = True
        return self._say(now)

    def on_event(self, event: Event, now: float) -> list[Send]:
        if isinstance(event, AutopilotVersion):
            self._encoding = event.encoding
        if not self._started or self.outcome is not None:
            return []
        if self._refusal is not None and now >= self._refused_at + TEXT_WAIT_S:
            self._next = now
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
        # By what is heard, not by the clock alone: on a busy machine the text may lie there unread for longer.
        self._refusal, self._refused_at = reason, now
        self._next = now + SILENT_S

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

    def __init__(self, name: str, tries: int = PARAMETER_TRIES) -> None:
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


class ReadSeveral:
    """Ask for several parameters by name at once; the value has those that were answered, None where it was no."""

    def __init__(self, names: Sequence[str], tries: int = PARAMETER_TRIES) -> None:
        self.outcome: Done[Mapping[str, Parameter | None]] | None = None
        self._reads = {name: ReadParameter(name, tries) for name in names}

    def start(self, now: float) -> list[Send]:
        return [send for read in self._reads.values() for send in read.start(now)]

    def on_event(self, event: Event, now: float) -> list[Send]:
        return self._after(send for read in self._reads.values() for send in read.on_event(event, now))

    def poll(self, now: float) -> list[Send]:
        return self._after(send for read in self._reads.values() for send in read.poll(now))

    def _after(self, sends: Iterable[Send]) -> list[Send]:
        said = list(sends)
        outcomes = {name: read.outcome for name, read in self._reads.items()}
        if self.outcome is None and all(outcome is not None for outcome in outcomes.values()):
            answered: dict[str, Parameter | None] = {}
            for name, outcome in outcomes.items():
                if isinstance(outcome, Done):
                    answered[name] = outcome.value
                elif isinstance(outcome, Failed) and outcome.answered:
                    answered[name] = None
            self.outcome = Done(answered)
        return said


class WriteParameter(_Conversation[Parameter]):
    """Set one parameter; done when the echoed 32 bits equal the sent ones.

    `value` becomes the float32 nearest to it. On a vehicle that packs integers bytewise the parameter is read first,
    to learn its type. `repeat=False` is for parameters that do something when written, where a lost echo must not
    make it happen twice: it is sent once, and whoever asked finds out by other means whether it arrived.
    """

    def __init__(self, name: str, value: float, *, repeat: bool = True) -> None:
        super().__init__(PARAMETER_TRIES if repeat else 1, RETRY_S if repeat else RETRY_S * 3)
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


class AwaitParameter(_Conversation[Parameter]):
    """Ask for a parameter again and again until it has a value: then what was set going on board is over."""

    def __init__(self, name: str, value: float, tries: int = PARAMETER_TRIES) -> None:
        super().__init__(tries)
        self.name, self.value = name, value
        self._held: float | None = None

    def _sends(self, attempt: int) -> list[Send]:
        return [ParamRead(self.name)]

    def _hear(self, event: Event, now: float) -> list[Send]:
        if isinstance(event, ParamValue) and event.name == self.name:
            self._held = event.value(self._encoding)
            if self._held == self.value:
                self.outcome = Done(_parameter(event, self._encoding))
        return []

    def _about(self) -> str:
        held = "" if self._held is None else f", and is {self._held:.9g}"
        return f"parameter {self.name} was waited for to become {self.value:.9g}{held}"


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
        if not isinstance(event, CommandAck) or event.command != self.command:
            return []
        if event.result == 0:
            self.outcome = Done(event)  # also behind a refusal, which was an earlier order's then
        elif self._refusal is not None:
            return []
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
            self.outcome = Done(CommandAck(0, 0, command=DO_SET_MODE, result=0, target_system=0, target_component=0))
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
