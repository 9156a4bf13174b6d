"""The session: one vehicle on one link, heard and spoken to without a screen.

Two threads. The engine's reads the link, reduces what it hears to a snapshot, runs procedures and writes what is
recorded. The heartbeat's does nothing else, so that neither a slow disk nor a busy fit lets the vehicle believe the
ground has gone. Faces read immutable snapshots and call procedures; they hold no lock while they do.

The vehicle is the first autopilot whose heartbeat comes; others are counted and not listened to. After a lost link is
found again nothing restarts by itself, except that a log being recorded goes on.
"""

from __future__ import annotations

import contextlib
import math
import threading
import time
from collections import deque
from collections.abc import Callable, Iterable
from dataclasses import replace
from pathlib import Path
from types import TracebackType
from typing import Any, Self, TypeVar

from gcs.errors import LinkError, TippathError
from gcs.flight.calls import Call
from gcs.flight.card_recording import CardRecording
from gcs.flight.connection import LogWay, silence
from gcs.flight.live import LiveLog, LiveWindow
from gcs.flight.log_health import LogHealth
from gcs.flight.neighbours import Neighbours
from gcs.flight.pace import BEAT_S, Pace, RealTime
from gcs.flight.recorder import Recorder, RecordingSummary
from gcs.flight.recording import Recording
from gcs.flight.telemetry import TelemetryRequests
from gcs.flight.voice import Voice
from gcs.link.clock import LOST_AFTER_S, LinkClock
from gcs.link.decode import TextAssembly, decode
from gcs.link.encode import STATION_COMPONENT, Send, StationHeartbeat
from gcs.link.events import (
    AutopilotVersion,
    CommandAck,
    Event,
    FtpReply,
    Heartbeat,
    LogBlock,
    LogReceipt,
    StatusText,
    StatusTextPart,
)
from gcs.link.frames import Frame
from gcs.link.key_file import signing_with
from gcs.link.log_answer import AnsweredRate, LogAnswer, LogClient
from gcs.link.procedures import (
    Failed,
    NoAnswerError,
    Procedure,
    ProcedureError,
    RequestAutopilotVersion,
)
from gcs.link.signing import Signing
from gcs.link.transport import Transport, carries, open_transport
from gcs.vehicle.autopilots import PRIMARY_SYSTEM
from gcs.vehicle.snapshot import Text, VehicleSnapshot, reduce

T = TypeVar("T")
STATION_SYSTEM = 254
RECEIVE_S = 0.01
"""How long the engine waits for bytes before it looks at what is due."""
KEPT_TEXTS = 1000
STOP_WITHIN_S = 15.0
"""The longest that the end of a recording may take: the sender drops a stream after 10 s."""


