"""What many flights say together: the course of every parameter of every group, what changed, and what is apart.

Copies of one flight count once. A change is told of the parameter in which it sits, where the fits tell it from others;
else of all in which it could. What goes with a condition that was logged is told as that, not as the vehicle's change.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any, Literal, TypeVar

import numpy as np

from gcs.campaign.estimates import estimates_of, with_bounds
from gcs.campaign.groups import copies
from gcs.campaign.work import Outcome
from sysid.campaign.changes import Change, Kind, line_along
from sysid.campaign.claims import Course, Outlier, courses
from sysid.campaign.joint import Alone, Combination, Flight, alone, combinations
from sysid.campaign.values import Estimate
from sysid.model.base import bases
from sysid.model.effect import catalogue

FORMAT = "tippath.findings/1"
JOINED = " & "
"""Between the members of a combination, in its key."""
Named = Literal["one", "class", "several"]


@dataclass(frozen=True, kw_only=True)
class Size:
    """How much one parameter changed; of a drift, in a year."""

    parameter: str
    unit: str
    meaning: str
    """In words; empty of a parameter of somebody's own."""
    size: float
    error: float
    before: float
    """Its mean before a step, or at the first day of a drift;"""
    after: float
    """and since then, or at the last day."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Event:
    """What changed in a group, at once or bit by bit."""

    group: str
    kind: Kind
    named: Named
    """`one`: the parameters but this agree with no change at all; `class`: it could sit in any of these, and the fits
    cannot tell in which; `several`: these changed, and no one of them alone explains it."""
    sizes: tuple[Size, ...]
    """The one that is named, each as if it had changed alone, or all."""
    chance: float
    """Adjusted for all that was asked."""
    days: tuple[int, int]
    """Of a step the last day before it and its first, at the earliest and at the latest; of a drift first and last."""
    since: int | None
    """A step's first day."""
    followed_by: tuple[int, int] | None
    """Of how many flights since a step how many are nearer to what is flown since."""


@dataclass(frozen=True, kw_only=True)
class GoesWith:
    """A parameter that goes with a condition."""

    group: str
    parameter: str
    unit: str
    condition: str
    size: float
    """For one of the condition, SI."""
    error: float
    or_time: bool
    """Whether the condition itself changed once, or bit by bit, so that it could as well be the vehicle that did."""


@dataclass(frozen=True, kw_only=True)
class Apart:
    """A day's flights that agree with no others."""

    group: str
    day: int
    keys: tuple[str, ...]
    """Of the outcomes;"""
    parameters: tuple[str, ...]
    """what is apart, the farthest first,"""
    deviations: tuple[float, ...]
    """and how many standard errors from the others."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Findings:
    """All of it."""

    courses: Mapping[tuple[str, str], Course]
    """(group, parameter) -> its course; of what is known on two days at least."""
    units: Mapping[str, str]
    meanings: Mapping[str, str]
    """Of parameters, in words; those that are known."""
    events: tuple[Event, ...]
    goes_with: tuple[GoesWith, ...]
    apart: tuple[Apart, ...]
    copies: Mapping[str, str]
    """Path of a copy -> path of the flight that counts."""
    undated: tuple[str, ...]
    """Paths of fitted logs that do not say when they were flown: they have no place in a course."""
    dated_by_file: int
    """Flights that count whose only date is their file's."""
    asked: int
    """Courses with days enough to ask for changes."""

    @property
    def claims(self) -> int:
        """Of changes and dependences: what a campaign in which nothing changed has none of."""
        return len(self.events) + len(self.goes_with)

    def to_json(self) -> dict[str, Any]:
        """The `tippath.findings/1` document; days are days since 1970."""
        return {
            "format": FORMAT,
            "courses": [_course_json(key, course, self.units) for key, course in self.courses.items()],
            "events": [_plain(one) for one in self.events],
            "goes_with": [_plain(one) for one in self.goes_with],
            "apart": [_plain(one) for one in self.apart],
            "copies": dict(self.copies),
            "undated": list(self.undated),
            "dated_by_file": self.dated_by_file,
        }


