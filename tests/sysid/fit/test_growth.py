"""What growing modes cost the likelihood in a loop: by Bode's integral, and on strange flights whose loop misled."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import pytest
from scipy.linalg import expm, solve_discrete_are
from strangers.asking import _Question as Question
from strangers.flights import Stranger, fly

from sysid.data.dataset import Bins, dataset
from sysid.data.record import Record
from sysid.fit import prediction_error
from sysid.fit.growth import answered, growth, growth_slopes
from sysid.fit.identify import identify, on_runs
from sysid.fit.output_error import OutputError
from sysid.fit.result import Fit
from sysid.model.compose import compose
from sysid.model.paper import CD

MOTORS_UNLOGGED = 4008535
"""A quadrotor whose motors lag by 79 ms, in a weak loop; no excitation is logged."""
COMMANDS = {"L_lat": 300.0, "L_lon": 10.0, "M_lat": -5.0, "M_lon": 250.0}


def cd(**rates: float) -> np.ndarray:
    return CD.vector({"L_p": -1.0, "L_q": 0.0, "M_p": 0.0, "M_q": -2.0, **COMMANDS, **rates})


@pytest.mark.parametrize(
    "rates",
    [{}, {"L_p": 3.0}, {"L_p": 3.0, "M_q": 2.0, "L_q": 0.5, "M_p": -1.5}, {"L_q": 4.0, "M_p": -4.0, "L_p": 2.5}],
)
def test_it_is_bode_s_integral_of_any_loop_that_holds_the_modes(rates: Mapping[str, float]) -> None:
    """The mean of log |det(1 + L)| around the circle, of a sampled vehicle under LQR."""
    values, dt = cd(**rates), 0.01
    named = dict(zip(CD.names, values, strict=True))
    block = np.zeros((4, 4))
    block[:2, :2] = [[named["L_p"], named["L_q"]], [named["M_p"], named["M_q"]]]
    block[:2, 2:] = [[named["L_lat"], named["L_lon"]], [named["M_lat"], named["M_lon"]]]
    sampled = expm(block * dt)
    A, B = sampled[:2, :2], sampled[:2, 2:]
    P = solve_discrete_are(A, B, np.eye(2), 1e3 * np.eye(2))
    K = np.linalg.solve(1e3 * np.eye(2) + B.T @ P @ B, B.T @ P @ A)
    z = np.exp(2j * np.pi * (np.arange(20_000) + 0.5) / 20_000)
    loop = K @ np.linalg.inv(z[:, None, None] * np.eye(2) - A) @ B
    integral = np.mean(np.log(np.abs(np.linalg.det(np.eye(2) + loop))))
    assert growth(CD, values) * dt == pytest.approx(-integral, abs=1e-5)


def test_slopes_are_of_the_sum_also_where_modes_fall_together() -> None:
    apart = growth_slopes(CD, cd(L_p=3.0, M_q=2.0, L_q=0.5, M_p=0.5))
    step = 1e-3
    by_hand = [
        (growth(CD, cd(L_p=3.0, M_q=2.0, L_q=0.5, M_p=0.5) + step * one)
         - growth(CD, cd(L_p=3.0, M_q=2.0, L_q=0.5, M_p=0.5) - step * one)) / (2 * step)
        for one in np.eye(len(CD.names))
    ]  # fmt: skip
    np.testing.assert_allclose(apart, by_hand, atol=1e-6)
    same = dict(zip(CD.names, growth_slopes(CD, cd(L_p=2.0, M_q=2.0)), strict=True))
    assert (same["L_p"], same["M_q"]) == pytest.approx((1.0, 1.0), abs=1e-6)
    np.testing.assert_array_equal(growth_slopes(CD, cd()), 0.0)


def test_without_a_response_it_is_infinite_and_has_no_slope() -> None:
    late = compose("cd", ["gyro_lag"])
    values = late.vector({**dict(zip(CD.names, cd(), strict=True)), "tau_g": 0.0})
    assert growth(late, values) == np.inf
    np.testing.assert_array_equal(growth_slopes(late, values), 0.0)


def test_what_is_the_model_s_own_error_grows_with_the_motion_and_gusts_do_not() -> None:
    t = 0.01 * np.arange(6000)
    rng = np.random.default_rng(5)
    motion = np.sin(0.3 * t) ** 2 * rng.standard_normal((2, t.size))
    gusts = rng.standard_normal((2, t.size))

    def bins(rates: np.ndarray) -> Bins:
        channels = {"t": t, "p": rates[0], "q": rates[1], "delta_x": motion[0], "delta_y": motion[1]}
        return dataset([Record("#1", channels)], (0.5, 15.0)).viewed(CD.inputs)

    measured = bins(motion)
    (group,) = measured.stacks
    late = compose("cd", ["motor_lag"])
    power = np.ones(2)
    own = OutputError([0.2 * group.Y * np.exp(-0.1j * group.frequency_hz)], power, power, measured.stacks)
    blown = OutputError([0.2 * bins(gusts).stacks[0].Y], power, power, measured.stacks)
    assert own.with_motion > 0.9
    assert abs(blown.with_motion) < 0.3
    assert answered(late, blown)
    assert not answered(late, own)
    assert not answered(CD, blown)
    assert not answered(compose("cd", ["servo_rate_limit"]), blown)


def fitted(flown: Stranger, **how: Any) -> Fit:
    base, runs, records, judging, band_hz = Question.of(flown)
    lag = ("motor_lag",)
    return identify(on_runs(base, lag, runs, records), records, judging, band_hz, effects=lag, **how)


def test_a_loop_s_answers_are_not_taken_for_their_cause(monkeypatch: pytest.MonkeyPatch) -> None:
    """Without it the likeliest model grows by 2.8 1/s, with a lag that is 12 standard errors short."""
    flown = fly(MOTORS_UNLOGGED)
    truth = {**flown.plan.vehicle.table, **flown.hidden.sizes[0]}
    fit = fitted(flown)
    assert fit.instrument == "prediction error"
    assert fit.model.stable
    off = [
        (fit.model[name] - truth[name]) / error
        for name, error in zip(fit.model.structure.names, fit.standard_errors, strict=True)
    ]
    assert np.sqrt(np.mean(np.square(off))) < 2.5
    assert fit.validation_nrmse_percent is not None
    assert min(fit.validation_nrmse_percent.values()) < 0  # simulated from gusty commands
    assert any("do not use it there; its numbers are those that foretell best" in text for text in fit.warnings)
    monkeypatch.setattr(prediction_error, "growth", lambda *_: 0.0)
    monkeypatch.setattr(prediction_error, "growth_slopes", lambda structure, _: np.zeros(len(structure.names)))
    without = fitted(flown)
    assert without.model["L_p"] > 2.0
