"""The chain reader against another program's reader, and against damage."""

from __future__ import annotations

import random
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from injuries import COUNTS, bounded_turns, injure
from more_of_a_kind import thorough
from pymavlink import DFReader

from gcs.errors import TippathError
from gcs.logs.formats import dataflash
from gcs.logs.formats.damage import Damage
from gcs.logs.formats.dataflash import DataFlashLog
from gcs.logs.formats.dataflash_table import DataFlashTables
from gcs.logs.words import printable

LOGS = ("heli_pitch_sweep.BIN", "log171.bin", *thorough(["quad_roll_sweep.BIN"]))
"""One of each vehicle; the other axis holds the same messages, and the quadrotor's firmware is the helicopter's."""
MIXED = {
    "MIXD": (7, "QbBhHiIfdM", "TimeUS,b,B,h,H,i,I,f,d,M"),
    "SCAL": (8, "QcCeELnNZqa", "TimeUS,c,C,e,E,L,n,N,Z,q,a"),
}


def parse(data: bytes) -> DataFlashLog:
    return dataflash.parse(np.frombuffer(data, np.uint8))


def messages(log: DataFlashLog, name: str) -> Counter[bytes]:
    """Every message of a type, as its bytes."""
    return Counter(row.tobytes() for row in log.raw(name))


def table_of(data: bytes, name: str) -> list[tuple[float, ...]]:
    """The samples of a message type as a profile sees them."""
    tables = DataFlashTables(parse(data), "log")
    series = [tables.series(f"{name}.{column}") for column in tables.log.formats[name].columns]
    return list(zip(*(one.values.tolist() for one in series), strict=True))


def compare(path: Path, most: int = 1_000_000) -> int:
    """Every value of the first `most` messages must be DFReader's, and so how many there are of each type.

    Returns how many values were compared.
    """
    log = dataflash.read(path)
    theirs: dict[str, list[list[Any]]] = {}
    fields: dict[str, list[str]] = {}
    other = DFReader.DFReader_binary(str(path))
    try:
        for _ in range(most):
            if (message := other.recv_msg()) is None:
                break
            name = message.get_type()
            if name not in theirs:
                theirs[name], fields[name] = [], message.get_fieldnames()
            theirs[name].append([getattr(message, field) for field in fields[name]])
        counts = {fmt.name: other.counts[id] for id, fmt in other.formats.items() if other.counts[id]}
    finally:
        other.close()
    compared = 0
    for name, rows in theirs.items():
        assert list(log.formats[name].columns) == fields[name]
        for field, values in zip(fields[name], zip(*rows, strict=True), strict=True):
            ours = log.column(name, field)
            assert len(ours) == counts[name], (name, field)
            ours = ours[: len(values)]
            compared += len(values)
            if isinstance(values[0], str):
                for raw, text in zip((bytes(raw).split(b"\0", 1)[0] for raw in ours), values, strict=True):
                    assert text in (raw.decode("utf-8", "replace"), raw.decode("latin-1")), (name, field)
            else:
                assert np.array_equal(ours, np.array(values), equal_nan=ours.dtype.kind == "f"), (name, field)
    assert {name: log.count(name) for name in log.names} == counts
    assert not log.damage.any
    return compared


@pytest.mark.data
@pytest.mark.parametrize("name", LOGS)
def test_every_value_of_a_real_log_is_dfreaders(shared_data: Path, name: str) -> None:
    assert compare(shared_data / "ardupilot" / name, most=15_000) > 100_000


def test_every_type_of_field_is_read_as_dfreader_does(writer: Callable[..., Any], tmp_path: Path) -> None:
    log = writer(MIXED)
    chance = random.Random(3)
    for i in range(50):
        us = 1000 * i
        whole = [chance.randint(-128, 127), i, chance.randint(-32768, 32767), 65535 - i, -i * 7919, 2**32 - 1 - i]
        log.add("MIXD", us, *whole, chance.gauss(0, 1), chance.gauss(0, 1), i)
        scaled = [chance.randint(-32768, 32767), chance.randint(0, 65535), -i * 1000003, i * 85899345]
        degrees = chance.randint(-(2**31), 2**31 - 1)
        texts = [b"ab", b"name16characters", b"text \xc3\xa4"]
        log.add("SCAL", us, *scaled, degrees, *texts, -(2**40) * i, bytes(range(64)))
    path = tmp_path / "mixed.BIN"
    path.write_bytes(log.data)
    assert compare(path) == 50 * (10 + 11) + 3 * 5


def test_header_bytes_inside_a_payload_are_not_messages(writer: Callable[..., Any]) -> None:
    log = writer({"AAAA": (1, "QZ", "TimeUS,Text"), "BBBB": (2, "QI", "TimeUS,N")})
    for i in range(100):
        log.add("AAAA", i, b"\xa3\x95\x02" + bytes([i]) * 20 + b"\xa3\x95\x01\xa3\x95\x80")
        log.add("BBBB", i, 0x0295A3)
    read = parse(log.data)
    assert (read.count("AAAA"), read.count("BBBB")) == (100, 100)
    assert read.damage == Damage(len(log.data), 0, 0)


def test_a_file_cut_anywhere_keeps_exactly_the_whole_messages_before_the_cut(two_chirps: bytes) -> None:
    whole = parse(two_chirps)
    ends = {name: whole.places(name) + whole.formats[name].length for name in ("RATE", "SIDD")}
    chance = random.Random(11)
    cuts = [len(two_chirps) - n for n in range(200)] + [chance.randrange(2000, len(two_chirps)) for _ in range(200)]
    for cut in cuts:
        read = parse(two_chirps[:cut])
        for name, stops in ends.items():
            expected = int(np.count_nonzero(stops <= cut))
            lost = expected - read.count(name)
            assert lost in (0, 1), (cut, name)
            assert np.array_equal(read.places(name), whole.places(name)[: read.count(name)])
        assert read.damage.skipped_bytes < 160


