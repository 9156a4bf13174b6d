"""Telemetry logs against another program's reader, against damage, and what is told of them."""

from __future__ import annotations

import json
import random
import struct
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from injuries import COUNTS, bounded_turns, injure
from pymavlink import mavutil
from pymavlink.dialects.v20 import all as mavlink

from gcs.errors import TippathError
from gcs.link.tlog import PAD, Frames, layouts, locate
from gcs.logs import ingest, opening
from gcs.logs.formats import tlog
from gcs.logs.formats.tlog import TlogTables
from gcs.logs.profile import mapping

BEGUN_US = 1_700_000_000_000_000


def padded(data: bytes) -> np.ndarray:
    return np.frombuffer(data + bytes(PAD), np.uint8)


def frames_of(data: bytes) -> Frames:
    return locate(padded(data), len(data))


def read(data: bytes) -> tlog.Read:
    return tlog.parse(padded(data), len(data), "log.tlog")


def raw_frames(frames: Frames) -> Counter[tuple[int, int, bytes]]:
    """Every frame as source, id and payload."""
    spans = zip(frames.payloads.tolist(), frames.lengths.tolist(), strict=True)
    payloads = [frames.data[at : at + length].tobytes() for at, length in spans]
    return Counter(zip(frames.sources.tolist(), frames.ids.tolist(), payloads, strict=True))


class Station:
    """Writes a telemetry log with pymavlink's own packing."""

    def __init__(self) -> None:
        self.pieces: list[bytes] = []
        self._links: dict[tuple[int, int, bool], Any] = {}

    def add(
        self, at_s: float, message: Any, system: int = 1, component: int = 1, *, old: bool = False, signed: bool = False
    ) -> None:
        key = (system, component, signed)
        if key not in self._links:
            link = self._links[key] = mavlink.MAVLink(None, srcSystem=system, srcComponent=component)
            if signed:
                link.signing.secret_key = bytes(range(32))
                link.signing.sign_outgoing = True
        frame = bytes(message.pack(self._links[key], force_mavlink1=old))
        self.pieces.append(struct.pack(">Q", BEGUN_US + round(1e6 * at_s)) + frame)

    @property
    def data(self) -> bytes:
        return b"".join(self.pieces)


def heartbeat(mode: int = 0, armed: bool = False, kind: int = 2, autopilot: int = 3) -> Any:
    return mavlink.MAVLink_heartbeat_message(kind, autopilot, 1 | 128 * armed, mode, 4, 3)


def station_heartbeat() -> Any:
    return mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3)


def attitude(boot_s: float, p: float = 0.0) -> Any:
    return mavlink.MAVLink_attitude_message(round(1000 * boot_s), 0.1, -0.1, 0.0, p, -p, 0.5)


def servos(boot_s: float, *pulses: int) -> Any:
    us = round(1e6 * boot_s) & 0xFFFFFFFF
    return mavlink.MAVLink_servo_output_raw_message(us, 0, *pulses, *(0,) * (8 - len(pulses)))


def flight(seconds: float = 20.0, old: bool = False, signed: bool = False, started_s: float = 3.0) -> Station:
    """A vehicle 1/1 with ATTITUDE and SERVO_OUTPUT_RAW at 50 Hz, and the station 255/190."""
    log = Station()
    for i in range(round(50 * seconds)):
        t = i / 50
        log.add(t + 0.03, attitude(started_s + t, 0.01 * i), old=old, signed=signed)
        log.add(t + 0.031, servos(started_s + t, 1500 + i % 100, 1400), old=old, signed=signed)
        if i % 50 == 0:
            mode = 25 if 5 <= t < 15 else 0
            log.add(t + 0.032, heartbeat(mode, armed=t >= 2), old=old, signed=signed)
            log.add(t + 0.033, station_heartbeat(), 255, 190, old=old)
    return log


# ------------------------------------------------------------------------------------------------ values


