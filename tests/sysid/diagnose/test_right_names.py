"""Training strangers whose one effect was named wrongly, or not at all."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import pytest
from strangers.asking import ask, fitted_runs
from strangers.flights import fly

from gcs.analysis.text.verdict import _by_the_noise as by_the_noise_words
from sysid.data import preprocess
from sysid.data.band import USUAL
from sysid.data.dataset import prepared
from sysid.diagnose import (
    candidates,
    choice,
    diagnose,
    fitted_chains,
    likely,
    reach,
    refits,
    score,
    shares,
    size_check,
    verdict,
)
from sysid.diagnose.shares import Shares
from sysid.diagnose.unsearched import BudgetSpent
from sysid.diagnose.validated import ByWhatIsNew, validation_of
from sysid.diagnose.verdict import LARGEST_DIFFERENCE, Diagnosis
from sysid.errors import FitError
from sysid.fit.clocks import found_hold
from sysid.fit.estimate import estimate
from sysid.model.paper import TPP
from sysid.model.parameter import Parameter
from sysid.model.structure import Structure

PITCHED_BY_COLLECTIVE = 8029
"""A helicopter of 90 kg whose collective turns it a little, in coloured gusts; every second sample is logged."""
DELAY_AND_COUPLING = 7016
"""A helicopter with a delay and a turning collective, in a loop whose excitation is not logged."""
JUDGED_BY_LITTLE = 4001733
"""A helicopter that its speed turns, whose validation runs are too short to tell how long it keeps its speed."""
LAGGING_BLADES = 8090
"""A helicopter of 90 kg whose blades lag at 4.3 Hz, far below slow gusts of four times the usual."""
TWO_MODES = 7001
"""A small helicopter with modes at 11.9 Hz in roll and 6.4 Hz in pitch."""
TETHERED = 3007
"""A helicopter that its angles push back, as on a tether."""
FAST_SERVOS = 4001905
"""A small helicopter whose servos are 1.3 ms late, by two poles at 211 Hz; every tenth sample is logged."""
SMALL_LAG = 4002042
"""A helicopter whose servos lag by 2.4 ms."""
SLOW_GUSTS_ON_MOTORS = 4001569
"""A quadrotor whose motors lag by 25 ms, in slow gusts that a weak loop answers."""
LIMITED_SERVOS = 4001888
"""A small helicopter in a strong loop whose servos move no faster than 8 1/s."""
ONE_MODE = 4000199
"""A small helicopter with a mode in pitch, at 8.3 Hz."""
LOUD_MODES = 4003647
"""A helicopter with modes at 9.3 and 8.5 Hz, far above gusts in bursts; every fifth sample is logged."""
PLAY_IN_GUSTS = 4020041
"""A helicopter with play of 1.4 % of the command to either side, in gusts of 2.3 times the usual."""
PLAY_BETWEEN_SAMPLES = 4020708
"""A helicopter of 90 kg with play of 0.9 %; every fourth sample is logged."""
LAZY_SERVOS = 4021768
"""A helicopter whose servos run the slower the smaller their error, by its root; asked for a lag and a limit alone."""
SLOW_FILTER = 4005786
"""A helicopter of 90 kg whose gyros are filtered at 12 Hz, in bursts of 2.8 times the usual gusts."""
WAKE_IN_A_LOOP = 4004305
"""A small helicopter with a wing in the wake; no excitation is logged."""
VAGUELY_VALIDATED = 4036006
"""A helicopter in a strong loop whose servos move no faster than 7.13 1/s; validation runs hardly tell how fast."""
LIMIT_IN_A_LOOP = 4004371
"""A helicopter whose servos end at 0.32, which only the fitted runs reach; no excitation is logged."""
MODE_IN_A_LOOP = 4021628
"""A vehicle that bends; its mode in pitch does not show, and no excitation is logged."""
GOVERNOR_IN_A_LOOP = 4021538
"""A helicopter whose governor shows 1.9 times what is detectable, in gusts; no excitation is logged."""
LATE_MOTORS_IN_GUSTS = 4008471
"""A quadrotor whose motors lag by 100 ms, in slow gusts that leave more than it moves."""
GOVERNED_IN_GUSTS = 4024932
"""A helicopter with a governor that explains three quarters of what can be explained by power, and all by the noise."""
ONE_LAG_OF_ALL = 4038815
"""A quadrotor whose motors lag by 25.9 ms."""
DRIFT_IN_A_LOOP = 4038949
"""A helicopter that its speed turns and whose servos have two poles at 38 Hz; no excitation is logged, and every second
sample."""
SHORT_DELAY = 4020686
"""A small helicopter with a delay of 2.7 ms; every fourth sample is logged."""


def asked(seed: int) -> Diagnosis:
    return ask(fly(seed)).first


def beyond_the_sweep(monkeypatch: pytest.MonkeyPatch) -> None:
    """Ask in all of the band, where these logs, which lost samples of the chirps' noise, tell little."""
    monkeypatch.setattr("strangers.asking.swept_band", lambda _: USUAL)


