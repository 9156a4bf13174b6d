"""Seconds that one step hardly shows beside an effect that was added: refits tell, in both measures or not at all."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any, cast

import pytest
from strangers.asking import ask
from strangers.flights import fly

from sysid.diagnose import beside_known, diagnose
from sysid.diagnose.beside_known import FORETELLS, chance_beside_known
from sysid.diagnose.candidates import SIGNIFICANT, Ranked
from sysid.diagnose.progress import unheard
from sysid.diagnose.refits import FEW_POINTS, WORTH_THE_TIME
from sysid.diagnose.score import Score

SEED = 4300743
"""A training one's: a drift of 3.1 times what is detectable beside late servos, in gusts."""


@pytest.mark.thorough
@pytest.mark.usefixtures("only_effects")
@pytest.mark.parametrize("only_effects", [("servo_lag", "speed_stability", "angle_of_attack")], indirect=True)
def test_a_drift_that_one_step_hardly_shows_beside_late_servos_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    flight = fly(SEED)
    found = ask(flight)
    assert found.second is not None
    assert (found.first.chain, found.second.chain) == (("servo_lag",), ("speed_stability",))
    monkeypatch.setattr(diagnose, "chance_beside_known", lambda *_: 0.0)
    without = ask(flight).second
    assert without is not None
    assert without.verdict == "complete"


def scored(name: str, chi_squared: float, tried: int = 1) -> Ranked:
    score = Score(effect=name, chi_squared=chi_squared, degrees=1, tried=tried, at={}, errors={})
    return Ranked(effects=(name,), score=score, not_testable=None)


def parent(measured: bool = True, composed: tuple[str, ...] = ("servo_lag",), bent: bool = False) -> Any:
    model = SimpleNamespace(structure=SimpleNamespace(composed=composed, bent=bent))
    return SimpleNamespace(division=SimpleNamespace(measured=measured), model=model, metric="its own", fitted=9)


def test_only_what_is_faint_is_refitted_and_told_where_all_say_so(monkeypatch: pytest.MonkeyPatch) -> None:
    tried: list[str] = []
    foretold, explained = FORETELLS, {"its own": 40.0, "the fit's": 50.0}

    def refitted(one: Ranked, *_: object) -> Ranked:
        tried.append(one.effect)
        return replace(one, fit=cast("Any", SimpleNamespace(metric="the fit's", fitted=10)))

    monkeypatch.setattr(beside_known, "refitted", refitted)
    monkeypatch.setattr(beside_known, "linear_dynamics", lambda structure: not structure.bent)
    monkeypatch.setattr(beside_known, "explained_by", lambda _, __, metric: explained[metric])
    monkeypatch.setattr(beside_known, "foretells_better_by", lambda *_: foretold)
    asked = [scored("gyro_filter", 3.0), scored("structural_mode", 30.0, FEW_POINTS + 1)]
    asked += [scored("quadratic_damping", 30.0), scored("gyro_lag", 12.0)]  # the first takes simulations in time
    assert asked[0].score is not None
    assert asked[0].score.log_p_there > WORTH_THE_TIME

    def chance(of: Any) -> float:
        return chance_beside_known(asked, of, (), unheard)

    assert chance(parent()) < SIGNIFICANT
    assert tried == ["gyro_lag"]
    for nothing in (parent(measured=False), parent(composed=()), parent(bent=True)):
        tried.clear()
        assert (chance(nothing), tried) == (0.0, [])
    explained["the fit's"] = 10.0
    assert chance(parent()) == 0.0, "by its own noise it explains little"
    explained["the fit's"], foretold = 50.0, 0.9 * FORETELLS
    assert chance(parent()) == 0.0, "the commands as flown do not say so"
