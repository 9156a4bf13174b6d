"""The ULog reader against pyulog, against damage, and from a planted flight to its fit.

The writer here is the tests' own, after the published format, so that what is read does not come from the code beside.
"""

from __future__ import annotations

import io
import json
import random
import struct
import time
import tracemalloc
from collections import Counter
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import planted
import pytest
from injuries import COUNTS, bounded_turns, injure
from pyulog import ULog

from gcs.errors import TippathError
from gcs.logs import ingest, resolve_runs
from gcs.logs.formats import ulog
from gcs.logs.formats.ulog import ULogFile
from gcs.logs.formats.ulog_table import UlogTables
from gcs.logs.profile.choice import choose
from gcs.logs.profile.profiles import bundled_profiles

Tippath = Callable[..., tuple[int, str, str]]
REAL = ("sample.ulg", "sample_log_small.ulg")
PLAIN = {"int8_t": "b", "uint8_t": "B", "int16_t": "h", "uint16_t": "H", "int32_t": "i", "uint32_t": "I"}
PLAIN |= {"int64_t": "q", "uint64_t": "Q", "float": "f", "double": "d", "bool": "?", "char": "c"}

FORMATS = {
    "vehicle_angular_velocity": "uint64_t timestamp;uint64_t timestamp_sample;float[3] xyz;uint8_t[4] _padding0;",
    "vehicle_torque_setpoint": "uint64_t timestamp;uint64_t timestamp_sample;float[3] xyz;uint8_t[4] _padding0;",
    "vehicle_status": "uint64_t timestamp;uint8_t nav_state;uint8_t arming_state;uint8_t[6] _padding0;",
    "esc_report": "uint64_t timestamp;int32_t esc_rpm;uint8_t failures;uint8_t[3] _padding0;",
    "esc_status": "uint64_t timestamp;uint16_t counter;uint8_t[6] _padding0;esc_report[2] esc;",
    "every_type": "uint64_t timestamp;bool a;int8_t b;uint8_t c;int16_t d;uint16_t e;int32_t f;uint32_t g;int64_t h;"
    "uint64_t i;float j;double k;char[5] l;float[2] m;",
    "never_timed": "uint64_t timestamp;float x;",
}
ANGULAR, TORQUE, STATUS, ESC0, ESC1, EVERY, UNTIMED = range(3, 10)
SYNC = b"\x2f\x73\x13\x20\x25\x0c\xbb\x12"


class Writer:
    """Collects messages; `data` is the file."""

    def __init__(self, incompatible: int = 0, appended: tuple[int, int, int] = (0, 0, 0)) -> None:
        self.pieces = [b"ULog\x01\x12\x35\x01" + struct.pack("<Q", 10_000_000)]
        self.add("B", bytes(8) + bytes([incompatible]) + bytes(7) + struct.pack("<3Q", *appended))

    def add(self, kind: str, body: bytes) -> None:
        self.pieces.append(struct.pack("<HB", len(body), ord(kind)) + body)

    def define(self, formats: dict[str, str]) -> None:
        for name, fields in formats.items():
            self.add("F", f"{name}:{fields}".encode())

    def keyed(self, kind: str, key: bytes, value: bytes) -> None:
        self.add(kind, (b"\0" if kind in "MQ" else b"") + bytes([len(key)]) + key + value)

    def subscribe(self, id: int, topic: str, instance: int = 0) -> None:
        self.add("A", struct.pack("<BH", instance, id) + topic.encode())

    def put(self, id: int, packing: str, *values: Any) -> None:
        self.add("D", struct.pack("<H" + packing, id, *values))

    def say(self, us: int, text: bytes, kind: str = "L") -> None:
        self.add(kind, b"6" + (b"\1\0" if kind == "C" else b"") + struct.pack("<Q", us) + text)

    @property
    def data(self) -> bytes:
        return b"".join(self.pieces)


