"""Other people's logs, found with flights that nobody here made: each test names the finding (A1 to A17) it holds.

Findings about fits stand in `tests/gcs/cli/test_strangers_fits.py`.
"""

from __future__ import annotations

import tomllib
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from gcs.cli.listing import table
from gcs.errors import TippathError
from gcs.logs import Ingest, fitted_beside, ingest, logs_in, resolve_runs
from gcs.logs.profile import profiles
from gcs.logs.profile.expression import Expression
from gcs.logs.profile.proposal import propose
from gcs.logs.runs import health
from gcs.vehicle.sweeps import ANY, how_to_sweep
from sysid.data.record import Record

Saved = Callable[[bytes, str], Path]
HEADER = "t,p,q,delta_x,delta_y"


def columns(seconds: float = 40.0, rate_hz: float = 200.0) -> np.ndarray:
    t = np.arange(0, seconds, 1 / rate_hz)
    x, y = 0.1 * np.sin(2 * np.pi * t), 0.1 * np.cos(2 * np.pi * 1.3 * t)
    return np.column_stack([t, 3 * x, 2 * y, x, y])


def csv(table: np.ndarray, header: str = HEADER, behind: str = "") -> bytes:
    return "\n".join([header, *(",".join(f"{v:.6f}" for v in row) + behind for row in table)]).encode() + b"\n"


def listed(found: Ingest) -> str:
    return "\n".join(table(found))


def test_numbered_names_beside_the_same_name_without_a_number(saved: Saved) -> None:
    """A1: `run.csv` beside `run2.csv` was a traceback, in `ingest` and in `fit`."""
    first, second = saved(csv(columns()), "run.csv"), saved(csv(columns(30.0)), "run2.csv")
    tenth = saved(csv(columns(20.0)), "run10.csv")
    assert logs_in(first.parent) == [first, second, tenth]
    assert len(resolve_runs([str(first.parent)])) == 3


def test_parts_of_one_log_fit_and_judge(saved: Saved, tmp_path: Path) -> None:
    """A11: records cut from one log by two windows were taken for the same run, and nothing was left to fit."""
    path = saved(csv(columns()), "x.csv")
    parts = []
    for name, window in (("a", (5.0, 20.0)), ("b", (20.0, 38.0))):
        (run,) = ingest([path], window=window).runs
        assert run.record is not None
        run.record.save(tmp_path / f"{name}.npz")
        (part,) = resolve_runs([str(tmp_path / f"{name}.npz")])
        assert part.path == str(tmp_path / f"{name}.npz"), "it is read again from there"
        parts.append(part)
    a, b = parts
    assert a.id == b.id
    assert fitted_beside([a], [b]) == [a]
    assert fitted_beside([a, b], [b]) == [a]
    assert len(resolve_runs([str(tmp_path / "a.npz"), str(tmp_path / "b.npz")])) == 2
    early, late = resolve_runs([f"{path}@5:20"]), resolve_runs([f"{path}#1@20:38"])
    assert fitted_beside(early, late) == early
    assert fitted_beside([*early, a], early) == [], "a record of the same part is that part"
    with pytest.raises(TippathError, match=r"x.csv#1@10:30 is to judge, and 10.0 s"):
        fitted_beside(early, resolve_runs([f"{path}@10:30"]))
    with pytest.raises(TippathError, match="parts that do not overlap"):
        fitted_beside(resolve_runs([str(path)]), early)


def test_what_a_flight_folder_hides_is_said(tmp_path: Path, two_chirps: bytes) -> None:
    """A12: `flight*.BIN` hid all other logs of its folder, and all below, without a word."""
    (tmp_path / "flight000_roll.BIN").write_bytes(two_chirps)
    (tmp_path / "flight000_roll.tlog").write_bytes(b"x")
    (tmp_path / "fetched-00000001.BIN.part").write_bytes(b"x")
    assert not ingest([tmp_path]).left_out, "what belongs to the flight is not left out"
    (tmp_path / "below").mkdir()
    for name in ("below/heli.BIN", "quad.BIN", "x.csv"):
        (tmp_path / name).write_bytes(two_chirps)
    found = ingest([tmp_path])
    (words,) = found.left_out.values()
    assert "below/heli.BIN, quad.BIN, x.csv" in words
    assert words in listed(found)
    assert any(words in note for note in resolve_runs([str(tmp_path)])[0].notes), "a fit tells it, too"
    assert not ingest([tmp_path / "flight000_roll.BIN"]).left_out, "nobody asked for the folder"


