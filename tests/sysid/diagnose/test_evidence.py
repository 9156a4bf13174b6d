"""Scores behave as chi squared where nothing is missing, and one step from the parent finds what is."""

from __future__ import annotations

import math
from dataclasses import replace
from types import SimpleNamespace
from typing import cast

import numpy as np
import planted
import pytest
from planted import PLANTED, Run, fly_many
from planted_fits import records

from sysid.data.dataset import dataset
from sysid.diagnose import evidence
from sysid.diagnose.evidence import Candidate, Stepped, candidate, gain, instrumental_step, refit
from sysid.diagnose.score import score
from sysid.fit.estimate import estimate
from sysid.fit.noise import divide
from sysid.fit.whitening import Whitening, noise_whitening
from sysid.model.compose import compose
from sysid.model.effect import catalogue
from sysid.model.paper import TPP
from sysid.model.parameter import Parameter
from sysid.model.structure import Model

BAND = (0.0, 15.0)
LINEAR = ("hub_gyroscopics", "angular_damping", "inertia_coupling", "servo_lag", "transport_delay", "gyro_misalignment")
SECONDS = 15.0


def prepared(flight: list[Run]) -> tuple[Candidate, Stepped, Whitening]:
    on = dataset(records(flight), BAND)
    parent = candidate(estimate(TPP, on.viewed(TPP.inputs)), (), on)
    whitening = noise_whitening(parent.model, on.stacks, divide(parent.estimate.error, on.stacks, on.causes))
    return parent, instrumental_step(parent, whitening), whitening


def scored(effect: str, flight: list[Run]):  # type: ignore[no-untyped-def]
    parent, stepped, whitening = prepared(flight)
    composed = compose("tpp", [effect], parent.dataset.available)
    return score(catalogue()[effect], composed, parent, stepped, whitening)


def test_scores_of_a_complete_model_are_chi_squared() -> None:
    flights = fly_many(None, {}, seeds=range(81, 93), duration_s=SECONDS)
    each = []
    for flight in flights:
        parent, stepped, whitening = prepared(flight)
        for name in LINEAR:
            found = score(
                catalogue()[name], compose("tpp", [name], parent.dataset.available), parent, stepped, whitening
            )
            assert found is not None
            each.append(found.chi_squared / found.degrees)
    # 12 flights of 6 kindred questions: a mean of 1 within about 0.25
    assert np.mean(each) == pytest.approx(1.0, abs=0.5)
    assert np.max(each) < 12


@pytest.mark.parametrize(
    ("effect", "share"),
    [("hub_gyroscopics", 0.3), ("angular_damping", 0.3), ("servo_lag", 0.1), ("inertia_coupling", 0.3)],
)
def test_one_step_estimates_a_small_effect(effect: str, share: float) -> None:
    planted = {name: share * value for name, value in PLANTED[effect].items()}
    (flight,) = fly_many(effect, planted, seeds=[95], duration_s=SECONDS)
    found = scored(effect, flight)
    assert found.log_p < np.log(1e-6)
    for name, value in planted.items():
        assert found.at[name] == pytest.approx(value, abs=4 * found.errors[name] + 0.1 * abs(value))


def test_what_no_flight_tells_apart_is_equally_likely() -> None:
    (flight,) = fly_many("servo_lag", PLANTED["servo_lag"], seeds=[96], duration_s=SECONDS)
    parent, _, _ = prepared(flight)
    on = parent.dataset
    fits = {name: refit(compose("tpp", [name], on.available), parent, [name]) for name in ("servo_lag", "gyro_lag")}
    best = fits["servo_lag"]
    whitening = noise_whitening(best.model, on.stacks, divide(best.estimate.error, on.stacks, on.causes))
    servo, gyro = (instrumental_step(one, whitening) for one in fits.values())
    likelier, apart = gain(servo, gyro)
    assert abs(likelier) < 0.5
    assert apart < 0.5
    assert gain(servo, instrumental_step(parent, whitening))[0] > 1e4
    assert gain(servo, servo) == (0.0, 0.0)


def test_channels_that_do_not_move_are_set_apart() -> None:
    (flight,) = fly_many(None, {}, seeds=[97], duration_s=5.0)
    still = [{**run, "omega": np.full_like(run["omega"], 172.8)} for run in flight]
    found = dataset(records(still), BAND)
    assert "omega" in found.still
    assert "omega" not in found.available
    assert {"delta_x", "delta_y", "r"} <= found.available


