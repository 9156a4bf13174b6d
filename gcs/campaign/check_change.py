"""Two sets of flights side by side: logs that are fitted here, or fits that were saved."""

from __future__ import annotations

import glob
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np

from gcs import documents
from gcs.analysis.quantities import amount_in, listed
from gcs.campaign.estimates import estimates_of
from gcs.campaign.given import Given
from gcs.campaign.groups import placed
from gcs.campaign.when import by_place
from gcs.campaign.work import Numbers, Outcome, Settings, worked_on
from gcs.errors import TippathError, UsageError
from gcs.logs import logs_in
from sysid.campaign.two_sets import Difference, by_days, differences
from sysid.campaign.values import Estimate
from sysid.fit.document import FitDocument
from sysid.fit.result import FORMAT as FIT

FORMAT = "tippath.change/1"
Verdict = Literal["changed", "nothing changed", "cannot tell"]


class _Unit(documents.Open, frozen=True, kw_only=True):
    unit: str


class _Units(documents.Open, frozen=True, kw_only=True):
    format: str
    parameters: dict[str, _Unit]


@dataclass(frozen=True, kw_only=True)
class _Flight:
    """One that can be compared."""

    seen: str
    """The same in all copies of it."""
    estimates: Mapping[str, Estimate]
    units: Mapping[str, str]
    structure: str


@dataclass(frozen=True, eq=False, kw_only=True)
class Flights:
    """One set."""

    estimates: Mapping[str, Sequence[Estimate]]
    units: Mapping[str, str]
    structures: frozenset[str]
    count: int
    left_out: tuple[str, ...]
    """Why, of what could not be used."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Answer:
    """Whether the vehicle changed."""

    verdict: Verdict
    limit_percent: float
    differences: tuple[Difference, ...]
    units: Mapping[str, str]
    by_days: bool
    flights: tuple[int, int]
    left_out: tuple[str, ...]

    @property
    def told(self) -> list[Difference]:
        """What is known to be no more than the limit, the best known first."""
        known = [one for one in self.differences if not one.changed and self.percent(one) <= self.limit_percent]
        return sorted(known, key=self.percent)

    def percent(self, one: Difference) -> float:
        """What it did not change beyond, of its size; infinite where nobody knows."""
        return np.inf if one.beyond is None or not one.before else 100 * one.beyond / abs(one.before)

    def needed(self, one: Difference) -> int:
        """Days or flights in each set that would show a change of the limit."""
        return one.needed(self.limit_percent / 100 * abs(one.before), len(self.differences))

    def to_json(self) -> dict[str, Any]:
        """The `tippath.change/1` document."""
        return {
            "format": FORMAT,
            "verdict": self.verdict,
            "sentence": sentence(self),
            "limit_percent": self.limit_percent,
            "compared": "days" if self.by_days else "flights",
            "flights": list(self.flights),
            "parameters": [
                {**asdict(one), "unit": self.units[one.parameter], "changed": one.changed,
                 "needed_in_each_set": self.needed(one) if one.before else None}
                for one in self.differences
            ],
            "left_out": list(self.left_out),
        }  # fmt: skip


def read_set(word: str, settings: Settings, say: Callable[[str], None] = lambda words: None) -> Flights:
    """A folder, a file or a pattern of logs or saved fits. Raises UsageError, TippathError where none is usable."""
    paths = files_of(word)
    flights: list[_Flight] = []
    left_out = []
    for path in paths:
        say(str(path))
        if path.suffix.lower() == ".json":
            flights.append(_of_fit(path))
            continue
        (outcome,) = placed([worked_on(path, settings)], Given())
        if outcome.fit is None:
            left_out.append(f"{path}: {outcome.reason}: {outcome.words}")
        else:
            flights.append(_of_outcome(outcome, outcome.fit))
    once = {one.seen: one for one in flights}
    if not once:
        why = f": {left_out[0]}" if left_out else "; name a folder, logs, or fits of `tippath fit`"
        raise TippathError(f"{word}: no flight that can be compared{why}")
    estimates: dict[str, list[Estimate]] = {}
    for each in once.values():
        for name, one in each.estimates.items():
            estimates.setdefault(name, []).append(one)
    return Flights(
        estimates=estimates,
        units={name: unit for each in once.values() for name, unit in each.units.items()},
        structures=frozenset(each.structure for each in once.values()),
        count=len(once),
        left_out=tuple(left_out),
    )


def files_of(word: str) -> list[Path]:
    """Saved fits of a folder, or where it has none its logs. Raises UsageError where there is nothing."""
    path = Path(word)
    if path.is_dir():
        fits = [one for one in sorted(path.rglob("*")) if one.suffix.lower() == ".json" and _units(one) is not None]
        found = fits or _logs_in(path)
    else:
        found = [path] if path.is_file() else [Path(one) for one in sorted(glob.glob(word, recursive=True))]
    if not found:
        raise UsageError(f"{word}: no logs and no fits there; name a folder, a file, or a pattern in quotes")
    return found


def _logs_in(folder: Path) -> list[Path]:
    try:
        return logs_in(folder)
    except (TippathError, OSError):  # none, as is said of fits and logs together
        return []


def _units(path: Path) -> Mapping[str, str] | None:
    """Of a saved fit's parameters; None where the file is none."""
    try:
        found = documents.read_json(path, _Units, what="fit")
    except documents.DocumentError:
        return None
    return {name: one.unit for name, one in found.parameters.items()} if found.format == FIT else None