def compare(path: Path) -> int:
    """Every value of every frame must be mavutil's; returns how many values were compared."""
    data = path.read_bytes()
    frames = frames_of(data)
    tables = {int(id): frames.table(int(id), np.flatnonzero(frames.ids == id)) for id in np.unique(frames.ids)}
    place: Counter[int] = Counter()
    compared = count = 0
    other = mavutil.mavlink_connection(str(path))
    try:
        while (message := other.recv_msg()) is not None:
            assert message.get_type() != "BAD_DATA"
            id = message.get_msgId()
            assert frames.ids[count] == id
            assert frames.sources[count] == 256 * message.get_srcSystem() + message.get_srcComponent()
            assert abs(frames.received_us[count] * 1e-6 - message._timestamp) < 1e-6
            row = tables[id][place[id]]
            for name in message.get_fieldnames():
                ours, theirs = row[name], getattr(message, name)
                compared += 1
                if isinstance(theirs, str):
                    assert bytes(ours).split(b"\0")[0].decode("utf-8", "replace") == theirs
                elif isinstance(theirs, list):
                    assert np.array_equal(ours, np.array(theirs, ours.dtype), equal_nan=ours.dtype.kind == "f")
                else:
                    assert ours == theirs or (ours != ours and theirs != theirs), (message, name, ours)
            place[id] += 1
            count += 1
    finally:
        other.close()
    assert count == frames.ids.size
    assert frames.skipped_bytes == 0
    return compared


@pytest.mark.data
@pytest.mark.parametrize(("name", "values"), [("from_vehicle", 100_000), ("from_ground", 1500)])
def test_every_value_of_a_real_log_is_mavutils(shared_data: Path, name: str, values: int) -> None:
    assert compare(shared_data / "ardupilot" / f"quad_pitch_{name}.tlog") > values


@pytest.mark.parametrize(("old", "signed"), [(True, False), (False, False), (False, True)])
def test_every_value_of_both_versions_and_of_signed_frames(tmp_path: Path, old: bool, signed: bool) -> None:
    log = flight(4, old, signed)
    for text in ("", "a", "x" * 50):
        log.add(5, mavlink.MAVLink_statustext_message(6, text.encode()), old=old, signed=signed)
    log.add(5, mavlink.MAVLink_param_value_message(b"SIXTEEN_LETTERS_", 1.5, 9, 1, 0), old=old, signed=signed)
    controls = [0.5, -0.25, float("nan"), 0, 0, 0, 0, 0]
    log.add(5, mavlink.MAVLink_actuator_control_target_message(5, 0, controls), old=old, signed=signed)
    log.add(5, mavlink.MAVLink_gps_raw_int_message(5, 3, -(2**31), 2**31 - 1, -1, 1, 2, 3, 4, 5), old=old)
    path = tmp_path / "flight.tlog"
    path.write_bytes(log.data)
    assert compare(path) > 3000


def test_every_kind_of_message_that_is_known_has_its_layout() -> None:
    log = Station()
    made = 0
    for id, kind in mavlink.mavlink_map.items():
        items = zip(kind.fieldtypes, (kind.array_lengths[i] for i in kind.orders), strict=True)
        values: list[Any] = []
        for type, length in items:
            one: Any = 3.5 if type in ("float", "double") else 7
            values.append(b"ab" if type == "char" and length else [one] * length if length else one)
        if any(v == 7 and t == "char" for v, t in zip(values, kind.fieldtypes, strict=True)):
            continue  # a single character: pymavlink has no such message in use
        log.add(0, kind(*values), old=False)
        made += 1
        assert layouts()[id].dtype.itemsize == kind.unpacker.size
    assert frames_of(log.data).ids.size == made > 300


# ------------------------------------------------------------------------------------------------ clock and vehicle


