"""MCAP recordings of ROS 2: topics beside each other, stamps, an index that is not there, and damage."""

from __future__ import annotations

import builtins
import io
import json
import random
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from injuries import FIRSTS, STEP, bounded, bounded_turns, injure

from gcs.cli import main
from gcs.errors import TippathError
from gcs.logs import ingest
from gcs.logs.formats import mcap
from sysid.data.record import Record

writing = pytest.importorskip("mcap.writer")
ros2 = pytest.importorskip("mcap_ros2.writer")

Saved = Callable[[bytes, str], Path]
RATES = """geometry_msgs/Vector3 rate
float64[4] motors
string frame
================================================================================
MSG: geometry_msgs/Vector3
float64 x
float64 y
float64 z
"""
STAMPED = """std_msgs/Header header
float32[] controls
================================================================================
MSG: std_msgs/Header
builtin_interfaces/Time stamp
string frame_id
================================================================================
MSG: builtin_interfaces/Time
int32 sec
uint32 nanosec
"""
START_NS = 1_790_000_000_000_000_000
PROFILE = b"""
[channels.p]
source = "imu_data.rate.x"
[channels.q]
source = "-imu_data.rate.y"
[channels.delta_x]
source = "fmu_out_mix.controls[0]"
[channels.delta_y]
source = "fmu_out_mix.controls[1]"
"""


def flight(count: int = 1500) -> dict[str, np.ndarray]:
    t = np.arange(count) / 200
    x, y = 0.1 * np.sin(2 * np.pi * t), 0.1 * np.cos(2 * np.pi * 1.3 * t)
    return {"t": t, "p": 3 * x, "q": 2 * y, "delta_x": x, "delta_y": y}