def test_gusts_do_not_hide_that_a_log_thinned_the_commands() -> None:
    flown = fly(PITCHED_BY_COLLECTIVE)
    on = prepared(fitted_runs(flown), (0.0, 15.0))
    bare = estimate(TPP, on.viewed(TPP.inputs), weights="constant").model
    hold = found_hold(bare, on, {}, lambda runs, near: estimate(TPP, runs.viewed(TPP.inputs), near).model)
    assert hold is not None
    early_s = 0.5 * (1 / flown.plan.log_hz - 1 / flown.plan.loop_hz)
    assert hold.what.early_s == pytest.approx(early_s, abs=3 * hold.what.error_s)
    assert hold.loop_s == pytest.approx(1 / flown.plan.loop_hz, abs=6 * hold.what.error_s)


@pytest.mark.thorough
@pytest.mark.usefixtures("only_effects")
@pytest.mark.parametrize("only_effects", [("input_coupling",)], indirect=True)
def test_runs_that_cannot_tell_what_it_explains_do_not_judge_its_size(monkeypatch: pytest.MonkeyPatch) -> None:
    found = asked(PITCHED_BY_COLLECTIVE)
    assert (found.verdict, found.effect) == ("missing", "input_coupling")
    assert found.winner is not None
    assert found.winner.validation_share is None
    monkeypatch.setattr(verdict, "_compared", lambda one, at: verdict.sizes(one.fit, one.effects, at.validation))
    monkeypatch.setattr(size_check, "_as_well", lambda *_: False)
    # a size that differs there would have been a veto; what is left unnamed then matters to no loop
    assert asked(PITCHED_BY_COLLECTIVE).verdict == "complete"


@pytest.mark.thorough
@pytest.mark.usefixtures("only_effects")
@pytest.mark.parametrize("only_effects", [("transport_delay", "servo_lag", "input_coupling")], indirect=True)
def test_in_a_loop_candidates_are_ranked_under_the_noise_of_the_likeliest(monkeypatch: pytest.MonkeyPatch) -> None:
    """Not under that of what leaves least power, which was the coupling alone."""
    assert set(asked(DELAY_AND_COUPLING).chain) == {"transport_delay", "input_coupling"}
    monkeypatch.setattr(diagnose, "_likelier", lambda *_: None)
    assert set(asked(DELAY_AND_COUPLING).chain) == {"servo_lag", "input_coupling"}


@pytest.mark.thorough
@pytest.mark.usefixtures("only_effects")
@pytest.mark.parametrize("only_effects", [("lead_lag", "gyro_filter")], indirect=True)
def test_a_narrow_mode_far_below_the_gusts_is_fitted_by_the_noise(monkeypatch: pytest.MonkeyPatch) -> None:
    """Where least squares by constant weights went after the gusts, and ended without any of it."""
    assert asked(LAGGING_BLADES).effect == "lead_lag"
    beyond_the_sweep(monkeypatch)
    flown, found = fly(LAGGING_BLADES), asked(LAGGING_BLADES)
    assert (found.verdict, found.effect) == ("missing", "lead_lag")
    assert found.winner is not None
    frequency_hz = flown.hidden.sizes[0]["frequency_lag"]
    assert found.winner.values["frequency_lag"] == pytest.approx(frequency_hz, rel=0.01)
    monkeypatch.setattr(refits, "by_the_noise", lambda *_: None)
    assert asked(LAGGING_BLADES).chain == ("gyro_filter",)


