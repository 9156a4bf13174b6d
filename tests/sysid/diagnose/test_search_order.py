"""What is refitted at all, and in which order: fits, which cost most, are counted without any being made."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, cast

import pytest

from sysid.diagnose import candidates, chains
from sysid.diagnose.candidates import Ranked, refit_serious, silent
from sysid.diagnose.chains import _Chains
from sysid.diagnose.score import Score


@dataclass(frozen=True)
class Left:
    """As much of a candidate as the order of refits reads."""

    error_share: float


def scored(effect: str, chi_squared: float) -> Ranked:
    score = Score(effect=effect, chi_squared=chi_squared, degrees=1, tried=1, at={}, errors={})
    return Ranked(effects=(effect,), score=score, not_testable=None)


def refits(monkeypatch: pytest.MonkeyPatch, asked: Sequence[Ranked], enough: str | None) -> list[str]:
    """Effects in the order in which they were refitted, where `enough` leaves noise."""
    made: list[str] = []

    def refitted(one: Ranked, *_: Any) -> Ranked:
        made.append(one.effect)
        return replace(one, fit=cast("Any", Left(0.1 if one.effect == enough else 0.5)))

    monkeypatch.setattr(candidates, "refitted", refitted)
    monkeypatch.setattr(candidates, "_leaves_more", lambda best, _: best.error_share > 0.2)
    monkeypatch.setattr(candidates, "noise_whitening", lambda *_: None)
    monkeypatch.setattr(candidates, "instrumental_step", lambda *_: None)
    monkeypatch.setattr(candidates, "gain", lambda *_: (1000.0, 0.0))
    parent: Any = type("Parent", (), {"error_share": 1.0, "dataset": type("On", (), {"stacks": ()})})()
    monkeypatch.setattr(Left, "model", None, raising=False)
    monkeypatch.setattr(Left, "division", None, raising=False)
    refit_serious(asked, parent, (), silent)
    return made


ASKED = [scored("hub_gyroscopics", 150.0), scored("servo_lag", 900.0), scored("gyro_lag", 1000.0)]
SLOW = [scored("quadratic_damping", 250.0), scored("servo_backlash", 800.0)]


def test_the_most_promising_first_and_all_while_the_question_is_open(monkeypatch: pytest.MonkeyPatch) -> None:
    names = refits(monkeypatch, [*ASKED, *SLOW], None)
    assert names == ["gyro_lag", "servo_lag", "hub_gyroscopics", "servo_backlash", "quadratic_damping"]


def test_beside_one_that_leaves_noise_only_what_could_be_as_good(monkeypatch: pytest.MonkeyPatch) -> None:
    assert refits(monkeypatch, [*ASKED, *SLOW], "gyro_lag") == ["gyro_lag", "servo_lag", "servo_backlash"]
    assert refits(monkeypatch, SLOW, "servo_backlash") == ["servo_backlash", "quadratic_damping"]


def test_a_chain_is_not_begun_from_its_other_end_where_that_promised_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    limit, lag, twin = scored("servo_rate_limit", 500.0), scored("servo_lag", 900.0), scored("gyro_lag", 880.0)
    search = _Chains([], cast("Any", None), silent, None)
    search.begun = [(lag, {"servo_rate_limit": scored("servo_rate_limit", 1.0)})]
    assert search.asked_from_behind(limit, lag)
    assert not search.asked_from_behind(limit, twin)
    monkeypatch.setattr(chains, "_apart", lambda *_: False)
    search.alone = {"servo_lag": lag, "gyro_lag": twin}
    assert search.asked_from_behind(limit, twin)
    search.begun = [(lag, {"servo_rate_limit": scored("servo_rate_limit", 400.0)})]
    assert not search.asked_from_behind(limit, lag)
