"""One axis alone: a rate and its own command, where nothing else was excited or measured."""

from __future__ import annotations

import numpy as np
import pytest

import sysid
from sysid.model.base import find_base
from sysid.model.compose import acts_on, not_testable
from sysid.model.effect import catalogue

DT = 0.004
AXES = {"roll": ("p", "delta_x", "L_p", "L_lat"), "pitch": ("q", "delta_y", "M_q", "M_lon")}


@pytest.fixture(params=AXES)
def axis(request: pytest.FixtureRequest) -> str:
    return str(request.param)


def swept(axis: str, seed: int, late: int, lag_s: float = 0.0) -> sysid.Record:
    """A vehicle that acts so many samples late, behind a lag, in a sweep of this axis; noise of a tenth of its rate."""
    rate, command, damping, control = AXES[axis]
    numbers = {damping: -3.0, control: 150.0} | ({"tau_s": lag_s} if lag_s else {})
    truth = sysid.make_model(axis, numbers, ["servo_lag"] if lag_s else [])
    t = DT * np.arange(10_000)
    sweep = 0.05 * np.sin(2 * np.pi * (0.5 * t + 0.09 * t**2)) * np.clip(np.minimum(t, 40 - t), 0, 1)
    acting = np.concatenate([np.zeros(late), sweep[: t.size - late]])
    flown = sysid.simulate("sweep", truth, t, {command: acting}).channels
    answer = flown[rate]
    noise = 0.1 * np.std(answer) * np.random.default_rng(seed).standard_normal(t.size)
    return sysid.make_record("sweep", {**flown, command: sweep, rate: answer + noise}, maneuver="chirp")


def test_a_late_vehicle_ends_with_its_own_sign(axis: str) -> None:
    """Without its lateness the bare base fits best with the opposite one."""
    _, _, damping, control = AXES[axis]
    run = swept(axis, 1, late=10, lag_s=0.05)
    fit = sysid.fit_model([run], axis, ["servo_lag", "transport_delay"], band_hz=(1.5, 7.5))
    assert fit.model["T_d"] == pytest.approx(0.04, abs=0.002)
    assert fit.model[control] > 0
    assert sorted((-fit.model[damping], 1 / fit.model["tau_s"])) == pytest.approx([3, 20], rel=0.15)


def test_what_is_missing_is_found(axis: str) -> None:
    run = swept(axis, 2, late=8)
    fit = sysid.fit_model([run], axis, band_hz=(0.5, 7.5))
    found = sysid.diagnose_fit(fit, [run])
    assert (found.verdict, found.effect) == ("missing", "transport_delay")


def test_effects_on_what_it_lacks_are_not_testable(axis: str) -> None:
    base = find_base(axis)
    for name in ("flapping", "yaw_coupling", "gyro_misalignment", "angular_damping"):
        assert "not testable" in (not_testable(catalogue()[name], base, [name], ("t", "r")) or ""), name
    for name in ("servo_lag", "transport_delay", "motor_lag", "servo_backlash"):
        assert not_testable(catalogue()[name], base, [name], ("t",)) is None, name
    for name, effect in catalogue().items():
        assert effect.needs or acts_on(effect, find_base("cd")), name