@pytest.mark.thorough
@pytest.mark.usefixtures("only_effects")
@pytest.mark.parametrize("only_effects", [("structural_mode", "angular_damping")], indirect=True)
def test_a_mode_in_pitch_is_looked_for_beside_that_in_roll() -> None:
    flown, found = fly(TWO_MODES), asked(TWO_MODES)
    assert (found.verdict, found.effect) == ("missing", "structural_mode")
    assert found.winner is not None
    for name in ("frequency_roll", "frequency_pitch"):
        assert found.winner.values[name] == pytest.approx(flown.hidden.sizes[0][name], rel=0.02)


@pytest.mark.usefixtures("only_effects")
@pytest.mark.parametrize("only_effects", [("attitude_stiffness", "stabiliser_bar")], indirect=True)
def test_a_tether_is_told_beside_what_is_like_it_in_free_flight() -> None:
    found = asked(TETHERED)
    assert (found.verdict, found.effect) == ("missing", "stabiliser_bar")
    assert found.indistinguishable == ("attitude_stiffness",)


@pytest.mark.thorough
@pytest.mark.usefixtures("only_effects")
@pytest.mark.parametrize("only_effects", [("speed_stability",)], indirect=True)
def test_sizes_that_other_runs_contradict_by_chance_alone_are_no_veto(monkeypatch: pytest.MonkeyPatch) -> None:
    found = asked(JUDGED_BY_LITTLE)
    assert (found.verdict, found.effect) == ("missing", "speed_stability")
    assert found.winner is not None
    assert found.winner.fit is not None
    assert found.validation is not None
    where = (found.winner.fit, found.winner.effects, found.validation)
    assert all(one.off <= LARGEST_DIFFERENCE for one in size_check.sizes(*where))
    # by their standard errors there nothing damps its speed
    monkeypatch.setattr(size_check, "_as_well", lambda *_: False)
    monkeypatch.setattr(Parameter, "sizes", property(lambda _: True))  # what physics does not allow there counts, too
    size_check.sizes.cache_clear()
    worst = size_check.sizes(*where)[0]
    assert worst.parameter.name == "X_u"
    assert worst.off > LARGEST_DIFFERENCE


@pytest.mark.thorough
@pytest.mark.usefixtures("only_effects")
@pytest.mark.parametrize("only_effects", [("gyro_lag", "transport_delay", "servo_second_order")], indirect=True)
def test_a_damping_ratio_that_noise_has_chosen_leaves_a_filter_in_the_class(monkeypatch: pytest.MonkeyPatch) -> None:
    found = asked(FAST_SERVOS)
    assert found.verdict == "missing"
    assert "servo_second_order" in {found.effect, *found.not_told}
    other = next(one for one in found.candidates if one.effects == ("servo_second_order",))
    assert not other.implausible
    assert other.added == 2, "what is held was not known before"
    monkeypatch.setattr(reach, "_held", lambda *_: None)
    again = asked(FAST_SERVOS)
    assert "servo_second_order" not in {again.effect, *again.not_told}


@pytest.mark.usefixtures("only_effects")
@pytest.mark.parametrize("only_effects", [("servo_lag", "transport_delay", "dynamic_inflow")], indirect=True)
def test_inflow_that_would_push_is_no_lateness(monkeypatch: pytest.MonkeyPatch) -> None:
    found = asked(SMALL_LAG)
    assert {found.effect, *found.indistinguishable} == {"servo_lag", "transport_delay"}
    inflow = next(one for one in found.candidates if one.effects == ("dynamic_inflow",))
    assert inflow.values["k_l"] < 0
    assert "k_l" in inflow.implausible
    monkeypatch.setattr(candidates, "of_the_wrong_sign", lambda *_: frozenset())
    assert "dynamic_inflow" in asked(SMALL_LAG).indistinguishable


