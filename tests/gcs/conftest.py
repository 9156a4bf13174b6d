"""A vehicle of a few lines, scripted with pymavlink on a link in fake time: the engine is judged by packets."""

from __future__ import annotations

import struct
import threading
import time
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from gcs.flight.session import Session
from gcs.link.frames import Frame, FrameFinder

START, STOP = 2147483646, 2147483645
BANK_NAMES = (
    *(f"K{row}{column}" for row in "12" for column in "1234"),
    *(f"L{row}{column}" for row in "1234" for column in "12"),
    *("G11", "G12", "G21", "G22"),
    *("L_B", "M_A", "TAU_F", "A_B", "B_A", "A_LAT", "A_LON", "B_LAT", "B_LON"),
)
MORE_NAMES = (
    *("K31", "K32", "K33", "K34", "G31", "G32", "L_P", "M_Q", "M_ELEV", "W1", "W2", "Z1", "Z2"),
    *(f"F{row}{column}" for row in "123" for column in "1234"),
)


class FakeTime:
    """A session's pace: 10 ms go by with every turn of the engine, and only while somebody waits."""

    TURN_S = 0.01

    def __init__(self) -> None:
        self.at = 100.0
        self.vehicles: list[ScriptedVehicle] = []
        self._turns: list[Callable[[], None]] = []
        self._beats: list[Callable[[], None]] = []
        self._next_beat = 0.0

    def now(self) -> float:
        return self.at

    def wall_clock(self) -> float:
        return 1.7e9 + self.at

    def begin(self, turn: Callable[[], None], beat: Callable[[], None]) -> None:
        self._turns, self._beats, self._next_beat = [turn], [beat], self.at

    def end(self) -> None:
        self._turns, self._beats = [], []

    def wait(self, event: threading.Event, seconds: float) -> bool:
        end = self.at + seconds
        while not event.is_set() and self.at < end:
            self.pass_by()
        return event.is_set()

    def pass_by(self) -> None:
        """One turn, of the vehicles and of the session that there is."""
        self.at += self.TURN_S
        for vehicle in self.vehicles:
            vehicle.live(self.at)
        if self.at >= self._next_beat:
            self._next_beat = self.at + 1.0
            for beat in self._beats:
                beat()
        for turn in self._turns:
            turn()

    def until(self, condition: Callable[[], Any], timeout_s: float = 30.0) -> Any:
        """Let time pass until something holds; a test that waits in vain fails here."""
        end = self.at + timeout_s
        while self.at < end:
            if value := condition():
                return value
            self.pass_by()
        raise AssertionError(f"did not happen in {timeout_s} s of fake time")


class Wire:
    """A link without a socket: what the vehicle said since the last turn, and what it is told in its next."""

    strangers = 0
    newcomer: str | None = None
    receive_buffer: int | None = None
    problem: str | None = None

    def __init__(self, vehicle: ScriptedVehicle) -> None:
        self.name = vehicle.link
        self._vehicle = vehicle
        self._finder = FrameFinder()

    @property
    def counts(self) -> tuple[int, int]:
        return self._finder.frames, self._finder.bad_bytes

    def receive(self, timeout_s: float) -> list[Frame]:
        data, self._vehicle.said = self._vehicle.said, b""
        return self._finder.feed(data)

    def take_over(self) -> bool:
        return False

    def send(self, data: bytes) -> None:
        self._vehicle.told.append(data)

    def close(self) -> None:
        """What was sent last still arrives."""
        self._vehicle.hear()


def until(condition: Callable[[], Any], timeout_s: float = 60.0) -> Any:
    """Wait by the wall clock for what another thread or process does; a test that waits in vain fails here."""
    end = time.monotonic() + timeout_s
    while time.monotonic() < end:
        value = condition()
        if value:
            return value
        time.sleep(0.003)
    raise AssertionError("did not happen in time")


