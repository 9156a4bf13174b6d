"""Slow gusts: least squares takes some of them for a quadrotor's answers; where they are weak its numbers are off by
more than the noise."""

from __future__ import annotations

import pytest
from strangers.asking import fitted_runs
from strangers.flights import Stranger, fly

from sysid.data.record import Record
from sysid.diagnose.diagnose import diagnose
from sysid.diagnose.score import log_chance
from sysid.fit import estimate
from sysid.fit.identify import identify, on_runs
from sysid.fit.noise import divide

SEED = 2069
"""A training one: motors of 89 ms, 39 s chirps, slow gusts of 2.3 times the usual size."""
CLEAN_SEED = 3144
"""One of a small helicopter that hides nothing: 13.8 s chirps, a strong loop, slow gusts."""


def test_the_excitation_decides_where_least_squares_leaves_less(
    flown: Stranger, runs: list[Record], monkeypatch: pytest.MonkeyPatch
) -> None:
    truth = flown.plan.vehicle.table
    fit = identify(on_runs("cd", (), runs, runs), runs, effects=["motor_lag"])
    assert fit.instrument == "excitation logged"
    assert fit.model["tau_m"] == pytest.approx(flown.hidden.sizes[0]["tau_m"], rel=0.1)
    assert fit.model["L_lat"] == pytest.approx(truth["L_lat"], rel=0.05)
    assert fit.model["M_lon"] == pytest.approx(truth["M_lon"], rel=0.05)
    monkeypatch.setattr(estimate, "_asks_less", lambda *_: False)
    foretold = identify(on_runs("cd", (), runs, runs), runs, effects=["motor_lag"])
    assert foretold.instrument == "prediction error"  # which knows no excitation, and gets there all the same
    assert foretold.model["tau_m"] == pytest.approx(flown.hidden.sizes[0]["tau_m"], rel=0.03)
    assert foretold.model["L_p"] == pytest.approx(truth["L_p"], abs=0.3)
    monkeypatch.setattr("sysid.fit.identify.prediction_error", lambda *_: None)
    before = identify(on_runs("cd", (), runs, runs), runs, effects=["motor_lag"])
    assert before.instrument == "commands"
    assert before.nrmse_percent["p"] > fit.nrmse_percent["p"]


@pytest.mark.thorough
@pytest.mark.usefixtures("only_effects")
@pytest.mark.parametrize("only_effects", [("motor_lag", "servo_rate_limit", "structural_mode")], indirect=True)
def test_what_is_missing_is_told_by_the_noise(runs: list[Record]) -> None:
    found = diagnose(on_runs("cd", (), runs, runs), runs, chains=False)
    assert (found.verdict, found.effect) == ("missing", "motor_lag")
    assert found.winner is not None
    assert found.winner.fit is not None
    assert found.winner.fit.error_share > found.parent.error_share
    assert found.explained_share is not None
    assert found.explained_share > 0.9


@pytest.mark.usefixtures("only_effects")
@pytest.mark.parametrize("only_effects", [("servo_lag",)], indirect=True)
def test_where_noise_is_weak_numbers_by_strong_noise_are_no_error_of_the_structure() -> None:
    flown = fly(CLEAN_SEED)
    runs = fitted_runs(flown)
    found = diagnose(on_runs("tpp", (), runs, runs), runs, chains=False)
    assert found.verdict == "complete"
    parent = found.parent
    as_fitted = divide(parent.estimate.error, parent.dataset.stacks, parent.dataset.causes)
    assert log_chance(as_fitted.chi_squared, as_fitted.degrees) < -30, "which would be an alarm"
    assert found.division.chi_squared < found.division.degrees + 4 * (2 * found.division.degrees) ** 0.5
