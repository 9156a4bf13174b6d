"""`tippath shadow`: gains over flights of the simulated vehicle, and of one whose bank runs wrongly."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from flying import CHIRP, PITCH, ROLL, Card, fly_maneuver, log_of
from more_of_a_kind import thorough

from gcs.cli import main
from gcs.flight.gains import load_gains
from sitl.autopilot.control_laws import LqrController
from sitl.autopilot.vehicle import make_vehicle
from sitl.pilot import obey

SWEEPS: Card = ((CHIRP, ROLL, 0.1, 14.0), (CHIRP, PITCH, 0.15, 14.0))
Capture = pytest.CaptureFixture[str]


def flown(folder: Path, *, axes: slice = slice(None), gains: Path | None = None, plant: str = "hover-ideal") -> Path:
    """The log of a sweep of each axis; with gains, their bank beside what flies."""
    folder.mkdir(parents=True)
    vehicle = make_vehicle(plant, 5, directory=folder, on_ground=True)
    if gains is not None:
        bank = load_gains(gains)
        for name, value in bank.values.items():
            vehicle.write_parameter("LQS_" + name, value)
        vehicle.write_parameter("LQR_COMMIT", bank.crc)
        vehicle.write_parameter("LQR_LOG", 1)
    obey(vehicle, "takeoff")
    for _ in range(2500):
        vehicle.step()
    for maneuver in SWEEPS[axes]:
        fly_maneuver(vehicle, *maneuver)
    return log_of(vehicle, folder)


@pytest.fixture(scope="module")
def designed(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """A flight's log, and gains that were designed on its fit."""
    folder = tmp_path_factory.mktemp("shadow")
    log = flown(folder / "flight")
    assert main(["fit", str(log), "--model", "tpp", "-o", str(folder / "fit.json")]) == 0
    assert main(["design", str(folder / "fit.json"), "-o", str(folder / "gains.json")]) == 0
    return log, folder / "gains.json"


def asked(capsys: Capture, *words: object) -> dict[str, Any]:
    capsys.readouterr()
    assert main(["shadow", *map(str, words), "--json"]) == 0
    document: dict[str, Any] = json.loads(capsys.readouterr().out)
    assert document["format"] == "tippath.shadow/1"
    return document


def refused(capsys: Capture, *words: object) -> str:
    capsys.readouterr()
    assert main(["shadow", *map(str, words)]) in (1, 2)
    error = capsys.readouterr().err
    assert "Traceback" not in error
    return error


def test_gains_are_cleared_over_the_flight_that_they_come_from(
    designed: tuple[Path, Path], tmp_path: Path, capsys: Capture
) -> None:
    log, gains = designed
    document = asked(capsys, gains, log)
    assert (document["verdict"], document["measured"]["roots_to_the_right"]) == ("cleared", 0)
    assert (document["beside"], document["faults"], document["targets_told"]) == ([], [], True)
    assert document["checksum"] == f"{load_gains(gains).crc:06x}"
    for one in document["outputs"]:
        assert 0 < one["rms"] < one["largest"] < 1
        assert 0 < one["innovation"] < 0.5
    picture = tmp_path / "loop.png"
    capsys.readouterr()
    assert main(["shadow", str(gains), str(log), "--plot", str(picture)]) == 0
    text = capsys.readouterr().out
    assert "CLEARED" in text
    assert max(map(len, text.splitlines())) <= 78
    assert picture.read_bytes().startswith(b"\x89PNG")
    assert "exists" in refused(capsys, gains, log, "--plot", picture)


def test_what_is_asked_may_be_more(designed: tuple[Path, Path], capsys: Capture) -> None:
    log, gains = designed
    document = asked(capsys, gains, log, "--limits", "120deg")
    assert document["verdict"] == "refused"
    assert [one["quantity"] for one in document["measured"]["shortfalls"]] == ["phase_deg"]
    assert "REFUSED" in text_of(capsys, gains, log, "--limits", "120deg")
    assert asked(capsys, gains, log, "--limits", "5deg")["limits"]["phase_deg"] == 45.0, "never less than usual"
    assert "wants such as" in refused(capsys, gains, log, "--limits", "many")