def test_samples_have_the_vehicles_clock_and_texts_come_between_them() -> None:
    log = flight(4)
    log.add(4.0, mavlink.MAVLink_statustext_message(6, b"late \x1b[2Jtext"))
    boot = read(log.data).boots[0]
    rates = boot.series("ATTITUDE.rollspeed")
    assert rates.t == pytest.approx(3 + np.arange(200) / 50)
    assert rates.values == pytest.approx(0.01 * np.arange(200))
    assert boot.series("SERVO_OUTPUT_RAW.servo1_raw").t == pytest.approx(3 + np.arange(200) / 50)
    beats = boot.series("HEARTBEAT.custom_mode").t
    assert beats == pytest.approx(3 + np.arange(4) + 0.002, abs=1e-3)
    ((at, text),) = boot.texts()
    assert text == "late text"
    assert at == pytest.approx(6.98 + (4.0 - 4.011), abs=0.05)


def test_a_wall_clock_that_jumps_moves_nothing() -> None:
    log = Station()
    for i in range(100):
        jump = 3600 if i >= 50 else 0
        log.add(i / 50 + jump, attitude(1 + i / 50))
        log.add(i / 50 + 0.001 + jump, heartbeat())
    beats = read(log.data).boots[0].series("HEARTBEAT.custom_mode").t
    assert np.all((beats >= 1 + np.arange(100) / 50) & (beats <= 1.02 + np.arange(100) / 50))


def test_microseconds_that_count_from_1970_or_run_over_keep_their_spacing() -> None:
    log = Station()
    begun = 4290.0  # s since boot: 32 bits of microseconds run over at 4294.967
    for i in range(500):
        t = begun + i / 50
        log.add(i / 50, attitude(t))
        log.add(i / 50, servos(t, 1500))
        imu = mavlink.MAVLink_highres_imu_message(BEGUN_US + 20_000 * i + i % 3, *(0.0,) * 13, 0)
        log.add(i / 50 + 0.001 * (i % 7), imu)
    boot = read(log.data).boots[0]
    assert boot.series("SERVO_OUTPUT_RAW.servo1_raw").t == pytest.approx(begun + np.arange(500) / 50)
    imu_t = boot.series("HIGHRES_IMU.xgyro").t
    assert np.diff(imu_t) == pytest.approx(np.diff(0.02 * np.arange(500) + 1e-6 * (np.arange(500) % 3)), abs=1e-9)
    assert imu_t[0] == pytest.approx(begun, abs=0.01)
    assert not boot.dropped


def test_a_log_without_the_vehicles_clock_has_that_of_receipt() -> None:
    log = Station()
    for i in range(50):
        log.add(i / 10, mavlink.MAVLink_vfr_hud_message(i, 0, 0, 0, 0, 0))
    series = read(log.data).boots[0].series("VFR_HUD.airspeed")
    assert series.t == pytest.approx(np.arange(50) / 10)


def test_two_boots_are_two_logs_and_what_came_before_the_first_sample_is_of_the_second() -> None:
    first, second = flight(10), flight(10, started_s=2.0)
    log = Station()
    log.pieces = list(first.pieces)
    for at in (30.5, 31.5):
        log.add(at, heartbeat(mode=7))
    for piece in second.pieces:
        (us,) = struct.unpack(">Q", piece[:8])
        log.pieces.append(struct.pack(">Q", us + 32_000_000) + piece[8:])
    found = read(log.data)
    one, two = found.boots
    assert one.series("ATTITUDE.roll").t.size == two.series("ATTITUDE.roll").t.size == 500
    assert (one.series("ATTITUDE.roll").t[0], two.series("ATTITUDE.roll").t[0]) == (3.0, 2.0)
    assert [mode for _, mode in one.modes()] == [0, 25]
    assert [mode for _, mode in two.modes()] == [7, 0, 25]
    assert any("2 times" in note for note in found.notes)


def test_frames_that_overtake_each_other_are_no_second_boot() -> None:
    log = flight(5)
    log.pieces[100], log.pieces[140] = log.pieces[140], log.pieces[100]
    (boot,) = read(log.data).boots
    assert boot.series("ATTITUDE.roll").t.size >= 248
    assert sum(boot.dropped.values()) <= 2


