"""Outputs are the structure's: flapping that is measured, a yaw rate, in any order. Truth is SciPy's, not sysid's:
matrices written down here a second time, `cont2discrete` and `dlsim`."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest
from scipy.signal import cont2discrete, dlsim

import sysid
from sysid.data.dataset import dataset
from sysid.data.preprocess import spectra
from sysid.data.stacks import stack
from sysid.diagnose.candidates import composed_with, score_effects
from sysid.diagnose.evidence import candidate, instrumental_step, refit
from sysid.errors import FitError
from sysid.fit.estimate import estimate
from sysid.fit.result import Fit, ResultError
from sysid.fit.whitening import noise_whitening
from sysid.model.effect import catalogue
from sysid.model.predict import respond
from sysid.model.structure import FloatArray

DT = 0.005
T = np.arange(0, 14, DT)
SWEEP = 0.1 * np.sin(2 * np.pi * (0.3 * T + 0.35 * T**2)) * (T < 12)
ALL = ("p", "q", "a", "b")
TPP = {
    "L_b": 147.5, "M_a": 713.4, "tau_f": 0.091,
    "A_b": -1.338, "B_a": 1.448, "A_lat": -0.282, "A_lon": 0.296, "B_lat": 0.524, "B_lon": -0.050,
}  # fmt: skip
LAG_S = 0.03
NOISE = {"p": 0.02, "q": 0.02, "r": 0.02, "a": 0.002, "b": 0.002}
YAWING = {"L_p": -4.0, "M_q": -6.0, "N_r": -1.5, "L_lat": 40.0, "M_lon": 30.0, "N_yaw": 12.0, "N_p": 0.8}
YAWING_FILE = '''
"""Axes apart, the yaw rate among them, which follows the roll rate a little."""

from sysid.model.base import Base
from sysid.model.parameter import Parameter


def equations(s):
    return {
        "p_dot": s.L_p * s.p + s.L_lat * s.delta_x,
        "q_dot": s.M_q * s.q + s.M_lon * s.delta_y,
        "r_dot": s.N_r * s.r + s.N_yaw * s.delta_r + s.N_p * s.p,
    }


BASE = Base(
    name="yawing",
    title="axes apart, with yaw",
    states=("p", "q", "r"),
    outputs=("p", "q", "r"),
    commands=("delta_x", "delta_y", "delta_r"),
    parameters=tuple(Parameter(name, "1/s", name) for name in ("L_p", "M_q", "N_r", "L_lat", "M_lon", "N_yaw", "N_p")),
    equations=equations,
    uncoupled=(-5.0, -5.0, -5.0, 0, 0, 0, 0),
)
'''


def flown(A: FloatArray, B: FloatArray, names: Sequence[str], commands: Sequence[str], swept: int) -> sysid.Record:
    """A chirp on one command, noise on all, from SciPy's simulation; the first states are the outputs."""
    rng = np.random.default_rng(7 + swept)
    u = 0.01 * rng.normal(size=(T.size, len(commands)))
    u[:, swept] += SWEEP
    k, n = len(names), len(A)
    Ad, Bd, C, D, _ = cont2discrete((A, B, np.eye(n)[:k], np.zeros((k, len(commands)))), DT)
    _, y, _ = dlsim((Ad, Bd, C, D, DT), u)
    y = y + rng.normal(size=y.shape) * [NOISE[name] for name in names]
    channels = {"t": T, **dict(zip(names, y.T, strict=True)), **dict(zip(commands, u.T, strict=True))}
    return sysid.Record(f"run{swept}", channels, maneuver="chirp", axis=("roll", "pitch", None)[swept])


def helicopters(lag_s: float | None = None) -> list[sysid.Record]:
    """The paper's eq. 5-7, written down again, behind servos where they lag; the tilt of the disc is measured."""
    p = TPP
    A = np.array(
        [
            [0, 0, 0, p["L_b"]],
            [0, 0, p["M_a"], 0],
            [0, -1, -1 / p["tau_f"], p["A_b"] / p["tau_f"]],
            [-1, 0, p["B_a"] / p["tau_f"], -1 / p["tau_f"]],
        ]
    )
    B = np.array([[0, 0], [0, 0], [p["A_lat"], p["A_lon"]], [p["B_lat"], p["B_lon"]]]) / p["tau_f"]
    if lag_s is not None:
        A = np.block([[A, B], [np.zeros((2, 4)), -np.eye(2) / lag_s]])
        B = np.vstack([np.zeros((4, 2)), np.eye(2) / lag_s])
    return [flown(A, B, ALL, ("delta_x", "delta_y"), swept) for swept in (0, 1)]