@pytest.mark.thorough
@pytest.mark.usefixtures("only_effects")
@pytest.mark.parametrize("only_effects", [("motor_lag", "lag_per_axis")], indirect=True)
def test_gusts_that_commands_explain_do_not_keep_a_lag_where_least_squares_left_it() -> None:
    found = asked(SLOW_GUSTS_ON_MOTORS)
    assert (found.verdict, found.effect) == ("missing", "motor_lag")
    assert found.winner is not None
    assert found.winner.values["tau_m"] == pytest.approx(0.02473, rel=0.02)


@pytest.mark.thorough
@pytest.mark.usefixtures("only_effects")
@pytest.mark.parametrize("only_effects", [("servo_rate_limit", "lag_per_axis", "structural_mode")], indirect=True)
def test_a_limit_that_only_a_chain_finds_is_named_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(refits, "_worth_simulating", lambda _: ())  # as where its score promises little
    found = asked(LIMITED_SERVOS)
    assert (found.verdict, found.chain) == ("missing", ("servo_rate_limit",))
    assert found.winner is not None
    assert found.winner.values["rate"] == pytest.approx(7.97, rel=0.05)


@pytest.mark.thorough
@pytest.mark.usefixtures("only_effects")
@pytest.mark.parametrize("only_effects", [("servo_rate_limit",)], indirect=True)
def test_a_limit_that_explains_nearly_all_by_power_is_judged_by_the_noise() -> None:
    found = asked(VAGUELY_VALIDATED)
    assert (found.verdict, found.effect) == ("missing", "servo_rate_limit")
    assert found.winner is not None
    assert found.winner.values["rate"] == pytest.approx(7.13, rel=0.05)


@pytest.mark.thorough
@pytest.mark.usefixtures("only_effects")
@pytest.mark.parametrize("only_effects", [("servo_rate_limit", "lag_per_axis", "structural_mode")], indirect=True)
@pytest.mark.parametrize("ended", [FitError("none"), KeyboardInterrupt()], ids=["fails", "interrupted"])
def test_a_half_that_cannot_be_asked_alone_leaves_its_chain(
    ended: BaseException, monkeypatch: pytest.MonkeyPatch
) -> None:
    real = refits.refit

    def refit(composed: Structure, *of: Any) -> Any:
        if composed.effects == ("servo_rate_limit",):
            raise ended
        return real(composed, *of)

    monkeypatch.setattr(refits, "_worth_simulating", lambda _: ())
    monkeypatch.setattr(refits, "refit", refit)
    found = asked(LIMITED_SERVOS)
    assert "servo_rate_limit" in found.chain
    assert len(found.chain) == 2
    spent = found.unsearched
    assert isinstance(spent, BudgetSpent) == isinstance(ended, KeyboardInterrupt)
    assert not isinstance(spent, BudgetSpent) or spent.interrupted


@pytest.mark.thorough
@pytest.mark.usefixtures("only_effects")
@pytest.mark.parametrize("only_effects", [("structural_mode", "hub_gyroscopics")], indirect=True)
def test_a_little_of_the_other_sign_at_some_frequency_is_no_other_mode() -> None:
    found = asked(ONE_MODE)
    assert (found.verdict, found.effect) == ("missing", "structural_mode")
    assert found.winner is not None
    assert -3 < found.winner.values["kappa_roll"] / found.winner.standard_errors["kappa_roll"] < -2


