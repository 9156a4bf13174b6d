"""`tippath design` and `tippath report --gains` on fits whose delay their gains do not hold."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from loops_in_time import Late, flown
from planted import TABLE_4

from gcs.analysis.clearance import cleared_again
from gcs.analysis.text.gains import measured_text
from gcs.flight.gains import GainsError
from sysid.control.measured_margins import NOTHING_MEASURED, Crossing, MeasuredMargins
from sysid.control.regulator import design
from sysid.control.stability import Margins
from sysid.fit.identify import identify
from sysid.model.paper import TPP
from sysid.model.structure import Model

Tippath = Callable[..., tuple[int, str, str]]
LATE_S = 0.080
"""Beyond what the paper's gains hold, 48 ms."""


@pytest.fixture(scope="module")
def flight(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the CSV of each of two chirps of Table 4's vehicle, 80 ms late, and with tpp.json, fitted to it."""
    folder = tmp_path_factory.mktemp("late")
    vehicle = Late(dict(TABLE_4), {"T_d": LATE_S}, ("transport_delay",))
    for axis in ("roll", "pitch"):
        channels = flown(vehicle, axis, 15.0).channels
        rows = zip(*channels.values(), strict=True)
        lines = [",".join(channels), *(",".join(f"{value:.7g}" for value in row) for row in rows)]
        (folder / f"{axis}.csv").write_text("\n".join(lines) + "\n")
    from gcs.cli import main

    runs = [str(folder / f"{axis}.csv") for axis in ("roll", "pitch")]
    assert main(["fit", *runs, "--model", "tpp", "--with", "transport_delay", "-o", str(folder / "tpp.json")]) == 0
    return folder


@pytest.fixture
def believed(flight: Path, tmp_path: Path) -> Path:
    """Gains of that fit as they were written when the delay was left out."""
    from sysid.fit.result import Fit

    model = Fit.load(flight / "tpp.json").model
    document = design(Model(TPP, TPP.vector({name: model[name] for name in TPP.names}))).to_json()
    path = tmp_path / "gains.json"
    path.write_text(json.dumps(document | {"margins_with": ["transport_delay"]}))
    return path


def test_design_refuses_and_names_the_cost_that_holds(flight: Path, tippath: Tippath, tmp_path: Path) -> None:
    target = tmp_path / "gains.json"
    status, out, err = tippath("design", flight / "tpp.json", "-o", target)
    assert (status, out) == (1, "")
    assert not target.exists()
    assert "do not hold this model with transport_delay (80 ms) in the loop" in err
    cost = err.split("--input-cost ")[1].split()[0]
    status, out, _ = tippath("design", flight / "tpp.json", "--input-cost", cost, "-o", target)
    assert status == 0
    assert "held: gain margin" in out
    assert "with transport_delay in the loop" in out
    document = json.loads(target.read_text())
    assert document["weights"]["inputs"] == float(cost)
    assert document["margins"]["gain_db"] > 6


@pytest.mark.thorough
@pytest.mark.usefixtures("few_effects")
def test_the_report_says_that_gains_do_not_hold_and_writes_its_page(
    flight: Path, believed: Path, tippath: Tippath, tmp_path: Path
) -> None:
    page = tmp_path / "page.html"
    status, _, err = tippath("report", flight / "tpp.json", "--gains", believed, "--no-diagnosis", "-o", page)
    assert status == 0
    for text in (err, page.read_text()):
        assert "do not hold this model with transport_delay (80 ms) in the loop" in text
    assert "none of these fits" not in err
    assert "Gains, gains.json, which do not hold tpp.json" in page.read_text()
    assert "NOT held" in page.read_text()


def test_the_report_says_why_gains_are_of_no_fit(
    flight: Path, believed: Path, tippath: Tippath, tmp_path: Path
) -> None:
    other = tmp_path / "other.json"
    document = json.loads(believed.read_text())
    document["model"]["parameters"]["L_b"] *= 1.01
    other.write_text(json.dumps(document))
    status, _, err = tippath("report", flight / "tpp.json", "--gains", other, "-o", tmp_path / "page.html")
    assert status == 1
    assert "designed on none of these fits: tpp.json: its model is another (L_b differ" in err
    document = json.loads(believed.read_text())
    document["K"][0][0] *= 1.01
    other.write_text(json.dumps(document))
    status, _, err = tippath("report", flight / "tpp.json", "--gains", other, "-o", tmp_path / "page.html")
    assert status == 1
    assert "K is not what `tippath design` makes of its model" in err


def test_a_fit_says_what_its_matrices_and_modes_leave_out(flight: Path, tippath: Tippath) -> None:
    document = json.loads((flight / "tpp.json").read_text())
    assert document["outside_matrices"] == ["transport_delay"]
    assert document["stable"] is True
    runs = [flight / f"{axis}.csv" for axis in ("roll", "pitch")]
    status, out, _ = tippath("fit", *runs, "--model", "tpp", "--with", "transport_delay")
    assert status == 0
    assert "not in them, for it acts on the commands before: transport_delay" in out


def test_the_same_vehicle_less_late_is_given_its_gains() -> None:
    early = Late(dict(TABLE_4), {"T_d": 0.020}, ("transport_delay",))
    fit = identify(TPP, [flown(early, axis, 15.0) for axis in ("roll", "pitch")], effects=["transport_delay"])
    assert design(fit.model).margins.delay_ms == pytest.approx(28, abs=3)


@pytest.mark.usefixtures("few_effects")
def test_a_diagnosis_is_kept_beside_its_fit_and_the_design_says_so(flight: Path, tippath: Tippath) -> None:
    def state() -> str:
        status, out, _ = tippath("design", flight / "tpp.json", "--input-cost", 100, "--json")
        assert status == 0
        return str(json.loads(out)["diagnosis"]["state"])

    assert state() == "not asked"
    status, out, err = tippath("diagnose", flight / "tpp.json", "--json")
    assert status == 0
    kept = flight / "tpp-diagnosis.json"
    assert f"wrote {kept}" in err
    assert json.loads(kept.read_text())["verdict"] == json.loads(out)["verdict"] == state()


@pytest.mark.thorough
def test_a_dynamic_prefilter_is_designed_kept_judged_again_and_reported(
    flight: Path, tippath: Tippath, tmp_path: Path
) -> None:
    path = tmp_path / "gains.json"
    options = (flight / "tpp.json", "--input-cost", 1000)
    status, out, _ = tippath("design", *options)
    assert status == 0
    assert "--prefilter dynamic mends the answer" in out
    status, out, _ = tippath("design", *options, "--prefilter", "dynamic", "-o", path)
    assert status == 0
    assert "of models that p and q follow" in out
    assert [line for line in out.splitlines() if len(line) > 80] == []
    document = json.loads(path.read_text())
    dynamic = document["dynamic_prefilter"]
    assert np.shape(dynamic["F"]) == (2, 4)
    assert min(dynamic["frequency_rad_s"]) > 0
    (fit, *_) = document["judged"]["models"]
    assert max(fit["coupling"], fit["overshoot"]) < 0.25
    again = cleared_again(path)
    assert again.judgement.models[0].coupling == pytest.approx(fit["coupling"], abs=1e-9)
    page = tmp_path / "page.html"
    assert tippath("report", flight / "tpp.json", "--gains", path, "--no-diagnosis", "-o", page)[0] == 0
    assert "of models that p and q follow" in page.read_text()
    path.write_text(json.dumps(document | {"dynamic_prefilter": dynamic | {"F": dynamic["F"][:1]}}))
    with pytest.raises(GainsError, match="wants 2 rows of F"):
        cleared_again(path)


def test_the_elevator_is_asked_of_a_fit_that_has_one(flight: Path, tippath: Tippath) -> None:
    status, out, err = tippath("design", flight / "tpp.json", "--elevator")
    assert (status, out) == (1, "")
    assert "the model has no elevator: fit forward flight --with angular_damping,elevator" in err


@pytest.mark.thorough
def test_observers_stand_side_by_side_and_costs_are_drawn(flight: Path, tippath: Tippath, tmp_path: Path) -> None:
    picture = tmp_path / "costs.png"
    options = (flight / "tpp.json", "--input-cost", 1000)
    status, out, _ = tippath("design", *options, "--observers", "--costs", "--plot", picture)
    assert status == 0
    rows = {line.split()[0]: line for line in out.splitlines() if line.startswith("  ") and line.split()}
    assert {"half", "paper", "twice", "four", "kalman"} <= set(rows)
    assert [line for line in out.splitlines() if len(line) > 80] == []
    assert picture.read_bytes()[:4] == b"\x89PNG"
    status, out, _ = tippath("design", *options, "--observers", "--json")
    document = json.loads(out)
    each = {one["observer"]: one for one in document["over_observers"]}
    assert each["paper"]["observer_gain"] == pytest.approx(np.array(document["observer_gain"]))
    assert each["half"]["command_noise"][0] < each["paper"]["command_noise"][0] < each["twice"]["command_noise"][0]
    assert min(each["kalman"]["gusts_left"]) > 0
    path = tmp_path / "kalman.json"
    assert tippath("design", *options, "--observer", "kalman", "-o", path)[0] == 0
    assert json.loads(path.read_text())["observer_gain"] == pytest.approx(np.array(each["kalman"]["observer_gain"]))


@pytest.mark.parametrize(
    ("options", "says"),
    [
        (("--observer", "50,50,51"), "wants kalman or such as 50,50,51,51 (four poles"),
        (("--observer", "50,50,50,51"), "each pole at most twice"),
        (("--observer", "50,50,51,nan"), "four poles, each below 0"),
        (("--observer", "fast"), "wants kalman or such as 50,50,51,51"),
        (("--measured", "--elevator"), "--measured knows a loop of two commands"),
        (("--plot", "costs.png"), "--plot draws what --costs lists: name both"),
        (("--costs", "--plot", "costs.gif"), "name a file that ends in .png, .svg or .html"),
        (("--for", "ardupilot", "--observer", "kalman"), "--observer goes with the paper's controller"),
        (("--for", "ardupilot", "--flapping-cost", "0.1"), "--flapping-cost goes with the paper's controller"),
        (("--flapping-cost", "-1"), "--flapping-cost: wants a number, not negative"),
    ],
)
def test_wrong_words_for_a_design(flight: Path, tippath: Tippath, options: tuple[str, ...], says: str) -> None:
    status, out, err = tippath("design", flight / "tpp.json", *options)
    assert (status, out) == (2, "")
    assert says in err


def test_a_push_of_gains_that_fail_asks_nothing_of_any_vehicle(flight: Path, tippath: Tippath, tmp_path: Path) -> None:
    """Gains that hold 80 ms, by hand made faster: the file's own verdict is not believed."""
    path = tmp_path / "gains.json"
    assert tippath("design", flight / "tpp.json", "--input-cost", 1000, "-o", path)[0] == 0
    faster = design(Model(TPP, TPP.vector(TABLE_4)), 1.0)
    document = json.loads(path.read_text())
    assert document["judged"]["verdict"] != "fails"
    path.write_text(json.dumps(document | {"K": faster.K.tolist()}))
    status, out, err = tippath("push", path, "--connect", "udpin:127.0.0.1:0", "--json")
    assert status == 1
    said = json.loads(out)
    assert said["reason"] == "margins"
    assert "TPP + transport_delay: not held" in said["error"]
    assert "nothing was sent" in err


@pytest.mark.thorough
def test_margins_that_were_measured_stand_beside_the_model_s(flight: Path, tippath: Tippath) -> None:
    status, out, _ = tippath("design", flight / "tpp.json", "--input-cost", 100, "--measured")
    assert status == 0
    assert "\n  measured      " in out
    status, out, _ = tippath("design", flight / "tpp.json", "--input-cost", 100, "--measured", "--json")
    assert status == 0
    document = json.loads(out)
    measured, model = document["margins_measured"], document["margins"]
    assert measured["band_hz"][0] < 1 < 8 < measured["band_hz"][1]
    for name in ("phase_deg", "gain_db"):
        if measured[name] is not None and model[name] is not None:
            assert measured[name]["value"] >= model[name] - measured[name]["bound"] - 0.02 * model[name]


def test_a_model_that_promises_more_than_was_measured_is_told_so() -> None:
    phase, delay = Crossing(value=21.0, bound=4.0, frequency_hz=4.8), Crossing(value=12.2, bound=2.3, frequency_hz=4.8)
    found = MeasuredMargins(band_hz=(0.5, 10.0), phase_deg=phase, delay_ms=delay, gain_db=None)
    promised, kept = (Margins(gain_db=17.0, phase_deg=one, delay_s=0.03) for one in (99.0, 22.0))
    text = measured_text(found, promised)
    words = " ".join(text.split())
    assert words.startswith("measured phase 21 ± 4° at 4.8 Hz; delay 12 ± 2 ms at 4.8 Hz; gain margin: not measured")
    assert "not measured between 0.5 and 10 Hz: the model has none; no unstable poles" in words
    lacking = replace(found, missing=("gain_db",), sweep_to_hz=14, unstable_poles=2)
    further = " ".join(measured_text(lacking, promised).split())
    assert "not measured between 0.5 and 10 Hz: sweep to 14 Hz; 2 unstable poles in the open loop" in further
    assert "The model promises more: it lacks something" in words
    assert all(len(line) <= 78 for line in text.splitlines())
    assert "promises more" not in measured_text(found, kept)
    assert "not measured well enough" in measured_text(NOTHING_MEASURED, promised)
