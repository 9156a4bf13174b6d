"""Searches of chains that would end with much left: what promises nearly all is looked for yet."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any, cast

import pytest
from strangers.asking import ask_runs, fitted_runs
from strangers.flights import fly

from sysid.diagnose import chains, exchanged_halves
from sysid.diagnose.candidates import Ranked
from sysid.diagnose.chains import _Chains
from sysid.diagnose.fitted_chains import KEPT_BACK
from sysid.diagnose.score import Score
from sysid.diagnose.unsearched import MuchLeft

BESIDE_INFLOW = 4320655
"""A training one's: a dead band that alone explains nothing, beside an inflow that explains half of a drift."""


def scored(name: str, chi_squared: float) -> Ranked:
    score = Score(effect=name, chi_squared=chi_squared, degrees=1, tried=1, at={}, errors={})
    return Ranked(effects=(name,), score=score, not_testable=None)


def fitted(effects: tuple[str, ...], chi_squared: float) -> Ranked:
    one = SimpleNamespace(
        effects=effects, effect=effects[0], chi_squared=chi_squared, delta_bic=-chi_squared, implausible=(), fit=True
    )
    return cast("Ranked", one)


def search_with(**methods: Any) -> _Chains:
    search = object.__new__(_Chains)
    for name, value in methods.items():
        setattr(search, name, value)
    return search


@pytest.mark.parametrize(("scores", "found"), [((60.0, 75.0), ["lead_lag"]), ((71.0, 95.0), ["lead_lag", "governor"])])
def test_what_promises_nearly_all_with_the_best_beside_it_is_begun_with(
    scores: tuple[float, float], found: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    one, other = fitted(("governor",), 20.0), fitted(("lead_lag",), 20.0)
    asked = {"governor": [scored("servo_lag", scores[0])], "lead_lag": [scored("servo_lag", scores[1])]}
    monkeypatch.setattr(chains, "misfit", lambda _: 30.0)
    best = fitted(("stabiliser_bar", "servo_lag"), 70.0)
    search = search_with(found={best.effects: best}, ask_beside=lambda one: asked[one.effect])
    assert [one.effect for one in search.promising_nearly_all([one, other])] == found


@pytest.mark.thorough
@pytest.mark.usefixtures("only_effects")
@pytest.mark.parametrize(
    "only_effects",
    [("speed_stability", "dynamic_inflow", "servo_deadband", "servo_backlash", "attitude_stiffness")],
    indirect=True,
)
def test_a_dead_band_is_found_beside_an_inflow_though_a_drift_explains_more_alone(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    runs = fitted_runs(fly(BESIDE_INFLOW))
    found = ask_runs(runs, chains=True)
    assert (found.verdict, set(found.chain)) == ("missing", {"dynamic_inflow", "servo_deadband"})
    assert found.winner is not None
    assert found.winner.values["width"] == pytest.approx(0.0258, rel=0.05)
    monkeypatch.setattr(chains, "NEARLY_ALL", float("inf"))
    without = ask_runs(runs, chains=True)
    assert without.verdict == "unexplained"
    assert isinstance(without.unsearched, MuchLeft)


def test_for_what_a_half_contains_some_of_the_budget_is_kept_back(monkeypatch: pytest.MonkeyPatch) -> None:
    """Beside play a lag of each axis had two that were the same, and the budget was spent before that of all."""
    asked: list[tuple[str, str]] = []
    lag, play = fitted(("gyro_lag",), 90.0), fitted(("servo_backlash",), 80.0)
    chain = fitted(("lag_per_axis", "servo_backlash"), 170.0)
    monkeypatch.setattr(exchanged_halves, "rank", lambda _: 0)
    search: _Chains = search_with(
        found={chain.effects: chain},
        single={"gyro_lag": lag, "servo_backlash": play},
        left=0.0,
        kept_back=KEPT_BACK,
        price_of=lambda *_: 20.0,
        fit=lambda one, other, exchanged: asked.append((one.effect, other.effect)) if search.paid(20.0) else None,
    )
    search.exchange_larger()
    assert asked == [("gyro_lag", "servo_backlash")]
    assert search.left == KEPT_BACK - 20.0
    assert search.kept_back == 0.0
