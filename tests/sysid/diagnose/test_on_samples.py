"""Play, dead bands and limits beside a name, of which the imposed commands tell little and all commands much."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from strangers.asking import ask_runs, fitted_runs
from strangers.flights import fly

from sysid.data.band import swept_band
from sysid.data.dataset import dataset
from sysid.data.record import Record
from sysid.diagnose import candidates, chains, choice, on_samples, refits
from sysid.diagnose.candidates import Ranked, Reference
from sysid.diagnose.chains import _Chains
from sysid.diagnose.choice import SURELY_FORETELLS, winner
from sysid.diagnose.diagnose import diagnose
from sysid.diagnose.on_samples import PROMISES, RIVAL, _Foretelling
from sysid.diagnose.progress import unheard
from sysid.diagnose.score import Score
from sysid.diagnose.unsearched import BudgetSpent, LittleLeft
from sysid.fit.identify import identify
from sysid.model.compose import compose

SEED = 4054550
"""A judged one's: a dead band of 5.4 times what is just detectable beside an inflow, which was named alone at 0.99."""
WIDTH = 0.00967
LIMITED, LIMIT = 4076841, 0.23555
"""Another's: commands reach a limit where gusts add to what is imposed, and hardly else; 1.8 times, and unexplained."""
JUMPING, JUMP = 4110687, 0.009418
"""A dead band that least squares had at 0.01 by gusts' power, where play explained more: it was named, at 0.95."""
UNTOLD = 4301540
"""Another in a log that has every second command of its loop, and does not tell: play was named at 0.995."""
GONE = 4110803
"""A limit of rates beside an inflow, of which least squares with it sees nothing for gusts."""
HALVES = {
    4301171: ("attitude_stiffness", "servo_deadband"),
    4301439: ("servo_lag", "servo_deadband"),
}
"""Of strangers whose linear half was told as angle_of_attack beside play, and as a lag of each axis."""


@pytest.mark.usefixtures("only_effects")
@pytest.mark.parametrize(
    "only_effects", [("dynamic_inflow", "gyro_lag", "servo_backlash", "servo_deadband")], indirect=True
)
def test_a_dead_band_that_the_imposed_commands_hide_is_told_beside_an_inflow(
    fitted_stranger: list[Record], monkeypatch: pytest.MonkeyPatch
) -> None:
    found = ask_runs(fitted_stranger, chains=True)
    assert (found.verdict, set(found.chain)) == ("missing", {"dynamic_inflow", "servo_deadband"})
    assert found.winner is not None
    assert found.winner.values["width"] == pytest.approx(WIDTH, rel=0.05)
    monkeypatch.setattr(on_samples, "PROMISES", np.inf)
    assert ask_runs(fitted_stranger, chains=True).chain == ("dynamic_inflow",)


@pytest.mark.usefixtures("only_effects")
@pytest.mark.parametrize("only_effects", [("servo_deadband", "servo_backlash")], indirect=True)
def test_a_dead_band_is_as_wide_as_the_noise_has_it(monkeypatch: pytest.MonkeyPatch) -> None:
    runs = fitted_runs(fly(JUMPING))
    found = ask_runs(runs)
    assert found.verdict == "missing"
    assert "servo_deadband" in {found.effect, *found.indistinguishable}
    (band,) = (one for one in found.candidates if one.effect == "servo_deadband")
    assert band.values["width"] == pytest.approx(JUMP, rel=0.02)
    monkeypatch.setattr(refits, "ROUNDS", 0)
    (band,) = (one for one in ask_runs(runs).candidates if one.effect == "servo_deadband")
    assert band.values["width"] > 1.05 * JUMP


@pytest.mark.usefixtures("only_effects")
@pytest.mark.parametrize("only_effects", [("servo_deadband", "servo_backlash")], indirect=True)
def test_where_samples_may_be_lost_play_and_a_dead_band_that_explain_the_same_are_one_answer() -> None:
    runs = fitted_runs(fly(UNTOLD))
    told = [replace(run, loop_dt_s=1 / 250) for run in runs]
    for asked, alike in ((runs, ("servo_deadband",)), (told, ())):
        found = ask_runs(asked)
        assert (found.effect, found.indistinguishable) == ("servo_backlash", alike)


