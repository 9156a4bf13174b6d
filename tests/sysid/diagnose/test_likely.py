"""The class that an answer declares, and how sure answers are: of made-up candidates."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from sysid.diagnose import candidates, choice, likely
from sysid.diagnose.candidates import SIGNIFICANT, Ranked
from sysid.diagnose.confidence import (
    CHAIN_RIGHT,
    CHAIN_TOLD,
    COMPLETE_RIGHT,
    UNEXPLAINED_RIGHT,
    VETO_RIGHT,
    leaves_more,
    of_chain,
    of_complete,
    of_named,
    of_single,
    of_unexplained,
)
from sysid.diagnose.evidence import Candidate, Stepped
from sysid.diagnose.likely import declared, near
from sysid.model.effect import catalogue, named_effect
from sysid.model.relaxation import RelaxationError

N = 40
CHI_SQUARED = 1e4
"""Of the winner."""
NOTHING_ON_SAMPLES = SimpleNamespace(structure=SimpleNamespace(composed=[]))
LOGGED = cast(Candidate, SimpleNamespace(division=SimpleNamespace(measured=True), model=NOTHING_ON_SAMPLES))
"""A fit to runs whose excitation is logged,"""
IN_A_LOOP = cast(Candidate, SimpleNamespace(division=SimpleNamespace(measured=False), model=NOTHING_ON_SAMPLES))
"""and to some where none is."""


@pytest.fixture(autouse=True)
def plain(monkeypatch: pytest.MonkeyPatch) -> None:
    """Nothing is left, and no parameter promises anything."""
    monkeypatch.setattr(likely, "misfit", lambda *_: 0.0)
    monkeypatch.setattr(choice, "misfit", lambda *_: 0.0)
    monkeypatch.setattr(likely, "promised", lambda *_: 0.0)
    monkeypatch.setattr(choice, "_unusual", lambda one: (bool(one.implausible), 0.0))
    monkeypatch.setattr(Ranked, "names", property(lambda one: ("x",) * one.added))


def refitted(name: str, behind: float = 0.0, direction: int = 0, **also: object) -> Ranked:
    """A candidate so far behind the winner in chi squared, whose prediction is off in a direction of its own."""
    imposed, residual = np.zeros(N), np.zeros(N)
    imposed[direction] = residual[direction + N // 2] = math.sqrt(abs(behind))
    residual[direction] = -imposed[direction]
    residual[:] = imposed  # what it predicts too little is left
    values = {"chi_squared": CHI_SQUARED - behind, "added": 1, "fit": LOGGED, **also}
    return Ranked(
        effects=(name,),
        score=None,
        not_testable=None,
        stepped=Stepped(residual=residual, imposed=-imposed, J=np.zeros((0, N)), Z=np.zeros((0, N))),
        rows=N,
        **values,  # type: ignore[arg-type]
    )


def of(winner: Ranked, others: Sequence[Ranked]) -> likely.Class:
    return declared(winner, [winner, *others])


def test_what_is_far_behind_is_not_in_the_class() -> None:
    lag = refitted("servo_lag")
    found = of(lag, [refitted("transport_delay", 4.0, 1), refitted("servo_backlash", 60.0, 2)])
    assert found.alike == ("transport_delay",)
    assert near(lag, [refitted("transport_delay", 4.0, 1), refitted("servo_backlash", 60.0, 2)]) == {"transport_delay"}
    assert found.named == pytest.approx(1 / (1 + math.exp(-2 / likely.TEMPER)), abs=1e-3)
    assert found.right == found.whole > 0.97


def test_entries_that_predict_the_same_are_one() -> None:
    lag = refitted("servo_lag")
    found = of(lag, [refitted("gyro_lag"), refitted("transport_delay", 4.0, 1), refitted("gyro_filter", 4.0, 1)])
    assert found.alike == ("transport_delay",)
    assert found.equivalent == {"servo_lag": ("gyro_lag",), "transport_delay": ("gyro_filter",)}


def test_what_contains_an_entry_and_does_not_pay_for_what_it_has_more_is_no_other_answer() -> None:
    lag, lags = refitted("gyro_lag"), {"added": 2}
    found = of(lag, [refitted("servo_lag"), refitted("lag_per_axis", 3.0, 1, **lags)])
    assert found.alike == ()
    assert found.equivalent == {"gyro_lag": ("servo_lag", "lag_per_axis")}
    assert of(lag, [refitted("lag_per_axis", 3.0, 1, **lags)]).equivalent == {"gyro_lag": ("lag_per_axis",)}
    delay = refitted("transport_delay")
    assert of(delay, [refitted("lag_per_axis", 3.0, 1, **lags)]).alike == ("lag_per_axis",)  # of that it contains none
    paying = refitted("lag_per_axis", 0.0, 1, **lags)
    assert of(paying, [refitted("servo_lag", 3.0, 2)]).alike == ("servo_lag",)
    assert of(paying, [refitted("servo_lag", 3.0, 2)]).equivalent == {}


def test_entries_of_the_same_equations_are_one_answer_where_fits_stopped_apart() -> None:
    lag = refitted("servo_lag")
    poles = refitted("servo_second_order")
    near, far = refitted("gyro_filter", 6.0, 1), refitted("gyro_filter", 40.0, 1)
    assert of(lag, [poles, near]).equivalent == {"servo_lag": ("servo_second_order", "gyro_filter")}
    assert of(lag, [poles, far]).equivalent == {"servo_lag": ("servo_second_order",)}
    assert of(lag, [near]).equivalent == {}


def test_of_many_alike_only_the_one_named_counts() -> None:
    lag = refitted("servo_lag")
    few = of(lag, [refitted(f"other {i}", 2.0, i) for i in range(1, 3)])
    many = of(lag, [refitted(f"other {i}", 2.0, i) for i in range(1, 6)])
    assert len(few.alike) == 2
    assert len(many.alike) == 5
    assert few.right > 0.97
    assert many.right == many.named < 0.4
    assert of_named(3.0, 0.0, many) < 0.4 < 0.9 < of_named(3.0, 0.0, few)


def test_of_four_as_likely_three_are_declared_and_the_fourth_makes_less_sure() -> None:
    found = of(refitted("servo_lag"), [refitted(f"late {i}", 2.0, i) for i in (1, 2, 3)])
    assert len(found.alike) == 2
    assert found.right == pytest.approx(0.80, abs=0.01)


def test_a_single_name_is_told_less_modestly_and_no_surer_than_its_class() -> None:
    lag = refitted("servo_lag")
    one, many = of(lag, []), of(lag, [refitted(f"late {i}", 2.0, i) for i in range(1, 6)])
    assert of_named(0.5, 0.0, one) < 0.6 < 0.94 < of_single(0.5, 0.0, one, excited=True) < 0.965
    assert of_single(9.0, 0.0, one, excited=True) == pytest.approx(of_named(9.0, 0.0, one), abs=1e-3)
    assert of_single(9.0, 0.0, many, excited=True) <= many.right < 0.4


def test_where_no_excitation_is_logged_a_name_is_told_less_sure() -> None:
    lag = of(refitted("servo_lag"), [])
    assert of_single(0.0, 0.0, lag, excited=False) < 0.6 < 0.85 < of_single(0.0, 0.0, lag, excited=True)
    assert of_single(1.5, 0.0, lag, excited=False) < 0.96 < 0.98 < of_single(1.5, 0.0, lag, excited=True)
    assert of_single(9.0, 0.0, lag, excited=False) > 0.99  # what is far ahead of all others stays sure


def test_a_chain_is_told_surer_where_an_excitation_is_logged() -> None:
    """A lag in a rotor that changes its speed, right and told 0.45 before, is named with an excitation logged."""
    alone = of(refitted("servo_lag"), [])
    for lead, named in ((0.9, (False, True)), (1.1, (False, True)), (0.4, (False, False)), (2.5, (True, True))):
        told = [of_chain(lead, 0.0, alone, excited=excited) for excited in (False, True)]
        assert (told[0] >= CHAIN_TOLD, told[1] >= CHAIN_TOLD) == named
    assert of_chain(9.0, 0.0, alone, excited=True) <= CHAIN_RIGHT


def test_a_name_that_explains_little_by_any_measure_is_told_less() -> None:
    """Servos that no time constant fits, called a mode that explains 56 % by power (0.93 was said), and others, are
    told less; what is far ahead of all others stays sure."""
    one = of(refitted("lead_lag"), [])
    told = [of_single(1.5, left, one, excited=True) for left in (0.0, 0.2, 0.44, 1.0)]
    assert told == sorted(told, reverse=True)
    assert told[0] > 0.97 > told[2] > 0.95 > 0.86 > told[3]
    assert of_single(4.5, 1.0, one, excited=True) > 0.99


def test_a_long_tail_of_unlikely_ones_is_left_out_and_makes_less_sure() -> None:
    lag = refitted("servo_lag")
    likelier, tail = [refitted(f"near {i}", 1.5, i) for i in (1, 2)], [refitted(f"far {i}", 9.0, i) for i in (3, 4)]
    found = of(lag, [*likelier, *tail])
    assert set(found.alike) == {"near 1", "near 2"}
    assert 0.85 < found.right < 0.97


def test_an_implausible_rival_is_in_no_class() -> None:
    lag = refitted("servo_lag")
    assert of(lag, [refitted("transport_delay", 1.0, 1, implausible=("T_d",))]).alike == ()


def test_where_samples_of_commands_are_lost_play_and_a_dead_band_are_one_answer(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(Ranked, "own", property(lambda one: tuple(catalogue()[name] for name in one.effects)))
    play, band = refitted("servo_backlash"), refitted("servo_deadband", CHI_SQUARED / 2, 1)
    lag, weak = refitted("servo_lag", CHI_SQUARED / 2, 2), refitted("servo_saturation", 0.9 * CHI_SQUARED, 3)
    others = [play, band, lag, weak]
    told = declared(play, others)
    assert told.alike == ()
    assert likely.where_samples_are_lost(told, play, others).alike == ("servo_deadband",)
    assert likely.where_samples_are_lost(told, play, others, share=0.6).alike == ()
    full = replace(told, alike=("servo_lag", "gyro_filter"))
    assert likely.where_samples_are_lost(full, play, others).alike == full.alike, "more would be of no use"
    impossible = replace(band, implausible=("backlash",))
    assert likely.where_samples_are_lost(told, play, [play, impossible]).alike == ()
    assert likely.where_samples_are_lost(told, lag, others).alike == ()  # a lag does not hang on samples


def test_where_samples_are_lost_they_are_one_answer_beside_another_effect_too(monkeypatch: pytest.MonkeyPatch) -> None:
    """Gyros that lag beside a dead band in a log of every second sample were named beside play; either way half of what
    the lag leaves is explained."""
    monkeypatch.setattr(Ranked, "own", property(lambda one: tuple(catalogue()[name] for name in one.effects)))

    def chain(half: str, chi_squared: float, implausible: tuple[str, ...] = ()) -> Ranked:
        fit = refitted("gyro_lag", chi_squared=chi_squared, implausible=implausible)
        return replace(fit, effects=("gyro_lag", half))

    lag, play = refitted("gyro_lag", chi_squared=4000.0), chain("servo_backlash", 7000.0)
    told = declared(play, [play])
    for band, alike in (
        (chain("servo_deadband", 5100.0), ("servo_deadband",)),
        (chain("servo_deadband", 4900.0), ()),  # too little beside what the lag does alone
        (chain("servo_deadband", 5100.0, implausible=("width",)), ()),
        (chain("inertia_coupling", 6900.0), ()),  # hangs on no samples
        (replace(chain("servo_deadband", 6900.0), effects=("servo_lag", "servo_deadband")), ()),  # beside another
    ):
        assert likely.where_samples_are_lost(told, play, [lag], [play, band]).alike == alike
    doubtful = replace(play, implausible=("tau_g",))
    band = chain("servo_deadband", 5100.0, implausible=("tau_g",))
    assert likely.where_samples_are_lost(told, doubtful, [lag], [doubtful, band]).alike == ("servo_deadband",)
    band = replace(chain("servo_deadband", 5100.0), effects=("servo_lag", "servo_deadband"))
    by_another_name = replace(told, equivalent={"gyro_lag": ("servo_lag",)})
    assert likely.where_samples_are_lost(by_another_name, play, [lag], [play, band]).alike == ("servo_deadband",)


@pytest.mark.parametrize(
    ("other_half", "told"),
    [("servo_backlash", {"servo_lag": ("gyro_lag",)}), ("input_coupling", {"servo_lag": ("gyro_lag",)}),
     ("quadratic_damping", {})],
)  # fmt: skip
def test_what_is_one_alone_is_one_in_a_chain_too_wherever_its_fit_ended(
    other_half: str, told: dict[str, tuple[str, ...]], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Beside play a lag of the gyros, the truth, had ended at another half-width than one of the servos."""
    monkeypatch.setattr(Ranked, "own", property(lambda one: tuple(catalogue()[name] for name in one.effects)))
    chain = replace(refitted("servo_lag"), effects=("servo_lag", other_half))
    lag, gyro, delay = refitted("servo_lag", 50.0), refitted("gyro_lag", 50.0), refitted("transport_delay", 50.0, 1)
    found = declared(chain, [chain])
    assert likely.with_twins(found, chain, [lag, gyro, delay]).equivalent == told
    impossible, most = replace(gyro, implausible=("tau_g",)), catalogue()["gyro_lag"].parameters[0].plausible[1]
    for off, error in ((2.0, 0.0), (2.0, 0.9), (0.5, 0.0)):  # beside the other half it may be what a twin is
        at = {"model": {"tau_s": off * most}, "standard_errors": {"tau_s": error * most}}
        there = replace(chain, fit=cast(Candidate, SimpleNamespace(division=LOGGED.division, **at)))
        assert likely.with_twins(found, there, [lag, impossible]).equivalent == (told if off < 1 or error else {})
    assert likely.with_twins(declared(lag, [lag]), lag, [lag, gyro]).equivalent == {}, "of a single one fits tell"


