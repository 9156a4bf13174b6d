"""A real session without the log's stream over a telemetry radio of 57,600 baud, in fake time, byte by byte."""

from __future__ import annotations

import json
import math
import struct
from collections import deque
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from gcs.cards.maneuver import Maneuver, TestCard
from gcs.flight.folder import create
from gcs.flight.session import Session
from gcs.flight.sweep import fly_card

BYTES_S = 5760.0
"""Each way."""
BOOTED_S = 40.0
MOST_BEHIND = 3 * 280
"""Bytes that may wait before a stock vehicle skips what it streams: its output buffer is nearly full."""
STREAMED = {1: 0.5, 24: 0.5, 33: 0.33, 65: 0.5, 74: 0.25, 30: 0.25}
"""What a telemetry port streams by itself: message, interval in s."""
PARAMETERS = {
    "SID_AXIS": 0.0,
    "SID_MAGNITUDE": 15.0,
    "SID_F_START_HZ": 0.5,
    "SID_F_STOP_HZ": 40.0,
    "SID_T_FADE_IN": 15.0,
    "SID_T_REC": 70.0,
    "SID_T_FADE_OUT": 2.0,
    "FS_GCS_ENABLE": 1.0,
    "FS_OPTIONS": 16.0,
    "FS_GCS_TIMEOUT": 5.0,
    "SYSID_MYGCS": 255.0,
    "SCHED_LOOP_RATE": 400.0,
    "ANGLE_MAX": 3000.0,
    "LOG_BACKEND_TYPE": 1.0,
}
"""A stock ArduCopter's, of those that are asked for."""


