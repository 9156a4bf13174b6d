"""Gains are pushed and flown, and `tippath proof` says whether the vehicle flies as it was predicted to."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from flying import CHIRP, DOUBLET, fly_maneuver, log_of
from slow_flight import SlowFlight

from gcs.cli import main
from gcs.flight.gains import gains_of
from gcs.vehicle.gain_switch import SCRIPT
from sitl.autopilot.modes import Mode, Reason
from sitl.autopilot.vehicle import Vehicle, make_vehicle

pytestmark = pytest.mark.usefixtures("logs_kept")
ROLL, PITCH, ELEVATOR, ROLL_RATE, PITCH_RATE = 10, 11, 20, 7, 8
DEG_S = 28.6
"""0.5 rad/s, as the card `proof` asks for."""


def pushed(vehicle: Vehicle, gains: Path) -> None:
    bank = gains_of(json.loads(gains.read_text()))
    for name, value in bank.values.items():
        assert vehicle.write_parameter(f"LQS_{name}", value) is not None
    assert vehicle.write_parameter("LQR_COMMIT", bank.crc) is not None
    assert vehicle.parameters["LQR_ACTIVE"] == bank.crc


def proof_flight(
    plant: str, gains: Path, folder: Path, *, repeat: int, seed: int = 111, lqr: bool = True, axes: Any = None
) -> Path:
    """The log of the card `proof`, without sockets or a clock."""
    folder.mkdir()
    vehicle = make_vehicle(plant, seed=seed, directory=folder, on_ground=True)
    pushed(vehicle, gains)
    assert vehicle.take_off() is None
    for _ in range(4000):
        vehicle.step()
    if lqr:
        assert vehicle.select_lqr(True) is None
    for _ in range(500):
        vehicle.step()
    for _ in range(repeat):
        for axis in axes or (ROLL_RATE, PITCH_RATE):
            fly_maneuver(vehicle, DOUBLET, axis, DEG_S, 9.0, pulse_s=0.5)
    return log_of(vehicle, folder)


@pytest.fixture(scope="module")
def gains(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Of `hover-ideal`, as it was identified."""
    folder = tmp_path_factory.mktemp("ideal")
    vehicle = make_vehicle("hover-ideal", seed=11, directory=folder)
    for axis, size in ((ROLL, 0.1), (PITCH, 0.15)) * 2:
        fly_maneuver(vehicle, CHIRP, axis, size, 20.0)
    log = log_of(vehicle, folder)
    fit, path = folder / "tpp.json", folder / "gains.json"
    assert main(["fit", str(log), "--model", "tpp", "-o", str(fit)]) == 0
    assert main(["design", str(fit), "-o", str(path)]) == 0
    return path


