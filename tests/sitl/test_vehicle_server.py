"""The vehicle's MAVLink, spoken to by pymavlink: in memory and fake time, then over loopback sockets with losses."""

from __future__ import annotations

import itertools
import os
import random
import socket
import struct
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sitl.autopilot.modes import Mode
from sitl.autopilot.parameters import BANK_MORE, BANK_ORDER, bank_crc
from sitl.autopilot.vehicle import Vehicle, make_vehicle
from sitl.faults import Loss, LossyLink, Outage
from sitl.protocol.links import Link, LinkError, open_link
from sitl.protocol.server import Server

Reader = Callable[[Path], list[Any]]
START, STOP = 2147483646, 2147483645
SET_MODE, SET_INTERVAL, REQUEST = 176, 511, 512
ACCEPTED, DENIED, UNSUPPORTED, FAILED = 0, 2, 3, 4


def receipt(seqno: int, status: int = 1) -> Any:
    return mavlink.MAVLink_remote_log_block_status_message(1, 155, seqno, status)


def texts(messages: list[Any]) -> list[str]:
    return [m.text for m in messages if m.get_type() == "STATUSTEXT"]


@pytest.fixture
def station(radio: Any, hovering: Vehicle) -> Any:
    """A ground station that the vehicle has met."""
    made = radio(hovering)
    made.ask(made.heartbeat())
    return made


# Telemetry


def test_it_introduces_itself_as_the_contract_says(station: Any) -> None:
    station.fly(1.01)
    heartbeat = station.take("HEARTBEAT")[-1]
    assert (heartbeat.type, heartbeat.autopilot, heartbeat.custom_mode) == (4, 3, 0)
    assert heartbeat.base_mode & 1
    assert heartbeat.base_mode & 128
    assert (heartbeat.get_srcSystem(), heartbeat.get_srcComponent()) == (1, 1)
    assert heartbeat.get_msgbuf()[0] == 0xFD
    answers = station.ask(mavlink.MAVLink_command_long_message(1, 1, REQUEST, 0, 148, 0, 0, 0, 0, 0, 0))
    version = next(m for m in answers if m.get_type() == "AUTOPILOT_VERSION")
    assert version.capabilities & 8192
    assert version.capabilities & 131072
    assert not version.capabilities & 32


def test_default_rates(station: Any) -> None:
    station.take()
    station.fly(10)
    counts: dict[str, int] = {}
    for message in station.take():
        counts[message.get_type()] = counts.get(message.get_type(), 0) + 1
    expected = {"HEARTBEAT": 10, "SYS_STATUS": 10, "ATTITUDE": 100, "RPM": 50}
    assert {name: counts[name] for name in expected} == pytest.approx(expected, abs=1)
    assert "SERVO_OUTPUT_RAW" not in counts


def test_message_intervals_are_kept_capped_and_taken_back(station: Any) -> None:
    assert station.command(SET_INTERVAL, mavlink.MAVLINK_MSG_ID_HIGHRES_IMU, 5000) == ACCEPTED
    station.take()
    station.fly(2)
    times = [m.time_usec for m in station.take("HIGHRES_IMU")]
    assert len(times) == pytest.approx(400, abs=1)
    assert station.command(SET_INTERVAL, mavlink.MAVLINK_MSG_ID_HIGHRES_IMU, 2500) == FAILED
    assert station.command(SET_INTERVAL, mavlink.MAVLINK_MSG_ID_HIGHRES_IMU, 3000) == ACCEPTED
    (interval,) = station.ask(
        mavlink.MAVLink_command_long_message(1, 1, 510, 0, 105, 0, 0, 0, 0, 0, 0), kind="MESSAGE_INTERVAL"
    )
    assert interval.interval_us == 3000
    assert station.command(SET_INTERVAL, mavlink.MAVLINK_MSG_ID_HIGHRES_IMU, -1) == ACCEPTED
    station.take()
    station.fly(1)
    assert station.take("HIGHRES_IMU") == []
    assert station.command(SET_INTERVAL, 99999, 5000) == FAILED
    for number in (36, 65, 74, 33, 2, 245):
        assert station.command(SET_INTERVAL, number, 100_000) == ACCEPTED
    station.fly(0.5)
    kinds = {m.get_type() for m in station.take()}
    assert {"SERVO_OUTPUT_RAW", "RC_CHANNELS", "VFR_HUD", "GLOBAL_POSITION_INT", "SYSTEM_TIME"} <= kinds


