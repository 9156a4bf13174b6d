"""Did a parameter change: by a step at some date, by a drift, or with something else that was logged?

Chances are those of the days' order: where nothing changed, every order of the days is as likely as the one that was
flown, whatever the spread between days is like. So the largest step over all dates needs no formula of its own.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np
from scipy import stats

from sysid.campaign.spread import Line, line
from sysid.campaign.values import Days
from sysid.data.record import FloatArray

Kind = Literal["step", "drift"]

FEWEST_DAYS = 3
"""On each side of a step."""
ORDERS = 20_000
AT_ONCE = 2_000
PROBABILITY = 0.95


@dataclass(frozen=True, eq=False, kw_only=True)
class Change:
    """What the order of the days tells, significant or not."""

    kind: Kind
    size: float
    """Of a step what it was, of a drift its change in a year."""
    error: float
    """Standard error, by the spread between days as well."""
    chance: float
    """That an order by chance shows as large a one of its kind; of a step over all dates."""
    line: Line
    since: int | None = None
    """A step's first day."""
    since_within: tuple[int, int] | None = None
    """The last day before it and its first day, at the earliest and at the latest (95 %)."""
    followed_by: tuple[int, int] | None = None
    """Of how many flights since then how many are nearer to what is flown since."""


def step_of(days: Days, chance: np.random.Generator) -> Change | None:
    """The largest step; None where there are too few days for one."""
    n = len(days)
    if n < 2 * FEWEST_DAYS:
        return None
    level = line(np.ones((n, 1)), days.value, days.error)
    flown = _steps(level.left[None], level.weight[None])[0]
    cut = int(np.argmax(flown)) + FEWEST_DAYS
    found = line(np.column_stack([np.ones(n), np.arange(n) >= cut]), days.value, days.error)
    likely = np.flatnonzero(flown > flown.max() - stats.chi2.ppf(PROBABILITY, 1)) + FEWEST_DAYS
    nearer = [
        abs(one.value - found.at.sum()) < abs(one.value - found.at[0])
        for flights in days.flights[cut:]
        for one in flights
    ]
    return Change(
        kind="step",
        size=float(found.at[1]),
        error=float(found.covariance[1, 1] ** 0.5),
        chance=_chance(level, chance, lambda left, weight: _steps(left, weight).max(axis=1), float(flown.max())),
        line=found,
        since=int(days.day[cut]),
        since_within=(int(days.day[likely.min() - 1]), int(days.day[likely.max()])),
        followed_by=(len(nearer), sum(nearer)),
    )


def drift_of(days: Days, chance: np.random.Generator) -> Change | None:
    """A steady change over time; None where there are too few days for one."""
    n = len(days)
    if n < 2 * FEWEST_DAYS:
        return None
    years = (days.day - days.day.mean()) / 365.25
    level = line(np.ones((n, 1)), days.value, days.error)
    found = line(np.column_stack([np.ones(n), years]), days.value, days.error)

    def slopes(left: FloatArray, weight: FloatArray) -> FloatArray:
        off = years - (weight @ years / weight.sum(axis=1))[:, None]
        return np.asarray(np.sum(weight * off * left, axis=1) ** 2 / np.sum(weight * off**2, axis=1))

    return Change(
        kind="drift",
        size=float(found.at[1]),
        error=float(found.covariance[1, 1] ** 0.5),
        chance=_chance(level, chance, slopes, float(slopes(level.left[None], level.weight[None])[0])),
        line=found,
    )


def likelier(step: Change, drift: Change) -> Change:
    """Of the two the one that leaves less, its date counted as one coefficient more (BIC)."""
    n = len(step.line.left)
    return step if step.line.log_likelihood - 0.5 * np.log(n) > drift.line.log_likelihood else drift


def _steps(left: FloatArray, weight: FloatArray) -> FloatArray:
    """(orders, cuts): squared difference of the means before and since each cut, in its variances."""
    inside = slice(FEWEST_DAYS - 1, -FEWEST_DAYS)
    before, sums = np.cumsum(weight, axis=1)[:, inside], np.cumsum(weight * left, axis=1)[:, inside]
    since, rest = weight.sum(axis=1, keepdims=True) - before, (weight * left).sum(axis=1, keepdims=True) - sums
    return np.asarray((rest / since - sums / before) ** 2 / (1 / before + 1 / since))


def _chance(
    level: Line, chance: np.random.Generator, statistic: Callable[[FloatArray, FloatArray], FloatArray], flown: float
) -> float:
    """Share of the orders, the flown one among them, in which days with their errors show as much."""
    as_much = 1
    for _ in range(ORDERS // AT_ONCE):
        orders = chance.permuted(np.tile(np.arange(len(level.left)), (AT_ONCE, 1)), axis=1)
        as_much += int(np.sum(statistic(level.left[orders], level.weight[orders]) >= flown * (1 - 1e-9)))
    return as_much / (1 + ORDERS)
