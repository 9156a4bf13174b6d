"""The engine against a scripted vehicle in fake time. Real threads and sockets are in `test_session_for_real.py`."""

from __future__ import annotations

import math
import struct
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pymavlink import mavutil
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from gcs.errors import LinkError, TippathError
from gcs.flight.session import Session
from gcs.link.ftp import ListFolder
from gcs.link.procedures import (
    NoAnswerError,
    ProcedureError,
    ReadAllParameters,
    ReadParameter,
    RefusedError,
    SetMode,
    WriteParameter,
)

STOP = 2147483645


@pytest.fixture
def session(connect: Callable[..., Session]) -> Iterator[Session]:
    with connect() as opened:
        yield opened


@pytest.fixture(name="until")
def _until(fake_time: Any) -> Callable[..., Any]:
    """Of fake time."""
    until: Callable[..., Any] = fake_time.until
    return until


def tell_its_clock(vehicle: Any, fake_time: Any, boot_ms: int) -> None:
    """From now on the vehicle says its attitude, with its clock starting from `boot_ms`."""
    began = fake_time.now()
    vehicle.boot_ms = lambda: boot_ms + round(1000 * (fake_time.now() - began))


def test_a_vehicle_is_found_named_and_told_that_we_are_here(session: Session, vehicle: Any, until: Any) -> None:
    vehicle.armed, vehicle.mode = True, 25
    vehicle.say(mavlink.MAVLink_attitude_message(1000, 0.1, -0.2, 0.3, 1.0, 2.0, math.nan))
    vehicle.say(mavlink.MAVLink_rpm_message(1650.0, 0.0))
    until(lambda: session.snapshot().rpm and session.snapshot().armed)
    seen = session.snapshot()
    assert (seen.system, seen.component, seen.mode, seen.mode_name) == (1, 1, 25, "SystemID")
    assert seen.capabilities == 131072
    assert seen.version == "4.7.0"
    assert seen.rpm == pytest.approx(1650.0)
    assert (seen.roll, seen.pitch) == (pytest.approx(0.1), pytest.approx(-0.2))
    assert seen.r is None  # it was NaN
    assert not seen.lost
    beats = [m for m in vehicle.heard if m.get_type() == "HEARTBEAT"]
    assert {(m.get_srcSystem(), m.type, m.autopilot) for m in beats} == {(254, 6, 8)}


def test_the_primary_station_is_255(connect: Any, vehicle: Any) -> None:
    with connect(primary=True):
        assert {m.get_srcSystem() for m in vehicle.heard} == {255}


def test_no_vehicle_says_so(connect: Any, vehicle: Any) -> None:
    vehicle.mute = True
    with pytest.raises(LinkError, match=r"no vehicle at udpout:127\.0\.0\.1:14550: nothing heard in 4 s"):
        connect(timeout_s=4.0)


def test_a_lost_link_is_shown_within_three_and_a_half_seconds_and_so_is_its_return(
    session: Session, vehicle: Any, fake_time: Any, until: Any
) -> None:
    vehicle.mute = True
    until(lambda: session.snapshot().link_age_s > 0.1)
    fake_time.at += 3.0
    assert not session.snapshot().lost
    fake_time.at += 0.5
    assert session.snapshot().lost
    assert session.snapshot().link_age_s == pytest.approx(3.6, abs=0.3)
    vehicle.mute = False
    until(lambda: not session.snapshot().lost)


