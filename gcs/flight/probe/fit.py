"""The fit of each rate's gains and delay.

The answer is fitted as

    rate_i(t) = sum_j (b0_ij + b1_ij s) w_i^2 / (s^2 + 2 zeta_i w_i s + w_i^2) delta_j(t - T_i)

`w`, `zeta` and `T` are searched, `b0` and `b1` follow from them (see `regression`). A gain is the rate half a second
after a step of full command; of both commands on both rates it is a 2 x 2 matrix.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from gcs.flight.probe.errors import Solution, autocovariance, delay_error_s, evidence, hover_rate
from gcs.flight.probe.grid import GRID_S, Gridded, gridded
from gcs.flight.probe.regression import Dynamics, Regression, lag, late, regression, solve
from gcs.flight.probe.values import LATE_S, LETTERS, FloatArray, ProbeStep, Samples

SEEN = 4.5
"""Answer over its standard error from which it is taken for one."""

_REACHED_S = (0.25, 0.75)
"""After a step of the command: what is reached there is called the gain."""
_LATEST_S = 0.4

Misfit = Callable[[FloatArray], float]
"""What is left at log w, log zeta and the delay in s, shape (3,)."""


@dataclass(frozen=True, eq=False, slots=True, kw_only=True)
class RateFit:
    """One rate's answer to the commands."""

    gain: FloatArray
    """Rate half a second after a step of full command, shape (m,) in the order of `Fit.letters`."""
    covariance: FloatArray
    """Shape (m, m)."""
    evidence: FloatArray
    """How far each command's whole answer stands out, squared standard errors less what noise gives, shape (m,)."""
    delay_s: float
    delay_error_s: float
    answered: tuple[FloatArray, ...]
    """The fitted answer to what was added in each step, on its grid, without offset and slope."""


@dataclass(frozen=True, eq=False, slots=True)
class Fit:
    """What the steps together say of each rate."""

    letters: tuple[str, ...]
    rates: tuple[str, ...]
    rows: tuple[RateFit, ...]
    steps: tuple[Gridded, ...]

    @property
    def G(self) -> FloatArray:
        """Gains, shape (rates, letters)."""
        return np.array([row.gain for row in self.rows])

    def variance(self, weights: FloatArray) -> float:
        """Of the sum of weights times G, both of shape (rates, letters)."""
        return float(sum(w @ row.covariance @ w for w, row in zip(weights, self.rows, strict=True)))

    def signal_to_noise(self, column: int) -> float:
        """The answer of all rates to one command over its standard error."""
        return math.sqrt(max(0.0, sum(float(row.evidence[column]) for row in self.rows)))


def fit_steps(quiet: Samples, steps: Sequence[ProbeStep], rates: tuple[str, ...]) -> Fit:
    """These rates' answers in all the steps, with the noise of the quiet hover."""
    grids = tuple(gridded(step, rates) for step in steps)
    letters = tuple(dict.fromkeys(LETTERS[grid.axis] for grid in grids))
    rows = tuple(_fit_rate(regression(grids, letters, rate), hover_rate(quiet, rate)) for rate in rates)
    return Fit(letters, rates, rows, grids)


def _fit_rate(problem: Regression, quiet: FloatArray) -> RateFit:
    m = len(problem.letters)
    z = problem.instrumented(problem.y)
    answers = lru_cache(maxsize=1)(problem.answers)  # a delay moves them, and asks for no new ones

    def misfit(point: FloatArray) -> float:
        w, zeta, delay_s = _natural(point)
        return solve(m, problem.instrumented(late(answers(w, zeta), delay_s)), z).unexplained

    best, worse = _search(misfit)
    filtered = problem.filtered(best)
    b, used, _ = solve(m, problem.instrumented(filtered), z)
    X = problem.free(filtered[:, used])
    noise = autocovariance(problem.free(problem.y) - X @ b, quiet)
    return _rate_fit(Solution(regression=problem, dynamics=best, b=b, used=used, X=X, noise=noise), worse)


def _search(misfit: Misfit) -> tuple[Dynamics, float]:
    """The best point, and the squares that the best point in time leaves more."""

    def early(point: FloatArray) -> float:
        return misfit(point) if point[2] <= LATE_S else math.inf

    starts = [
        np.array([math.log(w), math.log(zeta), delay])
        for w in np.geomspace(2.0, 50.0, 8)
        for zeta in (0.3, 0.6, 1.2)
        for delay in np.arange(0.0, _LATEST_S, 0.03)
    ]
    errors = np.array([misfit(point) for point in starts])
    best = _refined(misfit, starts[int(np.argmin(errors))])
    in_time = np.where([start[2] <= LATE_S for start in starts], errors, math.inf)
    worse = early(_refined(early, starts[int(np.argmin(in_time))])) - misfit(best)
    return _natural(best), max(worse, 0.0)


def _natural(point: FloatArray) -> Dynamics:
    """Within what is searched."""
    w, zeta = math.exp(min(max(point[0], 0.0), 4.2)), math.exp(min(max(point[1], -1.8), 1.1))
    return Dynamics(w, zeta, min(max(float(point[2]), 0.0), _LATEST_S))


def _refined(misfit: Misfit, point: FloatArray) -> FloatArray:
    """Coordinate steps that halve; three unknowns, and nothing that can fail."""
    best, steps = misfit(point), np.array([0.2, 0.3, 0.015])
    for _ in range(6):
        for i in range(3):
            for sign in (1.0, -1.0):
                tried = point.copy()
                tried[i] += sign * steps[i]
                error = misfit(tried)
                if error < best:
                    point, best = tried, error
        steps = steps / 2
    return point


def _rate_fit(solution: Solution, worse: float) -> RateFit:
    """Gains and answers with errors that hold for coloured noise; `worse` as `delay_error_s` wants it."""
    problem, b, used = solution.regression, solution.b, solution.used
    m = len(problem.letters)
    covariance = solution.covariance()
    reached = _reached(m, solution.dynamics)[:, used]
    answered = np.zeros(problem.rows.size)
    answered[problem.rows] = problem.instruments @ (problem.instruments.T @ (solution.X @ b))
    bounds = np.cumsum([grid.rows.size for grid in problem.grids])[:-1]
    return RateFit(
        gain=reached @ b,
        covariance=reached @ covariance @ reached.T,
        evidence=np.array([evidence(b, covariance, used % m == j) for j in range(m)]),
        delay_s=solution.dynamics.delay_s,
        delay_error_s=delay_error_s(solution, LATE_S, worse),
        answered=tuple(np.split(answered, bounds)),
    )


def _reached(m: int, dynamics: Dynamics) -> FloatArray:
    """The filter's and its derivative's mean answer to a step within `_REACHED_S`, shape (m, 2 m)."""
    start, stop = (round(at / GRID_S) for at in _REACHED_S)
    position, speed = lag(np.ones((1, stop)), dynamics.w, dynamics.zeta)[:, start:].mean(axis=1)
    return np.hstack([position * np.eye(m), speed * np.eye(m)])
