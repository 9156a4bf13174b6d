"""Fits of other people's flights: each test names the finding (A1 to A17) that it holds.

Findings about logs stand in `tests/gcs/logs/test_strangers_logs.py`; A6 in `tests/end_to_end/test_crazyflie.py`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import scipy.io
from planted import PLANTED, fly_many
from planted_fits import records

from gcs.logs import FromStart, resolve_runs
from sysid.compare.compare import compare
from sysid.compare.data_checks import mistaken_signs
from sysid.compare.finding_kinds import WrongSigns
from sysid.data.preprocess import EXCITATIONS
from sysid.data.record import Record
from sysid.data.stacks import Stack
from sysid.diagnose import fitted_chains
from sysid.fit import checks
from sysid.fit.identify import identify
from sysid.model import predict
from sysid.model.compose import compose
from sysid.response.flown import flown_responses

Tippath = Callable[..., tuple[int, str, str]]
PROFILE = """\
name = "cf"
[time]
source = "tick"
scale = 1e-3
[channels.p]
source = "controller.r_roll"
[channels.q]
source = "controller.r_pitch"
[channels.delta_x]
source = "controller.cmd_roll / 32767"
[channels.delta_y]
source = "controller.cmd_pitch / 32767"
"""
BAND = (0.3, 10.0)


@pytest.fixture
def bitcraze(shared_data: Path, tmp_path: Path) -> list[str | Path]:
    """What names the flight of bitcraze's own quadrotor, by its profile."""
    path = shared_data / "measured" / "crazyflie_data_1901.csv"
    if not path.is_file():
        pytest.skip(f"NO REAL LOGS: {path} is absent")
    (tmp_path / "cf.toml").write_text(PROFILE)
    return [path, "--profile", tmp_path / "cf.toml", "--model", "cd", "--band", "0.3:10"]


@pytest.mark.thorough
def test_a_lag_and_a_delay_together_end_in_a_fit(tippath: Tippath, bitcraze: list[str | Path]) -> None:
    """A2: a traceback where no stable model lay near the data. A16: the ladder named the first effect twice."""
    status, out, err = tippath("fit", *bitcraze, "--with", "servo_lag,transport_delay")
    assert (status, "Traceback" in err) == (0, False)
    assert "the model is unstable" in out
    at = out.index("ladder")
    rungs = [line.split("  ")[1] for line in out[at:].splitlines()[1:4]]
    assert rungs == ["CD", "+ servo_lag", "+ transport_delay"]


def test_what_is_asked_for_is_fitted_where_its_base_is_refused(tippath: Tippath, bitcraze: list[str | Path]) -> None:
    """A8: every `--with` was refused in the words of its base. A16: L_p held at 0 was "unstable, +0.0 1/s"."""
    held = ("--fix", "L_p=0,L_q=0,M_p=0,M_q=0")
    status, _, err = tippath("fit", *bitcraze, *held)
    assert status == 1
    assert "known only to" in err
    status, out, _ = tippath("fit", *bitcraze, *held, "--with", "transport_delay")
    assert status == 0
    assert "T_d" in out
    assert "a pole at zero" in " ".join(out.split())
    assert "the model is unstable" not in out


def signs(records: list[Record]) -> list[WrongSigns]:
    return [one for one in mistaken_signs(flown_responses(records, BAND).responses) if isinstance(one, WrongSigns)]


def turned(records: list[Record], **signs: float) -> list[Record]:
    return [
        replace(one, channels={name: signs.get(name, 1.0) * values for name, values in one.channels.items()})
        for one in records
    ]


def test_a_loop_without_excitation_turns_no_axes(shared_data: Path) -> None:
    """A9: rightly mapped pilot-flown logs were "as if turned by 180 degrees ... check the profile first".

    The slowest answers of a loop are those of its controller. The fast ones tell which axis is turned, and that alone.
    """
    path = shared_data / "crazyflie" / "roll_pitch_pilot_mapped.csv"
    records = resolve_runs([str(path)], window=FromStart(0, 20))
    assert signs(records) == []
    found = compare(identify(compose("cd"), records, band_hz=BAND).model, records, BAND)
    assert not [one for one in found.suspicions if one.kind == "signs"]
    assert [one.answers for one in signs(turned(records, q=-1.0))] == [((0, 1), (1, -1))]
    assert [one.answers for one in signs(turned(records, p=-1.0, q=-1.0))] == [((0, -1), (1, -1))]
    swapped = [
        replace(one, channels={**one.channels, "p": one.channels["q"], "q": one.channels["p"]}) for one in records
    ]
    assert [one.answers for one in signs(swapped)] == [((1, 1), (0, 1))]


