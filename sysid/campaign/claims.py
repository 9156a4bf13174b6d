"""What may be said of a whole campaign: of all parameters of all vehicles, few claims are false.

A hundred parameters looked at by themselves show five changes by chance. Here the expected share of false ones among
all that is claimed is held (Benjamini and Yekutieli, Ann. Statist. 29, 2001, p. 1165), whatever depends on what.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy import stats

from sysid.campaign.changes import FEWEST_DAYS, ORDERS, Change, Changes, Dependence, changes_of, level_of
from sysid.campaign.spread import Line
from sysid.campaign.values import Days, Estimate, by_day

FALSE_SHARE = 0.01
"""Of all claims, expected. In a campaign where nothing changed it is the chance of any claim."""
MOST_ORDERS = 400_000
SMALLEST = 0.5
"""Of the chance below which a single claim must be: as what a change that no order reaches is told, at most."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Outlier:
    """A day that agrees with no other."""

    day: int
    flights: tuple[str, ...]
    value: float
    deviations: float
    """From the others, in its own error and their spread."""
    chance: float
    """Adjusted for all days of all parameters."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Course:
    """One parameter of one vehicle over the campaign."""

    days: Days
    level: Line
    """The mean, what conditions make of it, and the spread between days, as if nothing changed."""
    change: Change | None
    """The likelier kind; None where there are too few days."""
    claimed: bool
    """Whether the change may be told as one."""
    chance: float | None
    """Of the change, adjusted for all that was asked; None where nothing was."""
    outliers: tuple[Outlier, ...]
    dependences: tuple[Dependence, ...] = ()
    """On the conditions that may be told: of all of them those that are significant."""

    @property
    def line(self) -> Line:
        """What the days are to be seen against: with the change where it is claimed."""
        return self.change.line if self.claimed and self.change is not None else self.level


def courses(
    estimates: Mapping[tuple[str, str], Sequence[Estimate]], chance: np.random.Generator
) -> dict[tuple[str, str], Course]:
    """(vehicle, parameter) -> its course. `chance` draws orders of days."""
    days = {key: by_day(each) for key, each in estimates.items()}
    levels = {key: level_of(one) for key, one in days.items() if len(one) > 1}
    orders = _orders(sum(2 + len(days[key].conditions) for key in levels if len(days[key]) >= 2 * FEWEST_DAYS))
    asked = {key: changes_of(days[key], chance, orders) for key in levels}
    adjusted = iter(adjusted_chances([one for found in asked.values() if found is not None for one in found.chances]))
    told = {key: _Told.of(found, adjusted) for key, found in asked.items()}
    lines = {
        key: told[key].change.line if told[key].claimed else level  # type: ignore[union-attr]
        for key, level in levels.items()
    }
    apart = _outliers(days, lines)
    return {
        key: Course(
            days=days[key],
            level=_without(days[key], apart[key], levels[key]),
            change=told[key].change,
            claimed=told[key].claimed,
            chance=told[key].chance,
            outliers=apart[key],
            dependences=told[key].dependences,
        )
        for key in levels
    }


def _without(days: Days, outliers: Sequence[Outlier], level: Line) -> Line:
    """The level of the other days, so that a far one widens no spread."""
    far = {one.day for one in outliers}
    rest = [one for flights in days.flights for one in flights if one.day not in far]
    return level if not far or len({one.day for one in rest}) < 2 else level_of(by_day(rest))


@dataclass(frozen=True, eq=False, kw_only=True)
class _Told:
    change: Change | None
    claimed: bool
    chance: float | None
    dependences: tuple[Dependence, ...]

    @classmethod
    def of(cls, found: Changes | None, adjusted: Iterator[float]) -> _Told:
        """`adjusted` gives the chances of what is asked of a parameter, in its order."""
        if found is None:
            return cls(change=None, claimed=False, chance=None, dependences=())
        least = min(next(adjusted), next(adjusted))
        dependences = tuple(one for one in found.dependences if next(adjusted) < FALSE_SHARE)
        return cls(change=found.likelier, claimed=least < FALSE_SHARE, chance=least, dependences=dependences)


def _orders(asked: int) -> int:
    """So many that a change which none of them shows is claimed, though it is the only one."""
    needed = 1 / (SMALLEST * single_chance(max(asked, 1)))
    return int(min(MOST_ORDERS, max(ORDERS, needed)))


def single_chance(asked: int) -> float:
    """Below which one chance of so many must be, so that it alone is claimed."""
    return FALSE_SHARE / (asked * float(np.sum(1 / np.arange(1, asked + 1))))


def adjusted_chances(chances: Sequence[float]) -> list[float]:
    """So that below `FALSE_SHARE` so few of all claims are false, whatever depends on what."""
    return [] if not chances else [float(one) for one in stats.false_discovery_control(chances, method="by")]


def _outliers(
    days: Mapping[tuple[str, str], Days], lines: Mapping[tuple[str, str], Line]
) -> dict[tuple[str, str], tuple[Outlier, ...]]:
    """Days whose value lies farther from the line of the others than chance explains, by their median spread: a far
    one must not widen what it is measured by."""
    deviations = {key: _deviations(days[key], one) for key, one in lines.items()}
    chances = [2 * stats.norm.sf(abs(z)) for each in deviations.values() for z in each]
    adjusted = iter(adjusted_chances(chances))
    found: dict[tuple[str, str], tuple[Outlier, ...]] = {}
    for key, each in deviations.items():
        one = days[key]
        apart = [(place, z, next(adjusted)) for place, z in enumerate(each)]
        found[key] = tuple(
            Outlier(
                day=int(one.day[place]),
                flights=tuple(flight.flight for flight in one.flights[place]),
                value=float(one.value[place]),
                deviations=float(z),
                chance=adjusted_chance,
            )
            for place, z, adjusted_chance in apart
            if adjusted_chance < FALSE_SHARE
        )
    return found


def _deviations(days: Days, through: Line) -> list[float]:
    """In standard errors; the spread between days by the median of what is left beyond them."""
    middle = np.median(np.abs(through.left)) / stats.norm.ppf(0.75)
    between = max(0.0, middle**2 - float(np.median(days.error)) ** 2) if len(days) > 4 else through.between**2
    return [float(z) for z in through.left / np.sqrt(days.error**2 + between)]