def test_intervals_belong_to_one_peer(radio: Any, hovering: Vehicle) -> None:
    station = radio(hovering)
    other = ("127.0.0.1", 40001)
    station.send(station.heartbeat())
    station.send(station.heartbeat(), address=other)
    station.fly(0.1)
    assert station.command(SET_INTERVAL, mavlink.MAVLINK_MSG_ID_SERVO_OUTPUT_RAW, 10_000) == ACCEPTED
    station.fly(0.5)
    assert len(station.take("SERVO_OUTPUT_RAW")) > 40
    station.heard.clear()
    assert station.take("SERVO_OUTPUT_RAW", address=other) == []
    assert any(m.get_type() == "ATTITUDE" for m in station.heard)


def test_time_is_told(station: Any) -> None:
    (answer,) = station.ask(mavlink.MAVLink_timesync_message(0, 123456789), kind="TIMESYNC")
    assert answer.ts1 == 123456789
    assert answer.tc1 == station.vehicle.time_us * 1000
    assert station.ask(mavlink.MAVLink_timesync_message(answer.tc1, 5), kind="TIMESYNC") == []


def test_long_texts_come_in_pieces_with_one_id(station: Any) -> None:
    for text in ("x" * 50, "y" * 100, "z" * 117):
        station.take()
        station.heard.clear()
        station.vehicle.say(4, text)
        station.server.poll()
        pieces = station.take("STATUSTEXT")
        assert "".join(m.text for m in pieces) == text
        assert [m.chunk_seq for m in pieces] == list(range(len(pieces)))
        assert len({m.id for m in pieces}) == 1
        assert (pieces[0].id == 0) == (len(text) == 50)
        assert len(pieces) == 1 or len(pieces[-1].text) < 50


# Modes and commands


def test_mode_changes_are_acknowledged_and_shown(station: Any) -> None:
    station.set("SID_AXIS", 10)
    assert station.command(SET_MODE, 1, 25) == ACCEPTED
    assert station.vehicle.mode is Mode.SYSTEMID
    station.fly(1.2)
    heard = station.take()
    assert texts(heard)[-1] == "SystemID Starting: axis=10"
    assert [m.custom_mode for m in heard if m.get_type() == "HEARTBEAT"][-1] == 25
    assert station.command(SET_MODE, 1, 25) == ACCEPTED
    assert station.command(SET_MODE, 1, 0) == ACCEPTED
    assert station.vehicle.mode is Mode.STABILIZE


def test_refused_modes_say_why(station: Any) -> None:
    assert station.command(SET_MODE, 1, 25) == FAILED
    assert station.command(SET_MODE, 1, 77) == FAILED
    assert station.command(SET_MODE, 0, 2) == DENIED
    assert station.command(SET_MODE, 1, float("nan")) == DENIED
    assert station.vehicle.mode is Mode.STABILIZE
    station.vehicle.set_mode(25, 2)
    station.vehicle.set_mode(77, 2)
    station.server.poll()
    assert texts(station.take()) == ["No axis selected, SID_AXIS = 0", "No such mode: 77"]


@pytest.mark.parametrize("command", [400, 22, 21])
def test_nobody_arms_or_flies_it_over_the_link(station: Any, command: int) -> None:
    assert station.command(command, 0) == DENIED
    assert station.vehicle.armed
    assert not station.vehicle.landed
    assert station.command(31999) == UNSUPPORTED


def test_frames_for_others_are_not_obeyed(station: Any) -> None:
    message = mavlink.MAVLink_command_long_message(2, 1, SET_MODE, 0, 1, 2, 0, 0, 0, 0, 0)
    assert station.ask(message, kind="COMMAND_ACK") == []
    assert station.vehicle.mode is Mode.STABILIZE


def test_version_1_frames_are_understood(station: Any) -> None:
    old = mavlink.MAVLink(None, 255, 190)
    message = mavlink.MAVLink_command_long_message(1, 1, SET_MODE, 0, 1, 2, 0, 0, 0, 0, 0)
    station.link.to_vehicle.append((station.address, bytes(message.pack(old, force_mavlink1=True))))
    station.server.poll()
    assert station.vehicle.mode is Mode.ALT_HOLD


def test_the_failsafe_hears_the_grounds_heartbeats(station: Any) -> None:
    for _ in range(7):
        station.send(station.heartbeat())
        station.fly(1)
    assert station.vehicle.mode is Mode.STABILIZE
    station.fly(5.1)
    assert station.vehicle.mode is Mode.RTL
    assert "GCS Failsafe" in texts(station.take())