class StockVehicle:
    """An ArduCopter in the air behind a slow radio; says what it streams, and skips it where the radio is full."""

    link = "/dev/ttyUSB0,57600"

    def __init__(self) -> None:
        self.bytes_s = BYTES_S
        self.mav = mavlink.MAVLink(None, srcSystem=1, srcComponent=1)
        self.parser = mavlink.MAVLink(None)
        self.parser.robust_parsing = True
        self.parameters = dict(PARAMETERS)
        self.mode, self.entered = 0, math.nan
        self.intervals = dict(STREAMED)
        self.said, self.told = b"", []  # type: ignore[var-annotated]
        self.asked: list[Any] = []
        self.entries: list[float] = []
        """When the excitation mode was entered, on the vehicle's clock."""
        self.down_bytes: deque[tuple[float, int]] = deque()
        """What went down the radio: when, how much."""
        self.skipped = 0
        self._now = 100.0
        self._waiting, self._rising = b"", b""
        self._credit, self._up_credit = 0.0, 0.0
        self._due: dict[int, float] = {}
        self._next_beat, self._finished = 0.0, True

    def boot_s(self) -> float:
        return self._now - BOOTED_S

    def live(self, now: float) -> None:
        """One turn of 10 ms."""
        passed, self._now = now - self._now, now
        self._stream(now)
        self._fly()
        self._credit = min(self._credit + self.bytes_s * passed, self.bytes_s * 0.05)
        gone = min(len(self._waiting), int(self._credit))
        self._credit -= gone
        self.said += self._waiting[:gone]
        self._waiting = self._waiting[gone:]
        self.down_bytes.append((now, gone))
        self._up_credit = min(self._up_credit + self.bytes_s * passed, self.bytes_s * 0.05)
        self._rising += b"".join(self.told)
        self.told = []
        risen = min(len(self._rising), int(self._up_credit))
        self._up_credit -= risen
        heard, self._rising = self._rising[:risen], self._rising[risen:]
        self._parse(heard)

    def hear(self) -> None:
        """The link was closed: what was sent last still arrives."""
        self._parse(self._rising + b"".join(self.told))

    def _parse(self, heard: bytes) -> None:
        for message in self.parser.parse_buffer(heard) or []:
            self.asked.append(message)
            self._hear(message)

    def say(self, message: Any) -> None:
        self._waiting += message.pack(self.mav)
        self.mav.seq = (self.mav.seq + 1) % 256

    def _stream(self, now: float) -> None:
        if now >= self._next_beat:
            self._next_beat = now + 1.0
            self.say(mavlink.MAVLink_heartbeat_message(2, 3, 129, self.mode, 4, 3))
        for message, interval_s in self.intervals.items():
            if now < self._due.get(message, 0.0):
                continue
            self._due[message] = now + interval_s
            if len(self._waiting) > MOST_BEHIND:
                self.skipped += 1
            else:
                self.say(self._telemetry(message))

    def _telemetry(self, message: int) -> Any:
        boot_ms = round(1000 * self.boot_s())
        match message:
            case 30:
                swing = 0.2 * math.sin(20.0 * self._now) if self.mode == 25 else 0.01
                return mavlink.MAVLink_attitude_message(boot_ms, 0.02, 0.03, 1.0, swing, 0.011, 0.012)
            case 36:
                return mavlink.MAVLink_servo_output_raw_message(boot_ms * 1000, 0, *range(1500, 1516))
            case 1:
                logging = 1 << 24
                return mavlink.MAVLink_sys_status_message(
                    logging, logging, logging, 300, 12000, 900, 80, 0, 0, 0, 0, 0, 0
                )
            case 74:
                return mavlink.MAVLink_vfr_hud_message(1.0, 1.0, 90, 50, 20.0, 0.1)
            case 65:
                return mavlink.MAVLink_rc_channels_message(boot_ms, 16, *([1500] * 18), 200)
            case 33:
                return mavlink.MAVLink_global_position_int_message(boot_ms, 1, 2, 3, 4, 5, 6, 7, 8)
            case _:
                return mavlink.MAVLink_gps_raw_int_message(boot_ms * 1000, 3, 1, 2, 3, 4, 5, 6, 7, 12)

    def _fly(self) -> None:
        p = self.parameters
        if self.mode == 25 and not self._finished:
            over_s = 1.0 + p["SID_T_FADE_IN"] + 2 / p["SID_F_START_HZ"] + p["SID_T_REC"] + p["SID_T_FADE_OUT"]
            if self.boot_s() - self.entered > over_s:
                self._finished = True
                self.say(mavlink.MAVLink_statustext_message(6, b"SystemID Finished"))

    def _hear(self, m: Any) -> None:
        match m.get_type():
            case "TIMESYNC":
                self.say(mavlink.MAVLink_timesync_message(int(self.boot_s() * 1e9), m.ts1))
            case "PARAM_REQUEST_READ" if m.param_id in self.parameters:
                self._echo(m.param_id)
            case "PARAM_SET" if m.param_id in self.parameters:
                (self.parameters[m.param_id],) = struct.unpack("<f", bytes(m.get_msgbuf()[10:14]).ljust(4, b"\0"))
                assert self.mode != 25, "written in the excitation mode"
                self._echo(m.param_id)
            case "COMMAND_LONG" if m.command == 511:
                interval_s = m.param2 * 1e-6 or STREAMED.get(int(m.param1), 0.0)
                self.intervals.pop(int(m.param1), None)
                if interval_s:
                    self.intervals[int(m.param1)] = interval_s
            case "COMMAND_LONG" if m.command == 176:
                self._enter(int(m.param2))
                self.say(mavlink.MAVLink_command_ack_message(176, 0, 0, 0, m.get_srcSystem(), m.get_srcComponent()))
            case _:
                pass

    def _enter(self, mode: int) -> None:
        if mode == 25 != self.mode:
            self.entered, self._finished = self.boot_s(), False
            self.entries.append(self.entered)
            axis = f"SystemID Starting: axis={self.parameters['SID_AXIS']:.0f}"
            self.say(mavlink.MAVLink_statustext_message(6, axis.encode()))
        self.mode = mode

    def _echo(self, name: str) -> None:
        self.say(mavlink.MAVLink_param_value_message(name.encode(), self.parameters[name], 9, 900, 65535))


class Clock:
    """The session's, as a card wants it."""

    def __init__(self, fake_time: Any) -> None:
        self.now = fake_time.now
        self._time = fake_time

    def sleep(self, seconds: float) -> None:
        end = self._time.at + seconds
        while self._time.at < end:
            self._time.pass_by()


@pytest.fixture
def vehicle(fake_time: Any) -> StockVehicle:
    fake_time.vehicles.append(StockVehicle())
    made: StockVehicle = fake_time.vehicles[0]
    return made


