"""Modes over a sample: against the exponential of matrices, and derivatives against complex steps through it."""

from __future__ import annotations

import sys

import numpy as np
import pytest
from scipy.signal import lfilter, place_poles

from sysid.control.regulator import OBSERVER_POLES, lqr, observer_gain
from sysid.diagnose.maneuver_plans import Plan
from sysid.model.compose import compose
from sysid.model.modal import Modes
from sysid.model.paper import TABLE_4, TPP
from sysid.model.structure import COMPLEX_STEP, Model, discretise, recursion

NOMINAL = Model(TPP, np.array([one.typical for one in TPP.parameters]))
STILL = np.array([[0.0, 1.0, 0.0], [0.0, -2.0, 1.0], [0.0, 0.0, 0.0]])
"""Two poles at zero, the attitude of a vehicle that drifts."""


@pytest.mark.parametrize("dt", [0.002, 0.02, 0.3])
@pytest.mark.parametrize("poles", [(-3.0, -3.0001, -40.0), (0.0, -1e-9, 5.0), (-1e5, -2.0, 0.0)])
def test_values_and_derivatives_are_those_of_the_matrix_exponential(poles: tuple[float, ...], dt: float) -> None:
    random = np.random.default_rng(1)
    turn = np.linalg.qr(random.normal(size=(3, 3)))[0]
    A = turn @ np.diag(poles) @ turn.T
    B, dA, dB = (random.normal(size=shape) for shape in ((3, 2), (3, 3), (3, 2)))
    Ad, Bd = discretise(A + 1j * COMPLEX_STEP * dA, B + 1j * COMPLEX_STEP * dB, dt)
    modes = Modes.of(A, dt)
    V, W = modes.V, modes.W
    turned, WB = W @ dA @ V, W @ B

    def near(found: np.ndarray, wanted: np.ndarray) -> None:
        np.testing.assert_allclose(found, wanted, rtol=1e-6, atol=1e-7 * dt)

    near(V @ (modes.factor[:, None] * W), Ad.real)
    near(V @ (modes.held[:, None] * WB), Bd.real)
    near(V @ (turned * modes.moved) @ W, Ad.imag / COMPLEX_STEP)
    moved = (turned * modes.held_moved) @ WB + modes.held[:, None] * (W @ dB)
    near(V @ moved, Bd.imag / COMPLEX_STEP)


def test_poles_that_do_not_part_are_nudged() -> None:
    modes = Modes.of(np.array([[-2.0, 1.0], [0.0, -2.0]]), 0.01)
    exact = np.exp(-0.02) * np.array([[1.0, 0.01], [0.0, 1.0]])
    np.testing.assert_allclose(modes.V @ (modes.factor[:, None] * modes.W), exact, atol=1e-7)
    assert Modes.of(STILL, 0.01).factor == pytest.approx([1.0, np.exp(-0.02), 1.0], abs=1e-6)


def test_a_recursion_is_that_of_a_filter() -> None:
    driving = np.random.default_rng(2).normal(size=(3, 1, 500))
    for factor in (0.0, 0.5, 0.999, -0.9):
        wanted = lfilter([1.0], [1.0, -factor], driving[:, 0], axis=1)
        np.testing.assert_allclose(recursion(np.array([[factor]]), driving)[:, 0], wanted, rtol=1e-10, atol=1e-12)


def test_the_papers_observer_leaves_no_choice() -> None:
    A, _, C, _ = NOMINAL.matrices
    wanted = place_poles(A.T, C.T, np.array(OBSERVER_POLES)).gain_matrix.T
    np.testing.assert_allclose(observer_gain(A, C, OBSERVER_POLES), wanted, rtol=1e-7)
    others = (-40.0, -50.0, -60.0, -70.0)
    np.testing.assert_allclose(sorted(np.linalg.eigvals(A - observer_gain(A, C, others) @ C).real), sorted(others))


def test_gains_and_plans_load_no_scipy_signal(monkeypatch: pytest.MonkeyPatch) -> None:
    """It takes as long to load as a diagnosis takes to compute."""
    monkeypatch.setitem(sys.modules, "scipy.signal", None)
    assert lqr(NOMINAL).loop.stable
    plan = Plan(kind="chirp", axis="roll", amplitude=0.1, f_start_hz=0.1, f_stop_hz=10.0, duration_s=5.0)
    assert np.any(plan.excitation(0.01))


@pytest.mark.parametrize(
    "effects",
    [(), ("servo_second_order",), ("dynamic_inflow",), ("gyro_filter",), ("servo_lag", "gyro_lag", "transport_delay")],
)
def test_what_an_effect_brings_along_is_no_mode_of_the_airframe(effects: tuple[str, ...]) -> None:
    structure = compose("tpp", effects)
    values = {one.name: one.typical for one in structure.parameters} | dict(zip(TPP.names, TABLE_4["tpp"], strict=True))
    model = Model(structure, structure.vector(values))
    own = [(mode.frequency_hz, mode.damping_ratio) for mode in model.own_modes]
    assert len(own) == 2
    for found, paper in zip(own, ((1.64, 0.39), (5.04, 0.22)), strict=True):
        assert found == pytest.approx(paper, rel=0.35 if "dynamic_inflow" in effects else 0.02)
    assert len(model.modes) > 2 or not effects
