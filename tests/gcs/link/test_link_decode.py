"""Decode and encode against pymavlink's own packing and parsing; hostile input; the real flight's telemetry."""

from __future__ import annotations

import math
import random
import struct
import unicodedata
from pathlib import Path
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from gcs.link.decode import TextAssembly, decode, sanitise
from gcs.link.encode import BlockStatus, Command, Encoder, ParamList, ParamRead, ParamWrite, Send, StationHeartbeat
from gcs.link.events import (
    Attitude,
    Battery,
    Encoding,
    Event,
    Heartbeat,
    LogBlock,
    ParamValue,
    RotorSpeed,
    StatusText,
    StatusTextPart,
    parameter_bits,
    parameter_value,
)
from gcs.link.frames import FrameFinder
from gcs.vehicle.snapshot import VehicleSnapshot, reduce

FLIGHT = Path(__file__).parents[4] / "shared" / "data" / "ardupilot" / "quad_pitch_from_vehicle.tlog"


def through(message: Any, system: int = 1, component: int = 1) -> Event | None:
    """Pack with pymavlink, find and decode with ours."""
    (frame,) = FrameFinder().feed(message.pack(mavlink.MAVLink(None, srcSystem=system, srcComponent=component)))
    return decode(frame.message)


def test_units_become_si() -> None:
    beat = through(mavlink.MAVLink_heartbeat_message(4, 3, 129, 25, 4, 3))
    assert beat == Heartbeat(1, 1, vehicle_type=4, autopilot=3, armed=True, mode=25, status=4)
    attitude = through(mavlink.MAVLink_attitude_message(1500, 0.5, -0.25, 3.0, 0.125, -0.5, 0.0))
    assert attitude == Attitude(1, 1, boot_s=1.5, roll=0.5, pitch=-0.25, yaw=3.0, p=0.125, q=-0.5, r=0.0)
    rpm = through(mavlink.MAVLink_rpm_message(60.0, 0.0))
    assert isinstance(rpm, RotorSpeed)
    assert rpm.omega == pytest.approx(2 * math.pi)
    status = mavlink.MAVLink_sys_status_message(0, 0, 0, 0, 22100, 150, 50, 0, 0, 0, 0, 0, 0)
    assert through(status) == Battery(1, 1, pytest.approx(22.1), pytest.approx(1.5), 0.5)  # type: ignore[arg-type]
    unknown = mavlink.MAVLink_sys_status_message(0, 0, 0, 0, 65535, -1, -1, 0, 0, 0, 0, 0, 0)
    assert through(unknown) == Battery(1, 1, None, None, None)


def param_value(bits: int, name: bytes = b"A", kind: int = 9) -> Any:
    message = mavlink.MAVLink_param_value_message(name, 0.0, kind, 1, 0)
    mav = mavlink.MAVLink(None, srcSystem=1, srcComponent=1)
    frame = message._pack(mav, message.crc_extra, struct.pack("<IHH16sB", bits, 1, 0, name, kind))
    return FrameFinder().feed(frame)[0].message


@pytest.mark.parametrize("bits", [0x7FC00001, 0x7F800001, 0xFF812345, 0x00000001, 0x807FFFFF, 0x80000000, 0x7F800000])
def test_bits_of_nans_and_denormals_survive_both_ways(bits: int) -> None:
    event = decode(param_value(bits))
    assert isinstance(event, ParamValue)
    assert event.bits == bits
    frame = Encoder(254).encode(ParamWrite("A", bits, 9))
    assert struct.unpack("<I", frame[10:14])[0] == bits
    parsed = mavlink.MAVLink(None).parse_buffer(frame)
    assert parsed is not None
    assert (parsed[0].get_type(), parsed[0].param_id) == ("PARAM_SET", "A")


def test_names_of_sixteen_letters_have_no_terminator() -> None:
    event = decode(param_value(0, b"ABCDEFGHIJKLMNOP"))
    assert isinstance(event, ParamValue)
    assert event.name == "ABCDEFGHIJKLMNOP"


@pytest.mark.parametrize(("kind", "number"), [(6, -123456789), (5, 4000000000), (4, -1), (2, -128), (1, 255)])
def test_integers_travel_bytewise_or_cast(kind: int, number: int) -> None:
    bits = parameter_bits(float(number), kind, Encoding.BYTEWISE)
    assert struct.pack("<I", bits)[:1] == struct.pack("<q", number)[:1]
    assert parameter_value(bits, kind, Encoding.BYTEWISE) == number
    assert parameter_value(parameter_bits(100.0, kind, Encoding.C_CAST), kind, Encoding.C_CAST) == 100.0
    assert parameter_bits(1.0, kind, Encoding.C_CAST) == 0x3F800000


