"""Chains whose halves the runs show the opposite of, or that have doubtful values: what is tried in their place."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any, cast

import pytest
from strangers.asking import ask_runs, fitted_runs
from strangers.flights import fly

from sysid.diagnose import choice, exchanged_halves, fitted_chains, likely, refits
from sysid.diagnose.candidates import Ranked
from sysid.diagnose.chains import _Chains
from sysid.diagnose.fitted_chains import DEAR, OPPOSED
from sysid.diagnose.likely import doubtful
from sysid.diagnose.refits import as_scored
from sysid.diagnose.score import Score
from sysid.model.compose import compose
from sysid.model.effect import catalogue
from sysid.model.paper import TPP
from sysid.model.structure import Model


def scored(name: str, chi_squared: float, times: float = 1.0, **at: float) -> Ranked:
    score = Score(effect=name, chi_squared=chi_squared, degrees=1, tried=1, at=at, errors={}, times=times)
    return Ranked(effects=(name,), score=score, not_testable=None)


def alone(name: str, chi_squared: float, outside: tuple[str, ...] = (), effects: tuple[str, ...] = ()) -> Ranked:
    structure = compose(TPP.base_, [catalogue()[one] for one in effects or (name,)], TPP.inputs, {})
    fit = SimpleNamespace(model=Model(structure, structure.vector(dict.fromkeys(structure.names, 1.0))))
    return Ranked(
        effects=effects or (name,),
        score=None,
        not_testable=None,
        fit=cast("Any", fit),
        chi_squared=chi_squared,
        outside=outside,
        implausible=outside,
    )


def search_of(*single: Ranked) -> _Chains:
    reference = cast("Any", SimpleNamespace(users=(), parent=None))
    return _Chains(single, reference, lambda _: None, None, answered=False)


def test_what_the_runs_show_the_opposite_of_is_not_begun_there() -> None:
    begun = cast("Any", SimpleNamespace(model=Model(TPP, TPP.vector(dict.fromkeys(TPP.names, 0.5)))))
    late = compose(TPP.base_, [catalogue()["transport_delay"]], TPP.inputs, {})
    assert as_scored(scored("transport_delay", 335.0, 0.4, T_d=0.02), late, begun) is not None
    assert as_scored(scored("transport_delay", 335.0, -0.05, T_d=0.02), late, begun) is None
    assert as_scored(scored("transport_delay", 335.0, 1.0, T_d=-0.02), late, begun) is None


def test_of_what_is_opposed_a_few_keep_their_place(monkeypatch: pytest.MonkeyPatch) -> None:
    """Beside a hub four of five kinds of lateness were tried, all below zero, and the inflow was not."""
    late = ["servo_second_order", "gyro_filter", "lag_per_axis", "servo_lag", "transport_delay"]
    monkeypatch.setattr(_Chains, "price_of", lambda *_: 2.0)
    monkeypatch.setattr(_Chains, "_opposed", lambda _, one, __: one.effect in late)
    seconds = [scored(name, 130.0) for name in (*late, "dynamic_inflow")]
    able = search_of().able_beside(cast("Any", None), seconds)
    assert [one.effect for one in able] == [*late[:OPPOSED], "dynamic_inflow", *late[OPPOSED:]]


def test_what_cannot_begin_beside_another_nor_alone_is_not_tried(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(_Chains, "price_of", lambda _, one, __: 0.0 if "lag" in one.effect else 25.0)
    monkeypatch.setattr(_Chains, "_opposed", lambda *_: False)
    search = search_of(alone("servo_lag", 90.0), alone("gyro_lag", 5.0))
    seconds = [scored(name, 300.0) for name in ("gyro_lag", "servo_lag", "lag_per_axis", "dynamic_inflow")]
    able = [one.effect for one in search.able_beside(cast("Any", None), seconds)]
    assert able == ["servo_lag", "dynamic_inflow"], "that lag explains something alone: the other may be fitted to it"


@pytest.mark.parametrize(
    ("outside", "tried"),
    [((), []), (("M_w",), ["angular_damping", "lag_per_axis"]), (("M_w", "T_d"), []), (("L_phi",), [])],
)
def test_plausible_effects_take_the_place_of_a_doubtful_half(
    outside: tuple[str, ...], tried: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """A wing at its bound beside a delay for a damping beside a lag, which no chain had begun with."""
    wing, delay = alone("slipstream_wing", 2141.0), alone("transport_delay", 800.0)
    others = [alone("angular_damping", 1712.0), alone("lag_per_axis", 1500.0), alone("servo_rate_limit", 1600.0)]
    search, asked = search_of(wing, delay, *others, alone("gyro_lag", 790.0)), list[str]()
    prices = {"servo_rate_limit": DEAR}

    def fit(_: object, first: Ranked, second: Ranked, *, exchanged: bool) -> None:
        assert exchanged
        assert first.effect == "transport_delay"
        asked.append(second.effect)
        chain = alone("", 2488.0, (), (first.effect, second.effect))
        search.found[fitted_chains.names_of(first.effect, second.effect)] = chain

    monkeypatch.setattr(_Chains, "fit", fit)
    monkeypatch.setattr(_Chains, "price_of", lambda _, one, __: prices.get(one.effect, 2.0))
    monkeypatch.setattr(exchanged_halves, "do_else", lambda one, other: "gyro_lag" not in (one.effect, other.effect))
    monkeypatch.setattr(fitted_chains, "twins", lambda *_: False)
    best = alone("", 2476.0, outside, ("slipstream_wing", "transport_delay"))
    search.found["slipstream_wing", "transport_delay"] = best
    assert search.exchange_doubtful() == bool(tried)
    assert asked == tried
    search.found = {("slipstream_wing", "transport_delay"): best}
    assert not search.exchange_doubtful()
    assert asked == tried, "once"
    search.replaced = set()
    search.found = {("slipstream_wing", "transport_delay"): replace(best, implausible=())}
    assert not search.exchange_doubtful(), "a damping ratio at its bound is none"


def test_a_tether_is_no_doubtful_value() -> None:
    tied = alone("", 890.0, ("L_phi", "M_theta"), ("servo_backlash", "attitude_stiffness"))
    assert doubtful(tied) == set()
    assert doubtful(replace(tied, outside=("L_phi", "half_width"))) == {"half_width"}


def test_what_a_tether_would_be_takes_the_place_of_a_half_too() -> None:
    tied, wing = alone("attitude_stiffness", 454.0, ("L_phi",)), alone("slipstream_wing", 436.0, ("L_w",))
    search = search_of(tied, wing, alone("servo_backlash", 177.0))
    assert [*search.alone] == ["attitude_stiffness", "servo_backlash"]
    assert [*search.single] == ["attitude_stiffness", "slipstream_wing", "servo_backlash"]


def test_play_on_a_tether_is_told_before_what_alone_resembles_both(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(choice, "misfit", lambda *_: 10.0)
    both = alone("", 890.0, ("L_phi", "M_theta"), ("servo_backlash", "attitude_stiffness"))
    fit = SimpleNamespace(division=SimpleNamespace(measured=True))
    both = replace(both, fit=cast("Any", fit), explained_share=1.0)
    single = replace(alone("speed_stability", 800.0, ("Y_v",)), explained_share=1.0)
    assert choice._more(both, single) == pytest.approx(0.1)
    assert choice._more(replace(both, outside=("half_width",)), single) == 0.0


@pytest.mark.thorough
@pytest.mark.usefixtures("only_effects")
@pytest.mark.parametrize("only_effects", [("quadratic_damping", "dynamic_inflow")], indirect=True)
def test_beside_what_is_not_linear_the_noise_leads_where_powers_lead_away(monkeypatch: pytest.MonkeyPatch) -> None:
    """A training stranger: inflow beside a quadratic damping went to a second by power, and explained 109 of 289."""
    flown = fly(4048795)
    runs = fitted_runs(flown)
    answer = ask_runs(runs, chains=True)
    assert answer.verdict == "missing"
    assert set(answer.chain) == {"quadratic_damping", "dynamic_inflow"}
    assert answer.winner is not None
    assert answer.winner.values["tau_l"] == pytest.approx(0.0147, rel=0.5)
    monkeypatch.setattr(refits, "by_the_noise", lambda *_: None)
    astray = ask_runs(runs, chains=True)
    assert astray.winner is not None
    assert astray.winner.values.get("tau_l") != pytest.approx(0.0147, rel=0.5)


def test_a_tether_is_no_doubtful_single_that_any_plausible_chain_takes_the_place_of(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A tethered stranger was named a stabiliser bar beside a sideslip, which explained no more."""
    monkeypatch.setattr(choice, "_likeliest_in_practice", lambda one, *_: one)
    monkeypatch.setattr(choice, "_more", lambda *_: 0.0)
    fit = cast("Any", SimpleNamespace(division=SimpleNamespace(measured=True)))
    both = replace(alone("", 7422.0, (), ("stabiliser_bar", "sideslip")), fit=fit)
    tether = replace(alone("attitude_stiffness", 7421.0, ("L_phi",)), fit=fit)
    wing = replace(alone("slipstream_wing", 7421.0, ("tau_w",)), fit=fit)
    assert choice.winner([tether], [both]) is tether
    assert choice.winner([wing], [both]) is both
    tied = ("attitude_stiffness", "sideslip")
    assert choice.winner([wing], [replace(both, effects=tied, implausible=("L_phi",))]).effects == tied
    assert choice.winner([wing], [replace(both, implausible=("tau_b",))]) is wing