@pytest.fixture(scope="module")
def flight(gains: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return proof_flight("hover-ideal", gains, tmp_path_factory.mktemp("flight") / "log", repeat=4)


def asked(capsys: pytest.CaptureFixture[str], *words: str | Path) -> dict[str, Any]:
    capsys.readouterr()
    assert main(["proof", *map(str, words), "--json"]) == 0
    document: dict[str, Any] = json.loads(capsys.readouterr().out)
    return document


def evidence(document: Mapping[str, Any], axis: str, quantity: str) -> dict[str, Any]:
    (found,) = (e for e in document["evidence"] if (e["axis"], e["quantity"]) == (axis, quantity))
    return dict(found)


def within_the_issue_s_limits(document: Mapping[str, Any], axes: tuple[str, ...] = ("roll", "pitch")) -> None:
    """NRMSE above 85 %, rise within 15 %, the other axis within 5 points."""
    for axis in axes:
        assert np.mean(evidence(document, axis, "nrmse_percent")["flown"]) > 85
        rise, coupling = (evidence(document, axis, quantity) for quantity in ("rise_ms", "coupling"))
        assert abs(rise["difference"]) < 0.15 * rise["predicted"]
        assert abs(coupling["difference"]) < 0.05


def test_a_vehicle_that_flies_as_predicted_is_accepted_and_drawn(
    gains: Path, flight: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    document = asked(capsys, gains, flight)
    assert (document["verdict"], document["model"], document["ask"], document["left_out"]) == (
        "accepted",
        "TPP",
        None,
        [],
    )
    assert [run["axis"] for run in document["runs"]] == ["roll", "pitch"] * 4
    within_the_issue_s_limits(document)
    picture = tmp_path / "proof.png"
    assert main(["proof", str(gains), str(flight), "--plot", str(picture)]) == 0
    text = capsys.readouterr().out
    assert text.startswith("accepted: it flies as predicted; 4 roll and 4 pitch runs, predicted by TPP")
    assert max(map(len, text.splitlines())) <= 78
    assert picture.read_bytes().startswith(b"\x89PNG")


@pytest.mark.thorough
def test_a_dynamic_prefilter_leaves_the_other_axis_alone_as_predicted(
    gains: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    dynamic = gains.with_name("dynamic.json")
    assert main(["design", str(gains.with_name("tpp.json")), "--prefilter", "dynamic", "-o", str(dynamic)]) == 0
    document = asked(capsys, dynamic, proof_flight("hover-ideal", dynamic, tmp_path / "log", repeat=3))
    within_the_issue_s_limits(document)
    assert document["verdict"] != "not accepted"
    assert max(evidence(document, "roll", "coupling")["flown"]) < 0.1


def test_one_run_of_each_axis_is_too_few(gains: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    log = proof_flight("hover-ideal", gains, tmp_path / "log", repeat=1)
    assert asked(capsys, gains, log)["verdict"] == "too few to say"
    assert main(["proof", str(gains), str(log)]) == 0
    assert "fly the card `proof` again" in " ".join(capsys.readouterr().out.split())


def test_another_vehicle_than_the_model_s_is_not_accepted_and_the_diagnosis_is_named(
    gains: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Servos, play and inflow that no TPP has."""
    log = proof_flight("hover", gains, tmp_path / "log", repeat=3)
    document = asked(capsys, gains, log)
    assert (document["verdict"], document["ask"]) == ("not accepted", "diagnose")
    delay = evidence(document, "pitch", "delay_ms")
    assert (delay["verdict"], delay["difference"] > 10) == ("not accepted", True), document["evidence"]
    assert main(["proof", str(gains), str(log)]) == 0
    assert "`tippath diagnose FIT.json FLIGHT`" in " ".join(capsys.readouterr().out.split())


def test_runs_without_these_gains_are_left_out_and_told(
    gains: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    document = json.loads(gains.read_text())
    document["K"][0][0] *= 1.1
    other = gains.with_name("other.json")
    other.write_text(json.dumps(document))
    for name, flown, lqr, why in (
        ("a", other, True, "another set flew"),
        ("b", gains, False, "the pilot's switch did not select the LQR"),
    ):
        log = proof_flight("hover-ideal", flown, tmp_path / name, repeat=1, lqr=lqr, axes=(ROLL_RATE,))
        assert main(["proof", str(gains), str(log), "--json"]) == 1
        assert why in capsys.readouterr().err


@pytest.mark.parametrize("spoil", ["no.json", "empty", "csv", "nan"])
def test_what_proves_nothing_is_said_in_a_line(
    spoil: str, gains: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    document = json.loads(gains.read_text())
    file, flight = tmp_path / "gains.json", tmp_path / "flight"
    flight.mkdir()
    if spoil == "nan":
        document["K"][0][0] = float("nan")
    if spoil != "no.json":
        file.write_text(json.dumps(document))
    if spoil == "csv":
        flight = tmp_path / "flight.csv"
        flight.write_text("t,p,q,delta_x,delta_y\n" + "".join(f"{k / 100},0,0,0,0\n" for k in range(900)))
    assert main(["proof", str(file), str(flight)]) == 1
    said = capsys.readouterr().err
    assert "Traceback" not in said
    assert len(said.strip().splitlines()) == 1


# ------------------------------------------------------------------------------------------------ the other vehicles


def identified_and_flown(
    plant: str, words: tuple[str, ...], cost: str, folder: Path, *, repeat: int
) -> tuple[Path, Path]:
    """Gains on a fit, and a flight with them."""
    (folder / "id").mkdir()
    vehicle = make_vehicle(plant, seed=11, directory=folder / "id")
    axes = ((ROLL, 0.1), (PITCH, 0.15)) * 2 + (((ELEVATOR, 0.3),) if plant == "forward" else ())
    for axis, size in axes:
        fly_maneuver(vehicle, CHIRP, axis, size, 25.0)
    log = log_of(vehicle, folder / "id")
    fit, path = folder / "tpp.json", folder / "gains.json"
    assert main(["fit", str(log), "--model", "tpp", *words, "-o", str(fit)]) == 0
    assert main(["design", str(fit), "--input-cost", cost, "-o", str(path)]) == 0
    return path, proof_flight(plant, path, folder / "flown", repeat=repeat)


@pytest.mark.thorough
def test_forward_flight_is_as_predicted(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    words = ("--with", "angular_damping,elevator")
    document = asked(capsys, *identified_and_flown("forward", words, "5", tmp_path, repeat=3))
    assert document["verdict"] != "not accepted"
    within_the_issue_s_limits(document)


@pytest.mark.thorough
def test_a_hover_with_servos_and_play_is_as_predicted_once_the_model_has_them(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The vehicle has inflow besides, which the model has not."""
    words = ("--with", "servo_second_order,servo_backlash,transport_delay")
    document = asked(capsys, *identified_and_flown("hover", words, "8", tmp_path, repeat=5))
    within_the_issue_s_limits(document)
    assert document["verdict"] != "not accepted"


# ------------------------------------------------------------------------------------------------ ArduPilot's loops

SWEEP = {
    "SID_MAGNITUDE": 0.05,
    "SID_F_START_HZ": 0.5,
    "SID_F_STOP_HZ": 10.0,
    "SID_T_REC": 20.0,
    "SID_T_FADE_IN": 1.0,
    "SID_T_FADE_OUT": 0.5,
    "LOG_BITMASK": 180223.0,
}


def stock_flight(
    folder: Path, axes: tuple[int, ...], seed: int, *, kind: tuple[str, str] = ("quad", "ardupilot-quad"), **set: float
) -> Path:
    """The log of a sweep of each axis."""
    folder.mkdir()
    plant, like = kind
    vehicle = make_vehicle(plant, seed, directory=folder, parameters=SWEEP | set, like=like)
    for axis in axes:
        vehicle.write_parameter("SID_AXIS", axis)
        assert vehicle.set_mode(Mode.SYSTEMID, Reason.GROUND)
        for _ in range(round(27 / vehicle.dt)):
            vehicle.step()
        assert vehicle.set_mode(Mode.STABILIZE, Reason.GROUND)
        for _ in range(round(2 / vehicle.dt)):
            vehicle.step()
    vehicle.close()
    (path,) = folder.rglob("*.BIN")
    return path


@pytest.mark.thorough
def test_new_rate_gains_of_a_stock_autopilot_are_pushed_and_fly_as_predicted(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    log = stock_flight(tmp_path / "id", (ROLL, PITCH), 5)
    fit, rates = tmp_path / "fit.json", tmp_path / "rates.json"
    assert main(["fit", str(log), "--model", "multirotor", "-o", str(fit)]) == 0
    lua = tmp_path / "gains.lua"
    assert main(["design", str(fit), "--for", "ardupilot", "-o", str(rates), "--script", str(lua)]) == 0
    assert lua.read_text() == SCRIPT.read_text()
    with_script = SlowFlight(
        monkeypatch, "quad", "ardupilot-quad", tmp_path / "sd", bytes_s=400_000.0, gain_switch=True
    )
    with_script.sleep(2.0)
    capsys.readouterr()
    assert with_script.tippath("push", rates, "--json") == 0
    done = json.loads(capsys.readouterr().out)
    assert done["behind_switch"] == {"channel": 9, "option": 300}
    assert not any(one["refuses"] for one in done["objections"])
    with_script.close()
    new = {name: pair["new"] for name, pair in json.loads(rates.read_text())["parameters"].items()}
    flown = stock_flight(tmp_path / "new", (ROLL_RATE, PITCH_RATE) * 3, 6, SID_MAGNITUDE=20.0, **new)
    document = asked(capsys, rates, flown, "--fit", fit)
    within_the_issue_s_limits(document)
    assert document["verdict"] == "accepted"
    as_before = stock_flight(tmp_path / "old", (ROLL_RATE,), 7, SID_MAGNITUDE=20.0)
    assert main(["proof", str(rates), str(as_before), "--fit", str(fit), "--json"]) == 1
    assert "these gains did not fly" in capsys.readouterr().err
    assert main(["proof", str(rates), str(flown)]) == 2
    assert "--fit FIT.json" in capsys.readouterr().err


@pytest.mark.thorough
def test_new_rate_gains_of_a_stock_helicopter_fly_as_predicted(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    kind = ("hover-ideal", "ardupilot-heli")
    log = stock_flight(tmp_path / "id", (ROLL, PITCH), 5, kind=kind, SID_MAGNITUDE=0.1)
    fit, rates = tmp_path / "fit.json", tmp_path / "rates.json"
    assert main(["fit", str(log), "--model", "tpp", "-o", str(fit)]) == 0
    assert main(["design", str(fit), "--for", "ardupilot", "-o", str(rates)]) == 0
    new = {name: pair["new"] for name, pair in json.loads(rates.read_text())["parameters"].items()}
    flown = stock_flight(
        tmp_path / "new", (ROLL_RATE, PITCH_RATE) * 4, 6, kind=kind, **({"SID_MAGNITUDE": DEG_S} | new)
    )
    document = asked(capsys, rates, flown, "--fit", fit)
    within_the_issue_s_limits(document)
    assert document["verdict"] != "not accepted"
