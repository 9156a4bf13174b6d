"""Refits that begin where the score found an effect, where growing from the parent ends in another valley."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from strangers.asking import ask_runs, fitted_runs
from strangers.flights import Stranger, as_planned, fly, planned
from strangers.hiding import Hidden

from sysid.data.dataset import dataset
from sysid.diagnose import growing_modes, refits, verdict
from sysid.diagnose.candidates import Ranked
from sysid.diagnose.choice import larger_first
from sysid.diagnose.evidence import _steps, candidate
from sysid.diagnose.plausible import out_of_reach
from sysid.diagnose.score import Score
from sysid.fit.estimate import estimate
from sysid.model.base import bases
from sysid.model.compose import compose
from sysid.model.effect import catalogue
from sysid.model.structure import Model

SEED = 2041
LIMITED = 4160303
"""Of a judgement: rates limited to 5.3 1/s beside a damping, every fifth command of the loop logged; a limit of
acceleration and a lead-lag explained three quarters of what the limit does."""
MODES = {
    "frequency_roll": 5.877,
    "zeta_roll": 0.0358,
    "kappa_roll": 0.01035,
    "frequency_pitch": 11.585,
    "zeta_pitch": 0.0620,
    "kappa_pitch": 0.00931,
}
"""A training one's: a mode of 5.9 Hz in roll with one share in a hundred of the inertia, far less than the gusts. Least
squares by constant weights lose it; with 4 % more they do not."""


@pytest.fixture(scope="module")
def flown() -> Stranger:
    return as_planned(planned(SEED), Hidden(("structural_mode",), (MODES,)))


@pytest.mark.thorough
@pytest.mark.usefixtures("only_effects")
@pytest.mark.parametrize("only_effects", [("structural_mode", "angular_damping")], indirect=True)
def test_a_mode_below_the_gusts_is_found_where_its_score_is(flown: Stranger, monkeypatch: pytest.MonkeyPatch) -> None:
    runs = fitted_runs(flown)
    found = ask_runs(runs)
    assert (found.verdict, found.effect) == ("missing", "structural_mode")
    assert found.winner is not None
    frequency_hz = flown.hidden.sizes[0]["frequency_roll"]
    assert found.winner.values["frequency_roll"] == pytest.approx(frequency_hz, rel=0.01)
    monkeypatch.setattr(refits, "as_scored", lambda *_: None)
    assert ask_runs(runs).verdict == "unexplained"


@pytest.mark.usefixtures("only_effects")
@pytest.mark.parametrize("only_effects", [("dynamic_inflow", "servo_lag")], indirect=True)
def test_a_refit_that_leaves_more_than_the_parent_begins_again() -> None:
    """Of an inflow in a log of every fourth sample; a lag explains it as little as a step to below zero would."""
    strange = fly(5113)
    runs = fitted_runs(strange)
    found = ask_runs(runs)
    assert (found.verdict, found.effect) == ("missing", "dynamic_inflow")
    assert found.winner is not None
    assert found.winner.fit is not None
    assert found.winner.fit.error_share < found.parent.error_share
    lag = next(one for one in found.candidates if one.effect == "servo_lag")
    assert lag.chi_squared < 1


def test_of_two_the_larger_is_named_though_one_has_no_fit_of_its_own() -> None:
    def scored(effect: str, chi_squared: float) -> Ranked:
        score = Score(effect=effect, chi_squared=chi_squared, degrees=1, tried=1, at={}, errors={})
        return Ranked(effects=(effect,), score=score, not_testable=None)

    alone = [scored("angular_damping", 10.0), scored("structural_mode", 400.0)]
    both = Ranked(effects=("angular_damping", "structural_mode"), score=None, not_testable=None)
    assert larger_first(both, alone) == ("structural_mode", "angular_damping")


@pytest.mark.thorough
@pytest.mark.usefixtures("only_effects")
@pytest.mark.parametrize("only_effects", [("speed_stability", "servo_lag")], indirect=True)
def test_below_the_sweeps_a_loop_is_asked_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    """A clean flight without a logged excitation: where nobody tells what was swept, a slow effect would explain its
    gusts by a mode that grows, which has its cost."""
    strange = fly(3052)
    runs = fitted_runs(strange)
    assert ask_runs(runs).verdict == "complete"
    untold = [replace(one, swept_band_hz=None) for one in runs]
    found = ask_runs(untold)
    assert (found.verdict, found.reason, found.chain) == ("unexplained", "feedback", ())
    monkeypatch.setattr(growing_modes, "cost", lambda *_: 0.0)
    free = ask_runs(untold)
    assert (free.verdict, free.reason, free.chain) == ("unexplained", "feedback", ("speed_stability",))
    assert free.winner is not None
    assert free.winner.outside
    monkeypatch.setattr(verdict, "A_LOOP_MAKES", 0.0)
    assert ask_runs(untold).verdict == "missing"


@pytest.mark.thorough
@pytest.mark.usefixtures("only_effects")
@pytest.mark.parametrize("only_effects", [("dynamic_inflow", "slipstream_wing")], indirect=True)
def test_values_that_feedback_led_astray_are_looked_for_anew(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of an inflow in slow gusts, no excitation logged: least squares ends at a bound."""
    strange = fly(6013)
    runs = fitted_runs(strange)
    found = ask_runs(runs)
    assert (found.verdict, found.effect) == ("missing", "dynamic_inflow")
    assert found.winner is not None
    assert not found.winner.outside
    monkeypatch.setattr(refits, "predicting", lambda fit, _: fit)
    again = next(one for one in ask_runs(runs).candidates if one.effect == "dynamic_inflow")
    assert again.fit is not None
    assert again.fit.estimate.at_bound, "where its other values count as free, too"
    assert again.outside