def test_what_the_search_had_no_time_for_is_as_good_beside_another_half_as_alone() -> None:
    """Beside a damping of squared rates servos of second order were fitted, and a filter of the gyros, which alone is
    the same and was the truth, was not."""

    def chain(name: str, behind: float = 0.0) -> Ranked:
        return replace(refitted(name, behind), effects=(name, "quadratic_damping"))

    servos, filtered = refitted("servo_second_order"), refitted("gyro_filter", 0.5)
    damping, other = refitted("quadratic_damping", 0.8 * CHI_SQUARED, 1), refitted("lead_lag", -0.5 * CHI_SQUARED, 2)
    winner = chain("servo_second_order")
    found = declared(winner, [winner])

    def alike(singles: list[Ranked], chains: list[Ranked], among: likely.Class = found) -> tuple[str, ...]:
        return likely.with_unasked(among, winner, singles, chains).alike

    every = [servos, filtered, other, damping]
    assert alike(every, [winner]) == ("gyro_filter",)
    assert alike(every, [winner, chain("gyro_filter", 60.0)]) == (), "fits told it"
    assert alike([servos, replace(filtered, implausible=("zeta",)), damping], [winner]) == ()
    assert alike([servos, refitted("gyro_filter", 3.0), damping], [winner]) == (), "less likely alone"
    assert alike([servos, refitted("gyro_filter", 0.5, 3), damping], [winner]) == ("gyro_filter",)
    assert likely.with_unasked(declared(servos, [servos]), servos, every, []).alike == (), "of a single one fits tell"
    # beside one of the class, too; but no longer lists than are of use
    delay = refitted("transport_delay", 40.0)
    told = replace(found, alike=("transport_delay",))
    late = [delay, refitted("servo_lag", 40.0), refitted("gyro_lag", 40.0)]
    assert alike([servos, *late], [winner, chain("transport_delay", 5.0)], told) == ("transport_delay", "servo_lag")
    assert alike([servos, *late], [winner], told) == ("transport_delay",), "that it stands there no chain says"


