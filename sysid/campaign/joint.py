"""Which parameter did a change sit in, where the fits cannot tell some of them apart?

Two things follow from the joint covariance of each fit. Parameters that trade against each other (a delay and a lag)
may both be too uncertain by themselves to show a change that their best known combination shows. And of several that
seem changed at once all but one may have moved by their errors alone, or no single one may explain it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from scipy import stats
from scipy.sparse.csgraph import connected_components

from sysid.campaign.values import SAME, Estimate
from sysid.data.record import FloatArray

CLOSE = 0.9
"""Correlation of two estimates, averaged over flights, from which on they are looked at together."""
TAKES_PART = 0.25
"""Of a unit vector: a parameter that has less of a combination is none of its members."""
DOUBTED = 0.01
"""Chance below which a parameter alone does not explain what all show,"""
FAR = 9.0
"""and by how much more squared standard errors than the best one's."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Flight:
    """All free parameters of one flight's fit."""

    flight: str
    day: int
    """Days since 1970."""
    values: Mapping[str, float]
    covariance: FloatArray
    """(p, p), in their order."""
    conditions: Mapping[str, float] = field(default_factory=dict)

    def of(self, names: Sequence[str]) -> tuple[FloatArray, FloatArray]:
        """(k,) values and (k, k) covariance of some."""
        places = [list(self.values).index(name) for name in names]
        return np.array([self.values[name] for name in names]), self.covariance[np.ix_(places, places)]


@dataclass(frozen=True, eq=False, kw_only=True)
class Combination:
    """Parameters that fits hardly tell apart, and what they do tell of them: a number without a unit."""

    members: tuple[str, ...]
    per_unit: FloatArray
    """(m,) of the number, for one unit of each."""
    estimates: tuple[Estimate, ...]

    def alone(self, size: float) -> dict[str, float]:
        """How much each of the members would have changed, had it changed alone."""
        return {name: float(size / per) for name, per in zip(self.members, self.per_unit, strict=True)}


def combinations(flights: Sequence[Flight]) -> list[Combination]:
    """Of each set of parameters that are close to each other the best known combination."""
    names = _common(flights)
    if len(names) < 2:
        return []
    covariances = np.array([one.of(names)[1] for one in flights])
    errors = np.sqrt(np.diagonal(covariances, axis1=1, axis2=2))
    mean = np.mean(covariances / (errors[:, :, None] * errors[:, None, :]), axis=0)
    scale = np.median(errors, axis=0)
    count, label = connected_components(np.abs(mean) > CLOSE, directed=False)
    found = []
    for number in range(count):
        places = np.flatnonzero(label == number)
        if places.size > 1:
            best = np.linalg.eigh(mean[np.ix_(places, places)])[1][:, 0]
            places, best = places[np.abs(best) > TAKES_PART], best[np.abs(best) > TAKES_PART]
            found.append(_combined(flights, [names[i] for i in places], best / scale[places]))
    return [one for one in found if len(one.members) > 1]


def _combined(flights: Sequence[Flight], members: Sequence[str], per_unit: FloatArray) -> Combination:
    estimates = []
    for one in flights:
        values, covariance = one.of(members)
        estimates.append(
            Estimate(
                flight=one.flight,
                day=one.day,
                value=float(per_unit @ values),
                error=float((per_unit @ covariance @ per_unit) ** 0.5),
                conditions=one.conditions,
            )
        )
    return Combination(members=tuple(members), per_unit=per_unit, estimates=tuple(estimates))


@dataclass(frozen=True, kw_only=True)
class Alone:
    """A parameter that by itself explains what all of them show."""

    name: str
    size: float
    """For one of the column that it was asked with."""
    error: float
    chance: float
    """That the others differ by chance as much as they do, had it changed alone."""


def alone(flights: Sequence[Flight], of_day: Mapping[int, float]) -> list[Alone]:
    """The parameters of which one, changed alone along a column, explains all; the likeliest first. Empty where none
    does, or where there are too few days to ask. `of_day` is the column: 0 and 1 of a step, or years."""
    names = _common(flights)
    days = sorted({one.day for one in flights} & set(of_day))
    conditions = _conditions(flights, days)
    n, p, k = len(days), len(names), 2 + conditions.shape[1]
    if p < 2 or n < k + 2 or not all(_certain(one.of(names)[1]) for one in flights):
        return []
    values, errors = _by_day(flights, days, names)
    columns = np.column_stack([np.ones(n), conditions, [of_day[day] for day in days]])
    inverse = np.linalg.pinv(columns.T @ columns)
    at = inverse @ columns.T @ values
    left = values - columns @ at
    spread, freedom = _spread(left, errors, n - k)
    moved = at[-1]
    S = np.linalg.inv(spread * inverse[-1, -1])
    pulls, squares = S @ moved, float(moved @ S @ moved)
    rest = squares - pulls**2 / np.diag(S)
    q = p - 1
    chances = stats.f.sf(rest * (freedom - q + 1) / (freedom * q), q, freedom - q + 1)
    return [
        Alone(name=names[i], size=float(pulls[i] / S[i, i]), error=float(S[i, i] ** -0.5), chance=float(chances[i]))
        for i in np.argsort(rest)
        if rest[i] < rest.min() + FAR and chances[i] > DOUBTED
    ]


def _certain(covariance: FloatArray) -> bool:
    return bool(np.all(np.isfinite(covariance)) and np.all(np.diag(covariance) > 0))


def _common(flights: Sequence[Flight]) -> list[str]:
    """The names that all flights have."""
    if not flights:
        return []
    first, *others = (one.values for one in flights)
    return [name for name in first if all(name in one for one in others)]


def _conditions(flights: Sequence[Flight], days: Sequence[int]) -> FloatArray:
    """(n, k) of what all flights tell and what differs, by day, less their means."""
    told = sorted(set.intersection(*(set(one.conditions) for one in flights)))
    each = [[np.mean([one.conditions[name] for one in flights if one.day == day]) for day in days] for name in told]
    differs = [np.array(one) - np.mean(one) for one in each if np.std(one) > SAME * abs(np.mean(one))]
    return np.array(differs).reshape(len(differs), len(days)).T


def _by_day(flights: Sequence[Flight], days: Sequence[int], names: Sequence[str]) -> tuple[FloatArray, FloatArray]:
    """(n, p) means and (n, p, p) covariances of their errors."""
    values, errors = [], []
    for day in days:
        each = [one.of(names) for one in flights if one.day == day]
        values.append(np.mean([one for one, _ in each], axis=0))
        errors.append(np.sum([one for _, one in each], axis=0) / len(each) ** 2)
    return np.array(values), np.array(errors)


def _spread(left: FloatArray, errors: FloatArray, freedom: int) -> tuple[FloatArray, int]:
    """(p, p) covariance between days, as it is seen, held to the fits' correlations where days are few; and what it is
    worth in days."""
    seen = left.T @ left
    known = errors.mean(axis=0)
    size = np.sqrt(np.maximum(np.diag(seen) / freedom, np.diag(known)))
    correlation = known / np.sqrt(np.outer(np.diag(known), np.diag(known)))
    prior = correlation * np.outer(size, size)
    worth = left.shape[1] + 1
    return (seen + worth * prior) / (freedom + worth), freedom + worth
