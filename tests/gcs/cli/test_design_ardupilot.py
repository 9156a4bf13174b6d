"""`tippath design FIT.json --for ardupilot`: from flights of a vehicle with stock loops to a parameter file."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path
from shutil import copytree
from typing import Any

import numpy as np
import pytest

from gcs.analysis import rate_gains
from gcs.analysis.clearance import cleared_again
from gcs.analysis.standing import digest
from gcs.analysis.text.clearance import require_cleared
from gcs.cli import main
from gcs.flight.gains import GainsError
from gcs.logs.formats.dataflash_table import DataFlashTables
from gcs.logs.opening import open_log
from gcs.vehicle.rate_loops import rate_loops
from sitl.autopilot.modes import Mode, Reason
from sitl.autopilot.vehicle import make_vehicle
from sysid.control.sampled import sampled_plant
from sysid.fit.result import Fit
from sysid.fit.saved_model import model_json
from sysid.model.compose import compose
from sysid.model.structure import Model
from sysid.rate_loop.linear import controller

SWEEP = {
    "SID_MAGNITUDE": 0.05,
    "SID_F_STOP_HZ": 10.0,
    "SID_T_FADE_IN": 1.0,
    "SID_T_FADE_OUT": 0.5,
    "LOG_BITMASK": 180223.0,
}


def flown(
    folder: Path,
    like: str,
    plant: str,
    *,
    axes: tuple[int, ...] = (10, 11),
    between: Mapping[str, float] | None = None,
    sweep_s: float = 20.0,
    **settings: float,
) -> Path:
    """The log of a sweep of each axis; `between` is written before the second."""
    folder.mkdir()
    vehicle = make_vehicle(plant, 5, directory=folder, parameters=SWEEP | {"SID_T_REC": sweep_s} | settings, like=like)
    for number, axis in enumerate(axes):
        for name, value in (between or {}).items() if number else ():
            vehicle.write_parameter(name, value)
        vehicle.write_parameter("SID_AXIS", axis)
        assert vehicle.set_mode(Mode.SYSTEMID, Reason.GROUND)
        for _ in range(round((sweep_s + 7) / vehicle.dt)):
            vehicle.step()
        assert vehicle.set_mode(Mode.STABILIZE, Reason.GROUND)
        for _ in range(round(2 / vehicle.dt)):
            vehicle.step()
    vehicle.close()
    (path,) = folder.rglob("*.BIN")
    return path


@pytest.fixture(scope="module")
def quad_fit(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("quad")
    log = flown(folder / "flight", "ardupilot-quad", "quad")
    path = folder / "fit.json"
    assert main(["fit", str(log), "--model", "multirotor", "-o", str(path)]) == 0
    return path


def designed(capsys: pytest.CaptureFixture[str], *words: object) -> dict[str, Any]:
    capsys.readouterr()
    assert main(["design", *map(str, words), "--for", "ardupilot", "--json"]) == 0
    document: dict[str, Any] = json.loads(capsys.readouterr().out)
    return document


@pytest.mark.usefixtures("few_samples")
def test_from_a_quadrotor_s_flight_to_a_parameter_file(
    quad_fit: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "new.param"
    document = designed(capsys, quad_fit, "-o", path)
    assert document["format"] == "tippath.rate_gains/1"
    changes = document["parameters"]
    assert set(changes) == {f"ATC_RAT_{axis}_{gain}" for axis in ("RLL", "PIT") for gain in "PID"}
    assert changes["ATC_RAT_RLL_P"]["flown"] == pytest.approx(0.135)
    assert path.read_text("utf-8").splitlines() == [f"{name},{one['new']:g}" for name, one in changes.items()]
    for one in changes.values():
        assert one["new"] <= 1.3001 * one["flown"]
    margins = document["new"]["margins"]
    assert margins["gain_db"] >= 6
    assert margins["phase_deg"] >= 45
    assert margins["delay_ms"] >= 10
    assert all(run["residual_percent"] < 1 for run in document["repeated"])
    for axis in ("roll", "pitch"):
        assert document["new"][axis]["rejection_hz"] > document["flown"][axis]["rejection_hz"]
    # the simulated vehicle flies them
    settings = {name: one["new"] for name, one in changes.items()}
    vehicle = make_vehicle("quad", 6, parameters=settings, like="ardupilot-quad")
    lean = 0.0
    for _ in range(round(10 / vehicle.dt)):
        vehicle.step()
        lean = max(lean, abs(vehicle.plant.phi), abs(vehicle.plant.theta))
    assert lean < 0.05


@pytest.fixture(scope="module")
def quad_set(quad_fit: Path) -> str:
    """The JSON document of the set that is designed on it."""
    path = quad_fit.parent / "rate-gains.json"
    assert main(["design", str(quad_fit), "--for", "ardupilot", "-o", str(path)]) == 0
    return path.read_text("utf-8")


@pytest.fixture
def few_samples(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(rate_gains, "ardupilot_gains", partial(rate_gains.ardupilot_gains, samples=20))


def kept(document: Mapping[str, Any], path: Path) -> Path:
    path.write_text(json.dumps(document))
    return path


def test_both_sets_are_judged_and_the_file_is_judged_anew(
    quad_set: str, tmp_path: Path, few_of_the_errors: int
) -> None:
    path, document = tmp_path / "rate-gains.json", json.loads(quad_set)
    path.write_text(quad_set)
    assert document["judged_flown"]["noise"]["times_flown"] == pytest.approx(1)
    assert 1 < document["judged"]["noise"]["times_flown"] <= 1.3013
    for name in ("judged", "judged_flown"):
        assert document[name]["verdict"] == "holds"
        assert document[name]["bounds"]["samples"] == few_of_the_errors
    again = cleared_again(path)
    assert json.loads(json.dumps(again.judgement.to_json())) == document["judged"]
    require_cleared(again, None)
    # what is written is judged, whatever stands there as its verdict
    document["parameters"]["ATC_RAT_RLL_P"]["new"] *= 20
    refused = cleared_again(kept(document, path))
    assert refused.judgement.verdict == "fails"
    with pytest.raises(GainsError, match="not cleared") as error:
        require_cleared(refused, None)
    assert error.value.reason == "margins"


@pytest.mark.parametrize(
    ("where", "what"),
    [
        (("parameters",), {"ATC_RAT_RLL_P": {"new": None}}),
        (("parameters",), {"ARMING_CHECK": {"new": 0.0}}),
        (("judged_on", "models"), []),
        (("judged_on", "loops"), {}),
        (("judged_on", "loops", "loop_hz"), 0),
        (("judged_on", "covariance"), [[1.0]]),
        (("command_noise",), {"own": {"rms": [0.1]}}),
    ],
)
def test_a_damaged_set_is_refused_in_a_line(
    quad_set: str, tmp_path: Path, where: tuple[str, ...], what: object
) -> None:
    document = part = json.loads(quad_set)
    for key in where[:-1]:
        part = part[key]
    part[where[-1]] = what
    with pytest.raises(GainsError, match="`tippath design`") as error:
        cleared_again(kept(document, tmp_path / "damaged.json"))
    assert "\n" not in str(error.value)


@pytest.mark.thorough
@pytest.mark.usefixtures("few_samples")
def test_gains_hold_what_the_diagnosis_leaves_open(
    quad_fit: Path, quad_set: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A kept diagnosis that says 40 ms are missing: the gains are others, and both sets are judged with them."""
    alone = json.loads(quad_set)
    fit = Fit.load(quad_fit)
    structure = compose("multirotor", ("transport_delay",))
    late = Model(structure, structure.vector({**fit.model.by_name, "T_d": 0.040}))
    model = {"role": "missing", "effects": ["transport_delay"], "model": model_json(late, tmp_path)}
    said = {"format": "tippath.diagnosis/1", "verdict": "missing", "chain": ["transport_delay"], "confidence": 0.9}
    folder = tmp_path / "asked"
    copytree(quad_fit.parent, folder)
    kept({**said, "fit_sha256": digest(fit), "models": [model]}, folder / "diagnosis.json")
    found = designed(capsys, folder / "fit.json")
    assert found["diagnosis"]["effects"] == ["transport_delay"]
    assert [one["role"] for one in found["judged"]["models"]] == ["fit", "missing"]
    assert found["judged"]["verdict"] != "fails"
    assert found["judged"]["models"][1]["margins"]["delay_ms"] >= 20
    slower, faster_ = (sum(one["new"][axis]["rejection_hz"] for axis in ("roll", "pitch")) for one in (found, alone))
    assert slower <= faster_
    assert len(found["judged_flown"]["models"]) == 2