def test_a_likelier_rival_of_doubtful_values_hides_no_other() -> None:
    lag, other = refitted("gyro_lag", 30.0), refitted("gyro_filter", 31.0, 2)
    inflow = refitted("dynamic_inflow", 0.0, 1)
    assert "gyro_filter" not in of(lag, [other, inflow]).alike
    doubtful = replace(inflow, outside=("k_l",))
    assert set(of(lag, [other, doubtful]).alike) == {"gyro_filter", "dynamic_inflow"}
    # beside an answer of doubtful values it is one as any
    assert "gyro_filter" not in of(replace(lag, outside=("tau_g",)), [other, doubtful]).alike


def test_what_is_left_makes_differences_count_less(monkeypatch: pytest.MonkeyPatch) -> None:
    lag, delay = refitted("servo_lag"), refitted("transport_delay", 30.0, 1)
    assert of(lag, [delay]).alike == ()
    monkeypatch.setattr(likely, "misfit", lambda *_: 100.0)
    assert of(lag, [delay]).alike == ("transport_delay",)


def test_unexplained_is_as_sure_as_there_is_something() -> None:
    sure = [of_unexplained(None, SIGNIFICANT - beyond, 0.0) for beyond in (0.0, 3.0, 30.0)]
    assert sure[0] < 0.5 < sure[1] < sure[2] == pytest.approx(UNEXPLAINED_RIGHT, abs=0.01)