# Parameters


def test_the_list_is_complete_by_index(station: Any) -> None:
    station.set("SID_AXIS", 11)
    station.send(mavlink.MAVLink_param_request_list_message(1, 1))
    station.fly(0.2)
    values = station.take("PARAM_VALUE")
    names = station.vehicle.parameters.visible()
    assert [m.param_index for m in values] == list(range(len(names)))
    assert [m.param_id for m in values] == list(names)
    assert {m.param_count for m in values} == {len(names)}
    (third,) = station.ask(mavlink.MAVLink_param_request_read_message(1, 1, b"", 3), kind="PARAM_VALUE")
    assert (third.param_id, third.param_index) == (names[3], 3)
    assert station.ask(mavlink.MAVLink_param_request_read_message(1, 1, b"", 9999), kind="PARAM_VALUE") == []


def test_writes_echo_the_float32_bits_or_the_old_value_or_nothing(station: Any) -> None:
    sent = struct.unpack("<f", struct.pack("<f", 0.123456789))[0]
    assert station.set("SID_MAGNITUDE", sent) == sent
    assert station.get("SID_MAGNITUDE") == sent
    assert station.set("SID_AXIS", 10.7) == 10
    assert station.set("LQR_K11", 1.0) == 0
    assert station.set("SID_MAGNITUDE", float("nan")) is None
    assert station.set("SID_MAGNITUDE", float("inf")) is None
    assert station.set("NO_SUCH_NAME", 1.0) is None
    assert station.get("NO_SUCH_NAME") is None
    assert station.get("SID_MAGNITUDE") == sent


def test_a_full_length_name_has_no_terminator(station: Any) -> None:
    assert "H_RSC_RUNUP_TIME" in station.vehicle.parameters
    assert station.get("H_RSC_RUNUP_TIME") == 2


def test_gains_go_over_as_one_set(radio: Any, paper_bank: tuple[float, ...]) -> None:
    station = radio(make_vehicle("hover-ideal", 1, on_ground=True))
    for name, value in zip(BANK_ORDER, paper_bank, strict=True):
        assert station.set("LQS_" + name, value) == value
    crc = bank_crc(paper_bank)
    assert station.set("LQR_COMMIT", crc + 1.0) == 0
    assert station.get("LQR_ACTIVE") == 0
    assert station.set("LQR_COMMIT", crc) == crc
    assert station.get("LQR_ACTIVE") == crc
    assert [station.get("LQR_" + name) for name in BANK_ORDER] == list(paper_bank)
    assert station.set("LQR_REVERT", 1) == 0
    station.vehicle.take_off()
    station.fly(5)
    assert station.set("LQR_COMMIT", crc) == 0
    station.server.poll()
    station.send(mavlink.MAVLink_param_set_message(1, 1, b"LQR_COMMIT", crc, 9))
    station.fly(0.01)
    assert "LQR commit refused: armed" in texts(station.take())


# Garbage


def test_strangers_with_garbage_are_not_spoken_to(radio: Any, hovering: Vehicle) -> None:
    station = radio(hovering)
    rng = random.Random(3)
    for _ in range(500):
        junk = rng.choice([b"", b"\xfd", b"\xfe", b"\xfd\xff"]) + rng.randbytes(rng.randrange(400))
        station.link.to_vehicle.append((("127.0.0.1", rng.randrange(1, 65536)), junk))
        station.fly(0.002)
    assert station.link.from_vehicle == []


def test_frames_are_found_in_a_stream_cut_anywhere(radio: Any, hovering: Vehicle) -> None:
    station = radio(hovering, address=1)
    rng = random.Random(4)
    data = b""
    for n in range(200):
        message = mavlink.MAVLink_timesync_message(0, n + 1)
        data += rng.randbytes(rng.randrange(3)).replace(b"\xfd", b"x").replace(b"\xfe", b"x")
        data += bytes(message.pack(station.mav))
    while data:
        size = rng.randrange(1, 40)
        station.link.to_vehicle.append((1, data[:size]))
        data = data[size:]
        station.server.poll()
    assert [m.ts1 for m in station.take("TIMESYNC")] == list(range(1, 201))


