"""`tippath fit --axes`: one axis by its own command, asked for or found excited alone; what was done is said."""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import jsonschema
import numpy as np
import pytest
from contract_schemas import FIT, FIT_ALONE
from scipy.signal import cont2discrete, lfilter

Tippath = Callable[..., tuple[int, str, str]]
DT = 0.005


def write_csv(path: Path, names: str, channels: Sequence[Any]) -> Path:
    lines = (",".join(f"{x:.8g}" for x in row) for row in zip(*channels, strict=True))
    path.write_text("\n".join([names, *lines]) + "\n")
    return path


@pytest.fixture(scope="module")
def sweeps(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """CSVs of a quadrotor: k/((s + 2)(0.05 s + 1)) on each axis, integrated by scipy; one swept, the other at rest."""
    folder = tmp_path_factory.mktemp("sweeps")
    rng = np.random.default_rng(31)
    t = DT * np.arange(6000)
    chirp = 0.06 * np.sin(2 * np.pi * (0.5 * t + 0.14 * t**2)) * (t < 29)
    numerator, denominator, _ = cont2discrete(([200.0], np.polymul([0.05, 1.0], [1.0, 2.0])), DT, "zoh")
    rate = lfilter(np.ravel(numerator), denominator, chirp)
    found = {}
    for axis in ("roll", "pitch"):
        own, other = rate + 0.05 * rng.standard_normal(t.size), 0.05 * rng.standard_normal(t.size)
        channels = [t, own, other, chirp, 0 * t] if axis == "roll" else [t, other, own, 0 * t, chirp]
        found[axis] = write_csv(folder / f"{axis}.csv", "t,p,q,delta_x,delta_y", channels)
    return found


def test_a_single_sweep_is_a_fit_of_its_own(tippath: Tippath, sweeps: dict[str, Path]) -> None:
    for axis, names in (("roll", ("L_p", "L_lat")), ("pitch", ("M_q", "M_lon"))):
        status, out, err = tippath("fit", sweeps[axis], "--model", "multirotor", "--band", "0.5:9", "--json")
        assert status == 0, err
        assert f"only {axis} was excited: fitted alone" in err
        assert "--axes roll,pitch asks for all" in err
        document = json.loads(out)
        jsonschema.validate(document, FIT_ALONE)
        assert (document["structure"]["base"], document["structure"]["effects"]) == (axis, ["motor_lag"])
        found = {name: one["value"] for name, one in document["parameters"].items()}
        assert [found[name] for name in (*names, "tau_m")] == pytest.approx([-2.0, 200.0, 0.05], rel=0.05)


def test_both_axes_are_fitted_where_both_were_swept_and_one_where_it_is_asked_for(
    tippath: Tippath, sweeps: dict[str, Path]
) -> None:
    both = [*sweeps.values(), "--model", "multirotor", "--band", "0.5:9", "--json"]
    status, out, err = tippath("fit", *both)
    assert (status, "alone" in err) == (0, False)
    document = json.loads(out)
    jsonschema.validate(document, FIT)
    assert document["parameters"]["tau_m"]["value"] == pytest.approx(0.05, rel=0.03)
    status, out, _ = tippath("fit", *both, "--axes", "pitch")
    assert (status, list(json.loads(out)["nrmse_percent"])) == (0, ["q"])
    status, out, _ = tippath("fit", *both, "--axes", "pitch, roll")
    assert (status, json.loads(out)["parameters"]) == (0, document["parameters"])


def test_what_was_asked_for_is_not_replaced(tippath: Tippath, sweeps: dict[str, Path]) -> None:
    status, _, err = tippath("fit", sweeps["roll"], "--model", "cd", "--axes", "roll,pitch", "--band", "0.5:9")
    assert (status, "or fit roll alone: --axes roll" in err) == (1, True)
    status, _, err = tippath("fit", sweeps["roll"], "--model", "cd", "--fix", "M_q=0", "--band", "0.5:9")
    assert (status, "--fix M_q: there is no such parameter" in err) == (2, True)


def test_axes_that_make_no_sense_are_refused_before_a_log_is_read(tippath: Tippath) -> None:
    for model, axes, told in (
        ("tpp", "roll", "TPP is fitted on roll,pitch, not on roll; --model cd can"),
        ("pitch", "roll", "PITCH is fitted on pitch, not on roll"),
        ("cd", "sideways", "CD is fitted on roll,pitch or roll or pitch or yaw or heave, not on sideways"),
        ("cd", "roll,", "not on roll,"),
    ):
        status, out, err = tippath("fit", "nowhere.csv", "--model", model, "--axes", axes)
        assert (status, out) == (2, "")
        assert told in err


def test_who_names_no_structure_is_told_which_there_are(tippath: Tippath) -> None:
    status, out, err = tippath("fit", "nowhere.csv")
    assert (status, out) == (2, "")
    assert "which structure? Give --model: multirotor for a multirotor, tpp or cd for a helicopter" in err


def test_a_quadrotor_s_single_roll_sweep_is_fitted(tippath: Tippath, shared_data: Path) -> None:
    status, out, err = tippath("fit", shared_data / "ardupilot" / "quad_roll_sweep.BIN", "--model", "cd")
    assert status == 0
    assert out.startswith("ROLL fitted to 1 run")
    assert "only roll was excited" in err


def test_runs_of_other_axes_are_left_out_and_named(tippath: Tippath, shared_data: Path) -> None:
    log = shared_data / "ardupilot" / "quad_roll_pitch.BIN"
    status, out, err = tippath("fit", log, "--model", "multirotor", "--axes", "pitch")
    assert (status, out.startswith("PITCH + motor_lag fitted to 1 run")) == (0, True)
    assert "left out, of an axis that PITCH is not of: quad_roll_pitch.BIN#1 (roll)" in err
    status, _, err = tippath("fit", f"{log}#1", "--model", "pitch")
    assert status == 1
    assert "no run swept pitch, which PITCH is of: quad_roll_pitch.BIN#1 (roll)" in err


@pytest.mark.parametrize(
    ("axis", "answer", "command", "plant", "known"),
    [
        ("yaw", "r", "delta_r", ([50.0], [1.0, 3.0]), {"N_r": -3.0, "N_ped": 50.0}),
        ("heave", "az", "delta_c", ([-60.0, 0.0], [0.08, 1.0, 1.1]), {"Z_w": -1.1, "Z_col": -60.0, "tau_T": 0.08}),
    ],
)
def test_a_csv_in_which_roll_and_pitch_rest_is_a_run_of_what_moves(
    axis: str, answer: str, command: str, plant: Any, known: dict[str, float], tippath: Tippath, tmp_path: Path
) -> None:
    rng = np.random.default_rng(7)
    t = DT * np.arange(8000)
    chirp = 0.1 * np.sin(2 * np.pi * (0.3 * t + 0.12 * t**2)) * (t < 38)
    numerator, denominator, _ = cont2discrete(plant, DT, "zoh")
    motion = lfilter(np.ravel(numerator), denominator, chirp)
    noise = 0.01 * np.std(motion) * rng.standard_normal((3, t.size))
    path = write_csv(
        tmp_path / "x.csv",
        f"t,p,q,delta_x,delta_y,{answer},{command}",
        [t, noise[0], noise[1], 0 * t, 0 * t, motion + noise[2] - (9.8 if axis == "heave" else 0), chirp],
    )
    status, out, err = tippath("fit", path, "--model", "cd", "--axes", axis, "--band", "0.4:9", "--json")
    assert status == 0, err
    document = json.loads(out)
    jsonschema.validate(document, FIT_ALONE)
    assert {name: document["parameters"][name]["value"] for name in known} == pytest.approx(known, rel=0.05)
    status, _, err = tippath("fit", path, "--model", "cd")
    assert (status, "not identifiable" in err, "--axes" in err) == (1, True, False)


@pytest.mark.thorough
def test_a_yaw_sweep_is_fitted_by_its_own_command_and_its_delay_named(
    tippath: Tippath, shared_data: Path, tmp_path: Path
) -> None:
    log, fit = shared_data / "ardupilot" / "heli_axis12_yaw_mixer.BIN", tmp_path / "yaw.json"
    status, out, err = tippath("fit", log, "--model", "cd", "--axes", "yaw", "--json", "-o", fit)
    assert status == 0, err
    document = json.loads(out)
    jsonschema.validate(document, FIT_ALONE)
    assert (document["structure"]["base"], document["instrument"]) == ("yaw", "excitation logged")
    status, out, _ = tippath("diagnose", fit, "--json")
    found = json.loads(out)
    assert (status, found["verdict"], found["effect"]) == (0, "missing", "transport_delay")
    delay = next(one for one in found["candidates"] if one["effect"] == "transport_delay")
    assert delay["nrmse_percent"]["r"] > 95
    assert delay["parameters"]["T_d"] == pytest.approx(0.054, abs=0.004)
    assert re.search("not asked: [0-9]+ effects of more than yaw", tippath("diagnose", fit)[1])
    for words in (("compare", fit), ("report", fit, "-o", tmp_path / "yaw.html")):
        status, _, err = tippath(*words)
        assert status == 0, err


def test_yaw_is_left_out_of_roll_and_pitch_and_measured_by_itself(tippath: Tippath, shared_data: Path) -> None:
    yaw, roll, pitch = (
        shared_data / "ardupilot" / f"heli_{name}.BIN" for name in ("axis12_yaw_mixer", "roll_sweep", "pitch_sweep")
    )
    told = "left out, of an axis that CD is not of: heli_axis12_yaw_mixer.BIN#8 (yaw)"
    status, _, err = tippath("response", roll, pitch, yaw)
    assert (status, told in err) == (0, True)
    status, out, _ = tippath("response", yaw)
    assert (status, "r per delta_r" in out, "p per delta_x" in out) == (0, True, False)
    status, _, err = tippath("fit", roll, pitch, yaw, "--model", "cd")
    assert (status, told in err) == (0, True)