@pytest.mark.parametrize(
    ("chi_squared", "least", "most"),
    [(480.0, VETO_RIGHT - 0.01, VETO_RIGHT + 0.01), (900.0, UNEXPLAINED_RIGHT - 0.01, UNEXPLAINED_RIGHT)],
)
def test_unexplained_is_as_sure_as_the_likeliest_leaves_something(
    chi_squared: float, least: float, most: float
) -> None:
    fit = SimpleNamespace(division=SimpleNamespace(chi_squared=chi_squared, degrees=480))
    winner = refitted("servo_lag", fit=fit)
    assert least <= of_unexplained(winner, -100.0, 0.0) <= most


def test_luck_does_not_name_what_the_runs_could_tell() -> None:
    """Two as likely by chance, which predict what is far apart: no usual size decides."""
    lag, other = refitted("servo_lag"), refitted("servo_rate_limit", 0.0, 1)
    usual = choice._stands_beside
    assert usual(other, lag, 0.5, 1.0, 10.0)
    assert not usual(other, lag, 0.5, 16.0, 10.0)


def test_a_simpler_entry_explains_as_much_only_with_as_much_evidence() -> None:
    bar = refitted("stabiliser_bar", 0.0, 0, added=2, explained_share=1.0, outside=("tau_b",))
    as_good = refitted("servo_lag", 500.0, 1, explained_share=1.0)
    crumb = refitted("servo_lag", CHI_SQUARED - 5.0, 1, explained_share=1.0)
    assert choice._explains_as_much(as_good, bar, ())
    assert not choice._explains_as_much(crumb, bar, ())
    for behind, named in ((9.0, True), (11.0, False)):  # a number less is worth 3.7 of these 40 rows
        less = refitted("servo_lag", behind, 1, explained_share=0.8)
        assert choice._explains_as_much(less, bar, ()) == named, "of its power, where evidence tells them apart"
    contradicted = replace(refitted("servo_lag", 9.0, 1, explained_share=0.8), validation_share=0.1)
    assert not choice._explains_as_much(contradicted, bar, ())