def test_missing_bytes_cost_a_few_messages_and_invent_none(two_chirps: bytes) -> None:
    names = ("RATE", "SIDD", "TPEX")
    whole = parse(two_chirps)
    original = {name: messages(whole, name) for name in names}
    samples = {name: set(table_of(two_chirps, name)) for name in names}
    chance = random.Random(12)
    spliced = 0
    for _ in range(6):
        at = chance.randrange(2000, len(two_chirps) - 2000)
        for size, filling in ((517, b""), (4096, bytes(4096))):
            injured = two_chirps[:at] + filling + two_chirps[at + size :]
            read = parse(injured)
            for name, before in original.items():
                # now and then two halves fit together and only the time that follows shows it: see tables
                spliced += (messages(read, name) - before).total()
                assert set(table_of(injured, name)) <= samples[name], (at, size, name)
                assert sum(before.values()) - read.count(name) <= size / 90 + 3
            assert read.damage.resyncs <= 1
    assert spliced < 8


def test_flipped_bytes_cost_only_the_messages_they_hit(two_chirps: bytes) -> None:
    data = bytearray(two_chirps)
    before = parse(two_chirps)
    chance = random.Random(13)
    for _ in range(200):
        data[chance.randrange(2000, len(data))] ^= 1 << chance.randrange(8)
    read = parse(bytes(data))
    total = sum(before.count(name) for name in before.names)
    found = sum(read.count(name) for name in read.names)
    # 3 of some 47 bytes are header; the message before a broken header goes too
    assert 0 < total - found < 80
    assert 1 <= read.damage.resyncs < 40


@pytest.mark.data
def test_a_real_log_with_two_hundred_flipped_bytes_loses_a_dozen_samples(shared_data: Path) -> None:
    data = bytearray((shared_data / "ardupilot" / "quad_roll_sweep.BIN").read_bytes())
    total = parse(bytes(data)).count("IMU")
    chance = random.Random(14)
    for _ in range(200):
        data[chance.randrange(30_000, len(data))] ^= 1 << chance.randrange(8)
    assert parse(bytes(data)).count("IMU") >= total - 20
    for at in range(100_000, len(data), 100_000):
        data[at : at + 3] = b"\xa3\x95\x4b"
    assert parse(bytes(data)).count("IMU") >= total - 60


def test_a_message_without_a_format_is_stepped_over_and_named(writer: Callable[..., Any]) -> None:
    log = writer({"AAAA": (1, "QI", "TimeUS,N")})
    for i in range(10):
        log.add("AAAA", i, i)
        log.pieces.append(b"\xa3\x95\x63" + bytes(10))
    log.add("AAAA", 99, 99)
    read = parse(log.data)
    assert read.column("AAAA", "N").tolist() == [*range(10), 99]
    assert read.damage.unknown == {0x63: 10}
    assert read.damage.skipped_bytes == 130
    assert "99" in read.damage.describe()


def test_a_damaged_format_that_claims_an_id_twice_loses_to_the_true_one(writer: Callable[..., Any]) -> None:
    log = writer({"AAAA": (1, "QI", "TimeUS,N"), "BBBB": (2, "QIII", "TimeUS,N,M,O")})
    false = bytearray(log.pieces[-1])
    false[3] = 1  # BBBB's format now also claims id 1
    log.pieces.insert(1, bytes(false))
    for i in range(20):
        log.add("AAAA", i, i)
        log.add("BBBB", i, i, i, i)
    read = parse(log.data)
    assert (read.count("AAAA"), read.count("BBBB")) == (20, 20)


@pytest.mark.parametrize(
    ("data", "words"), [(b"", "empty"), (b"\xa3", "not a DataFlash log"), (b"\xa3\x95\x80" * 40, "not a DataFlash log")]
)
def test_what_is_no_log_is_refused_with_a_reason(data: bytes, words: str) -> None:
    with pytest.raises(TippathError, match=words):
        parse(data)


def test_bytes_of_the_vehicle_cannot_reach_the_terminal() -> None:
    assert printable(b"SystemID \x1b[2Jx\n\0rest") == "SystemID ?[2Jx?"


def mutated(data: bytes, chance: random.Random) -> bytes:
    """With header bytes anywhere."""
    return injure(data, chance, lambda chance: b"\xa3\x95" + bytes([chance.choice((9, 10, 75, 128, 200))]))


@pytest.mark.parametrize("count", COUNTS)
def test_no_injury_makes_the_reader_fail(two_chirps: bytes, count: int) -> None:
    chance = random.Random(15)
    short = two_chirps[:60_000]
    read_at_all = 0
    for _ in bounded_turns(count):
        try:
            log = parse(mutated(short, chance))
        except TippathError:
            continue
        read_at_all += 1
        for name in log.names:
            for values in log.table(name).values():
                assert len(values) == log.count(name)
        assert 0 <= log.damage.skipped_bytes <= log.damage.total_bytes
    assert read_at_all > 0.666667 * count


def test_noise_is_no_log(tmp_path: Path) -> None:
    chance = random.Random(16)
    for size in (1, 2, 3, 90, 5000):
        with pytest.raises(TippathError):
            parse(chance.randbytes(size))
    with pytest.raises(TippathError, match="cannot be read"):
        dataflash.read(tmp_path / "absent.BIN")