def recorded(count: int = 1500, *, finished: bool = True, late_s: float = 0.0, chunk: int = 20_000) -> bytes:
    """Rates without a stamp; commands with one, recorded by `late_s` later."""
    stream = io.BytesIO()
    writer = ros2.Writer(stream, chunk_size=chunk)
    rates, mix = (writer.register_msgdef(f"made/{name}", text) for name, text in (("Rates", RATES), ("Mix", STAMPED)))
    made = flight(count)
    for i, t in enumerate(made["t"]):
        at = START_NS + round(1e9 * t)
        rate = {"rate": {"x": made["p"][i], "y": -made["q"][i], "z": 0.0}, "motors": [1.0, 2.0, 3.0, 4.0], "frame": "b"}
        writer.write_message("/imu/data", rates, rate, at)
        header = {"stamp": {"sec": at // 10**9, "nanosec": at % 10**9}, "frame_id": ""}
        controls = {"header": header, "controls": [made["delta_x"][i], made["delta_y"][i], 0.5]}
        writer.write_message("/fmu/out/mix", mix, controls, at + round(1e9 * late_s))
    if finished:
        writer.finish()
    return stream.getvalue()


def read(path: Path, profile: Path) -> tuple[Record, Any]:
    found = ingest([path], profile)
    (run,) = found.runs
    assert run.usable
    return run.record, found.sources[0]


def test_topics_are_fields_and_stamps_count(saved: Saved) -> None:
    record, source = read(saved(recorded(late_s=0.05), "f.mcap"), saved(PROFILE, "p.toml"))
    made = flight()
    assert np.allclose(record.t, made["t"], atol=1e-6)
    for name in ("p", "q"):
        assert np.allclose(record.channels[name], made[name])
    # float32 in the message; by their stamps, not by when they were recorded
    assert np.allclose(record.channels["delta_x"], made["delta_x"], atol=1e-6)
    assert {"imu_data.t", "imu_data.rate.x", "imu_data.motors[3]", "fmu_out_mix.controls[2]"} <= set(source.fields)
    assert not any("header" in name or "frame" in name for name in source.fields)


def test_a_recording_without_an_index_is_read(saved: Saved) -> None:
    """A recorder that was stopped hard writes neither index nor end; what its last chunk held is lost."""
    record, source = read(saved(recorded(finished=False), "f.mcap"), saved(PROFILE, "p.toml"))
    assert record.t.size > 1000
    assert np.allclose(record.channels["p"], flight()["p"][: record.t.size])
    assert any("the recording ends early" in hint for hint in source.hints)


def test_a_damaged_chunk_is_left_out(saved: Saved) -> None:
    raw = bytearray(recorded())
    at = len(raw) // 2
    raw[at : at + 8] = bytes(8)
    found = ingest([saved(bytes(raw), "f.mcap")], saved(PROFILE, "p.toml"))
    (run,), damage = found.runs, found.sources[0].damage
    assert damage.resyncs == 1
    assert len(run.gaps) == 1
    made = flight()
    place = np.round(run.record.t * 200).astype(int)
    assert np.allclose(run.record.channels["p"], made["p"][place])


PX4_RATES = "uint64 timestamp\nuint64 timestamp_sample\nfloat32[3] xyz\nfloat32[3] xyz_derivative\n"
PX4_TORQUE = "uint64 timestamp\nuint64 timestamp_sample\nfloat32[3] xyz\n"
PX4_COMBINED = "uint64 timestamp\nfloat32[3] gyro_rad\nuint32 gyro_integral_dt\nfloat32[3] accelerometer_m_s2\n"
IMU = (
    "std_msgs/Header header\ngeometry_msgs/Vector3 angular_velocity\ngeometry_msgs/Vector3 linear_acceleration\n"
    + STAMPED[STAMPED.index("====") :]
    + RATES[RATES.index("====") :]
)
ACTUATORS = "std_msgs/Header header\nuint8 group_mix\nfloat32[8] controls\n" + STAMPED[STAMPED.index("====") :]


def px4_recorded(rates: str, torque: str, since_ns: int = 0) -> bytes:
    """Two topics as px4_msgs has them; recorded up to 4 ms late. PX4's clock begins at `since_ns` of the recorder's."""
    stream, made, draw = io.BytesIO(), flight(), np.random.default_rng(3)
    writer = ros2.Writer(stream)
    names = [rates.rpartition("/")[2], torque.rpartition("/")[2]]
    texts = [PX4_COMBINED if names[0] == "sensor_combined" else PX4_RATES, PX4_TORQUE]
    types = [name.title().replace("_", "") for name in names]
    kinds = [writer.register_msgdef(f"px4_msgs/{name}", text) for name, text in zip(types, texts, strict=True)]
    for i, t in enumerate(made["t"]):
        at = START_NS + round(1e9 * t)
        us = (at - since_ns) // 1000
        rate = [made["p"][i], made["q"][i], 0.0]
        fields: dict[str, Any] = {"timestamp_sample": us, "xyz": rate, "xyz_derivative": [0.0] * 3}
        if names[0] == "sensor_combined":
            fields = {"gyro_rad": rate, "gyro_integral_dt": 5000, "accelerometer_m_s2": [0.0, 0.0, -9.81]}
        late = (round(x) for x in draw.uniform(0, 4e6, 2))
        writer.write_message(rates, kinds[0], {"timestamp": us, **fields}, at + next(late))
        command = {"timestamp": us + 300, "timestamp_sample": us, "xyz": [made["delta_x"][i], made["delta_y"][i], 0.0]}
        writer.write_message(torque, kinds[1], command, at + next(late))
    writer.finish()
    return stream.getvalue()


@pytest.mark.parametrize("since_ns", [0, START_NS - 10**10], ids=["synchronised", "since its boot"])
@pytest.mark.parametrize("rates", ["vehicle_angular_velocity", "sensor_combined"])
@pytest.mark.parametrize("way", ["in", "out"])
def test_px4_topics_need_no_profile(saved: Saved, rates: str, way: str, since_ns: int) -> None:
    """Read by their own clock: recorded times waver by 4 ms."""
    raw = px4_recorded(f"/fmu/out/{rates}", f"/fmu/{way}/vehicle_torque_setpoint", since_ns)
    found = ingest([saved(raw, "f.mcap")])
    (run,), made = found.runs, flight()
    assert found.sources[0].profile.name.startswith("px4_ros2")
    assert run.usable
    assert np.allclose(np.diff(run.record.t), 0.005, atol=2e-6)
    for name in ("p", "q", "delta_x", "delta_y"):
        assert np.allclose(run.record.channels[name], made[name], atol=1e-6)


@pytest.mark.parametrize("imu", ["/mavros/imu/data", "/mavros/imu/data_raw"])
def test_mavros_topics_need_no_profile(saved: Saved, imu: str) -> None:
    """Its gyro is in ROS's axes, y to the left; commands are the autopilot's."""
    stream, made = io.BytesIO(), flight()
    writer = ros2.Writer(stream)
    gyro = writer.register_msgdef("sensor_msgs/Imu", IMU)
    control = writer.register_msgdef("mavros_msgs/ActuatorControl", ACTUATORS)
    for i, t in enumerate(made["t"]):
        at = START_NS + round(1e9 * t)
        header = {"stamp": {"sec": at // 10**9, "nanosec": at % 10**9}, "frame_id": "base_link"}
        rate = {"x": made["p"][i], "y": -made["q"][i], "z": 0.0}
        up = {"x": 0.0, "y": 0.0, "z": 9.81}
        writer.write_message(imu, gyro, {"header": header, "angular_velocity": rate, "linear_acceleration": up}, at)
        controls = [made["delta_x"][i], made["delta_y"][i], 0.0, 0.4, 0.0, 0.0, 0.0, 0.0]
        actuators = {"header": header, "group_mix": 0, "controls": controls}
        writer.write_message("/mavros/target_actuator_control", control, actuators, at)
    writer.finish()
    (run,) = ingest([saved(stream.getvalue(), "f.mcap")]).runs
    assert run.usable
    for name in ("p", "q", "delta_x", "delta_y"):
        assert np.allclose(run.record.channels[name], made[name], atol=1e-6)
    assert np.allclose(run.record.channels["az"], -9.81)


def test_messages_in_json(saved: Saved) -> None:
    stream = io.BytesIO()
    writer = writing.Writer(stream)
    writer.start()
    schema = writer.register_schema("made", "jsonschema", b"{}")
    channel = writer.register_channel("run", "json", schema)
    made = flight()
    for i, t in enumerate(made["t"]):
        values = {name: float(made[name][i]) for name in made if name != "t"}
        writer.add_message(channel, round(1e9 * t), json.dumps(values).encode(), round(1e9 * t))
    writer.finish()
    (run,) = ingest([saved(stream.getvalue(), "f.mcap")]).runs
    assert np.allclose(run.record.channels["delta_y"], made["delta_y"])


def test_what_to_write_is_proposed(saved: Saved, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["ingest", str(saved(recorded(200), "f.mcap")), "--explain"]) == 1
    out = capsys.readouterr().out
    assert "fields of this log: imu_data.t, imu_data.rate.x" in out
    assert "TIME_COLUMN" not in out  # each topic has its own
    assert '\ny = "left"\nz = "up"\n' in out  # REP 103
    assert 'source = "fmu_out_mix.controls[0]"' in out[out.index("[channels.delta_x]") :]
    assert 'source = "fmu_out_mix.controls[1]"' in out[out.index("[channels.delta_y]") :]


def test_nothing_of_use_is_told(saved: Saved) -> None:
    stream = io.BytesIO()
    writer = writing.Writer(stream)
    writer.start()
    channel = writer.register_channel("camera", "protobuf", writer.register_schema("x.Image", "protobuf", b"\0"))
    writer.add_message(channel, 0, b"\1", 0)
    writer.finish()
    with pytest.raises(TippathError, match="no message with numbers could be read; topics in it: camera"):
        ingest([saved(stream.getvalue(), "f.mcap")])


def test_not_installed_is_one_line(saved: Saved, monkeypatch: pytest.MonkeyPatch) -> None:
    usual = builtins.__import__

    def without(name: str, *rest: Any, **named: Any) -> Any:
        if name.split(".")[0] in ("mcap", "mcap_ros2", "pyarrow"):
            raise ImportError(name)
        return usual(name, *rest, **named)

    paths = [saved(recorded(20), "f.mcap"), saved(b"PAR1" + bytes(20) + b"PAR1", "f.parquet")]
    monkeypatch.setattr(builtins, "__import__", without)
    for path, package in zip(paths, ("mcap", "pyarrow"), strict=True):
        with pytest.raises(TippathError, match=rf"what reads it is not installed: \S+ -m pip install {package}"):
            ingest([path])


@pytest.mark.parametrize("raw", [b"", mcap.MARK, mcap.MARK + b"\x01"])
def test_empty_and_cut_files_are_refused(saved: Saved, raw: bytes) -> None:
    with pytest.raises(TippathError, match="no message with numbers could be read"):
        ingest([saved(raw, "f.mcap")])


@pytest.mark.parametrize("first", FIRSTS)
def test_no_damage_is_a_traceback(saved: Saved, first: int) -> None:
    raw, profile = recorded(30, chunk=1500), saved(PROFILE, "p.toml")
    for seed in bounded_turns(STEP, first):
        damaged = injure(raw, random.Random(seed), lambda chance: raw[: chance.randrange(1, 300)], cut=True)
        try:
            ingest([saved(damaged, "f.mcap")], profile)
        except TippathError as error:
            assert len(str(error).splitlines()) == 1  # noqa: PT017


@pytest.mark.parametrize("packing", ["LZ4", "ZSTD"])
def test_a_small_file_that_becomes_gigabytes_is_refused(saved: Saved, packing: str) -> None:
    stream = io.BytesIO()
    writer = writing.Writer(stream, chunk_size=64 << 20, compression=writing.CompressionType[packing])
    writer.start()
    channel = writer.register_channel("/zeros", "json", writer.register_schema("zeros", "jsonschema", b"{}"))
    for k in range(4):
        writer.add_message(channel, k, bytes(40 << 20), k)
    writer.finish()
    assert len(stream.getvalue()) < 1e6
    with bounded(), pytest.raises(TippathError, match="no message with numbers could be read"):
        ingest([saved(stream.getvalue(), "f.mcap")])