def text_of(capsys: Capture, *words: object) -> str:
    capsys.readouterr()
    assert main(["shadow", *map(str, words)]) == 0
    return capsys.readouterr().out


def test_a_bank_that_runs_as_it_should_is_said_and_clears_nothing(
    designed: tuple[Path, Path], tmp_path: Path, capsys: Capture
) -> None:
    log, gains = designed
    beside = flown(tmp_path / "beside", gains=gains)
    document = asked(capsys, gains, log, beside)
    assert document["verdict"] == "cleared", document["measured"]["not_measured"]
    (one,) = document["beside"]
    assert (one["faults"], one["checksum"]) == ([], document["checksum"])
    assert one["seconds"] > 20
    assert all(each["saturated_at_rest"] == 0 for each in one["outputs"])
    holed = with_hole(beside, tmp_path / "holed.BIN")
    (parts,) = asked(capsys, gains, holed)["beside"]
    assert parts["faults"] == []
    assert 10 < parts["seconds"] < one["seconds"], "two stretches, each begun anew"
    alone = asked(capsys, gains, flown(tmp_path / "roll", gains=gains, axes=slice(1)))
    assert (alone["verdict"], alone["beside"][0]["faults"]) == ("not measured", [])
    assert [one["why"] for one in alone["measured"]["not_measured"]] == ["axes"]
    assert "sweep roll and pitch" in " ".join(text_of(capsys, gains, tmp_path / "roll" / "vehicle-1.BIN").split())


@pytest.mark.thorough
def test_a_dynamic_prefilter_runs_beside_as_well_and_an_elevator_is_refused(
    designed: tuple[Path, Path], tmp_path: Path, capsys: Capture
) -> None:
    log, gains = designed
    dynamic = tmp_path / "dynamic.json"
    assert main(["design", str(gains.parent / "fit.json"), "--prefilter", "dynamic", "-o", str(dynamic)]) == 0
    document = asked(capsys, dynamic, log, flown(tmp_path / "beside", gains=dynamic, axes=slice(1)))
    assert document["verdict"] == "cleared", document["measured"]["not_measured"]
    assert document["beside"][0]["faults"] == []

    def steer(document: dict[str, Any]) -> None:
        document["elevator"] = {"K": [0.1, 0.1, 0.1, 0.1], "prefilter": [0.1, 0.1]}
        document["model"]["parameters"]["M_elev"] = 30.0

    assert "two cyclic commands" in refused(capsys, changed(gains, tmp_path / "elevator.json", steer), log)


Step = Callable[[LqrController, float, float, float, float], tuple[float, float, float]]


@pytest.mark.parametrize(
    ("change", "kind", "words"),
    [
        (lambda step: lambda self, p, q, x, y: step(self, q, p, x, y), "swapped", "roll and pitch are swapped"),
        *thorough(
            [
                (lambda step: lambda self, p, q, x, y: step(self, -p, q, x, y), "sign", "of roll has the wrong sign"),
                (lambda step: lambda self, p, q, x, y: step(self, p, 57.3 * q, x, y), "scale", "degrees for radians?"),
            ]
        ),
    ],
)
def test_a_bank_that_runs_wrongly_is_refused_and_told_why(
    designed: tuple[Path, Path],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: Capture,
    change: Callable[[Step], Step],
    kind: str,
    words: str,
) -> None:
    log, gains = designed
    monkeypatch.setattr(LqrController, "step", change(LqrController.step))
    wrong = flown(tmp_path / "wrong", gains=gains, axes=slice(1))
    monkeypatch.undo()
    document = asked(capsys, gains, log, wrong)
    assert document["measured"]["verdict"] == "cleared"
    assert document["verdict"] == "refused"
    assert kind in {one["kind"] for one in document["beside"][0]["faults"]}
    assert words in " ".join(text_of(capsys, gains, log, wrong).split())


