"""What is recovered from damaged logs, counted against what was written."""

from __future__ import annotations

import random
import time
import tracemalloc
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from gcs.errors import TippathError
from gcs.logs import ingest
from gcs.logs.formats import dataflash, dataflash_boots, dataflash_chain, dataflash_scan
from gcs.logs.formats.dataflash import DataFlashLog
from gcs.logs.formats.dataflash_table import DataFlashTables

FAST = {
    "IMU": (20, "QBffffffIIfBBHH", "TimeUS,I,GyrX,GyrY,GyrZ,AccX,AccY,AccZ,EG,EA,T,GH,AH,GHz,AHz"),
    "RATE": (75, "Qfffffffffffff", "TimeUS,RDes,R,ROut,PDes,P,POut,YDes,Y,YOut,ADes,A,AOut,AOutSlew"),
    "SIDD": (9, "Qfffffffff", "TimeUS,Time,Targ,F,Gx,Gy,Gz,Ax,Ay,Az"),
    "PIDR": (30, "Qfffffffff", "TimeUS,Tar,Act,Err,P,I,D,FF,Dmod,SRate"),
    "PIDP": (32, "Qffff", "TimeUS,P,I,D,FF"),
    "ATT": (31, "QccccCC", "TimeUS,DesRoll,Roll,DesPitch,Pitch,DesYaw,Yaw"),
}
WHOLE = 71_172
"""IMU records in the 10 MB log."""

Writer = Callable[..., Any]


def parse(data: bytes) -> DataFlashLog:
    return dataflash.parse(np.frombuffer(data, np.uint8))