def test_in_a_loop_more_evidence_makes_an_answer() -> None:
    for fit, bic, named in ((LOGGED, -7.0, True), (IN_A_LOOP, -7.0, False), (IN_A_LOOP, -16.0, True)):
        wing = refitted("slipstream_wing", fit=fit, chi_squared=math.log(N) - bic, explained_share=1.0)
        assert (choice.winner([wing], []) is wing) == named


def test_beside_an_implausible_half_the_simpler_of_two_others_is_named_and_what_is_like_it_declared() -> None:
    stiff = ("M_theta",)
    also = {"explained_share": 1.0, "implausible": stiff, "added": 3}
    filtered = refitted("gyro_filter", 0.0, 0, **{**also, "added": 4, "outside": ("M_theta", "zeta")})
    lag = refitted("servo_lag", 6.0, 1, **also, outside=stiff)
    late = refitted("transport_delay", 7.0, 2, **also, outside=stiff)
    worse = refitted("slipstream_wing", 2.0, 3, **{**also, "implausible": ("tau_w",), "outside": ("tau_w",)})
    assert choice.winner([refitted("servo_backlash", 0.5 * CHI_SQUARED)], [filtered, worse, lag]) is lag
    assert set(of(lag, [filtered, late, worse]).alike) == {"gyro_filter", "transport_delay"}


