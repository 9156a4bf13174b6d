"""How well a regression's coefficients and its delay are known, where what is not answer is coloured noise."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import signal
from scipy.linalg import matmul_toeplitz

from gcs.flight.probe.grid import GRID_S, means, smooth
from gcs.flight.probe.regression import Dynamics, Regression
from gcs.flight.probe.values import FloatArray, Samples

_MEMORY_S = 0.6


@dataclass(frozen=True, eq=False, slots=True, kw_only=True)
class Solution:
    """A regression at its best dynamics, with the noise beside the answer."""

    regression: Regression
    dynamics: Dynamics
    b: FloatArray
    """Coefficients, shape (k,)."""
    used: NDArray[np.intp]
    """Their columns of `Regression.filtered`."""
    X: FloatArray
    """These columns without offsets and slopes, shape (n, k)."""
    noise: FloatArray
    """Autocovariance of what is not answer, shape (n,)."""

    def covariance(self) -> FloatArray:
        """Of the coefficients, shape (k, k)."""
        inverse = self.regression.inverse(self.X)
        covariance: FloatArray = inverse @ matmul_toeplitz(self.noise, inverse.T)
        return covariance


def hover_rate(quiet: Samples, rate: str) -> FloatArray:
    """The rate in quiet hover, smoothed as the steps and without its slope; empty where it is not known."""
    if quiet["t"].size < 50 or quiet["t"][-1] - quiet["t"][0] < 1.0:
        return np.empty(0)
    values = means(quiet)[0].get(rate)
    return np.empty(0) if values is None else np.asarray(signal.detrend(smooth(values)))


def autocovariance(residual: FloatArray, quiet: FloatArray) -> FloatArray:
    """Of what is not answer, shape (n,): the residual's, raised to the quiet hover's variance, fading with the lag."""
    n = residual.size
    lags = np.arange(min(n, round(_MEMORY_S / GRID_S)))
    own = np.array([residual[lag:] @ residual[: n - lag] for lag in lags]) / n
    scale = max(1.0, float(quiet.var()) / max(own[0], 1e-30)) if quiet.size else 1.0
    out = np.zeros(n)
    out[: lags.size] = scale * own * (1 - lags / lags.size)
    return out


def evidence(b: FloatArray, covariance: FloatArray, which: NDArray[np.bool_]) -> float:
    """Of some coefficients: chi squared less its degrees of freedom."""
    part = covariance[np.ix_(which, which)]
    return float(b[which] @ np.linalg.pinv(part) @ b[which]) - float(which.sum())


def delay_error_s(solution: Solution, in_time_s: float, worse: float) -> float:
    """Standard error of the delay, s, frequency and damping being as unknown as the gains.

    `worse` is the squares that the best fit with a delay up to `in_time_s` leaves more than this one.
    """
    error, delay_s = _curvature_error(solution), solution.dynamics.delay_s
    if delay_s <= in_time_s:
        return error
    # The misfit need not be a parabola: how much worse an answer in time would be counts, too.
    level = max(float(2 * solution.noise.sum() - solution.noise[0]), 1e-30)
    return max(error, (delay_s - in_time_s) / math.sqrt(max(worse / level, 1e-6)))


def _curvature_error(solution: Solution) -> float:
    problem, point = solution.regression, solution.dynamics
    slopes = []
    for i, step in enumerate((0.02 * point.w, 0.02 * point.zeta, 0.005)):
        high, low = (Dynamics(*(x + sign * step * (j == i) for j, x in enumerate(point))) for sign in (1, -1))
        low = low._replace(delay_s=max(low.delay_s, 0.0))
        difference = problem.filtered(high) - problem.filtered(low)
        slopes.append(problem.free(difference[:, solution.used] @ solution.b) / (high[i] - low[i]))
    J = np.column_stack([solution.X, *slopes])
    J = J / np.maximum(np.linalg.norm(J, axis=0), 1e-30)
    scale = max(float(np.linalg.norm(slopes[2])), 1e-30)
    inverse = np.linalg.pinv(J, rcond=1e-3)
    variance = float(inverse[-1] @ matmul_toeplitz(solution.noise, inverse[-1]))
    return math.sqrt(max(variance, 0.0)) / scale