class Session:
    """A vehicle, connected. A context manager: leaving it ends recording and threads, and closes the link.

    Made by `open`, or in tests from a transport and a pace of their own. `wall_clock` gives seconds since 1970.
    """

    def __init__(
        self,
        transport: Transport,
        *,
        primary: bool = False,
        signing: Signing | None = None,
        system: int | None = None,
        dry: bool = False,
        pace: Pace | None = None,
        wall_clock: Callable[[], float] = time.time,
    ) -> None:
        self.link = transport.name
        self.station = PRIMARY_SYSTEM if primary else STATION_SYSTEM
        self._transport = transport
        self._pace = pace or RealTime()
        self._clock = self._pace.now
        self._wall_clock = wall_clock
        self._signing = signing
        self._wanted = system
        self._voice = Voice(self.station, transport, signing, dry=dry)
        self._lock = threading.RLock()
        """Guards all below but the snapshot, which is replaced whole."""
        self._snapshot: VehicleSnapshot | None = None
        self._last_heard = -math.inf
        self._found = threading.Event()
        self._ending = threading.Event()
        self._crash: BaseException | None = None
        self._calls: list[Call] = []
        self._version: AutopilotVersion | None = None
        self._link_clock = LinkClock()
        self._assembly = TextAssembly()
        self._texts: deque[Text] = deque(maxlen=KEPT_TEXTS)
        self._neighbours = Neighbours(transport, signing)
        self._recording: Recording | CardRecording | None = None
        self._answer: LogAnswer | None = None
        """Of the vehicle's log, while it is not recorded."""
        self._live = LiveLog()
        self._window = self._live.window  # of what is being recorded, or was last
        self._telemetry = TelemetryRequests()
        self._pace.begin(self._turn, self._beat)

    @classmethod
    def open(
        cls,
        link: str,
        *,
        primary: bool = False,
        key: Path | None = None,
        system: int | None = None,
        dry: bool = False,
        connect_timeout_s: float = 5.0,
    ) -> Session:
        """Open a LINK and wait for a vehicle.

        With the file of a `key` all is signed, and nothing else believed; `system` alone is heard; with
        `dry` nothing leaves but questions. Raises LinkError where the link makes no sense or cannot be opened, or no
        vehicle is heard, UsageError where the key is none.
        """
        signing = None if key is None else signing_with(key)
        transport = open_transport(link, signing, system)
        session = cls(transport, primary=primary, signing=signing, system=system, dry=dry)
        try:
            session.wait_for_vehicle(connect_timeout_s)
        except BaseException:
            session.close()
            raise
        return session

    def wait_for_vehicle(self, timeout_s: float) -> None:
        """Wait for the first heartbeat of an autopilot and ask what it is. Raises LinkError where none comes."""
        if not self._pace.wait(self._found, timeout_s):
            raise LinkError(silence(self._transport, timeout_s, self._signing, self._wanted))
        # A vehicle that does not tell its version can still be flown.
        with contextlib.suppress(ProcedureError):
            self.call(RequestAutopilotVersion(3))

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    # What a face may ask, from any thread.

    def snapshot(self) -> VehicleSnapshot:
        """What is known now. Raises LinkError before the first heartbeat."""
        snapshot = self._snapshot
        if snapshot is None:
            raise LinkError(f"no vehicle at {self.link} yet")
        now, clock = self._clock(), self._link_clock
        age = max(0.0, now - self._last_heard)
        problem = self._transport.problem if self._crash is None else f"the engine stopped: {self._crash}"
        return replace(
            snapshot,
            link_age_s=age,
            lost=age > LOST_AFTER_S,
            lag_s=clock.lag_s,
            answer_age_s=now - clock.answered_s,
            link_problem=problem,
        )

    def call(
        self,
        procedure: Procedure[T],
        timeout_s: float | None = None,
        *,
        cancelled: Callable[[], bool] | None = None,
    ) -> T:
        """Run a procedure to its end and give its value.

        Raises ProcedureError: refused, unanswered, not done in `timeout_s` (the procedure's own patience where it is
        None), or `cancelled()` became true.
        """
        call = Call(procedure)
        with self._lock:
            if self._version is not None:
                procedure.on_event(self._version, self._clock())
            try:
                self._say(procedure.start(self._clock()))
            except ValueError as error:  # MAVLink cannot carry it
                raise ProcedureError(str(error)) from error
            if procedure.outcome is None:
                self._calls.append(call)
            else:
                call.ended.set()
        pace = self._pace
        give_up = math.inf if timeout_s is None else pace.now() + timeout_s
        try:
            while not pace.wait(call.ended, min(0.05, max(0.0, give_up - pace.now()))):
                if cancelled is not None and cancelled():
                    raise ProcedureError("cancelled")
                if pace.now() >= give_up:
                    raise NoAnswerError(f"not done in {timeout_s:g} s")
                if self._ending.is_set() or self._crash is not None:
                    raise ProcedureError(f"the link is closed ({self._crash or self.link})")
        finally:
            with self._lock:
                if call in self._calls:
                    self._calls.remove(call)
        if call.crash is not None:
            raise call.crash
        outcome = procedure.outcome
        assert outcome is not None
        if isinstance(outcome, Failed):
            raise outcome.error()
        return outcome.value

    def take_over(self) -> None:
        """Speak with the address that speaks as the vehicle does, whose own is silent. Raises TippathError where there
        is none, or something is being recorded: during a run the vehicle stays the one that was started."""
        with self._lock:
            self._refuse_second()
            if not self._transport.take_over():
                raise TippathError("no other address speaks as this vehicle does")

    def send(self, *sends: Send) -> None:
        """Say something that needs no answer, at once."""
        self._say(sends)

    def texts_since(self, cursor: int) -> tuple[int, list[Text]]:
        """The vehicle's texts numbered above `cursor` (0: all that are kept), and the cursor for the next time."""
        with self._lock:
            texts = [text for text in self._texts if text.number > cursor]
        return (texts[-1].number if texts else cursor), texts

    def samples(self, last_s: float) -> LiveWindow:
        """The last seconds of the log being recorded, or of telemetry instead; empty arrays while there is none."""
        return self._window(last_s)

    def log_health(self) -> LogHealth | None:
        """How the log being recorded arrives, at this moment; None while nothing is recorded. Cheap: ask every tick."""
        with self._lock:
            return None if self._recording is None else self._recording.health()

    @property
    def receive_buffer(self) -> int | None:
        """What the system gave for receiving, bytes."""
        return self._transport.receive_buffer

    def start_recording(self, directory: Path, log: LogWay = "stream") -> None:
        """Ask for the vehicle's log, or with `card` for telemetry that serves instead, and write it into `directory`.

        Returns at once. Raises TippathError where the folder cannot be written, or something is being recorded already.
        """
        with self._lock:
            self._refuse_second()
            self._record(Recorder(directory, self._wall_clock), log)

    def answer_log(self, wanted: bool = True, *, at_once: bool = False) -> None:
        """Answer a log that is streamed and not recorded: once disarmed, or `at_once`. See `LogClient`."""
        with self._lock:
            if wanted and self._answer is None:
                self._answer = LogAnswer((self.station, STATION_COMPONENT), at_once=at_once)
            elif not wanted:
                self._answer = None
                self._update(log_client=LogClient.NOBODY)

    def answered_rate(self) -> AnsweredRate | None:
        """What the link carried of the log that is answered; None where too little came, or it is recorded."""
        with self._lock:
            return None if self._answer is None else self._answer.rate(self._clock())

    def _record(self, recorder: Recorder, log: LogWay = "stream") -> None:
        with self._lock:
            self._refuse_second()
            self._voice.forget()
            if log == "card":
                told = (self._clock, self._link_clock, self._telemetry, carries(self.link))
                self._recording = CardRecording(recorder, *told)
                self._say(self._recording.ask(self._clock()))
            else:
                station, clock = (self.station, STATION_COMPONENT), self._link_clock
                self._recording = Recording(recorder, self._live, self._clock, station, lambda: clock.lag_s)
            self._window = self._recording.window
            if self._answer is not None:
                self._say(self._answer.hand_over(self._clock()))
            self._begin_blocks(self._recording)

    def _begin_blocks(self, recording: Recording | CardRecording, *, now_at_last: bool = False) -> None:
        """Ask for the log, once nothing of a stream that was answered before can come any more."""
        answer, now = self._answer, self._clock()
        free = answer is None or now_at_last or answer.handed_over(now, self._link_clock.lag_s)
        if free and not recording.blocks.started:
            self._say(recording.blocks.start(now))

    def _refuse_second(self) -> None:
        if self._recording is not None:
            raise TippathError(f"already recording into {self._recording.recorder.directory}")

    def shed_log(self) -> None:
        """Ask the vehicle to send no more of its log: the link is too late to carry it. The recording ends as usual."""
        with self._lock:
            if self._recording is not None:
                self._say(self._recording.blocks.stop(self._clock()))
                self._say(self._telemetry.want({}, self._clock()))

    def stop_recording(
        self, within_s: float = STOP_WITHIN_S, *, meanwhile: Callable[[], None] = lambda: None
    ) -> RecordingSummary:
        """End the log and say what is on disk; waits until the vehicle has sent the rest, or has nothing more.

        `meanwhile` is called some times a second while it waits. Raises TippathError where nothing is being recorded.
        """
        with self._lock:
            recording = self._recording
            if recording is None:
                raise TippathError("nothing is being recorded")
            self._begin_blocks(recording, now_at_last=True)
            self._say(recording.blocks.stop(self._clock()))
        end = self._pace.now() + within_s
        while not self._pace.wait(recording.over, 0.05) and self._pace.now() < end:
            if self._ending.is_set() or self._crash is not None:
                break
            meanwhile()
        with self._lock:
            self._say(self._telemetry.want({}, self._clock()))
            self._log_sent()
            self._recording = None
            self._update(recording=None, log_on_card=False)
            if self._answer is not None:
                self._answer.restart()
            return recording.finish()

    def close(self) -> None:
        """End the stream of blocks, both threads and the link; what is recorded stays. Twice is no harm."""
        if self._ending.is_set():
            return
        with contextlib.suppress(TippathError):
            lost = self._snapshot is None or self.snapshot().lost
            self.stop_recording(0.5 if lost else 3.0)
        with self._lock:
            if self._answer is not None:
                self._say(self._answer.hand_over(self._clock()))
                self._answer = None
        if self._snapshot is not None:
            self._say(self._telemetry.given_back())
        self._ending.set()
        self._pace.end()
        self._transport.close()

    # The two threads' work.

    def _beat(self) -> None:
        self._say([StationHeartbeat()])

    def _turn(self) -> None:
        if self._crash is not None:
            self._pace.wait(self._ending, BEAT_S)
            return
        try:
            frames = self._transport.receive(RECEIVE_S)
            with self._lock:
                now = self._clock()
                for frame in frames:
                    self._hear(frame, now)
                self._poll(now)
        except Exception as error:
            self._crash = error  # shown by the snapshot, told to every call

    def _hear(self, frame: Frame, now: float) -> None:
        if self._recording is not None and frame.message.get_msgId() != 184:
            self._recording.recorder.frame(frame.raw)
        event = decode(frame.message)
        snapshot = self._snapshot
        self._neighbours.hear(event, None if snapshot is None else snapshot.system, now)
        if snapshot is None and isinstance(event, Heartbeat) and event.from_autopilot:
            snapshot = self._pin(event, frame, now) if self._wanted in (None, event.system) else None
        if isinstance(event, LogReceipt):  # another station's
            self._answered(event, now)
            return
        if snapshot is None or frame.message.get_srcSystem() != snapshot.system:
            return
        self._last_heard = now
        if frame.message.get_srcComponent() == snapshot.component:
            self._telemetry.heard(frame.message.get_msgId(), now)
        if isinstance(event, StatusTextPart):
            for text in self._assembly.add(event, now):
                self._on_event(text, now)
        elif event is not None:
            self._on_event(event, now)

    def _pin(self, event: Heartbeat, frame: Frame, now: float) -> VehicleSnapshot:
        self._voice.address(event.system, event.component)
        signed = self._signing is not None
        self._snapshot = VehicleSnapshot(
            system=event.system, component=event.component, signed=signed, signs=not signed and frame.signed
        )
        self._telemetry.begin(now)
        return self._snapshot

    def _on_event(self, event: Event, now: float) -> None:
        assert self._snapshot is not None
        if isinstance(event, CommandAck | FtpReply) and not self._is_ours(event):
            return
        own = event.component == self._snapshot.component
        clock = self._link_clock
        if own:
            clock.on_event(event, now)
        self._snapshot = reduce(self._snapshot, event, now, known_s=clock.known_s, late_s=clock.stamp_age_s(now))
        if isinstance(event, StatusText):
            self._texts.append(self._snapshot.texts[-1])
        if isinstance(event, Heartbeat) and self._snapshot.heartbeats:
            self._found.set()
        if isinstance(event, AutopilotVersion) and own:
            self._version = event
        if self._recording is not None and (own or isinstance(event, LogBlock)):
            self._say(self._recording.blocks.on_event(event, now))
        if isinstance(event, LogBlock) and (self._recording is None or not self._recording.blocks.started):
            self._answered(event, now)
        if own:
            for call in list(self._calls):
                self._step(call, lambda procedure: procedure.on_event(event, now))

    def _is_ours(self, event: CommandAck | FtpReply) -> bool:
        to = (event.target_system, event.target_component)
        return to[0] in (0, self.station) and to[1] in (0, STATION_COMPONENT)

    def _answered(self, event: Event, now: float) -> None:
        for client in (self._answer, None if self._recording is None else self._recording.blocks):
            if client is not None:
                self._say(client.on_event(event, now))

    def _poll_answer(self, now: float) -> None:
        """Of the log: answered while it is not recorded, and handed over to a recording that begins."""
        answer, recording = self._answer, self._recording
        if answer is None or self._snapshot is None:
            return
        if recording is None or not recording.blocks.started:
            self._say(answer.poll(now, self._snapshot.armed, self._link_clock))
        if recording is not None:
            self._begin_blocks(recording)
        self._update(log_client=LogClient.NOBODY if recording is not None else answer.client)

    def _step(self, call: Call, step: Callable[[Procedure[Any]], Iterable[Send]]) -> None:
        if call.ended.is_set():
            return
        try:
            self._say(step(call.procedure))
            over = call.procedure.outcome is not None
        except Exception as error:
            call.crash, over = error, True  # its caller's matter, not the link's
        if over:
            call.ended.set()

    def _poll(self, now: float) -> None:
        if self._snapshot is None:
            return
        for text in self._assembly.overdue(now):
            self._on_event(text, now)
        for call in list(self._calls):
            self._step(call, lambda procedure: procedure.poll(now))
        self._poll_answer(now)
        if self._recording is not None:
            self._say(self._recording.poll(now))
            self._log_sent()
        self._say(self._link_clock.poll(now))
        self._say(self._telemetry.poll(now, self._last_heard))
        self._refresh(now)

    def _refresh(self, now: float) -> None:
        self._neighbours.tend(recording=self._recording is not None)
        self._update(**self._neighbours.seen(now))
        if self._recording is not None:
            self._update(**self._recording.seen())

    def _update(self, **changes: Any) -> None:
        if self._snapshot is not None and any(getattr(self._snapshot, k) != v for k, v in changes.items()):
            self._snapshot = replace(self._snapshot, **changes)

    def _say(self, sends: Iterable[Send]) -> None:
        self._voice.say(sends)

    def _log_sent(self) -> None:
        """What was said by either thread goes into the telemetry log from the engine's only."""
        if self._recording is not None:
            for raw in self._voice.said():
                self._recording.recorder.frame(raw)