def test_the_station_other_components_and_other_vehicles_are_told_and_left_out() -> None:
    log = flight(4)
    for i in range(100):
        log.add(i / 25, attitude(100 + i / 25, 9.0), system=2)
        log.add(i / 25, heartbeat(mode=3), system=2)
        log.add(i / 25, mavlink.MAVLink_heartbeat_message(26, 8, 0, 0, 4, 3), component=154)
    found = read(log.data)
    (boot,) = found.boots
    assert boot.series("ATTITUDE.rollspeed").values.max() < 2.0
    assert [mode for _, mode in boot.modes()] == [0]
    assert any("2 vehicles" in note and "system 2" in note for note in found.notes)
    hints = " ".join(found.hints)
    assert "system 255, component 190, a ground station" in hints
    assert "component 154" in hints


def test_instances_arrays_and_names() -> None:
    log = Station()
    for i in range(20):
        log.add(i / 10, attitude(1 + i / 10))
        for group in (1, 0):
            controls = [group + 0.25, i] + [0] * 6
            log.add(i / 10, mavlink.MAVLink_actuator_control_target_message(1_000_000 + 100_000 * i, group, controls))
    boot = read(log.data).boots[0]
    assert boot.series("ACTUATOR_CONTROL_TARGET.controls[1]").values == pytest.approx(np.arange(20))
    assert set(boot.series("ACTUATOR_CONTROL_TARGET[1].controls[0]").values) == {1.25}
    assert set(boot.series("ACTUATOR_CONTROL_TARGET.controls[0]").values) == {0.25}
    for key in (
        "ACTUATOR_CONTROL_TARGET.controls",
        "ACTUATOR_CONTROL_TARGET.controls[8]",
        "ACTUATOR_CONTROL_TARGET[2].controls[0]",
        "ATTITUDE[0].roll",
        "ATTITUDE.roll[0]",
        "ATTITUDE.absent",
        "HEARTBEAT.type",
        "nonsense",
    ):
        assert not boot.has(key)
    for key in boot.fields():
        assert boot.has(key)
        assert boot.series(key).t.size


def test_modes_arming_and_texts_in_chunks() -> None:
    log = flight(20)
    for chunk, text in ((1, b"y" * 10), (0, b"x" * 50)):
        log.add(20, mavlink.MAVLink_statustext_message(4, text, 9, chunk))
    boot = read(log.data).boots[0]
    assert [(round(t, 1), mode) for t, mode in boot.modes()] == [(3.0, 0), (8.0, 25), (18.0, 0)]
    assert [(round(t, 1), armed) for t, armed in boot.armed()] == [(3.0, False), (5.0, True)]
    assert [text for _, text in boot.texts()] == ["x" * 50 + "y" * 10]


@pytest.mark.data
def test_modes_and_texts_of_a_real_log_are_mavutils(shared_data: Path) -> None:
    path = shared_data / "ardupilot" / "quad_pitch_from_vehicle.tlog"
    boot = tlog.read(path).boots[0]
    modes, texts = [], []
    other = mavutil.mavlink_connection(str(path))
    try:
        while (message := other.recv_msg()) is not None:
            if message.get_type() == "HEARTBEAT" and modes[-1:] != [message.custom_mode]:
                modes.append(message.custom_mode)
            if message.get_type() == "STATUSTEXT":
                texts.append(message.text)
    finally:
        other.close()
    assert [mode for _, mode in boot.modes()] == modes
    assert [text for _, text in boot.texts()] == texts
    assert [armed for _, armed in boot.armed()] == [False, True, False]
    assert boot.sampled_s == pytest.approx(219.7, abs=0.2)


# ------------------------------------------------------------------------------------------------ damage


def original() -> tuple[bytes, Counter[tuple[int, int, bytes]]]:
    data = flight(20).data
    return data, raw_frames(frames_of(data))