def test_sends_are_what_pymavlink_reads() -> None:
    encoder = Encoder(254)
    encoder.target = (7, 1)
    sends: list[Send] = [
        StationHeartbeat(),
        ParamRead("SID_AXIS"),
        ParamRead("", 12),
        ParamList(),
        Command(176, (1.0, 25.0), 2),
        BlockStatus(2147483646, True),
        BlockStatus(9, False),
    ]
    raw = b"".join(encoder.encode(send) for send in sends)
    messages = mavlink.MAVLink(None).parse_buffer(raw)
    assert messages is not None
    assert [m.get_seq() for m in messages] == list(range(7))
    assert {(m.get_srcSystem(), m.get_srcComponent()) for m in messages} == {(254, 190)}
    assert {m.target_system for m in messages[1:]} == {7}
    beat, by_name, by_index, _, command, start, nack = messages
    assert (beat.type, beat.autopilot) == (6, 8)
    assert (by_name.param_id, by_name.param_index) == ("SID_AXIS", -1)
    assert (by_index.param_id, by_index.param_index) == ("", 12)
    assert (command.command, command.param1, command.param2, command.confirmation) == (176, 1.0, 25.0, 2)
    assert (start.seqno, start.status, nack.seqno, nack.status) == (2147483646, 1, 9, 0)


def test_a_block_ending_in_zeros_is_whole() -> None:
    data = [1, 2, 3] + [0] * 197
    event = through(mavlink.MAVLink_remote_log_data_block_message(255, 190, 77, data), component=155)
    assert event == LogBlock(1, 155, 77, bytes(data), 255, 190)


@pytest.mark.parametrize(
    ("hostile", "safe"),
    [
        ("plain [b]text[/b] <i>", "plain [b]text[/b] <i>"),
        ("\x1b[2J\x1b[31mred\x1b[0m", "red"),
        ("\x1b]0;title\x07after", "after"),
        ("\x1b]8;;http://x\x1b\\link", "link"),
        ("\x1bPq#0\x1b\\x", "x"),
        ("bell\x07 nul\x00 del\x7f", "bell nul del"),
        ("two\r\nlines\tand", "two lines and"),
        ("right‮left⁦x", "rightleftx"),
        ("cut off \x1b[3", "cut off"),
        ("\x9b31mc1\x85", "c1"),
    ],
)
def test_text_is_made_safe_to_print(hostile: str, safe: str) -> None:
    assert sanitise(hostile) == safe


def test_whatever_is_sanitised_holds_no_control_character() -> None:
    rng = random.Random(3)
    for _ in range(3000):
        text = "".join(chr(rng.choice([27, 91, 93, 7, 92, 109, 0x9B, 0x202E, rng.randrange(0x300)])) for _ in range(40))
        assert all(unicodedata.category(c)[0] != "C" for c in sanitise(text))


def part(chunk: int, text: str, id: int = 5) -> StatusTextPart:
    message = mavlink.MAVLink_statustext_message(4, text.encode(), id, chunk)
    event = through(message)
    assert isinstance(event, StatusTextPart)
    return event


def test_chunks_join_in_any_order_and_escapes_across_chunks_go() -> None:
    first, second, third = "a" * 49 + "\x1b", "[31m" + "b" * 46, "end"
    assembly = TextAssembly()
    assert assembly.add(part(2, third), 0.0) == []
    assert assembly.add(part(0, first), 0.1) == []
    assert assembly.add(part(0, first, id=6), 0.1) == []
    assert assembly.add(part(1, second), 0.2) == [StatusText(1, 1, 4, "a" * 49 + "b" * 46 + "end")]
    assert assembly.overdue(0.5) == []
    assert assembly.overdue(1.5) == [StatusText(1, 1, 4, "a" * 49 + "…")]
    assert assembly.overdue(9.0) == []


def test_a_lost_chunk_is_shown_as_an_ellipsis() -> None:
    assembly = TextAssembly()
    assembly.add(part(0, "x" * 50), 0.0)
    assembly.add(part(2, "tail"), 0.0)
    assert [text.text for text in assembly.overdue(2.0)] == ["x" * 50 + "…tail"]


