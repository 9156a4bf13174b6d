"""In what order chains of two are looked for, what stands in whose place, and where the search ends."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from sysid.diagnose import chains, exchanged_halves, fitted_chains, refits
from sysid.diagnose.candidates import Ranked
from sysid.diagnose.score import Score
from sysid.diagnose.unsearched import BudgetSpent, MuchLeft
from sysid.model.compose import compose
from sysid.model.paper import TPP
from sysid.model.structure import Model


def search_of(answered: bool, *single: Ranked, measured: bool = True) -> chains._Chains:
    parent = SimpleNamespace(division=SimpleNamespace(measured=measured))
    return chains._Chains(single, cast("Any", SimpleNamespace(parent=parent, users=())), lambda _: None, None, answered)


def scored(name: str, chi_squared: float) -> Ranked:
    score = Score(effect=name, chi_squared=chi_squared, degrees=1, tried=1, at={}, errors={})
    return Ranked(effects=(name,), score=score, not_testable=None)


def alone(name: str, chi_squared: float, implausible: tuple[str, ...] = ()) -> Ranked:
    fit = cast("Any", SimpleNamespace(model=SimpleNamespace(structure=SimpleNamespace(linear=True))))
    return Ranked(
        effects=(name,), score=None, not_testable=None, fit=fit, chi_squared=chi_squared, implausible=implausible
    )


def test_what_is_dear_and_little_is_tried_beside_what_is_no_answer(monkeypatch: pytest.MonkeyPatch) -> None:
    stiff = alone("attitude_stiffness", 5386.0, ("M_theta",))
    monkeypatch.setattr(chains._Chains, "price_of", lambda *_: fitted_chains.DEAR)
    assert search_of(False, stiff).promising(stiff, scored("rotor_speed", 253.0))
    assert not search_of(True, stiff).promising(stiff, scored("rotor_speed", 253.0))


def test_beside_one_that_only_stands_in_and_leaves_noise_others_are_tried(monkeypatch: pytest.MonkeyPatch) -> None:
    begun: list[str] = []
    monkeypatch.setattr(chains, "do_else", lambda *_: True)

    def leaves_noise(_: object, one: Ranked) -> bool:
        begun.append(one.effect)
        return False

    monkeypatch.setattr(chains._Chains, "begin_with", leaves_noise)
    bar, lag = alone("stabiliser_bar", 320.0, ("tau_b",)), alone("servo_lag", 180.0)
    assert search_of(False, bar, lag).search([bar, lag])
    assert begun == ["stabiliser_bar", "servo_lag"]
    assert not search_of(False, lag).search([lag])


@pytest.mark.parametrize(
    ("explained", "implausible", "order"),
    [
        (300.0, (), ["servo_lag", "stabiliser_bar"]),
        (240.0, (), ["stabiliser_bar", "servo_lag"]),
        (300.0, ("tau_s",), ["stabiliser_bar"]),
    ],
)
def test_of_two_that_explain_nearly_the_same_the_plausible_one_is_begun_with(
    explained: float, implausible: tuple[str, ...], order: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Servos that ring, which only stood in, explained as much as the play that was there beside an inflow."""
    begun: list[str] = []
    monkeypatch.setattr(chains, "do_else", lambda *_: True)
    monkeypatch.setattr(chains._Chains, "begin_with", lambda _, one: begun.append(one.effect))
    bar, lag = alone("stabiliser_bar", 320.0, ("tau_b",)), alone("servo_lag", explained, implausible)
    search_of(False, bar, lag).search([bar, lag])
    assert begun == order
    begun.clear()
    likeliest = replace(bar, implausible=())
    search_of(False, likeliest, lag).search([likeliest, lag])
    assert begun[0] == "stabiliser_bar"


