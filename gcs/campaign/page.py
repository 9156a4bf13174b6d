"""campaign.html: what many flights say together, on one page that needs no network, no script and no fonts.

Values are set by a template that escapes whatever it is given: names of files, vehicles and reasons are strangers'.
"""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from urllib.parse import quote

import numpy as np

from gcs.analysis.pages.page import rendered
from gcs.analysis.quantities import amount_in
from gcs.campaign.findings import Findings
from gcs.campaign.panels import HEIGHT, ROW, STRIP_LEFT, WIDTH, Panel, Strip, panels, strip
from gcs.campaign.sentences import (
    apart_sentence,
    day_words,
    dependence_sentence,
    event_sentence,
    none_apart_sentence,
    nothing_sentence,
    remarks,
    short,
)
from gcs.campaign.summary import reasons
from gcs.campaign.work import Outcome
from gcs.files import write_whole
from sysid.campaign.claims import Course

WORST = 10
NAMED = 3
"""Flights that a sentence names; of more it gives the first."""
LISTED = 200
"""Files of one reason that are listed."""


@dataclass(frozen=True, kw_only=True)
class Parameter:
    """One parameter of a group."""

    name: str
    unit: str
    meaning: str
    anchor: str
    value: str
    between: str
    within_days: str
    within: str
    days: int
    flights: int
    panels: tuple[Panel, ...]


@dataclass(frozen=True, kw_only=True)
class Vehicle:
    """A group."""

    name: str
    anchor: str
    about: tuple[tuple[str, str], ...]
    structures: tuple[str, ...]
    parameters: tuple[Parameter, ...]


@dataclass(frozen=True, kw_only=True)
class Listed:
    """A flight in the list."""

    key: str
    name: str
    href: str
    group: str
    day: str
    fit: tuple[str, ...]
    runs: str
    copy: bool


@dataclass(frozen=True, kw_only=True)
class Failed:
    """Logs of one reason."""

    reason: str
    words: str
    files: tuple[tuple[str, str], ...]
    """Name and link."""
    count: int


def write_page(
    findings: Findings, groups: Mapping[str, Sequence[Outcome]], failed: Sequence[Outcome], path: Path
) -> None:
    """The page, whole or not at all. Raises TippathError where it cannot be written."""
    write_whole(campaign_page(findings, groups, failed, path.parent).encode(), path)


def campaign_page(
    findings: Findings, groups: Mapping[str, Sequence[Outcome]], failed: Sequence[Outcome], folder: Path
) -> str:
    """As HTML, its links as seen from a folder."""
    fitted = {group: [one for one in each if one.fit is not None] for group, each in groups.items()}
    without = _without(groups, failed)
    flights = [_listed(one, group, folder, findings) for group, each in fitted.items() for one in each]
    names = {one.key: one.name for one in flights if not one.copy}
    return rendered(
        "campaign.html.jinja",
        title="Campaign",
        about=_about(fitted, without, findings),
        changes=[event_sentence(one) for one in findings.events],
        dependences=[dependence_sentence(one) for one in findings.goes_with],
        nothing="" if findings.events else nothing_sentence(findings),
        apart=[
            (apart_sentence(one, _named([names.get(key, "?") for key in one.keys])), one.keys[0])
            for one in findings.apart
        ],
        none_apart=none_apart_sentence(findings),
        remarks=remarks(findings),
        strips=_strips(findings) if len(groups) > 1 else (),
        vehicles=[_vehicle(group, place, each, findings, names) for place, (group, each) in enumerate(fitted.items())],
        worst=_worst(fitted, findings, names),
        outputs=_outputs(fitted),
        flights=flights,
        failed=_failed(list(without.values()), folder),
        counts=Counter(one.reason or "" for one in without.values()).most_common(),
        frame=(WIDTH, HEIGHT, ROW, STRIP_LEFT),
    )


def _about(fitted: Mapping[str, Sequence[Outcome]], without: Mapping[str, Outcome], findings: Findings) -> str:
    count = sum(len(each) for each in fitted.values())
    days = [one.when.day for each in fitted.values() for one in each if one.when is not None]
    seen = {one.path for each in (*fitted.values(), without.values()) for one in each}
    copied = len(findings.copies.keys() - seen)
    told = f"{count + copied + len(without)} logs: {count} fitted, {len(without)} not"
    told += f", {copied} again a flight of another" if copied else ""
    vehicles = f"{len(fitted)} vehicles or configurations" if len(fitted) != 1 else ""
    dates = f"{day_words(min(days))} to {day_words(max(days))}" if days else ""
    return "; ".join(one for one in (told, vehicles, dates) if one)


