"""A log off the vehicle's card, and the flight whose runs it holds: matched by the vehicle's clock, or not."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from gcs.cli import main
from gcs.errors import TippathError
from gcs.flight.folder import FlightFolder
from gcs.logs import ingest
from gcs.logs.runs.of_flight import of_flight
from gcs.logs.runs.run import Run

KEPT = {"keep": None, "log": "card", "reasons": []}


def run(number: int, entered_s: float, axis: str = "roll") -> Run:
    return Run(
        record=None,
        id=f"7.BIN#{number}",
        path="7.BIN",
        maneuver="chirp",
        axis=axis,
        start_s=entered_s + 1.0,
        duration_s=30.0,
        rate_hz=400.0,
        gaps=(),
        usable=True,
        reasons=(),
        entered_s=entered_s,
    )


def flown(label: str, start_s: float, axis: str = "roll", **more: Any) -> dict[str, Any]:
    return {
        "label": label,
        "maneuver": {"kind": "chirp", "axis": axis},
        "ending": "finished",
        "log_start_s": start_s,
        "log_start_within_s": 0.3,
        "verdict": KEPT,
        **more,
    }


def flight(path: Path, *runs: dict[str, Any]) -> Path:
    path.mkdir(exist_ok=True)
    FlightFolder(path).write({"log": "card", "runs": list(runs), "recording": {"logs": []}})
    return path


def test_runs_are_matched_by_the_vehicles_clock(tmp_path: Path) -> None:
    folder = flight(tmp_path, flown("roll chirp", 100.4), flown("pitch chirp", 140.1, "pitch"))
    found = of_flight([run(1, 50.0), run(2, 100.0), run(3, 140.0, "pitch")], folder)
    assert [m.words for m in found.matches] == [
        "roll chirp is 7.BIN#2 (-0.40 s)",
        "pitch chirp is 7.BIN#3 (-0.10 s)",
    ]
    assert found.problem == ""
    assert all(one.usable for one in found.runs)


def test_a_run_that_telemetry_has_something_against_is_not_fitted_unasked(tmp_path: Path) -> None:
    aborted = flown(
        "roll chirp", 100.0, ending="aborted", verdict={"keep": False, "log": "card", "reasons": ["Ctrl-C"]}
    )
    (one,) = of_flight([run(1, 100.0)], flight(tmp_path, aborted)).runs
    assert not one.usable
    assert "fly again: Ctrl-C" in one.reasons[0]


def test_a_log_of_another_boot_is_said(tmp_path: Path) -> None:
    folder = flight(tmp_path, flown("roll chirp", 100.0))
    found = of_flight([run(1, 260.0)], folder)
    assert found.problem.startswith("this log is of another boot, or another vehicle")
    assert "100 s of the vehicle's clock, the log's at 260 s" in found.problem
    assert found.matches[0].words == "roll chirp is not in this log"


def test_another_axis_at_the_same_time_is_another_run(tmp_path: Path) -> None:
    assert of_flight([run(1, 100.0, "pitch")], flight(tmp_path, flown("roll chirp", 100.0))).problem


def test_a_flight_without_times_is_refused(tmp_path: Path) -> None:
    with pytest.raises(TippathError, match="tells no run's time"):
        of_flight([run(1, 1.0)], flight(tmp_path, flown("roll chirp", 1.0) | {"log_start_s": None}))


def test_a_vehicles_own_log_is_matched(
    two_chirps: bytes, saved: Callable[[bytes, str], Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    log = saved(two_chirps, "00000007.BIN")
    entered = [one.entered_s for one in ingest([log]).runs]
    assert entered[0] is not None
    near = flight(tmp_path / "near", flown("roll chirp", entered[0] + 0.4))
    assert main(["ingest", str(log), "--flight", str(near), "--json"]) == 0
    document = json.loads(capsys.readouterr().out)
    assert document["flight"]["matches"][0]["run"] == "00000007.BIN#1"
    far = flight(tmp_path / "far", flown("roll chirp", entered[0] + 300.0))
    assert main(["ingest", str(log), "--flight", str(far)]) == 1
    assert "another boot" in capsys.readouterr().out
