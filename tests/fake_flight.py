"""A vehicle and a session in fake time: a card of minutes in a fraction of a second, every fault at a chosen moment.

The vehicle behaves as ArduPilot does where the engine cares: a heartbeat a second, mode changes acknowledged,
"Starting" and "Finished" as texts, one second of nothing before and after a maneuver, the mode staying after the
end. The session runs the real procedures against it.
"""

from __future__ import annotations

import math
import random
from bisect import bisect_left
from collections.abc import Callable, Sequence
from operator import itemgetter
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from gcs.flight.connection import LogWay
from gcs.flight.live import LiveWindow, SweepSettings
from gcs.flight.log_health import Capacity, LogHealth
from gcs.flight.recorder import ON_CARD, RecordedLog, RecordingSummary
from gcs.link.encode import DO_SET_MODE, Command, ParamRead, ParamWrite, Send
from gcs.link.events import CommandAck, Event, Heartbeat, ParamValue, StatusText, bits_of_float, float_of_bits
from gcs.link.log_answer import AnsweredRate, LogClient
from gcs.link.log_end import Cause, EndState, LogEnd
from gcs.link.procedures import NoAnswerError, Procedure, ProcedureError
from gcs.vehicle.autopilots import mode_name
from gcs.vehicle.snapshot import Beat, Said, Text, VehicleSnapshot

T = TypeVar("T")

DT = 0.01
RATE_HZ = 100.0
COLUMNS = ("t", "p", "q", "delta_x", "delta_y", "excitation_x", "excitation_y")
STABILIZE, ALT_HOLD, RTL, SYSTEMID = 0, 2, 6, 25

PARAMETERS = {
    "SID_AXIS": 0.0,
    "SID_MAGNITUDE": 0.05,
    "SID_F_START_HZ": 0.5,
    "SID_F_STOP_HZ": 10.0,
    "SID_T_FADE_IN": 5.0,
    "SID_T_REC": 60.0,
    "SID_T_FADE_OUT": 2.0,
    "SIDX_KIND": 0.0,
    "SIDX_LAW": 0.0,
    "SIDX_C1": 4.0,
    "SIDX_NOISE": 0.2,
    "SIDX_PULSE_S": 0.3,
    "SIDX_SEED": 7.0,
    "FS_GCS_ENABLE": 1.0,
    "FS_OPTIONS": 0.0,
    "FS_GCS_TIMEOUT": 5.0,
    "SYSID_MYGCS": 255.0,
    "SCHED_LOOP_RATE": RATE_HZ,
    "ANGLE_MAX": 3000.0,
    "LOG_BACKEND_TYPE": 3.0,
}
PARAMETERS = {name: float(np.float32(value)) for name, value in PARAMETERS.items()}


