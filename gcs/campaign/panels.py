"""Small drawings of a parameter's flights, as places in a frame: the page sets them as SVG of its own colours."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from datetime import date, timedelta

import numpy as np

from gcs.analysis.quantities import amount_in
from gcs.campaign.sentences import CONDITIONS, EPOCH, day_words
from sysid.campaign.claims import Course
from sysid.campaign.values import Estimate
from sysid.data.record import FloatArray

WIDTH, HEIGHT = 440.0, 210.0
LEFT, RIGHT, TOP, BOTTOM = 54.0, 26.0, 10.0, 34.0
ROW = 26.0
"""Height of a group's row in a strip,"""
STRIP_LEFT = 110.0
"""and where values begin."""
BOUNDS = 2.0
"""Standard errors, as bars."""
FAR = 6.0
"""Distances between quartiles beyond which a value is drawn at the edge, so that the others stay apart."""
MOST_TICKS = 5
MOST_POINTS = 400
"""Flights of a group that are drawn one by one; beyond, days are."""
STEPS = (1, 2, 5, 10)
MONTHS = (1, 2, 3, 6, 12, 24, 60)


@dataclass(frozen=True, kw_only=True)
class Point:
    """A flight, or a day's mean, with its bounds, in the frame's units."""

    x: float
    y: float
    low: float
    high: float
    key: str
    """Of the flight; empty of a day."""
    words: str
    apart: bool
    edge: bool
    """Its value lies beyond the frame."""


@dataclass(frozen=True, kw_only=True)
class Panel:
    """One drawing."""

    over: str
    """What is to the right."""
    points: tuple[Point, ...]
    lines: tuple[str, ...]
    """Corners of what the course is, as SVG writes them."""
    band: tuple[float, float] | None
    """Top and height of the spread between days about the level; None where the level is not one."""
    x_ticks: tuple[tuple[float, str], ...]
    y_ticks: tuple[tuple[float, str], ...]


@dataclass(frozen=True, kw_only=True)
class Row:
    """A group's mean of one parameter."""

    group: str
    y: float
    at: float
    bounds: tuple[float, float]
    spread: tuple[float, float]
    """Between days, about the mean."""
    words: str


@dataclass(frozen=True, kw_only=True)
class Strip:
    """One parameter of all groups, side by side."""

    parameter: str
    height: float
    rows: tuple[Row, ...]
    ticks: tuple[tuple[float, str], ...]


@dataclass(frozen=True, eq=False)
class _Scale:
    """Values to places."""

    low: float
    high: float
    begin: float
    end: float

    def __call__(self, value: float) -> float:
        inside = min(max(value, self.low), self.high)
        return round(self.begin + (inside - self.low) / (self.high - self.low) * (self.end - self.begin), 1)


def panels(course: Course, unit: str, names: Callable[[str], str]) -> list[Panel]:
    """Over date, and over every condition that differs; `names` words a flight by its key."""
    flights = [one for each in course.days.flights for one in each]
    drawn = [(one, one.flight) for one in flights]
    if len(flights) > MOST_POINTS:
        drawn = [(_mean(course, place), "") for place in range(len(course.days))]
    told = [
        (f"{names(key)}, " if key else "") + f"{day_words(one.day)}: {amount_in(unit, one.value, one.error)}"
        for one, key in drawn
    ]
    y = _y_scale(np.array([one.value for one, _ in drawn]), np.array([one.error for one, _ in drawn]))
    frame = _Frame(course=course, drawn=drawn, told=told, y=y)
    return [frame.over_date(), *(frame.over(name) for name in course.days.conditions)]


@dataclass(frozen=True, eq=False, kw_only=True)
class _Frame:
    """What all panels of a parameter share."""

    course: Course
    drawn: Sequence[tuple[Estimate, str]]
    """Flights with their keys, or days without;"""
    told: Sequence[str]
    """and in words."""
    y: _Scale

    def over_date(self) -> Panel:
        course, y = self.course, self.y
        days = [float(one.day) for one, _ in self.drawn]
        x = _x_scale(days)
        line = " ".join(f"{x(day)},{y(value)}" for day, value in _course(course))
        level, between = float(course.level.at[0]), course.level.between
        top, bottom = y(level + BOUNDS * between), y(level - BOUNDS * between)
        return Panel(
            over="date",
            points=self._points(days, x),
            lines=(line,),
            band=None if course.claimed else (top, round(bottom - top, 1)),
            x_ticks=tuple(_date_ticks(x)),
            y_ticks=self._y_ticks,
        )

    def over(self, name: str) -> Panel:
        """A condition."""
        at = [one.conditions[name] for one, _ in self.drawn]
        x = _x_scale(at)
        words, unit = CONDITIONS.get(name, (name, ""))
        slope = next((one.size for one in self.course.dependences if one.condition == name), None)
        told = slope is not None and not self.course.claimed
        return Panel(
            over=f"{words}, {unit}" if unit else words,
            points=self._points(at, x),
            lines=(_sloping(self.course, slope or 0.0, float(np.mean(at)), x, self.y),) if told else (),
            band=None,
            x_ticks=tuple((x(tick), label) for tick, label in _ticks(x.low, x.high)),
            y_ticks=self._y_ticks,
        )

    @property
    def _y_ticks(self) -> tuple[tuple[float, str], ...]:
        return tuple((self.y(tick), label) for tick, label in _ticks(self.y.low, self.y.high))

    def _points(self, at: Sequence[float], x: _Scale) -> tuple[Point, ...]:
        y, apart = self.y, {key for one in self.course.outliers for key in one.flights}
        return tuple(
            Point(
                x=x(place),
                y=y(one.value),
                low=y(one.value - BOUNDS * one.error),
                high=y(one.value + BOUNDS * one.error),
                key=key,
                words=words,
                apart=one.flight in apart,
                edge=not y.low <= one.value <= y.high,
            )
            for (one, key), place, words in zip(self.drawn, at, self.told, strict=True)
        )


