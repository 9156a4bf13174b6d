"""Flown against predicted: loops in time beside another computation of them, steps beside known ones, and verdicts."""

from __future__ import annotations

import numpy as np
import pytest
from planted import TABLE_4
from scipy import signal, stats
from scipy.linalg import expm

from sysid.control.in_time import _sampled, in_loops, lqr_law, predicted_rates
from sysid.control.loop import PULSE_S, following
from sysid.control.prefilter import DynamicPrefilter
from sysid.control.proof import (
    COUPLING,
    KNOTS_S,
    FlownRun,
    ProofError,
    below,
    flown_run,
    mean_bounds,
    prove,
)
from sysid.control.regulator import design
from sysid.control.sampled import NotSampledError
from sysid.data.record import FloatArray
from sysid.model.compose import compose
from sysid.model.paper import TPP
from sysid.model.structure import Model

DT = 0.002
MODEL = Model(TPP, TPP.vector(TABLE_4))
GAINS = design(MODEL)
LAW = lqr_law(MODEL, GAINS.K, GAINS.observer_gain, GAINS.prefilter, DT)


def doublets(seconds: float = 9.0, axis: int = 0) -> FloatArray:
    asked = np.zeros((round(seconds / DT), 2))
    pulse = (np.arange(len(asked)) * DT / PULSE_S).astype(int) % 6
    asked[:, axis] = 0.5 * ((pulse == 0) * 1.0 - (pulse == 1) * 1.0)
    asked[: round(0.1 / DT)] = 0
    return asked


def test_the_loops_in_time_are_the_continuous_loop_of_the_design() -> None:
    """`following` has the same doublet by the inverse Laplace transform; the hold is half a loop of lateness."""
    expected = following(GAINS, MODEL)
    asked = np.column_stack([expected.roll.asked, np.zeros_like(expected.roll.asked)])
    found = predicted_rates(LAW, in_loops(MODEL, DT), asked)
    for k, rate in enumerate((expected.roll.p, expected.roll.q)):
        assert np.abs(found[:, k] - rate).max() < 0.03 * np.abs(expected.roll.p).max()


def test_a_delay_and_a_lag_are_as_the_design_promises_too() -> None:
    structure = compose("tpp", ("servo_lag", "transport_delay"), ("delta_x", "delta_y"), {})
    late = Model(structure, structure.vector({**TABLE_4, "tau_s": 0.02, "T_d": 0.011}))
    expected = following(GAINS, late)
    asked = np.column_stack([np.zeros_like(expected.pitch.asked), expected.pitch.asked])
    found = predicted_rates(LAW, in_loops(late, DT), asked)
    assert np.abs(found[:, 1] - expected.pitch.q).max() < 0.03 * np.abs(expected.pitch.q).max()


def test_models_that_are_followed_act_as_they_are_described() -> None:
    """Command by command beside the same written down loop by loop, the models as SciPy steps them."""
    w, zeta, F = np.array([12.0, 20.0]), np.array([0.8, 1.1]), np.random.default_rng(5).normal(0, 0.1, (2, 4))
    law = lqr_law(
        MODEL, GAINS.K, GAINS.observer_gain, GAINS.prefilter, DT, DynamicPrefilter(frequency=w, damping=zeta, F=F)
    )
    asked = doublets(2.0)
    t = DT * np.arange(len(asked))
    of_models = [
        signal.lsim(([[0, 1], [-a * a, -2 * b * a]], [[0], [a * a]], np.eye(2), np.zeros((2, 1))), one, t, interp=False)
        for a, b, one in zip(w, zeta, asked.T, strict=True)
    ]
    (p, p_dot), (q, q_dot) = (rows[1].T for rows in of_models)
    added = (F @ np.vstack([p - asked[:, 0], q - asked[:, 1], p_dot, q_dot])).T
    A, B, C, _ = (np.asarray(one, dtype=float) for one in MODEL.matrices)
    x, of_law = np.zeros(4), np.zeros(len(law.A))
    ahead = expm(np.block([[A - GAINS.observer_gain @ C, B[:, :2]], [np.zeros((2, 6))]]) * DT)[:4]
    for k, target in enumerate(asked):
        found = law.C @ of_law + law.D @ np.concatenate([target, np.zeros(2)])
        np.testing.assert_allclose(found, -GAINS.K @ x + GAINS.prefilter @ target + added[k], atol=1e-9)
        x = ahead @ np.concatenate([x, found])
        of_law = law.A @ of_law + law.B @ np.concatenate([target, np.zeros(2)])


@pytest.mark.parametrize("effects", [("servo_backlash",), ("servo_second_order", "servo_backlash")])
def test_play_of_no_width_is_nothing(effects: tuple[str, ...]) -> None:
    """Loop by loop as all at once, a servo before the play included."""
    structure = compose("tpp", effects, ("delta_x", "delta_y"), {})
    typical = {one.name: one.typical for one in structure.parameters}
    values = {**typical, **TABLE_4, "half_width": 1e-12}
    with_play = Model(structure, structure.vector(values))
    without = compose("tpp", effects[:-1], ("delta_x", "delta_y"), {})
    plain = Model(without, without.vector({name: values[name] for name in without.names}))
    asked = doublets(3.0)
    a, b = (predicted_rates(LAW, in_loops(one, DT), asked) for one in (with_play, plain))
    assert np.abs(a - b).max() < 2e-3 * np.abs(b).max()


