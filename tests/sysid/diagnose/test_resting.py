"""Play and dead bands whose scores are faint: a refit tells, and only where it does is anything said to be missing."""

from __future__ import annotations

import math
from dataclasses import replace
from types import ModuleType, SimpleNamespace
from typing import Any, cast

import pytest
from strangers.asking import ask_runs, fitted_runs
from strangers.flights import fly

from sysid.data.record import Record
from sysid.diagnose import diagnose as asking
from sysid.diagnose import resting
from sysid.diagnose.candidates import SIGNIFICANT, Ranked
from sysid.diagnose.progress import unheard
from sysid.diagnose.refits import WORTH_THE_TIME
from sysid.diagnose.resting import chance_of_rest
from sysid.diagnose.score import Score

SEED = 4034426
"""A training one's: a dead band of 0.0089, 1.3 times what is just detectable, in chirps of 9 s."""
CLEAN = 4067053
"""A vehicle that nothing rests in, every second sample of 400 Hz."""
FOLDED = 4094788
"""Another, logged at 50 of 250 Hz, and noise flown with the chirps;"""
WITH_A_TERM = 4094759
"""and at 50 of 400 Hz: products of one command and the other's magnitude showed at log10 p -8.7."""
RESTING = ("servo_deadband", "servo_backlash")


@pytest.mark.usefixtures("only_effects")
@pytest.mark.parametrize("only_effects", [RESTING], indirect=True)
def test_a_dead_band_of_a_faint_score_is_found_by_its_refit(
    fitted_stranger: list[Record], monkeypatch: pytest.MonkeyPatch
) -> None:
    found = ask_runs(fitted_stranger)
    assert (found.verdict, found.effect) == ("missing", "servo_deadband")
    assert found.candidates[0].values["width"] == pytest.approx(0.0089, rel=0.5)
    monkeypatch.setattr(asking, "chance_of_rest", lambda *_: 0.0)
    assert ask_runs(fitted_stranger).verdict == "complete"


def scored(name: str, chi_squared: float) -> Ranked:
    score = Score(effect=name, chi_squared=chi_squared, degrees=1, tried=5, at={}, errors={})
    return Ranked(effects=(name,), score=score, not_testable=None)


def parent(measured: bool = True, error_share: float = 0.01) -> Any:
    return SimpleNamespace(
        division=SimpleNamespace(measured=measured),
        error_share=error_share,
        metric=None,
        dataset=SimpleNamespace(pieces=()),
    )


def test_only_what_is_faint_and_rests_is_refitted_and_told_by_what_it_explains(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    tried: list[str] = []
    explained, left = 40.0, 0.009

    def refitted(one: Ranked, *_: object) -> Ranked:
        tried.append(one.effect)
        return replace(one, fit=cast("Any", SimpleNamespace(error_share=left, metric=None)))

    monkeypatch.setattr(resting, "refitted", refitted)
    monkeypatch.setattr(resting, "explained_by", lambda *_: explained)
    faint, nothing = scored("servo_deadband", 12.0), scored("servo_backlash", 5.0)
    lag = scored("servo_lag", 12.0)
    assert faint.score is not None
    assert faint.score.log_p_there < WORTH_THE_TIME
    assert chance_of_rest([faint, nothing, lag], parent(), (), unheard) < SIGNIFICANT
    assert tried == ["servo_deadband"]
    explained = 20.0  # one in 100,000, of fifty sizes
    assert SIGNIFICANT < chance_of_rest([faint], parent(), (), unheard) < math.log(0.01)
    explained, left = 40.0, 0.00995
    assert chance_of_rest([faint], parent(), (), unheard) == 0.0, "it hardly follows the samples"
    left = 0.009
    assert chance_of_rest([faint], parent(measured=False), (), unheard) == 0.0, "feedback makes powers"
    explained = -3.0
    assert chance_of_rest([faint], parent(), (), unheard) == 0.0


@pytest.mark.usefixtures("only_effects")
@pytest.mark.parametrize("only_effects", [RESTING], indirect=True)
def test_what_hardly_follows_the_samples_of_a_log_that_lost_some_is_chance(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of many widths of a dead band one always fits best: on a clean flight it had chi squared of 46, and 1.2 % of the
    power."""
    runs = fitted_runs(fly(CLEAN))
    assert ask_runs(runs).verdict == "complete"
    monkeypatch.setattr(resting, "LEAST", 0.01)
    assert ask_runs(runs).verdict == "missing"


@pytest.mark.usefixtures("only_effects")
@pytest.mark.parametrize("only_effects", [RESTING], indirect=True)
@pytest.mark.parametrize(
    ("seed", "asks", "otherwise"),
    [
        (FOLDED, resting, "missing"),
        pytest.param(WITH_A_TERM, asking, "unexplained", marks=pytest.mark.thorough),
    ],
)
def test_noise_that_mostly_folded_back_is_neither_rest_nor_a_simple_term(
    seed: int, asks: ModuleType, otherwise: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Logged at 50 of 250 Hz a clean vehicle had chi squared of 43 for a dead band, by all of what its log shows."""
    runs = fitted_runs(fly(seed))
    assert ask_runs(runs).verdict == "complete"
    monkeypatch.setattr(asks, "noise_folded", lambda _: False)
    assert ask_runs(runs).verdict == otherwise
