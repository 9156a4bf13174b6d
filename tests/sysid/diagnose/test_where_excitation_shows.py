"""Candidates compared where the excitation shows, in slow gusts and slow logs: training strangers, and white rows."""

from __future__ import annotations

import math

import numpy as np
import pytest
from strangers.asking import ask, fitted_runs
from strangers.flights import Stranger, fly

from sysid.data.band import USUAL, swept_band
from sysid.data.dataset import dataset
from sysid.diagnose import candidates, refits, shares, term_search
from sysid.diagnose import diagnose as diagnosing
from sysid.diagnose.evidence import Candidate, candidate
from sysid.diagnose.score import log_chance
from sysid.diagnose.shown import as_loud_as_it_is
from sysid.diagnose.verdict import Diagnosis
from sysid.fit import bursts
from sysid.fit.estimate import estimate
from sysid.fit.whitening import noise_whitening
from sysid.model.paper import TPP

LATE_IN_A_SLOW_LOG = 2000032
"""A small helicopter whose commands act 9.6 ms late, logged at 50 of 250 Hz by a log that does not tell its loop."""
LATE_MOTORS = 2000278
"""A quadrotor whose motors lag by 78 ms, in slow gusts and chirps of 11 s."""
SLOW_SERVOS = 2000071
"""A small helicopter whose servos turn no faster than 24 1/s, which costs a hundred-thousandth of the power."""
DRIFTS = 4011063
"""A helicopter whose moments follow its speed: it lets go of what it answers only after seconds."""
BURSTS = 4012857
"""A complete model of a vehicle that was flown in gusts in bursts, one chirp of 8 s an axis."""
DRIFTING = 2000266
"""Two effects in strong gusts and chirps of 10 s from 0.5 Hz on."""

IN_SLOW_GUSTS = 4059740
"""A disc that the yaw rate turns, 0.61 of what can be explained by power, and by the noise all of it."""
MET_BY_A_BURST = 4065794
"""Another of 8.5 s, where a burst makes an entry as well, at 5e-8, and one of many terms at 2e-10."""


def asked(seed: int) -> Diagnosis:
    return ask(fly(seed)).first


def size_of(found: Diagnosis, effect: str) -> tuple[float, float]:
    """Of its one parameter, and the standard error."""
    one = next(each for each in found.candidates if each.effect == effect)
    ((name, value),) = one.values.items()
    return value, one.standard_errors[name]


@pytest.mark.thorough
@pytest.mark.usefixtures("only_effects")
@pytest.mark.parametrize("only_effects", [("transport_delay", "lead_lag")], indirect=True)
def test_a_delay_is_not_the_hold_of_a_slow_loop(monkeypatch: pytest.MonkeyPatch) -> None:
    found = asked(LATE_IN_A_SLOW_LOG)
    assert (found.verdict, found.effect) == ("missing", "transport_delay")
    assert found.thinned is not None, "which is said"
    value, _ = size_of(found, "transport_delay")
    assert value == pytest.approx(0.0096, abs=1e-3), "but for the loop that is not known"
    monkeypatch.setattr(diagnosing, "by_a_usual_loop", lambda *_: None)
    assert asked(LATE_IN_A_SLOW_LOG).effect == "lead_lag"


@pytest.mark.thorough
@pytest.mark.usefixtures("only_effects")
@pytest.mark.parametrize("only_effects", [("motor_lag", "gyro_filter")], indirect=True)
def test_a_fit_that_slow_gusts_led_astray_goes_on_in_its_own_noise(monkeypatch: pytest.MonkeyPatch) -> None:
    found = asked(LATE_MOTORS)
    assert found.effect == "motor_lag"
    value, error = size_of(found, "motor_lag")
    assert value == pytest.approx(0.078, abs=3 * error)
    monkeypatch.setattr(refits, "misled", lambda *_: False)
    monkeypatch.setattr(refits, "by_its_own_noise", lambda fit, _: fit)
    monkeypatch.setattr(refits, "_gone_on", lambda fit, *_: fit)
    assert size_of(asked(LATE_MOTORS), "motor_lag")[0] < 0.05


@pytest.mark.usefixtures("only_effects")
@pytest.mark.parametrize("only_effects", [("servo_rate_limit", "servo_lag")], indirect=True)
def test_a_limit_far_below_the_gusts_is_fitted_by_the_noise() -> None:
    value, error = size_of(asked(SLOW_SERVOS), "servo_rate_limit")
    assert value == pytest.approx(24.0, abs=3 * error)
    assert error < 3.0


def parent_of(flown: Stranger) -> Candidate:
    runs = fitted_runs(flown)
    on = dataset(runs, (swept_band(runs) or USUAL).hz)
    return candidate(estimate(TPP, on.viewed(TPP.inputs), weights="constant"), (), on)


@pytest.fixture(scope="module")
def parent() -> Candidate:
    return parent_of(fly(DRIFTING))