def test_gusts_in_the_commands_are_no_play(monkeypatch: pytest.MonkeyPatch) -> None:
    """A small helicopter in strong gusts that its controller answers: play would do something to these answers, which
    are in the residual as well. Nothing is hidden."""
    small = {"L_b": 1500.0, "M_a": 450.0, "tau_f": 0.05, "A_b": -0.2, "B_a": 0.2}
    monkeypatch.setattr(planted, "TABLE_4", small | {"A_lat": -0.05, "A_lon": 0.3, "B_lat": 0.5, "B_lon": -0.03})
    monkeypatch.setattr(planted, "GUST", (0.8, 0.7))
    monkeypatch.setattr(planted, "RATE_GAIN", np.diag([0.045, 0.075]))
    monkeypatch.setattr(planted, "ATTITUDE_GAIN", np.diag([0.75, 1.2]))
    (flight,) = fly_many(None, {}, seeds=[1], duration_s=20.0, gusts=4.0)
    for effect in ("servo_backlash", "servo_deadband"):
        found = scored(effect, flight)
        assert found is None or found.log_p > np.log(1e-3), effect


def test_surrogate_gusts_have_the_spectrum_of_those_flown_and_other_phases() -> None:
    (flight,) = fly_many(None, {}, seeds=[97], duration_s=SECONDS, gusts=2.0)
    on = dataset(records(flight), BAND)
    for flown, imposed, surrogate in zip(on.stacks, on.imposed, on.surrogate, strict=True):
        ours, theirs = surrogate.U - imposed.U, flown.U - imposed.U
        assert np.abs(ours) == pytest.approx(np.abs(theirs), rel=1e-9, abs=1e-12)
        assert abs(np.vdot(ours, theirs)) < 0.3 * np.vdot(theirs, theirs).real


def test_what_runs_away_with_the_whole_step_moves_by_the_damped_one() -> None:
    J = np.array([[1.0, 0.0], [1.0, 1e-4]])
    first, second = evidence._steps(J, np.array([1.0, 0.1]))
    assert first == pytest.approx([-999.0, 1000.0], rel=1e-3)
    assert second == pytest.approx([0.5, 0.5], rel=0.02)
    assert list(evidence._steps(J[:0], np.zeros(2))) == []


def at(values: dict[str, float], *parameters: Parameter) -> Candidate:
    """One that has these parameters alone."""

    class Values(dict[str, float]):
        """Of a model."""

        structure: object

    model = Values(values)
    model.structure = SimpleNamespace(parameters=parameters)
    return cast(Candidate, SimpleNamespace(model=model, free=tuple(values)))


def test_a_step_ends_at_a_bound_and_the_rest_follows() -> None:
    """Two that stand for each other: where a lag would have to be a lead, a gain takes what it can."""
    tau = Parameter("tau", "s", "", null=0.0, bounds=(0.0, 1.0))
    one = at({"gain": 0.0, "tau": 0.1}, Parameter("gain", "1", "", bounds=(-10.0, 10.0)), tau)
    H, move = np.array([[2.0, 1.0], [1.0, 2.0]]), np.array([1.0, -0.5])
    assert evidence._within_bounds(one, H, H @ move) == pytest.approx([(H @ move)[0] / 2 + 0.1 / 2, -0.1])
    assert evidence._within_bounds(one, H, H @ -move) == pytest.approx(-move)


def test_no_step_makes_a_lead_of_poles_far_above() -> None:
    """By its slope what is late by 1/f is not late any more at twice the frequency."""
    frequency = Parameter("frequency", "Hz", "", null=math.inf, bounds=(1.0, 1e5))
    one = at({"frequency": 600.0}, frequency)
    assert evidence._within_bounds(one, np.eye(1), np.array([5000.0])) == pytest.approx([600.0])
    assert evidence._within_bounds(one, np.eye(1), np.array([-200.0])) == pytest.approx([-200.0])


def test_values_whose_motion_does_not_settle_are_no_candidate() -> None:
    """A damping of the second power that drives: where it wins, motion has no end."""
    (flight,) = fly_many(None, {}, seeds=[97], duration_s=5.0)
    parent, _, _ = prepared(flight)
    driven = compose("tpp", ["quadratic_damping"], parent.dataset.available)
    nothing = driven.vector({**parent.model.by_name, "L_pp": 0.0, "M_qq": 0.0, "exponent": 2.0})
    size = len(nothing)
    found = replace(parent.estimate, model=Model(driven, nothing), covariance=np.zeros((size, size)))
    one = candidate(found, (), parent.dataset, ["quadratic_damping"])
    assert one.at(nothing) is not None
    assert one.at(driven.vector({**one.model.by_name, "L_pp": 1e4, "M_qq": 1e4})) is None