def turning() -> list[sysid.Record]:
    y = YAWING
    A = np.array([[y["L_p"], 0, 0], [0, y["M_q"], 0], [y["N_p"], 0, y["N_r"]]])
    B = np.diag([y["L_lat"], y["M_lon"], y["N_yaw"]])
    return [flown(A, B, ("p", "q", "r"), ("delta_x", "delta_y", "delta_r"), swept) for swept in (0, 1, 2)]


def near(fit: Fit, truth: dict[str, float]) -> None:
    """Every number within four of its standard errors, which are small."""
    for name, value in truth.items():
        error = fit.standard_errors[fit.model.structure.names.index(name)]
        assert abs(fit.model[name] - value) < 4 * error, name
        assert error < 0.03 * abs(value), name


@pytest.fixture(scope="module")
def measured() -> list[sysid.Record]:
    return helicopters()


@pytest.fixture(scope="module")
def lagging() -> list[sysid.Record]:
    return helicopters(LAG_S)


@pytest.fixture(scope="module")
def yawing(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("mine") / "yawing.py"
    path.write_text(YAWING_FILE, encoding="utf-8")
    return path


def test_measured_flapping_is_fitted_and_tells_more_than_rates_alone(measured: list[sysid.Record]) -> None:
    fit, rates = sysid.fit_model(measured, "tpp", outputs=ALL), sysid.fit_model(measured, "tpp")
    near(fit, TPP)
    assert tuple(fit.nrmse_percent) == ALL
    assert min(fit.nrmse_percent.values()) > 90
    assert np.all(fit.standard_errors < rates.standard_errors)


def test_an_effect_is_found_and_judged_on_all_outputs(lagging: list[sysid.Record]) -> None:
    fit = sysid.fit_model(lagging, "tpp", ["servo_lag"], outputs=ALL, validation=lagging)
    near(fit, {**TPP, "tau_s": LAG_S})
    assert [tuple(rung.nrmse_percent) for rung in fit.lineage] == [ALL, ALL]
    assert tuple(fit.validation_nrmse_percent or ()) == ALL
    assert sysid.judge_model(fit.model, lagging) == pytest.approx(fit.nrmse_percent, abs=1e-9)


def test_a_fit_keeps_its_outputs(measured: list[sysid.Record], tmp_path: Path) -> None:
    fit = sysid.fit_model(measured, "tpp", outputs=ALL)
    document = json.loads(json.dumps(fit.to_json(tmp_path)))
    assert document["structure"]["outputs"] == list(ALL)
    assert Fit.from_json(document, tmp_path).model.structure == fit.model.structure
    plain = sysid.fit_model(measured, "tpp").to_json(tmp_path)
    assert not {"outputs", "user_base"} & set(plain["structure"]), "a document of p and q is as it was"


@pytest.mark.parametrize("effect", ["servo_lag", "quadratic_damping"])
def test_a_response_is_in_the_order_of_the_outputs(lagging: list[sysid.Record], effect: str) -> None:
    """In matrices, and by relaxation; what is not measured as well changes nothing of what is."""
    values = {**TPP, "tau_s": LAG_S, "L_pp": -1.0, "M_qq": -1.0}
    answers = {}
    for outputs in (ALL, ("b", "q", "a", "p"), ("p", "q")):
        structure = sysid.compose("tpp", [effect], outputs=outputs)
        found, _ = spectra(lagging[:1], structure.inputs, outputs)
        (group,) = stack(found)
        typical = {one.name: one.typical for one in structure.parameters}
        response = respond(structure, structure.vector({**typical, **values}), group, True)
        assert response.J is not None
        answers[outputs] = dict(zip(outputs, np.moveaxis(np.stack([response.Y, *response.J]), 1, 0), strict=True))
    usual, other, rates = answers.values()
    for name in ALL:
        np.testing.assert_allclose(other[name], usual[name], rtol=1e-3, atol=1e-3 * np.max(np.abs(usual[name])))
    for name in ("p", "q"):
        np.testing.assert_allclose(rates[name], usual[name], rtol=1e-3, atol=1e-2 * np.max(np.abs(usual[name])))


def test_rates_in_another_order_say_what_the_closed_form_says(measured: list[sysid.Record]) -> None:
    closed, general = sysid.fit_model(measured, "tpp"), sysid.fit_model(measured, "tpp", outputs=("q", "p"))
    # both end within a tenth of a standard error of the optimum
    assert np.all(np.abs(closed.model.values - general.model.values) < 0.1 * closed.standard_errors)


@pytest.mark.usefixtures("few_effects")
def test_what_is_missing_is_named_on_four_outputs(lagging: list[sysid.Record]) -> None:
    fit = sysid.fit_model(lagging, "tpp", outputs=ALL)
    compared = sysid.compare_fit(fit, lagging)
    assert {one.axis for one in compared.bands} == {"roll", "pitch", "longitudinal flapping", "lateral flapping"}
    on = dataset(lagging, fit.band_hz, outputs=ALL)
    parent = candidate(estimate(fit.model.structure, on.viewed(fit.model.structure.inputs), fit.model), (), on)
    whitening = noise_whitening(parent.model, on.stacks, parent.division)
    asked = score_effects(parent, instrumental_step(parent, whitening), whitening, (), lambda _name: None)
    best = min((one for one in asked if one.score is not None), key=lambda one: one.score.log_p)  # type: ignore[union-attr]
    assert best.effects[0] in {"servo_lag", "servo_second_order", "transport_delay"}, "they are late alike in one step"
    refitted = refit(composed_with(parent.model.structure, catalogue()["servo_lag"], on), parent, ("servo_lag",))
    assert refitted.model.structure.outputs == ALL
    assert refitted.error_share < 0.1 * parent.error_share


def test_gains_are_those_of_the_rates_that_the_controller_measures(measured: list[sysid.Record]) -> None:
    fit = sysid.fit_model(measured, "tpp", outputs=ALL)
    bare = sysid.make_model("tpp", fit.model.structure.named(fit.model.values))
    gains, expected = sysid.design_gains(fit.model), sysid.design_gains(bare)
    np.testing.assert_allclose(gains.K, expected.K, rtol=1e-12)
    assert gains.margins == expected.margins


def test_a_base_of_a_user_s_own_with_a_yaw_rate(yawing: Path) -> None:
    fit = sysid.fit_model(turning(), str(yawing))
    near(fit, YAWING)
    assert tuple(fit.nrmse_percent) == ("p", "q", "r")
    assert [warning for warning in fit.warnings if "yaw" in warning] == []
    compared = sysid.compare_fit(fit, turning())
    assert "r" not in compared.controls, "it is what is fitted, not what disturbs"
    coupled = sysid.fit_model(turning(), str(yawing), ["yaw_coupling"])
    assert coupled.model.structure.channels == (), "the effect reads the state, no logged channel"


def test_a_user_s_base_runs_only_where_it_is_named_and_unchanged(yawing: Path, tmp_path: Path) -> None:
    document = json.loads(json.dumps(sysid.fit_model(turning(), str(yawing)).to_json(tmp_path)))
    with pytest.raises(ResultError, match=r"the base file .*yawing\.py, which is code: name it with --with"):
        Fit.from_json(document, tmp_path)
    again = Fit.from_json(document, tmp_path, [str(yawing)])
    assert again.model.structure.outputs == ("p", "q", "r")
    (word,) = document["structure"]["user_base"]
    document["structure"]["user_base"][word] = "0" * 64
    with pytest.raises(ResultError, match="has changed since this fit was made"):
        Fit.from_json(document, tmp_path, [str(yawing)])


def test_an_output_that_is_not_logged_is_said(measured: list[sysid.Record]) -> None:
    short = [sysid.Record(one.id, {k: v for k, v in one.channels.items() if k != "a"}) for one in measured]
    with pytest.raises(FitError, match=r"run0: a is not logged, which TPP with the outputs p, q, a, b needs"):
        sysid.fit_model(short, "tpp", outputs=ALL)
    fit = sysid.fit_model(measured, "tpp", outputs=ALL)
    with pytest.raises(FitError, match="a is not logged"):
        sysid.judge_model(fit.model, short)
