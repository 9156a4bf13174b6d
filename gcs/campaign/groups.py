"""Which flights may be compared: of one vehicle, set up alike, of one structure; and which logs are one flight."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

import msgspec

from gcs.campaign.given import Given
from gcs.campaign.identity import SAME
from gcs.campaign.when import When, by_place
from gcs.campaign.work import Outcome
from gcs.vehicle.identity import SYSTEM, group_of

OF_A_VEHICLE = ("frame", "flown as")
NOT_CONFIGURATION = (None, "vehicle", "gains")
"""Gains change the loop and not what is identified within it."""
UNKNOWN = "vehicle"


def placed(outcomes: Iterable[Outcome], given: Given) -> tuple[Outcome, ...]:
    """Each with the time at which it was flown: as given, as its satellites told, or by its place."""
    return tuple(msgspec.structs.replace(one, when=_when(one, given)) for one in outcomes)


def _when(outcome: Outcome, given: Given) -> When | None:
    time = given.about(Path(outcome.path)).time
    if time is not None:
        return When.told(time, "campaign.toml")
    return outcome.when or by_place(Path(outcome.path))


def copies(outcomes: Sequence[Outcome]) -> dict[str, str]:
    """Path of a log -> path of another that holds the same flight, and more of it or the same."""
    holders: dict[int, list[int]] = defaultdict(list)
    first: dict[str, int] = {}
    found: dict[str, str] = {}
    kept: list[int] = []
    for place in sorted(range(len(outcomes)), key=lambda at: _most_first(outcomes[at])):
        one = outcomes[place]
        shared: dict[int, int] = defaultdict(int)
        for number in one.sketch:
            for other in holders[number]:
                shared[other] += 1
        same = first.get(one.seen or one.sha256) if one.sha256 else None
        if same is None:
            same = max((at for at, count in shared.items() if count >= SAME), key=lambda at: shared[at], default=None)
        if same is not None:
            found[one.path] = outcomes[same].path
            continue
        kept.append(place)
        if one.sha256:
            first[one.seen or one.sha256] = place
        for number in one.sketch:
            holders[number].append(place)
    return found


def _most_first(outcome: Outcome) -> tuple[object, ...]:
    """What is fitted, then what holds most, then by name."""
    return outcome.fit is None, -sum(run.duration_s for run in outcome.runs if run.usable), outcome.path


def grouped(
    outcomes: Sequence[Outcome], given: Given, again: Mapping[str, str] | None = None
) -> dict[str, tuple[Outcome, ...]]:
    """`vehicle` or `vehicle/configuration` -> its independent flights that were fitted, in the order of their time.

    `again`: what `copies` says of them, where that was asked before.
    """
    again = copies(outcomes) if again is None else again
    fitted = [one for one in outcomes if one.fit is not None and one.path not in again]
    vehicles = _vehicles(fitted, given)
    by_vehicle: dict[str, list[Outcome]] = defaultdict(list)
    for one in fitted:
        by_vehicle[vehicles[one.path]].append(one)
    groups: dict[str, list[Outcome]] = defaultdict(list)
    for vehicle, its in sorted(by_vehicle.items()):
        words = _configurations(its, given)
        for one in sorted(its, key=lambda one: (one.when.utc if one.when else "", one.path)):
            groups["/".join(part for part in (vehicle, words[one.path]) if part)].append(one)
    return {name: tuple(each) for name, each in groups.items()}


def _vehicles(outcomes: Sequence[Outcome], given: Given) -> dict[str, str]:
    """Path -> name: as given, or by as little of what the logs say as tells them apart."""
    said = {one.path: _identity(one) for one in outcomes}
    words: dict[str, tuple[str, ...]] = {one.path: (one.airframe or UNKNOWN,) for one in outcomes}
    for name in dict.fromkeys(("system", *(name for its in said.values() for name in its))):
        values: dict[tuple[str, ...], set[str]] = defaultdict(set)
        for path, its in said.items():
            values[words[path]].add(its.get(name, ""))
        apart = {label for label, each in values.items() if len(each) > 1}
        for path, its in said.items():
            if words[path] in apart and name in its:
                words[path] += (f"{name} {its[name]}",)
    named = {one.path: given.about(Path(one.path)).vehicle for one in outcomes}
    return {path: named[path] or ", ".join(each).replace("/", "-") for path, each in words.items()}


def _identity(outcome: Outcome) -> dict[str, str]:
    found: dict[str, str] = {}
    for name, value in outcome.vehicle.items():
        if name in SYSTEM:
            found["system"] = value
        elif group_of(name) == "vehicle" or name in OF_A_VEHICLE:
            found[name] = value
    return found


def _configurations(outcomes: Sequence[Outcome], given: Given) -> dict[str, str]:
    """Path -> what tells its configuration from the others of its vehicle; empty where there is but one.

    A setting counts where all its logs tell it: one that another firmware does not have says nothing.
    """
    said = {
        one.path: {name: value for name, value in one.vehicle.items() if group_of(name) not in NOT_CONFIGURATION}
        for one in outcomes
    }
    differing = _differing(list(said.values()))
    structures = {one.fit.structure for one in outcomes if one.fit is not None}
    names = {}
    for one in outcomes:
        its = [f"{name} {said[one.path][name]}" for name in differing]
        words = [given.about(Path(one.path)).configuration or ", ".join(its).replace("/", "-")]
        if len(structures) > 1 and one.fit is not None:
            words.append(one.fit.structure)
        names[one.path] = ", ".join(word for word in words if word)
    return names


def _differing(said: Sequence[Mapping[str, str]]) -> list[str]:
    """What all of them say, and not alike."""
    common = [name for name in (said[0] if said else {}) if all(name in one for one in said)]
    return [name for name in common if len({one[name] for one in said}) > 1]
