"""Signed links: five kinds of bad frames are refused and counted at both ends, and the time never goes backwards."""

from __future__ import annotations

import json
import os
import socket
import threading
from collections import Counter
from pathlib import Path
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from gcs.errors import UsageError
from gcs.link.encode import Encoder, StationHeartbeat
from gcs.link.frames import FrameFinder
from gcs.link.key_file import KeptStamps, drawn, of_passphrase, read_key, signing_with, write_key
from gcs.link.signing import AHEAD, EPOCH_S, UNITS_PER_S, Refusal, Signing
from gcs.link.transport import open_transport
from sitl.protocol.signatures import Signatures

KEY, OTHER = bytes(range(32)), bytes(32)
NOW = 1_800_000_000.0
BEAT = mavlink.MAVLink_heartbeat_message(4, 3, 0, 0, 4, 3)


class Stamps:
    link_id = 7

    def __init__(self, kept: int = 0) -> None:
        self.kept = kept

    def at_least(self) -> int:
        return self.kept

    def keep(self, stamp: int) -> None:
        self.kept = max(self.kept, stamp + AHEAD)


def units(seconds: float) -> int:
    return int((seconds - EPOCH_S) * UNITS_PER_S)


def signed(message: Any, *, key: bytes = KEY, at: float = NOW, link_id: int = 3, system: int = 1) -> bytes:
    """By pymavlink."""
    mav = mavlink.MAVLink(None, srcSystem=system, srcComponent=1)
    mav.signing.secret_key, mav.signing.sign_outgoing = key, True
    mav.signing.link_id, mav.signing.timestamp = link_id, units(at)
    return bytes(message.pack(mav))


def plain(message: Any, *, version: int = 2) -> bytes:
    return bytes(message.pack(mavlink.MAVLink(None, srcSystem=1, srcComponent=1), force_mavlink1=version == 1))


def tampered() -> bytes:
    """Another mode, and a checksum that is right again: only the signature can tell."""
    frame = bytearray(signed(BEAT, at=NOW + 5))
    frame[10] = 9
    frame[-15:-13] = mavlink.x25crc(bytes([*frame[1:-15], mavlink.MAVLink_heartbeat_message.crc_extra])).crc.to_bytes(
        2, "little"
    )
    return bytes(frame)


def bad_frames() -> dict[str, bytes]:
    return {
        "unsigned": plain(BEAT),
        "MAVLink 1": plain(BEAT, version=1),
        "wrongly signed": signed(BEAT, key=OTHER, at=NOW + 5),
        "tampered": tampered(),
        "replayed": signed(BEAT),
        "too old": signed(BEAT, at=NOW - 61, link_id=4),
    }


COUNTED = {
    "unsigned": 1,
    "MAVLink 1": 1,
    "wrongly signed": 2,  # the tampered one is among them
    "replayed": 1,
    "too old": 1,
}


def test_bad_frames_are_refused_and_counted_on_the_ground() -> None:
    signing = Signing(KEY, Stamps(), wall_clock=lambda: NOW)
    finder = FrameFinder(signing)
    assert len(finder.feed(signed(BEAT))) == 1
    for kind, frame in bad_frames().items():
        assert finder.feed(frame) == [], kind
    assert {str(why): count for why, count in signing.refused.items()} == COUNTED
    assert len(finder.feed(signed(BEAT, at=NOW + 1))) == 1, "the good ones go on"


def test_bad_frames_are_refused_and_counted_on_board() -> None:
    signatures, parser = Signatures(KEY, lambda: NOW), mavlink.MAVLink(None)
    assert signatures.accept(parser.decode(bytearray(signed(BEAT))))
    for kind, frame in bad_frames().items():
        assert not signatures.accept(parser.decode(bytearray(frame))), kind
    assert signatures.refused == Counter(COUNTED)
    assert signatures.accept(parser.decode(bytearray(signed(BEAT, at=NOW + 1))))