def test_a_card_is_flown_over_57600_baud(
    fake_time: Any, vehicle: StockVehicle, connect: Callable[..., Session], tmp_path: Path
) -> None:
    chirps = tuple(
        Maneuver(kind="chirp", axis=axis, amplitude=0.05, duration_s=8.0, f_start_hz=1.0, noise_fraction=0.0)
        for axis in ("roll", "pitch")
    )
    folder = create(tmp_path / "flight")
    with connect() as session:
        result = fly_card(
            session,
            TestCard(name="slow", maneuvers=chirps),
            folder=folder,
            clock=Clock(fake_time),
            disk_free=lambda _: 10**12,
            log="card",
        )
        lag_s = session.snapshot().lag_s
    assert result.done, result.stopped
    assert lag_s is not None
    assert lag_s < 0.3
    assert vehicle.parameters == PARAMETERS
    assert not any(m.get_type() == "REMOTE_LOG_BLOCK_STATUS" for m in vehicle.asked), "no log was asked for"
    for run, entered in zip(result.runs, vehicle.entries, strict=True):
        assert run.log_start_s is not None
        assert abs(run.log_start_s - entered) <= run.log_start_within_s + 0.02
        assert run.log_start_within_s < 0.25
        assert run.verdict is not None
        assert run.verdict.samples > 20 * run.duration_s, "25 attitudes a second"
    assert vehicle.intervals == STREAMED, "its own rates again"
    about = json.loads(folder.about.read_text())
    assert (about["log"], about["recording"]["logs"]) == ("card", [])
    assert (folder.path / "flight.tlog").stat().st_size > 10_000
    assert not folder.log.exists()


def test_what_is_asked_for_fits_the_radio(
    fake_time: Any, vehicle: StockVehicle, connect: Callable[..., Session], tmp_path: Path
) -> None:
    with connect() as session:
        session.start_recording(tmp_path, "card")
        Clock(fake_time).sleep(4.0)
        vehicle.down_bytes.clear()
        vehicle.skipped = 0
        Clock(fake_time).sleep(5.0)
        health = session.log_health()
    assert sum(count for _, count in vehicle.down_bytes) < 0.7 * BYTES_S * 5.0
    assert vehicle.skipped == 0
    assert health is not None
    assert (health.on_card, health.blocks > 25 * 8) == (True, True)
    assert (health.silent_s or 0.0) < 0.1


def test_a_rate_that_another_station_took_is_asked_for_again(
    fake_time: Any, vehicle: StockVehicle, connect: Callable[..., Session], tmp_path: Path
) -> None:
    with connect() as session:
        session.start_recording(tmp_path, "card")
        Clock(fake_time).sleep(3.0)
        vehicle.intervals[30] = 0.25
        Clock(fake_time).sleep(6.0)
        assert vehicle.intervals[30] == pytest.approx(0.04)


@pytest.mark.parametrize(
    ("link", "bytes_s", "interval_s"),
    [
        ("/dev/ttyUSB0,57600", 5760.0, 0.04),
        ("/dev/ttyUSB0,19200", 1920.0, 0.1),
        ("/dev/ttyUSB0,115200", 11520.0, 0.02),
        ("udpout:127.0.0.1:14550", 100_000.0, 0.02),
        ("udpout:127.0.0.1:14550", 2_200.0, 0.05),
        ("udpout:127.0.0.1:14550", 1_300.0, 0.1),
    ],
)
def test_attitudes_are_asked_for_as_often_as_the_link_carries_them(
    link: str,
    bytes_s: float,
    interval_s: float,
    fake_time: Any,
    vehicle: StockVehicle,
    connect: Callable[..., Session],
    tmp_path: Path,
) -> None:
    vehicle.link, vehicle.bytes_s = link, bytes_s
    with connect() as session:
        session.start_recording(tmp_path, "card")
        Clock(fake_time).sleep(15.0)
        assert vehicle.intervals[30] == pytest.approx(interval_s)
        before, now = session.log_health(), fake_time.at
        Clock(fake_time).sleep(5.0)
        after = session.log_health()
        assert before is not None
        assert after is not None
        assert (after.blocks - before.blocks) / (fake_time.at - now) > 0.6 / interval_s


def test_more_is_asked_for_only_in_the_mode_that_the_pilot_chose(
    fake_time: Any, vehicle: StockVehicle, connect: Callable[..., Session], tmp_path: Path
) -> None:
    vehicle.link, vehicle.bytes_s = "udpout:127.0.0.1:14550", 100_000.0
    with connect() as session:
        session.start_recording(tmp_path, "card")
        Clock(fake_time).sleep(1.2)
        vehicle.mode = 25
        Clock(fake_time).sleep(1.5)
        asked = vehicle.intervals[30]
        Clock(fake_time).sleep(10.0)
        assert vehicle.intervals[30] == asked > 0.03