def gappy(rate_hz: float = 500.0, gap_s: float = 0.021, every_s: float = 0.5) -> dict[str, np.ndarray]:
    made = columns(40.0, rate_hz)
    keep = np.mod(made[:, 0], every_s) >= gap_s
    return dict(zip(HEADER.split(","), made[keep].T, strict=True))


def test_up_to_which_frequency_a_log_is_usable_is_said(saved: Saved) -> None:
    """A13: a log with many short gaps, or slow, was "not usable", though a fit of a lower band takes it at once."""
    found = health.check(Record("x#1", gappy(), maneuver="unknown"))
    assert not found.usable
    assert found.usable_to_hz == 10, "a quarter period of it is 25 ms, of 11 Hz 22.7: the gaps are 24"
    assert health.check(Record("x#1", gappy(), maneuver="unknown"), f_high_hz=10).usable
    slow = health.check(Record("x#1", gappy(50.0, 0.0), maneuver="unknown"))
    assert slow.usable_to_hz == 12
    still = gappy()
    still["delta_x"] = still["delta_y"] = np.zeros_like(still["t"])
    assert health.check(Record("x#1", still)).usable_to_hz is None, "no band helps"
    assert health.check(Record("x#1", gappy(gap_s=0.0))).usable_to_hz is None, "nothing stands against it"
    path = saved(csv(np.column_stack(list(gappy().values()))), "gappy.csv")
    assert "usable up to 10 Hz: --band 0.3:10; not above, because" in listed(ingest([path]))
    with pytest.raises(TippathError, match=r"usable up to 10 Hz: --band 0\.3:10"):
        resolve_runs([str(path)])
    assert resolve_runs([str(path)], f_high_hz=10)


def test_the_crazyflie_log_with_gaps_is_usable_below_them(shared_data: Path, tmp_path: Path) -> None:
    """A13 on the log that it was found with: 139 gaps of 16 to 36 ms."""
    text = (
        'name = "cf"\n[time]\nsource = "tick"\nscale = 1e-3\n[channels.p]\nsource = "controller.r_roll"\n'
        '[channels.q]\nsource = "controller.r_pitch"\n[channels.delta_x]\nsource = "controller.cmd_roll / 32767"\n'
        '[channels.delta_y]\nsource = "controller.cmd_pitch / 32767"\n'
    )
    (tmp_path / "cf.toml").write_text(text)
    path = shared_data / "measured" / "crazyflie_data_1901.csv"
    if not path.is_file():
        pytest.skip(f"NO REAL LOGS: {path} is absent")
    (run,) = ingest([path], tmp_path / "cf.toml").runs
    assert not run.usable
    assert run.usable_to_hz is not None
    assert run.usable_to_hz >= 10
    assert resolve_runs([str(path)], tmp_path / "cf.toml", f_high_hz=run.usable_to_hz)


def test_commands_beyond_full_are_noted_and_not_refused() -> None:
    """A14: a mixer's input passes 1; that refused logs of which 5 of 24,866 samples did."""
    made = dict(zip(HEADER.split(","), columns().T, strict=True))
    made["delta_x"][100:140] = 1.4
    found = health.check(Record("x#1", made))
    assert found.usable, found.reasons
    (note,) = [note for note in found.notes if "passes full command" in note]
    assert "delta_x passes full command in 40 of 8000 samples, by up to 0.4" in note
    made["delta_x"] = 30 * made["delta_x"]
    (reason,) = [reason for reason in health.check(Record("x#1", made)).reasons if "delta_x" in reason]
    assert "give a scale" in reason


