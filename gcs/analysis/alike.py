"""Are runs that are to be fitted together alike: vehicle, gains, rates, flight condition? Told before the fit.

Which of them go together is told as well: the runs that are alike, those with most axes and most time first. What is
not known of a run speaks neither for nor against it.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from gcs.analysis.text.findings import listed_runs
from gcs.flight.identified import ROTOR
from gcs.vehicle.identity import group_of
from sysid.data.record import Record

Kind = Literal["vehicle", "gains", "log rate", "loop rate", "rotor speed", "airspeed"]
LOG_RATE = 0.1
"""Of the rate: what one log's clock and its missing samples do to it is less."""
AIRSPEED_MPS = 3.0
"""A hover's gusts change the mean of a run by less."""
MEANING: dict[Kind, str] = {
    "vehicle": "no model answers for both",
    "gains": "the autopilot's loops were others: with the excitation logged, runs of both may be fitted together",
    "log rate": "each is fitted at its own rate; bounds are those of the slower",
    "loop rate": "each is fitted at its own rate; the delay of one is not the other's",
    "rotor speed": "flapping changes with its square: only a model with rotor_speed answers for both",
    "airspeed": "hover and forward flight are two models",
}
SHOWN = 3
"""Names of one kind that are told with their values."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Difference:
    """One thing that is not the same in all runs."""

    kind: Kind
    name: str
    """`FRAME_CLASS`, `rotor speed`."""
    values: tuple[tuple[str, tuple[str, ...]], ...]
    """Each value in words, with the ids of its runs."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Alike:
    """Runs sorted by what they have in common."""

    differences: tuple[Difference, ...]
    groups: tuple[tuple[str, ...], ...]
    """Ids of runs that are alike in everything; those with most axes, then most time, first."""

    @property
    def odd(self) -> tuple[str, ...]:
        """Ids of the runs that are not like the first group's."""
        return tuple(id for group in self.groups[1:] for id in group)

    @property
    def told(self) -> list[str]:
        """A sentence for each kind of difference, and what it means for a fit; another vehicle has other gains."""
        kinds = dict.fromkeys(one.kind for one in self.differences)
        if "vehicle" in kinds:
            kinds.pop("gains", None)
        return [_told(kind, [one for one in self.differences if one.kind == kind]) for kind in kinds]

    def letter(self, id: str) -> str:
        """`A` for runs of the first group, and so on; empty where all are alike, or the run is none of them."""
        at = next((place for place, group in enumerate(self.groups) if id in group), None)
        return "" if at is None or len(self.groups) < 2 else chr(ord("A") + min(at, 25))


def _told(kind: Kind, found: Sequence[Difference]) -> str:
    """`vehicle differs: frame HELI, FRAME_CLASS 6: a.BIN#1, #2; frame QUAD, FRAME_CLASS 1: b.BIN#1: ...`."""
    runs = [ids for _, ids in found[0].values]
    same = [one for one in found if [ids for _, ids in one.values] == runs]
    names = ["" if one.name == kind else f"{one.name} " for one in same[:SHOWN]]
    each = [
        f"{', '.join(name + one.values[place][0] for name, one in zip(names, same, strict=False))}: {listed_runs(ids)}"
        for place, ids in enumerate(runs)
    ]
    more = len(found) - len(names)
    beside = f" (and {more} setting{'s' if more > 1 else ''} more)" if more else ""
    return f"{kind} differs: {'; '.join(each)}{beside}. {MEANING[kind][0].upper()}{MEANING[kind][1:]}"


def alike(records: Sequence[Record]) -> Alike:
    """What differs among these runs; each id once."""
    told: list[tuple[Kind, str, dict[str, int], list[str]]] = [*_settings(records), *_measured(records)]
    differences = []
    for kind, name, places, words in told:
        if len(words) > 1:
            ids = [tuple(id for id, at in places.items() if at == place) for place in range(len(words))]
            differences.append(Difference(kind=kind, name=name, values=tuple(zip(words, ids, strict=True))))
    marks = [places for _, _, places, words in told if len(words) > 1]
    return Alike(differences=tuple(differences), groups=_groups(records, marks))


def _settings(records: Sequence[Record]) -> list[tuple[Kind, str, dict[str, int], list[str]]]:
    """Of what logs say in words: the name, each run's value by its number, and the values."""
    found = []
    for name in dict.fromkeys(key for record in records for key in record.vehicle):
        values = list(dict.fromkeys(one.vehicle[name] for one in records if name in one.vehicle))
        places = {one.id: values.index(one.vehicle[name]) for one in records if name in one.vehicle}
        kind: Kind = "gains" if group_of(name) == "gains" else "vehicle"
        found.append((kind, name, places, values))
    return found


def _measured(records: Sequence[Record]) -> list[tuple[Kind, str, dict[str, int], list[str]]]:
    """Of what was measured: values that lie closer together than their tolerance are one."""
    asked: tuple[tuple[Kind, str, Callable[[Record], float | None], Callable[[float], float]], ...] = (
        ("log rate", "Hz", _rate_hz, lambda value: LOG_RATE * value),
        ("loop rate", "Hz", lambda one: None if one.loop_dt_s is None else 1 / one.loop_dt_s, lambda v: LOG_RATE * v),
        ("rotor speed", "rad/s", lambda one: _mean(one, "omega"), lambda value: ROTOR * value),
        ("airspeed", "m/s", lambda one: _mean(one, "airspeed"), lambda _: AIRSPEED_MPS),
    )
    found: list[tuple[Kind, str, dict[str, int], list[str]]] = []
    for kind, unit, value_of, tolerance in asked:
        known = {one.id: value for one in records if (value := value_of(one)) is not None}
        places: dict[str, int] = {}
        first = -math.inf
        sums: list[list[float]] = []
        for id, value in sorted(known.items(), key=lambda each: each[1]):
            if not sums or value - first > tolerance(first):
                sums.append([])
                first = value
            sums[-1].append(value)
            places[id] = len(sums) - 1
        words = [f"{sum(each) / len(each):.3g} {unit}" for each in sums]
        found.append((kind, kind, places, words))
    return found


def _rate_hz(record: Record) -> float | None:
    return None if record.t.size < 2 else 1 / float(np.median(np.diff(record.t)))


def _mean(record: Record, channel: str) -> float | None:
    """Of what is finite; None where nothing is, or it rests at zero."""
    values = record.channels.get(channel, np.empty(0))
    values = values[np.isfinite(values)]
    return float(np.mean(values)) if values.size and np.any(values) else None


def _groups(records: Sequence[Record], marks: Sequence[dict[str, int]]) -> tuple[tuple[str, ...], ...]:
    """Runs whose values are nowhere different from one another's."""
    groups: list[list[Record]] = []
    for record in sorted(records, key=lambda one: -sum(one.id in each for each in marks)):
        for group in groups:
            if all(
                record.id not in each or other.id not in each or each[record.id] == each[other.id]
                for each in marks
                for other in group
            ):
                group.append(record)
                break
        else:
            groups.append([record])
    groups.sort(
        key=lambda group: (len({one.axis for one in group}), sum(one.duration_s for one in group)), reverse=True
    )
    order = [one.id for one in records]
    return tuple(tuple(sorted((one.id for one in group), key=order.index)) for group in groups)
