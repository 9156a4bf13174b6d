"""Several CSVs of one flight, joined by time: what converters write, a file for each topic."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from gcs.errors import TippathError, UsageError
from gcs.logs import ingest_joined, resolve_runs

Tippath = Callable[..., tuple[int, str, str]]
PROFILE = """\
name = "topics"
[time]
source = "timestamp"
scale = 1e-6
[channels.p]
source = "angular_velocity_0.xyz[0]"
[channels.q]
source = "angular_velocity_0.xyz[1]"
[channels.delta_x]
source = "2 * torque_setpoint_0.xyz[0]"
[channels.delta_y]
source = "2 * torque_setpoint_0.xyz[1]"
[channels.omega]
source = "rpm"
"""
NAMES = ("08_54_39_angular_velocity_0.csv", "08_54_39_torque_setpoint_0.csv", "08_54_39_rotor_0.csv")


def command(t: np.ndarray) -> np.ndarray:
    """Roll and pitch."""
    return np.array([0.1 * np.sin(2 * np.pi * (0.5 * t + 0.1 * t**2)), 0.1 * np.cos(2 * np.pi * 1.3 * t)])


def rate(t: np.ndarray) -> np.ndarray:
    return 3 * command(t - 0.05)


def topics(folder: Path, late_us: float = 0.0) -> list[Path]:
    """Rates at 250 Hz, commands at 200 Hz from 1.7 ms later on, a rotor at 20 Hz; microseconds since the start."""
    paths = [folder / name for name in NAMES]
    for path, step, begin, late, header, values in (
        (paths[0], 0.004, 1.0, 0.0, "timestamp,xyz[0],xyz[1]", rate),
        (paths[1], 0.005, 0.5017, late_us, "timestamp,xyz[0],xyz[1]", lambda t: command(t) / 2),
        (paths[2], 0.05, 0.0, 0.0, "timestamp,rpm", lambda t: [170 + 0.1 * t]),
    ):
        t = np.arange(begin, 31.0, step)
        rows = zip(np.round(1e6 * t + late), *values(t), strict=True)
        path.write_text(header + "\n" + "\n".join(",".join(f"{one:.8g}" for one in row) for row in rows) + "\n")
    return paths


def test_topics_are_joined_by_time(tmp_path: Path) -> None:
    (tmp_path / "topics.toml").write_text(PROFILE)
    found = ingest_joined(topics(tmp_path), tmp_path / "topics.toml")
    (run,), (source,) = found.runs, found.sources
    assert run.usable, run.reasons
    assert run.id == f"{NAMES[0]}#1"
    assert any("joined by time with" in hint and NAMES[2] in hint for hint in source.hints)
    assert {"angular_velocity_0.xyz[0]", "torque_setpoint_0.xyz[0]", "rpm"} <= set(source.fields)
    assert run.record is not None
    t, made = run.record.t, run.record.channels
    assert t[0] == pytest.approx(1.0, abs=0.01), "where the rates begin"
    assert np.allclose(made["p"], rate(t)[0], atol=1e-6)
    last = np.max(np.abs(np.diff(command(t)[0])))
    assert np.max(np.abs(made["delta_x"] - command(t)[0])) < 2.5 * last, "held since its last sample, or between two"
    assert np.allclose(made["omega"], 170 + 0.1 * t, atol=0.01)


def test_channels_by_their_own_names_need_no_profile(tmp_path: Path) -> None:
    t = np.arange(0, 20, 0.005)
    for name, header, columns in (("gyro", "t,p,q", rate(t)), ("sticks", "t,delta_x,delta_y", command(t))):
        np.savetxt(tmp_path / f"{name}.csv", np.column_stack([t, *columns]), "%.8f", ",", header=header, comments="")
    (run,) = ingest_joined([tmp_path / "gyro.csv", tmp_path / "sticks.csv"]).runs
    assert run.usable, run.reasons
    assert run.record is not None
    assert np.allclose(run.record.channels["delta_y"], command(t)[1], atol=1e-7)


def test_a_joined_record_is_written_and_fitted(tmp_path: Path, tippath: Tippath) -> None:
    (tmp_path / "topics.toml").write_text(PROFILE)
    words = ("--join", *topics(tmp_path), "--profile", tmp_path / "topics.toml", "-o", tmp_path / "out")
    status, out, _ = tippath("ingest", *words)
    assert status == 0
    assert "joined by time with" in out
    (record,) = (tmp_path / "out").iterdir()
    (again,) = resolve_runs([str(record)])
    assert again.path == str(record), "a fit of it is read again from there"
    status, _, err = tippath("ingest", *words, "--flight", tmp_path)
    assert status == 2
    assert "name one of them" in err


def test_what_cannot_be_joined_is_said(tmp_path: Path) -> None:
    (tmp_path / "topics.toml").write_text(PROFILE)
    with pytest.raises(TippathError, match=r"no time lies in all of them.*torque_setpoint_0 1.*one unit of time"):
        ingest_joined(topics(tmp_path, late_us=1e9), tmp_path / "topics.toml")
    paths = topics(tmp_path)
    with pytest.raises(UsageError, match="name several"):
        ingest_joined(paths[:1], tmp_path / "topics.toml")
    with pytest.raises(UsageError, match=r"topics\.toml is none"):
        ingest_joined([paths[0], tmp_path / "topics.toml"])
    with pytest.raises(TippathError, match="column t missing"):
        ingest_joined(paths)
    (tmp_path / "below").mkdir()
    copy = tmp_path / "below" / paths[0].name
    copy.write_bytes(paths[0].read_bytes())
    with pytest.raises(TippathError, match="called the same"):
        ingest_joined([paths[0], copy], tmp_path / "topics.toml")
    begun = paths[1].read_text()
    paths[1].write_text(begun + begun.split("\n", 1)[1])
    with pytest.raises(TippathError, match="clock begins anew"):
        ingest_joined(paths, tmp_path / "topics.toml")
    with pytest.raises(TippathError, match="no such file"):
        ingest_joined([paths[0], tmp_path / "gone.csv"], tmp_path / "topics.toml")


def test_what_to_write_is_proposed_for_all_of_them(tippath: Tippath, tmp_path: Path) -> None:
    """--explain said nothing where they could not be joined yet; its proposal joins them."""
    paths = topics(tmp_path)
    status, out, _ = tippath("ingest", "--join", *paths, "--explain")
    assert status == 1
    assert "not joined" in out
    proposed = out[out.index("# save as mine.toml") :]
    for source in ('"timestamp"', '"angular_velocity_0.xyz[0]"', '"torque_setpoint_0.xyz[1]"', '"rpm"'):
        assert f"source = {source}" in proposed
    (tmp_path / "mine.toml").write_text(proposed)
    status, out, _ = tippath("ingest", "--join", *paths, "--profile", tmp_path / "mine.toml")
    assert status == 0, out