def test_a_chain_is_named_before_one_effect_that_only_stands_in_for_it() -> None:
    bar = refitted("stabiliser_bar", 30.0, 0, explained_share=1.0, added=3, implausible=("tau_b",))
    both = replace(
        refitted("servo_lag", 0.0, 1, explained_share=1.0, added=3), effects=("hub_gyroscopics", "servo_lag")
    )
    assert choice.winner([bar], [both]) is both
    bar = replace(bar, implausible=())
    assert choice.winner([bar], [both]) is bar, "as plausible, and simpler"


def test_a_chain_that_is_much_likelier_explains_clearly_more_where_powers_do_not_show_it() -> None:
    one = refitted("attitude_stiffness", 0.12 * CHI_SQUARED, 0, explained_share=0.99)
    both = replace(
        refitted("servo_lag", 0.0, 1, explained_share=1.0, added=2), effects=("attitude_stiffness", "servo_lag")
    )
    assert choice.winner([one], [both]) is both
    assert choice.winner([replace(one, chi_squared=0.98 * CHI_SQUARED)], [both]) is not both
    assert choice.winner([one], [replace(both, outside=("k_l",))]) is one, "by doubtful values"


def test_in_a_loop_powers_tell_nothing_that_is_hardly_likelier() -> None:
    """Late motors whose fit left more power than without; beside a delay of nearly nothing it left less."""
    also = {"explained_share": 0.2, "added": 2}
    motors = refitted("motor_lag", 8.0, 0, explained_share=0.0, fit=IN_A_LOOP)
    late = refitted("servo_lag", 9.0, 2, explained_share=0.2, fit=IN_A_LOOP)
    both = replace(refitted("transport_delay", 0.0, 1, fit=IN_A_LOOP, **also), effects=("motor_lag", "transport_delay"))
    assert choice.winner([motors, late], [both]) is motors
    likelier = replace(both, chi_squared=1.02 * CHI_SQUARED)
    assert choice.winner([motors], [likelier]) is likelier
    motors, late, both = (replace(one, fit=LOGGED) for one in (motors, late, both))
    assert choice.winner([motors], [both]) is both, "no gusts in what the excitation explains"
    assert choice.winner([motors, late], []) is late