@pytest.mark.thorough
@pytest.mark.usefixtures("only_effects")
@pytest.mark.parametrize("only_effects", [("structural_mode", "dynamic_inflow")], indirect=True)
def test_a_mode_that_no_burst_makes_is_begun_where_it_explains_most(monkeypatch: pytest.MonkeyPatch) -> None:
    found = asked(LOUD_MODES)
    assert (found.verdict, found.effect) == ("missing", "structural_mode")
    assert found.winner is not None
    assert found.winner.values["frequency_pitch"] == pytest.approx(8.49, rel=0.02)

    def promised() -> float:
        (mode,) = [one for one in asked(LOUD_MODES).candidates if one.effect == "structural_mode"]
        assert mode.score is not None
        return mode.score.chi_squared

    most = promised()
    monkeypatch.setattr(score, "BEYOND_BURSTS", -math.inf)
    monkeypatch.setattr(score, "rows_that_tell_commands", lambda _: None)
    assert promised() < 0.1 * most


@pytest.mark.usefixtures("only_effects")
@pytest.mark.parametrize("only_effects", [("governor",)], indirect=True)
def test_the_noise_has_the_last_word_where_powers_nearly_tell(monkeypatch: pytest.MonkeyPatch) -> None:
    found = asked(GOVERNED_IN_GUSTS)
    assert (found.verdict, found.effect) == ("missing", "governor")
    assert found.explained_share is not None
    assert found.explained_share < shares.EXPLAINED
    (line,) = by_the_noise_words(found)
    assert "90 % or more" in str(line)
    assert by_the_noise_words(replace(found, explained_share=0.95)) == []
    with monkeypatch.context() as patched:
        patched.setattr(Shares, "_by_the_noise", lambda *_, **__: 0.8)
        assert asked(GOVERNED_IN_GUSTS).verdict == "unexplained", "it leaves more than noise"
    monkeypatch.setattr(shares, "NEARLY", shares.EXPLAINED)
    monkeypatch.setattr(shares, "DOUBTFUL", shares.EXPLAINED)
    assert asked(GOVERNED_IN_GUSTS).verdict == "unexplained"


PLAYS = ("servo_backlash", "servo_deadband")


@pytest.mark.thorough
@pytest.mark.usefixtures("only_effects")
@pytest.mark.parametrize("only_effects", [PLAYS], indirect=True)
def test_play_is_named_before_a_dead_band_that_validation_runs_contradict(monkeypatch: pytest.MonkeyPatch) -> None:
    found = asked(PLAY_IN_GUSTS)
    assert (found.verdict, found.effect) == ("missing", "servo_backlash")
    assert found.winner is not None
    assert found.winner.values["half_width"] == pytest.approx(0.0142, rel=0.1)
    monkeypatch.setattr(choice, "contradicted", lambda _: False)
    assert asked(PLAY_IN_GUSTS).effect == "servo_backlash", "it shows plainly more there, too"
    monkeypatch.setattr(choice, "PLAINLY_MORE", math.inf)
    assert asked(PLAY_IN_GUSTS).effect == "servo_backlash", "and foretells more"
    monkeypatch.setattr(choice, "FORETELLS", math.inf)
    likeliest = asked(PLAY_IN_GUSTS)
    assert (likeliest.verdict, likeliest.chain) == ("unexplained", ("servo_deadband",))


@pytest.mark.thorough
@pytest.mark.usefixtures("only_effects")
@pytest.mark.parametrize("only_effects", [PLAYS], indirect=True)
def test_doublets_of_a_thinned_log_do_not_contradict_play(monkeypatch: pytest.MonkeyPatch) -> None:
    found = asked(PLAY_BETWEEN_SAMPLES)
    assert (found.verdict, found.chain) == ("missing", ("servo_backlash",))
    assert found.winner is not None
    assert found.winner.validation_share is not None
    assert found.winner.validation_share > 0.5
    with monkeypatch.context() as patched:
        patched.setattr(choice, "PLAINLY_MORE", math.inf)
        assert asked(PLAY_BETWEEN_SAMPLES).effect == "servo_backlash", "it foretells more, too"
        patched.setattr(choice, "FORETELLS", math.inf)
        assert asked(PLAY_BETWEEN_SAMPLES).effect == "servo_deadband", "likelier by a hair on the fitted runs"
    monkeypatch.setattr(preprocess, "STEP", math.inf)  # a spline through every step
    assert asked(PLAY_BETWEEN_SAMPLES).verdict == "unexplained"


