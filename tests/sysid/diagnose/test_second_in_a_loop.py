"""A second effect that is surely there by likelihood, in a loop whose excitation is not logged, where powers show
crumbs at most."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any, cast

import pytest
from strangers.asking import ask_runs, fitted_runs
from strangers.flights import fly

from sysid.diagnose import chains, choice, verdict
from sysid.diagnose.candidates import Ranked
from sysid.diagnose.chains import LEFT_BESIDE, SURELY_BESIDE, _Chains
from sysid.diagnose.choice import SURELY_BOTH, both_surely
from sysid.diagnose.score import Score
from sysid.diagnose.unsearched import BudgetSpent, LittleLeft


def fit(measured: bool) -> Any:
    return cast("Any", SimpleNamespace(division=SimpleNamespace(measured=measured), model=SimpleNamespace(structure=0)))


def told(*effects: str, chi_squared: float, measured: bool = False) -> Ranked:
    """Of no parameters that cost anything."""
    return Ranked(effects=effects, score=None, not_testable=None, fit=fit(measured), chi_squared=chi_squared)


def test_a_chain_is_surely_there_by_likelihood_in_a_loop_alone() -> None:
    one = told("slipstream_wing", chi_squared=900.0)
    both = told("slipstream_wing", "servo_lag", chi_squared=901.0 + SURELY_BOTH)
    assert both_surely(both, one)
    assert not both_surely(replace(both, chi_squared=899.0 + SURELY_BOTH), one)
    assert not both_surely(replace(both, fit=fit(measured=True)), one), "powers tell there"
    assert not both_surely(replace(both, outside=("tau_w",)), one), "what is doubtful only resembles"
    much = 900.0 * SURELY_BOTH
    assert not both_surely(replace(both, chi_squared=much + 2 * SURELY_BOTH), replace(one, chi_squared=much)), "hardly"


@pytest.mark.parametrize(
    ("scores", "measured", "linear", "left", "fitted"),
    [
        ((SURELY_BESIDE + 1, SURELY_BESIDE - 1), False, True, LEFT_BESIDE, ["servo_backlash"]),
        ((SURELY_BESIDE - 1, 0.0), False, True, LEFT_BESIDE, []),
        ((SURELY_BESIDE + 1, 0.0), True, True, LEFT_BESIDE, []),
        ((SURELY_BESIDE + 1, 0.0), False, False, LEFT_BESIDE, []),
        ((SURELY_BESIDE + 1, 0.0), False, True, LEFT_BESIDE - 1, []),
    ],
)
def test_it_is_looked_for_where_its_score_is_sure(
    scores: tuple[float, ...],
    measured: bool,
    linear: bool,
    left: float,
    fitted: list[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    named = told("slipstream_wing", chi_squared=900.0, measured=measured)
    asked = [
        Ranked(
            effects=(name,),
            score=Score(effect=name, chi_squared=chi_squared, degrees=1, tried=1, at={}, errors={}),
            not_testable=None,
        )
        for name, chi_squared in zip(("servo_backlash", "servo_lag"), scores, strict=True)
    ]
    tried: list[str] = []

    def fit_beside(search: _Chains, first: Ranked, second: Ranked) -> None:
        tried.append(second.effect)
        search.found[first.effect, second.effect] = told(
            first.effect, second.effect, chi_squared=900.0 + 2 * SURELY_BOTH
        )

    monkeypatch.setattr(chains, "on_samples_beside", lambda *_: [])  # where an excitation is logged
    monkeypatch.setattr(chains, "linear_dynamics", lambda _: linear)
    monkeypatch.setattr(chains, "misfit", lambda _: left)
    monkeypatch.setattr(_Chains, "ask_beside", lambda *_: asked)
    monkeypatch.setattr(_Chains, "able_beside", lambda _, __, seconds: list(seconds))
    monkeypatch.setattr(_Chains, "fit", fit_beside)
    monkeypatch.setattr(_Chains, "improve", lambda _: None)
    search = _Chains([named], cast("Any", None), lambda _: None, None, answered=True)
    assert search.surely_beside(named) == bool(fitted)
    assert tried == fitted


@pytest.mark.parametrize(("interrupted", "surely"), [(False, True), (False, False), (True, False)])
def test_of_what_is_not_surely_there_nothing_is_told_but_that_it_was_interrupted(
    interrupted: bool, surely: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    named = told("slipstream_wing", chi_squared=900.0)
    both = told("slipstream_wing", "servo_lag", chi_squared=950.0)

    def surely_beside(search: _Chains, _: Ranked) -> bool:
        search.found["servo_lag", "slipstream_wing"] = both
        if interrupted:
            search.interrupt()
        return surely

    crumbs = chains.ChainSearch(unsearched=LittleLeft(0.05))
    monkeypatch.setattr(chains, "_of_little", lambda *_: crumbs)
    monkeypatch.setattr(_Chains, "surely_beside", surely_beside)
    found = chains.chains_of_two([named], cast("Any", None), lambda _: None, named=named)
    assert found.pairs == ((both,) if surely else ())
    if interrupted:
        assert isinstance(found.unsearched, BudgetSpent)
        assert found.unsearched.interrupted
    else:
        assert found.unsearched == (None if surely else crumbs.unsearched)


@pytest.mark.thorough
@pytest.mark.usefixtures("only_effects")
@pytest.mark.parametrize("only_effects", [("servo_lag", "lag_per_axis", "slipstream_wing")], indirect=True)
def test_two_are_named_where_one_leaves_crumbs_by_power(monkeypatch: pytest.MonkeyPatch) -> None:
    """A training stranger: a wing beside a lag, of which a lag of its own on each axis left nothing that power shows,
    and 68 of 3,100 by likelihood."""
    flown = fly(4046125)
    runs = fitted_runs(flown)
    found = ask_runs(runs, chains=True)
    assert (found.verdict, set(found.chain)) == ("missing", {"servo_lag", "slipstream_wing"})
    monkeypatch.setattr(choice, "SURELY_BOTH", 1e6)
    assert ask_runs(runs, chains=True).chain == ("lag_per_axis",)


@pytest.mark.parametrize(
    ("measured", "doubtful", "alone", "named"),
    [
        (False, True, "missing", True),
        (False, True, "unexplained", False),
        (False, False, "missing", False),
        (True, True, "missing", False),
    ],
)
def test_a_single_name_stays_in_a_loop_where_the_likelier_chain_is_not_sure_enough(
    measured: bool, doubtful: bool, alone: str, named: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """An inflow at 0.90, and beside it any of three kinds of lateness: at 0.30 the two were none to name."""
    chain = verdict._Answer(verdict="unexplained", chain=("dynamic_inflow", "gyro_lag"), confidence=0.85)
    single = verdict._Answer(verdict=alone, chain=("dynamic_inflow",), confidence=0.9)
    chain = replace(chain, doubtful=doubtful)

    def by(winner: object, *_: object, chance: float) -> object:
        assert chance == -1e3
        return {"chain": chain, "single": single}[str(winner)]

    monkeypatch.setattr(verdict, "_by", by)
    monkeypatch.setattr(verdict, "_winner", lambda *_: "chain")
    monkeypatch.setattr(choice, "winner", lambda _, pairs: "chain" if pairs else "single")
    parent = SimpleNamespace(division=SimpleNamespace(measured=measured))
    reference = cast("Any", SimpleNamespace(parent=parent))
    found = verdict._answer((), cast("Any", [None]), cast("Any", None), reference, -1e3)
    assert found is (single if named else chain)