def test_flips_cost_only_the_frames_they_hit() -> None:
    data, before = original()
    injured = bytearray(data)
    chance = random.Random(21)
    for _ in range(200):
        injured[chance.randrange(len(injured))] ^= 1 << chance.randrange(8)
    found = frames_of(bytes(injured))
    assert before.total() - 200 <= raw_frames(found).total() < before.total()
    assert raw_frames(found) <= before
    assert 50 < found.resyncs <= 200


def test_a_damaged_time_does_not_cost_the_frame_behind_it() -> None:
    data, before = original()
    pieces = flight(20).pieces
    at = len(b"".join(pieces[:300]))
    injured = data[:at] + b"\xff\xfd\xfe\xff" + data[at + 4 :]
    found = frames_of(injured)
    assert raw_frames(found) == before
    assert found.skipped_bytes == 8
    assert found.received_us[300] == -1
    whole, boot = read(data).boots[0], read(injured).boots[0]
    assert np.array_equal(boot.series("ATTITUDE.roll").t, whole.series("ATTITUDE.roll").t)
    assert boot.series("HEARTBEAT.type").t == pytest.approx(whole.series("HEARTBEAT.type").t, abs=0.03)


@pytest.mark.parametrize("size", [1, 7, 60, 517, 4096])
def test_holes_garbage_and_zeros_cost_what_they_cover(size: int) -> None:
    data, before = original()
    chance = random.Random(22)
    for filling in (b"", bytes(size), chance.randbytes(size), b"\xfd" * size):
        at = chance.randrange(1000, len(data) - 6000)
        injured = data[:at] + filling + data[at + size :]
        found = frames_of(injured)
        assert raw_frames(found) <= before
        assert before.total() - raw_frames(found).total() <= size / 20 + 2
        assert found.resyncs == 1 or (found.resyncs == 0 and size == 1)  # a byte of a time may be another time
        assert not found.tail_cut
        assert found.skipped_bytes <= len(filling) + 120


def test_a_cut_tail_is_told_and_costs_one_frame() -> None:
    data, before = original()
    for cut in range(1, 60):
        found = frames_of(data[:-cut])
        assert before.total() - raw_frames(found).total() <= 2
        assert found.tail_cut == (found.skipped_bytes > 0)


def test_frames_of_unknown_ids_are_stepped_over_and_named() -> None:
    log = flight(2)
    strange = bytes([0xFD, 3, 0, 0, 0, 1, 1, 0x99, 0x88, 0x77, 1, 2, 3, 0, 0])
    for at in (10, 11, 50):
        log.pieces.insert(at, struct.pack(">Q", BEGUN_US) + strange)
    found = frames_of(log.data)
    assert found.unknown == {0x778899: 3}
    assert found.resyncs == 0
    assert found.skipped_bytes == 3 * 23
    assert found.ids.size == len(log.pieces) - 3


def test_a_frame_that_another_carries_is_not_taken_for_one() -> None:
    log = flight(1)
    hidden = flight(1).pieces[-1]
    tunnel = mavlink.MAVLink_tunnel_message(0, 0, 0, len(hidden), hidden.ljust(128, b"\0"))
    before = len(log.pieces)
    log.add(1, tunnel)
    log.add(1, heartbeat())
    found = frames_of(log.data)
    assert found.ids.size == before + 2
    assert found.skipped_bytes == 0


def mutated(data: bytes, chance: random.Random) -> bytes:
    """With beginnings of frames anywhere."""
    return injure(
        data,
        chance,
        lambda chance: bytes([chance.choice((0xFD, 0xFE)), chance.randrange(256), 0]),
        (1, 3, 8, 40, 200, 4096),
    )