def strip(parameter: str, unit: str, by_group: Sequence[tuple[str, Course]]) -> Strip:
    """The means of groups with their bounds and the spread between days."""
    each = [
        (float(one.level.at[0]), float(one.level.covariance[0, 0] ** 0.5), one.level.between) for _, one in by_group
    ]
    wide = [BOUNDS * max(error, between) for _, error, between in each]
    low = min(mean - off for (mean, _, _), off in zip(each, wide, strict=True))
    high = max(mean + off for (mean, _, _), off in zip(each, wide, strict=True))
    room = 0.05 * (high - low) or 1.0
    x = _Scale(low - room, high + room, STRIP_LEFT, WIDTH - RIGHT)
    rows = tuple(
        Row(
            group=group,
            y=ROW * (place + 0.5),
            at=x(mean),
            bounds=(x(mean - BOUNDS * error), x(mean + BOUNDS * error)),
            spread=(x(mean - BOUNDS * between), x(mean + BOUNDS * between)),
            words=f"{group}: {amount_in(unit, mean, error)}",
        )
        for place, ((group, _), (mean, error, between)) in enumerate(zip(by_group, each, strict=True))
    )
    ticks = tuple((x(tick), label) for tick, label in _ticks(x.low, x.high))
    return Strip(parameter=parameter, height=ROW * len(rows), rows=rows, ticks=ticks)


def _mean(course: Course, place: int) -> Estimate:
    """A day as one flight."""
    days = course.days
    conditions = {
        name: float(np.mean([one.conditions[name] for one in days.flights[place]])) for name in days.conditions
    }
    return Estimate(
        flight=days.flights[place][0].flight,
        day=int(days.day[place]),
        value=float(days.value[place]),
        error=float(days.error[place]),
        conditions=conditions,
    )


def _course(course: Course) -> list[tuple[float, float]]:
    """Corners of the line in time, conditions at their means."""
    days, change = course.days.day, course.change
    level = float(course.line.at[0])
    if not course.claimed or change is None:
        return [(float(days[0]), level), (float(days[-1]), level)]
    each = level + change.size * change.column
    if change.since is None:
        return [(float(days[0]), float(each[0])), (float(days[-1]), float(each[-1]))]
    since = float(change.since)
    return [(float(days[0]), float(each[0])), (since, float(each[0])), (since, float(each[-1])),
            (float(days[-1]), float(each[-1]))]  # fmt: skip


def _sloping(course: Course, slope: float, mean: float, x: _Scale, y: _Scale) -> str:
    level = float(course.level.at[0])
    return " ".join(f"{x(at)},{y(level + slope * (at - mean))}" for at in (x.low, x.high))


def _x_scale(at: Sequence[float]) -> _Scale:
    low, high = min(at), max(at)
    room = 0.03 * (high - low) or 1.0
    return _Scale(low - room, high + room, LEFT, WIDTH - RIGHT)


def _y_scale(values: FloatArray, errors: FloatArray) -> _Scale:
    """Of the values with most of their bounds, less the farthest."""
    first, last = np.percentile(values, [25, 75])
    apart = FAR * max(float(last - first), float(np.median(errors)))
    bars = BOUNDS * np.minimum(errors, 2 * np.median(errors))
    low = max(float(np.min(values - bars)), float(first) - apart)
    high = min(float(np.max(values + bars)), float(last) + apart)
    room = 0.04 * (high - low) or 1.0
    return _Scale(low - room, high + room, HEIGHT - BOTTOM, TOP)


def _ticks(low: float, high: float) -> list[tuple[float, str]]:
    """At round numbers."""
    rough = (high - low) / MOST_TICKS
    ten = 10.0 ** math.floor(math.log10(rough))
    step = next(one * ten for one in STEPS if one * ten >= rough * (1 - 1e-9))
    digits = max(0, -math.floor(math.log10(step) + 1e-9))
    count = math.floor(high / step + 1e-9) - math.ceil(low / step - 1e-9)
    first = math.ceil(low / step - 1e-9)
    return [((first + k) * step, f"{(first + k) * step:.{digits}f}") for k in range(count + 1)]


def _date_ticks(x: _Scale) -> list[tuple[float, str]]:
    """At the begin of months, or at days where there are no two of these."""
    first, last = date.fromordinal(EPOCH + math.ceil(x.low)), date.fromordinal(EPOCH + math.floor(x.high))
    months = (last.year - first.year) * 12 + last.month - first.month
    if months < 2:
        step = max(1, math.ceil((last - first).days / MOST_TICKS))
        days = [first + timedelta(days=k) for k in range(0, (last - first).days + 1, step)]
        return [(x(one.toordinal() - EPOCH), f"{one.day} {one:%b}") for one in days]
    every = next((one for one in MONTHS if months / one <= MOST_TICKS), months)
    begins = [date(first.year + (first.month + k) // 12, (first.month + k) % 12 + 1, 1) for k in range(months)]
    return [
        (x(one.toordinal() - EPOCH), f"{one:%b} {one.year}")
        for one in begins
        if (one.year * 12 + one.month - 1) % every == 0
    ]