class ScriptedVehicle:
    """Answers parameters, commands and log blocks, a turn after it heard of them; every knob is an attribute."""

    link = "udpout:127.0.0.1:14550"

    def __init__(self) -> None:
        self.mav = mavlink.MAVLink(None, srcSystem=1, srcComponent=1)
        self.log_mav = mavlink.MAVLink(None, srcSystem=1, srcComponent=155)
        self.parser = mavlink.MAVLink(None)
        self.parser.robust_parsing = True
        self.parameters: dict[str, tuple[int, int]] = {}
        """Name -> (float32 bits, type)."""
        self.read_only: set[str] = set()
        self.mode = 0
        self.armed = False
        self.capabilities = 131072
        self.refusals: dict[int, tuple[int, str]] = {}
        """Mode -> (MAV_RESULT, text)."""
        self.commit_refusal: str | None = None
        self.deaf: Callable[[Any], bool] = lambda message: False
        """What it does not hear."""
        self.mute = False
        self.previous: dict[str, tuple[int, int]] | None = None
        self.heard: list[Any] = []
        self.said = b""
        """What is on its way to the ground."""
        self.told: list[bytes] = []
        """What is on its way from there."""
        self.boot_ms: Callable[[], int] | None = None
        """Where it is known, its attitude is said thirty times a second with it."""
        self.blocks: list[bytes] = []
        self._unacked: dict[int, float] = {}
        self.client = (0, 0)
        """System and component that the log goes to."""
        self.streaming = False
        self._next_beat = self._next_attitude = 0.0

    def raw(self, data: bytes) -> None:
        if not self.mute:
            self.said += data

    def say(self, message: Any, mav: Any = None) -> None:
        mav = mav or self.mav
        self.raw(message.pack(mav))
        mav.seq = (mav.seq + 1) % 256

    def text(self, text: str, severity: int = 4) -> None:
        self.say(mavlink.MAVLink_statustext_message(severity, text.encode()))

    def set(self, name: str, value: float, kind: int = 9) -> None:
        self.parameters[name] = (struct.unpack("<I", struct.pack("<f", value))[0], kind)

    def get(self, name: str) -> float:
        return float(struct.unpack("<f", struct.pack("<I", self.parameters[name][0]))[0])

    def offer_bank(self, more: bool = False) -> None:
        """`more`: with an elevator and a dynamic prefilter."""
        self.bank_names = (*BANK_NAMES, *MORE_NAMES) if more else BANK_NAMES
        for prefix in ("LQS_", "LQR_"):
            for name in self.bank_names:
                self.set(prefix + name, 0.0)
        for name in ("LQR_COMMIT", "LQR_REVERT", "LQR_ACTIVE", "LQR_SW"):
            self.set(name, 0.0)
        self.read_only |= {"LQR_" + name for name in self.bank_names} | {"LQR_ACTIVE", "LQR_SW"}

    def echo(self, name: str, index: int = 65535) -> None:
        bits, kind = self.parameters[name]
        message = mavlink.MAVLink_param_value_message(name.encode(), 0.0, kind, len(self.parameters), index)
        payload = struct.pack("<IHH16sB", bits, len(self.parameters), index, name.encode(), kind)
        self.raw(message._pack(self.mav, message.crc_extra, payload))
        self.mav.seq = (self.mav.seq + 1) % 256

    def live(self, now: float) -> None:
        if now >= self._next_beat:
            self._next_beat = now + 0.05
            base = 1 | (128 if self.armed else 0)
            self.say(mavlink.MAVLink_heartbeat_message(4, 3, base, self.mode, 4, 3))
        if self.boot_ms is not None and now >= self._next_attitude:
            self._next_attitude = now + 0.03
            self.say(mavlink.MAVLink_attitude_message(self.boot_ms(), 0, 0, 0, 0, 0, 0))
        self._send_blocks(now)
        self.hear()

    def hear(self) -> None:
        told, self.told = self.told, []
        for data in told:
            for message in self.parser.parse_buffer(data) or []:
                self.heard.append(message)
                if not self.deaf(message):
                    self._hear(message)

    def _hear(self, m: Any) -> None:
        names = list(self.parameters)
        match m.get_type():
            case "PARAM_REQUEST_READ":
                name = m.param_id if m.param_index < 0 else names[m.param_index]
                if name in self.parameters:
                    self.echo(name, names.index(name))
            case "PARAM_REQUEST_LIST":
                for index, name in enumerate(names):
                    self.echo(name, index)
            case "PARAM_SET" if m.param_id in self.parameters:
                self._set(m.param_id, struct.unpack("<I", bytes(m.get_msgbuf()[10:14]).ljust(4, b"\0"))[0])
            case "COMMAND_LONG":
                self._command(m)
            case "REMOTE_LOG_BLOCK_STATUS":
                self._block_status(m)

    def _set(self, name: str, bits: int) -> None:
        value = struct.unpack("<f", struct.pack("<I", bits))[0]
        kind = self.parameters[name][1]
        if name == "LQR_COMMIT":
            bank = [self.parameters["LQS_" + n] for n in self.bank_names]
            told = bank if any(b for b, _ in bank[29:]) else bank[:29]
            crc = zlib.crc32(struct.pack(f"<{len(told)}I", *(b for b, _ in told))) & 0xFFFFFF
            if self.commit_refusal or value != crc:
                self.text(f"LQR commit refused: {self.commit_refusal or 'CRC'}")
            else:
                self.previous = {n: self.parameters["LQR_" + n] for n in [*self.bank_names, "ACTIVE"]}
                self.parameters |= {"LQR_" + n: b for n, b in zip(self.bank_names, bank, strict=True)}
                self.set("LQR_ACTIVE", float(crc))
                self.parameters[name] = (bits, kind)
        elif name == "LQR_REVERT":
            if self.previous is None:
                self.text("LQR revert refused: no previous bank")
            else:
                active = {n: self.parameters["LQR_" + n] for n in self.previous}
                self.parameters |= {"LQR_" + n: b for n, b in self.previous.items()}
                self.previous = active
                self.parameters[name] = (bits, kind)
                self.echo(name)
                self.set(name, 0.0)
                return
        elif name not in self.read_only:
            self.parameters[name] = (bits, kind)
        self.echo(name)

    def _command(self, m: Any) -> None:
        result, text = 0, ""
        if m.command == 176:
            result, text = self.refusals.get(int(m.param2), (0, ""))
            if result == 0:
                self.mode = int(m.param2)
        if text:
            self.text(text)
        self.say(mavlink.MAVLink_command_ack_message(m.command, result, 0, 0, m.get_srcSystem(), m.get_srcComponent()))
        if m.command == 512:
            zeros = [0] * 8
            self.say(
                mavlink.MAVLink_autopilot_version_message(
                    self.capabilities, 0x04070000, 0, 0, 0, zeros, zeros, zeros, 0, 0, 0
                )
            )

    def _block_status(self, m: Any) -> None:
        if m.seqno == START:
            if not self.streaming:
                self.streaming, self.client = True, (m.get_srcSystem(), m.get_srcComponent())
                self._unacked = dict.fromkeys(range(len(self.blocks)), 0.0)
        elif m.seqno == STOP:
            pass
        elif m.status == 1:
            self._unacked.pop(m.seqno, None)
        elif m.seqno in self._unacked:
            self._unacked[m.seqno] = 0.0

    def _send_blocks(self, now: float) -> None:
        if not self.streaming:
            return
        for number in [n for n, sent in self._unacked.items() if now - sent > 0.1][:40]:
            self._unacked[number] = now
            data = list(self.blocks[number])
            self.say(mavlink.MAVLink_remote_log_data_block_message(*self.client, number, data), self.log_mav)