def found(
    groups: Mapping[str, Sequence[Outcome]], seed: int = 0, *, known_copies: Mapping[str, str] = MappingProxyType({})
) -> Findings:
    """What flights in groups say; `seed` draws the orders of days that chances are counted of. `known_copies`: path of
    a log that was left out of the groups -> path of the one that holds the same flight."""
    counted, again = _counted(groups)
    dated = {group: with_bounds([one for one in each if one.when is not None]) for group, each in counted.items()}
    flights = {group: [_flight(one) for one in each] for group, each in dated.items()}
    combined = _combined(flights)
    estimates = _estimates(dated)
    estimates.update({key: one.estimates for key, one in combined.items()})
    found_courses = courses(estimates, np.random.default_rng(seed))
    single = {key: course for key, course in found_courses.items() if key not in combined}
    every = [one for each in counted.values() for one in each]
    about = _About(units=_units(every), meanings=_meanings(every), courses=single)
    events = [
        event
        for group, each in flights.items()
        for event in _events(group, each, _of(group, found_courses), _of(group, combined), about)
    ]
    return Findings(
        courses=single,
        units=about.units,
        meanings=about.meanings,
        events=tuple(events),
        goes_with=_goes_with(single, about.units),
        apart=_apart(single),
        copies={**known_copies, **again},
        undated=tuple(one.path for one in every if one.when is None),
        dated_by_file=sum(one.when is not None and one.when.told_by == "file" for one in every),
        asked=sum(course.change is not None for course in single.values()),
    )


AS_WELL = 5.0
"""Difference of log-likelihoods below which two changes may be one: the date was sought as well."""
MOSTLY = 0.5
"""Of a condition's squares, from which on it cannot be told from time."""


@dataclass(frozen=True, eq=False, kw_only=True)
class _About:
    units: Mapping[str, str]
    meanings: Mapping[str, str]
    courses: Mapping[tuple[str, str], Course]

    def size(self, group: str, name: str, change: Change, size: float, error: float) -> Size:
        """`change` gives the column: by how much of it first and last days differ."""
        course = self.courses.get((group, name))
        line = None if course is None else course.line
        column = change.column
        at = np.nan if line is None else float(line.at[0])
        if course is not None and not course.claimed:  # its line has no change: the level is that of all days
            at -= size * float(np.mean(column))
        return Size(
            parameter=name,
            unit=self.units[name],
            meaning=self.meanings.get(name, ""),
            size=size,
            error=error,
            before=at + size * float(column[0]),
            after=at + size * float(column[-1]),
        )


T = TypeVar("T")


def _of(group: str, every: Mapping[tuple[str, str], T]) -> dict[str, T]:
    """Those of a group, by parameter."""
    return {name: one for (of, name), one in every.items() if of == group}


def _goes_with(each: Mapping[tuple[str, str], Course], units: Mapping[str, str]) -> tuple[GoesWith, ...]:
    return tuple(
        GoesWith(
            group=group,
            parameter=name,
            unit=units[name],
            condition=one.condition,
            size=one.size,
            error=one.error,
            or_time=one.goes_with_time > MOSTLY,
        )
        for (group, name), course in each.items()
        for one in course.dependences
    )


def _counted(groups: Mapping[str, Sequence[Outcome]]) -> tuple[dict[str, list[Outcome]], dict[str, str]]:
    """Fitted flights, each once; and path of a copy -> path of the flight that counts."""
    fitted = {group: [one for one in each if one.fit is not None] for group, each in groups.items()}
    again = {path: other for each in fitted.values() for path, other in copies(each).items()}
    return {group: [one for one in each if one.path not in again] for group, each in fitted.items()}, again


def _combined(flights: Mapping[str, Sequence[Flight]]) -> dict[tuple[str, str], Combination]:
    return {(group, JOINED.join(one.members)): one for group, each in flights.items() for one in combinations(each)}


def _flight(one: Outcome) -> Flight:
    assert one.fit is not None
    assert one.when is not None
    return Flight(
        flight=one.key,
        day=one.when.day,
        values={name: number.value for name, number in one.fit.parameters.items()},
        covariance=np.array(one.fit.covariance),
        conditions=one.conditions,
    )


def _estimates(dated: Mapping[str, Sequence[Outcome]]) -> dict[tuple[str, str], Sequence[Estimate]]:
    found: dict[tuple[str, str], list[Estimate]] = {}
    for group, each in dated.items():
        for one in each:
            for name, estimate in estimates_of(one).items():
                found.setdefault((group, name), []).append(estimate)
    return dict(found)


def _events(
    group: str,
    flights: Sequence[Flight],
    courses_: Mapping[str, Course],
    combined: Mapping[str, Combination],
    about: _About,
) -> list[Event]:
    """Claims of one kind at one time are one event, told of what it sits in."""
    claimed = {name: course for name, course in courses_.items() if course.claimed and course.change is not None}
    events = []
    for names in _at_once(claimed):
        leading = names[0]
        change, days = _change(claimed[leading]), claimed[leading].days.day
        along = dict(zip((int(day) for day in days), (float(x) for x in change.column), strict=True))
        named, sizes = _named(names, claimed, combined, alone(flights, along))
        events.append(
            Event(
                group=group,
                kind=change.kind,
                named=named,
                sizes=tuple(about.size(group, name, change, size, error) for name, size, error in sizes),
                chance=min(claimed[name].chance or 1.0 for name in names),
                days=change.since_within or (int(days[0]), int(days[-1])),
                since=change.since,
                followed_by=change.followed_by,
            )
        )
    return events


