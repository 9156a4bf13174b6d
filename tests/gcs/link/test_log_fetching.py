"""Logs off a vehicle as conversations in fake time: identical bytes whatever the air does; nothing hostile raises."""

from __future__ import annotations

import random
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from fetched import Air, FileSession, FileVehicle, noise
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from gcs.link.decode import decode
from gcs.link.encode import Encoder, FtpRequest, LogDataRequest, LogEnd
from gcs.link.events import Event, FtpReply, LogData, LogEntry, StatusText
from gcs.link.ftp import FileChecksum, ListFolder, ReadFile, checksum
from gcs.link.log_files import EndLogs, ListLogs, ReadLog
from gcs.link.pieces import Pieces
from gcs.link.procedures import Failed, NoAnswerError, RefusedError

PATH = "logs/00000001.BIN"
AIRS = {
    "clean": Air(),
    "2 %": Air(loss=0.02),
    "10 %": Air(loss=0.10),
    "out of order": Air(late=0.2),
    "twice": Air(doubled=0.2),
    "a lag of 0.7 s": Air(lag_s=0.7, loss=0.01),
    "all at once": Air(loss=0.05, late=0.1, doubled=0.1, lag_s=0.05),
    "an outage of 20 s": Air(loss=0.02, outage=(100.3, 120.3)),
}
SIZE = 150_001


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "vehicle-1.BIN").write_bytes(noise(SIZE))
    return tmp_path


def read(way: str, store: Callable[[bytes], Any], start: int = 0, stop: int = SIZE) -> Any:
    if way == "ftp":
        return ReadFile(PATH, store, start=start, stop=stop)
    return ReadLog(1, store, start=start, stop=stop)


@pytest.mark.parametrize("air", AIRS)
@pytest.mark.parametrize("way", ["ftp", "log"])
def test_the_bytes_are_the_vehicles_whatever_the_air_does(way: str, air: str, folder: Path) -> None:
    session = FileSession(FileVehicle(folder, AIRS[air]))
    came = bytearray()
    session.call(read(way, came.extend))
    assert bytes(came) == noise(SIZE)


@pytest.mark.parametrize("way", ["ftp", "log"])
@pytest.mark.parametrize(("start", "stop"), [(0, 1), (77, 400), (1234, 99_000), (SIZE - 1, SIZE), (5, 5)])
def test_any_stretch_can_be_had(way: str, start: int, stop: int, folder: Path) -> None:
    session = FileSession(FileVehicle(folder, Air(loss=0.02)))
    came = bytearray()
    session.call(read(way, came.extend, start, stop))
    assert bytes(came) == noise(SIZE)[start:stop]


def test_a_vehicle_that_restarts_meanwhile_is_gone_on_with(folder: Path) -> None:
    vehicle = FileVehicle(folder)
    session, came = FileSession(vehicle), bytearray()

    def restart_once(_: FileVehicle) -> None:
        if len(came) > 30_000:
            vehicle.restart()
            session.meanwhile = lambda _: None

    session.meanwhile = restart_once
    session.call(ReadFile(PATH, came.extend))
    assert bytes(came) == noise(SIZE)