@pytest.mark.parametrize(("price", "begun"), [(2.0, True), (DEAR, False), (0.0, False)])
def test_what_is_not_plausible_alone_is_begun_with_where_that_is_cheap(
    price: float, begun: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Alone an inflow took up a tether; beside it the tether led where the inflow did not come from."""
    tether, inflow = alone("attitude_stiffness", 2016.0, ("L_phi",)), alone("dynamic_inflow", 646.0, ("tau_l",))
    monkeypatch.setattr(_Chains, "price_of", lambda *_: price)
    search = search_of(tether, inflow, alone("angular_damping", 137.0))
    assert search.cheap_to_begin_with(tether, scored("dynamic_inflow", 203.0)) is (inflow if begun else None)
    assert search.cheap_to_begin_with(tether, scored("angular_damping", 137.0)) is search.single["angular_damping"]
    assert search.cheap_to_begin_with(tether, scored("sideslip", 137.0)) is None


@pytest.mark.parametrize("doubtful", [(), ("tau_s",)])
@pytest.mark.parametrize(("behind", "tried"), [(0.5, ["servo_lag"]), (50.0, [])])
def test_what_a_half_contains_is_tried_in_the_likeliest_chains(
    behind: float, tried: list[str], doubtful: tuple[str, ...], monkeypatch: pytest.MonkeyPatch
) -> None:
    """A lag of each axis beside a hub was the likeliest, and a lag of all beside a damping, the truth, not fitted; and
    a lag of all that alone, without the hub, was longer than one may be."""
    search, asked = search_of(alone("lag_per_axis", 284.0), alone("servo_lag", 270.0, doubtful)), list[str]()
    best = alone("", 422.0, (), ("hub_gyroscopics", "dynamic_inflow"))
    near = alone("", 422.0 - behind, (), ("lag_per_axis", "angular_damping"))
    search.found = {one.effects: one for one in (best, near)}
    monkeypatch.setattr(_Chains, "price_of", lambda *_: 2.0)

    def fit(_: object, first: Ranked, second: Ranked, *, exchanged: bool) -> None:
        assert exchanged
        assert second.effect == "angular_damping"
        asked.append(first.effect)

    monkeypatch.setattr(_Chains, "fit", fit)
    search.exchange_larger()
    assert asked == tried


def test_a_chain_that_leaves_more_than_its_half_begins_once_more_as_both_are_alone(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A dead band beside a damping of squared rates stayed at twice its width, where its score was."""
    damping, band = alone("quadratic_damping", 253.0), alone("servo_deadband", 68.0)
    begun: list[object] = []

    def fitted(_: object, first: Ranked, second: Ranked, __: Ranked, ___: Ranked, near: object) -> Ranked:
        begun.append(near)
        return alone("", 370.0 if near else -203.0, (), (first.effect, second.effect))

    monkeypatch.setattr(_Chains, "price_of", lambda *_: 2.0)
    monkeypatch.setattr(_Chains, "_fitted", fitted)
    monkeypatch.setattr(fitted_chains, "as_alone", lambda *_: "as alone")
    search = search_of(damping, band)
    search.fit(damping, scored("servo_deadband", 88.0))
    assert begun == [None, "as alone"]
    monkeypatch.setattr(fitted_chains, "as_alone", lambda *_: None)
    search.fit(damping, scored("servo_deadband", 88.0))
    assert begun == [None, "as alone", None]


@pytest.mark.parametrize(("behind", "simpler"), [(0.5, True), (20.0, False)])
def test_of_two_a_simpler_pair_is_told_by_evidence_where_the_common_half_was_not_fitted(
    behind: float, simpler: bool
) -> None:
    """A lag beside a hub, the truth, was a hair behind servos of two real poles there, which were taken for the lag
    alone: the hub had no fit of its own to tell how much either adds."""
    servos = alone("", 3362.2, ("zeta",), ("servo_second_order", "hub_gyroscopics"))
    lag = alone("", 3362.2 - behind, (), ("gyro_lag", "hub_gyroscopics"))
    servos, lag = (replace(one, rows=1000, added=len(one.names), explained_share=1.0) for one in (servos, lag))
    for halves in ((), (alone("hub_gyroscopics", 69.0),)):
        assert choice._explains_as_much(lag, servos, halves) == (simpler or bool(halves))
    assert not choice._explains_as_much(replace(lag, chi_squared=2000.0), servos, ())


@pytest.mark.parametrize(("stand", "tried"), [(407.0, True), (300.0, False)])
def test_a_stand_is_asked_in_the_place_of_what_alone_explains_hardly_more(
    stand: float, tried: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Play beside a weathercock explained 538 and left 127; beside a stand, the truth, 679 and 32."""
    search = search_of(alone("sideslip", 411.0), alone("attitude_stiffness", stand, ("L_phi",)))
    search.found[("servo_backlash", "sideslip")] = alone("", 538.0, (), ("sideslip", "servo_backlash"))
    fitted: list[tuple[str, str]] = []
    monkeypatch.setattr(_Chains, "fit", lambda _, one, other, **__: fitted.append((one.effect, other.effect)))
    search.exchange_for_a_tether()
    assert fitted == ([("attitude_stiffness", "servo_backlash")] if tried else [])


@pytest.mark.parametrize(("twin_s", "told"), [(("zeta",), True), (("corner",), False), ((), True)])
def test_what_is_one_with_an_entry_of_a_chain_s_class_is_so_however_implausible_both_are_alone(
    twin_s: tuple[str, ...], told: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Alone servos of second order and a filter of the gyros rang for the inflow; beside it neither did."""
    monkeypatch.setattr(Ranked, "own", property(lambda one: tuple(catalogue()[name] for name in one.effects)))
    monkeypatch.setattr(likely, "twins", lambda one, other: {one.effect, other.effect} == {*SECOND_ORDER})
    singles = [alone("servo_second_order", 431.0, ("zeta",)), alone("gyro_filter", 431.0, twin_s)]
    singles = [replace(one, stepped=cast("Any", object())) for one in singles]
    chain = alone("", 534.0, (), ("transport_delay", "dynamic_inflow"))
    among = likely.Class(alike=("servo_second_order",), equivalent={}, named=0.7, whole=0.99)
    found = likely.with_twins(among, chain, singles).equivalent
    assert found == ({"servo_second_order": ("gyro_filter",)} if told else {})
    assert likely.with_twins(replace(among, alike=()), chain, singles).equivalent == {}


SECOND_ORDER = ("servo_second_order", "gyro_filter")