def _named(
    names: Sequence[str],
    claimed: Mapping[str, Course],
    combined: Mapping[str, Combination],
    explained: Sequence[Alone],
) -> tuple[Named, list[tuple[str, float, float]]]:
    """How the claims of one event are told, with each parameter's size and error; the first name leads."""
    change = _change(claimed[names[0]])
    if len(explained) == 1:
        only = explained[0]
        if only.name in names:  # by its own days, their errors weighed
            own = _change(claimed[only.name])
            return "one", [(only.name, own.size, own.error)]
        return "one", [(only.name, only.size, only.error)]
    if explained:
        return "class", [(one.name, one.size, one.error) for one in explained]
    singles = [name for name in names if name not in combined]
    if not singles:
        parts = combined[names[0]].alone(change.size)
        return "class", [(name, part, abs(part * change.error / change.size)) for name, part in parts.items()]
    lines = [(name, line_along(claimed[name].days, change.column)) for name in singles]
    sizes = [(name, float(one.at[-1]), float(one.covariance[-1, -1] ** 0.5)) for name, one in lines]
    return "several" if len(singles) > 1 else "one", sizes


def _at_once(claimed: Mapping[str, Course]) -> list[list[str]]:
    """Names of claims that may be one: with the surest of them as good as with a kind and date of their own."""
    ordered = sorted(claimed, key=lambda name: -abs(_change(claimed[name]).size) / _change(claimed[name]).error)
    sets: list[list[str]] = []
    for name in ordered:
        own = claimed[name]
        for names in sets:
            first = claimed[names[0]]
            if len(own.days) == len(first.days):
                along = line_along(own.days, _change(first).column)
                if _change(own).line.log_likelihood - along.log_likelihood < AS_WELL:
                    names.append(name)
                    break
        else:
            sets.append([name])
    return sets


def _change(course: Course) -> Change:
    assert course.change is not None
    return course.change


def _apart(each: Mapping[tuple[str, str], Course]) -> tuple[Apart, ...]:
    """Outliers of several parameters on one day are one."""
    by_day: dict[tuple[str, int], list[tuple[str, Outlier]]] = {}
    for (group, name), course in each.items():
        for one in course.outliers:
            by_day.setdefault((group, one.day), []).append((name, one))
    found = []
    for (group, day), some in sorted(by_day.items()):
        some.sort(key=lambda pair: -abs(pair[1].deviations))
        found.append(
            Apart(
                group=group,
                day=day,
                keys=some[0][1].flights,
                parameters=tuple(name for name, _ in some),
                deviations=tuple(one.deviations for _, one in some),
            )
        )
    return tuple(sorted(found, key=lambda one: -abs(one.deviations[0])))


def _units(outcomes: Sequence[Outcome]) -> dict[str, str]:
    return {name: one.unit for each in outcomes if each.fit for name, one in each.fit.parameters.items()}


def _meanings(outcomes: Sequence[Outcome]) -> dict[str, str]:
    """Of the bases and effects that come along; files of somebody's own are not run for their words."""
    found: dict[str, str] = {}
    for base, effects in {(one.fit.base, one.fit.effects) for one in outcomes if one.fit}:
        parameters = [
            *(bases()[base].parameters if base in bases() else ()),
            *(one for effect in effects if effect in catalogue() for one in catalogue()[effect].parameters),
        ]
        found.update({one.name: one.meaning for one in parameters})
    return found


def _course_json(key: tuple[str, str], course: Course, units: Mapping[str, str]) -> dict[str, Any]:
    group, name = key
    return {
        "group": group,
        "parameter": name,
        "unit": units[name],
        "mean": float(course.level.at[0]),
        "standard_error": float(course.level.covariance[0, 0] ** 0.5),
        "between_days": course.level.between,
        "between_flights": course.days.within,
        "within": float(np.median([one.error for each in course.days.flights for one in each])),
        "days": len(course.days),
        "flights": sum(len(one) for one in course.days.flights),
        "chance_of_change": course.chance,
        "changed": course.claimed,
    }


def _plain(one: Any) -> dict[str, Any]:
    """A value's fields; numbers that are none as null."""
    import msgspec

    return _finite(msgspec.to_builtins(one))  # type: ignore[no-any-return]


def _finite(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _finite(each) for key, each in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(each) for each in value]
    return None if isinstance(value, float) and not np.isfinite(value) else value