@pytest.mark.parametrize("effect", ["servo_backlash", "servo_saturation", "servo_deadband"])
def test_what_acts_on_samples_acts_loop_by_loop_as_over_a_whole_run(effect: str) -> None:
    structure = compose("tpp", (effect,), ("delta_x", "delta_y"), {})
    (one,) = structure.composed
    own = {name: structure.parameters[structure.names.index(name)].typical for name in one.names}
    commands = np.cumsum(np.random.default_rng(2).normal(0, 0.01, (2, 500)), axis=1)
    commands[:, 0] = 0
    assert one.samples is not None
    act = _sampled(one, own, DT)
    found = np.array([act(command) for command in commands.T]).T
    np.testing.assert_allclose(found, one.samples(commands.copy(), DT, own), atol=1e-12)


@pytest.mark.parametrize(
    ("effect", "size"), [("servo_rate_limit", {"rate": 2.0}), ("servo_acceleration_limit", {"acceleration": 100.0})]
)
def test_what_does_not_go_by_loops_is_refused(effect: str, size: dict[str, float]) -> None:
    structure = compose("tpp", (effect,), ("delta_x", "delta_y"), {})
    slow = Model(structure, structure.vector({**TABLE_4, **size}))
    with pytest.raises(NotSampledError, match="cannot be computed loop by loop"):
        in_loops(slow, DT)


def test_play_changes_the_answer() -> None:
    structure = compose("tpp", ("servo_backlash",), ("delta_x", "delta_y"), {})
    loose = Model(structure, structure.vector({**TABLE_4, "half_width": 0.02}))
    assert run_of(predicted_rates(LAW, in_loops(loose, DT), doublets())).nrmse_percent[0] < 95


def run_of(measured: FloatArray, predicted: FloatArray | None = None, axis: int = 0) -> FlownRun:
    asked = doublets(len(measured) * DT, axis)
    model = predicted_rates(LAW, in_loops(MODEL, DT), asked) if predicted is None else predicted
    t = DT * np.arange(len(asked), dtype=np.float64)
    return flown_run("made#1", axis, t, asked=asked, measured=measured, predicted=model)


@pytest.mark.parametrize("axis", [0, 1])
def test_the_step_in_a_run_is_that_of_the_loop(axis: int) -> None:
    asked = np.zeros((1000, 2))
    asked[1:, axis] = 1.0
    step = predicted_rates(LAW, in_loops(MODEL, DT), asked)
    run = run_of(predicted_rates(LAW, in_loops(MODEL, DT), doublets(axis=axis)), axis=axis)
    found = run.steps[0]
    at = np.round(found.t / DT).astype(int) + 1
    assert np.abs(found.own - step[at, axis]).max() < 0.05
    assert np.abs(found.other - step[at, 1 - axis]).max() < 0.05
    assert run.nrmse_percent[0] == pytest.approx(100, abs=1e-6)


def noisy(rng: np.random.Generator, size: float, axis: int, gain: float = 1.0) -> FlownRun:
    rates = predicted_rates(LAW, in_loops(MODEL, DT), doublets(axis=axis))
    changed = rates.copy()
    changed[:, 1 - axis] *= gain
    return run_of(changed + rng.normal(0, size, rates.shape), rates, axis)


def test_runs_with_noise_are_accepted_and_another_coupling_is_not() -> None:
    rng = np.random.default_rng(3)
    good = [noisy(rng, 0.05, axis) for axis in (0, 1) for _ in range(4)]
    assert prove(good, DT).verdict == "accepted"
    bad = [*good, *(noisy(rng, 0.05, 0, gain=2.5) for _ in range(4))][4:]
    proof = prove(bad, DT)
    assert proof.verdict == "not accepted"
    (coupling,) = (one for one in proof.evidence if (one.axis, one.quantity) == (0, "coupling"))
    assert coupling.verdict == "not accepted"
    assert coupling.difference is not None
    assert coupling.difference > COUPLING


def test_one_axis_and_one_run_are_too_few() -> None:
    rng = np.random.default_rng(4)
    assert prove([noisy(rng, 0.02, 0) for _ in range(4)], DT).verdict == "too few to say"
    assert prove([noisy(rng, 0.02, axis) for axis in (0, 1)], DT).verdict == "too few to say"


def test_an_answer_that_never_comes_is_not_accepted() -> None:
    rates = [predicted_rates(LAW, in_loops(MODEL, DT), doublets(axis=axis)) for axis in (0, 1)]
    runs = [run_of(0.3 * rates[axis], rates[axis], axis) for axis in (0, 1) for _ in range(2)]
    proof = prove(runs, DT)
    (rise,) = (one for one in proof.evidence if (one.axis, one.quantity) == (0, "rise_ms"))
    assert (rise.measured, rise.verdict, proof.verdict) == ((None, None), "not accepted", "not accepted")


def test_bounds_of_a_mean_are_student_s() -> None:
    values = [1.0, 2.5, 0.5, 3.0]
    expected = stats.t.interval(0.95, 3, loc=np.mean(values), scale=stats.sem(values))
    assert mean_bounds(values) == pytest.approx(expected)
    assert mean_bounds(values[:1]) is None


def test_what_is_above_the_band_is_left_out() -> None:
    t = DT * np.arange(4500, dtype=np.float64)
    both = np.column_stack([np.sin(2 * np.pi * 5 * t), np.sin(2 * np.pi * 27 * t)])
    left = below(both, 15.0, DT)
    assert np.abs(left[200:-200, 0] - both[200:-200, 0]).max() < 0.02
    assert np.abs(left[200:-200, 1]).max() < 0.02


def test_a_run_in_which_nothing_was_asked_is_refused() -> None:
    nothing = np.zeros((4500, 2))
    with pytest.raises(ProofError, match="nothing was asked"):
        flown_run("a", 0, DT * np.arange(4500, dtype=np.float64), asked=nothing, measured=nothing, predicted=nothing)
    assert KNOTS_S[0] > 0