@pytest.mark.thorough
@pytest.mark.usefixtures("only_effects")
@pytest.mark.parametrize("only_effects", [("servo_rate_limit", "lag_per_axis")], indirect=True)
def test_servos_that_no_lag_and_no_limit_fits_are_not_called_both(monkeypatch: pytest.MonkeyPatch) -> None:
    found = asked(LAZY_SERVOS)
    assert (found.verdict, set(found.chain)) == ("unexplained", {"servo_rate_limit", "lag_per_axis"})
    monkeypatch.setattr(verdict, "leaves_more", lambda _: False)
    assert asked(LAZY_SERVOS).verdict == "missing"


@pytest.mark.thorough
@pytest.mark.usefixtures("only_effects")
@pytest.mark.parametrize(
    "only_effects", [("gyro_lag", "transport_delay", "gyro_filter", "dynamic_inflow")], indirect=True
)
def test_inflow_that_pushes_is_no_lateness_though_it_ended_at_its_bound() -> None:
    """There it has no standard error, and is not free; it made a fourth in the class."""
    found = asked(SHORT_DELAY)
    (inflow,) = [one for one in found.candidates if one.effect == "dynamic_inflow"]
    assert inflow.fit is not None
    assert "k_l" in inflow.fit.estimate.at_bound
    assert "k_l" in inflow.implausible
    assert found.verdict == "missing"
    assert "transport_delay" in (found.effect, *found.not_told)
    assert "dynamic_inflow" not in found.not_told


