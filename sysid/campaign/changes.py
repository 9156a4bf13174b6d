"""Did a parameter change: by a step at some date, by a drift, or with something else that was logged?

Chances are those of the days' order: where nothing changed, every order of the days is as likely as the one that was
flown, whatever the spread between days is like. So the largest step over all dates needs no formula of its own. What
conditions explain (rotor speed, airspeed) is taken out first, and it is what they leave that is put in other orders
(Freedman and Lane, J. Bus. Econ. Stat. 1, 1983, p. 292).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from sysid.campaign.spread import Line, line
from sysid.campaign.values import Days
from sysid.data.record import FloatArray

Kind = Literal["step", "drift"]

FEWEST_DAYS = 3
"""On each side of a step, and for each condition."""
ORDERS = 20_000
FIRST, AT_ONCE = 100, 2_000
ENOUGH = 20
"""Orders that show as much as was flown: then the chance is told well enough, and is no small one (Besag and Clifford,
Biometrika 78, 1991, p. 301)."""
PROBABILITY = 0.95
YEAR = 365.25
NOTHING = 1e-9
"""Of a column, that others leave of it: then it is one of theirs."""


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
    column: FloatArray
    """(n,) what the size is multiplied by: 0 and 1, or years."""
    since: int | None = None
    """A step's first day."""
    since_within: tuple[int, int] | None = None
    """The last day before it and its first day, at the earliest and at the latest (95 %)."""
    followed_by: tuple[int, int] | None = None
    """Of how many flights since then how many are nearer to what is flown since."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Dependence:
    """How a parameter goes with a condition, beside all others."""

    condition: str
    size: float
    """In units of the parameter, for one of the condition."""
    error: float
    chance: float
    goes_with_time: float
    """0 to 1: how much of the condition itself is a step or a drift over the days; near 1 nobody can tell whether the
    condition or the vehicle changed."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Changes:
    """All that is asked of a parameter."""

    step: Change
    drift: Change
    dependences: tuple[Dependence, ...]

    @property
    def chances(self) -> tuple[float, ...]:
        """Of the step, of the drift, and of each dependence."""
        return self.step.chance, self.drift.chance, *(one.chance for one in self.dependences)

    @property
    def likelier(self) -> Change:
        """The one that leaves less, a step's date counted as one coefficient more (BIC)."""
        n = len(self.step.line.left)
        ahead = self.step.line.log_likelihood - 0.5 * np.log(n) > self.drift.line.log_likelihood
        return self.step if ahead else self.drift


def accounted(days: Days) -> list[str]:
    """As many of the conditions as there are days for."""
    room = len(days) // FEWEST_DAYS - 2
    return list(days.conditions)[: max(0, room)]


def level_of(days: Days) -> Line:
    """The mean, and what conditions make of it, as if nothing changed. Raises ValueError where there is one day."""
    return line(_columns(days), days.value, days.error)


def line_along(days: Days, column: FloatArray) -> Line:
    """The mean, conditions, and (n,) a column, whose coefficient is the last."""
    return line(np.column_stack([_columns(days), column]), days.value, days.error)


def changes_of(days: Days, chance: np.random.Generator, orders: int = ORDERS) -> Changes | None:
    """The largest step, the drift and the dependences; None where there are too few days for any."""
    n = len(days)
    if n < 2 * FEWEST_DAYS:
        return None
    columns, names = _columns(days), accounted(days)
    level, years = line(columns, days.value, days.error), (days.day - days.day.mean()) / YEAR
    cuts = np.arange(FEWEST_DAYS, n - FEWEST_DAYS + 1)
    steps = _Asked(lambda x: _since(x)[:, cuts], columns)
    drifts = _Asked(lambda x: x @ years[:, None], columns, squared=lambda x: x @ years[:, None] ** 2)
    flown = steps.explained(level.left[None], level.weight[None])[0]

    def largest(left: FloatArray, weight: FloatArray) -> FloatArray:
        both = steps.explained(left, weight).max(axis=1, keepdims=True), drifts.explained(left, weight)
        return np.concatenate(both, axis=1)

    by_chance = _chances(level, chance, largest, orders)
    step = _step(days, cuts, flown, float(by_chance[0]))
    found = line_along(days, years)
    drift = Change(
        kind="drift",
        size=float(found.at[-1]),
        error=float(found.covariance[-1, -1] ** 0.5),
        chance=float(by_chance[1]),
        line=found,
        column=years,
    )
    with_time = np.column_stack([np.arange(n)[:, None] >= cuts, years])
    dependences = [_dependence(days, columns, names, k, with_time, chance, orders) for k in range(len(names))]
    return Changes(step=step, drift=drift, dependences=tuple(dependences))