def test_little_comes_twice_where_nothing_is_lost(folder: Path) -> None:
    vehicle = FileVehicle(folder)
    FileSession(vehicle).call(ReadLog(1, lambda data: None, start=0, stop=SIZE))
    assert vehicle.sent_of_logs <= -(-SIZE // 90) + 2  # a stretch need not end with a whole piece


# Lists and checksums


@pytest.mark.parametrize("loss", [0.0, 0.1])
def test_logs_are_listed(loss: float, tmp_path: Path) -> None:
    sizes = {number: 10 * number for number in (2, 3, *range(5, 40))}
    for number, size in sizes.items():
        (tmp_path / f"vehicle-{number}.BIN").write_bytes(bytes(size))
    session = FileSession(FileVehicle(tmp_path, Air(loss=loss)))
    assert [entry.size for entry in session.call(ListLogs())] == list(sizes.values())
    session.wait(0.2)
    entries = session.call(ListFolder("logs"))
    assert {int(entry.name[:8]): entry.size for entry in entries} == sizes
    session.wait(0.2)
    with pytest.raises(RefusedError, match="no such file"):
        session.call(ListFolder("/APM/LOGS"))


def test_a_vehicle_without_logs_lists_none(tmp_path: Path) -> None:
    session = FileSession(FileVehicle(tmp_path))
    assert session.call(ListLogs()) == ()
    assert session.call(ListFolder("logs")) == ()


def test_the_checksum_is_the_vehicles(folder: Path) -> None:
    session = FileSession(FileVehicle(folder, Air(loss=0.3)))
    assert session.call(FileChecksum(PATH)) == checksum(noise(SIZE))
    # as autopilots count: no inversion at either end
    assert checksum(b"123456789") == 0x2DFD2D88
    assert checksum(b"6789", checksum(b"12345")) == checksum(b"123456789")
    assert checksum(b"123456789") != zlib.crc32(b"123456789")


# Refused


def test_an_armed_vehicle_refuses_in_its_own_words(folder: Path) -> None:
    vehicle = FileVehicle(folder)
    vehicle.vehicle.armed = True
    session = FileSession(vehicle)
    with pytest.raises(RefusedError, match="Disarm for log download"):
        session.call(ListLogs())
    session.wait(6.0)
    with pytest.raises(RefusedError, match="Disarm for log download"):
        session.call(ReadLog(1, lambda data: None, start=0, stop=SIZE))


@pytest.mark.parametrize("way", ["ftp", "log"])
def test_a_log_that_vanishes_is_refused(way: str, folder: Path) -> None:
    session, came = FileSession(FileVehicle(folder)), bytearray()

    def vanish(vehicle: FileVehicle) -> None:
        if came:
            (folder / "vehicle-1.BIN").unlink(missing_ok=True)

    session.meanwhile = vanish
    with pytest.raises((RefusedError, NoAnswerError)):
        session.call(read(way, came.extend))
    assert bytes(came) == noise(SIZE)[: len(came)]


@pytest.mark.parametrize("way", ["ftp", "log"])
def test_a_log_that_is_shorter_than_told_ends(way: str, folder: Path) -> None:
    session, came = FileSession(FileVehicle(folder)), bytearray()

    def cut(vehicle: FileVehicle) -> None:
        (folder / "vehicle-1.BIN").write_bytes(noise(SIZE)[:60_000])

    session.meanwhile = cut
    with pytest.raises((RefusedError, NoAnswerError)):
        session.call(read(way, came.extend))
    assert bytes(came) == noise(SIZE)[:60_000]


def test_a_vehicle_without_files_is_not_waited_for_long(folder: Path) -> None:
    session = FileSession(FileVehicle(folder, ways=()))
    for procedure in (ListLogs(), ListFolder("logs"), ReadFile(PATH, lambda data: None)):
        began = session.now()
        with pytest.raises(NoAnswerError):
            session.call(procedure)
        assert session.now() - began < 13.0


def test_another_stations_session_is_waited_for_and_then_named(folder: Path) -> None:
    vehicle = FileVehicle(folder)
    session = FileSession(vehicle)
    vehicle.tell([FtpRequest(number=7, session=5, opcode=4, data=PATH.encode() + b"\0")])
    session.wait(0.1)
    session.call(ReadFile(PATH, lambda data: None))  # after 3 s of its silence
    vehicle.tell([FtpRequest(number=9, session=6, opcode=4, data=PATH.encode() + b"\0")])

    def busy(_: FileVehicle) -> None:
        vehicle.tell([FtpRequest(number=random.randrange(65536), session=6, opcode=5, size=10)])

    session.wait(0.1)
    session.meanwhile = busy
    with pytest.raises(RefusedError, match="another ground station"):
        session.call(ReadFile(PATH, lambda data: None))


def test_what_was_abandoned_goes_on_until_it_is_ended(folder: Path) -> None:
    vehicle = FileVehicle(folder)
    session = FileSession(vehicle)
    vehicle.tell([LogDataRequest(1, 0, SIZE)])
    session.wait(0.1)
    before = vehicle.sent_of_logs
    session.wait(0.05)
    assert vehicle.sent_of_logs > before
    session.call(EndLogs())
    before = vehicle.sent_of_logs
    session.wait(0.5)
    assert vehicle.sent_of_logs == before


def test_a_list_is_had_behind_an_abandoned_download(folder: Path) -> None:
    vehicle = FileVehicle(folder)
    session = FileSession(vehicle)
    vehicle.tell([LogDataRequest(1, 0, SIZE)])
    session.wait(0.02)
    assert [entry.size for entry in session.call(ListLogs())] == [SIZE]


@pytest.mark.parametrize("make", [lambda: ListLogs(), lambda: read("log", lambda data: None)])
def test_the_end_is_said_however_it_goes(make: Callable[[], Any], folder: Path) -> None:
    vehicle = FileVehicle(folder, ways=())
    procedure = make()
    procedure.start(0.0)
    said: list[Any] = []
    now = 0.0
    while procedure.outcome is None and now < 200.0:
        now += 0.1
        said = procedure.poll(now) or said
    assert isinstance(procedure.outcome, Failed)
    assert LogEnd() in said
    assert vehicle.sent_of_logs == 0


# Hostile


def procedures() -> list[Any]:
    return [
        ListFolder("logs"), FileChecksum(PATH), ReadFile(PATH, lambda data: None),
        ReadFile(PATH, lambda data: None, start=1000, stop=5000), ListLogs(),
        ReadLog(1, lambda data: None, start=0, stop=100_000), ReadLog(1, lambda data: None, start=0, stop=2**32 - 1),
        EndLogs(),
    ]  # fmt: skip


def hostile(rng: random.Random, asked: list[Any]) -> Event | None:
    """A message with random fields, often of those that were asked for."""
    near = rng.choice([0, 1, 89, 90, 239, 5000, 2**31, 2**32 - 1])
    data = rng.randbytes(rng.choice([0, 1, 4, 90, 239]))
    request = next((send for send in reversed(asked) if isinstance(send, FtpRequest)), None)
    match rng.randrange(5):
        case 0:
            return LogData(1, 1, rng.choice([0, 1, 2, 65535]), near, data[:90])
        case 1:
            count = rng.choice([0, 1, 3, 65535])
            return LogEntry(1, 1, id=rng.choice([0, 1, 2, 3, 65535]), count=count, size=near, utc_s=near)
        case 2:
            return StatusText(1, 1, 3, rng.choice(["Log download in progress", "Disarm", "[/]"]))
        case 3:
            message = mavlink.MAVLink_file_transfer_protocol_message(0, 254, 190, rng.randbytes(251))
            return decode(mavlink.MAVLink(None).decode(bytearray(message.pack(mavlink.MAVLink(None, 1, 1)))))
        case _:
            return FtpReply(
                1, 1, target_system=254, target_component=190,
                number=rng.randrange(65536) if request is None else request.number + rng.choice([0, 1, 1, 1, 2]),
                session=rng.choice([0, 113, 255]), ack=rng.random() < 0.8,
                answers=rng.randrange(256) if request is None else request.opcode,
                burst_complete=rng.random() < 0.1, offset=near, data=data,
            )  # fmt: skip


@pytest.mark.parametrize("seed", range(6))
def test_nothing_hostile_raises_or_floods(seed: int) -> None:
    rng, encoder = random.Random(seed), Encoder(254)
    for procedure in procedures():
        now, asked = 50.0, list(procedure.start(50.0))
        for _ in range(300):
            event = hostile(rng, asked)
            sends = [] if event is None else procedure.on_event(event, now)
            now += rng.random() * 0.05
            sends = [*sends, *procedure.poll(now)]
            assert len(sends) < 20
            for send in sends:
                encoder.encode(send)
            asked = [*asked, *sends][-20:]


def test_lengths_that_lie_are_clamped() -> None:
    parser, mav = mavlink.MAVLink(None), mavlink.MAVLink(None, 1, 1)
    message = mavlink.MAVLink_log_data_message(1, 0, 255, bytes(range(90)))
    event = decode(parser.decode(bytearray(message.pack(mav))))
    assert isinstance(event, LogData)
    assert event.data == bytes(range(90))
    payload = bytes([1, 0, 0, 128, 255, 5, 0, 0, 0, 0, 0, 0]) + bytes(239)
    message = mavlink.MAVLink_file_transfer_protocol_message(0, 254, 190, payload)
    reply = decode(parser.decode(bytearray(message.pack(mav))))
    assert isinstance(reply, FtpReply)
    assert len(reply.data) == 239


@pytest.mark.parametrize("seed", range(4))
def test_pieces_come_out_in_order_whatever_goes_in(seed: int) -> None:
    rng, content = random.Random(seed), noise(3000, seed)
    pieces, out = Pieces(100, 2900), bytearray()
    while not pieces.whole:
        at = rng.randrange(0, 3000)
        out += pieces.add(at, content[at : at + rng.randrange(1, 300)])
        covered = sum(stop - start for start, stop in pieces.missing)
        assert pieces.at == (pieces.missing[0][0] if pieces.missing else pieces.highest)
        assert covered <= pieces.highest - pieces.at
    assert bytes(out) == content[100:2900]
    assert not pieces.missing