def test_functions_in_profiles() -> None:
    """A14: a profile could not clip; now min, max, abs, clip and sqrt."""
    a, b = np.array([-4.0, 0.25, 9.0]), np.array([1.0, 2.0, -3.0])
    for text, expected in (
        ("min(a, b)", [-4.0, 0.25, -3.0]),
        ("max(a, 2 * b)", [2.0, 4.0, 9.0]),
        ("abs(a) + 1", [5.0, 1.25, 10.0]),
        ("clip(a, -1, 1)", [-1.0, 0.25, 1.0]),
        ("sqrt(max(a, 0))", [0.0, 0.5, 3.0]),
    ):
        expression = Expression.parse(text)
        assert set(expression.fields) <= {"a", "b"}
        assert np.array_equal(expression.evaluate({"a": a, "b": b}), expected), text
    for text, words in (("clip(a)", "takes 3 values, not 1"), ("abs()", "takes 1 value, not 0"), ("exp(a)", "call")):
        with pytest.raises(TippathError, match=words):
            Expression.parse(text)
    with pytest.raises(TippathError, match="call is not allowed"):
        Expression.parse("min(a, key=b)")


def test_px4s_former_log_is_told(saved: Saved, writer: Callable[..., object]) -> None:
    """A15: a whole .px4log "ends before any samples: fetch it from the vehicle again, whole"."""
    log = writer({"TIME": (129, "Q", "StartTime"), "ATT": (2, "ffffff", "Roll,Pitch,Yaw,RollRate,PitchRate,YawRate")})
    for i in range(500):
        log.add("TIME", 1_000_000 + 4000 * i)  # type: ignore[attr-defined]
        log.add("ATT", 0.1, 0.1, 0.1, 0.01 * i, 0.1, 0.1)  # type: ignore[attr-defined]
    path = saved(log.data, "12_30_00.px4log")  # type: ignore[attr-defined]
    with pytest.raises(TippathError, match=r"sdlog2.*not read.*sdlog2_dump.py"):
        ingest([path])


@pytest.mark.parametrize(
    ("header", "behind", "said"),
    [
        (HEADER + ",", ",", False),
        (HEADER + ",", ",7", True),
        (HEADER + ",,", ",,", True),
        (HEADER + ",,", ",,7", True),
    ],
)
def test_columns_without_a_name_behind_the_others_are_left_out(
    saved: Saved, header: str, behind: str, said: bool
) -> None:
    """A17: one unnamed trailing column, as spreadsheets write it, refused the file."""
    path = saved(csv(columns(), header, behind), "book.csv")
    found = ingest([path])
    (run,) = found.runs
    assert run.record is not None
    assert run.record.t.size == 8000
    assert any("without a name, and not used: column 6" in hint for hint in found.sources[0].hints) == said


@pytest.mark.parametrize(
    ("rows", "scale", "unit"),
    [(0.004, 1.0, "seconds"), (4.0, 1e-3, "milliseconds"), (4000.0, 1e-6, "microseconds"), (4e6, 1e-9, "nanoseconds")],
)
def test_the_unit_of_time_is_guessed_by_its_values(rows: float, scale: float, unit: str) -> None:
    """A17: `scale = 1 # to seconds` was written for a column of microseconds named time."""
    values = {"time": rows * np.arange(1000.0)}
    text = propose(["time"], "csv", {}, values=values.get)
    assert tomllib.loads(text)["time"] == {"source": "time", "scale": scale}
    assert f"{unit}: it goes on by" in text
    assert tomllib.loads(propose(["time [us]"], "csv", {}, values=values.get))["time"]["scale"] == 1e-6, "as written"


