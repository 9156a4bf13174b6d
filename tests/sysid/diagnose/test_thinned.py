"""Logs far slower than the loop: noise on the excitation moves commands between samples, which is no play."""

from __future__ import annotations

import pytest
from strangers.asking import ask_runs, fitted_runs
from strangers.flights import fly

from sysid.data.dataset import dataset
from sysid.data.preprocess import DEFAULT_BAND_HZ
from sysid.diagnose import score as scoring
from sysid.diagnose.diagnose import diagnose
from sysid.diagnose.evidence import candidate, instrumental_step
from sysid.diagnose.score import Score, score
from sysid.fit.estimate import estimate
from sysid.fit.identify import on_runs
from sysid.model.compose import compose
from sysid.model.effect import catalogue
from sysid.model.paper import TPP

CLEAN = 2763
"""A training seed: a small helicopter that hides nothing, logged at 50 of 400 Hz."""
CLEAN_AT_100_HZ = 8356
"""Another, at 100 of 500 Hz."""
CLEAN_IN_A_STRONG_LOOP = 4095222
"""A judged one's, at 50 of 250 Hz."""
WITH_PLAY = 3345
"""Another, logged at 50 of 250 Hz: play in the linkages, and inflow."""


def scored(seed: int) -> Score:
    flown = fly(seed)
    on = dataset(fitted_runs(flown), DEFAULT_BAND_HZ)
    assert on.stacks[0].thinned_log
    parent = candidate(estimate(TPP, on.viewed(TPP.inputs)), (), on)
    stepped = instrumental_step(parent, parent.metric)
    composed = compose("tpp", ["servo_backlash"], on.available)
    found = score(catalogue()["servo_backlash"], composed, parent, stepped, parent.metric)
    assert found is not None
    return found


@pytest.mark.usefixtures("only_effects")
@pytest.mark.parametrize("only_effects", [("servo_backlash", "servo_deadband")], indirect=True)
@pytest.mark.parametrize("seed", [CLEAN, CLEAN_AT_100_HZ])
def test_commands_between_samples_are_no_play(seed: int) -> None:
    flown = fly(seed)
    runs = fitted_runs(flown)
    found = diagnose(on_runs("tpp", (), runs, runs), runs, band_hz=DEFAULT_BAND_HZ, chains=False)
    assert found.verdict == "complete"
    scores = [one.score for one in found.candidates if one.score is not None]
    assert max(one.chi_squared for one in scores) > 30, "which would be an alarm"


@pytest.mark.usefixtures("only_effects")
@pytest.mark.parametrize("only_effects", [("structural_mode",)], indirect=True)
def test_what_was_between_five_samples_of_a_period_is_no_mode(monkeypatch: pytest.MonkeyPatch) -> None:
    runs = fitted_runs(fly(CLEAN_IN_A_STRONG_LOOP))
    assert ask_runs(runs).verdict == "complete"
    monkeypatch.setattr(scoring, "rows_that_tell_commands", lambda _: None)
    found = ask_runs(runs)
    assert (found.verdict, found.effect) == ("missing", "structural_mode")
    assert found.candidates[0].values["frequency_roll"] * runs[0].t[1] > 1 / 6


def test_play_shows_all_the_same() -> None:
    found = scored(WITH_PLAY)
    assert 200 < found.at_least <= found.chi_squared