@pytest.mark.parametrize(("left", "measured"), [(0.0, True), (10.0, True), (14.0, True), (14.0, False), (26.0, False)])
def test_beside_a_likeliest_effect_whose_best_chain_leaves_much_no_other_is_begun(
    left: float, measured: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    begun: list[str] = []
    bar, lag = alone("stabiliser_bar", 320.0), alone("servo_lag", 90.0)
    search = search_of(False, bar, lag, measured=measured)

    def begin(_: object, one: Ranked) -> bool:
        begun.append(one.effect)
        search.found[(one.effect, "rotor_speed")] = replace(alone("", 100.0), effects=(one.effect, "rotor_speed"))
        return True

    monkeypatch.setattr(chains, "do_else", lambda *_: True)
    monkeypatch.setattr(chains, "misfit", lambda _: left)
    monkeypatch.setattr(chains._Chains, "begin_with", begin)
    monkeypatch.setattr(chains._Chains, "leaves_noise", lambda *_: left == 0)
    monkeypatch.setattr(chains._Chains, "fitted_alone", lambda *_: None)
    monkeypatch.setattr(chains._Chains, "ask_beside", lambda *_: None)
    monkeypatch.setattr(chains._Chains, "exchange_halves", lambda _: begun.append("exchanged"))
    monkeypatch.setattr(fitted_chains, "levelled", lambda *_: {})
    monkeypatch.setattr(fitted_chains, "begun_at_rest", lambda *_: {})
    assert search.search([bar, lag])
    given_up = left > (12 if measured else 25)
    both = ["stabiliser_bar"] if left == 0 or given_up else ["stabiliser_bar", "servo_lag"]
    assert begun == [*both, *(() if given_up else ("exchanged",))]
    assert search.unsearched == (MuchLeft(("stabiliser_bar", "rotor_speed"), 100 / (100 + left)) if given_up else None)


@pytest.mark.parametrize("left", [99.0, 101.0])
def test_where_the_most_promising_leaves_most_no_other_is_tried_beside_the_same(
    left: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of a sticking hinge, which the catalogue does not have, one chain left three fifths, and eight others no less."""
    begun = SimpleNamespace(asked_in=lambda _: None, division=None)
    bar = replace(alone("stabiliser_bar", 320.0), stepped=cast("Any", object()), fit=cast("Any", begun))
    search, tried = search_of(False, bar), list[str]()
    search.reference = cast("Any", SimpleNamespace(whitening=None, users=()))

    def fit(_: object, first: Ranked, second: Ranked) -> None:
        tried.append(second.effect)
        search.found[fitted_chains.names_of(first.effect, second.effect)] = replace(alone("", 100.0), effects=("", ""))

    seconds = [scored(name, size) for name, size in (("rotor_speed", 60.0), ("lead_lag", 70.0), ("governor", 50.0))]
    dear = {"governor": fitted_chains.DEAR}
    monkeypatch.setattr(fitted_chains, "score_effects", lambda *_: seconds)
    monkeypatch.setattr(chains._Chains, "_opposed", lambda *_: False)
    monkeypatch.setattr(chains, "chance_of_noise", lambda *_: -1e3)
    monkeypatch.setattr(chains, "misfit", lambda _: left)
    monkeypatch.setattr(chains._Chains, "price_of", lambda _, one, __: dear.get(one.effect, 2.0))
    monkeypatch.setattr(chains._Chains, "promising", lambda *_: True)
    monkeypatch.setattr(chains._Chains, "fit", fit)
    assert search.begin_with(bar)
    assert tried == (["lead_lag"] if left > 100 else ["lead_lag", "rotor_speed", "governor"])


def test_a_half_that_scored_too_little_to_be_fitted_alone_is_begun_with_too(monkeypatch: pytest.MonkeyPatch) -> None:
    """A damping of squared rates beside what stood in for late servos: beside it the servos were found."""
    wing, damping = alone("slipstream_wing", 4693.0, ("tau_w",)), alone("quadratic_damping", 380.0)
    search, begun = search_of(False, wing), list[str]()

    def begin(_: object, one: Ranked) -> bool:
        begun.append(one.effect)
        search.found["", ""] = replace(alone("", 4816.0, ("tau_w",)), effects=("slipstream_wing", "quadratic_damping"))
        return True

    def fitted_alone(_: object, one: Ranked) -> None:
        search.single |= {one.effect: damping} if one.effect == "quadratic_damping" else {}

    monkeypatch.setattr(chains, "misfit", lambda _: 43.0)
    monkeypatch.setattr(chains._Chains, "leaves_noise", lambda *_: False)
    monkeypatch.setattr(chains._Chains, "exchange_halves", lambda _: None)
    monkeypatch.setattr(chains._Chains, "exchange_doubtful", lambda _: False)
    monkeypatch.setattr(chains._Chains, "begin_with", begin)
    monkeypatch.setattr(chains._Chains, "fitted_alone", fitted_alone)
    monkeypatch.setattr(fitted_chains, "levelled", lambda *_: {})
    assert search.search([wing])
    assert begun == ["slipstream_wing", "quadratic_damping"]


def test_ctrl_c_in_what_is_fitted_once_more_keeps_what_was_found(monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[str] = []

    def ended(one: object, *_: object) -> None:
        asked.append(type(one).__name__)
        raise KeyboardInterrupt

    search = search_of(False, alone("servo_lag", 180.0))
    search.reference = cast("Any", SimpleNamespace(parent=None, users=()))
    search.found["", ""] = replace(alone("", 300.0), effects=("servo_lag", "speed_stability"))
    monkeypatch.setattr(fitted_chains, "levelled", ended)
    search.level()
    assert search.interrupted
    assert search.unsearched == BudgetSpent((), (), interrupted=True), "else --repeat would go on"
    assert len(search.found) == 1
    search.level()
    assert asked == ["Ranked"], "nothing more is tried"
    halves = search_of(False, alone("servo_lag", 180.0))
    halves.reference, halves.found = search.reference, search.found
    monkeypatch.setattr(chains._Chains, "price_of", lambda *_: 2.0)
    monkeypatch.setattr(fitted_chains, "refitted", ended)
    assert [one.effect for one in halves.halves_of_the_best(set())] == ["servo_lag"]
    assert halves.interrupted
    assert halves.unsearched == search.unsearched


def test_a_chain_that_has_no_fit_from_one_half_is_fitted_from_the_other(monkeypatch: pytest.MonkeyPatch) -> None:
    wing, rotor = alone("slipstream_wing", 150.0), scored("rotor_speed", 89.0)
    tried: list[tuple[str, str]] = []

    def fitted(_: object, first: Ranked, second: Ranked, more: Ranked, begin: Ranked, __: object) -> Ranked | None:
        tried.append((begin.effect, more.effect))
        return None

    monkeypatch.setattr(chains._Chains, "price_of", lambda *_: 1.0)
    monkeypatch.setattr(chains._Chains, "_fitted", fitted)
    monkeypatch.setattr(fitted_chains, "refitted", lambda *_: alone("rotor_speed", 0.0))
    monkeypatch.setattr(fitted_chains, "as_alone", lambda *_: None)
    monkeypatch.setattr(fitted_chains, "ranked", lambda one, _: one)
    search = search_of(False, wing)
    search.reference = cast("Any", SimpleNamespace(parent=None, users=()))
    search.fit(wing, rotor)
    assert tried == [("slipstream_wing", "rotor_speed"), ("rotor_speed", "slipstream_wing")]


def test_in_the_place_of_a_half_stands_what_scores_as_much_beside_the_other(monkeypatch: pytest.MonkeyPatch) -> None:
    stiff, speed = alone("attitude_stiffness", 3051.0, ("M_theta",)), alone("speed_stability", 3235.0, ("Y_v",))
    search = search_of(False, stiff, speed, alone("slipstream_wing", 3000.0))
    lags = [scored("gyro_filter", 592.0), scored("gyro_lag", 574.0), scored("servo_rate_limit", 428.0)]
    search.seconds["attitude_stiffness"] = lags
    monkeypatch.setattr(chains._Chains, "price_of", lambda *_: 2.0)
    monkeypatch.setattr(exchanged_halves, "do_else", lambda *_: False)
    monkeypatch.setattr(fitted_chains, "twins", lambda *_: False)
    names = [one.effect for one in search.like_beside("attitude_stiffness", "gyro_filter")]
    assert names == ["gyro_filter", "gyro_lag"]
    assert "attitude_stiffness" in [one.effect for one in search.like_alone("speed_stability")]
    plausible = [one.effect for one in search.like_alone("slipstream_wing")]
    assert plausible == ["attitude_stiffness", "slipstream_wing"], "what is plausible, and what a tether would be"


def test_the_best_chain_is_asked_what_stands_beside_either_half(monkeypatch: pytest.MonkeyPatch) -> None:
    """A lag beside an angle of attack left noise; beside the lag the wing in the slipstream, the truth, explained more
    and was not asked, as it was far from the best alone."""
    lag, attack = alone("gyro_lag", 360.0), alone("angle_of_attack", 570.0)
    search = search_of(False, attack, lag, alone("slipstream_wing", 400.0))
    asked: list[str] = []

    def ask(_: object, other: Ranked) -> None:
        asked.append(other.effect)
        search.seconds[other.effect] = [scored("slipstream_wing", 430.0), scored("angle_of_attack", 420.0)]

    begun = SimpleNamespace(model=Model(TPP, np.ones(len(TPP.names))), division=SimpleNamespace(measured=False))
    search.single["gyro_lag"] = replace(lag, fit=cast("Any", begun))
    monkeypatch.setattr(chains._Chains, "price_of", lambda *_: 2.0)
    monkeypatch.setattr(chains._Chains, "ask_beside", ask)
    assert not search.like_beside("gyro_lag", "angle_of_attack"), "there a chain takes up errors, too"
    begun.division.measured = True
    names = [one.effect for one in search.like_beside("gyro_lag", "angle_of_attack")]
    assert names == ["slipstream_wing", "angle_of_attack"]
    search.like_beside("gyro_lag", "slipstream_wing")
    assert asked == ["gyro_lag"], "once"


def exchanged(search: chains._Chains, chi_squared: dict[tuple[str, str], float], patch: pytest.MonkeyPatch) -> Ranked:
    """The best chain after exchanges from the first of these, the others being what fits would find."""

    def fit(_: object, first: Ranked, second: Ranked, *, exchanged: bool = True) -> None:
        assert exchanged
        names = (first.effect, second.effect)
        found = chi_squared.get(names, chi_squared.get(names[::-1], 0.0))
        search.found[fitted_chains.names_of(*names)] = replace(alone("", found), effects=names)

    patch.setattr(chains._Chains, "price_of", lambda *_: 2.0)
    patch.setattr(chains._Chains, "seconds_beside", lambda search, other: search.seconds.get(other, []))
    patch.setattr(chains._Chains, "fit", fit)
    search.reference = cast("Any", SimpleNamespace(users=()))
    fit(None, *(Ranked(effects=(name,), score=None, not_testable=None) for name in next(iter(chi_squared))))
    search.exchange_halves()
    return search.best


def test_halves_of_a_chain_that_came_of_an_exchange_are_exchanged_too(monkeypatch: pytest.MonkeyPatch) -> None:
    """A damping took the place of a gyroscopic hub; beside it a lag of the servos, the truth, was not asked."""
    gyro, servo = alone("gyro_lag", 2218.0), alone("servo_lag", 2218.0)
    damping, hub = alone("angular_damping", 500.0), alone("hub_gyroscopics", 600.0)
    search = search_of(False, gyro, servo, damping, hub)
    late = (gyro, servo)
    monkeypatch.setattr(exchanged_halves, "do_else", lambda one, other: (one in late) != (other in late))
    monkeypatch.setattr(fitted_chains, "twins", lambda one, other: one in late and other in late)
    found = {
        ("gyro_lag", "hub_gyroscopics"): 2826.0,
        ("gyro_lag", "angular_damping"): 2835.0,
        ("servo_lag", "angular_damping"): 2836.0,
    }
    assert set(exchanged(search, found, monkeypatch).effects) == {"servo_lag", "angular_damping"}


def test_a_dead_band_is_asked_where_play_is_half_of_the_best_chain(monkeypatch: pytest.MonkeyPatch) -> None:
    """Beside a filter both scored little, and play was never held against a dead band that explained more."""
    search = search_of(False, alone("gyro_filter", 979.0), alone("transport_delay", 975.0))
    monkeypatch.setattr(exchanged_halves, "do_else", lambda *_: True)
    found = {("gyro_filter", "servo_backlash"): 1032.0, ("gyro_filter", "servo_deadband"): 1073.0}
    assert set(exchanged(search, found, monkeypatch).effects) == {"gyro_filter", "servo_deadband"}
    assert not search.rests_as("servo_rate_limit"), "a limit is none of the two"


@pytest.mark.parametrize(("left", "tried"), [(10.0, False), (52.0, True), (400.0, False)])
def test_a_dead_band_is_asked_before_a_chain_that_leaves_much_is_given_up(
    left: float, tried: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Play beside a tether explained 0.84, a dead band of half the width, which was there, 0.91."""
    tether = alone("attitude_stiffness", 123.0, ("L_phi",))
    search, fitted = search_of(False, tether), list[str]()
    chain = replace(alone("", 274.0, ("L_phi",)), effects=("attitude_stiffness", "servo_backlash"))

    def begin(_: object, __: Ranked) -> bool:
        search.found[("attitude_stiffness", "servo_backlash")] = chain
        return True

    monkeypatch.setattr(chains, "misfit", lambda _: left)
    monkeypatch.setattr(chains._Chains, "begin_with", begin)
    monkeypatch.setattr(chains._Chains, "leaves_noise", lambda *_: False)
    monkeypatch.setattr(chains._Chains, "halves_of_the_best", lambda *_: [])
    monkeypatch.setattr(chains._Chains, "improve", lambda _: None)
    monkeypatch.setattr(chains._Chains, "fit", lambda _, first, second, **__: fitted.append(second.effect))
    assert search.search([tether])
    assert fitted == (["servo_deadband"] if tried else [])


def test_what_promised_as_much_and_was_not_fitted_alone_takes_a_half_s_place(monkeypatch: pytest.MonkeyPatch) -> None:
    """A damping of rates left noise, so one of their squares was not asked; beside a limit it was the truth."""
    limit, damping = alone("servo_saturation", 512.0), alone("angular_damping", 447.0)
    scores = {"servo_saturation": 95.0, "angular_damping": 73.0, "quadratic_damping": 109.0, "lead_lag": 80.0}
    search, fitted = search_of(False, limit, damping), list[str]()
    search.scored = {name: scored(name, size).score for name, size in scores.items()}

    def fitted_alone(_: object, one: Ranked) -> Ranked:
        fitted.append(one.effect)
        return alone(one.effect, 504.0)

    monkeypatch.setattr(chains._Chains, "fitted_alone", fitted_alone)
    monkeypatch.setattr(exchanged_halves, "do_else", lambda *_: True)
    found = {("servo_saturation", "angular_damping"): 946.0, ("quadratic_damping", "servo_saturation"): 1022.0}
    assert set(exchanged(search, found, monkeypatch).effects) == {"quadratic_damping", "servo_saturation"}
    assert set(fitted) == {"quadratic_damping"}, "what promised less is not asked"


def test_what_is_dear_takes_the_place_of_a_half_only_where_it_may_be_as_good(monkeypatch: pytest.MonkeyPatch) -> None:
    delay, damping = alone("transport_delay", 2469.0), scored("quadratic_damping", 81.0)
    near, far = alone("lead_lag", 2470.0), alone("servo_lag", 2331.0)
    search = search_of(False, delay, near, far)
    both = ("quadratic_damping", "transport_delay")
    search.found[both] = replace(alone("", 2544.0), effects=both)
    monkeypatch.setattr(chains._Chains, "price_of", lambda *_: fitted_chains.DEAR)
    assert search.not_too_dear(near, "transport_delay", damping)
    assert not search.not_too_dear(far, "transport_delay", damping)
    search.single["quadratic_damping"] = alone("quadratic_damping", 2500.0)
    assert search.not_too_dear(near, "transport_delay", damping), "the half that stays explained more alone"
    monkeypatch.setattr(chains._Chains, "price_of", lambda *_: refits.PRICES["linear"])
    assert search.not_too_dear(far, "transport_delay", damping)


def test_what_is_dear_is_tried_last(monkeypatch: pytest.MonkeyPatch) -> None:
    """By then the best chain may be out of its reach."""
    tried: list[str] = []
    first = replace(alone("servo_lag", 900.0), stepped=cast("Any", object()))
    seconds = [scored("quadratic_damping", 300.0), scored("speed_stability", 200.0)]
    search = search_of(False, first)
    whitening = cast("Any", object())
    search.reference = cast("Any", SimpleNamespace(whitening=whitening, users=(), parent=search.reference.parent))
    begun = SimpleNamespace(asked_in=lambda _: None, division=None)
    first = replace(first, fit=cast("Any", begun))
    dear = {"quadratic_damping": fitted_chains.DEAR}
    monkeypatch.setattr(fitted_chains, "score_effects", lambda *_: seconds)
    monkeypatch.setattr(chains._Chains, "_opposed", lambda *_: False)
    monkeypatch.setattr(chains, "chance_of_noise", lambda *_: -1e3)
    monkeypatch.setattr(chains._Chains, "price_of", lambda _, one, __: dear.get(one.effect, 2.0))
    monkeypatch.setattr(chains._Chains, "fit", lambda _, __, one: tried.append(one.effect))
    assert search.begin_with(first)
    assert tried == ["speed_stability", "quadratic_damping"]


def test_of_what_is_dear_and_alone_alike_the_best_stands_for_all(monkeypatch: pytest.MonkeyPatch) -> None:
    """A filter beside a damping was never reached: a lag, a delay and another lag had spent the budget before it."""
    late = [alone("servo_lag", 3432.0), alone("transport_delay", 3859.0), alone("gyro_filter", 3927.0)]
    inflow = alone("dynamic_inflow", 3600.0)
    search = search_of(False, *late, inflow)
    seconds = [
        *(scored("servo_lag", 2424.0), scored("transport_delay", 2368.0), scored("servo_rate_limit", 1700.0)),
        *(scored("gyro_filter", 1649.0), scored("dynamic_inflow", 967.0)),
    ]
    monkeypatch.setattr(fitted_chains, "do_else", lambda one, other: inflow in (one, other))
    monkeypatch.setattr(chains._Chains, "price_of", lambda *_: fitted_chains.DEAR)
    kinds = [(one.effect, promise.effect) for one, promise in search.of_each_kind(seconds, cast("Any", None))]
    assert kinds == [
        ("gyro_filter", "servo_lag"),
        ("servo_rate_limit", "servo_rate_limit"),
        ("dynamic_inflow", "dynamic_inflow"),
    ]
    monkeypatch.setattr(chains._Chains, "price_of", lambda *_: refits.PRICES["linear"])
    kinds = [(one.effect, promise.effect) for one, promise in search.of_each_kind(seconds, cast("Any", None))]
    assert kinds == [(one.effect, one.effect) for one in seconds], "what costs little is tried itself"


@pytest.mark.parametrize("plausible", [True, False])
def test_what_is_cheaper_so_is_fitted_the_other_way_round_first(
    plausible: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A filter beside a damping is looked for at many corners, each simulated; the damping beside the filter is not."""
    damping, late = alone("quadratic_damping", 900.0), alone("gyro_filter", 800.0)
    tried: list[tuple[str, str]] = []

    def fitted(_: object, first: Ranked, second: Ranked, more: Ranked, begin: Ranked, __: object) -> Ranked:
        tried.append((begin.effect, more.effect))
        return alone("", 1000.0, () if plausible else ("zeta",))

    search = search_of(False, damping, late)
    monkeypatch.setattr(
        chains._Chains, "price_of", lambda _, more, *__: {"quadratic_damping": 25.0, "gyro_filter": 85.0}[more.effect]
    )
    monkeypatch.setattr(chains._Chains, "_fitted", fitted)
    search.fit(damping, scored("gyro_filter", 500.0))
    both = [("gyro_filter", "quadratic_damping"), ("quadratic_damping", "gyro_filter")]
    assert tried == both[: 1 if plausible else 2]
    assert search.left == fitted_chains.BUDGET - (25.0 if plausible else 110.0)
    tried.clear()
    search.fit(late, scored("quadratic_damping", 500.0))
    assert tried[0] == ("gyro_filter", "quadratic_damping")


def test_no_single_refit_takes_most_of_the_budget_and_what_is_left_out_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    mode, damping = alone("structural_mode", 1361.0, ("kappa_roll",)), alone("quadratic_damping", 255.0)
    tried: list[str] = []

    def fitted(_: object, first: Ranked, second: Ranked, more: Ranked, begin: Ranked, __: object) -> Ranked:
        tried.append(more.effect)
        return alone("", 1400.0, ("kappa_roll",))

    search = search_of(False, mode, damping)
    monkeypatch.setattr(
        chains._Chains, "price_of", lambda _, more, *__: 25.0 if more is damping else fitted_chains.DEAREST + 1.0
    )
    monkeypatch.setattr(chains._Chains, "_fitted", fitted)
    search.fit(mode, damping)
    assert tried == ["quadratic_damping"]
    assert search.left == fitted_chains.BUDGET - 25.0
    assert search.unsearched == BudgetSpent((("structural_mode", "quadratic_damping"),))


def test_where_what_stands_for_others_has_no_fit_the_one_that_promised_most_is_tried(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Beside a governor two lags, which stood for one, came out below zero in one axis; that one was the truth."""
    each, one_lag = alone("lag_per_axis", 180.0), scored("gyro_lag", 189.0)
    begun = SimpleNamespace(asked_in=lambda _: None, division=None)
    governor = replace(alone("governor", 1800.0), stepped=cast("Any", object()), fit=cast("Any", begun))
    search = search_of(False, governor, each)
    search.reference = cast("Any", SimpleNamespace(whitening=None, users=()))
    tried: list[str] = []

    def fit(_: object, first: Ranked, second: Ranked) -> None:
        tried.append(second.effect)
        if second.effect in has_a_fit:
            search.found[fitted_chains.names_of(first.effect, second.effect)] = second

    monkeypatch.setattr(fitted_chains, "score_effects", lambda *_: [one_lag])
    monkeypatch.setattr(chains._Chains, "_opposed", lambda *_: False)
    monkeypatch.setattr(chains, "misfit", lambda _: 0.0)
    monkeypatch.setattr(chains, "chance_of_noise", lambda *_: -1e3)
    monkeypatch.setattr(chains._Chains, "price_of", lambda *_: fitted_chains.DEAR)
    monkeypatch.setattr(chains._Chains, "promising", lambda *_: True)
    monkeypatch.setattr(chains._Chains, "of_each_kind", lambda *_: [(each, one_lag)])
    monkeypatch.setattr(chains._Chains, "fit", fit)
    has_a_fit = {"gyro_lag"}
    assert search.begin_with(governor)
    assert tried == ["lag_per_axis", "gyro_lag"]
    search.found.clear()
    tried.clear()
    has_a_fit = {"lag_per_axis"}
    assert search.begin_with(governor)
    assert tried == ["lag_per_axis"]


def test_what_the_budget_does_not_reach_is_told_once() -> None:
    """Exchange after exchange asks for it."""
    lag = replace(alone("gyro_lag", 360.0), stepped=cast("Any", object()))
    search = search_of(False, lag)
    search.left = 0.0
    assert search.ask_beside(lag) is None
    assert search.ask_beside(lag) is None
    assert search.unsearched == BudgetSpent((), ("gyro_lag",), interrupted=False)


@pytest.mark.parametrize(
    ("beside", "more", "by_score"),
    [
        ("quadratic_damping", "servo_rate_limit", True),
        ("quadratic_damping", "dynamic_inflow", True),
        ("servo_rate_limit", "quadratic_damping", False),
        ("servo_lag", "servo_rate_limit", False),
    ],
)
def test_beside_what_is_simulated_in_time_a_limit_begins_where_its_score_was(
    beside: str, more: str, by_score: bool
) -> None:
    """A look from every size there is cost more than any refit may, and a limit was never tried beside a damping."""
    asked = scored(more, 500.0)
    both = compose("tpp", [beside, more])
    assert refits.goes_by_its_score(asked, both, ()) == by_score
    assert not refits.goes_by_its_score(replace(asked, score=None), both, ())
