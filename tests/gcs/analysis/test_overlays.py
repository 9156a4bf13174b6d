"""Another model over a measurement, the part of a residual in a band, and what each rung leaves of an error."""

from __future__ import annotations

import numpy as np
import pytest
from planted import TABLE_4

from gcs.analysis.ladder import errors_left
from gcs.analysis.overlays import in_band, loud, modelled_by
from sysid.compare.values import Trace
from sysid.model.compose import compose
from sysid.model.paper import CD, TPP
from sysid.model.structure import Model

T = np.arange(0.0, 20.0, 0.01)


def simulated(model: Model, commands: np.ndarray) -> np.ndarray:
    """Its answer step by step, by the exponential of its matrices: nothing of what is tested."""
    from scipy.linalg import expm

    A, B, C, D = model.matrices
    n, m = A.shape[0], B.shape[1]
    moved = expm(0.01 * np.block([[A, B], [np.zeros((m, n + m))]]))
    x, outputs = np.zeros(n), []
    for u in commands.T:
        outputs.append(C @ x + D @ u)
        x = moved[:n, :n] @ x + moved[:n, n:] @ u
    return np.array(outputs).T


def test_another_model_is_drawn_as_it_would_answer():
    tpp = Model(TPP, TPP.vector(TABLE_4))
    other = Model(TPP, TPP.vector({**TABLE_4, "M_a": 0.8 * TABLE_4["M_a"]}))
    window = np.exp(-(((T - 8) / 2) ** 2))
    commands = 0.1 * np.stack([window * np.sin(9 * T), window * np.cos(14 * T)])
    own, wanted = simulated(tpp, commands), simulated(other, commands)
    noise = np.random.default_rng(1).normal(0, 0.02, own.shape)
    trace = Trace("a#1", T, own + noise, noise, {"delta_x": commands[0], "delta_y": commands[1]})
    found = modelled_by(trace, tpp, other)
    assert np.std(wanted - own) > 0.05 * np.std(own), "they differ"
    np.testing.assert_allclose(found, wanted, atol=0.02 * np.abs(wanted).max())


def test_a_model_that_a_trace_cannot_drive_is_not_drawn():
    tpp = Model(TPP, TPP.vector(TABLE_4))
    trace = Trace("a#1", T, np.zeros((2, T.size)), np.zeros((2, T.size)), {"delta_x": T})
    assert modelled_by(trace, tpp, Model(CD, np.ones(len(CD.names)))) is None, "a command is missing"
    play = compose("tpp", ["servo_backlash"])
    whole = Trace("a#1", T, trace.measured, trace.residual, {"delta_x": T, "delta_y": T})
    assert modelled_by(whole, tpp, Model(play, np.array([one.typical for one in play.parameters]))) is None


def test_the_part_of_a_residual_in_a_band_and_where_it_is_loud():
    slow, fast = np.sin(2 * np.pi * T), np.where((T > 12) & (T < 15), np.sin(2 * np.pi * 6 * T), 0)
    inside = in_band(T, slow + fast, (4.0, 8.0))
    assert np.std(inside - fast) < 0.2 * np.std(fast), "all but its sharp ends"
    ((begin, end),) = loud(T, inside)
    assert (begin, end) == (pytest.approx(12, abs=0.6), pytest.approx(15, abs=0.6))
    assert loud(T, np.zeros(T.size)) == ()
    assert in_band(T[:1], T[:1], (1.0, 2.0)).tolist() == [0.0]


def test_what_rungs_leave_falls_from_one_to_the_noise():
    rungs = [
        ("TPP", {"p": 60.0, "q": 90.0}, {"p": 58.0, "q": 89.0}),
        ("+ servo_lag", {"p": 80.0, "q": 90.0}, {"p": 77.0, "q": 89.1}),
        ("+ dynamic_inflow", {"p": 90.0, "q": 89.0}, {"p": 76.0, "q": 89.0}),
    ]
    floor = {"p": 90.0, "q": 90.0}
    found = errors_left(rungs, [None, {"p": 62.0, "q": 90.0}, None], floor)
    p = [one[0] for one in found]
    assert [one.left for one in p] == [1.0, pytest.approx((0.2**2 - 0.1**2) / (0.4**2 - 0.1**2)), 0.0]
    assert [one.before for one in p] == [1.0, 1.0, p[1].left]
    assert [one.better for one in p] == [None, True, False]
    assert p[1].placebo == pytest.approx((0.38**2 - 0.1**2) / (0.4**2 - 0.1**2))
    assert [one[1].left for one in found] == [0.0, 0.0, 0.0], "there was nothing to explain"
    assert errors_left(rungs, [None] * 3, None)[1][0].left == pytest.approx(0.25), "the noise is not known"