def test_another_station_and_another_vehicle_change_nothing_and_are_counted(
    session: Session, vehicle: Any, fake_time: Any, until: Any
) -> None:
    # Both arrive over the vehicle's own link, forwarded, and by a stranger's address.
    other = mavlink.MAVLink(None, srcSystem=9, srcComponent=1)
    station = mavlink.MAVLink(None, srcSystem=255, srcComponent=190)
    camera = mavlink.MAVLink(None, srcSystem=1, srcComponent=100)
    vehicle.set("A", 1.0)
    vehicle.say(mavlink.MAVLink_heartbeat_message(4, 3, 129, 9, 4, 3), other)
    vehicle.say(mavlink.MAVLink_heartbeat_message(6, 8, 192, 4, 4, 3), station)
    vehicle.say(mavlink.MAVLink_heartbeat_message(30, 8, 128, 6, 4, 3), camera)
    vehicle.say(mavlink.MAVLink_statustext_message(4, b"from another"), other)
    until(lambda: (session.snapshot().other_stations, session.snapshot().other_vehicles) == (1, 1))
    seen = session.snapshot()
    assert (seen.system, seen.mode, seen.armed, seen.texts) == (1, 0, False, ())
    # An answer of the other vehicle, or of the camera, is no answer.
    vehicle.deaf = lambda m: m.get_type() == "PARAM_REQUEST_READ"
    bad = mavlink.MAVLink_param_value_message(b"A", 5.0, 9, 1, 0)
    with pytest.raises(NoAnswerError):
        session.call(
            ReadParameter("A"),
            0.2,
            cancelled=lambda: vehicle.say(bad, other) or vehicle.say(bad, camera),
        )
    fake_time.at += 11.0
    until(lambda: (session.snapshot().other_stations, session.snapshot().other_vehicles) == (0, 0))


def test_answers_to_another_stations_commands_are_not_ours(session: Session, vehicle: Any) -> None:
    vehicle.deaf = lambda m: m.get_type() == "COMMAND_LONG"
    theirs = mavlink.MAVLink_command_ack_message(176, 0, 0, 0, 255, 190)
    with pytest.raises(ProcedureError, match="not done"):
        session.call(SetMode(25), 0.2, cancelled=lambda: vehicle.say(theirs))


def test_parameters_modes_and_refusals(session: Session, vehicle: Any) -> None:
    for number in range(200):
        vehicle.set(f"P{number}", float(number))
    vehicle.read_only = {"P7"}
    vehicle.refusals = {25: (4, "No axis selected, SID_AXIS = 0")}
    assert len(session.call(ReadAllParameters())) == 200
    assert session.call(WriteParameter("P6", 0.1)).value == vehicle.get("P6")
    with pytest.raises(RefusedError, match="holds 7"):
        session.call(WriteParameter("P7", 8.0))
    with pytest.raises(RefusedError, match="No axis selected"):
        session.call(SetMode(25))
    session.call(SetMode(2))
    assert vehicle.mode == 2


@pytest.mark.parametrize("bits", [0x00000001, 0x807FFFFF, 0x7F800001, 0xFFC12345])
def test_bits_survive_the_whole_way(session: Session, vehicle: Any, bits: int) -> None:
    vehicle.parameters["N"] = (bits, 9)
    assert session.call(ReadParameter("N")).bits == bits


def test_a_bytewise_vehicle_gets_integers_bytewise(connect: Any, vehicle: Any) -> None:
    vehicle.capabilities = 16
    vehicle.parameters["COUNT"] = (7, 6)
    with connect() as session:
        assert session.call(ReadParameter("COUNT")).value == 7.0
        session.call(WriteParameter("COUNT", -2.0))
    assert vehicle.parameters["COUNT"] == (0xFFFFFFFE, 6)


def test_a_name_that_cannot_be_and_a_cancelled_call(session: Session) -> None:
    with pytest.raises(ProcedureError, match="longer than 16"):
        session.call(ReadParameter("THIS_NAME_IS_TOO_LONG"))
    with pytest.raises(ProcedureError, match="cancelled"):
        session.call(ReadParameter("NOPE"), cancelled=lambda: True)


def test_a_procedure_that_breaks_is_its_callers_matter(session: Session, vehicle: Any) -> None:
    class Broken(ReadParameter):
        def _hear(self, event: Any, now: float) -> Any:
            raise ZeroDivisionError

    vehicle.set("A", 1.0)
    with pytest.raises(ZeroDivisionError):
        session.call(Broken("A"))
    assert session.call(ReadParameter("A")).value == 1.0