def test_only_what_is_slow_and_lies_beside_the_excitation_tells_nothing(parent: Candidate) -> None:
    shown = parent.stepped.shown
    assert shown is not None
    frequency = np.concatenate([group.frequency_hz for group in parent.metric.stacks])
    row = np.random.default_rng(5).normal(size=parent.stepped.residual.size)
    told = shown.told(row[None])[0]
    np.testing.assert_allclose(shown.told(told[None])[0], told, atol=1e-12)
    white, kept = parent.metric.bins(row), parent.metric.bins(told)
    low = frequency < frequency[shown.lowest.order].max() + 1e-9
    np.testing.assert_allclose(kept[:, ~low], white[:, ~low], atol=1e-12)
    assert np.linalg.norm(kept[:, low]) < 0.8 * np.linalg.norm(white[:, low])
    np.testing.assert_allclose(shown.caused(told), shown.caused(row), atol=1e-9)


def test_noise_that_is_steep_in_a_window_is_as_loud_as_it_is(parent: Candidate) -> None:
    plain = noise_whitening(parent.model, parent.dataset.stacks, parent.division)
    shown, N = parent.stepped.shown, parent.stepped.residual.size
    assert shown is not None
    frequency = np.concatenate([group.frequency_hz for group in plain.stacks])
    steep = np.where(frequency < 0.5, 6.0, 1.0) * plain.bins(np.random.default_rng(7).normal(size=N))
    even = as_loud_as_it_is(plain, plain.row(steep), parent.dataset.causes)
    times = np.array(
        [np.linalg.norm(a) / np.linalg.norm(b) for a, b in zip(plain.whitener[0], even.whitener[0], strict=True)]
    )
    here = plain.stacks[0].frequency_hz
    assert np.all(times[here < 0.35] > 2.5)
    assert np.mean(times[(here > 0.8) & (here < 1.5)]) < 1.2
    assert np.all(times[here >= 1.5] == pytest.approx(1.0))


@pytest.mark.usefixtures("only_effects")
@pytest.mark.parametrize("only_effects", [("speed_stability", "attitude_stiffness")], indirect=True)
def test_what_drifts_is_told_by_what_is_left_and_not_by_what_was_imposed() -> None:
    """The product of what two models answer to the imposed commands, and what they leave, was below nothing."""
    found = asked(DRIFTS)
    assert (found.verdict, found.effect) == ("missing", "speed_stability")
    right, without = found.candidates[0].stepped, found.stepped
    assert right is not None
    assert (right.imposed - without.imposed) @ (right.residual + without.residual) < 0
    left, before = right.caused @ right.caused, without.caused @ without.caused
    assert left < 0.15 * before
    assert found.candidates[0].chi_squared == pytest.approx(before - left, rel=0.05)


@pytest.mark.usefixtures("only_effects")
@pytest.mark.parametrize("only_effects", [("gyro_lag", "lead_lag")], indirect=True)
def test_a_burst_that_a_short_chirp_met_is_no_effect(monkeypatch: pytest.MonkeyPatch) -> None:
    found = asked(BURSTS)
    assert found.verdict == "complete"
    assert log_chance(found.division.chi_squared, found.division.degrees) < math.log(1e-20), "window by window"
    assert found.stepped.envelope(found.whitening).rough
    monkeypatch.setattr(bursts, "ROUGH", math.inf)
    assert asked(BURSTS).verdict == "unexplained"


@pytest.mark.usefixtures("only_effects")
@pytest.mark.parametrize("only_effects", [("yaw_coupling", "stabiliser_bar")], indirect=True)
def test_what_shows_in_a_burst_alone_is_no_effect_and_no_term(monkeypatch: pytest.MonkeyPatch) -> None:
    found = asked(MET_BY_A_BURST)
    assert found.verdict == "complete"
    assert log_chance(found.division.chi_squared, found.division.degrees) < math.log(1e-30), "window by window"
    by_power = {one.effect: one.score.log_p for one in found.candidates if one.score is not None}
    assert by_power["yaw_coupling"] < math.log(1e-6)
    with monkeypatch.context() as one:
        one.setattr(term_search, "BEYOND_BURSTS", math.log(1e-9))
        assert asked(MET_BY_A_BURST).verdict == "unexplained", "by one of many terms"
    monkeypatch.setattr(candidates, "SHOWN_IN_BURSTS", candidates.SIGNIFICANT)
    assert asked(MET_BY_A_BURST).verdict == "unexplained", "by windows and an entry"


@pytest.mark.usefixtures("only_effects")
@pytest.mark.parametrize("only_effects", [("yaw_coupling", "speed_stability")], indirect=True)
def test_what_leaves_nothing_by_the_noise_is_named_where_powers_are_in_doubt(monkeypatch: pytest.MonkeyPatch) -> None:
    found = asked(IN_SLOW_GUSTS)
    assert (found.verdict, found.effect) == ("missing", "yaw_coupling")
    assert found.explained_share is not None
    assert shares.DOUBTFUL < found.explained_share < shares.NEARLY
    with monkeypatch.context() as one:
        one.setattr(shares, "NEARLY_ALL", 1.01)
        assert asked(IN_SLOW_GUSTS).verdict == "unexplained", "something is left"
    monkeypatch.setattr(shares, "DOUBTFUL", shares.NEARLY)
    assert asked(IN_SLOW_GUSTS).verdict == "unexplained", "powers tell"