class FakeVehicle:
    """Advances by 10 ms; every knob is an attribute, and `at` schedules what happens when."""

    def __init__(self) -> None:
        self.now = 0.0
        self.mode = STABILIZE
        self.armed = True
        self.status = 4
        self.parameters = dict(PARAMETERS)
        self.stubborn: set[str] = set()
        """Parameters whose writes are refused."""
        self.refuses: str | None = None
        """What it says when it refuses the excitation mode."""
        self.never_leaves = False
        self.gain = 3.0
        """rad/s per command; 0 is a vehicle that does not answer."""
        self.lean = 0.0
        self.noise = 0.002
        self.silent_text = False
        """Texts get lost."""
        self.logs = True
        self.instant_heartbeat = True
        """As ArduPilot: a mode change shows at once."""
        self.asked: list[tuple[float, int]] = []
        """Every mode command that arrived: when, which."""
        self.written: list[tuple[float, str, float, int]] = []
        """Every parameter write: when, what, value, and the mode it came in."""
        self.said: list[str] = []
        self.heartbeats: list[tuple[float, int, bool, int]] = []
        self.samples: list[tuple[float, float, float, float, float, float, float]] = []
        self.entered: float | None = None
        self.sweep_over = False
        self._schedule: list[tuple[float, Callable[[], None]]] = []
        self._next_heartbeat = 0.0
        self._random = random.Random(4)
        self._phase = 0.0
        self._p = 0.0
        self._q = 0.0
        self._beat()

    def at(self, seconds: float, action: Callable[[], None]) -> None:
        self._schedule.append((seconds, action))

    def in_sweep(self, seconds: float, action: Callable[[], None]) -> None:
        """Once, so many seconds after the excitation mode was first entered."""
        self._schedule.append((-seconds, action))

    def pilot(self, mode: int) -> None:
        self._enter(mode)

    def say(self, text: str) -> None:
        self.said.append(text)

    def set_mode(self, mode: int) -> bool:
        self.asked.append((self.now, mode))
        if mode == SYSTEMID and self.mode != SYSTEMID and (self.refuses is not None or not self.parameters["SID_AXIS"]):
            self.say(self.refuses or "No axis selected, SID_AXIS = 0")
            return False
        if mode != SYSTEMID and self.never_leaves:
            return True
        if mode != self.mode:
            self._enter(mode)
        return True

    def _enter(self, mode: int) -> None:
        self.mode = mode
        self.entered, self.sweep_over, self._phase = None, False, 0.0
        if mode == SYSTEMID:
            self.entered = self.now
            self.say(f"SystemID Starting: axis={self.parameters['SID_AXIS']:.0f}")
            self._schedule = [(self.now - when if when < 0 else when, action) for when, action in self._schedule]
        if self.instant_heartbeat:
            self._beat()

    def _beat(self) -> None:
        self.heartbeats.append((self.now, self.mode, self.armed, self.status))
        self._next_heartbeat = self.now + 1.0

    def write(self, name: str, value: float) -> None:
        self.written.append((self.now, name, value, self.mode))
        if name not in self.stubborn:
            self.parameters[name] = value

    def step(self) -> None:
        self.now += DT
        for entry in [e for e in self._schedule if 0 <= e[0] <= self.now]:
            self._schedule.remove(entry)
            entry[1]()
        if self.now >= self._next_heartbeat:
            self._beat()
        excitation = 0.0
        if self.entered is not None and not self.sweep_over:
            excitation = self._excitation(self.now - self.entered - 1.0)
        on_pitch = self.parameters.get("SID_AXIS") in (8, 11)
        x, y = (0.0, excitation) if on_pitch else (excitation, 0.0)
        self._p += 0.2 * (self.gain * x - self._p)
        self._q += 0.2 * (self.gain * y - self._q)
        if self.logs:
            gauss = self._random.gauss
            self.samples.append((self.now, self._p + gauss(0, self.noise), self._q + gauss(0, self.noise), x, y, x, y))

    def _excitation(self, t: float) -> float:
        p = self.parameters
        if t > p["SID_T_REC"] + 1.0:
            self.sweep_over = True
            self.say("SystemID Finished")
            return 0.0
        if not 0 <= t <= p["SID_T_REC"]:
            return 0.0
        if p["SIDX_KIND"] == 2:
            return 0.0
        if p["SIDX_KIND"] == 1:
            pulse = int(t / p["SIDX_PULSE_S"]) % 6
            return p["SID_MAGNITUDE"] * ((1.0, -1.0)[pulse] if pulse < 2 else 0.0)
        hertz = p["SID_F_START_HZ"] + (p["SID_F_STOP_HZ"] - p["SID_F_START_HZ"]) * t / p["SID_T_REC"]
        self._phase += 2 * math.pi * hertz * DT
        return p["SID_MAGNITUDE"] * math.sin(self._phase)


