"""Runs of different vehicles are told before any number is believed."""

from __future__ import annotations

import json
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from gcs.analysis.vehicles import different_vehicles, not_of_one_model
from gcs.cli import main
from gcs.logs import resolve_runs
from sysid.data.record import Record

pytestmark = pytest.mark.usefixtures("logs_kept")


def record(id: str, sha256: str = "a", **vehicle: str) -> Record:
    channels = {name: np.arange(3.0) for name in ("t", "p", "q", "delta_x", "delta_y")}
    return Record(id, channels, sha256=sha256, vehicle=vehicle)


def test_what_logs_say_alike_or_not_at_all_is_no_difference() -> None:
    assert different_vehicles([record("a#1", frame="HELI"), record("a#2", frame="HELI"), record("b#1")]) is None
    assert different_vehicles([record("a#1", FRAME_CLASS="6"), record("b#1", frame="HELI")]) is None


def test_what_differs_is_named_with_the_runs() -> None:
    told = different_vehicles([record("a#1", frame="HELI", FRAME_CLASS="6"), record("a#2", frame="HELI")])
    assert told is None
    told = different_vehicles(
        [record("a#1", frame="HELI", system="1"), record("a#2", frame="HELI"), record("b#1", system="2")]
    )
    assert told is not None
    assert "system 1: a#1; system 2: b#1" in told
    told = different_vehicles([record("a#1", frame="HELI", system="1"), record("b#1", frame="QUAD", system="2")])
    assert told is not None
    assert "frame HELI: a#1; frame QUAD: b#1; system too" in told
    assert "fit them apart" in told


def fitted(nrmse: tuple[float, float], implausible: bool) -> Any:
    parameter = SimpleNamespace(name="A_b", implausible=lambda value: implausible)
    model = SimpleNamespace(structure=SimpleNamespace(parameters=(parameter,)), values=np.array([197.0]))
    return SimpleNamespace(nrmse_percent=dict(zip("pq", nrmse, strict=True)), model=model, fixed={})


@pytest.mark.parametrize(
    ("nrmse", "implausible", "logs", "told"),
    [
        ((8.0, 81.0), True, "ab", True),
        ((8.0, 81.0), True, "aa", False),
        ((8.0, 81.0), False, "ab", False),
        ((56.0, 45.0), True, "ab", False),
        ((20.0, 25.0), True, "ab", False),
    ],
)
def test_a_fit_that_answers_some_of_several_logs_asks_whether_they_are_one_vehicles(
    nrmse: tuple[float, float], implausible: bool, logs: str, told: bool
) -> None:
    found = not_of_one_model(fitted(nrmse, implausible), [record(f"{log}#1", log) for log in logs])
    assert bool(found) == told
    if told:
        assert "2 logs" in found[0]
        assert "8 % against 81 %, A_b outside" in found[0]


def test_real_logs_say_which_vehicle_they_are_of(shared_data: Path, tmp_path: Path) -> None:
    logs = [shared_data / "ardupilot" / f"{name}_sweep.BIN" for name in ("heli_roll", "heli_pitch", "quad_pitch")]
    roll, pitch, quad = (resolve_runs([f"{log}@20:26"])[0] for log in logs)
    assert different_vehicles([roll, pitch]) is None
    told = different_vehicles([roll, quad])
    assert told is not None
    assert "frame HELI: heli_roll_sweep.BIN#1@20:26; frame QUAD/PLUS: quad_pitch_sweep.BIN#1@20:26" in told
    roll.save(tmp_path / "roll.npz")
    assert dict(Record.load(tmp_path / "roll.npz").vehicle) == dict(roll.vehicle)


def test_fit_refuses_runs_of_two_airframes_and_what_takes_them_warns(
    shared_data: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    runs = [f"{shared_data / 'ardupilot' / name}_sweep.BIN@20:26" for name in ("heli_roll", "quad_pitch")]
    fit = tmp_path / "mixed.json"
    asked = ["fit", *runs, "--model", "cd", "--band", "0:10", "-o", str(fit)]
    assert main(asked) == 1
    assert "two vehicles (a helicopter's: heli_roll_sweep.BIN#1@20:26; a multirotor's:" in capsys.readouterr().err
    assert not fit.exists()
    assert main([*asked, "--airframe", "helicopter"]) == 0  # whoever knows better
    out, err = capsys.readouterr()
    assert "note: vehicle differs: frame HELI" in err
    assert "these runs are of different vehicles" in " ".join(out.split())
    assert "different vehicles" in json.loads(fit.read_text())["warnings"][0]
    assert main(["compare", str(fit), "--json"]) == 0
    out, _ = capsys.readouterr()
    assert "different vehicles" in json.loads(out)["warnings"][0]
