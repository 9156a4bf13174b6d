"""Gains judged on all that a fit's diagnosis and its bounds leave open, and again before a push."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from loops_in_time import Late, flown
from planted import TABLE_4

from gcs.analysis.clearance import Clearance, clearance, cleared_again
from gcs.analysis.diagnosis import diagnose_fit
from gcs.analysis.pushing import to_push
from gcs.analysis.standing import NOT_ASKED, Standing, beside, digest, open_models
from gcs.analysis.text.clearance import clearance_text
from gcs.analysis.text.documents import diagnosis_document
from gcs.flight.gains import GainsError, gains_of
from sysid.control.judgement import Limits, judge
from sysid.control.regulator import Gains, design
from sysid.control.stability import closed_loop
from sysid.fit.identify import identify
from sysid.fit.result import Fit
from sysid.model.compose import compose
from sysid.model.paper import TPP
from sysid.model.structure import Model

LAGGED = compose("tpp", ["servo_lag"], TPP.inputs)
LAG_S = 0.030
LATE = compose("tpp", ["transport_delay"], TPP.inputs)


@pytest.fixture(scope="module")
def flight() -> list[Any]:
    """Chirps of Table 4's vehicle behind servos that lag by 30 ms."""
    vehicle = Late(dict(TABLE_4), {"tau_s": LAG_S}, ("servo_lag",))
    return [flown(vehicle, axis, 15.0) for axis in ("roll", "pitch")]


@pytest.fixture(scope="module")
def fit(flight: list[Any]) -> Fit:
    return identify(TPP, flight)


def kept(gains: Gains, found: Clearance, folder: Path) -> Path:
    path = folder / "gains.json"
    path.write_text(json.dumps(gains.to_json() | found.to_json(folder)))
    return path


def lagged(fit: Fit, tau_s: float) -> Model:
    return Model(LAGGED, LAGGED.vector({**fit.model.by_name, "tau_s": tau_s}))


@pytest.mark.usefixtures("only_effects")
@pytest.mark.parametrize("only_effects", [("gyro_lag", "servo_lag", "transport_delay")], indirect=True)
def test_a_kept_diagnosis_gives_the_margins_of_the_completed_model(fit: Fit, flight: list[Any], tmp_path: Path) -> None:
    assert beside(tmp_path, fit) is NOT_ASKED
    found = diagnose_fit(fit, flight)
    assert (found.last.verdict, found.last.effect) == ("missing", "servo_lag")
    (tmp_path / "any-name.json").write_text(json.dumps(diagnosis_document(found, (), tmp_path)))
    standing = beside(tmp_path, fit)
    assert standing.state == "missing"
    assert standing.effects == ("servo_lag",)
    (role, model), *_ = standing.models
    assert role == "missing"
    assert model["tau_s"] == pytest.approx(LAG_S, rel=0.05)
    gains = design(fit.model)
    judged = clearance(gains, fit, standing, samples=5)
    truth = closed_loop(gains, Model(LAGGED, LAGGED.vector({**TABLE_4, "tau_s": LAG_S})))
    assert truth.margins is not None
    alone, completed, *_ = judged.judgement.models
    assert completed.loop.margins is not None
    assert completed.loop.margins.phase_deg == pytest.approx(truth.margins.phase_deg, abs=2)
    assert alone.loop.margins is not None
    assert alone.loop.margins.phase_deg > truth.margins.phase_deg + 20
    assert "lacks servo_lag" in clearance_text(judged)
    assert all(len(line) <= 78 for line in clearance_text(judged).splitlines())


def test_a_diagnosis_of_other_numbers_is_not_of_this_fit(fit: Fit, tmp_path: Path) -> None:
    other = replace(fit, model=Model(TPP, fit.model.values * 1.0000001))
    assert digest(other) != digest(fit)
    assert digest(Fit.from_json(json.loads(json.dumps(fit.to_json(tmp_path))), tmp_path)) == digest(fit)
    said = {"format": "tippath.diagnosis/1", "verdict": "complete", "confidence": 0.9, "fit_sha256": digest(other)}
    (tmp_path / "other.json").write_text(json.dumps(said))
    assert beside(tmp_path, fit) is NOT_ASKED
    (tmp_path / "own.json").write_text(json.dumps(said | {"fit_sha256": digest(fit)}))
    assert beside(tmp_path, fit).complete
    (tmp_path / "own.json").write_text(json.dumps(said | {"fit_sha256": digest(fit), "verdict": ["?"]}))
    assert beside(tmp_path, fit) is NOT_ASKED


