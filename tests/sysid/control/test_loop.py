"""The predicted answer of the closed loop, against a simulation in time that shares no code with it."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.linalg import expm

from gcs.analysis.fits import PAPER_PARAMETERS
from sysid.control.loop import RATE, STEP_S, following
from sysid.control.regulator import DesignError, Gains, design
from sysid.model.compose import compose
from sysid.model.paper import TPP
from sysid.model.structure import Model

PAPER = dict(zip(TPP.names, PAPER_PARAMETERS["tpp"], strict=True))


def vehicle(*effects: str, **values: float) -> Model:
    structure = compose("tpp", effects)
    return Model(structure, structure.vector({**PAPER, **values}))


def simulated(gains: Gains, model: Model, asked: np.ndarray, late_s: float = 0.0) -> np.ndarray:
    """p and q (n, 2) by matrix exponentials; commands arrive `late_s` late, a whole number of steps."""
    A, B, C, _ = (np.asarray(x) for x in model.matrices)
    a, b, c, _ = (np.asarray(x) for x in gains.model.matrices)
    K, L, g = gains.K, gains.observer_gain, gains.prefilter
    h = STEP_S / 8  # the delayed command is held, and its steps must not show
    n, m = len(A), len(a)
    whole = np.zeros((n + m + 4, n + m + 4))
    whole[:n, :n], whole[:n, n + m : n + m + 2] = A, B[:, :2]
    whole[n : n + m, :n], whole[n : n + m, n : n + m] = L @ C[:2], a - L @ c - b[:, :2] @ K
    whole[n : n + m, n + m + 2 :] = b[:, :2] @ g
    step = expm(whole * h)
    x, found = np.zeros(n + m), []
    waiting = [np.zeros(2)] * round(late_s / h)
    for r in asked:
        found.append((C @ x[:n])[:2])
        for _ in range(8):
            waiting.append(g @ r - K @ x[n:])
            x = step[: n + m] @ np.concatenate([x, waiting.pop(0), r])
    return np.array(found)


@pytest.mark.parametrize(
    ("model", "late_s"),
    [
        (vehicle(), 0.0),
        (vehicle("servo_lag", tau_s=0.02), 0.0),
        (vehicle("transport_delay", T_d=0.02), 0.02),
    ],
)
def test_it_is_what_a_simulation_in_time_gives(model: Model, late_s: float) -> None:
    gains = design(model)
    found = following(gains, model)
    for k, one in enumerate((found.roll, found.pitch)):
        asked = np.zeros((found.t.size, 2))
        asked[:, k] = one.asked
        p, q = simulated(gains, model, asked, late_s).T
        np.testing.assert_allclose(one.p, p, atol=0.01 * RATE)
        np.testing.assert_allclose(one.q, q, atol=0.01 * RATE)


def test_what_it_tells_of_an_answer() -> None:
    gains = design(vehicle())
    found = following(gains, vehicle("servo_lag", tau_s=0.03))
    early = following(gains, vehicle())
    assert found.t[np.flatnonzero(found.roll.asked)[0]] == pytest.approx(0.0)
    assert found.pitch.own is found.pitch.q
    assert found.pitch.other is found.pitch.p
    for late, ideal in ((found.roll, early.roll), (found.pitch, early.pitch)):
        assert late.rise_s is not None
        assert ideal.rise_s is not None
        assert 0.03 < ideal.rise_s < late.rise_s < 0.4
        assert 0 <= late.overshoot < 1
        assert 0 < late.coupling < 1


@pytest.mark.parametrize("late_s", [0.2, 0.5, 1.0])
def test_gains_that_do_not_hold_promise_nothing(late_s: float) -> None:
    gains = design(vehicle())
    assert gains.margins.delay_s < late_s
    with pytest.raises(DesignError, match="do not hold"):
        following(gains, vehicle("transport_delay", T_d=late_s))


def test_commands_come_to_rest_with_the_rates() -> None:
    found = following(design(vehicle()), vehicle())
    late = found.t > 2.5
    for answer in (found.roll, found.pitch):
        before = max(float(np.abs(one).max()) for one in (answer.delta_x, answer.delta_y))
        assert 0.01 < before < 1.0
        assert np.abs(answer.delta_x[late]).max() < 1e-3 * before
        assert np.abs(answer.delta_y[late]).max() < 1e-3 * before