def _of_fit(path: Path) -> _Flight:
    """Raises TippathError."""
    units = _units(path)
    if units is None:
        raise TippathError(f"{path}: is no {FIT} document; `tippath fit -o` writes one")
    saved = documents.read_json(path, FitDocument, what="fit")
    first = saved.records[0].path if saved.records else ""
    when = by_place(path.parent / first) if first else None
    day = 0 if when is None else when.day
    seen = ",".join(sorted(f"{one.sha256} {one.id}" for one in saved.records)) or str(path.resolve())
    estimates = {}
    for place, (name, one) in enumerate(saved.parameters.items()):
        variance = saved.covariance[place][place] if place < len(saved.covariance) else None
        if variance is not None and variance > 0 and not one.fixed and not one.at_bound:
            estimates[name] = Estimate(flight=seen, day=day, value=one.value, error=float(variance**0.5))
    return _Flight(
        seen=seen,
        estimates=estimates,
        units=units,
        structure=_structure(saved.structure.base, saved.structure.effects),
    )


def _of_outcome(one: Outcome, fit: Numbers) -> _Flight:
    return _Flight(
        seen=one.seen or one.key,
        estimates=estimates_of(one),
        units={name: each.unit for name, each in fit.parameters.items()},
        structure=_structure(fit.base, fit.effects),
    )


def _structure(base: str, effects: Sequence[str]) -> str:
    return " + ".join((base, *sorted(effects)))


def checked(first: Flights, second: Flights, limit_percent: float) -> Answer:
    """Raises TippathError where the fits are not of one structure, so that a number means something else in each."""
    structures = sorted(first.structures | second.structures)
    if len(structures) > 1:
        raise TippathError(f"fits of {listed(structures)}: fit all with one structure, or name logs instead")
    found = differences(first.estimates, second.estimates)
    if not found:
        raise TippathError("the two sets have no free parameter in common: fit both with one structure")
    one = next(name for name in first.estimates if name in second.estimates)
    answer = Answer(
        verdict="cannot tell",
        limit_percent=limit_percent,
        differences=tuple(found),
        units={**first.units, **second.units},
        by_days=by_days((first.estimates[one], second.estimates[one])),
        flights=(first.count, second.count),
        left_out=(*first.left_out, *second.left_out),
    )
    if any(each.changed for each in found):
        return replace(answer, verdict="changed")
    return replace(answer, verdict="nothing changed") if answer.told else answer


def sentence(found: Answer) -> str:
    """The answer in one."""
    if found.verdict == "changed":
        changed = sorted((one for one in found.differences if one.changed), key=lambda one: -abs(one.size) / one.error)
        return f"Changed: {listed([_change(one, found.units[one.parameter]) for one in changed])}."
    counted = "days" if found.by_days else "flights"
    if found.verdict == "nothing changed":
        each = [f"{amount_in('%', found.percent(one))} of {one.parameter}" for one in found.told]
        told = f"Nothing changed beyond {listed(each)}"
        open_ = [one.parameter for one in found.differences if one not in found.told]
        return told + (f"; {listed(open_)}: not known to {found.limit_percent:g} %." if open_ else ".")
    best = min(found.differences, key=found.needed)
    return (
        f"Cannot tell: {found.flights[0]} and {found.flights[1]} flights are too few; about {found.needed(best)} "
        f"{counted} in each set would show {found.limit_percent:g} % of {best.parameter}."
    )


def _change(one: Difference, unit: str) -> str:
    """`M_a fell by 3.1 ± 0.4 %`."""
    way = "rose" if one.size > 0 else "fell"
    if abs(one.before) > abs(one.size):
        size, error, unit = abs(100 * one.size / one.before), abs(100 * one.error / one.before), "%"
    else:
        size, error = abs(one.size), one.error
    return f"{one.parameter} {way} by {amount_in(unit, size, error)}"
