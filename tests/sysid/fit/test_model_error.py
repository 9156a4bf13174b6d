"""Errors of the model, beside those of statistics, against shifts, vehicles and values not made by the package."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from planted import Run, fly
from planted_fits import records
from scipy.ndimage import shift

from gcs.analysis.text.fit import fit_text
from gcs.logs import resolve_runs
from sysid.fit.identify import identify
from sysid.fit.model_error import with_model_errors
from sysid.fit.result import Fit
from sysid.model.paper import TPP

DT = 0.002
CLOCKS_S = DT / np.sqrt(6)
"""Standard deviation of what two clocks are off, each anywhere within half a sample."""


@pytest.fixture(scope="module")
def flight() -> list[Run]:
    return fly(None, {}, seed=41, duration_s=10.0)


@pytest.fixture(scope="module")
def fit(flight: list[Run]) -> Fit:
    runs = records(flight)
    return with_model_errors(identify(TPP, runs), runs)


def later(flight: list[Run], off_s: float) -> list[Run]:
    """The same with its rates stamped late."""
    moved = {name: [shift(run[name], off_s / DT, order=3, mode="nearest") for run in flight] for name in ("p", "q")}
    return [{**run, "p": p, "q": q} for run, p, q in zip(flight, moved["p"], moved["q"], strict=True)]


def test_clocks_move_values_as_a_fit_to_shifted_rates_says(flight: list[Run], fit: Fit) -> None:
    off_s = 0.3 * CLOCKS_S
    moved = np.abs(identify(TPP, records(later(flight, off_s))).model.values - fit.model.values)
    clocks = np.array([fit.model_errors[name].clocks for name in TPP.names])
    assert np.allclose(moved / 0.3, clocks, atol=0.15 * np.max(clocks / fit.standard_errors) * fit.standard_errors)


def test_an_exact_vehicle_has_no_other_model_error_than_that_of_clocks(fit: Fit) -> None:
    others = [np.hypot(fit.model_errors[name].frequencies, fit.model_errors[name].runs) for name in TPP.names]
    assert np.median(others / fit.standard_errors) < 2
    assert all(fit.model_errors[name].validation == 0 for name in TPP.names)


def test_runs_of_vehicles_that_differ_disagree(flight: list[Run], fit: Fit) -> None:
    stronger = [{**run, "delta_y": 0.9 * run["delta_y"]} if number > 1 else run for number, run in enumerate(flight)]
    runs = records(stronger)
    other = with_model_errors(identify(TPP, runs), runs)
    place = TPP.names.index("A_lon")
    assert other.model_errors["A_lon"].runs > 5 * fit.model_errors["A_lon"].runs
    assert other.model_errors["A_lon"].runs > 5 * other.standard_errors[place]


def test_validation_runs_of_another_vehicle_widen_the_bounds(flight: list[Run]) -> None:
    runs = records(flight[:2])
    weaker = records([{**run, "delta_x": 0.9 * run["delta_x"], "delta_y": 0.9 * run["delta_y"]} for run in flight[2:]])
    fit = identify(TPP, runs)
    judged = with_model_errors(fit, runs, weaker).model_errors["B_lat"]
    assert judged.validation > 0.02 * fit.model["B_lat"]
    assert with_model_errors(fit, runs, records(flight[2:])).model_errors["B_lat"].validation < 0.5 * judged.validation


def test_it_is_kept_with_the_fit_and_shown_apart(fit: Fit, tmp_path: Path) -> None:
    document = json.loads(json.dumps(fit.to_json(tmp_path)))
    one = document["parameters"]["M_a"]
    assert one["model_error"] == pytest.approx(fit.model_errors["M_a"].total)
    assert set(one["model_error_by"]) == {"clocks", "frequencies", "runs", "validation"}
    assert one["standard_error"] == pytest.approx(fit.standard_errors[1])
    assert Fit.from_json(document, tmp_path).model_errors == fit.model_errors
    text = fit_text(fit, ())
    assert f"± {fit.standard_errors[1]:.2g} (± {fit.model_errors['M_a'].total:.2g})" in text
    assert max(map(len, text.splitlines())) <= 78


def test_a_helicopter_flown_by_strangers_lies_inside_two_full_bounds(shared_data: Path) -> None:
    logs = [shared_data / "ardupilot" / f"heli_{axis}_sweep.BIN" for axis in ("roll", "pitch")]
    runs = resolve_runs([str(log) for log in logs])
    fit = with_model_errors(identify(TPP, runs, band_hz=(0.5, 10.0), effects=["transport_delay"]), runs)
    truth = {"T_d": 0.050, "tau_f": 0.068232, "L_b": 3588.6, "M_a": 617.5, "A_b": -1.3402, "B_a": 1.2963}
    errors = dict(zip(fit.model.structure.names, fit.standard_errors, strict=True))
    off = {
        name: abs(fit.model[name] - value) / np.hypot(errors[name], fit.model_errors[name].total)
        for name, value in truth.items()
    }
    assert max(off.values()) < 2
    assert fit.model_errors["T_d"].clocks == pytest.approx(0.0025 / np.sqrt(6), rel=0.01)