def _named(names: Sequence[str]) -> str:
    return ", ".join(names[:NAMED]) + (f" and {len(names) - NAMED} more" if len(names) > NAMED else "")


def _strips(findings: Findings) -> list[Strip]:
    """Parameters that several groups have."""
    by_name: dict[str, list[tuple[str, Course]]] = {}
    for (group, name), course in findings.courses.items():
        by_name.setdefault(name, []).append((group, course))
    units = findings.units
    return [strip(_with_unit(name, units[name]), units[name], each) for name, each in by_name.items() if len(each) > 1]


def _with_unit(name: str, unit: str) -> str:
    return name if unit == "-" else f"{name}, {unit}"


def _vehicle(
    group: str, place: int, outcomes: Sequence[Outcome], findings: Findings, names: Mapping[str, str]
) -> Vehicle:
    parameters: list[Parameter] = []
    for (of, name), course in findings.courses.items():
        if of != group:
            continue
        unit, level = findings.units[name], course.level
        parameters.append(
            Parameter(
                name=name,
                unit=unit,
                meaning=findings.meanings.get(name, ""),
                anchor=f"g{place}-{len(parameters)}",
                value=amount_in(unit, float(level.at[0]), float(level.covariance[0, 0] ** 0.5)),
                between=amount_in(unit, level.between),
                within_days="" if course.days.within is None else amount_in(unit, course.days.within),
                within=amount_in(unit, float(np.median([one.error for each in course.days.flights for one in each]))),
                days=len(course.days),
                flights=sum(len(each) for each in course.days.flights),
                panels=tuple(panels(course, unit, lambda key: names.get(key, ""))),
            )
        )
    about = outcomes[0].vehicle if outcomes else {}
    same = {name: word for name, word in about.items() if all(one.vehicle.get(name) == word for one in outcomes)}
    structures = Counter(one.fit.structure for one in outcomes if one.fit is not None).most_common()
    return Vehicle(
        name=group,
        anchor=f"g{place}",
        about=tuple(same.items()),
        structures=tuple(f"{words}, {count} logs" for words, count in structures),
        parameters=tuple(parameters),
    )


def _listed(one: Outcome, group: str, folder: Path, findings: Findings) -> Listed:
    assert one.fit is not None
    usable = sum(run.usable for run in one.runs)
    return Listed(
        key=one.key,
        name=short(one.path),
        href=_link(one.path, folder),
        group=group,
        day="" if one.when is None else one.when.utc[:10],
        fit=tuple(f"{value:.1f}" for _, value in sorted(one.fit.nrmse_percent.items())),
        runs=f"{usable} of {len(one.runs)}" if one.runs else "",
        copy=one.path in findings.copies,
    )


def _without(groups: Mapping[str, Sequence[Outcome]], failed: Sequence[Outcome]) -> dict[str, Outcome]:
    """All that have no fit, each once."""
    every = [*(one for each in groups.values() for one in each if one.fit is None), *failed]
    return {one.key + one.path: one for one in every}


def _outputs(fitted: Mapping[str, Sequence[Outcome]]) -> list[str]:
    return sorted({name for each in fitted.values() for one in each if one.fit for name in one.fit.nrmse_percent})


def _worst(
    fitted: Mapping[str, Sequence[Outcome]], findings: Findings, names: Mapping[str, str]
) -> list[tuple[str, str, str]]:
    """Key, name and words of the flights that their fits say least of."""

    def least(one: Outcome) -> float:
        return min(one.fit.nrmse_percent.values(), default=100.0) if one.fit is not None else 100.0

    flights = [(one, group) for group, each in fitted.items() for one in each if one.path not in findings.copies]
    ordered = sorted(flights, key=lambda pair: least(pair[0]))[:WORST]
    return [
        (
            one.key,
            names.get(one.key, short(one.path)),
            f"{group}: NRMSE fit {least(one):.1f} %{_warning(one)}",
        )
        for one, group in ordered
    ]


def _warning(one: Outcome) -> str:
    return f"; {one.fit.warnings[0]}" if one.fit is not None and one.fit.warnings else ""


def _failed(outcomes: Sequence[Outcome], folder: Path) -> list[Failed]:
    """The most frequent reason first."""
    return [
        Failed(
            reason=why.reason,
            words=why.words.removeprefix(f"{why.logs[0]}: "),
            files=tuple((short(path), _link(path, folder)) for path in why.logs[:LISTED]),
            count=len(why.logs),
        )
        for why in reasons(outcomes)
    ]


def _link(path: str, folder: Path) -> str:
    """As seen from the folder of the page; with `./`, so that no name is taken for another protocol."""
    try:
        return "./" + quote(Path(os.path.relpath(path, folder)).as_posix())
    except ValueError:  # on another drive
        return Path(path).resolve().as_uri()