@pytest.mark.parametrize("count", COUNTS)
def test_no_injury_makes_the_reader_fail_and_none_invents_a_frame(count: int) -> None:
    data = flight(10).data
    known = set(raw_frames(frames_of(data)))
    samples = {
        (t, v)
        for key in ("ATTITUDE.rollspeed", "SERVO_OUTPUT_RAW.servo1_raw")
        for s in [read(data).boots[0].series(key)]
        for t, v in zip(s.t.tolist(), s.values.tolist(), strict=True)
    }
    chance = random.Random(23)
    read_at_all = 0
    for _ in bounded_turns(count):
        injured = mutated(data, chance)
        frames = frames_of(injured)
        assert set(raw_frames(frames)) <= known
        assert 0 <= frames.skipped_bytes <= len(injured)
        try:
            found = read(injured)
        except TippathError:
            continue
        read_at_all += 1
        for boot in found.boots:
            for key in boot.fields():
                series = boot.series(key)
                assert np.all(np.diff(series.t) >= 0)
                assert series.t.size == series.values.size
            for key in ("ATTITUDE.rollspeed", "SERVO_OUTPUT_RAW.servo1_raw"):
                if boot.has(key):
                    series = boot.series(key)
                    assert set(zip(series.t.tolist(), series.values.tolist(), strict=True)) <= samples
            boot.texts(), boot.modes(), boot.armed()
    assert read_at_all > 0.75 * count


def test_random_payloads_with_right_checksums_come_through() -> None:
    chance = random.Random(24)
    log = Station()
    kinds = [kind for kind in mavlink.mavlink_map.values() if kind.unpacker.size <= 255]
    for i in range(2000):
        kind = chance.choice(kinds)
        frame = bytes([chance.randrange(1, 256)]) + chance.randbytes(kind.unpacker.size - 1)
        id = kind.id
        head = bytes([len(frame), 0, 0, i % 256, 1, 1, id & 255, id >> 8 & 255, id >> 16])
        crc = mavutil.x25crc(head + frame)
        crc.accumulate(bytes([kind.crc_extra]))
        stamp = struct.pack(">Q", BEGUN_US + 10_000 * i)
        log.pieces.append(stamp + b"\xfd" + head + frame + struct.pack("<H", crc.crc))
    found = frames_of(log.data)
    assert found.ids.size == 2000
    try:
        boots = read(log.data).boots
    except TippathError:
        return
    with np.errstate(all="ignore"):
        for boot in boots:
            for key in boot.fields():
                boot.series(key)
            boot.texts(), boot.modes(), boot.armed()


def test_what_is_no_log_is_refused_with_a_reason(tmp_path: Path) -> None:
    chance = random.Random(25)
    for data, words in ((b"", "empty"), (chance.randbytes(5000), "not a telemetry log"), (bytes(5000), "not a tel")):
        with pytest.raises(TippathError, match=words):
            read(data)
    with pytest.raises(TippathError, match="cannot be read"):
        tlog.read(tmp_path / "absent.tlog")


# ------------------------------------------------------------------------------------------------ opening


def test_a_log_is_recognised_whatever_its_ending(tmp_path: Path) -> None:
    for i, log in enumerate((flight(4), flight(4, old=True), flight(4, signed=True))):
        path = tmp_path / f"flight{i}.dat"
        path.write_bytes(log.data)
        opened = opening.open_log(path, None)
        assert opened.kind == "tlog"
        assert opened.profile.name == "tlog"
    path = tmp_path / "cut.tlog"
    path.write_bytes(log.data[13:])
    assert opening.open_log(path, None).kind == "tlog"


@pytest.mark.data
def test_the_verdict_on_a_real_flight_names_the_maneuver_and_the_rates(
    shared_data: Path, tippath: Callable[..., tuple[int, str, str]]
) -> None:
    path = shared_data / "ardupilot" / "quad_pitch_from_vehicle.tlog"
    status, out, _ = tippath("ingest", path, "--json")
    document = json.loads(out)
    assert status == 1
    (run,) = document["runs"]
    assert (run["axis"], run["usable"]) == ("pitch", False)
    assert run["start_s"] == pytest.approx(76.9, abs=0.5)
    reasons = " ".join(run["reasons"])
    assert "ATTITUDE at 25 Hz: too slow for attitude identification" in reasons
    assert "actuators not logged" in reasons
    assert "SERVO_OUTPUT_RAW at 5 Hz" in reasons
    assert any("own log (.BIN, .ulg)" in note for note in document["sources"][0]["notes"])