def test_hostile_text_arrives_harmless_and_in_order(session: Session, vehicle: Any, until: Any) -> None:
    vehicle.text("\x1b[2J\x1b]0;owned\x07[b]bold[/] \x07\r\nline")
    for number in range(60):
        vehicle.text(f"text {number}")
    cursor, texts = until(lambda: (found := session.texts_since(0)) and len(found[1]) == 61 and found)
    assert texts[0].text == "[b]bold[/]  line"
    assert [text.text for text in texts[1:]] == [f"text {number}" for number in range(60)]
    assert cursor == 61
    assert session.texts_since(cursor) == (61, [])
    assert len(session.snapshot().texts) == 50
    vehicle.text("one more")
    _, more = until(lambda: (found := session.texts_since(cursor)) and found[1] and found)
    assert [text.text for text in more] == ["one more"]


def test_a_reboot_is_counted(session: Session, vehicle: Any, until: Any) -> None:
    for boot_ms in (50_000, 50_100, 50_050, 200):
        vehicle.say(mavlink.MAVLink_attitude_message(boot_ms, 0, 0, 0, 0, 0, 0))
    until(lambda: session.snapshot().boot_s == 0.2)
    assert session.snapshot().reboots == 1


def test_a_log_is_recorded_byte_for_byte_and_shown_live(
    session: Session, vehicle: Any, tmp_path: Path, dataflash: Callable[..., bytes], until: Any, fake_time: Any
) -> None:
    data = dataflash(1500)
    vehicle.blocks = [data[at : at + 200] for at in range(0, len(data), 200)]
    assert session.log_health() is None
    session.start_recording(tmp_path)
    with pytest.raises(TippathError, match="already recording"):
        session.start_recording(tmp_path)
    until(lambda: session.snapshot().blocks_received == len(vehicle.blocks))
    seen = session.snapshot()
    assert (seen.blocks_open, seen.missing, seen.recording_problem) == (0, 0, None)
    assert seen.recording == tmp_path / "flight.BIN"
    window = session.samples(1.0)
    assert window.t.size == pytest.approx(500, abs=1)
    assert np.array_equal(np.round(window.p), np.arange(1500 - window.t.size, 1500))
    assert (window.log_s, window.sweep_entered_s) == (pytest.approx(3.998), pytest.approx(1.0))
    tell_its_clock(vehicle, fake_time, boot_ms=3990)
    until(lambda: (health := session.log_health()) and health.clock_s)
    health = session.log_health()
    assert health is not None
    assert (health.file, health.blocks, health.open, health.problem) == (0, len(vehicle.blocks), 0, None)
    assert (health.log_s, health.reported) == (pytest.approx(3.998), "")
    assert health.silent_s is not None
    assert health.behind_s is not None
    vehicle.text("Log stream stopped: tired")
    until(lambda: (health := session.log_health()) and health.reported == "Log stream stopped: tired")
    summary = session.stop_recording()
    assert (tmp_path / "flight.BIN").read_bytes() == data
    assert (summary.missing_blocks, summary.complete) == (0, False)
    assert "(the vehicle: Log stream stopped: tired)" in summary.problems[0]
    assert session.snapshot().recording is None
    with pytest.raises(TippathError, match="nothing is being recorded"):
        session.stop_recording()
    log = mavutil.mavlink_connection(str(tmp_path / "flight.tlog"))
    kinds = []
    while (message := log.recv_msg()) is not None:
        kinds.append((message.get_type(), message.get_srcSystem()))
        assert abs(message._timestamp - fake_time.wall_clock()) < 60
    log.close()
    assert len(kinds) == summary.tlog_frames
    assert ("HEARTBEAT", 1) in kinds
    assert ("REMOTE_LOG_BLOCK_STATUS", 254) in kinds
    assert "REMOTE_LOG_DATA_BLOCK" not in {kind for kind, _ in kinds}


@pytest.mark.parametrize(("boot_ms", "end"), [(3600, "reached"), (9000, "cut"), (1000, "not known")])
def test_a_log_is_complete_where_it_reaches_the_vehicles_clock(
    session: Session,
    vehicle: Any,
    tmp_path: Path,
    dataflash: Callable[..., bytes],
    until: Any,
    fake_time: Any,
    boot_ms: int,
    end: str,
) -> None:
    data = dataflash(1500)  # to 3.998 s
    vehicle.blocks = [data[at : at + 200] for at in range(0, len(data), 200)]
    session.start_recording(tmp_path)
    until(lambda: session.snapshot().blocks_received == len(vehicle.blocks))
    tell_its_clock(vehicle, fake_time, boot_ms)
    summary = session.stop_recording()
    assert summary.logs[0].end.state.value == end
    assert summary.complete == (end == "reached")
    assert bool(summary.problems) != summary.complete