def test_another_bank_than_these_gains_is_refused(designed: tuple[Path, Path], tmp_path: Path, capsys: Capture) -> None:
    log, gains = designed
    other = changed(gains, tmp_path / "other.json", lambda document: document["K"][0].__setitem__(0, 0.5))
    document = asked(capsys, gains, log, flown(tmp_path / "beside", gains=other, axes=slice(1)))
    assert [one["kind"] for one in document["beside"][0]["faults"]] == ["other bank"]
    assert document["verdict"] == "refused"


def changed(gains: Path, path: Path, change: Callable[[dict[str, Any]], object]) -> Path:
    document = json.loads(gains.read_text())
    change(document)
    path.write_text(json.dumps(document))
    return path


def test_destabilising_gains_are_refused(designed: tuple[Path, Path], tmp_path: Path, capsys: Capture) -> None:
    log, gains = designed

    def turn(document: dict[str, Any]) -> None:
        document["K"] = [[-value for value in row] for row in document["K"]]

    document = asked(capsys, changed(gains, tmp_path / "turned.json", turn), log)
    assert document["verdict"] == "refused"
    assert document["measured"]["roots_to_the_right"] > 0


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda document: document["K"][0].__setitem__(0, float("nan")), "design"),
        (lambda document: document.__setitem__("format", "tippath.rate_gains/1"), "no LQR's"),
        (lambda document: document["model"].__setitem__("structure", "cd"), "tpp"),
        (lambda document: document["model"]["parameters"].pop("L_b"), "L_b"),
        (lambda document: document["model"]["parameters"].__setitem__("tau_f", 0.0), "design"),
    ],
)
def test_gains_that_are_none_are_refused_in_one_line(
    designed: tuple[Path, Path],
    tmp_path: Path,
    capsys: Capture,
    change: Callable[[dict[str, Any]], object],
    words: str,
) -> None:
    log, gains = designed
    assert words in refused(capsys, changed(gains, tmp_path / "none.json", change), log)


def test_flights_that_tell_nothing_are_refused_in_one_line(
    designed: tuple[Path, Path], tmp_path: Path, capsys: Capture
) -> None:
    log, gains = designed
    broken = tmp_path / "broken.json"
    broken.write_text('{"format": ')
    assert "broken.json" in refused(capsys, broken, log)
    damaged = tmp_path / "damaged.BIN"
    damaged.write_bytes(log.read_bytes()[: log.stat().st_size // 6])
    assert "tippath shadow:" in refused(capsys, gains, damaged)
    assert "no such file" in refused(capsys, gains, tmp_path / "nowhere.BIN")
    assert "tippath shadow:" in refused(capsys, gains, flown(tmp_path / "hover", axes=slice(0)))
    assert asked(capsys, gains, with_hole(log, tmp_path / "holed.BIN"))["verdict"] in ("cleared", "not measured")


def with_hole(log: Path, path: Path) -> Path:
    """A log of which a part came as zeros."""
    shutil.copy(log, path)
    with path.open("r+b") as stream:
        stream.seek(log.stat().st_size // 2)
        stream.write(b"\x00" * 60_000)
    return path


def test_gains_of_another_vehicle_are_not_cleared(designed: tuple[Path, Path], tmp_path: Path, capsys: Capture) -> None:
    """Its cyclic steered the other way round: the flight is what counts."""
    log, gains = designed

    def other(document: dict[str, Any]) -> None:
        for parameters in (document["model"]["parameters"], document["judged_on"]["models"][0]["model"]["parameters"]):
            for name in ("A_lat", "A_lon", "B_lat", "B_lon"):
                parameters[name] = -parameters[name]
        document["K"] = [[-value for value in row] for row in document["K"]]

    assert asked(capsys, changed(gains, tmp_path / "other.json", other), log)["verdict"] != "cleared"
