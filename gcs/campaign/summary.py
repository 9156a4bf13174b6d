"""A campaign in a page of text, and as the `tippath.campaign/1` document: reasons counted, groups with their means."""

from __future__ import annotations

import os
import re
from collections import Counter, defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from gcs.analysis.quantities import decimals
from gcs.campaign.campaign import FORMAT, Campaign
from gcs.campaign.estimates import estimates_of
from gcs.campaign.findings import Findings
from gcs.campaign.sentences import short
from gcs.campaign.work import Outcome
from gcs.logs.words import printable
from sysid.campaign.claims import Course
from sysid.campaign.values import Estimate, by_day

NAMED = 3
"""Logs that are named for a reason."""
WORDS = 96
_NUMBER = re.compile(r"\d+(?:\.\d+)?")


@dataclass(frozen=True, slots=True, kw_only=True)
class Mean:
    """One parameter over a group's flights."""

    value: float
    unit: str
    error: float
    """Standard error of the mean, by the flights' own errors and their spread."""
    between: float | None
    """Standard deviation between days beyond these errors; None of one day."""
    within_days: float | None
    """Standard deviation between flights of one day beyond these errors; None where no day has two."""
    flights: int
    days: int


@dataclass(frozen=True, slots=True, kw_only=True)
class Why:
    """Logs that have no fit for one and the same reason."""

    reason: str
    words: str
    """Of the first of them; numbers may be others in the rest."""
    logs: tuple[str, ...]


def reasons(outcomes: Sequence[Outcome]) -> list[Why]:
    """Why logs have no fit, the most frequent first: sentences that differ in numbers and names only are one."""
    found: dict[tuple[str, str], list[Outcome]] = defaultdict(list)
    for one in outcomes:
        if one.reason is not None:
            plain = one.words
            for name in (one.path, Path(one.path).name, *(run.id for run in one.runs)):
                plain = plain.replace(name, "")
            found[one.reason, _NUMBER.sub("0", plain)].append(one)
    each = [
        Why(reason=reason, words=its[0].words, logs=tuple(one.path for one in its))
        for (reason, _), its in found.items()
    ]
    return sorted(each, key=lambda why: (-len(why.logs), why.reason, why.words))


def means(group: str, flights: Sequence[Outcome], courses: Mapping[tuple[str, str], Course]) -> dict[str, Mean]:
    """Parameter -> its mean over a group's flights: the level of its course, or what one day says."""
    estimates: dict[str, list[Estimate]] = defaultdict(list)
    units: dict[str, str] = {}
    for one in flights:
        if one.fit is None or one.when is None:
            continue
        for name, estimate in estimates_of(one).items():
            units[name] = one.fit.parameters[name].unit
            estimates[name].append(estimate)
    found = {}
    for name, each in estimates.items():
        course = courses.get((group, name))
        days = by_day(each) if course is None else course.days
        level = None if course is None else course.level
        found[name] = Mean(
            value=float(days.value[0] if level is None else level.at[0]),
            unit=units[name],
            error=float(days.error[0] if level is None else level.covariance[0, 0] ** 0.5),
            between=None if level is None else level.between,
            within_days=days.within,
            flights=len(each),
            days=len(days),
        )
    return found


def document(campaign: Campaign, findings: Findings, folder: Path) -> dict[str, Any]:
    """`tippath.campaign/1`; paths from the campaign's folder."""

    def at(path: str) -> str:
        return _from(folder, path)

    return {
        "format": FORMAT,
        "folder": str(folder),
        "logs": len(campaign.outcomes),
        "fitted": sum(one.fit is not None for one in campaign.outcomes),
        "version": next((one.version for one in campaign.outcomes if one.version), None),
        "copies": {at(one): at(other) for one, other in campaign.copies.items()},
        "reasons": [
            {"reason": why.reason, "words": why.words, "count": len(why.logs), "logs": [at(one) for one in why.logs]}
            for why in reasons(campaign.outcomes)
        ],
        "groups": [_group(name, flights, findings, folder) for name, flights in campaign.groups.items()],
    }