def test_gains_fail_by_what_was_found_missing_and_only_words_let_them_pass(fit: Fit, tmp_path: Path) -> None:
    gains = design(fit.model)
    alone = clearance(gains, fit, NOT_ASKED, samples=0)
    assert alone.judgement.verdict != "fails"
    assert "NOT DIAGNOSED" in clearance_text(alone)
    assert to_push(gains_of(gains.to_json()), alone).why == ""
    margins = gains.margins
    late = Model(LATE, LATE.vector({**fit.model.by_name, "T_d": margins.delay_s - 0.005}))
    standing = Standing(state="missing", effects=("transport_delay",), models=(("missing", late),))
    found = clearance(gains, fit, standing, samples=0)
    assert found.judgement.verdict == "fails"
    again = cleared_again(kept(gains, found, tmp_path))
    assert again.standing.effects == ("transport_delay",)
    for one in (found, again):
        with pytest.raises(GainsError, match=r"TPP \+ transport_delay: .*delay 5 ms \(asked") as refused:
            to_push(gains_of(gains.to_json()), one, "  ")
        assert refused.value.reason == "margins"
        assert to_push(gains_of(gains.to_json()), one, "a tethered rig").why


def test_a_push_judges_what_a_design_judged(fit: Fit, tmp_path: Path) -> None:
    gains = design(fit.model)
    standing = Standing(state="missing", effects=("servo_lag",), models=(("missing", lagged(fit, LAG_S)),))
    found = clearance(gains, fit, standing)
    again = cleared_again(kept(gains, found, tmp_path))
    assert again.judgement.to_json() == found.judgement.to_json()


def test_a_push_believes_no_verdict_and_no_loose_limits(fit: Fit, tmp_path: Path) -> None:
    gains = design(fit.model)
    path = kept(gains, clearance(gains, fit, NOT_ASKED, samples=0), tmp_path)
    document = json.loads(path.read_text())
    document["K"] = (-20 * np.array(document["K"])).tolist()
    document["judged"] = {"verdict": "holds", "limits": Limits(gain_db=0.1, phase_deg=0.1, delay_ms=0.1).to_json()}
    path.write_text(json.dumps(document))
    assert cleared_again(path).judgement.verdict == "fails"
    assert cleared_again(path).judgement.limits == Limits()


@pytest.mark.parametrize(
    ("where", "what"),
    [
        ("covariance", [[1.0]]),
        (
            "models",
            [{"role": "hope", "model": {"structure": {"base": "tpp", "effects": []}, "parameters": {**TABLE_4}}}],
        ),
        ("models", [{"role": "fit", "model": {"structure": {"base": "tpp", "effects": ["x.py"]}, "parameters": {}}}]),
        ("models", [{"role": "fit", "model": {"structure": {"base": "tpp", "effects": []}, "parameters": {"L_b": 1}}}]),
    ],
)
def test_damaged_models_are_refused(fit: Fit, tmp_path: Path, where: str, what: object) -> None:
    gains = design(fit.model)
    path = kept(gains, clearance(gains, fit, NOT_ASKED, samples=0), tmp_path)
    document = json.loads(path.read_text())
    document["judged_on"][where] = what
    path.write_text(json.dumps(document))
    with pytest.raises(GainsError, match="design again") as refused:
        cleared_again(path)
    assert "\n" not in str(refused.value)


def test_an_older_file_is_judged_on_its_own_model_and_said_to_be_of_no_diagnosed_fit(fit: Fit, tmp_path: Path) -> None:
    gains = design(fit.model)
    path = tmp_path / "old.json"
    path.write_text(json.dumps(gains.to_json()))
    found = cleared_again(path)
    assert found.standing is NOT_ASKED
    assert found.judgement.to_json()["models"] == judge(gains, [("fit", gains.model)]).to_json()["models"]


@pytest.mark.usefixtures("few_effects")
def test_nothing_is_open_where_a_fit_is_complete(flight: list[Any], fit: Fit, tmp_path: Path) -> None:
    whole = identify(TPP, flight, effects=["servo_lag"])
    found = diagnose_fit(whole, flight)
    assert found.last.verdict == "complete"
    assert open_models(found, tmp_path) == []
