"""What was found over many flights, in sentences: sizes with their errors, dates, and what they might be else."""

from __future__ import annotations

import math
from collections.abc import Mapping
from datetime import date
from pathlib import Path

from gcs.analysis.quantities import amount_in, listed
from gcs.campaign.findings import Apart, Event, Findings, GoesWith, Size

EPOCH = date(1970, 1, 1).toordinal()
CONDITIONS: Mapping[str, tuple[str, str]] = {"omega": ("rotor speed", "rad/s"), "airspeed": ("airspeed", "m/s")}
"""Words and unit."""
NAMED = 3
"""Copies that are named."""


def day_words(day: int) -> str:
    """`3 May 2026`."""
    when = date.fromordinal(EPOCH + day)
    return f"{when.day} {when:%B} {when.year}"


def called(one: Size) -> str:
    """`T_d (delay of the commands)`."""
    return f"{one.parameter} ({one.meaning})" if one.meaning else one.parameter


def event_sentence(one: Event) -> str:
    """Who shows it, how much, in what, since when."""
    if one.kind == "drift":
        begin, end = (day_words(day) for day in one.days)
        told = f"{one.group}: {_joined(one, [_drift(part) for part in one.sizes])}, from {begin} to {end}"
    else:
        who = "flights" if one.followed_by is None else f"{one.followed_by[1]} of {one.followed_by[0]} flights"
        what = _joined(one, [_step(part) for part in one.sizes])
        told = f"{one.group}: {who} since {day_words(one.since or 0)} show {what}{_dates(one)}"
    if one.named == "class":
        told += "; the fits do not tell in which of these it sits"
    if one.named == "several":
        told += "; none of these alone explains it: something changed that moves them together"
    return f"{told}."


def dependence_sentence(one: GoesWith) -> str:
    """What goes with what, and whether it could be the vehicle."""
    words, unit = CONDITIONS.get(one.condition, (one.condition, ""))
    size = amount_in(one.unit, one.size, one.error)
    told = f"{one.group}: {one.parameter} goes with {words}, {size} for each {unit}"
    if one.or_time:
        return f"{told}; {words} itself changed over these days, so that it could as well be the vehicle that changed."
    return f"{told}; that is no change of the vehicle."


def apart_sentence(one: Apart, flights: str) -> str:
    """`flights` names them."""
    far = f"{abs(one.deviations[0]):.0f} standard errors"
    others = f", and so are {listed(one.parameters[1:])}" if len(one.parameters) > 1 else ""
    return f"{one.group}: {flights} of {day_words(one.day)}: {one.parameters[0]} is {far} from the others{others}."


def nothing_sentence(found: Findings) -> str:
    """What it means that no change is told."""
    if not found.asked:
        return "No change is told: that takes flights of six days at least in a group."
    return (
        f"No change is told: none of {found.asked} courses differs from what the order of its days by chance shows "
        "(1 % of claims expected to be false, all courses counted)."
    )


def none_apart_sentence(found: Findings) -> str:
    """What it means that no flight is told to be apart."""
    if not found.courses:
        return "Not asked: that takes dated flights of two days at least in a group."
    days = sum(len(course.days) for course in found.courses.values())
    return f"None: no day of {days} in {len(found.courses)} courses lies farther from the others than chance explains."


def short(path: str) -> str:
    """A file with its folder, which may be all that tells flights apart: many logs are called flight.BIN."""
    return "/".join(Path(path).parts[-2:])


def remarks(found: Findings) -> list[str]:
    """What limits the findings."""
    told = []
    if found.copies:
        each = [f"{short(one)} is {short(other)} again" for one, other in list(found.copies.items())[:NAMED]]
        more = [f"{len(found.copies) - NAMED} more"] if len(found.copies) > NAMED else []
        counted = f"{_logs(len(found.copies))} of a flight that another log holds as well, which counts once"
        told.append(f"{counted}: {listed([*each, *more])}.")
    if found.undated:
        told.append(f"{_logs(len(found.undated))} without a date: in no course.")
    if found.dated_by_file:
        told.append(
            f"{_logs(found.dated_by_file)} dated by the file's own time alone, which is when it was copied if it was."
        )
    return told


def told(found: Findings) -> list[str]:
    """All of them: what changed, or what it means that nothing is told, and what limits that."""
    changes = [event_sentence(one) for one in found.events] or [nothing_sentence(found)]
    return [*changes, *(dependence_sentence(one) for one in found.goes_with), *remarks(found)]


def _joined(event: Event, each: list[str]) -> str:
    return ", or ".join(each) if event.named == "class" else listed(each)


def _step(one: Size) -> str:
    """`20 ± 3 ms more T_d (delay of the commands), 31 ms instead of 11 ms`."""
    told = f"{amount_in(one.unit, abs(one.size), one.error)} {'more' if one.size > 0 else 'less'} {called(one)}"
    if not (math.isfinite(one.before) and math.isfinite(one.after)):
        return told
    return f"{told}, {amount_in(one.unit, one.after)} instead of {amount_in(one.unit, one.before)}"


def _drift(one: Size) -> str:
    """`L_b (roll acceleration per lateral flapping) falls by 13.2 ± 0.9 1/s^2 a year, 9.0 ± 0.6 %`."""
    way = "rises" if one.size > 0 else "falls"
    told = f"{called(one)} {way} by {amount_in(one.unit, abs(one.size), one.error)} a year"
    if not (math.isfinite(one.before) and abs(one.before) > abs(one.size)):
        return told
    return f"{told}, {amount_in('%', 100 * abs(one.size / one.before), 100 * abs(one.error / one.before))}"


def _dates(one: Event) -> str:
    """Where the first day is not sure."""
    last, first = one.days
    return (
        ""
        if first == one.since and first - last <= 1
        else (f"; it changed after {day_words(last)} and by {day_words(first)} at the latest")
    )


def _logs(count: int) -> str:
    return f"{count} log is" if count == 1 else f"{count} logs are"