def test_of_what_may_stand_for_an_implausible_one_the_likeliest_counts(monkeypatch: pytest.MonkeyPatch) -> None:
    """How far behind that any of them may be tells nothing of which it is."""
    monkeypatch.setattr(choice, "misfit", lambda *_: 300.0)
    monkeypatch.setattr(
        choice, "_unusual", lambda one: (bool(one.implausible), 3.0 if one.effect == "motor_lag" else 0)
    )
    gyros = refitted("gyro_lag", 0.0, 0, explained_share=1.0, implausible=("tau_g",))
    motors = refitted("motor_lag", 0.0, 0, explained_share=1.0)
    late = refitted("transport_delay", 400.0, 1, explained_share=1.0)
    assert choice.winner([gyros, motors, late], []) is motors
    assert choice.winner([gyros, motors, replace(late, stepped=motors.stepped)], []).effect == "transport_delay"


def test_of_two_the_likelier_half_is_named_though_another_has_fewer_numbers() -> None:
    lag = refitted("servo_lag", 0.05 * CHI_SQUARED, 0, explained_share=0.93)
    damped = replace(
        refitted("angular_damping", 0.0, 1, explained_share=1.0, added=3, outside=("M_q",)),
        effects=("servo_lag", "angular_damping"),
    )
    crumb = replace(
        refitted("servo_rate_limit", 0.04 * CHI_SQUARED, 2, explained_share=0.97, added=2),
        effects=("servo_lag", "servo_rate_limit"),
    )
    assert choice.winner([lag], [damped, crumb]) is damped


def test_of_two_a_simpler_half_is_named_that_adds_as_much_to_the_other() -> None:
    coupled = refitted("input_coupling", 0.7 * CHI_SQUARED, 0, explained_share=0.4)

    def beside(name: str, behind: float, number: int, **more: Any) -> Ranked:
        other = refitted(name, behind * CHI_SQUARED, number, explained_share=1.0, **more)
        return replace(other, effects=("input_coupling", name))

    inflow = beside("dynamic_inflow", 0.0, 1, added=6, outside=("k_l",))
    lag, mode = beside("servo_lag", 0.03, 2, added=5), beside("structural_mode", 0.2, 3, added=5)
    assert choice.winner([coupled], [inflow, lag]) is lag
    assert choice.winner([coupled], [replace(inflow, outside=()), lag]) is not lag, "nothing of it is doubtful"
    assert choice.winner([coupled], [inflow, mode]) is inflow, "what it adds is less"
    assert choice.winner([refitted("servo_lag", 0.5 * CHI_SQUARED)], [inflow, lag]) is inflow, "the half is not known"
    other = replace(lag, effects=("servo_lag", "servo_backlash"))
    assert choice.winner([coupled], [inflow, other]) is inflow, "another pair"


def test_what_explains_all_is_named_before_what_is_likelier_by_a_hair() -> None:
    lag = refitted("gyro_lag", 0.0, 0, explained_share=0.02)
    inflow = refitted("dynamic_inflow", 6.0, 1, explained_share=1.0, added=2)
    far = refitted("servo_backlash", 40.0, 2, explained_share=1.0)
    assert choice.winner([lag, inflow, far], []) is inflow
    assert choice.winner([lag, far], []) is lag


def test_what_validation_runs_confirm_is_named_before_what_is_likelier_by_a_hair_and_contradicted() -> None:
    """Play that a dead band of twice its width nearly is: 4 of chi squared 1981 likelier, at 0.1 of what can be
    explained on the validation runs."""
    band = refitted("servo_deadband", 0.0, 0, explained_share=0.997, validation_share=0.1, validation_slack=0.13)
    play = refitted("servo_backlash", 4.0, 1, explained_share=1.0, validation_share=1.0, added=2)
    far = refitted("stabiliser_bar", 40.0, 2, explained_share=1.0, validation_share=1.0)
    assert choice.winner([band, play, far], []) is play
    assert choice.winner([replace(band, validation_slack=0.5), play], []) is not play, "by chance alone"
    assert choice.winner([band, far], []) is band, "surely told apart"
    assert choice.winner([band, replace(play, validation_share=0.2)], []) is band, "no better"