@pytest.fixture(scope="module")
def ten_mb(writer: Writer) -> bytes:
    """Two IMU of noise with everything else that a fast log has, 500 Hz."""
    log = writer(FAST)
    noise = np.random.default_rng(20).normal(size=(4096, 13)).tolist()
    for i in range(WHOLE // 2):
        us = 2000 * i
        row = noise[i % 4096]
        for sensor in range(2):
            log.add("IMU", us, sensor, *row[:6], i, i, row[6], 1, 1, 500, 500)
        log.add("RATE", us, *row)
        log.add("SIDD", us, *row[:9])
        log.add("PIDR", us, *row[4:])
        log.add("PIDP", us, *row[:4])
        if i % 10 == 0:
            log.add("ATT", us, 1, 2, 3, 4, 5, i % 36000)
    return bytes(log.data)


@pytest.fixture(scope="module")
def original(ten_mb: bytes) -> dict[bytes, int]:
    """Every IMU record as its bytes, with its place."""
    read = parse(ten_mb)
    assert read.count("IMU") == WHOLE
    assert not read.damage.any
    rows = read.raw("IMU")
    return {row.tobytes(): place for row, place in zip(rows, read.places("IMU").tolist(), strict=True)}


def strange(read: DataFlashLog, original: dict[bytes, int]) -> int:
    """How many of the recovered records were never written."""
    return sum(row.tobytes() not in original for row in read.raw("IMU"))


def test_a_cut_tail_costs_one_record(ten_mb: bytes, original: dict[bytes, int]) -> None:
    last = max(original.values())
    read = parse(ten_mb[: last + 30])
    assert read.count("IMU") >= WHOLE - 2  # the one that is cut, and the one before it, which meets no whole message
    assert strange(read, original) == 0
    assert read.damage.tail_cut
    assert 0 < read.damage.skipped_bytes < 60
    read = parse(ten_mb[: last + 54])
    assert read.count("IMU") == WHOLE


def test_a_hole_costs_what_was_in_it(ten_mb: bytes, original: dict[bytes, int]) -> None:
    chance = random.Random(21)
    for filling in (bytes(4096), b"\xff" * 4096, chance.randbytes(4096)):
        for _ in range(3):
            at = chance.randrange(100_000, len(ten_mb) - 100_000)
            read = parse(ten_mb[:at] + filling + ten_mb[at + 4096 :])
            assert read.count("IMU") >= WHOLE - 31, at
            assert strange(read, original) == 0
            assert read.damage.resyncs == 1
            assert 4096 <= read.damage.skipped_bytes < 4096 + 200


def test_missing_bytes_cost_four_records(ten_mb: bytes, original: dict[bytes, int]) -> None:
    chance = random.Random(22)
    lost = []
    for _ in range(9):
        at = chance.randrange(100_000, len(ten_mb) - 100_000)
        read = parse(ten_mb[:at] + ten_mb[at + 517 :])
        lost.append(WHOLE - read.count("IMU"))
        assert strange(read, original) == 0
        assert read.damage.resyncs == 1
    assert max(lost) <= 6
    assert np.median(lost) <= 4


def test_two_hundred_flipped_bytes_cost_a_dozen_records(ten_mb: bytes, original: dict[bytes, int]) -> None:
    for seed in (23, 24, 25):
        chance = random.Random(seed)
        data = bytearray(ten_mb)
        flipped = [chance.randrange(1000, len(data)) for _ in range(200)]
        for at in flipped:
            data[at] ^= 1 << chance.randrange(8)
        read = parse(bytes(data))
        assert read.count("IMU") >= 0.999 * WHOLE
        assert read.count("IMU") >= WHOLE - 25
        # no checksum tells a flipped byte inside a record: it stays, in its place
        assert set(read.places("IMU").tolist()) <= set(original.values())
        hit = np.array(sorted(original.values()))
        hit = set(hit[np.searchsorted(hit, flipped, "right") - 1].tolist())
        odd = [
            place
            for place, row in zip(read.places("IMU").tolist(), read.raw("IMU"), strict=True)
            if row.tobytes() not in original
        ]
        assert set(odd) <= hit
        # and a flipped time stamp is thrown out by its neighbours
        table = DataFlashTables(read, "log")
        assert set((table.series("IMU.GyrX").t * 500).round().astype(int).tolist()) <= set(range(WHOLE // 2))


@pytest.mark.parametrize("id", [20, 75, 0x80, 0x63])
def test_false_headers_every_100_kb_cost_ten_records(ten_mb: bytes, original: dict[bytes, int], id: int) -> None:
    data = bytearray(ten_mb)
    places = range(100_000, len(data), 100_000)
    for at in places:
        data[at : at + 3] = b"\xa3\x95" + bytes([id])
    read = parse(bytes(data))
    assert read.count("IMU") >= WHOLE - 35
    assert set(read.places("IMU").tolist()) <= set(original.values())
    assert strange(read, original) <= len(places)


def test_pieces_make_no_difference(two_chirps: bytes, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """Damage anywhere, read in one piece, in pieces of 300 bytes, from memory and from a file."""
    chance = random.Random(26)
    path = tmp_path / "injured.BIN"
    for _ in range(12):
        data = bytearray(two_chirps[:150_000])
        for _ in range(20):
            at = chance.randrange(1000, len(data) - 1000)
            match chance.randrange(3):
                case 0:
                    data[at] ^= 1 << chance.randrange(8)
                case 1:
                    del data[at : at + chance.randrange(400)]
                case 2:
                    data[at:at] = b"\xa3\x95" + chance.randbytes(chance.randrange(600))
        path.write_bytes(data)
        whole = parse(bytes(data))
        messages = {name: whole.raw(name) for name in whole.names}
        sha256 = whole.sha256()
        with monkeypatch.context() as patch:
            piece = chance.choice((300, 1000, 4097))
            for module in (dataflash_scan, dataflash_chain, dataflash_boots):
                patch.setattr(module, "PIECE", piece)
            for read in (parse(bytes(data)), dataflash.read(path)):
                assert read.damage == whole.damage
                assert read.names == whole.names
                for name, rows in messages.items():
                    assert np.array_equal(read.places(name), whole.places(name))
                    assert np.array_equal(read.raw(name), rows)
                assert read.sha256() == sha256


# ------------------------------------------------------------------------------------------------ formats

SMALL = {"AAAA": (1, "QI", "TimeUS,N"), "BBBB": (2, "QIII", "TimeUS,N,M,O"), "CCCC": (3, "Qh", "TimeUS,N")}


def small(log: Any, first: int, count: int, *names: str) -> None:
    for i in range(first, first + count):
        for name in names or ("AAAA", "BBBB", "CCCC"):
            log.add(name, 1000 * i, *([i] * (3 if name == "BBBB" else 1)))


def test_of_a_damaged_format_another_copy_is_taken(writer: Writer) -> None:
    log = writer(SMALL)
    true = log.pieces[2]
    log.pieces[2] = true[:10] + b"\xff\xff\xff" + true[13:]
    small(log, 0, 50)
    assert parse(log.data).count("BBBB") == 0
    log.pieces.append(true)
    small(log, 50, 50)
    read = parse(log.data)
    assert [read.count(name) for name in SMALL] == [100, 100, 100]
    assert read.column("BBBB", "O").tolist() == list(range(100))


def test_a_lost_format_costs_its_own_messages_alone_and_is_named(writer: Writer) -> None:
    log = writer(SMALL)
    del log.pieces[2]
    small(log, 0, 5000)
    started = time.process_time()
    read = parse(log.data)
    assert time.process_time() - started < 1
    assert [read.count(name) for name in SMALL] == [5000, 0, 5000]
    assert read.damage.unknown == {2: 5000}
    assert read.damage.skipped_bytes == 5000 * 23
    assert read.damage.resyncs == 0
    assert "no format for message id 2" in read.damage.describe()


def test_each_boot_has_its_own_formats(writer: Writer) -> None:
    log = writer(SMALL)
    small(log, 0, 300)
    other = writer(
        {"AAAA": (1, "QIf", "TimeUS,N,X"), "BBBB": (2, "QIII", "TimeUS,N,M,O"), "DDDD": (3, "QB", "TimeUS,D")}
    )
    for i in range(200):
        other.add("AAAA", 1000 * i, i, 0.5)
        other.add("BBBB", 1000 * i, i, i, i)
        other.add("DDDD", 1000 * i, i)
    read = parse(log.data + other.data)
    assert not read.damage.any
    first, second = read.boots
    assert first.names == ("AAAA", "BBBB", "CCCC", "FMT")
    assert second.names == ("AAAA", "BBBB", "DDDD", "FMT")
    assert first.column("AAAA", "N").tolist() == list(range(300))
    assert second.column("AAAA", "X").tolist() == [0.5] * 200
    assert second.column("AAAA", "N").tolist() == second.column("BBBB", "M").tolist() == list(range(200))
    assert "CCCC" not in second.names
    assert read.count("BBBB") == 500


def test_a_format_that_is_lost_in_one_boot_is_taken_from_another(writer: Writer) -> None:
    log, other = writer(SMALL), writer(SMALL)
    small(log, 0, 100)
    del other.pieces[2]
    small(other, 0, 100)
    read = parse(log.data + other.data)
    assert [boot.count("BBBB") for boot in read.boots] == [100, 100]
    assert not read.damage.any


# ------------------------------------------------------------------------------------------------ boots


def boots(data: bytes) -> int:
    return len(parse(data).boots)


def without_formats(data: bytes) -> bytes:
    return data[data.index(b"\xa3\x95\x78") :]


def test_two_boots_in_one_file_are_two_clocks_and_one_numbering(flown: Callable[..., bytes], saved: Any) -> None:
    first, second = flown([{"axis": 10}, {"axis": 11}]), flown([{"axis": 11}], quiet_s=3.0)
    alone = [run for name, data in (("a.BIN", first), ("b.BIN", second)) for run in ingest([saved(data, name)]).runs]
    for data in (first + second, first + without_formats(second), first + second[300:]):
        found = ingest([saved(data)])
        assert [run.id for run in found.runs] == ["flight.BIN#1", "flight.BIN#2", "flight.BIN#3"]
        for run, other in zip(found.runs, alone, strict=True):
            assert (run.usable, run.axis, run.start_s, run.duration_s) == (True, other.axis, other.start_s, 6.0)
            assert run.record is not None
            assert other.record is not None
            assert set(run.record.channels) == set(other.record.channels)
            for channel, values in run.record.channels.items():
                assert np.array_equal(values, other.record.channels[channel], equal_nan=True), channel
        assert any("2 boots in this log" in note for note in found.sources[0].notes)


def test_three_boots_and_the_same_twice(two_chirps: bytes, saved: Any) -> None:
    assert boots(two_chirps * 3) == 3
    found = ingest([saved(two_chirps * 3)])
    assert [run.axis for run in found.runs] == ["roll", "pitch"] * 3
    assert all(run.usable for run in found.runs)


def test_a_boot_that_logged_nothing_is_told_and_gives_no_run(two_chirps: bytes, writer: Writer, saved: Any) -> None:
    silent = writer({"MSG": (59, "QZ", "TimeUS,Message"), "PARM": (32, "QNff", "TimeUS,Name,Value,Default")})
    for i in range(100):
        silent.add("PARM", 1000 * i, b"SID_AXIS", i, 0)
    assert boots(silent.data + two_chirps) == 2
    found = ingest([saved(silent.data + two_chirps)])
    assert [run.id for run in found.runs] == ["flight.BIN#1", "flight.BIN#2"]
    assert "2 boots in this log, each with its own clock; 1 of them without samples" in found.sources[0].notes


def test_what_is_damage_makes_no_boot(two_chirps: bytes) -> None:
    whole = parse(two_chirps)
    middle = len(two_chirps) // 2
    stamped = bytearray(two_chirps)
    for at in whole.places("RATE")[3000:3003].tolist():
        stamped[at + 3 : at + 11] = bytes(8)
    assert boots(bytes(stamped)) == 1, "stamps at zero"
    for at in whole.places("RPM")[100:].tolist():
        stamped[at + 3 : at + 11] = (5_000_000).to_bytes(8, "little")
    assert boots(bytes(stamped)) == 1, "one kind of message whose clock stands"
    for size in (4096, 40_000, 300_000):
        block = two_chirps[middle - size : middle]
        assert boots(two_chirps[:middle] + block + two_chirps[middle:]) == 1, "a block twice"
        later = middle + 200_000
        assert boots(two_chirps[:later] + block + two_chirps[later:]) == 1, "an old block again"
        assert boots(two_chirps[:middle] + bytes(size) + two_chirps[middle + size :]) == 1, "a hole"
    assert boots(two_chirps[:500] + two_chirps) == 1, "a part of the formats twice"


def test_an_unusable_piece_of_a_file_changes_no_run(two_chirps: bytes, saved: Any) -> None:
    """Repeated blocks, padding and noise around the log: the same records as without."""
    alone = ingest([saved(two_chirps, "alone.BIN")]).runs
    middle = len(two_chirps) // 2
    noise = random.Random(27).randbytes(5000)
    for data in (
        two_chirps[:middle] + two_chirps[middle - 40_000 :],
        two_chirps + bytes(100_000),
        two_chirps + b"\xff" * 100_000,
        noise + two_chirps,
        two_chirps[:500] + two_chirps,
    ):
        found = ingest([saved(data)]).runs
        assert [run.usable for run in found] == [True, True]
        for run, other in zip(found, alone, strict=True):
            assert run.record is not None
            assert other.record is not None
            # a sample before the seam may go
            assert set(run.record.t.tolist()) <= set(other.record.t.tolist())
            assert run.record.t.size >= other.record.t.size - 3


def test_a_backward_clock_gives_up_the_fewest_samples(two_chirps: bytes, saved: Any) -> None:
    whole = parse(two_chirps)
    data = bytearray(two_chirps)
    for name in ("RATE", "SIDD", "TPEX"):
        for at in whole.places(name).tolist():
            us = int.from_bytes(data[at + 3 : at + 11], "little")
            if 16_000_000 <= us < 16_050_000:
                data[at + 3 : at + 11] = (us - 400_000).to_bytes(8, "little")
    found = ingest([saved(bytes(data))])
    assert [run.usable for run in found.runs] == [True, True]
    assert sum("left out" in note for note in found.sources[0].notes) == 3
    record = found.runs[0].record
    assert record is not None
    assert np.all(np.diff(record.t) > 0)


# ------------------------------------------------------------------------------------------------ reading


def test_a_file_that_shrinks_while_it_is_read_is_an_error_and_no_crash(two_chirps: bytes, saved: Any) -> None:
    path = saved(two_chirps)
    log = dataflash.read(path)
    with path.open("r+b") as stream:
        stream.truncate(len(two_chirps) // 2)
    with pytest.raises(TippathError, match="changed while it was read"):
        log.column("RATE", "R")
    path.write_bytes(bytes(len(two_chirps)))
    with pytest.raises(TippathError, match="changed while it was read"):
        log.column("RATE", "P")
    path.unlink()
    with pytest.raises(TippathError, match="cannot be read"):
        log.column("RATE", "Y")


def test_a_file_that_grows_is_read_as_far_as_it_was(two_chirps: bytes, saved: Any) -> None:
    path = saved(two_chirps[:1_000_000])
    log = dataflash.read(path)
    path.write_bytes(two_chirps)
    assert np.array_equal(log.raw("RATE"), parse(two_chirps[:1_000_000]).raw("RATE"))


def test_what_does_not_fit_in_memory_is_read_again(two_chirps: bytes, monkeypatch: pytest.MonkeyPatch) -> None:
    whole = parse(two_chirps)
    expected = {name: whole.table(name) for name in whole.names}
    for budget in (0, 300_000):
        monkeypatch.setattr(dataflash, "CACHE_BYTES", budget)
        read = parse(two_chirps)
        for name, table in expected.items():
            for column, values in table.items():
                assert np.array_equal(read.column(name, column), values), (name, column)
                some = np.arange(0, read.count(name), 3)
                assert np.array_equal(read.column(name, column, some), values[some])
            assert sum(bodies.size for bodies in read._cache.values()) <= budget


def test_reading_takes_a_fraction_of_the_file(ten_mb: bytes, tmp_path: Path) -> None:
    data = ten_mb + ten_mb[89 * (1 + len(FAST)) :]  # without its formats, of 89 bytes each
    path = tmp_path / "large.BIN"
    path.write_bytes(data)
    tracemalloc.start()
    try:
        log = dataflash.read(path)
        held, peak = tracemalloc.get_traced_memory()
        assert peak < 0.5 * len(data)
        assert held < 0.2 * len(data)
        log.column("RATE", "R")
        held, _ = tracemalloc.get_traced_memory()
        assert held < 0.2 * len(data) + log.count("RATE") * 63
    finally:
        tracemalloc.stop()


# ------------------------------------------------------------------------------------------------ fuzz


def mutated(data: bytes, chance: random.Random) -> bytes:
    """Injuries of every kind, of formats and clocks too, one to thirty of them."""
    out = bytearray(data)
    for _ in range(chance.choice((1, 2, 5, 30))):
        # as often in the formats, at the start, as in the samples
        at = chance.randrange(len(out) if chance.random() < 0.6 else min(len(out), 1000))
        size = chance.choice((1, 3, 8, 89, 512, 4096, 30_000))
        match chance.randrange(8):
            case 0:
                out[at] = chance.randrange(256)
            case 1:
                del out[at : at + size]
            case 2:
                out[at:at] = chance.randbytes(size)
            case 3:
                out[at : at + size] = bytes([chance.choice((0, 255))]) * len(out[at : at + size])
            case 4:
                out[at:at] = out[at : at + size]
            case 5:
                where = chance.randrange(len(out))
                out[where:where] = out[at : at + size]
            case 6:
                out[at : at + 3] = b"\xa3\x95" + bytes([chance.choice((9, 10, 75, 128, 200))])
            case 7:
                out[at:] = out[at : at + size] * min(20, 1 + 100_000 // max(1, size)) if size < 100 else out[at:]
        if len(out) < 10:
            break
    return bytes(out)


def test_no_mutated_log_makes_ingest_fail(flown: Callable[..., bytes], saved: Any) -> None:
    chance = random.Random(28)
    short = flown([{"axis": 10}], quiet_s=0.5, rate_hz=250)
    twice = short + flown([{"axis": 11}], quiet_s=0.5, rate_hz=250)
    read = 0
    started = time.process_time()
    tracemalloc.start()
    try:
        for turn in range(40):
            if turn == 10:  # enough to see what it takes; tracing triples the time
                _, peak = tracemalloc.get_traced_memory()
                tracemalloc.stop()
            data = mutated(chance.choice((short, twice)), chance)
            path = saved(data)
            before = time.process_time()
            try:
                found = ingest([path])
            except TippathError:
                continue
            finally:
                assert time.process_time() - before < 10
            read += 1
            for run in found.runs:
                assert run.usable or run.reasons
                assert run.record is None or np.all(np.diff(run.record.t) > 0)
    finally:
        tracemalloc.stop()
    assert peak < 100e6
    assert read > 30
    assert time.process_time() - started < 60


def test_formats_over_and_over_cost_neither_time_nor_memory(writer: Writer) -> None:
    log = writer(SMALL)
    block = log.data
    small(log, 0, 50)
    tracemalloc.start()
    started = time.process_time()
    try:
        read = parse(block * 3_000 + log.data)
        _, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert read.count("AAAA") == 50
    assert peak < 10 * 3_000 * len(block)
    assert time.process_time() - started < 20


def test_the_format_of_formats_may_be_lost(writer: Writer) -> None:
    log = writer(SMALL)
    del log.pieces[0]
    small(log, 0, 50)
    read = parse(log.data)
    assert [read.count(name) for name in SMALL] == [50, 50, 50]
    assert not read.damage.any
