"""The vehicle's logs over the link: LOG_* and MAVFTP as ArduPilot answers them, judged by packets."""

from __future__ import annotations

import struct
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sitl.autopilot.storage import LogStorage
from sitl.autopilot.vehicle import make_vehicle

CONTENT = bytes(i * 31 % 251 for i in range(200_000))
LIST, OPEN, READ, CRC, BURST, TERMINATE, RESET, WRITE = 3, 4, 5, 14, 15, 1, 2, 7
ACK, NAK = 128, 129


def request(number: int, opcode: int, *, session: int = 1, offset: int = 0, size: int = 0, data: bytes = b"") -> Any:
    head = struct.pack("<HBBBBBxI", number, session, opcode, len(data) or size, 0, 0, offset)
    return mavlink.MAVLink_file_transfer_protocol_message(0, 1, 1, (head + data).ljust(251, b"\0"))


def fields(message: Any) -> tuple[int, int, int, int, bool, int, bytes]:
    """Number, session, opcode, opcode answered, burst complete, offset, data."""
    payload = bytes(message.payload)
    number, session, opcode, size, answers, complete, offset = struct.unpack_from("<HBBBBBxI", payload)
    return number, session, opcode, answers, bool(complete), offset, payload[12 : 12 + size]


@pytest.fixture
def station(radio: Callable[..., Any], tmp_path: Path) -> Any:
    """A ground station that a vehicle on the ground has met; it has logs 3 and 12."""
    (tmp_path / "vehicle-3.BIN").write_bytes(CONTENT[:5000])
    (tmp_path / "vehicle-12.BIN").write_bytes(CONTENT)
    made = radio(make_vehicle("hover-ideal", 1, directory=tmp_path, on_ground=True))
    made.ask(made.heartbeat())
    return made


def ftp(station: Any, *messages: Any, seconds: float = 0.02) -> list[Any]:
    station.take()
    station.heard.clear()
    station.send(*messages)
    station.fly(seconds)
    return [fields(message) for message in station.take("FILE_TRANSFER_PROTOCOL")]


def test_it_says_that_it_has_files(station: Any) -> None:
    version = station.ask(
        mavlink.MAVLink_command_long_message(1, 1, 512, 0, 148, 0, 0, 0, 0, 0, 0), kind="AUTOPILOT_VERSION"
    )
    assert version[0].capabilities & 32
    station.vehicle.storage = LogStorage(station.vehicle.directory, ("log",))
    version = station.ask(
        mavlink.MAVLink_command_long_message(1, 1, 512, 0, 148, 0, 0, 0, 0, 0, 0), kind="AUTOPILOT_VERSION"
    )
    assert not version[0].capabilities & 32
    assert ftp(station, request(1, LIST, data=b"logs\0")) == []


def test_entries_are_counted_from_the_oldest(station: Any) -> None:
    station.send(mavlink.MAVLink_log_request_list_message(1, 1, 0, 0xFFFF))
    station.fly(0.02)
    entries = station.take("LOG_ENTRY")
    assert [(m.id, m.num_logs, m.last_log_num, m.size) for m in entries] == [(1, 2, 2, 5000), (2, 2, 2, 200_000)]


def test_a_stretch_of_a_log_is_sent_in_slices_beside_telemetry(station: Any) -> None:
    station.take()
    station.heard.clear()
    station.send(mavlink.MAVLink_log_request_data_message(1, 1, 2, 100, 100_000))
    station.fly(0.2)
    under_way = station.take("LOG_DATA")
    assert 300 < len(under_way) < 100_000 // 90
    station.send(mavlink.MAVLink_log_request_data_message(1, 1, 1, 0, 10))  # dropped: one at a time
    station.fly(1.0)
    pieces = [*under_way, *station.take("LOG_DATA")]
    assert {m.id for m in pieces} == {2}
    assert [m.ofs for m in pieces] == list(range(100, 100_100, 90))
    assert b"".join(bytes(m.data[: m.count]) for m in pieces) == CONTENT[100:100_100]
    assert len(station.take("ATTITUDE")) >= 11


def test_the_end_of_a_log_is_a_short_piece(station: Any) -> None:
    station.send(mavlink.MAVLink_log_request_data_message(1, 1, 1, 4950, 1000))
    station.fly(0.02)
    (piece,) = station.take("LOG_DATA")
    assert (piece.count, bytes(piece.data[:50])) == (50, CONTENT[4950:5000])


def test_a_download_goes_on_until_its_end_is_said(station: Any) -> None:
    station.send(mavlink.MAVLink_log_request_data_message(1, 1, 2, 0, 200_000))
    station.fly(0.05)
    assert station.take("LOG_DATA")
    station.send(mavlink.MAVLink_log_request_end_message(1, 1))
    station.fly(0.01)
    station.take("LOG_DATA")
    station.fly(0.2)
    assert station.take("LOG_DATA") == []