@pytest.mark.thorough
@pytest.mark.usefixtures("few_samples")
def test_asked_limits_are_those_that_are_judged(quad_fit: Path, capsys: pytest.CaptureFixture[str]) -> None:
    document = designed(capsys, quad_fit, "--limits", "16dB,50deg")
    assert document["judged"]["limits"]["gain_db"] == 16
    assert document["new"]["margins"]["gain_db"] >= 16
    assert document["judged"]["bounds"]["least"]["gain_db"] >= 16


@pytest.mark.thorough
@pytest.mark.usefixtures("few_samples")
def test_measured_margins_stand_beside_both_sets(quad_fit: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The sweeps go to 10 Hz and the gain margin is decided beyond: not cleared, and it says how far to sweep."""
    document = designed(capsys, quad_fit, "--measured")
    for name, loop in (("margins_measured", "new"), ("margins_measured_flown", "flown")):
        measured, model = document[name], document[loop]["margins"]
        phase = measured["phase_deg"]
        assert abs(phase["value"] - model["phase_deg"]) < phase["bound"] + 2
        assert measured["disk"]["bound"] > 0
        assert measured["unstable_poles"] == 0
    judged = document["judged"]
    assert judged["measured"]["needed"] == ["gain_db", "phase_deg", "delay_ms"]
    assert judged["measured"]["missing"] == ["gain_db"]
    assert judged["measured"]["sweep_to_hz"] > document["margins_measured"]["band_hz"][1]
    assert judged["verdict"] == "not measured"
    assert main(["design", str(quad_fit), "--for", "ardupilot", "--measured"]) == 0
    text = capsys.readouterr().out
    assert "NOT MEASURED" in text
    assert f"sweep to {judged['measured']['sweep_to_hz']:g} Hz" in " ".join(text.split())


@pytest.mark.usefixtures("few_samples")
def test_the_text_has_old_and_new(quad_fit: Path, capsys: pytest.CaptureFixture[str]) -> None:
    capsys.readouterr()
    assert main(["design", str(quad_fit), "--for", "ardupilot"]) == 0
    text = capsys.readouterr().out
    assert "ATC_RAT_PIT_D            0.0036" in text
    assert "repeat the commands that the vehicle logged to rounding" in text
    assert "thrust curve (MOT_THST_EXPO 0.65" in text
    assert max(map(len, text.splitlines())) <= 78


def followed(path: Path, fit: Path, start_s: float, stop_s: float) -> tuple[float, float]:
    """NRMSE in percent of p and q: a log's rates against those of fit and loops in a loop, for the log's targets."""
    ((log, _),) = open_log(path, None).parts
    assert isinstance(log, DataFlashTables)
    loops = rate_loops(log.parameters(start_s))
    law = controller((replace(loops.roll, angle_p=0.0), replace(loops.pitch, angle_p=0.0)), 1 / loops.loop_hz)
    plant = sampled_plant(Fit.load(fit).model, 1 / loops.loop_hz, gyro_corner_hz=20.0).system
    series = [log.series(f"RATE.{name}").part(start_s, stop_s).values for name in ("RDes", "PDes", "R", "P")]
    targets, rates = np.radians(series[:2]).T, np.radians(series[2:]).T
    of_law, of_plant, predicted = np.zeros(len(law.A)), np.zeros(len(plant.A)), []
    for target in targets[:-1]:  # a row's target is the next loop's
        measured = plant.C @ of_plant
        predicted.append(measured)
        seen = np.concatenate([target, measured])
        command = law.C @ of_law + law.D @ seen
        of_law, of_plant = law.A @ of_law + law.B @ seen, plant.A @ of_plant + plant.B @ command
    left = np.std(rates[1:] - predicted, axis=0) / np.std(rates, axis=0)
    return float(100 * (1 - left[0])), float(100 * (1 - left[1]))


def test_flown_rates_are_those_that_fit_and_loops_predict(quad_fit: Path, tmp_path: Path) -> None:
    """Of a flight that the fit has not seen, with its rate target swept."""
    path = flown(tmp_path / "rates", "ardupilot-quad", "quad", axes=(7,), SID_MAGNITUDE=20.0)
    assert followed(path, quad_fit, 3.0, 24.0)[0] > 85


@pytest.mark.data
def test_a_real_autopilot_s_flight_is_as_predicted(shared_data: Path, tmp_path: Path) -> None:
    """The helicopter's sweep of its rate target, from a fit to sweeps of its mixer: both axes, with their coupling."""
    logs = [str(shared_data / "ardupilot" / f"heli_{axis}_sweep.BIN") for axis in ("roll", "pitch")]
    fit = tmp_path / "fit.json"
    assert main(["fit", *logs, "--model", "tpp", "--with", "transport_delay", "-o", str(fit)]) == 0
    p, q = followed(shared_data / "ardupilot" / "heli_axis7_roll_rate.BIN", fit, 1025.0, 1055.5)
    assert min(p, q) > 90


def test_runs_of_other_gains_are_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    log = flown(tmp_path / "flight", "ardupilot-quad", "quad", between={"ATC_RAT_PIT_P": 0.11}, sweep_s=8.0)
    fit = tmp_path / "fit.json"
    assert main(["fit", str(log), "--model", "multirotor", "-o", str(fit)]) == 0
    capsys.readouterr()
    assert main(["design", str(fit), "--for", "ardupilot"]) == 1
    assert "other gains than in the runs before (ATC_RAT_PIT_P)" in capsys.readouterr().err


def test_what_acts_and_is_not_modelled_refuses(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    log = flown(tmp_path / "flight", "ardupilot-quad", "quad", sweep_s=8.0, ATC_RAT_RLL_SMAX=20.0)
    fit = tmp_path / "fit.json"
    assert main(["fit", str(log), "--model", "multirotor", "-o", str(fit)]) == 0
    capsys.readouterr()
    assert main(["design", str(fit), "--for", "ardupilot", "-o", str(tmp_path / "no.param")]) == 1
    said = capsys.readouterr().err
    assert "ATC_RAT_RLL_SMAX" in said
    assert "set it to 0" in said
    assert not (tmp_path / "no.param").exists()


def test_one_axis_alone_is_refused_in_a_line(
    quad_fit: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (log,) = quad_fit.parent.rglob("*.BIN")
    fit = tmp_path / "fit.json"
    assert main(["fit", f"{log}#1", "--model", "roll", "-o", str(fit)]) == 0
    capsys.readouterr()
    assert main(["design", str(fit), "--for", "ardupilot"]) == 1
    assert "not both roll and pitch" in capsys.readouterr().err


def test_an_option_of_the_other_design_is_refused(quad_fit: Path) -> None:
    assert main(["design", str(quad_fit), "--for", "ardupilot", "--costs"]) == 2


@pytest.mark.thorough
@pytest.mark.usefixtures("few_samples")
def test_what_the_fit_lacks_is_said_beside_the_gains(quad_fit: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert designed(capsys, quad_fit)["diagnosis"]["state"] == "not asked"
    assert main(["design", str(quad_fit), "--for", "ardupilot"]) == 0
    assert "NOT DIAGNOSED" in capsys.readouterr().out
    assert main(["diagnose", str(quad_fit)]) == 0
    capsys.readouterr()
    assert designed(capsys, quad_fit)["diagnosis"]["state"] in ("complete", "missing", "unexplained")


@pytest.mark.data
@pytest.mark.usefixtures("few_samples")
def test_a_real_autopilot_s_helicopter(shared_data: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    logs = [str(shared_data / "ardupilot" / f"heli_{axis}_sweep.BIN") for axis in ("roll", "pitch")]
    fit = tmp_path / "fit.json"
    assert main(["fit", *logs, "--model", "tpp", "--with", "transport_delay", "-o", str(fit)]) == 0
    document = designed(capsys, fit)
    assert document["flown"]["held"], "it flew"
    assert document["asked"]["delay_ms"] == pytest.approx(25, abs=1), "half of the delay that was found"
    assert all(run["residual_percent"] < 0.001 for run in document["repeated"])
    # the feed-forward is told; rates would overshoot with it, so the flown one stays
    for axis, word in (("roll", "RLL"), ("pitch", "PIT")):
        told = document["feed_forward"][axis]
        assert not told["taken"]
        one = document["parameters"][f"ATC_RAT_{word}_FF"]
        assert one["new"] == pytest.approx(one["flown"], rel=1e-4)
        assert 1 / told["rate_per_command"] > one["flown"]


@pytest.mark.thorough
def test_the_gains_know_the_vehicle_of_their_fit(quad_fit: Path, capsys: pytest.CaptureFixture[str]) -> None:
    known = designed(capsys, quad_fit)["identified"]
    assert known["parameters"]["ATC_RAT_RLL_P"] == pytest.approx(0.135)
    assert known["parameters"]["SCHED_LOOP_RATE"] == 400
    assert (known["changed"], known["battery_v"]) == ([], None)
    assert not [name for name in known["parameters"] if name.startswith("SID_")]


def test_a_setting_changed_between_runs_is_known_and_battery_and_rotor_from_the_flight_s_file(
    quad_fit: Path, tmp_path: Path
) -> None:
    from gcs.analysis.identified import identified

    log = flown(tmp_path / "flight", "ardupilot-quad", "quad", between={"MOT_THST_EXPO": 0.5}, sweep_s=5.0)
    put = log.rename(log.parent / "flight.BIN")
    about = {"format": "tippath.flight/1", "vehicle": {"battery_v": 23.5, "rotor_rpm": None}}
    (log.parent / "flight.json").write_text(json.dumps(about))
    fit = Fit.load(quad_fit)
    found = identified(replace(fit, records=tuple(replace(one, path=str(put)) for one in fit.records)))
    assert found.changed == ("MOT_THST_EXPO",)
    assert "MOT_THST_EXPO" not in found.parameters
    assert (found.battery_v, found.rotor_rpm) == ((23.5, 23.5), None)
    put.unlink()
    assert identified(replace(fit, records=tuple(replace(one, path=str(put)) for one in fit.records))).parameters == {}
