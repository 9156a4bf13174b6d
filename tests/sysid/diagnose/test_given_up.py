"""Searches of chains that would end with much left: what promises nearly all is looked for yet."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any, cast

import pytest
from strangers.asking import ask, ask_runs, fitted_runs
from strangers.flights import fly

from sysid.diagnose import chains, exchanged_halves
from sysid.diagnose.candidates import Ranked
from sysid.diagnose.chains import _Chains
from sysid.diagnose.fitted_chains import KEPT_BACK
from sysid.diagnose.score import Score
from sysid.diagnose.unsearched import MuchLeft

BESIDE_INFLOW = 4320655
"""A training one's: a dead band that alone explains nothing, beside an inflow that explains half of a drift."""
NO_TETHER = 4110160
"""A judged one's: play and an inflow, of which a tether explains more than either alone, and a limit of acceleration
promises most beside each and explains nothing."""
TIED_AND_LATE = 4110381
"""Another's: late servos on a tether, where a limit of acceleration explains a little more than the lag."""
ENOUGH = ((("sideslip", 80.0), 0.4), (("servo_backlash", 70.0), 0.97))
BOTH = ({"servo_backlash", "dynamic_inflow"}, {"servo_lag", "attitude_stiffness"})


def scored(name: str, chi_squared: float) -> Ranked:
    score = Score(effect=name, chi_squared=chi_squared, degrees=1, tried=1, at={}, errors={})
    return Ranked(effects=(name,), score=score, not_testable=None)


def fitted(effects: tuple[str, ...], chi_squared: float) -> Ranked:
    one = SimpleNamespace(
        effects=effects, effect=effects[0], chi_squared=chi_squared, delta_bic=-chi_squared, implausible=(), fit=True
    )
    return cast("Ranked", one)


def alone(name: str, chi_squared: float, *, linear: bool = True, outside: tuple[str, ...] = ()) -> Ranked:
    fit = SimpleNamespace(model=SimpleNamespace(structure=SimpleNamespace(linear=linear)))
    return Ranked(
        effects=(name,), score=None, not_testable=None, fit=cast("Any", fit), chi_squared=chi_squared, outside=outside
    )


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


@pytest.mark.parametrize(
    ("lag", "begun"),
    [
        (alone("servo_lag", 91.0), "servo_lag"),
        (alone("servo_lag", 89.0), "servo_acceleration_limit"),
        (alone("servo_lag", 95.0, outside=("tau_s",)), "servo_acceleration_limit"),
        (alone("servo_backlash", 99.0, linear=False), "servo_acceleration_limit"),
    ],
)
def test_what_is_linear_and_as_good_is_begun_with(lag: Ranked, begun: str) -> None:
    limit = alone("servo_acceleration_limit", 100.0, linear=False)
    assert chains._linear_for(limit, [limit, lag]).effect == begun
    assert chains._linear_for(lag, [limit, lag]) is lag or lag.effect == "servo_backlash"


@pytest.mark.parametrize(
    ("explained", "linear", "tried"),
    [(150.0, False, ["limit"]), (104.0, False, ["limit", "lag"]), (104.0, True, ["limit"])],
)
def test_a_limit_that_breaks_its_promise_ends_no_search(
    explained: float, linear: bool, tried: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """What promises most beside an effect and leaves most ends the search beside it, where a promise is worth one."""
    fitted_so_far: list[str] = []
    search = search_with(found={})
    first = replace(alone("play", 100.0), stepped=cast("Any", object()))

    def fit(_: object, one: Ranked, other: Ranked) -> None:
        fitted_so_far.append(other.effect)
        both = alone("", explained if other.effect == "limit" else 101.0, linear=linear)
        search.found[one.effect, other.effect] = replace(both, effects=(one.effect, other.effect))

    def same(_: object, some: object, *__: object) -> object:
        return some

    seconds = [scored("limit", 90.0), scored("lag", 80.0)]
    monkeypatch.setattr(chains, "misfit", lambda _: 300.0)
    monkeypatch.setattr(chains, "chance_of_noise", lambda *_: -50.0)
    monkeypatch.setattr(chains, "names_of", lambda *names: names)
    for name, value in {
        "ask_beside": lambda *_: seconds,
        "able_beside": lambda _, __, some: some,
        "without_twins": same,
        "of_each_kind": lambda _, some, __: [(one, one) for one in some],
        "price_of": lambda *_: 1.0,
        "promising": lambda *_: True,
        "best": property(lambda self: max(self.found.values(), key=lambda one: one.chi_squared)),
        "fit": fit,
    }.items():
        monkeypatch.setattr(_Chains, name, value)
    assert search.begin_with(replace(first, fit=cast("Any", SimpleNamespace(division=None))))
    assert fitted_so_far == tried


def test_what_explains_enough_by_power_is_begun_with_before_the_search_gives_up() -> None:
    tether = replace(alone("attitude_stiffness", 90.0), implausible=("L_phi",), explained_share=0.95)
    little, play = (replace(alone(*one), explained_share=share) for one, share in ENOUGH)
    assert chains._enough_by_power(tether, [little, play]) is play
    assert chains._enough_by_power(tether, [tether, little]) is None
    assert chains._enough_by_power(little, [play]) is None


@pytest.mark.thorough
@pytest.mark.parametrize(("seed", "both"), [(NO_TETHER, BOTH[0]), (TIED_AND_LATE, BOTH[1])])
def test_two_are_found_behind_one_that_alone_explains_more(seed: int, both: set[str]) -> None:
    assert set(ask(fly(seed)).first.chain) == both


@pytest.mark.parametrize(
    ("second", "scores", "measured", "tried"),
    [
        ("servo_deadband", 70.0, True, True),
        ("servo_deadband", 50.0, True, False),
        ("servo_deadband", 70.0, False, False),
        ("stabiliser_bar", 70.0, True, False),
    ],
)
def test_what_acts_on_samples_is_tried_where_it_scores_half_of_the_best(
    second: str, scores: float, measured: bool, tried: bool
) -> None:
    """Beside a hub a tether explained 113 more; a dead band scored 70, and explained 165."""
    hub, tether = alone("hub_gyroscopics", 730.0), alone("", 843.0)
    parent = SimpleNamespace(division=SimpleNamespace(measured=measured))
    search = search_with(
        found={("attitude_stiffness", "hub_gyroscopics"): tether},
        alone={"hub_gyroscopics": hub},
        answered=False,
        reference=SimpleNamespace(parent=parent),
    )
    score = Score(effect=second, chi_squared=scores, degrees=1, tried=1, at={}, errors={})
    assert search.promising(hub, Ranked(effects=(second,), score=score, not_testable=None)) == tried