@pytest.mark.thorough
@pytest.mark.usefixtures("only_effects")
@pytest.mark.parametrize("only_effects", [("gyro_filter", "transport_delay", "gyro_lag")], indirect=True)
def test_what_the_noise_alone_tells_stays_in_the_class(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(likely, "LATE", ())  # forms that explain as much are one class without that
    found = asked(SLOW_FILTER)
    assert (found.verdict, found.effect) == ("missing", "transport_delay")
    assert "gyro_filter" in found.indistinguishable
    filtered = next(one for one in found.candidates if one.effects == ("gyro_filter",))
    assert filtered.explained_share is not None
    assert filtered.explained_share < 0.1, "by power"
    assert filtered.values["corner"] == pytest.approx(12.08, rel=0.05)
    monkeypatch.setattr(Shares, "may_be", Shares.enough)
    assert "gyro_filter" not in asked(SLOW_FILTER).not_told


@pytest.mark.thorough
@pytest.mark.usefixtures("only_effects")
@pytest.mark.parametrize("only_effects", [("slipstream_wing", "angle_of_attack")], indirect=True)
def test_what_no_loop_makes_is_named_however_near_another_comes(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(candidates, "flies_forward", lambda *_: True)  # as far as these runs tell
    found = asked(WAKE_IN_A_LOOP)
    assert found.parent.dataset.in_a_loop
    assert (found.verdict, found.effect) == ("missing", "slipstream_wing")
    monkeypatch.setattr(verdict, "LEFT_OF_A_FORM", -1.0)
    monkeypatch.setattr(verdict, "NAMED_IN_A_LOOP", 0.55)
    unsure = asked(WAKE_IN_A_LOOP)
    assert (unsure.verdict, unsure.reason) == ("unexplained", "feedback")


@pytest.mark.thorough
@pytest.mark.usefixtures("only_effects")
@pytest.mark.parametrize("only_effects", [("structural_mode",)], indirect=True)
def test_no_loop_makes_a_narrow_mode_of_doubtful_values_or_not(monkeypatch: pytest.MonkeyPatch) -> None:
    found = asked(MODE_IN_A_LOOP)
    assert found.winner is not None
    assert found.winner.outside
    assert (found.verdict, found.effect) == ("missing", "structural_mode")
    monkeypatch.setattr(verdict, "NARROW", 0.0)
    withheld = asked(MODE_IN_A_LOOP)
    assert (withheld.verdict, withheld.reason) == ("unexplained", "feedback")


@pytest.mark.thorough
@pytest.mark.usefixtures("only_effects")
@pytest.mark.parametrize("only_effects", [("governor",)], indirect=True)
def test_validation_runs_do_not_contradict_a_size_by_its_own_error(monkeypatch: pytest.MonkeyPatch) -> None:
    """Its gain is 0.86 where 0.68 is true, which leaves them more than nothing; as if it were exact they veto it."""
    found = asked(GOVERNOR_IN_A_LOOP)
    assert (found.verdict, found.effect) == ("missing", "governor")
    plain = ByWhatIsNew.share
    monkeypatch.setattr(ByWhatIsNew, "share", lambda self, one: plain(self, replace(one, chi_squared=math.inf)))
    assert asked(GOVERNOR_IN_A_LOOP).verdict == "unexplained"


@pytest.mark.thorough
@pytest.mark.usefixtures("only_effects")
@pytest.mark.parametrize("only_effects", [("servo_saturation",)], indirect=True)
def test_a_limit_that_validation_runs_do_not_reach_is_not_contradicted_by_them(monkeypatch: pytest.MonkeyPatch) -> None:
    """Either foretells best, the base and what it becomes with the limit; beside the base as least squares has it how
    feedback biases that would count."""
    found = asked(LIMIT_IN_A_LOOP)
    assert (found.verdict, found.effect) == ("missing", "servo_saturation")
    assert found.winner is not None
    assert found.winner.validation_share is None

    def beside_least_squares(*of: Any) -> Any:
        made = validation_of(*of)
        assert isinstance(made, ByWhatIsNew)
        return replace(made, before=made.as_fitted)

    monkeypatch.setattr(shares, "validation_of", beside_least_squares)
    biased = asked(LIMIT_IN_A_LOOP).winner
    assert biased is not None
    assert biased.validation_share is not None


@pytest.mark.usefixtures("only_effects")
@pytest.mark.parametrize("only_effects", [("gyro_lag", "motor_lag", "gyro_filter")], indirect=True)
def test_entries_of_the_same_equations_end_at_the_same() -> None:
    """A lag of the gyros that no gyro has was likelier by chi squared of 25, for where its fit had ended."""
    explained = {one.effect: one.chi_squared for one in asked(LATE_MOTORS_IN_GUSTS).candidates}
    assert explained["motor_lag"] == pytest.approx(explained["gyro_lag"], rel=1e-3)


@pytest.mark.thorough
@pytest.mark.usefixtures("only_effects")
@pytest.mark.parametrize("only_effects", [("servo_lag", "gyro_lag", "speed_stability")], indirect=True)
def test_chains_that_are_the_same_by_their_halves_end_at_the_same(monkeypatch: pytest.MonkeyPatch) -> None:
    """One had ended far off, where the speed's damping is at its bound."""

    def apart() -> float:
        explained = [one.chi_squared for one in asked(DRIFT_IN_A_LOOP).pairs if "speed_stability" in one.effects]
        assert len(explained) == 2
        return max(explained) - min(explained)

    assert apart() < 5
    monkeypatch.setattr(fitted_chains, "levelled", lambda *_: {})
    assert apart() > 100


@pytest.mark.thorough
@pytest.mark.usefixtures("only_effects")
@pytest.mark.parametrize("only_effects", [("motor_lag", "lag_per_axis")], indirect=True)
def test_a_lag_of_all_is_as_likely_as_two_lags_that_are_the_same(monkeypatch: pytest.MonkeyPatch) -> None:
    found = asked(ONE_LAG_OF_ALL)
    assert (found.verdict, found.effect) == ("missing", "motor_lag")
    monkeypatch.setattr(refits._Order, "_level_inside", lambda *_: None)
    assert asked(ONE_LAG_OF_ALL).effect == "lag_per_axis"