def test_a_forged_frame_of_the_future_shuts_nobody_out() -> None:
    """pymavlink by itself notes the time first, and hears nothing of the vehicle afterwards."""
    signing = Signing(KEY, Stamps(), wall_clock=lambda: NOW)
    finder, far = FrameFinder(signing), signed(BEAT, key=OTHER, at=NOW + 1e8)
    assert [len(finder.feed(frame)) for frame in (signed(BEAT), far, signed(BEAT, at=NOW + 1))] == [1, 0, 1]
    signatures, parser = Signatures(KEY, lambda: NOW), mavlink.MAVLink(None)
    said = [signatures.accept(parser.decode(bytearray(f))) for f in (signed(BEAT), far, signed(BEAT, at=NOW + 1))]
    assert said == [True, False, True]


def test_a_radio_without_a_key_is_heard_and_nothing_else_of_its_kind() -> None:
    signing = Signing(KEY, Stamps(), wall_clock=lambda: NOW)
    finder = FrameFinder(signing)
    radio = mavlink.MAVLink_radio_status_message(180, 175, 90, 40, 38, 12, 0)
    assert len(finder.feed(plain(radio))) == 1
    assert finder.feed(signed(radio, key=OTHER)) == []
    assert signing.refused == Counter({Refusal.WRONG: 1})


def test_messages_that_no_dialect_knows_need_the_key_too() -> None:
    signing = Signing(KEY, Stamps(), wall_clock=lambda: NOW)
    finder = FrameFinder(signing)
    unknown = bytes([0xFD, 1, 0, 0, 0, 1, 1, 0xFE, 0xFF, 0x7F, 5, 0, 0])
    assert finder.feed(unknown) == []
    assert signing.refused[Refusal.UNSIGNED] == 0  # it says nothing, with or without a key
    assert len(finder.feed(signed(BEAT))) == 1


def test_both_ends_understand_each_other() -> None:
    ground = Signing(KEY, Stamps(), wall_clock=lambda: NOW)
    vehicle = Signatures(KEY, lambda: NOW)
    encoder, parser = Encoder(254, signing=ground), mavlink.MAVLink(None)
    assert all(vehicle.accept(parser.decode(bytearray(encoder.encode(StationHeartbeat())))) for _ in range(300))
    speaks = mavlink.MAVLink(None, srcSystem=1, srcComponent=1)
    vehicle.equip(speaks)
    finder = FrameFinder(ground)
    assert sum(len(finder.feed(BEAT.pack(speaks))) for _ in range(300)) == 300


def test_no_time_is_used_twice_though_the_clock_goes_back_or_the_program_dies(tmp_path: Path) -> None:
    path = tmp_path / "a.key"
    write_key(drawn(), path)
    clock, last = [NOW], 0
    for jump_s in (0.0, 5.0, -3600.0, 0.001, 30.0):
        clock[0] += jump_s
        signing = Signing(read_key(path).secret, KeptStamps(path), wall_clock=lambda: clock[0])
        mav = mavlink.MAVLink(None)
        for _ in range(500):
            clock[0] += 0.01
            signing.stamp(mav)
            assert mav.signing.timestamp > last
            last = mav.signing.timestamp
            signing.keep()  # and then the power fails
    assert json.loads((tmp_path / "a.key.state").read_text())["latest"] - last <= AHEAD


def test_a_station_that_was_started_again_at_once_is_still_believed_and_believes(tmp_path: Path) -> None:
    path = tmp_path / "a.key"
    write_key(drawn(), path)
    secret = read_key(path).secret
    vehicle, parser = Signatures(secret, lambda: NOW), mavlink.MAVLink(None)
    for _ in range(3):
        signing = Signing(secret, KeptStamps(path), wall_clock=lambda: NOW)
        encoder = Encoder(254, signing=signing)
        assert vehicle.accept(parser.decode(bytearray(encoder.encode(StationHeartbeat()))))
        signing.keep()
        assert len(FrameFinder(signing).feed(signed(BEAT, key=secret, at=NOW))) == 1


def test_the_same_link_id_is_kept_and_damage_of_the_state_begins_anew(tmp_path: Path) -> None:
    path = tmp_path / "a.key"
    write_key(drawn(), path)
    first = KeptStamps(path)
    first.keep(units(NOW))
    assert KeptStamps(path).link_id == first.link_id
    for text in ("", "{", '{"latest": -1, "link_id": 1}', '{"latest": 1e400, "link_id": 1}', "[" * 100_000, "null"):
        (tmp_path / "a.key.state").write_text(text)
        assert KeptStamps(path).at_least() == 0