def _columns(days: Days) -> FloatArray:
    return np.column_stack([np.ones(len(days)), *(days.conditions[name] for name in accounted(days))])


def _step(days: Days, cuts: NDArray[np.int64], flown: FloatArray, chance: float) -> Change:
    """Where it explains most."""
    cut = int(cuts[int(np.argmax(flown))])
    since = (np.arange(len(days)) >= cut).astype(float)
    found = line_along(days, since)
    likely = np.flatnonzero(flown > flown.max() - stats.chi2.ppf(PROBABILITY, 1)) + FEWEST_DAYS
    size, rest = float(found.at[-1]), (found.left - days.value)[cut:]  # less the level, conditions and step
    nearer = [
        abs(one.value + off) < abs(one.value + off + size)
        for off, flights in zip(rest, days.flights[cut:], strict=True)
        for one in flights
    ]
    return Change(
        kind="step",
        size=size,
        error=float(found.covariance[-1, -1] ** 0.5),
        chance=chance,
        line=found,
        column=since,
        since=int(days.day[cut]),
        since_within=(int(days.day[likely.min() - 1]), int(days.day[likely.max()])),
        followed_by=(len(nearer), sum(nearer)),
    )


def _dependence(
    days: Days,
    columns: FloatArray,
    names: Sequence[str],
    k: int,
    with_time: FloatArray,
    chance: np.random.Generator,
    orders: int,
) -> Dependence:
    """On the k-th condition, beside the others."""
    own, others = columns[:, k + 1], np.delete(columns, k + 1, axis=1)
    asked = _Asked(lambda x: x @ own[:, None], others, squared=lambda x: x @ own[:, None] ** 2)
    without = line(others, days.value, days.error)
    whole = line(columns, days.value, days.error)
    off = with_time - with_time.mean(axis=0)
    alike = np.abs(off.T @ own) / np.sqrt(np.sum(off**2, axis=0) * np.sum(own**2))
    return Dependence(
        condition=names[k],
        size=float(whole.at[k + 1]),
        error=float(whole.covariance[k + 1, k + 1] ** 0.5),
        chance=float(_chances(without, chance, asked.explained, orders)[0]),
        goes_with_time=float(alike.max() ** 2),
    )


def _since(x: FloatArray) -> FloatArray:
    """Sums over each day and all later ones."""
    return np.asarray(np.cumsum(x[:, ::-1], axis=1)[:, ::-1])


@dataclass(frozen=True, eq=False)
class _Asked:
    """Columns s that may explain what others C leave, as sums over days: (orders, n) to (orders, s)."""

    sums: Callable[[FloatArray], FloatArray]
    columns: FloatArray
    squared: Callable[[FloatArray], FloatArray] | None = None
    """The sums with their squares; None where they are 0 and 1."""

    def explained(self, left: FloatArray, weight: FloatArray) -> FloatArray:
        """(orders, s) squared coefficient of each column in its variance, of (orders, n) values and weights."""
        C, pulled = self.columns, weight * left
        k = C.shape[1]
        G = (weight @ (C[:, :, None] * C[:, None, :]).reshape(len(C), -1)).reshape(-1, k, k)
        b = np.stack([self.sums(weight * C[:, j]) for j in range(k)], axis=1)
        h = np.linalg.solve(G, b)
        along = self.sums(pulled) - np.einsum("oj,ojs->os", pulled @ C, h)
        whole = (self.squared or self.sums)(weight)
        rest = whole - np.einsum("ojs,ojs->os", b, h)
        return np.where(rest > NOTHING * whole, along**2 / np.maximum(rest, NOTHING * whole), 0.0)


def _chances(
    level: Line,
    chance: np.random.Generator,
    statistics: Callable[[FloatArray, FloatArray], FloatArray],
    orders: int,
) -> FloatArray:
    """(s,) share of the orders, the flown one among them, in which days with their errors show as much."""
    flown = statistics(level.left[None], level.weight[None])[0] * (1 - 1e-9)
    found, counted, done = np.full(flown.size, np.nan), np.zeros(flown.size, dtype=int), 0
    while done < orders and np.isnan(found).any():
        size = min(FIRST if not done else AT_ONCE, orders - done)
        drawn = chance.permuted(np.tile(np.arange(len(level.left)), (size, 1)), axis=1)
        counts = counted + np.cumsum(statistics(level.left[drawn], level.weight[drawn]) >= flown, axis=0)
        ended = np.isnan(found) & (counts[-1] >= ENOUGH)
        at = done + 1 + np.argmax(counts >= ENOUGH, axis=0)
        found[ended] = ENOUGH / at[ended]
        counted, done = counts[-1], done + size
    return np.where(np.isnan(found), (1 + counted) / (1 + orders), found)
