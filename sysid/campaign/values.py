"""What flights say of one parameter, side by side: numbers that flights of one day share their chances in."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from sysid.data.record import FloatArray

SAME = 2e-3
"""Of its size: a condition that differs by less is the same on all days, and tells nothing."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Estimate:
    """One flight's value of one parameter."""

    flight: str
    """Which; near copies of one flight have one name."""
    day: int
    """Days since 1970, UTC: flights of one day share weather, battery, mass."""
    value: float
    error: float
    """Standard error within the flight, > 0."""
    conditions: Mapping[str, float] = field(default_factory=dict)
    """What else may move a value: rotor speed, airspeed; means over the flight."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Days:
    """One parameter, a number for each day in their order: what is exchangeable where nothing changed."""

    day: NDArray[np.int64]
    """(n,), rising."""
    value: FloatArray
    """(n,)"""
    error: FloatArray
    """(n,) standard error of the day's mean, by its flights' own errors and their spread within days."""
    flights: tuple[tuple[Estimate, ...], ...]
    """(n,) those of each day."""
    within: float | None
    """Standard deviation between flights of one day, beyond their own errors; None where no day has two."""
    conditions: Mapping[str, FloatArray] = field(default_factory=dict)
    """(n,) each, less their mean: those that all flights tell, and that differ between days."""

    def __len__(self) -> int:
        return len(self.day)


def by_day(estimates: Sequence[Estimate]) -> Days:
    """Flights brought together day by day. Raises ValueError for an error that is not positive, or no flights."""
    if not estimates:
        raise ValueError("no flights")
    if not all(np.isfinite(one.value) and 0 < one.error < np.inf for one in estimates):
        raise ValueError("each value must be finite and its standard error positive")
    ordered = sorted(estimates, key=lambda one: (one.day, one.flight))
    days = np.array(sorted({one.day for one in ordered}))
    each = tuple(tuple(one for one in ordered if one.day == day) for day in days)
    seen = _variance_within(each)
    within = seen or 0.0
    values, errors = zip(*(_mean(flights, within) for flights in each), strict=True)
    return Days(
        day=days,
        value=np.array(values),
        error=np.array(errors),
        flights=each,
        within=None if seen is None else seen**0.5,
        conditions=_conditions(each, within),
    )


def _mean(flights: Sequence[Estimate], within: float) -> tuple[float, float]:
    weight = np.array([1 / (one.error**2 + within) for one in flights])
    return float(weight @ [one.value for one in flights] / weight.sum()), float(weight.sum() ** -0.5)


def _conditions(days: Sequence[Sequence[Estimate]], within: float) -> dict[str, FloatArray]:
    """Weighted as the values are."""
    told = set.intersection(*(set(one.conditions) for flights in days for one in flights))
    found = {}
    for name in sorted(told):
        each = []
        for flights in days:
            weight = np.array([1 / (one.error**2 + within) for one in flights])
            each.append(float(weight @ [one.conditions[name] for one in flights] / weight.sum()))
        mean = float(np.mean(each))
        if np.std(each) > SAME * abs(mean):
            found[name] = np.array(each) - mean
    return found


def _variance_within(days: Sequence[Sequence[Estimate]]) -> float | None:
    """By how much flights of one day differ beyond their errors: squared unit, of all days together (moments); None
    where no day has two."""
    excess, freedom = 0.0, 0.0
    for flights in days:
        if len(flights) > 1:
            error = np.array([one.error for one in flights])
            value = np.array([one.value for one in flights])
            weight = error**-2 / np.sum(error**-2)
            excess += float(weight @ (value - weight @ value) ** 2 - weight @ error**2 * (1 - weight @ weight))
            freedom += float(1 - weight @ weight)
    return max(0.0, excess / freedom) if freedom > 0 else None