@pytest.mark.usefixtures("only_effects")
@pytest.mark.parametrize("only_effects", [("servo_rate_limit", "dynamic_inflow")], indirect=True)
def test_a_limit_that_was_added_stays_where_least_squares_sees_nothing_of_it() -> None:
    runs = fitted_runs(fly(GONE))
    swept = swept_band(runs)
    assert swept is not None
    begin = identify(compose("tpp"), runs, band_hz=swept.hz, effects=("servo_rate_limit",)).model
    found = diagnose(begin.structure, runs, band_hz=swept.hz, begin=begin, chains=False)
    assert found.parent.model["rate"] == begin["rate"]
    assert "rate" in found.parent.held


@pytest.mark.thorough
@pytest.mark.usefixtures("only_effects")
@pytest.mark.parametrize("only_effects", [("servo_saturation", "servo_deadband", "angular_damping")], indirect=True)
def test_a_limit_that_the_imposed_commands_hardly_reach_is_told_by_what_it_foretells(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    runs = fitted_runs(fly(LIMITED))
    found = ask_runs(runs)
    assert (found.verdict, found.chain) == ("missing", ("servo_saturation",))
    assert found.winner is not None
    assert found.winner.values["limit"] == pytest.approx(LIMIT, rel=0.02)
    assert found.winner.chi_squared < 15 < SURELY_FORETELLS < found.winner.foretells
    monkeypatch.setattr(on_samples, "PROMISES", np.inf)
    without = ask_runs(runs)
    assert (without.verdict, without.chain) == ("unexplained", ())


@pytest.mark.thorough
@pytest.mark.usefixtures("only_effects")
@pytest.mark.parametrize(
    ("seed", "only_effects", "without"),
    [
        (4301171, (*HALVES[4301171], "angle_of_attack", "servo_backlash"), "exchange_for_a_tether"),
        (4301439, (*HALVES[4301439], "lag_per_axis", "servo_backlash"), "exchange_larger"),
    ],
    indirect=["only_effects"],
)
def test_beside_what_foretells_stands_what_alone_was_hidden_by_another(
    seed: int, without: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(candidates, "flies_forward", lambda *_: True)  # as far as these runs tell
    runs = fitted_runs(fly(seed))
    assert ask_runs(runs, chains=True).chain == HALVES[seed]
    monkeypatch.setattr(_Chains, without, lambda *_: None)
    assert ask_runs(runs, chains=True).chain != HALVES[seed]


def test_of_two_that_foretell_the_likelier_is_named_with_no_more_numbers(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(choice, "_likeliest_in_practice", lambda best, *_: best)
    monkeypatch.setattr(choice, "_measured_by_samples", lambda _: True)
    monkeypatch.setattr(Ranked, "own", ())
    monkeypatch.setattr(Ranked, "names", ("tau_s", "width"))
    named = ranked("lag_per_axis", chi_squared=800.0)
    foretelling = ranked("lag_per_axis", "servo_deadband", chi_squared=890.0, foretells=SURELY_FORETELLS + 1)
    likelier = ranked("servo_lag", "servo_deadband", chi_squared=900.0)
    assert winner([named], [likelier, foretelling]) is likelier
    less = replace(likelier, chi_squared=880.0)
    assert winner([named], [foretelling, less]) is foretelling
    impossible = replace(likelier, implausible=("tau_s",))
    assert winner([named], [impossible, foretelling]) is foretelling
    monkeypatch.setattr(choice, "_measured_by_samples", lambda one: one is not likelier)
    assert winner([named], [likelier, foretelling]) is foretelling


def test_what_foretells_is_named_where_nothing_else_pays_for_its_parameters(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(choice, "_likeliest_in_practice", lambda best, *_: best)
    limit = replace(ranked("servo_saturation", chi_squared=1.0, foretells=SURELY_FORETELLS), added=1, rows=100)
    lag = replace(ranked("servo_lag", chi_squared=3.0), added=1, rows=100)
    assert winner([lag, limit], []) is limit
    assert winner([lag, replace(limit, foretells=SURELY_FORETELLS - 1)], []) is None
    assert winner([lag, replace(limit, outside=("limit",))], []) is None
    surely = replace(lag, chi_squared=100.0)
    assert winner([surely, limit], []) is surely


def test_runs_are_asked_as_if_no_excitation_had_been_logged(fitted_stranger: list[Record]) -> None:
    logged = dataset(fitted_stranger, (0.1, 20.0))
    assert not logged.in_a_loop
    unexcited = logged.unexcited
    assert unexcited.in_a_loop
    assert unexcited is logged.unexcited
    assert not any(name.startswith("excitation") for one in unexcited.records for name in one.channels)
    assert all(any(name.startswith("excitation") for name in one.channels) for one in logged.records)
    judging = logged.beside(logged).unexcited
    assert judging.like is unexcited


def ranked(*effects: str, chi_squared: float = 0.0, foretells: float = 0.0, measured: bool = True) -> Ranked:
    fit = SimpleNamespace(
        division=SimpleNamespace(measured=measured), model=SimpleNamespace(structure=SimpleNamespace(linear=True))
    )
    return Ranked(
        effects=effects,
        score=None,
        not_testable=None,
        fit=cast("Any", fit),
        chi_squared=chi_squared,
        foretells=foretells,
        explained_share=1.0,
    )


def test_what_surely_foretells_more_is_named_whatever_the_imposed_commands_tell(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(choice, "_likeliest_in_practice", lambda best, *_: best)
    named = ranked("dynamic_inflow", chi_squared=900.0)
    other = ranked("slipstream_wing", chi_squared=800.0)
    both = ranked("dynamic_inflow", "servo_deadband", chi_squared=890.0, foretells=SURELY_FORETELLS + 1)
    more = ranked("dynamic_inflow", "servo_backlash", chi_squared=880.0, foretells=SURELY_FORETELLS + 9)
    assert winner([named, other], [both, more]) is more
    assert winner([named, other], [replace(both, foretells=SURELY_FORETELLS - 1)]) is named
    assert winner([named, other], [replace(both, outside=("width",))]) is named
    assert winner([named, other], [replace(both, effects=("slipstream_wing", "servo_deadband"))]) is named
    alone = ranked("servo_deadband", chi_squared=950.0)
    assert winner([alone, named], [both, more]) is alone


def scored(name: str, chi_squared: float) -> Ranked:
    score = Score(effect=name, chi_squared=chi_squared, degrees=1, tried=1, at={}, errors={})
    return Ranked(effects=(name,), score=score, not_testable=None)


@pytest.mark.parametrize(
    ("band", "lag", "told"),
    [
        ((PROMISES, SURELY_FORETELLS), (0.0, 0.0), ["servo_deadband"]),
        ((PROMISES, SURELY_FORETELLS - 1), (0.0, 0.0), []),
        ((PROMISES - 1, SURELY_FORETELLS), (0.0, 0.0), []),
        ((PROMISES, SURELY_FORETELLS), (SURELY_FORETELLS, 1.1 * RIVAL * SURELY_FORETELLS), []),
        ((PROMISES, SURELY_FORETELLS), (SURELY_FORETELLS, 0.9 * RIVAL * SURELY_FORETELLS), ["servo_deadband"]),
    ],
)
def test_nothing_is_told_beside_a_name_that_is_faint_or_that_something_linear_does_nearly_as_well(
    band: tuple[float, float], lag: tuple[float, float], told: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    search = foretelling({"servo_deadband": band}, {"servo_lag": lag}, monkeypatch)
    assert {one.effect for one in search.found()} == set(told)


@pytest.mark.parametrize(
    ("scores", "more", "told"),
    [
        # what rests is fitted both ways where either promises, and stands beside the one that surely foretells
        ((PROMISES, PROMISES - 1, 0.0), (SURELY_FORETELLS, 30.0, 0.0), ["servo_backlash", "servo_deadband"]),
        ((PROMISES - 1, PROMISES, 0.0), (SURELY_FORETELLS, 30.0, 0.0), ["servo_backlash", "servo_deadband"]),
        ((PROMISES - 1, PROMISES - 1, PROMISES), (99.0, 99.0, 99.0), ["servo_rate_limit"]),
        ((PROMISES, PROMISES, PROMISES), (99.0, 30.0, 30.0), ["servo_backlash", "servo_deadband"]),
        ((PROMISES, PROMISES, PROMISES), (30.0, 30.0, 99.0), ["servo_rate_limit"]),
    ],
)
def test_play_and_a_dead_band_are_told_together(
    scores: tuple[float, ...], more: tuple[float, ...], told: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    names = ("servo_backlash", "servo_deadband", "servo_rate_limit")
    search = foretelling(dict(zip(names, zip(scores, more, strict=True), strict=True)), {}, monkeypatch)
    assert {one.effect for one in search.found()} == set(told)


def foretelling(
    samples: Mapping[str, tuple[float, float]],
    linear: Mapping[str, tuple[float, float]],
    monkeypatch: pytest.MonkeyPatch,
) -> _Foretelling:
    """A search that finds what acts on samples, and what does not, to score and foretell so much."""
    more = {name: each[1] for name, each in ({**samples, **linear}).items()}
    fits = {name: SimpleNamespace(told=(SimpleNamespace(by_name={}),), name=name) for name in more}
    monkeypatch.setattr(on_samples, "refitted", lambda one, *_: replace(one, fit=cast("Any", fits[one.effect])))
    monkeypatch.setattr(on_samples, "begun_at", lambda *_: None)
    asked = {
        acts: [scored(name, each[0]) for name, each in some.items()]
        for acts, some in ((True, samples), (False, linear))
    }
    monkeypatch.setattr(_Foretelling, "__init__", lambda *_: None)
    monkeypatch.setattr(_Foretelling, "asked", lambda _, acts: asked[acts])
    monkeypatch.setattr(_Foretelling, "more", lambda _, fit: more[fit.name])
    monkeypatch.setattr(_Foretelling, "told", lambda _, beside, __: beside)
    search = _Foretelling(cast("Any", None), ("dynamic_inflow",), cast("Any", None))
    search.begun, search.reference = cast("Any", None), cast("Any", SimpleNamespace(users=()))
    return search


def test_only_beside_what_is_linear_and_where_an_excitation_is_logged() -> None:
    nowhere = cast("Reference", None)  # not even looked at
    assert on_samples.on_samples_beside(ranked("dynamic_inflow", measured=False), nowhere, unheard) == []
    bent = ranked("quadratic_damping")
    assert bent.fit is not None
    bent.fit.model.structure.linear = False  # type: ignore[misc]
    assert on_samples.on_samples_beside(bent, nowhere, unheard) == []


@pytest.mark.parametrize("interrupted", [False, True])
def test_ctrl_c_ends_the_question_and_is_told(interrupted: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    named = ranked("dynamic_inflow", chi_squared=900.0)
    both = ranked("dynamic_inflow", "servo_deadband", chi_squared=900.0, foretells=2 * SURELY_FORETELLS)

    def beside(*_: object) -> list[Ranked]:
        if interrupted:
            raise KeyboardInterrupt
        return [both]

    monkeypatch.setattr(chains, "on_samples_beside", beside)
    monkeypatch.setattr(chains, "_of_little", lambda *_: chains.ChainSearch(unsearched=LittleLeft(0.0)))
    found = chains.chains_of_two([replace(named, rows=2)], cast("Any", None), unheard, named=named)
    assert found.pairs == (() if interrupted else (both,))
    assert isinstance(found.unsearched, BudgetSpent) == interrupted


def test_it_costs_nothing_where_nothing_may_be_spent() -> None:
    named = ranked("dynamic_inflow", chi_squared=900.0)
    search = _Chains([named], cast("Any", None), unheard, 0.0, answered=True)
    assert not search.surely_beside(named)
    assert not search.found