@pytest.mark.usefixtures("only_effects")
@pytest.mark.parametrize("only_effects", [("angular_damping", "hub_gyroscopics", "angle_of_attack")], indirect=True)
def test_what_powers_do_not_tell_in_a_loop_is_no_doubt() -> None:
    """Damping on top of what a strong loop makes of gusts: little of the power, and all that the commands foretell."""
    strange = fly(6049)
    found = ask_runs(fitted_runs(strange))
    assert (found.verdict, found.effect) == ("missing", "angular_damping")
    assert found.explained_share is not None
    assert found.explained_share < 0.2


def test_values_that_each_may_be_plausible_may_not_be_so_together() -> None:
    strange = fly(6049)
    runs = fitted_runs(strange)
    on = dataset(runs, (0.25, 6.0))
    structure = compose(bases()["tpp"], [catalogue()["angular_damping"]], on.available)
    fit = candidate(estimate(structure, on.viewed(structure.inputs), None, {}, "constant"), (), on)
    places = [structure.names.index(name) for name in ("L_p", "M_q")]
    values, covariance = fit.model.values.copy(), np.zeros_like(fit.estimate.covariance)
    high = [one.plausible[1] for one in structure.parameters if one.name in ("L_p", "M_q")]
    values[places] = np.array(high) + 1.8

    def together(correlation: float) -> bool:
        covariance[np.ix_(places, places)] = [[1.0, correlation], [correlation, 1.0]]
        there = replace(fit.estimate, model=Model(structure, values), covariance=covariance)
        return out_of_reach(replace(fit, estimate=there), ("L_p", "M_q"))

    assert not together(0.9)
    assert together(-0.9)
    assert not out_of_reach(fit, ())


def test_rows_beyond_all_numbers_move_nothing_and_lapack_says_nothing_of_them() -> None:
    assert list(_steps(np.full((2, 3), 1e200), np.ones(3))) == []
    assert len(list(_steps(np.eye(2, 3), np.ones(3)))) == 2


@pytest.mark.usefixtures("only_effects")
@pytest.mark.parametrize(
    "only_effects", [("servo_rate_limit", "servo_acceleration_limit", "lead_lag", "servo_backlash")], indirect=True
)
def test_beside_a_limit_that_explains_much_the_other_is_fitted(monkeypatch: pytest.MonkeyPatch) -> None:
    runs = fitted_runs(fly(LIMITED))
    found = ask_runs(runs)
    assert found.winner is not None
    assert found.winner.effect == "servo_rate_limit"
    assert found.winner.values["rate"] == pytest.approx(5.28, rel=0.03)
    play = next(one for one in found.candidates if one.effect == "servo_backlash")
    monkeypatch.setattr(refits, "LIMITS", ())
    without = next(one for one in ask_runs(runs).candidates if one.effect == "servo_rate_limit")
    assert (without.fit, play.fit) == (None, None)