@pytest.mark.data
def test_a_log_of_what_was_sent_to_a_vehicle_is_refused_as_such(
    shared_data: Path, tippath: Callable[..., tuple[int, str, str]]
) -> None:
    status, _, err = tippath("ingest", shared_data / "ardupilot" / "quad_pitch_from_ground.tlog")
    assert status == 1
    assert "nothing in it comes from a vehicle" in err
    assert "ground station" in err


def fast_flight(frame: float | None) -> bytes:
    """A roll chirp of a quadrotor at 200 Hz in mode SYSTEMID, as fast as a link can carry it."""
    log = Station()
    if frame is not None:
        log.add(0, mavlink.MAVLink_param_value_message(b"FRAME_TYPE", frame, 2, 1, 0))
    rate = 0.0
    for i in range(200 * 24):
        t = i / 200
        flying = 2 <= t < 20
        x = 0.1 * np.sin(2 * np.pi * (0.5 * (t - 2) + 0.25 * (t - 2) ** 2)) if flying else 0.0
        rate += (20 * x - 4 * rate) / 200
        a = round(500 * x)
        log.add(
            t,
            mavlink.MAVLink_highres_imu_message(
                round(1e6 * t) + 5_000_000, 0, 0, -9.8, rate, 0.01 * rate, *(0,) * 8, 0
            ),
        )
        log.add(t, servos(5 + t, 1500 - a, 1500 + a, 1500 + a, 1500 - a))
        if i % 20 == 0:
            log.add(t, attitude(5 + t))
        if i % 200 == 0:
            log.add(t, heartbeat(25 if 1 <= t < 22 else 0, armed=True))
    return log.data


@pytest.mark.parametrize(("frame", "profile"), [(1.0, "tlog_motors"), (0.0, "tlog"), (None, "tlog")])
def test_commands_come_from_four_motors_only_where_the_vehicle_says_x(
    tmp_path: Path, frame: float | None, profile: str
) -> None:
    path = tmp_path / "flight.tlog"
    path.write_bytes(fast_flight(frame))
    found = ingest([path])
    assert found.sources[0].profile is not None
    assert found.sources[0].profile.name == profile
    assert bool(found.usable) == (frame == 1.0), [run.reasons for run in found.runs]
    if found.usable:
        record = found.usable[0].record
        assert record is not None
        assert np.abs(record.channels["delta_x"]).max() == pytest.approx(0.1, abs=0.002)
        assert found.usable[0].rate_source == "HIGHRES_IMU"


def test_streamed_controls_are_commands(tmp_path: Path) -> None:
    log = Station()
    for i in range(400):
        us = 1_000_000 + 5000 * i
        log.add(i / 200, mavlink.MAVLink_highres_imu_message(us, *(0.0,) * 3, 0.5, -0.5, *(0.0,) * 8, 0))
        log.add(i / 200, mavlink.MAVLink_actuator_control_target_message(us, 0, [0.1, -0.2, 0, 0.5, 0, 0, 0, 0]))
    path = tmp_path / "px4.tlog"
    path.write_bytes(log.data)
    opened = opening.open_log(path, None)
    assert opened.profile.name == "tlog"
    boot = opened.boots[0]
    assert isinstance(boot, TlogTables)
    channels = mapping.apply(opened.profile, boot).channels
    assert set(channels["delta_x"]) == {np.float32(0.1)}
    assert set(channels["delta_y"]) == {np.float32(-0.2)}
    assert channels["t"] == pytest.approx(1 + 0.005 * np.arange(400))