def test_a_second_recording_is_a_second_file(
    connect: Any, vehicle: Any, tmp_path: Path, dataflash: Callable[..., bytes], until: Any
) -> None:
    data = dataflash(20)
    vehicle.blocks = [data[at : at + 200] for at in range(0, len(data), 200)]
    with connect() as session:
        for name in ("flight.BIN", "flight-2.BIN"):
            vehicle.streaming = False
            session.start_recording(tmp_path)
            until(lambda: session.snapshot().blocks_received == len(vehicle.blocks))
            session.stop_recording()
            assert (tmp_path / name).read_bytes() == data


def test_a_folder_that_cannot_be_leaves_the_link_alone(session: Session, vehicle: Any, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(TippathError, match="choose another folder"):
        session.start_recording(tmp_path / "file")
    vehicle.set("A", 3.0)
    assert session.call(ReadParameter("A")).value == 3.0


def test_closing_stops_the_stream_and_gives_intervals_back(
    connect: Any, vehicle: Any, tmp_path: Path, until: Any
) -> None:
    with connect() as session:
        vehicle.blocks = [bytes(200)]
        session.start_recording(tmp_path)
        until(lambda: session.snapshot().blocks_received == 1)
        # The vehicle sends no attitude: it is asked for.
        until(lambda: any(m.get_type() == "COMMAND_LONG" and m.command == 511 for m in vehicle.heard))
        vehicle.heard.clear()
    intervals = {m.param1: m.param2 for m in vehicle.heard if m.get_type() == "COMMAND_LONG" and m.command == 511}
    assert intervals == {30.0: 0.0, 1.0: 0.0, 226.0: 0.0}
    assert any(m.get_type() == "REMOTE_LOG_BLOCK_STATUS" and m.seqno == STOP for m in vehicle.heard)
    session.close()
    with pytest.raises(ProcedureError, match="closed"):
        session.call(ReadParameter("A"))


def test_a_hundred_random_peers_worth_of_noise_does_not_stop_the_engine(session: Session, vehicle: Any) -> None:
    import random

    rng = random.Random(5)
    ids = sorted(mavlink.mavlink_map)
    for _ in range(2000):
        kind = mavlink.mavlink_map[rng.choice(ids)]
        message = mavlink.MAVLink_message(kind.id, kind.msgname)
        vehicle.raw(message._pack(vehicle.mav, kind.crc_extra, rng.randbytes(kind.unpacker.size)))
        if rng.random() < 0.1:
            vehicle.raw(rng.randbytes(60))
    vehicle.set("A", 4.0)
    assert session.call(ReadParameter("A")).value == 4.0
    assert session.snapshot().link_problem is None


def test_answers_of_files_to_another_station_are_not_ours(connect: Callable[..., Session], vehicle: Any) -> None:
    """Two stations may ask with the same numbers: only what is addressed to us answers us."""

    def answer(target: int, name: bytes) -> None:
        asked = next((m for m in reversed(vehicle.heard) if m.get_type() == "FILE_TRANSFER_PROTOCOL"), None)
        if asked is None:
            return
        number, _, opcode = struct.unpack_from("<HBB", bytes(asked.payload))
        more = b"F" + name + b"\t5\0"
        ack, data = (129, b"\6") if asked.payload[8] else (128, more)
        head = struct.pack("<HBBBBBxI", number + 1, 0, ack, len(data), opcode, 0, asked.payload[8])
        payload = (head + data).ljust(251, b"\0")
        vehicle.say(mavlink.MAVLink_file_transfer_protocol_message(0, target, 190, payload))

    def answers() -> bool:
        answer(7, b"theirs")
        answer(254, b"ours")
        return False

    with connect() as session:
        entries = session.call(ListFolder("logs"), cancelled=answers)
    assert [entry.name for entry in entries] == ["ours"]
