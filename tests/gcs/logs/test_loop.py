"""The loop that held a log's commands: who tells its rate, and what is made of it."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import planted
import pytest

from gcs.errors import TippathError
from gcs.logs import ingest, resolve_runs
from gcs.logs.formats import ulog
from gcs.logs.formats.tables import FloatArray, Series
from gcs.logs.formats.ulog_table import UlogTables
from gcs.logs.profile.mapping import moving_onto
from gcs.logs.profile.profiles import named, parse
from gcs.logs.runs.loop import Loop, loop_of
from sysid.fit.identify import identify
from sysid.model.compose import compose

Command = Callable[..., tuple[int, str, str]]
CHANNELS = ("t", "p", "q", "delta_x", "delta_y", "excitation_x", "excitation_y")
HELD = "commands were held for 2 ms (the vehicle's loop: {} 500) and logged every 10 ms: fits take them so"


@pytest.fixture(scope="module")
def thinned(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    """A roll and a pitch chirp of a loop of 500 Hz, as 100 Hz logs that do not tell it."""
    folder = tmp_path_factory.mktemp("thinned")
    paths = []
    for number, run in enumerate(planted.fly(None, {}, seed=1, duration_s=15.0)[:2]):
        paths.append(folder / f"{number}.csv")
        table = np.stack([run[name][::5] for name in CHANNELS], axis=1)
        np.savetxt(paths[-1], table, delimiter=",", header=",".join(CHANNELS), comments="", fmt="%.8g")
    return paths


def test_ardupilot_tells_its_loop(shared_data: Path) -> None:
    slow, fast = ingest([shared_data / "ardupilot" / "heli_bitmask_changed_two_runs.BIN"]).runs
    for run in (slow, fast):
        assert run.record is not None
        assert (run.record.loop_dt_s, run.record.loop_told_by) == (0.0025, "SCHED_LOOP_RATE")
    assert "commands were held" not in " ".join(fast.notes)


def test_px4_tells_its_loop(shared_data: Path) -> None:
    log = UlogTables(ulog.read(shared_data / "px4" / "sample_log_small.ulg"), "sample")
    assert loop_of(log, named("px4"), 0.0) == Loop(400.0, "IMU_GYRO_RATEMAX")
    told = replace(named("px4"), loop_rate_hz=1000.0)
    assert loop_of(log, told, 0.0) == Loop(1000.0, "profile"), "whoever names it knows better"


@pytest.mark.thorough
def test_runs_of_100_and_400_hz_fit_together(shared_data: Path) -> None:
    """A helicopter of other people's simulator, whose commands act 50 ms late: without that it comes out unstable."""
    folder, tpp = shared_data / "ardupilot", compose("tpp")
    runs = resolve_runs([f"{folder}/heli_bitmask_changed_two_runs.BIN#1", f"{folder}/heli_pitch_sweep.BIN"])
    fit = identify(tpp, runs, effects=["transport_delay"])
    assert fit.nrmse_percent["p"] > 98
    assert fit.nrmse_percent["q"] > 99
    assert fit.model["T_d"] == pytest.approx(0.0507, abs=0.0003)
    assert fit.model["L_b"] == pytest.approx(3588.6, rel=0.005)
    assert fit.model["M_a"] == pytest.approx(617.5, rel=0.005)


def test_the_user_tells_it_and_the_fit_remembers(thinned: list[Path], tippath: Command, tmp_path: Path) -> None:
    words = ("fit", *thinned, "--model", "tpp", "--json")
    status, out, err = tippath(*words, "--loop-rate", "500", "-o", tmp_path / "fit.json")
    assert status == 0
    assert HELD.format("--loop-rate") in err
    told = json.loads(out)
    assert [one["loop_rate_hz"] for one in told["records"]] == pytest.approx([500.0, 500.0])
    assert told["parameters"]["M_a"]["value"] == pytest.approx(planted.TABLE_4["M_a"], rel=0.01)
    assert "time of commands" not in [check["name"] for check in told["checks"]]
    status, out, err = tippath("compare", tmp_path / "fit.json", "--json")
    assert status == 0
    assert json.loads(out)["nrmse_percent"] == pytest.approx(told["nrmse_percent"])
    status, out, _ = tippath(*words)
    untold = json.loads(out)
    assert [one["loop_rate_hz"] for one in untold["records"]] == pytest.approx([500.0, 500.0], rel=0.2)
    assert {one["loop_told_by"] for one in untold["records"]} == {"by these runs"}
    assert untold["parameters"]["M_a"]["value"] == pytest.approx(planted.TABLE_4["M_a"], rel=0.02)
    (text,) = [text for text in untold["warnings"] if "--loop-rate" in text]
    assert "no log tells the rate of the vehicle's loop" in text