class FakeSession:
    """The session's face before a `FakeVehicle`, and the clock that lets both of them live."""

    LATENCY_S = 0.02

    def __init__(self, vehicle: FakeVehicle, station: int = 254) -> None:
        self.vehicle = vehicle
        self.station = station
        self.unheard: list[tuple[float, str, float]] = []
        """Writes whose echo nobody waits for: when, what, its value. They arrive also while the session is deaf."""
        self.deaf_from = math.inf
        """Nothing is heard of the vehicle between these; what is sent arrives."""
        self.deaf_until = math.inf
        self.drop_commands = 0
        """So many commands are lost on their way."""
        self.drop_acks = 0
        """So many acknowledgements are lost on their way back."""
        self.drop_answers: dict[str, int] = {}
        """So many answers about a parameter are lost on their way back."""
        self.calls = 0
        self.recordings: list[Path] = []
        self.ended_recordings = 0
        self.ticks: list[Callable[[], None]] = []
        """Called at every sleep."""
        self.lag_s: float | None = 0.02
        """How late the link claims to be."""
        self.one_way = False
        """The vehicle is heard, and hears nothing."""
        self.known_lag_s = 1.2
        """A heartbeat knows of what was sent so long before it."""
        self.recorded_magnitude: float | None = None
        """Of the vehicle's own record of the maneuver; None where it keeps none."""
        self.shed = 0
        """Times the log was shed."""
        self.log: LogWay = "stream"
        """Of the recording that goes on, or of the last one."""
        self.log_fails = ""
        """What the vehicle says about a log on its card that it does not write."""
        self.log_client = LogClient.NOBODY
        self.answered: list[bool] = []
        """The log was to be answered; whether at once."""
        self.rate: AnsweredRate | None = None
        self.said: list[Said] = []
        """Values of parameters that the vehicle told."""
        self._texts: list[Text] = []

    # the clock

    def now(self) -> float:
        return self.vehicle.now

    def sleep(self, seconds: float) -> None:
        for _ in range(max(1, round(seconds / DT))):
            self.vehicle.step()
        for tick in list(self.ticks):
            tick()

    # the session

    @property
    def _deaf(self) -> bool:
        return self.deaf_from <= self.vehicle.now < self.deaf_until

    def _unheard(self, timed: Sequence[tuple[float, ...]]) -> tuple[int, int]:
        """Which of what the vehicle said, in order of time, was lost: from and until."""
        silent, back = (bisect_left(timed, when, key=itemgetter(0)) for when in (self.deaf_from, self.deaf_until))
        return silent, max(silent, back)

    def snapshot(self) -> VehicleSnapshot:
        vehicle = self.vehicle
        silent, back = self._unheard(vehicle.heartbeats)
        heard = [*vehicle.heartbeats[:silent], *vehicle.heartbeats[back:]]
        _, mode, armed, status = heard[-1]
        beats = tuple(
            Beat(
                number=number,
                at_s=at,
                mode=shown,
                mode_name=mode_name(shown, 4, 3),
                armed=is_armed,
                status=state,
                known_s=self._known(at),
                late_s=self.lag_s,
            )
            for number, (at, shown, is_armed, state) in list(enumerate(heard, start=1))[-20:]
        )
        newest = vehicle.now if not self._deaf else self.deaf_from
        age = max(0.0, vehicle.now - newest)
        blocks = len(vehicle.samples) // 5 if self.recordings else 0
        return VehicleSnapshot(
            system=1,
            component=1,
            link_age_s=age,
            lost=age > 3.5,
            mode=mode,
            mode_name=mode_name(mode, 4, 3),
            armed=armed,
            vehicle_type=4,
            autopilot=3,
            status=status,
            heartbeats=len(heard),
            beats=beats,
            lag_s=self.lag_s,
            answer_age_s=math.inf if self.one_way else vehicle.now - min(newest, vehicle.now - 0.1),
            roll=vehicle.lean,
            pitch=0.0,
            p=0.0,
            q=0.0,
            battery_v=24.0,
            battery_remaining=0.9,
            recording=self.log_path if self.recordings else None,
            blocks_received=blocks,
            log_client=self.log_client,
            said=tuple(self.said[-64:]),
        )

    def written_by_another(self, name: str, value: float, *, told: bool = True) -> None:
        """Another station's write, and the vehicle's word to all about it, unless that is lost."""
        self.vehicle.parameters[name] = value
        if told:
            self._tell(name)

    def _tell(self, name: str) -> None:
        if not self._deaf:
            self.said.append(Said(len(self.said) + 1, name, self.vehicle.parameters[name]))

    def send(self, *sends: Send) -> None:
        for send in sends if not self.one_way else ():
            if isinstance(send, ParamRead) and self.drop_answers.get(send.name, 0) > 0:
                self.drop_answers[send.name] -= 1
            elif isinstance(send, ParamRead):
                self._tell(send.name)
            elif isinstance(send, ParamWrite):
                self.unheard.append((self.vehicle.now, send.name, float_of_bits(send.bits)))
                self.vehicle.parameters[send.name] = float_of_bits(send.bits)

    def _known(self, at: float) -> float:
        """A ping every 0.2 s, answered at once unless the link is deaf; see `gcs.link.clock`."""
        known = at - self.known_lag_s
        return (
            min(known, self.deaf_from - self.known_lag_s) if known < self.deaf_until and at >= self.deaf_from else known
        )

    def log_health(self) -> LogHealth | None:
        rows = self.vehicle.samples if self.recordings else []
        silent, back = self._unheard(rows)
        heard = len(rows) - (back - silent)
        if not heard:
            return None
        first, last = rows[0 if silent else back][0], rows[-1 if back < len(rows) else silent - 1][0]
        now, rate = self.vehicle.now, 4000.0
        if self.log == "card":
            return LogHealth(
                file=0,
                blocks=heard // 4,
                open=0,
                silent_s=now - last,
                log_s=last,
                clock_s=now,
                capacity=None,
                reported=self.log_fails,
                problem=None,
                on_card=True,
            )
        seconds = min(5.0, now - first)
        return LogHealth(
            file=0,
            blocks=heard // 5,
            open=0,
            silent_s=now - last,
            log_s=last,
            clock_s=now,
            capacity=None
            if seconds < 1.0
            else Capacity(over_s=seconds, carried=rate, numbered=rate, per_log_s=rate, advance=1.0),
            reported="",
            problem=None,
        )

    def answer_log(self, wanted: bool = True, *, at_once: bool = False) -> None:
        if not wanted:
            return
        self.answered.append(at_once)
        if self.log_client is LogClient.NOBODY:
            self.log_client = LogClient.OURS

    def answered_rate(self) -> AnsweredRate | None:
        return self.rate if self.answered else None

    def shed_log(self) -> None:
        self.shed += 1

    def texts_since(self, cursor: int) -> tuple[int, list[Text]]:
        for said in self.vehicle.said[len(self._texts) :]:
            self._texts.append(Text(len(self._texts) + 1, self.vehicle.now, 6, said))
        if self._deaf or self.vehicle.silent_text:
            return cursor, []
        return len(self._texts), [text for text in self._texts if text.number > cursor]

    def samples(self, last_s: float) -> LiveWindow:
        rows = self.vehicle.samples if self.recordings else []
        if self._deaf:
            rows = rows[: self._unheard(rows)[0]]
        if rows:
            rows = rows[-int((last_s + 5) * RATE_HZ) :]
            rows = rows[bisect_left(rows, rows[-1][0] - last_s, key=itemgetter(0)) :]
        table = np.array(rows).reshape(-1, 7)
        if self.log == "card":
            table = table[::4]  # attitudes, 25 a second
            unknown = np.full(len(table), np.nan)
            known = dict(zip(COLUMNS[:3], table.T, strict=False))
            others = dict.fromkeys(COLUMNS[3:], unknown)
            return LiveWindow(**known, **others, log_s=float(table[-1, 0]) if rows else None)
        entered = self.vehicle.entered
        sweep = None if entered is None or not rows else float(table[-1, 0] - entered)
        return LiveWindow(
            **dict(zip(COLUMNS, table.T, strict=True)),
            sweep_s=sweep,
            sweep_hz=None if sweep is None else 1.0,
            sweep_entered_s=entered,
            sweep_settings=self._record(entered),
            log_s=float(table[-1, 0]) if rows else None,
        )

    def _record(self, entered: float | None) -> SweepSettings | None:
        if entered is None or self.recorded_magnitude is None:
            return None
        p = self.vehicle.parameters
        return SweepSettings(
            at_s=entered,
            axis=int(p["SID_AXIS"]),
            magnitude=self.recorded_magnitude,
            f_start_hz=p["SID_F_START_HZ"],
            f_stop_hz=p["SID_F_STOP_HZ"],
            fade_in_s=p["SID_T_FADE_IN"],
            constant_s=0.0,
            duration_s=p["SID_T_REC"],
            fade_out_s=p["SID_T_FADE_OUT"],
        )

    def call(
        self,
        procedure: Procedure[T],
        timeout_s: float | None = None,
        *,
        cancelled: Callable[[], bool] | None = None,
    ) -> T:
        self.calls += 1
        under_way: list[tuple[float, Event]] = []
        heard = len(self.vehicle.heartbeats)
        end = math.inf if timeout_s is None else self.now() + timeout_s
        said = len(self.vehicle.said)
        self._send(procedure.start(self.now()), under_way)
        while procedure.outcome is None:
            if self.now() >= end:
                raise NoAnswerError(f"not done in {timeout_s} s")
            if cancelled is not None and cancelled():
                raise ProcedureError("cancelled")
            self.vehicle.step()
            events = [event for when, event in under_way if when <= self.now()]
            under_way = [one for one in under_way if one[0] > self.now()]
            for _, mode, armed, status in self.vehicle.heartbeats[heard:]:
                events.append(Heartbeat(1, 1, vehicle_type=4, autopilot=3, armed=armed, mode=mode, status=status))
            heard = len(self.vehicle.heartbeats)
            if not self.vehicle.silent_text:
                events += [StatusText(1, 1, 4, text) for text in self.vehicle.said[said:]]
            said = len(self.vehicle.said)
            for event in events if not self._deaf else ():
                self._send(procedure.on_event(event, self.now()), under_way)
            self._send(procedure.poll(self.now()), under_way)
        outcome: Any = procedure.outcome
        if hasattr(outcome, "error"):
            raise outcome.error()
        value: T = outcome.value
        return value

    def _send(self, sends: list[Send], under_way: list[tuple[float, Event]]) -> None:
        vehicle = self.vehicle
        answer_at = vehicle.now + self.LATENCY_S
        if self.one_way:
            return
        for send in sends:
            match send:
                case Command(command, parameters, _) if command == DO_SET_MODE:
                    if self.drop_commands > 0:
                        self.drop_commands -= 1
                        continue
                    accepted = vehicle.set_mode(int(parameters[1]))
                    if self.drop_acks > 0:
                        self.drop_acks -= 1
                        continue
                    under_way.append(
                        (
                            answer_at,
                            CommandAck(
                                1, 1, command=command, result=0 if accepted else 4, target_system=0, target_component=0
                            ),
                        )
                    )
                case ParamRead(name, _) if self.drop_answers.get(name, 0) > 0:
                    self.drop_answers[name] -= 1
                case ParamRead(name, _) if name in vehicle.parameters:
                    under_way.append((answer_at, self._value(name)))
                case ParamWrite(name, bits, _) if name in vehicle.parameters:
                    vehicle.write(name, float_of_bits(bits))
                    under_way.append((answer_at, self._value(name)))
                case _:
                    pass

    def _value(self, name: str) -> ParamValue:
        return ParamValue(
            1, 1, name=name, bits=bits_of_float(self.vehicle.parameters[name]), kind=9, count=100, index=65535
        )

    @property
    def log_path(self) -> Path:
        """Of the last recording: what lies there is never written again."""
        directory = self.recordings[-1]
        number = self.recordings.count(directory)
        return directory / ("flight.BIN" if number == 1 else f"flight-{number}.BIN")

    def start_recording(self, directory: Path, log: LogWay = "stream") -> None:
        self.log = log
        self.recordings.append(directory)
        self.vehicle.samples.clear()  # a new log

    def stop_recording(self, *, meanwhile: Callable[[], None] = lambda: None) -> RecordingSummary:
        meanwhile()
        self.ended_recordings += 1
        directory = self.recordings[-1]
        if self.log == "card":
            tlog = directory / "flight.tlog"
            return RecordingSummary(directory=directory, logs=(), tlog=tlog, tlog_frames=10, how=ON_CARD, problems=())
        end = LogEnd(state=EndState.REACHED, cause=Cause.ASKED, log_s=self.now(), clock_s=self.now())
        log = RecordedLog(path=self.log_path, blocks=100, expected=100, missing=(), duplicates=0, end=end)
        return RecordingSummary(
            directory=directory,
            logs=(log,),
            tlog=directory / "flight.tlog",
            tlog_frames=10,
            how="log blocks",
            problems=(),
        )