@pytest.fixture
def fake_time() -> FakeTime:
    return FakeTime()


@pytest.fixture
def vehicle(fake_time: FakeTime) -> ScriptedVehicle:
    fake_time.vehicles.append(ScriptedVehicle())
    return fake_time.vehicles[0]


@pytest.fixture
def connect(fake_time: FakeTime, vehicle: ScriptedVehicle) -> Callable[..., Session]:
    """A session with the vehicle, in fake time; leave it as one leaves `Session.open`."""

    def open_session(*_: object, timeout_s: float = 5.0, key: Path | None = None, **options: Any) -> Session:
        assert key is None, "this vehicle signs nothing"
        session = Session(Wire(vehicle), pace=fake_time, wall_clock=fake_time.wall_clock, **options)
        try:
            session.wait_for_vehicle(timeout_s)
        except BaseException:
            session.close()
            raise
        return session

    return open_session


@pytest.fixture(name="until")
def _until() -> Callable[..., Any]:
    return until


@pytest.fixture(scope="session")
def dataflash() -> Callable[..., bytes]:
    """A DataFlash log of RATE (and TPEX, SIDD) in as many whole blocks as it fills, made with struct alone."""

    def make(samples: int, excitation: bool = True, sweep: bool = True, start_us: int = 1_000_000) -> bytes:
        def fmt(kind: int, name: str, codes: str, labels: str, size: int) -> bytes:
            fields = struct.pack("<BB4s16s64s", kind, size, name.encode(), codes.encode(), labels.encode())
            return b"\xa3\x95\x80" + fields

        out = [
            fmt(128, "FMT", "BBnNZ", "Type,Length,Name,Format,Columns", 89),
            fmt(
                1, "RATE", "Qfffffffffffff",
                "TimeUS,RDes,R,ROut,PDes,P,POut,YDes,Y,YOut,ADes,A,AOut,AOutSlew", 3 + 8 + 52,
            ),
            fmt(2, "TPEX", "Qfffff", "TimeUS,EX,EY,EE,Elev,Coll", 3 + 8 + 20),
            fmt(3, "SIDD", "Qfffffffff", "TimeUS,Time,Targ,F,Gx,Gy,Gz,Ax,Ay,Az", 3 + 8 + 36),
            fmt(4, "PAD4", "B", "X", 4),
            fmt(5, "PAD5", "BB", "X,Y", 5),
        ]  # fmt: skip
        for i in range(samples):
            t = start_us + 2000 * i
            rate = (0.0, 57.29577951308232 * i, 0.001 * i, 0.0, -57.29577951308232 * i, -0.001 * i, *(0.0,) * 7)
            out.append(b"\xa3\x95\x01" + struct.pack("<Q13f", t, *rate))
            if excitation:
                out.append(b"\xa3\x95\x02" + struct.pack("<Q5f", t, i, -i, 2 * i, 3 * i, 0))
            if sweep:
                out.append(b"\xa3\x95\x03" + struct.pack("<Q9f", t, 0.002 * i, 0, 0.5 + 0.01 * i, *(0.0,) * 6))
        data = b"".join(out)
        short = -len(data) % 200
        while short and short < 12:
            short += 200
        while short:
            size = 5 if short % 4 else 4
            data += b"\xa3\x95" + bytes([size]) + bytes(size - 3)
            short -= size
        assert len(data) % 200 == 0
        return data

    return make


@pytest.fixture
def gains_document() -> dict[str, Any]:
    names = ("L_b", "M_a", "tau_f", "A_b", "B_a", "A_lat", "A_lon", "B_lat", "B_lon")
    return {
        "format": "tippath.gains/1",
        "K": [[0.1, 1 / 3, -2.5, 3.75], [4.0, 5.1, 6.2, -7.3]],
        "observer_gain": [[30.0, 1e-40], [0.5, 28.0], [-0.01, 0.002], [0.003, -0.04]],
        "prefilter": [[1.0, -0.0], [0.125, 1.1]],
        "model": {"structure": "tpp", "parameters": dict(zip(names, range(1, 10), strict=True))},
    }
