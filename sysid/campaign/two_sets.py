"""Did a parameter change between two sets of flights, by how much, and what could they not have shown?

A mean of each set, what conditions make of it, and the spread between days told from the errors within, as over a whole
campaign; but the date is known, so that Student's distribution is enough (Hartung and Knapp, Stat. Med. 20, 2001,
p. 3875, with the spread of Paule and Mandel).
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy import stats

from sysid.campaign.changes import FEWEST_DAYS
from sysid.campaign.claims import FALSE_SHARE, adjusted_chances, single_chance
from sysid.campaign.spread import line
from sysid.campaign.values import SAME, Days, Estimate, by_day

SURE = 0.95
SHOWN = 0.8
"""Share of such changes that so many flights would show."""
FEWEST = 3
"""Flights of a set that can be told to be enough: below, their spread is not known."""


@dataclass(frozen=True, kw_only=True)
class Difference:
    """One parameter, second set less first."""

    parameter: str
    before: float
    """Mean of the first set."""
    size: float
    error: float
    """Standard error, with the spread between days; of the flights' own errors alone where there is no spread to
    see."""
    chance: float | None
    """Of as much where nothing changed, adjusted for all parameters; None where there are too few to tell."""
    beyond: float | None
    """95 %: it did not change by more than this, either way. None as above."""
    counts: tuple[int, int]
    """Days, or flights where there are fewer than three days in a set."""

    @property
    def changed(self) -> bool:
        return self.chance is not None and self.chance < FALSE_SHARE

    def needed(self, size: float, asked: int) -> int:
        """Days (or flights) in each set that would show a change of this size, of so many parameters asked."""
        times = float(stats.norm.isf(single_chance(asked) / 2) + stats.norm.ppf(SHOWN))
        one = self.error / math.sqrt(1 / self.counts[0] + 1 / self.counts[1])
        return max(FEWEST, math.ceil(2 * (times * one / size) ** 2))


def by_days(sets: Sequence[Sequence[Estimate]]) -> bool:
    """Whether days are what is compared: flights of one day share weather, battery and mass."""
    return all(len({one.day for one in each}) >= FEWEST_DAYS for each in sets)


def differences(first: Mapping[str, Sequence[Estimate]], second: Mapping[str, Sequence[Estimate]]) -> list[Difference]:
    """Of every parameter that both sets have, in the order of the first."""
    found = [_difference(name, first[name], second[name]) for name in first if second.get(name)]
    adjusted = iter(adjusted_chances([one.chance for one in found if one.chance is not None]))
    return [one if one.chance is None else replace(one, chance=next(adjusted)) for one in found]


def _difference(name: str, first: Sequence[Estimate], second: Sequence[Estimate]) -> Difference:
    sets = [_apart(each) for each in (first, second)] if not by_days((first, second)) else [first, second]
    days = [by_day(each) for each in sets]
    value, error = (np.concatenate([getattr(one, what) for one in days]) for what in ("value", "error"))
    counts = len(days[0]), len(days[1])
    later = np.repeat([0.0, 1.0], counts)
    columns = np.column_stack([np.ones(len(value)), *_conditions(days, len(value)), later])
    freedom = len(value) - columns.shape[1]
    if freedom < 1 or min(counts) < 2:
        means = [one.value @ one.error**-2 / np.sum(one.error**-2) for one in days]
        spread = math.sqrt(sum(1 / float(np.sum(one.error**-2)) for one in days))
        return Difference(parameter=name, before=float(means[0]), size=float(means[1] - means[0]), error=spread,
                          chance=None, beyond=None, counts=counts)  # fmt: skip
    found = line(columns, value, error)
    size, spread = float(found.at[-1]), float(found.covariance[-1, -1] ** 0.5)
    return Difference(
        parameter=name,
        before=float(found.at[0]),
        size=size,
        error=spread,
        chance=float(2 * stats.t.sf(abs(size) / spread, freedom)),
        beyond=abs(size) + float(stats.t.ppf(SURE, freedom)) * spread,
        counts=counts,
    )


def _apart(flights: Sequence[Estimate]) -> list[Estimate]:
    """Each as of a day of its own."""
    return [replace(one, day=place) for place, one in enumerate(flights)]


def _conditions(days: Sequence[Days], n: int) -> list[np.ndarray[tuple[int], np.dtype[np.float64]]]:
    """Those that both sets tell, as many as there are days for; less their common mean."""
    told = [set.intersection(*(set(one.conditions) for each in part.flights for one in each)) for part in days]
    each = []
    for name in sorted(told[0] & told[1])[: max(0, n // FEWEST_DAYS - 2)]:
        means = np.array([np.mean([one.conditions[name] for one in some]) for part in days for some in part.flights])
        if np.std(means) > SAME * abs(np.mean(means)):
            each.append(means - means.mean())
    return each