def begin() -> Writer:
    log = Writer()
    log.define(FORMATS)
    log.keyed("I", b"char[10] sys_name", b"PX4")
    log.keyed("M", b"char[4] notes", b"more")
    log.keyed("P", b"float MC_ROLLRATE_P", struct.pack("<f", 0.15))
    log.keyed("Q", b"int32_t SYS_AUTOSTART", struct.pack("<i", 4001))
    for id, topic in ((ANGULAR, "vehicle_angular_velocity"), (TORQUE, "vehicle_torque_setpoint")):
        log.subscribe(id, topic)
    log.subscribe(STATUS, "vehicle_status")
    log.subscribe(ESC1, "esc_status", 1)
    return log


def flown(run: dict[str, np.ndarray], armed: bool = True, dropout: tuple[int, int] | None = None) -> Writer:
    """A flight at the rate of `run`. Beside rates and torques: two ESC topics that begin late, status, texts, syncs.

    dropout: first sample and number of samples that the logger loses.
    """
    log = begin()
    for i, t in enumerate(run["t"].tolist()):
        us = 20_000_000 + round(1e6 * t)
        if dropout and dropout[0] <= i < dropout[0] + dropout[1]:
            if i == dropout[0]:
                log.add("O", struct.pack("<H", 1000 * dropout[1] // 500))
            continue
        log.put(ANGULAR, "QQ3f", us + 400, us, run["p"][i], run["q"][i], 0.01)
        log.put(TORQUE, "QQ3f", us + 420, us, run["delta_x"][i], run["delta_y"][i], -0.02)
        if i % 25 == 3:
            log.put(ESC1, "QH6xQiB3xQiB3x", us + 30, i & 0xFFFF, us, i, 0, us, -i, 1)
        if i == 100:
            log.subscribe(ESC0, "esc_status", 0)
        if i % 30 == 4 and i > 100:
            log.put(ESC0, "QH6xQiB3xQiB3x", us + 35, i & 0xFFFF, us, 2 * i, 0, us, 3 * i, 1)
        if i % 250 == 0:
            log.put(STATUS, "QBB", us + 50, 10 if i < 1000 else 2, 2 if armed else 1)
        if i % 400 == 399:
            log.add("S", SYNC)
        if i == 600:
            log.say(us, b"[commander] Takeoff detected")
            log.say(us - 7, b"\x1b[2Jtagged", "C")
            log.add("R", struct.pack("<H", 999))
            log.add("Z", b"a kind of the future")
    return log


@pytest.fixture(scope="module")
def flight() -> list[dict[str, np.ndarray]]:
    """A roll and a pitch chirp of 12 s, planted: the truth is Table 4."""
    return planted.fly(None, {}, seed=5, gusts=0.3, duration_s=12.0)[:2]


@pytest.fixture(scope="module")
def whole(flight: list[dict[str, np.ndarray]]) -> bytes:
    return flown({name: values[:5000] for name, values in flight[0].items()}).data


def parse(data: bytes) -> ULogFile:
    return ulog.parse(np.frombuffer(data, np.uint8))


def stored(log: ULogFile) -> dict[tuple[str, int], Counter[bytes]]:
    """Every data message, as its bytes."""
    return {
        key: Counter(log.data[at : at + 5 + log.topics[key[0]].least].tobytes() for at in log.messages(*key).tolist())
        for key in log.ids
    }


def samples(data: bytes, topic: str, fields: Sequence[str]) -> list[tuple[float, ...]]:
    """The samples of a topic as a profile sees them."""
    tables = UlogTables(parse(data), "log")
    series = [tables.series(f"{topic}.{name}") for name in fields]
    return list(zip(series[0].t.tolist(), *(one.values.tolist() for one in series), strict=True))


def compare(path: Path) -> int:
    """Every value of every topic and instance must be pyulog's; returns how many were compared."""
    ours, theirs = ulog.read(path), ULog(str(path))
    assert set(ours.ids) == {(one.name, one.multi_id) for one in theirs.data_list}
    compared = 0
    tables = UlogTables(ours, str(path))
    for one in theirs.data_list:
        starts = ours.messages(one.name, one.multi_id)
        assert list(ours.layout(one.name)) == list(one.data)
        for name, values in one.data.items():
            mine = ours.column(one.name, name, starts)
            assert mine.dtype == values.dtype
            assert mine.tobytes() == values.tobytes(), (one.name, name)
            compared += values.size
        key = f"{one.name}[{one.multi_id}].timestamp"
        if tables.has(key):
            series = tables.series(key)
            assert set(series.values.tolist()) <= set(one.data["timestamp"].tolist())
            assert starts.size - series.t.size <= 2  # before gaps of the whole file, see `_trusted`
    said = [(one.timestamp * 1e-6, one.message) for one in theirs.logged_messages]
    assert [text for text in ours.texts if text in said] == said
    assert list(ours.dropouts_ms) == [one.duration for one in theirs.dropouts]
    assert not theirs.file_corruption
    assert tables.dropped == {}
    return compared


# ------------------------------------------------------------------------------------------------ undamaged


@pytest.mark.data
@pytest.mark.parametrize(("name", "values"), [("sample.ulg", 800_000), ("sample_log_small.ulg", 190_000)])
def test_every_value_of_a_real_log_is_pyulogs(shared_data: Path, name: str, values: int) -> None:
    assert compare(shared_data / "px4" / name) > values
    assert not ulog.read(shared_data / "px4" / name).damage.any


def test_every_type_of_field_is_read_as_pyulog_does(tmp_path: Path, whole: bytes) -> None:
    log = begin()
    log.subscribe(EVERY, "every_type")
    log.subscribe(UNTIMED, "never_timed")
    chance = random.Random(3)
    for i in range(60):
        small = [bool(i & 1), -i, i, -500 * i, 60_000 + i, -(2**31) + i, 2**32 - 1 - i, -(2**60) - i, 2**63 + i]
        real = [chance.gauss(0, 1), chance.gauss(0, 1)]
        text = [bytes([65 + i % 26]) for _ in range(5)]
        log.put(EVERY, "Q?bBhHiIqQfd5c2f", 1000 * i, *small, *real, *text, *real)
        log.put(UNTIMED, "Qf", 0, 1.0)
    path = tmp_path / "types.ulg"
    path.write_bytes(log.data)
    assert compare(path) == 60 * (1 + 9 + 2 + 5 + 2) + 60 * 2
    tables = UlogTables(ulog.read(path), "log")
    assert tables.has("every_type.m[1]")
    assert not tables.has("every_type.l[0]")  # a text
    assert not tables.has("never_timed.x")  # PX4 never set its time
    assert not any(tables.has(key) for key in ("every_type.m", "every_type.m[2]", "every_type[1].a", "x", "no.such"))
    path.write_bytes(whole)
    assert compare(path) > 50_000


def test_instances_arrays_and_nested_types_have_their_keys(whole: bytes) -> None:
    tables = UlogTables(parse(whole), "log")
    assert tables.series("esc_status.esc[1].esc_rpm").values.tolist()[:2] == [3 * 124, 3 * 154]  # the lowest: 0
    assert tables.series("esc_status[0].counter").values.tolist()[:2] == [124, 154]
    assert tables.series("esc_status[1].esc[1].esc_rpm").values.tolist()[:2] == [-3, -28]
    assert {"vehicle_angular_velocity.xyz[2]", "esc_status.esc[0].failures"} <= set(tables.fields())
    assert not [key for key in tables.fields() if "_padding" in key]
    assert not parse(whole).layout("vehicle_status").keys() & {"_padding0[0]"}
    with pytest.raises(KeyError):
        tables.series("esc_status[2].counter")


def test_padding_at_the_end_may_be_written_or_not() -> None:
    log = begin()
    for i in range(100):
        log.put(TORQUE, "QQ3f" + ("4x" if i % 3 else ""), 4000 * i, 4000 * i, i, 0, 0)
        log.put(TORQUE, "QQ3fB", 4000 * i, 4000 * i, i, 0, 0, 0)  # neither
    read = parse(log.data)
    assert read.column("vehicle_torque_setpoint", "xyz[0]", read.starts).tolist() == [*range(100)]
    assert read.damage.skipped_bytes == 100 * (5 + 29)
    assert (read.damage.resyncs, read.damage.unknown) == (0, {})


def test_time_is_the_profiles(whole: bytes) -> None:
    log = parse(whole)
    published = UlogTables(log, "log").series("vehicle_angular_velocity.xyz[0]").t
    sampled = UlogTables(log, "log", "timestamp_sample")
    np.testing.assert_allclose(published - sampled.series("vehicle_angular_velocity.xyz[0]").t, 400e-6, atol=1e-9)
    assert sampled.series("vehicle_status.nav_state").t[0] == pytest.approx(20.00005)  # has no other time
    one = UlogTables(log, "log", "vehicle_torque_setpoint.timestamp_sample")
    assert np.array_equal(one.series("vehicle_angular_velocity.xyz[0]").t, published)
    assert one.series("vehicle_torque_setpoint.xyz[0]").t[0] == 20.0


def test_texts_modes_and_arming(whole: bytes) -> None:
    tables = UlogTables(parse(whole), "log")
    assert [text for _, text in tables.texts()] == ["[commander] Takeoff detected", "?[2Jtagged"]
    assert [t for t, _ in tables.texts()] == pytest.approx([21.2, 21.199993])
    assert tables.modes() == [(pytest.approx(20.00005), 10), (pytest.approx(22.00005), 2)]
    assert tables.armed() == [(pytest.approx(20.00005), True)]
    assert tables.sampled_s == pytest.approx(9.998)
    only = begin()
    only.define({"actuator_armed": "uint64_t timestamp;bool armed;"})
    only.subscribe(50, "actuator_armed")
    for us, state in ((1, False), (2, False), (3, True), (4, True), (5, False)):
        only.put(50, "Q?", us * 1_000_000, state)
    assert UlogTables(parse(only.data), "log").armed() == [(1.0, False), (3.0, True), (5.0, False)]


def test_what_the_logger_lost_is_a_gap_and_a_note(flight: list[dict[str, np.ndarray]], tmp_path: Path) -> None:
    path = tmp_path / "lost.ulg"
    path.write_bytes(flown(flight[0], dropout=(2500, 60)).data)
    found = ingest([path])
    (source,) = found.sources
    assert any("lost samples once, 120 ms in all" in note for note in source.notes)
    assert found.damage.keys() <= {str(path)}  # the message of a later kind
    record = found.runs[0].record
    assert record is not None
    t = record.t
    (gap,) = np.flatnonzero(np.diff(t) > 0.1)
    assert (t[gap], t[gap + 1]) == pytest.approx((20 + 2499 / 500, 20 + 2560 / 500))


@pytest.mark.data
def test_the_real_logs_are_not_usable_and_say_why(shared_data: Path, tmp_path: Path, tippath: Tippath) -> None:
    for name in REAL:
        (tmp_path / name).write_bytes((shared_data / "px4" / name).read_bytes())  # ingest keeps its cache beside a log
    bench, ground = (UlogTables(ulog.read(tmp_path / name), name) for name in REAL)
    assert {state for _, state in bench.armed()} == {False}
    assert [state for _, state in ground.armed()] == [True, False]
    status, out, _ = tippath("ingest", tmp_path / "sample.ulg", "--explain")
    assert status == 1
    assert "disarmed throughout" in out
    assert "sensor_combined.gyro_rad[0]" in out
    assert "lost samples 4 times, 119 ms in all" in out
    assert "SDLOG_PROFILE" in out
    status, out, _ = tippath("ingest", tmp_path / "sample_log_small.ulg", "--explain")
    assert status == 1
    assert "no excitation" in out
    assert "vehicle_angular_velocity.xyz[1]" in out
    status, out, _ = tippath("ingest", tmp_path / "sample_log_small.ulg", "--json")
    (run,) = json.loads(out)["runs"]
    assert run["rate_source"] == "vehicle_angular_velocity"
    assert run["gaps"] == [[pytest.approx(20.327, abs=1e-3), pytest.approx(20.490, abs=1e-3)]]
    assert not run["usable"]


def test_a_planted_flight_is_fitted_from_its_logs(
    flight: list[dict[str, np.ndarray]], tmp_path: Path, tippath: Tippath
) -> None:
    paths = [tmp_path / f"{name}.ulg" for name in ("roll", "pitch")]
    for path, run in zip(paths, flight, strict=True):
        path.write_bytes(flown(run).data)
    records = resolve_runs([str(path) for path in paths])
    assert {record.rate_source for record in records} == {"vehicle_angular_velocity"}
    first = records[0]
    rows = np.round((first.t - 20.0) * 500).astype(int)
    for name in ("p", "q", "delta_x", "delta_y"):
        assert np.array_equal(first.channels[name], flight[0][name][rows].astype(np.float32))
    status, out, err = tippath("fit", *paths, "--model", "tpp", "--json")
    assert status == 0, err
    values = {name: one["value"] for name, one in json.loads(out)["parameters"].items()}
    for name in ("L_b", "M_a", "tau_f"):
        assert values[name] == pytest.approx(planted.TABLE_4[name], rel=0.1)


def test_the_faster_rates_are_chosen_unasked() -> None:
    def log(every: int) -> ULogFile:
        log = begin()
        log.define({"sensor_combined": "uint64_t timestamp;float[3] gyro_rad;float[3] accelerometer_m_s2;"})
        log.subscribe(60, "sensor_combined")
        for i in range(1000):
            if i % every == 0:
                log.put(ANGULAR, "QQ3f", 4000 * i, 4000 * i, 0, 0, 0)
            log.put(TORQUE, "QQ3f", 4000 * i + 1, 4000 * i, 0, 0, 0)
            log.put(60, "Q6f", 4000 * i + 2, *range(6))
        return parse(log.data)

    chosen = [choose(UlogTables(log(every), "log"), bundled_profiles()) for every in (1, 5)]
    assert [None if profile is None else profile.name for profile in chosen] == ["px4", "px4_sensor_combined"]


# ------------------------------------------------------------------------------------------------ damaged


def test_a_file_cut_anywhere_keeps_exactly_the_whole_messages_before_the_cut(whole: bytes) -> None:
    before = parse(whole)
    ends = before.starts + 3 + np.array([before.data[at] + 256 * int(before.data[at + 1]) for at in before.starts])
    chance = random.Random(11)
    cuts = [len(whole) - n for n in range(100)] + [chance.randrange(3000, len(whole)) for _ in range(60)]
    for cut in cuts:
        read = parse(whole[:cut])
        expected = int(np.count_nonzero(ends <= cut))
        assert expected - read.starts.size in (0, 1), cut
        assert np.array_equal(read.starts, before.starts[: read.starts.size])
        assert read.damage.skipped_bytes < 200
        assert read.damage.tail_cut or read.damage.skipped_bytes <= 23  # the kind of the future


def missing(whole: bytes, seed: int, tries: int) -> None:
    """Holes and missing bytes cost what stood there and two messages, and no sample is invented."""
    before = parse(whole)
    original = stored(before)
    chance = random.Random(seed)
    for _ in range(tries):
        at = chance.randrange(int(before.starts[400]), len(whole) - 5000)  # behind the last subscription
        for size, filling in ((517, b""), (4096, bytes(4096)), (4096, b"")):
            injured = whole[:at] + filling + whole[at + size :]
            read = parse(injured)
            for key, messages in stored(read).items():
                assert messages <= original[key], (at, size, key)
            stop = at + size
            touched = int(np.count_nonzero((before.starts < stop) & (before.starts > at - 200)))
            assert before.starts.size - read.starts.size <= touched + 2
            assert read.damage.resyncs <= 2
            assert read.damage.any


def test_missing_bytes_cost_a_few_messages_and_invent_none(whole: bytes) -> None:
    missing(whole, 12, 12)


@pytest.mark.data
@pytest.mark.parametrize("name", REAL)
def test_missing_bytes_of_a_real_log_cost_a_few_messages(shared_data: Path, name: str) -> None:
    missing((shared_data / "px4" / name).read_bytes(), 13, 3)


def test_two_halves_that_fit_together_are_found_by_their_time() -> None:
    log = begin()
    for i in range(400):
        log.put(ANGULAR, "QQ3f", 4000 * i, 4000 * i, i, 2 * i, 3 * i)
    data = log.data
    length = len(log.pieces[-1])
    at = len(data) - 200 * length + 25  # in the middle of a message; exactly 50 messages are missing
    spliced = data[:at] + data[at + 50 * length :]
    assert not parse(spliced).damage.any  # nothing in the format shows it
    fields = ("xyz[0]", "xyz[1]", "xyz[2]")
    assert set(samples(spliced, "vehicle_angular_velocity", fields)) < set(
        samples(data, "vehicle_angular_velocity", fields)
    )


def flipped(data: bytes, seed: int, first: int) -> bytes:
    chance = random.Random(seed)
    out = bytearray(data)
    for _ in range(200):
        out[chance.randrange(first, len(out))] ^= 1 << chance.randrange(8)
    return bytes(out)


def test_flipped_bytes_cost_only_the_messages_they_hit(whole: bytes) -> None:
    before = parse(whole)
    read = parse(flipped(whole, 14, int(before.starts[0])))
    lost = before.starts.size - read.starts.size
    assert 0 <= lost <= 20  # 2 of some 40 bytes are an id; the other three of a header are told by their neighbours
    assert set(read.starts.tolist()) <= set(before.starts.tolist())
    assert read.damage.any
    assert read.damage.describe()
    t = UlogTables(read, "log").series("vehicle_angular_velocity.xyz[0]").t
    assert np.all(np.diff(t) > 0)


@pytest.mark.data
@pytest.mark.parametrize("name", REAL)
def test_a_real_log_with_two_hundred_flipped_bytes_keeps_nearly_all(shared_data: Path, name: str) -> None:
    data = (shared_data / "px4" / name).read_bytes()
    before = parse(data)
    for seed in range(3):
        injured = flipped(data, seed, int(before.starts[0]))
        assert parse(injured).starts.size >= 0.999 * before.starts.size
        theirs = sum(one.data["timestamp"].size for one in ULog(io.BytesIO(injured)).data_list)
        assert parse(injured).starts.size > theirs


def test_messages_of_unknown_ids_are_stepped_over_and_named(whole: bytes) -> None:
    before = parse(whole)
    pieces, last = [], 0
    for at in before.starts[10::50].tolist():
        pieces += [whole[last:at], b"\x14\x00D\xff\x03" + bytes(range(18))]
        last = at
    injured = b"".join([*pieces, whole[last:]])
    read = parse(injured)
    assert stored(read) == stored(before)
    assert read.damage.unknown == {0x3FF: len(pieces) // 2}
    assert "1023" in read.damage.describe()


def test_a_topic_whose_format_is_lost_takes_no_other_with_it(whole: bytes) -> None:
    at = whole.index(b"vehicle_torque_setpoint:")
    for injured in (whole[: at - 1] + b"?" + whole[at:], whole[: at + 1] + b"\0" + whole[at + 2 :]):
        read, before = parse(injured), parse(whole)
        assert ("vehicle_torque_setpoint", 0) not in read.ids
        expected = stored(before)
        del expected["vehicle_torque_setpoint", 0]
        kept = stored(read)
        assert kept.keys() == expected.keys()
        assert sum(one.total() for one in kept.values()) >= sum(one.total() for one in expected.values()) - 2
        assert TORQUE in read.damage.unknown


def test_a_damaged_subscription_that_claims_an_id_twice_loses_to_the_true_one() -> None:
    log = begin()
    log.subscribe(ANGULAR, "vehicle_status")
    log.pieces.insert(2, log.pieces.pop())
    for i in range(50):
        log.put(ANGULAR, "QQ3f", 4000 * i, 4000 * i, 0, 0, 0)
        log.put(STATUS, "QBB", 4000 * i, 1, 2)
    read = parse(log.data)
    assert read.messages("vehicle_angular_velocity", 0).size == 50
    assert read.messages("vehicle_status", 0).size == 50


def test_a_log_without_its_header_is_read_where_its_name_says_what_it_is(whole: bytes, tmp_path: Path) -> None:
    path = tmp_path / "headless.ulg"
    path.write_bytes(bytes(16) + whole[16:])
    read = ulog.read(path)
    assert stored(read) == stored(parse(whole))
    assert (read.damage.resyncs, read.damage.any) == (1, True)
    assert ingest([path]).sources[0].kind == "ulog"


def test_what_was_being_written_at_a_crash_is_cut_where_data_is_appended(whole: bytes) -> None:
    at = int(parse(whole).starts[700])
    log = Writer(1, (at + 20, 0, 0))
    injured = (
        log.data + whole[len(log.data) : at + 20] + struct.pack("<HB", 20, ord("L")) + b"6" + bytes(8) + b"hard fault!"
    )
    read = parse(injured)
    assert read.starts.size in (699, 700)
    assert read.texts[-1][1] == "hard fault!"


@pytest.mark.parametrize(
    ("data", "words"),
    [
        (b"", "empty"),
        (b"ULog", "not a ULog"),
        (b"\0" * 5000, "not a ULog"),
        (Writer().data, "before its first sample"),
        (begin().data[:400], "before its first sample"),
        (Writer(2).data + begin().data[59:], "later kind"),
    ],
)
def test_what_cannot_be_read_is_refused_with_a_reason(data: bytes, words: str) -> None:
    with pytest.raises(TippathError, match=words):
        parse(data)


def test_a_file_that_is_not_there_is_refused(tmp_path: Path) -> None:
    with pytest.raises(TippathError, match="cannot be read"):
        ulog.read(tmp_path / "absent.ulg")


def test_a_log_without_a_sample_has_no_run(tmp_path: Path, tippath: Tippath) -> None:
    path = tmp_path / "short.ulg"
    path.write_bytes(begin().data)
    status, _, err = tippath("ingest", path)
    assert status == 1
    assert err


def test_hostile_sizes_cost_neither_memory_nor_time() -> None:
    log = begin()
    nested = {"t0": "uint64_t timestamp;float[65535] x;", "me": "uint64_t timestamp;me[9] me;"}
    nested |= {f"t{i}": f"uint64_t timestamp;t{i - 1}[65535] x;" for i in range(1, 40)}
    nested |= {f"u{i}": "uint64_t timestamp;uint8_t[65000] x;" for i in range(400)}
    nested |= {"bad": "uint64_t timestamp;float[-1] x;", "worse": "uint64_t timestamp;float[99999] x;", "no": "nothing"}
    log.define(nested)
    for i, name in enumerate(nested):
        log.subscribe(100 + i, name)
        log.put(100 + i, "Q", i)
    for i in range(400):
        log.pieces.append(b"\xff\xffD" + struct.pack("<H", 1000 + i))
    log.put(142 + 1, "Q65000s", 1, b"")
    data = log.data + b"D" * 300_000 + b"\xff" * 100_000 + b"\1\0X!" * 50_000
    tracemalloc.start()
    try:
        begun = time.process_time()
        tables = UlogTables(parse(data), "log")
        assert len(tables.fields()) < 70_000
        assert time.process_time() - begun < 20
        assert tracemalloc.get_traced_memory()[1] < 100e6
    finally:
        tracemalloc.stop()


def header(chance: random.Random) -> bytes:
    """Of a message that may be one."""
    head = struct.pack("<HB", chance.choice((0, 8, 42, 0xFFFF)), chance.choice(b"ABCDFILMOPQRSZ"))
    return head + chance.choice((b"", SYNC, struct.pack("<H", chance.choice((3, 4, 500)))))


def mutated(data: bytes, chance: random.Random) -> bytes:
    """With headers anywhere."""
    return injure(data, chance, header)


@pytest.mark.parametrize("count", COUNTS)
def test_no_injury_makes_the_reader_fail(whole: bytes, count: int) -> None:
    chance = random.Random(15)
    short = whole[:45_000]
    read_at_all = 0
    for _ in bounded_turns(count):
        try:
            log = parse(mutated(short, chance))
        except TippathError:
            continue
        read_at_all += 1
        assert 0 <= log.damage.skipped_bytes <= log.damage.total_bytes
        assert np.all(np.diff(log.starts) > 0)
        tables = UlogTables(log, "log", "timestamp_sample")
        for key in tables.fields():
            series = tables.series(key)
            assert series.t.size == series.values.size > 0
            assert np.all(np.diff(series.t) > 0)
        assert len(tables.armed()) <= len(tables.modes()) + 100
        assert all(text.isprintable() for _, text in tables.texts())
        assert tables.sampled_s >= 0
    assert read_at_all > 0.75 * count


def test_no_injury_makes_ingest_fail(whole: bytes, tmp_path: Path, tippath: Tippath) -> None:
    chance = random.Random(16)
    path = tmp_path / "injured.ulg"
    for _ in range(12):
        path.write_bytes(mutated(whole, chance))
        assert tippath("ingest", path, "--explain")[0] in (0, 1)