def test_fast_answers_that_are_not_clear_turn_nothing(shared_data: Path) -> None:
    """A9: a rotor that flaps has no fast answers of one sign; without its logged excitation nothing is told of it."""
    logs = [str(shared_data / "ardupilot" / f"heli_{axis}_sweep.BIN") for axis in ("roll", "pitch")]
    bare = [one.without(EXCITATIONS) for one in resolve_runs(logs)]
    assert signs(bare) == []
    assert signs(turned(bare, p=-1.0)) == []


def test_no_hint_costs_more_than_the_fit(shared_data: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Section 4: of 58 s of a helicopter's fit 55 went into 17 refits for one sentence. Counted in bins predicted."""
    path = shared_data / "measured" / "trex550_manual.mat"
    if not path.is_file():
        pytest.skip(f"NO REAL LOGS: {path} is absent")
    flown = scipy.io.loadmat(path)
    names = ("t", "p", "q", "delta_x", "delta_y")
    columns = (flown["t"][:, 0], flown["outr"][:, 2], flown["outr"][:, 3], flown["inr"][:, 0], flown["inr"][:, 1])
    record = Record("trex#1", dict(zip(names, columns, strict=True))).window(2, 83)
    spent = {"fit": 0, "hint": 0}
    now = "fit"
    predicted, hint = predict._linear, checks.lateness

    def counted(*args: Any, **more: Any) -> Any:
        spent[now] += next(one for one in args if isinstance(one, Stack)).Y.size
        return predicted(*args, **more)

    def told(*args: Any) -> str | None:
        nonlocal now
        now = "hint"
        return hint(*args)

    monkeypatch.setattr(predict, "_linear", counted)
    monkeypatch.setattr(checks, "lateness", told)
    fit = identify(compose("tpp"), [record], band_hz=BAND)
    assert any("something is late between command and rate: a lag of about 100 ms" in one for one in fit.warnings)
    assert 0 < spent["hint"] < spent["fit"], spent


@pytest.mark.thorough
def test_parts_of_one_log_fit_and_judge(tippath: Tippath, shared_data: Path, tmp_path: Path) -> None:
    """A11: "no run is left to fit" of two records of one log; what is read again later is the part that was fitted."""
    path = shared_data / "crazyflie" / "roll_pitch_pilot_mapped.csv"
    for folder, window in (("a", "55:75"), ("b", "75:90")):
        assert tippath("ingest", path, "--window", window, "-o", tmp_path / folder)[0] == 0
    parts = [tmp_path / folder / "roll_pitch_pilot_mapped-1.npz" for folder in ("a", "b")]
    fit = tmp_path / "fit.json"
    status, out, _ = tippath("fit", parts[0], "--validate", parts[1], "--model", "cd", "-o", fit)
    assert status == 0
    assert "validation" in out
    fitted = out[out.index("  fitted") :].split()[1:3]
    status, out, _ = tippath("compare", fit)
    assert status == 0
    again = out[out.index("NRMSE fit, %") :].split()[3:5]
    assert np.allclose([float(one) for one in again], [float(one) for one in fitted], atol=0.1)
    status, _, err = tippath("fit", f"{path}@0:20", "--validate", f"{path}@15:30", "--model", "cd")
    assert status == 1
    assert "5.0 s of the flight are in both" in err


@pytest.mark.parametrize("only_effects", [("servo_lag", "gyro_misalignment", "servo_backlash")], indirect=True)
@pytest.mark.usefixtures("only_effects")
def test_ctrl_c_in_a_long_diagnosis_gives_the_answer_so_far(
    tippath: Tippath, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Section 4: a diagnosis of 41 s of data took 237 s in pairs, and Ctrl-C gave nothing."""
    runs = fly_many("servo_lag", PLANTED["servo_lag"], seeds=[31], duration_s=8.0, noise=0.004)[0]
    paths = []
    for one in records([{**run, "p": run["p"] + 0.2 * run["q"], "q": run["q"] - 0.2 * run["p"]} for run in runs]):
        paths.append(tmp_path / f"{one.id.replace('#', '-')}.npz")
        one.save(paths[-1])
    assert tippath("fit", *paths, "--model", "tpp", "-o", tmp_path / "fit.json")[0] == 0

    def pressed(*_: Any) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(fitted_chains, "refitted", pressed)
    status, out, _ = tippath("diagnose", tmp_path / "fit.json", "--repeat")
    assert status == 130
    assert "servo_lag" in out
    assert "because the search was interrupted" in " ".join(out.split())