def test_betaflights_and_crazyflies_columns_are_guessed() -> None:
    """A17: none of gyroADC[0], axisP[0], controller.r_roll and tick was guessed."""
    n = np.arange(2000.0)
    betaflight = {
        "time": 1000 * n,
        "gyroADC[0]": 300 * np.sin(n / 9),
        "gyroADC[1]": 2 * np.sin(n / 9),  # slow: in rad/s it would be possible
        "axisP[0]": 300 * np.cos(n / 9),
        "axisSum[0]": 400 * np.cos(n / 9),
        "axisP[1]": np.cos(n / 9),
    }
    made = tomllib.loads(propose([*betaflight], "csv", {}, values=betaflight.get))
    assert made["time"]["scale"] == 1e-6
    assert made["channels"]["p"] == {"source": "gyroADC[0]", "scale": pytest.approx(np.pi / 180)}
    assert made["channels"]["q"] == {"source": "gyroADC[1]", "scale": pytest.approx(np.pi / 180)}
    assert made["channels"]["delta_x"] == {"source": "axisSum[0]", "scale": 0.002}
    assert made["channels"]["delta_y"] == {"source": "axisP[1]", "scale": 0.002}
    crazyflie = {
        "tick": 2 * n,
        "controller.r_roll": 5 * np.sin(n / 9),
        "controller.r_pitch": np.sin(n / 9),
        "controller.cmd_roll": 20000 * np.cos(n / 9),
        "controller.cmd_pitch": 100 * np.cos(n / 9),
    }
    made = tomllib.loads(propose([*crazyflie], "csv", {}, values=crazyflie.get))
    assert made["time"] == {"source": "tick", "scale": 1e-3}
    assert made["channels"]["p"] == {"source": "controller.r_roll"}
    assert made["channels"]["delta_x"] == {"source": "controller.cmd_roll", "scale": pytest.approx(1 / 32767)}
    assert made["channels"]["delta_y"]["source"] == "controller.cmd_pitch"


def test_pulse_widths_are_guessed_and_a_proposed_profile_is_read_as_it_stands(saved: Saved, tmp_path: Path) -> None:
    """A17: scales are guessed by values, and said."""
    made = columns()
    made[:, 0] *= 1e6
    made[:, 1:3] *= 180 / np.pi
    made[:, 3:] = 1500 + 500 * made[:, 3:]
    names = ["time", "gyro_x", "gyro_y", "roll_cmd", "pitch_cmd"]
    path = saved(csv(made, ",".join(names)), "rig.csv")
    text = propose(names, "csv", {}, values=dict(zip(names, made.T, strict=True)).get)
    assert "1000 to 2000 us?" in text
    (tmp_path / "mine.toml").write_text(text)
    assert profiles.load(tmp_path / "mine.toml").time_scale == 1e-6
    (run,) = ingest([path], tmp_path / "mine.toml").runs
    assert run.record is not None
    truth = columns()
    for place, name in enumerate(HEADER.split(",")):
        assert np.allclose(run.record.channels[name], truth[:, place], atol=1e-5), name


def test_who_flies_another_autopilot_is_told_how_to_sweep_with_it(saved: Saved, shared_data: Path) -> None:
    """Section 3: "tippath sweep --connect LINK" to users of PX4, Betaflight and Crazyflie, whom it cannot fly."""
    for name, kind, words in (
        ("arducopter_heli", "dataflash", "tippath sweep"),
        ("mine", "dataflash", "tippath sweep"),
        ("px4_sensor_combined", "ulog", "SDLOG_PROFILE"),
        ("mine", "ulog", "SDLOG_PROFILE"),
        ("blackbox_chirp", "blackbox", "debug_mode = CHIRP"),
        ("blackbox_rotorflight", "blackbox", "log what is added"),
        ("crazyflie_usd", "crazyflie", "uSD deck"),
        ("quadrotor", "csv", "uSD deck"),
        ("paparazzi_data", "paparazzi", "sys_id_chirp"),
        ("mine", "csv", "log what is added"),
    ):
        said = how_to_sweep(name, kind)
        assert words in said
        assert ("tippath" in said) == (words == "tippath sweep")
    for profile in profiles.bundled_profiles():
        sweeps = profile.name != "blackbox_rotorflight"  # no chirp of its own is known
        assert (how_to_sweep(profile.name, "") != ANY) == sweeps, profile.name
    still = columns()
    still[:, 1:] *= 1e-4
    (run,) = ingest([saved(csv(still), "still.csv")]).runs
    assert any(ANY in reason for reason in run.reasons)
    (run,) = ingest([shared_data / "px4" / "sample_log_small.ulg"]).runs
    assert any("PX4 has no chirp" in reason for reason in run.reasons), run.reasons
    (run,) = ingest([shared_data / "ardupilot" / "log171.bin"]).runs
    assert any("tippath sweep --connect LINK" in reason for reason in run.reasons)