def _group(name: str, flights: Sequence[Outcome], findings: Findings, folder: Path) -> dict[str, Any]:
    return {
        "name": name,
        "structure": next((one.fit.structure for one in flights if one.fit is not None), None),
        "flights": [
            {
                "log": _from(folder, one.path),
                "key": one.key,
                "flown": None if one.when is None else one.when.utc,
                "flown_told_by": None if one.when is None else one.when.told_by,
                "nrmse_percent": None if one.fit is None else one.fit.nrmse_percent,
                "predicted_nrmse_percent": None if one.predicted is None else one.predicted.nrmse_percent,
                "verdict": None if one.verdict is None else one.verdict.verdict,
                "effect": None if one.verdict is None else one.verdict.effect,
            }
            for one in flights
        ],
        "parameters": {
            parameter: {
                "mean": mean.value,
                "unit": mean.unit,
                "standard_error": mean.error,
                "between": mean.between,
                "within_days": mean.within_days,
                "flights": mean.flights,
                "days": mean.days,
            }
            for parameter, mean in means(name, flights, findings.courses).items()
        },
    }


def _from(folder: Path, path: str) -> str:
    try:
        return Path(os.path.relpath(path, folder)).as_posix()
    except ValueError:  # on another drive
        return Path(path).as_posix()


def text(campaign: Campaign, findings: Findings) -> str:
    """For people."""
    fitted = sum(one.fit is not None for one in campaign.outcomes)
    lines = [f"{len(campaign.outcomes)} logs: {fitted} fitted, {len(campaign.failed)} without a fit"]
    for why in reasons(campaign.outcomes):
        words = printable(why.words.splitlines()[0] if why.words else "")
        lines += ["", f" {len(why.logs):4d}  {why.reason}: {words[:WORDS]}"]
        more = f" and {len(why.logs) - NAMED} more" if len(why.logs) > NAMED else ""
        lines.append(f"       {', '.join(printable(short(one)) for one in why.logs[:NAMED])}{more}")
    for name, flights in campaign.groups.items():
        lines += ["", *_group_lines(name, flights, findings)]
    return "\n".join(lines)


def _group_lines(name: str, flights: Sequence[Outcome], findings: Findings) -> list[str]:
    fits = [one.fit for one in flights if one.fit is not None]
    predicted = [one.predicted.nrmse_percent for one in flights if one.predicted is not None]
    lines = [
        f"{printable(name)}: {_count(len(flights), 'flight')}{_span(flights)}, {fits[0].structure}",
        *_shares("own fit", [fit.nrmse_percent for fit in fits]),
        *_shares("by another flight's", [each for each in predicted if each is not None]),
        *_verdicts(flights),
        f"   {'':14} {'mean':>12} {'± error':>10}  {'between days':>12}  unit",
    ]
    for parameter, mean in means(name, flights, findings.courses).items():
        between = "" if mean.between is None else f"{mean.between:.2g}"
        places = decimals(mean.error)
        lines.append(
            f"   {parameter:14} {mean.value:12.{places}f} {mean.error:10.{places}f}  {between:>12}  {mean.unit}"
        )
    return lines


def _span(flights: Sequence[Outcome]) -> str:
    days = [one.when.utc[:10] for one in flights if one.when is not None]
    if not days:
        return ""
    return f", {days[0]}" if days[0] == days[-1] else f", {days[0]} to {days[-1]}"


def _verdicts(flights: Sequence[Outcome]) -> list[str]:
    said = Counter(one.verdict.effect or one.verdict.verdict for one in flights if one.verdict is not None)
    listed = ", ".join(f"{word} {count}" for word, count in said.most_common())
    return [f"   diagnosed: {listed}"] if said else []


def _shares(what: str, nrmse: Sequence[dict[str, float]]) -> list[str]:
    """`   NRMSE, own fit: p 77.1 % (51.0 to 90.2), q ...`: median, least and largest."""
    words = []
    for output in dict.fromkeys(name for each in nrmse for name in each):
        values = sorted(each[output] for each in nrmse if output in each)
        words.append(f"{output} {np.median(values):.1f} % ({values[0]:.1f} to {values[-1]:.1f})")
    return [f"   NRMSE, {what}: {', '.join(words)}"] if words else []


def _count(number: int, word: str) -> str:
    return f"{number} {word}{'' if number == 1 else 's'}"