@pytest.mark.parametrize(
    ("left", "of", "more"),
    [(144.0, 2500.0, True), (60.0, 730.0, False), (81.0, 11_000.0, False), (76.0, 880.0, True)],
    ids=["servos that no lag fits", "within chance", "nearly all", "a lag and a limit"],
)
def test_a_chain_that_surely_leaves_much_names_nothing(left: float, of: float, more: bool) -> None:
    """Chi squared beyond 306 degrees that is left, and that is explained, of chains named on strangers."""
    fit = cast(Candidate, SimpleNamespace(division=SimpleNamespace(chi_squared=306.0 + left, degrees=306)))
    assert leaves_more(refitted("servo_lag", fit=fit, chi_squared=of)) == more


def test_powers_tell_play_from_a_dead_band() -> None:
    acting = SimpleNamespace(samples=lambda *_: None, path=None, id="", rests_within=None)

    def on(name: str, shares: tuple[float, float], behind: float = 0.0, measured: bool = True) -> Ranked:
        effect = SimpleNamespace(**{**vars(acting), "id": name})
        structure = SimpleNamespace(composed=[effect])
        fit = SimpleNamespace(model=SimpleNamespace(structure=structure), division=SimpleNamespace(measured=measured))
        explained, validated = shares
        return refitted(name, behind, int(behind > 0), fit=fit, explained_share=explained, validation_share=validated)

    play, band = on("servo_backlash", (0.84, 0.64)), on("servo_deadband", (1.0, 0.95), 500.0)
    assert choice.winner([play, band], []) is band
    assert choice.winner([play, on("servo_deadband", (1.0, 0.7), 500.0)], []) is play, "not on validation runs"
    band, play = on("servo_deadband", (1.0, 0.74)), on("servo_backlash", (1.0, 1.0), 23.5)
    assert choice.winner([band, play], []) is play, "both explain all of the fitted runs"
    assert choice.winner([replace(band, validation_slack=0.09), play], []) is play
    assert choice.winner([replace(band, validation_slack=0.14), play], []) is not play, "by chance"
    loop = [on("servo_backlash", (0.84, 0.64), 0.0, False), on("servo_deadband", (1.0, 0.95), 500.0, False)]
    assert choice.winner(loop, []) is loop[0], "feedback makes powers, too"


def test_a_model_without_its_sizes_that_does_not_settle_ends_no_diagnosis(monkeypatch: pytest.MonkeyPatch) -> None:
    def unsettled(*_: object) -> None:
        raise RelaxationError("the response does not settle")

    effect = named_effect("structural_mode", ())
    names = list(effect.names)
    values = np.array([1e-3 if name.startswith("kappa") else 1.0 for name in names])
    model = dict(zip(names, values, strict=True))
    errors = dict.fromkeys(names, 1.0)
    structure = SimpleNamespace(composed=(effect,), names=names)
    one = SimpleNamespace(
        model=_Model(model, structure, values), standard_errors=errors, dataset=SimpleNamespace(stacks=(None,))
    )
    monkeypatch.setattr(candidates, "respond", unsettled)
    assert not candidates._means_nothing(cast(Candidate, one), names[0])


class _Model(dict[str, float]):
    """Values by name."""

    def __init__(self, named: dict[str, float], structure: object, values: np.ndarray) -> None:
        super().__init__(named)
        self.structure, self.values_by_place = structure, values

    @property
    def values(self) -> np.ndarray:  # type: ignore[override]
        return self.values_by_place


def test_what_is_nearly_told_makes_complete_doubtful() -> None:
    sure, nearly, almost = (of_complete(chance, True) for chance in (-0.5, -3.5, SIGNIFICANT + 0.1))
    assert of_complete(-0.5, False) < sure == COMPLETE_RIGHT > nearly > almost == pytest.approx(0.96)