def test_while_armed_it_refuses_and_says_so_once(station: Any) -> None:
    assert station.vehicle.take_off() is None
    for _ in range(3):
        station.send(mavlink.MAVLink_log_request_list_message(1, 1, 0, 0xFFFF))
        station.fly(0.1)
    assert station.take("LOG_ENTRY") == []
    assert [m.text for m in station.take("STATUSTEXT")].count("Disarm for log download") == 1
    station.vehicle.close()


def test_nothing_is_erased(station: Any) -> None:
    station.send(mavlink.MAVLink_log_erase_message(1, 1))
    station.fly(0.02)
    assert any("Erasing" in m.text for m in station.take("STATUSTEXT"))
    assert sorted(path.name for path in station.vehicle.directory.iterdir()) == ["vehicle-12.BIN", "vehicle-3.BIN"]


def test_a_folder_is_listed_by_entries(station: Any) -> None:
    number, session, opcode, answers, _, _, data = ftp(station, request(5, LIST, session=0, data=b"logs\0"))[0]
    assert (number, session, opcode, answers) == (6, 0, ACK, LIST)
    assert data == b"F00000003.BIN\t5000\0F00000012.BIN\t200000\0"
    assert ftp(station, request(7, LIST, offset=1, data=b"/logs\0"))[0][6] == b"F00000012.BIN\t200000\0"
    assert ftp(station, request(9, LIST, offset=2, data=b"logs\0"))[0][2:] == (NAK, LIST, False, 2, b"\x06")
    assert ftp(station, request(11, LIST, data=b"elsewhere\0"))[0][6] == b"\x0a"
    assert ftp(station, request(13, LIST, data=b"/\0"))[0][6] == b"Dlogs\0D@PARAM\0"


def test_a_file_is_opened_read_and_closed(station: Any) -> None:
    name = b"logs/00000012.BIN\0"
    (opened,) = ftp(station, request(1, OPEN, data=name))
    assert (opened[2], struct.unpack("<I", opened[6])[0]) == (ACK, 200_000)
    assert ftp(station, request(1, OPEN, data=name)) == [opened], "asked again, answered again"
    answers = ftp(station, *(request(3 + 2 * i, READ, offset=239 * i, size=239) for i in range(7)))
    assert [answer[5] for answer in answers] == [239 * i for i in range(5)], "five wait, the others are lost"
    assert b"".join(answer[6] for answer in answers) == CONTENT[: 5 * 239]
    assert ftp(station, request(31, READ, offset=200_000, size=9))[0][6] == b"\x06"
    assert ftp(station, request(33, READ, session=9, offset=0, size=9))[0][6] == b"\x04"
    assert ftp(station, request(35, OPEN, session=9, data=name))[0][6] == b"\x05"
    assert ftp(station, request(37, TERMINATE))[0][2] == ACK
    assert ftp(station, request(39, READ, offset=0, size=9))[0][6] == b"\x0a"
    assert ftp(station, request(41, OPEN, data=b"logs/00000004.BIN\0"))[0][6] == b"\x0a"
    assert ftp(station, request(43, OPEN, data=b"logs/../vehicle-3.BIN\0"))[0][6] == b"\x0a"
    assert ftp(station, request(45, WRITE, data=b"x"))[0][6] == b"\x07"


def test_a_burst_is_500_packets_and_counts_on(station: Any) -> None:
    ftp(station, request(1, OPEN, data=b"logs/00000012.BIN\0"))
    answers = ftp(station, request(100, BURST, offset=1000, size=239), seconds=1.0)
    assert [answer[0] for answer in answers] == list(range(101, 601))
    assert b"".join(answer[6] for answer in answers) == CONTENT[1000 : 1000 + 500 * 239]
    assert [answer[4] for answer in answers] == [False] * 499 + [True]
    rest = ftp(station, request(700, BURST, offset=199_000, size=239), seconds=0.1)
    assert b"".join(answer[6] for answer in rest if answer[2] == ACK) == CONTENT[199_000:]


def test_a_silent_session_is_given_to_another(station: Any) -> None:
    ftp(station, request(1, OPEN, data=b"logs/00000003.BIN\0"))
    assert ftp(station, request(3, OPEN, session=2, data=b"logs/00000003.BIN\0"))[0][2] == NAK
    station.fly(3.1)
    assert ftp(station, request(5, OPEN, session=2, data=b"logs/00000003.BIN\0"))[0][2] == ACK
    assert ftp(station, request(7, RESET, session=0))[0][2] == ACK
    assert ftp(station, request(9, OPEN, session=3, data=b"logs/00000003.BIN\0"))[0][2] == ACK


def test_the_checksum_is_the_one_without_inversion(station: Any) -> None:
    (station.vehicle.directory / "vehicle-13.BIN").write_bytes(b"123456789")
    assert struct.unpack("<I", ftp(station, request(1, CRC, data=b"logs/00000013.BIN\0"))[0][6])[0] == 0x2DFD2D88