def test_5000_random_payloads_with_valid_checksums(radio: Any, tmp_path: Path) -> None:
    """All message kinds, any values, whatever they ask for; afterwards it still flies and answers."""
    vehicle = make_vehicle("hover", 1, directory=tmp_path, parameters={"SID_AXIS": 10})
    station = radio(vehicle)
    rng = random.Random(5)
    kinds = sorted(mavlink.mavlink_map)
    spoken_to = [0, 11, 20, 21, 23, 75, 76, 109, 111, 148, 184, 185]
    names = [
        name for name in vehicle.parameters.table if name[4:] not in BANK_MORE
    ]  # which the first of a bank stand for
    for n in range(5000):
        number = rng.choice(spoken_to if n % 2 else kinds)
        kind = mavlink.mavlink_map[number]
        payload = bytearray(rng.randbytes(kind.unpacker.size))
        if number == 23 and n % 3:  # parameters that exist, with any value
            name = rng.choice(names).encode().ljust(16, b"\0")
            payload[4:23] = b"\1\1" + name + b"\x09"
        if number == 76 and n % 3:  # commands that it has, with any arguments
            payload[28:33] = struct.pack("<HBBB", rng.choice([SET_MODE, SET_INTERVAL, REQUEST, 510, 520]), 1, 1, 0)
            if n % 5 < 2:  # and some that make sense, so that the others meet a vehicle in every state
                payload[:8] = struct.pack("<ff", 1, rng.choice([0, 25, 25, 2, 5000]))
        if number == 185 and n % 3:
            payload = bytearray(struct.pack("<IBBB", rng.choice([START, STOP, n // 50]), 1, 155, rng.randrange(2)))
        body = struct.pack("<BBBBBBHB", len(payload), 0, 0, n % 256, 255, 190, number & 0xFFFF, number >> 16)
        body += payload.rstrip(b"\0") or b"\0"
        body = bytes([len(body) - 9]) + body[1:]
        checksum = mavlink.x25crc(bytearray(body + bytes([kind.crc_extra]))).crc
        station.link.to_vehicle.append((station.address, b"\xfd" + body + struct.pack("<H", checksum)))
        vehicle.step()
        station.server.poll()
    heard = station.take()
    assert sum(m.get_type() == "COMMAND_ACK" for m in heard) > 100
    assert sum(m.get_type() == "PARAM_VALUE" for m in heard) > 100
    assert any(m.get_type() == "REMOTE_LOG_DATA_BLOCK" for m in heard)
    assert "SystemID Starting: axis=10" in texts(heard)
    station.fly(1.1)
    assert station.take("HEARTBEAT")
    assert station.set("SID_T_REC", 12.5) == 12.5
    station.server.close()
    assert all(path.stat().st_size % 200 == 0 for path in tmp_path.glob("*.BIN"))


# Log blocks


class BlockReceiver:
    """The ground's half, as small as it can be: acknowledges what comes, refuses gaps."""

    def __init__(self, send: Callable[[Any], None]) -> None:
        self._send = send
        self.blocks: dict[int, bytes] = {}
        self.repeated = 0

    def take(self, message: Any) -> None:
        assert message.get_srcComponent() == 155
        number = message.seqno
        if number not in self.blocks:
            for missing in range(max(self.blocks, default=-1) + 1, number):
                self._send(receipt(missing, 0))
        else:
            self.repeated += 1
        self.blocks[number] = bytes(message.data)
        self._send(receipt(number))

    def whole(self) -> bytes:
        assert sorted(self.blocks) == list(range(len(self.blocks)))
        return b"".join(self.blocks[number] for number in range(len(self.blocks)))


def test_a_stream_opens_a_new_log_and_is_that_log(radio: Any, tmp_path: Path, read_log: Reader) -> None:
    vehicle = make_vehicle("hover", 1, directory=tmp_path)
    station = radio(vehicle)
    receiver = BlockReceiver(station.send)
    station.send(station.heartbeat(), receipt(START), receipt(START))
    for _ in range(1000):
        station.fly(0.002)
        for message in station.take("REMOTE_LOG_DATA_BLOCK"):
            assert (message.target_system, message.target_component) == (255, 190)
            receiver.take(message)
    station.send(receipt(STOP), receipt(STOP))
    for _ in range(100):
        station.fly(0.002)
        for message in station.take("REMOTE_LOG_DATA_BLOCK"):
            receiver.take(message)
    vehicle.close()
    assert sorted(path.name for path in tmp_path.iterdir()) == ["vehicle-1.BIN", "vehicle-2.BIN", "vehicle-3.BIN"]
    assert receiver.whole() == (tmp_path / "vehicle-2.BIN").read_bytes()
    assert receiver.repeated == 0
    log = read_log(tmp_path / "vehicle-2.BIN")
    kinds = [m.get_type() for m in log]
    assert kinds[0] == "FMT"
    assert kinds.index("MODE") < kinds.index("RATE")
    assert kinds.index("PARM") < kinds.index("RATE")
    assert kinds.count("RATE") == pytest.approx(1000, abs=2)
    # The three files hold every sample of the flight once.
    times = [m.TimeUS for n in (1, 2, 3) for m in read_log(tmp_path / f"vehicle-{n}.BIN") if m.get_type() == "RATE"]
    assert times == list(range(times[0], times[-1] + 1, 2000))


def test_a_silent_ground_loses_the_stream_and_the_file_goes_on(radio: Any, tmp_path: Path) -> None:
    vehicle = make_vehicle("hover", 1, directory=tmp_path, parameters={"FS_GCS_ENABLE": 0})
    station = radio(vehicle)
    station.send(station.heartbeat(), receipt(START))
    station.fly(10.2)
    assert "Log stream stopped: no acknowledgement for 10 s" in texts(station.take())
    station.take()
    before = (tmp_path / "vehicle-2.BIN").stat().st_size
    station.fly(1)
    assert station.take("REMOTE_LOG_DATA_BLOCK") == []
    assert (tmp_path / "vehicle-2.BIN").stat().st_size > before
    vehicle.close()


def test_no_stream_where_the_parameters_forbid_it_and_none_for_strangers(radio: Any, tmp_path: Path) -> None:
    vehicle = make_vehicle("hover", 1, directory=tmp_path, parameters={"LOG_BACKEND_TYPE": 1})
    station = radio(vehicle)
    station.send(receipt(START))
    station.fly(0.1)
    assert station.take("REMOTE_LOG_DATA_BLOCK") == []
    vehicle.write_parameter("LOG_BACKEND_TYPE", 3)
    station.send(receipt(START))
    station.fly(0.1)
    assert station.take("REMOTE_LOG_DATA_BLOCK")
    # Another peer's receipts do not count: the block comes again.
    station.send(*(receipt(n) for n in range(200)), receipt(STOP), address=("127.0.0.1", 40001))
    station.fly(0.15)
    assert vehicle.recording.stream is not None
    assert vehicle.recording.stream.open_blocks > 40
    vehicle.close()


def test_a_station_that_comes_back_gets_a_new_log(radio: Any, tmp_path: Path) -> None:
    vehicle = make_vehicle("hover", 1, directory=tmp_path)
    station = radio(vehicle)
    station.send(receipt(START))
    station.fly(1.5)
    station.take()
    station.heard.clear()
    station.send(receipt(START))
    station.fly(0.05)
    assert station.take("REMOTE_LOG_DATA_BLOCK")[0].seqno == 0
    vehicle.close()
    assert len(list(tmp_path.iterdir())) == 3


# Sockets


class Ground:
    """A pymavlink client on a real UDP socket."""

    def __init__(self, sock: socket.socket, peer: tuple[str, int] | None) -> None:
        self.socket = sock
        self.peer = peer
        self.mav = mavlink.MAVLink(None, 255, 190)
        self._decoder = mavlink.MAVLink(None)

    def send(self, message: Any) -> None:
        assert self.peer is not None
        self.socket.sendto(bytes(message.pack(self.mav)), self.peer)

    def receive(self) -> Iterator[Any]:
        while True:
            try:
                data, self.peer = self.socket.recvfrom(2048)
            except BlockingIOError:
                return
            yield self._decoder.decode(bytearray(data))


@pytest.fixture
def udp_pair() -> Iterator[tuple[Ground, Link]]:
    """A ground station's socket on a free port, and a vehicle's link that sends to it."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sock:
        sock.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 1 << 20)
        sock.bind(("127.0.0.1", 0))
        sock.setblocking(False)
        link = open_link(f"udpout:127.0.0.1:{sock.getsockname()[1]}")
        try:
            yield Ground(sock, None), link
        finally:
            link.close()


def test_blocks_over_udp_with_losses_and_an_outage_end_byte_identical(
    udp_pair: tuple[Ground, Link], tmp_path: Path
) -> None:
    """5 % lost either way and a second of nothing, on real sockets; time is the vehicle's, so nobody waits."""
    ground, link = udp_pair
    vehicle = make_vehicle("hover", 1, directory=tmp_path)
    loss = Loss(0.05, 11, [Outage(4.0, 5.0)])
    server = Server(vehicle, LossyLink(link, loss, lambda: vehicle.time_s))
    receiver = BlockReceiver(ground.send)
    stopping = False
    for turn in itertools.count():
        vehicle.step()
        server.poll()
        for message in ground.receive():
            if message.get_type() == "REMOTE_LOG_DATA_BLOCK":
                receiver.take(message)
        if ground.peer is None:
            continue
        if turn % 50 == 0 and not receiver.blocks:
            ground.send(receipt(START))
        if turn % 500 == 0:
            ground.send(mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 0, 3))
        if turn >= 3000 and turn % 50 == 0:
            stopping = True
            ground.send(receipt(STOP))
        if stopping and turn >= 4500:
            break
    assert vehicle.recording.stream is None
    server.close()
    logs = sorted(tmp_path.glob("*.BIN"), key=lambda path: path.stat().st_mtime)
    assert receiver.repeated > 50  # the air was bad indeed
    assert len(receiver.blocks) > 1400
    assert receiver.whole() in [path.read_bytes() for path in logs]


def test_udp_waiting_for_the_ground(hovering: Vehicle) -> None:
    link = open_link("udpin:127.0.0.1:0")
    server = Server(hovering, link)
    _, host, port = link.ground_link.split(":")
    assert link.ground_link.startswith("udpout:")
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sock:
        sock.settimeout(0)
        ground = Ground(sock, (host, int(port)))
        sock.sendto(b"hello?", (host, int(port)))
        for _ in range(600):
            hovering.step()
            server.poll()
        assert list(ground.receive()) == []
        ground.send(mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 0, 3))
        for _ in range(600):
            hovering.step()
            server.poll()
        assert {"HEARTBEAT", "ATTITUDE"} <= {m.get_type() for m in ground.receive()}
    server.close()


def test_tcp_serves_two_and_outlives_both(hovering: Vehicle) -> None:
    link = open_link("tcpin:127.0.0.1:0")
    server = Server(hovering, link)
    _, host, port = link.ground_link.split(":")
    decoder = mavlink.MAVLink(None)
    decoder.robust_parsing = True
    sockets = [socket.create_connection((host, int(port)), timeout=5) for _ in range(2)]
    try:
        for _ in range(600):
            hovering.step()
            server.poll()
        for sock in sockets:  # heard before they said anything
            kinds = {m.get_type() for m in decoder.parse_buffer(sock.recv(1 << 16)) or []}
            assert "HEARTBEAT" in kinds
        sockets[0].close()
        packed = mavlink.MAVLink_command_long_message(1, 1, SET_MODE, 0, 1, 2, 0, 0, 0, 0, 0).pack(decoder)
        sockets[1].sendall(bytes(packed[:9]))
        server.poll()
        sockets[1].sendall(bytes(packed[9:]))
        for _ in range(2500):
            if hovering.mode is Mode.ALT_HOLD:
                break
            hovering.step()
            server.poll()
        assert hovering.mode is Mode.ALT_HOLD
    finally:
        for sock in sockets:
            sock.close()
        for _ in range(20):
            server.poll()
        server.close()


@pytest.mark.skipif(os.name != "posix", reason="pseudo terminals are POSIX")
def test_a_serial_line_carries_it_too(hovering: Vehicle) -> None:
    link = open_link("pty")
    server = Server(hovering, link)
    path, _ = link.ground_link.split(",")
    far = os.open(path, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
    try:
        decoder = mavlink.MAVLink(None)
        decoder.robust_parsing = True
        for _ in range(600):
            hovering.step()
            server.poll()
        assert "HEARTBEAT" in {m.get_type() for m in decoder.parse_buffer(os.read(far, 1 << 16)) or []}
        os.write(far, bytes(mavlink.MAVLink_command_long_message(1, 1, SET_MODE, 0, 1, 2, *(0,) * 5).pack(decoder)))
        for _ in range(5):
            server.poll()
        assert hovering.mode is Mode.ALT_HOLD
    finally:
        os.close(far)
        server.close()


@pytest.mark.parametrize(
    "word", ["", "udp", "udpout:14550", "tcp:127.0.0.1:5760", "udpin:127.0.0.1:x", "udpin:127.0.0.1:99999"]
)
def test_words_that_are_no_link_are_named(word: str) -> None:
    with pytest.raises(LinkError):
        open_link(word)


def test_a_taken_port_is_named() -> None:
    first = open_link("udpin:127.0.0.1:0")
    try:
        with pytest.raises(LinkError, match="another port"):
            open_link(first.name)
    finally:
        first.close()
