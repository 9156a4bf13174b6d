"""What may be said of a whole campaign: of all parameters of all vehicles, few claims are false.

A hundred parameters looked at by themselves show five changes by chance. Here the expected share of false ones among
all that is claimed is held (Benjamini and Yekutieli, Ann. Statist. 29, 2001, p. 1165), whatever depends on what.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy import stats

from sysid.campaign.changes import Change, drift_of, likelier, step_of
from sysid.campaign.spread import Line, line
from sysid.campaign.values import Days, Estimate, by_day

FALSE_SHARE = 0.01
"""Of all claims, expected. In a campaign where nothing changed it is the chance of any claim."""


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
    """The mean, and the spread between days, as if nothing changed."""
    change: Change | None
    """The likelier kind; None where there are too few days."""
    claimed: bool
    """Whether the change may be told as one."""
    chance: float | None
    """Of the change, adjusted for all that was asked; None where nothing was."""
    outliers: tuple[Outlier, ...]


def courses(
    estimates: Mapping[tuple[str, str], Sequence[Estimate]], chance: np.random.Generator
) -> dict[tuple[str, str], Course]:
    """(vehicle, parameter) -> its course. `chance` draws orders of days."""
    days = {key: by_day(each) for key, each in estimates.items()}
    levels = {key: line(np.ones((len(one), 1)), one.value, one.error) for key, one in days.items() if len(one) > 1}
    asked = {key: (step_of(days[key], chance), drift_of(days[key], chance)) for key in levels}
    chances = [one.chance for both in asked.values() for one in both if one is not None]
    adjusted = iter(_adjusted(chances))
    changes: dict[tuple[str, str], tuple[Change | None, float | None]] = {}
    for key, (step, drift) in asked.items():
        if step is None or drift is None:
            changes[key] = None, None
            continue
        least = min(next(adjusted), next(adjusted))
        changes[key] = likelier(step, drift), least
    claimed = {key for key, (_, least) in changes.items() if least is not None and least < FALSE_SHARE}
    apart = _outliers(days, {key: changes[key][0].line if key in claimed else level for key, level in levels.items()})  # type: ignore[union-attr]
    return {
        key: Course(
            days=days[key],
            level=level,
            change=changes[key][0],
            claimed=key in claimed,
            chance=changes[key][1],
            outliers=apart[key],
        )
        for key, level in levels.items()
    }


def _adjusted(chances: Sequence[float]) -> list[float]:
    return [] if not chances else [float(one) for one in stats.false_discovery_control(chances, method="by")]


def _outliers(
    days: Mapping[tuple[str, str], Days], lines: Mapping[tuple[str, str], Line]
) -> dict[tuple[str, str], tuple[Outlier, ...]]:
    """Days whose value lies farther from the line of the others than chance explains, by their median spread: a far
    one must not widen what it is measured by."""
    deviations = {key: _deviations(days[key], one) for key, one in lines.items()}
    chances = [2 * stats.norm.sf(abs(z)) for each in deviations.values() for z in each]
    adjusted = iter(_adjusted(chances))
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