def test_the_time_is_on_the_disk_itself_and_only_the_first_is_waited_for(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "a.key"
    write_key(drawn(), path)
    asked, answered = threading.Event(), threading.Event()
    answered.set()

    def slow_disk(_: int) -> None:
        asked.set()
        answered.wait(30.0)

    monkeypatch.setattr(os, "fsync", slow_disk)
    stamps = KeptStamps(path)
    stamps.keep(units(NOW))
    assert asked.is_set()
    first = stamps.at_least()
    assert KeptStamps(path).at_least() == first == units(NOW) + AHEAD
    answered.clear()
    stamps.keep(units(NOW + 15))
    stamps.keep(units(NOW + 16))
    assert stamps.at_least() == KeptStamps(path).at_least() == first, "what is not there yet is not counted on"
    answered.set()
    for thread in threading.enumerate():
        if thread.name == "tippath key state":
            thread.join(30.0)
    assert stamps.at_least() == KeptStamps(path).at_least() == units(NOW + 15) + AHEAD


def test_a_disk_that_is_full_stops_no_signature(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "a.key"
    write_key(drawn(), path)
    signing = signing_with(path)

    tries: list[int] = []

    def full(*_: object, **__: object) -> None:
        tries.append(1)
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("gcs.link.key_file.put_in_place", full)
    for _ in range(100):
        signing.keep()
    assert len(tries) == 1, "once a second is enough"
    Encoder(254, signing=signing).encode(StationHeartbeat())


def test_a_key_is_its_owners_alone_and_never_shown(tmp_path: Path) -> None:
    path = tmp_path / "a.key"
    key = drawn()
    write_key(key, path)
    assert read_key(path) == key
    assert key.secret.hex() not in f"{key!r} {key.id} {signing_with(path)!r}"
    if os.name == "posix":
        assert path.stat().st_mode & 0o077 == 0
        path.chmod(0o640)
        with pytest.raises(UsageError, match="chmod 600"):
            read_key(path)
        path.chmod(0o600)
    with pytest.raises(UsageError, match="never overwritten"):
        write_key(key, path)
    for text in (b"", b"00" * 31, b"zz" * 32, b"\xff\xfe\x00", b"0" * 100_000):
        path.write_bytes(text)
        with pytest.raises(UsageError, match="not a key"):
            read_key(path)
    with pytest.raises(UsageError, match="cannot be read"):
        read_key(tmp_path / "no.key")


def test_a_passphrase_makes_the_key_that_other_stations_make_of_it() -> None:
    """SHA-256 of the words, by the standard's own test vector."""
    assert of_passphrase("abc").secret.hex() == "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad"


def test_a_spoofer_is_sent_nothing_and_is_not_taken_for_the_vehicle(tmp_path: Path) -> None:
    """Three spoofers before the vehicle: unsigned, another key, a recorded frame of an hour ago."""
    transport = open_transport("udpin:127.0.0.1:0", Signing(KEY, Stamps(), wall_clock=lambda: NOW))
    ground = ("127.0.0.1", int(transport.name.rsplit(":", 1)[1]))
    sockets = [socket.socket(socket.AF_INET, socket.SOCK_DGRAM) for _ in range(4)]
    *spoofers, vehicle = sockets
    try:
        forged = (plain(BEAT), signed(BEAT, key=OTHER), signed(BEAT, at=NOW - 3600))
        for spoofer, frame in zip(spoofers, forged, strict=True):
            spoofer.settimeout(0.0)
            for _ in range(3):
                spoofer.sendto(frame, ground)
                assert transport.receive(1.0) == []
                transport.send(b"to the vehicle only")
        vehicle.settimeout(10.0)
        vehicle.sendto(signed(BEAT), ground)
        assert len(transport.receive(1.0)) == 1
        transport.send(b"to the vehicle only")
        assert vehicle.recv(100) == b"to the vehicle only"
        for spoofer, frame in zip(spoofers, forged, strict=True):
            spoofer.sendto(frame, ground)
            assert transport.receive(1.0) == []
            with pytest.raises(BlockingIOError):
                spoofer.recv(100)
    finally:
        transport.close()
        for one in sockets:
            one.close()
