"""`@PARAM/param.pck`: read as ground stations read it, decoded by pymavlink's own client."""

from __future__ import annotations

import struct
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from pymavlink.mavftp import MAVFTP

from sitl.autopilot.parameters import Kind
from sitl.autopilot.vehicle import make_vehicle
from sitl.protocol.param_file import Entry, Part, packed, part_of

TERMINATE, OPEN, READ, BURST = 1, 4, 5, 15
ACK, NAK = 128, 129


@pytest.fixture
def station(radio: Callable[..., Any], tmp_path: Path) -> Any:
    """A ground station that a stock helicopter on the ground has met; one parameter has been changed."""
    made = radio(make_vehicle("hover-ideal", 1, directory=tmp_path, on_ground=True, like="ardupilot-heli"))
    made.vehicle.write_parameter("LOG_BITMASK", 180223)
    made.ask(made.heartbeat())
    return made


class Files:
    """Requests in their order, each answered before the next."""

    def __init__(self, station: Any) -> None:
        self.station = station
        self.number = 0

    def ask(self, opcode: int, *, offset: int = 0, size: int = 0, data: bytes = b"") -> list[tuple[int, int, bytes]]:
        """Opcode, offset and data of each answer."""
        self.number += 700
        head = struct.pack("<HBBBBBxI", self.number & 0xFFFF, 1, opcode, len(data) or size, 0, 0, offset)
        payload = (head + data).ljust(251, b"\0")
        self.station.take()
        self.station.send(mavlink.MAVLink_file_transfer_protocol_message(0, 1, 1, payload))
        self.station.fly(0.1)
        answers = [bytes(message.payload) for message in self.station.take("FILE_TRANSFER_PROTOCOL")]
        return [(raw[3], struct.unpack_from("<I", raw, 8)[0], raw[12 : 12 + raw[4]]) for raw in answers]

    def burst(self, name: bytes, size: int) -> bytes:
        """The file in reads of `size`."""
        ((opened, _, _),) = self.ask(OPEN, data=name)
        assert opened == ACK
        *pieces, end = self.ask(BURST, size=size)
        content = b"".join(data for _, _, data in pieces)
        assert end == (NAK, len(content), b"\x06"), "the end is told behind the last packet"
        self.ask(TERMINATE)
        return content


@pytest.mark.parametrize("size", [239, 80, 31])
def test_it_is_the_list_whatever_the_reads(size: int, station: Any) -> None:
    parameters = station.vehicle.parameters
    decoded = MAVFTP.ftp_param_decode(Files(station).burst(b"@PARAM/param.pck\0", size))
    values = {name.decode(): value for name, value, _ in decoded.params}
    assert values == {name: parameters[name] for name in parameters.visible()}
    assert decoded.defaults is None


def test_defaults_come_where_they_are_asked_for(station: Any) -> None:
    decoded = MAVFTP.ftp_param_decode(Files(station).burst(b"@PARAM/param.pck?withdefaults=1\0", 239))
    values, defaults = (
        {name.decode(): value for name, value, _ in each} for each in (decoded.params, decoded.defaults)
    )
    assert (values["LOG_BITMASK"], defaults["LOG_BITMASK"]) == (180223, 180222)
    assert {name for name in values if values[name] != defaults[name]} == {"LOG_BITMASK"}


def test_a_part_counts_from_its_start(station: Any) -> None:
    content = Files(station).burst(b"@PARAM/param.pck?start=3&count=5\0", 239)
    names = station.vehicle.parameters.visible()
    assert struct.unpack_from("<HHH", content) == (0x671B, 5, len(names))
    assert names[3].encode() in content, "the first name is whole"
    assert content.startswith(packed([], Part(), 239)[:2])


def test_other_reads_than_the_first_fail(station: Any) -> None:
    files = Files(station)
    files.ask(OPEN, data=b"@PARAM/param.pck\0")
    ((_, _, first),) = files.ask(READ, size=80)
    assert len(first) == 80
    assert files.ask(READ, offset=80, size=30) == [(NAK, 80, b"\x02\x16")]
    ((code, _, again),) = files.ask(READ, size=80)
    assert (code, again) == (ACK, first)


@pytest.mark.parametrize("query", [b"start=65535", b"withdefaults=2", b"count=x"])
def test_what_is_out_of_range_cannot_be_opened(query: bytes, station: Any) -> None:
    assert Files(station).ask(OPEN, data=b"@PARAM/param.pck?" + query + b"\0") == [(NAK, 0, b"\x02\x16")]


def test_only_its_own_name_is_meant() -> None:
    assert part_of("/@PARAM/param.pck?count=2&start=1") == Part(1, 2)
    assert part_of("@PARAM/param.pck") == Part()
    assert (part_of("logs/param.pck"), part_of("@PARAM/param.pckx")) == (None, None)


def test_no_value_lies_across_two_reads() -> None:
    """The layout by hand: AB and ABC share two letters; A's rest is its last letter again; a float at byte 14 of 16."""
    entries = [
        Entry("AB", Kind.INT8, -2, -2),
        Entry("ABC", Kind.REAL32, 1.5, 1.5),
        Entry("A", Kind.INT16, 258, 258),
    ]
    head = struct.pack("<HHH", 0x671B, 3, 3)
    first, second = b"\x01\x10AB\xfe", b"\x04\x02C" + struct.pack("<f", 1.5)
    third = b"\x02\x00A\x02\x01"
    assert packed(entries, Part(), 239) == head + first + second + third
    assert packed(entries, Part(), 16) == head + first + b"\0\0" + second + third


# What goes with them


def test_short_stretches_asked_for_at_once_are_all_sent(radio: Callable[..., Any], tmp_path: Path) -> None:
    """As MAVProxy fills the gaps of its log download: up to 20 requests, one behind the other."""
    (tmp_path / "vehicle-1.BIN").write_bytes(bytes(range(250)) * 200)
    station = radio(make_vehicle("hover-ideal", 1, directory=tmp_path, on_ground=True))
    station.ask(station.heartbeat())
    station.take()
    offsets = [900 * i for i in range(20)]
    station.send(*(mavlink.MAVLink_log_request_data_message(1, 1, 1, offset, 90) for offset in offsets))
    station.fly(0.1)
    assert [m.ofs for m in station.take("LOG_DATA")] == offsets


def test_a_list_of_some_entries_says_which_is_its_last(radio: Callable[..., Any], tmp_path: Path) -> None:
    for number in (1, 2, 3):
        (tmp_path / f"vehicle-{number}.BIN").write_bytes(bytes(number))
    station = radio(make_vehicle("hover-ideal", 1, directory=tmp_path, on_ground=True))
    station.ask(station.heartbeat())
    station.send(mavlink.MAVLink_log_request_list_message(1, 1, 0, 2))
    station.fly(0.02)
    assert [(m.id, m.num_logs, m.last_log_num) for m in station.take("LOG_ENTRY")] == [(1, 3, 2), (2, 3, 2)]