def test_twenty_thousand_random_payloads_pass_without_an_exception() -> None:
    rng = random.Random(20)
    used = [0, 1, 2, 22, 30, 32, 77, 148, 184, 226, 253, 345]
    ids = used * 3 + sorted(mavlink.mavlink_map)
    mav = mavlink.MAVLink(None)
    finder = FrameFinder()
    assembly = TextAssembly()
    snapshot = VehicleSnapshot(system=1, component=1)
    events = 0
    for number in range(20_000):
        kind = mavlink.mavlink_map[rng.choice(ids)]
        mav.srcSystem, mav.srcComponent = rng.choice([(1, 1), (1, 1), (255, 255), (0, 0), (1, 155)])
        special = rng.choice([None, None, b"\xff", b"\x00\x00\xc0\x7f", b"\x00\x00\x80\x7f"])
        size = kind.unpacker.size
        payload = rng.randbytes(size) if special is None else (special * size)[:size]
        message = mavlink.MAVLink_message(kind.id, kind.msgname)
        frames = finder.feed(message._pack(mav, kind.crc_extra, payload))
        for frame in frames:
            event = decode(frame.message)
            if event is None:
                continue
            events += 1
            joined = assembly.add(event, number * 0.01) if isinstance(event, StatusTextPart) else [event]
            for one in joined + assembly.overdue(number * 0.01):
                snapshot = reduce(snapshot, one, number * 0.01)
    # pymavlink itself rejects a few: flags and text that its constructors do not take.
    assert finder.frames > 19_900
    assert events > 1000
    assert snapshot.heartbeats > 10
    assert len(snapshot.texts) == 50
    for name in ("roll", "pitch", "yaw", "p", "q", "r", "rpm", "battery_v"):
        number_or_none = getattr(snapshot, name)
        assert number_or_none is None or math.isfinite(number_or_none)


def test_damaged_bytes_cost_no_good_frame() -> None:
    rng = random.Random(8)
    mav = mavlink.MAVLink(None, srcSystem=1, srcComponent=1)
    stream = bytearray()
    damaged = 0
    for number in range(2000):
        frame = bytearray(mavlink.MAVLink_attitude_message(number, 1, 2, 3, 4, 5, 6).pack(mav))
        if number % 10 == 3:
            frame[rng.randrange(len(frame))] ^= 1 << rng.randrange(8)
            damaged += 1
        if number % 50 == 7:
            stream += rng.randbytes(rng.randrange(30))
        stream += frame
    finder = FrameFinder()
    got = []
    while stream:
        size = rng.randrange(1, 400)
        got += finder.feed(bytes(stream[:size]))
        del stream[:size]
    numbers = {frame.message.time_boot_ms for frame in got if frame.message.get_type() == "ATTITUDE"}
    assert numbers >= {n for n in range(1999) if n % 10 != 3}
    assert damaged == 200
    assert finder.bad_bytes > 200 * 10


def test_frames_of_version_one_and_signed_frames_are_read() -> None:
    mav = mavlink.MAVLink(None, srcSystem=1, srcComponent=1)
    old = mavlink.MAVLink_heartbeat_message(4, 3, 0, 0, 4, 3).pack(mav, force_mavlink1=True)
    mav.signing.secret_key, mav.signing.sign_outgoing = bytes(32), True
    signed = mavlink.MAVLink_heartbeat_message(4, 3, 0, 2, 4, 3).pack(mav)
    frames = FrameFinder().feed(old + signed)
    assert [decode(frame.message) for frame in frames] == [
        Heartbeat(1, 1, vehicle_type=4, autopilot=3, armed=False, mode=0, status=4),
        Heartbeat(1, 1, vehicle_type=4, autopilot=3, armed=False, mode=2, status=4),
    ]


@pytest.mark.data
@pytest.mark.skipif(not FLIGHT.exists(), reason="the real logs of ../shared/data are not here")
def test_the_real_flights_telemetry_reduces_to_what_happened() -> None:
    data = FLIGHT.read_bytes()
    at, snapshot, finder = 0, VehicleSnapshot(system=1, component=1), FrameFinder()
    modes: list[str] = []
    while at + 8 < len(data):
        (microseconds,) = struct.unpack(">Q", data[at : at + 8])
        at += 8
        size = 12 + data[at + 1] + 13 * (data[at + 2] & 1) if data[at] == 0xFD else 8 + data[at + 1]
        for frame in finder.feed(data[at : at + size]):
            event = decode(frame.message)
            if event is not None:
                snapshot = reduce(snapshot, event, microseconds * 1e-6)
        at += size
        if not modes or modes[-1] != snapshot.mode_name:
            modes.append(snapshot.mode_name)
    assert finder.bad_bytes == 0
    assert modes == ["Stabilize", "Guided", "Loiter", "Stabilize", "SystemID", "Loiter", "Land"]
    assert "SystemID Starting: axis=11" in [text.text for text in snapshot.texts]
    assert not snapshot.armed
    assert snapshot.reboots == 0
