"""What is refitted at all, and in which order: fits, which cost most, are counted without any being made."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from types import SimpleNamespace
from typing import Any, cast

import pytest
from strangers.asking import ask
from strangers.flights import fly

from sysid.diagnose import candidates, refits
from sysid.diagnose.candidates import Ranked
from sysid.diagnose.progress import Asking, Listener, unheard
from sysid.diagnose.refits import refit_serious
from sysid.diagnose.score import Score
from sysid.model.effect import catalogue

LATE_MOTORS_UNDER_A_LOOP = 4054518
"""A quadrotor whose motors lag by 29 ms, in gusts of 3.8 times the usual; every fourth sample is logged."""


@dataclass(frozen=True)
class Left:
    """As much of a candidate as the order of refits reads."""

    error_share: float
    nrmse_percent: None = None
    metric: None = None
    stepped: None = None

    def asked_in(self, _: object) -> Left:
        return self


def scored(effect: str, chi_squared: float) -> Ranked:
    score = Score(effect=effect, chi_squared=chi_squared, degrees=1, tried=1, at={}, errors={})
    return Ranked(effects=(effect,), score=score, not_testable=None)


def order(
    monkeypatch: pytest.MonkeyPatch, asked: Sequence[Ranked], enough: str | None, say: Listener = unheard
) -> list[str]:
    """Effects in the order in which they were refitted, where `enough` leaves noise."""
    made: list[str] = []

    def refitted(one: Ranked, *_: Any) -> Ranked:
        made.append(one.effect)
        return replace(one, fit=cast("Any", Left(0.1 if one.effect == enough else 0.5)))

    monkeypatch.setattr(refits, "refitted", refitted)
    monkeypatch.setattr(refits._Order, "level", lambda _: None)
    monkeypatch.setattr(refits, "_leaves_more", lambda best, _: best.error_share > 0.2)
    monkeypatch.setattr(refits, "_avoidable", lambda *_: 1.0)
    monkeypatch.setattr(candidates, "instrumental_step", lambda *_: None)
    monkeypatch.setattr(candidates, "gain", lambda *_: (1000.0, 0.0))
    refit_serious(asked, cast("Any", Left(1.0)), (), say)
    return made


ASKED = [scored("hub_gyroscopics", 350.0), scored("servo_lag", 900.0), scored("gyro_lag", 1000.0)]
SLOW = [scored("quadratic_damping", 350.0), scored("servo_backlash", 800.0)]


def test_the_most_promising_first_and_all_while_the_question_is_open(monkeypatch: pytest.MonkeyPatch) -> None:
    names = order(monkeypatch, [*ASKED, *SLOW], None)
    assert names == ["gyro_lag", "servo_lag", "hub_gyroscopics", "servo_backlash", "quadratic_damping"]


def test_beside_one_that_leaves_noise_nothing_slow_that_could_not_be_as_good(monkeypatch: pytest.MonkeyPatch) -> None:
    names = order(monkeypatch, [*ASKED, *SLOW], "gyro_lag")
    assert names == ["gyro_lag", "servo_lag", "hub_gyroscopics", "servo_backlash"]
    assert order(monkeypatch, SLOW, "servo_backlash") == ["servo_backlash", "quadratic_damping"]


@pytest.mark.parametrize("enough", [None, "gyro_lag"])
def test_what_scores_far_below_the_best_is_not_refitted(enough: str | None, monkeypatch: pytest.MonkeyPatch) -> None:
    little = [scored("hub_gyroscopics", 90.0), scored("servo_deadband", 250.0), scored("quadratic_damping", 250.0)]
    more = [scored("gyro_lag", 1000.0), scored("servo_lag", 150.0)]
    assert order(monkeypatch, [*little, *more], enough) == ["gyro_lag", "servo_lag"]


def test_a_refit_that_fails_leaves_none_of_an_earlier_one(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(refits, "composed_with", lambda *_: SimpleNamespace(composed=()))
    monkeypatch.setattr(refits, "refit_or_reason", lambda *_: (None, "the response does not settle"))
    monkeypatch.setattr(refits, "as_scored", lambda *_: None)
    monkeypatch.setattr(refits, "goes_by_its_score", lambda *_: False)
    before = replace(scored("servo_lag", 900.0), fit=cast("Any", Left(0.1)))
    parent = SimpleNamespace(model=SimpleNamespace(structure=None), dataset=None, metric=None)
    after = refits.refitted(before, cast("Any", parent), ())
    assert (after.fit, after.not_testable) == (None, "the response does not settle")


def test_entries_of_the_same_equations_name_each_other() -> None:
    known = catalogue()
    for name, effect in known.items():
        assert all(name in known[other].same_as for other in effect.same_as), name


def test_beside_the_best_on_samples_all_else_that_acts_on_them_is_refitted(monkeypatch: pytest.MonkeyPatch) -> None:
    """A score goes by a few sizes: between two of them a dead band explained more than a play."""
    little = [scored("quadratic_damping", 90.0), scored("servo_deadband", 90.0)]
    heard: list[object] = []
    names = order(monkeypatch, [*little, scored("servo_backlash", 1000.0)], None, heard.append)
    assert names == ["servo_backlash", "servo_deadband"]
    assert [(one.number, one.of) for one in heard if isinstance(one, Asking)] == [(1, 1), (2, 2)]
    assert order(monkeypatch, [*little, scored("gyro_lag", 1000.0)], None) == ["gyro_lag"]
    by_chance = [scored("servo_deadband", 1.0), scored("servo_backlash", 1000.0)]
    assert order(monkeypatch, by_chance, None) == ["servo_backlash"]


@pytest.mark.thorough
def test_a_lag_goes_on_to_what_its_score_promises(monkeypatch: pytest.MonkeyPatch) -> None:
    """By power it ended at 1 ms, for two poles less than a filter explained; its score said 18 ms, and so much more."""
    flown = fly(LATE_MOTORS_UNDER_A_LOOP)
    found = ask(flown).first
    assert (found.verdict, found.effect) == ("missing", "motor_lag")
    assert found.winner is not None
    assert found.winner.values["tau_m"] == pytest.approx(flown.hidden.sizes[0]["tau_m"], rel=0.15)
    monkeypatch.setattr(refits, "NEARLY_KEPT", 0.5)
    assert ask(flown).first.effect != "motor_lag"
