"""Gauss-Newton steps: inside bounds, and never with numbers that are none."""

from __future__ import annotations

import subprocess
import sys

import numpy as np
import pytest
from planted import PLANTED, fly_many
from planted_fits import records
from scipy.optimize import lsq_linear

from sysid.data.dataset import dataset
from sysid.fit import estimate as estimate_module
from sysid.fit import gauss_newton
from sysid.fit.estimate import estimate
from sysid.fit.gauss_newton import NormalEquations, bounded_step, moved
from sysid.fit.identify import on_runs
from sysid.fit.rows import smoothed_spectrum


def equations(J: np.ndarray, e: np.ndarray) -> NormalEquations:
    return NormalEquations(np.array([e @ e]), J @ J.T, J @ e, [])


@pytest.mark.parametrize("seed", range(5))
def test_a_step_that_would_pass_a_bound_is_the_best_inside(seed: int) -> None:
    rng = np.random.default_rng(seed)
    lag = rng.standard_normal(50)
    J = np.stack([lag, lag + 0.05 * rng.standard_normal(50), rng.standard_normal(50)])  # the first two are nearly one
    e = np.array([-2.0, 3.0, 0.5]) @ J
    least, most = np.array([-0.1, -np.inf, -np.inf]), np.full(3, np.inf)
    move = bounded_step(equations(J, e), np.ones(3, dtype=bool), least, most)
    best = lsq_linear(J.T, e, (least, most), tol=1e-12).x
    assert move == pytest.approx(best, abs=1e-6)


@pytest.mark.parametrize("seed", range(40))
def test_a_step_between_narrow_bounds_promises_something(seed: int) -> None:
    """Each that passes its bound put there, and never let go, had made steps that promised less than none."""
    rng = np.random.default_rng(seed)
    common = rng.standard_normal(50)
    J = np.stack([common + 0.1 * rng.standard_normal(50) for _ in range(4)])
    here = equations(J, rng.standard_normal(4) @ J)
    least, most = -rng.uniform(0.01, 1, 4), rng.uniform(0.01, 1, 4)
    move = bounded_step(here, np.ones(4, dtype=bool), least, most)
    assert here.promise(move) > 0
    assert np.all((least <= move) & (move <= most))


def test_a_lag_that_is_not_there_ends_at_nothing_and_leaves_the_delay_right() -> None:
    """From too late a beginning the lag's bound used to hold the delay off: worse with the lag than without."""
    flight = records(fly_many("transport_delay", PLANTED["transport_delay"], seeds=[5], duration_s=8.0)[0])
    on = dataset(flight, (0.0, 15.0))
    late = on_runs("tpp", ["transport_delay"], flight, flight)
    without = estimate(late, on.viewed(late.inputs))
    both = on_runs("tpp", ["transport_delay", "gyro_lag"], flight, flight)
    found = estimate(both, on.viewed(both.inputs), without.model)
    assert np.all(found.error.residual_power <= 1.001 * without.error.residual_power)
    assert found.model["T_d"] == pytest.approx(without.model["T_d"], abs=2e-3)


LINEAR_ALGEBRA_OF_WHAT_IS_NO_NUMBER = """
import numpy as np
from sysid.fit.gauss_newton import NormalEquations, bounded_step
from sysid.model.relaxation import RelaxationError, _Explaining
nothing = np.full((6, 6), np.nan)
here = NormalEquations(np.ones(1), nothing, nothing[0], [])
assert not here.finite
assert not np.any(bounded_step(here, np.ones(6, dtype=bool), np.full(6, -np.inf), np.full(6, np.inf)))
try:
    _Explaining.by(np.full((6, 40), np.inf))
except RelaxationError:
    pass
"""


def test_lapack_has_nothing_to_print() -> None:
    done = subprocess.run(
        [sys.executable, "-c", LINEAR_ALGEBRA_OF_WHAT_IS_NO_NUMBER], capture_output=True, text=True, check=False
    )
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")


def test_a_step_that_is_halved_takes_derivatives_only_where_it_ends() -> None:
    asked: list[tuple[float, bool]] = []

    def equations_at(values: np.ndarray, *, full: bool, **_: object) -> NormalEquations:
        asked.append((float(values[0]), full))
        return NormalEquations(np.array([1.0 + (values[0] - 0.25) ** 2]), np.eye(1), np.ones(1), [])

    ends, here = (np.zeros(1), np.full(1, 2.0)), NormalEquations(np.array([1.05]), np.eye(1), np.ones(1), [])
    reached = gauss_newton._lower(equations_at, ends, (), here, 1e-3)
    assert reached is not None
    assert asked == [(2.0, True), (1.0, False), (0.5, False), (0.25, False), (0.25, True)]


def test_the_spread_under_coloured_residuals_is_worked_out_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """Not at every step on the way to where the excitation leaves no bias."""
    flight = records(fly_many("servo_lag", PLANTED["servo_lag"], seeds=[5], duration_s=8.0)[0])
    on = dataset(flight, (0.0, 15.0))
    asked: list[int] = []

    def counted(left: np.ndarray, frequency_hz: np.ndarray) -> np.ndarray:
        asked.append(frequency_hz.size)
        return smoothed_spectrum(left, frequency_hz)

    monkeypatch.setattr(estimate_module, "smoothed_spectrum", counted)
    structure = on_runs("tpp", [], flight, flight)
    found = estimate(structure, on.viewed(structure.inputs), weights="constant")
    assert found.instrument == "excitation logged"
    assert len(asked) == len(flight)


def test_what_goes_to_a_bound_is_at_it() -> None:
    """Rounding left a time constant of an inflow 4e-19 s inside: it counted as free, and as no doubtful value."""
    values = np.random.default_rng(1).uniform(0.001, 1.0, 200)
    low, high = np.full(200, 0.0005), np.full(200, 2.0003)
    assert np.any(values + (low - values) != low), "these round"
    assert np.array_equal(moved(values, low - values, low, high), low)
    assert np.array_equal(moved(values, high - values, low, high), high)
    assert np.array_equal(moved(values, np.full(200, 1e-4), low, high), values + 1e-4)