def test_a_record_can_be_told_it_too(thinned: list[Path], tippath: Command, tmp_path: Path) -> None:
    assert tippath("ingest", *thinned, "-o", tmp_path)[0] == 0
    records = sorted(tmp_path.glob("*.npz"))
    status, out, _ = tippath("ingest", *records, "--loop-rate", "500")
    assert status == 0
    assert out.count(HELD.format("--loop-rate")) == 2


@pytest.mark.parametrize("word", ["0", "fast", "nan", "-400", "1e9"])
def test_a_rate_that_is_none_is_wrong_usage(word: str, thinned: list[Path], tippath: Command) -> None:
    status, _, err = tippath("fit", *thinned, "--model", "tpp", f"--loop-rate={word}")
    assert status == 2
    assert "wants a rate in Hz, such as 400" in err


PROFILE = """
[time]
source = "t"
loop_rate_hz = 500
commands_late_s = {late}
[channels.p]
source = "p"
[channels.q]
source = "q"
[channels.delta_x]
source = "delta_x"
[channels.delta_y]
source = "delta_y"
"""


def test_a_profile_tells_the_loop_and_the_clock(thinned: list[Path]) -> None:
    profile = parse(PROFILE.format(late=0.02), "late.toml")
    (plain,), (moved,) = (resolve_runs([str(thinned[0])], one) for one in (None, profile))
    assert moved.loop_dt_s == pytest.approx(0.002)
    assert moved.loop_told_by == "profile"
    t, x = plain.channels["t"], plain.channels["delta_x"]
    common = np.isin(np.round(t, 6), np.round(moved.channels["t"], 6))
    assert common.sum() == moved.channels["t"].size > t.size - 5
    assert np.allclose(moved.channels["delta_x"], x[np.flatnonzero(common) + 2], atol=1e-9), "two samples earlier"
    assert np.array_equal(moved.channels["p"], plain.channels["p"][common])


def test_a_profile_without_sense_is_refused() -> None:
    for line in ("loop_rate_hz = 0", "commands_late_s = 3"):
        with pytest.raises(TippathError, match=r"late\.toml"):
            parse(PROFILE.replace("loop_rate_hz = 500", line).replace("commands_late_s = {late}", ""), "late.toml")


def wave(t: FloatArray) -> FloatArray:
    return np.asarray(np.sin(2 * np.pi * 8.0 * t))


def test_commands_logged_more_slowly_than_rates_move_between_their_samples() -> None:
    fast, slow = np.arange(0, 4, 0.004), np.arange(0, 4, 0.01)
    values = moving_onto(Series(fast, fast, "gyro"), Series(slow, wave(slow), "motors"))
    inside = np.isfinite(values)
    assert inside.sum() >= fast.size - 2
    assert np.max(np.abs(values - wave(fast))[inside][20:-20]) < 0.01, "held they would be off by a half"
    gap = (slow < 1.0) | (slow > 1.2)
    holed = moving_onto(Series(fast, fast, "gyro"), Series(slow[gap], wave(slow[gap]), "motors"))
    assert np.all(np.isnan(holed[(fast > 1.0) & (fast < 1.2)])), "nothing is invented in a gap"


@pytest.mark.parametrize("only_effects", [["servo_lag"]], indirect=True)
@pytest.mark.usefixtures("only_effects")
def test_a_diagnosis_names_the_clocks(tippath: Command, tmp_path: Path) -> None:
    paths = []
    for number, run in enumerate(planted.fly(None, {}, seed=1, duration_s=15.0)[:2]):
        paths.append(tmp_path / f"{number}.csv")
        columns = [run[name][:-3] if name.startswith(("delta", "exc")) else run[name][3:] for name in CHANNELS]
        np.savetxt(paths[-1], np.stack(columns, 1), "%.8g", ",", header=",".join(CHANNELS), comments="")
    assert tippath("fit", *paths, "--model", "tpp", "-o", tmp_path / "fit.json")[0] == 0
    status, out, _ = tippath("diagnose", tmp_path / "fit.json", "--json")
    assert status == 0
    found = json.loads(out)
    assert found["verdict"] == "unexplained"
    assert found["reason"] == "clocks"
    assert re.match(r"commands are stamped (5\.9|6\.[0-3]) ± ", found["remarks"][0])
    status, out, _ = tippath("diagnose", tmp_path / "fit.json")
    assert out.index("unexplained") < out.index("but commands are stamped") < out.index("explains")
    assert max(len(line) for line in out.splitlines() if str(tmp_path) not in line) <= 78
