"""A flight that did not come to its end goes on in its own folder: what of it is kept, what is left, and whether this
is the same flight still.

The folder alone tells: card.toml what was to be flown, flight.json what was, the logs whether its samples reached the
disk. A run that finished and was worth keeping is not flown again, unless its samples went with the power. What was
written before is never touched: the log goes on in the next free file, and flight.json keeps what it says.
"""

from __future__ import annotations

import contextlib
import hashlib
import os
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

from gcs.cards.envelope import Peaks
from gcs.cards.maneuver import CardRun, TestCard, parse_card
from gcs.documents import read_text
from gcs.errors import TippathError, UsageError
from gcs.flight.connection import LogWay
from gcs.flight.coverage import Coverage, coverage
from gcs.flight.flown_card import FlownBefore, log_document
from gcs.flight.folder import FlightFolder, NoFlightError, fetched_for, is_kept, newest
from gcs.flight.lock import alone
from gcs.flight.preflight import Check
from gcs.flight.recorder import RecordedLog
from gcs.flight.run import PEAKS
from gcs.flight.verdict import FEW_MISSING
from gcs.link.events import bits_of_float
from gcs.link.log_end import LogEnd
from gcs.vehicle.profile import Plan, VehicleProfile
from gcs.vehicle.snapshot import VehicleSnapshot

ANEW = "fly the card anew, into another folder (-o DIR)"
SAME = {"system": "system", "type": "type", "autopilot": "autopilot"}
"""What of a vehicle must not change, and its word."""
LARGEST = 3.4e38
"""That 32 bits hold."""
OF_A_PART = ("started", "ended", "stopped", "boot", "checks", "probe", "missing_blocks")
"""What of flight.json is told of each part of a flight apart."""


@dataclass(frozen=True, kw_only=True)
class Earlier:
    """What was flown of a card before this time."""

    folder: FlightFolder
    card: TestCard
    document: Mapping[str, Any]
    """flight.json, as it was left."""
    kept: Mapping[int, Mapping[str, Any]]
    """Number of the card's run -> what flight.json says of it, where it is not to be flown again."""
    lost: tuple[str, ...]
    """Of each run that was kept and is no more: why."""
    whole: bool
    """No sample of a run that is kept is missing on disk."""
    logs: tuple[Mapping[str, Any], ...]
    """Of each log recorded, as flight.json has them."""
    missing_blocks: int
    """Of these logs, as they lie on disk."""
    unjudged: tuple[str, ...]
    """Of logs whose end nobody saw, in words."""

    @property
    def log(self) -> LogWay:
        """How its log comes."""
        return "card" if self.document.get("log") == "card" else "stream"

    @property
    def ended(self) -> bool:
        """The program that flew it last lived to say so."""
        return self.document.get("ended") is not None

    @cached_property
    def left(self) -> tuple[CardRun, ...]:
        """The card's runs that are to be flown."""
        return tuple(run for run in self.card.runs() if run.number not in self.kept)

    @property
    def complete(self) -> bool | None:
        """Every run is flown and kept, and all of it is on disk; None where the log stays on the vehicle's card."""
        if self.left or self.log == "stream":
            return not self.left and self.whole
        return None

    @property
    def problems(self) -> tuple[str, ...]:
        """What is to be known of the logs that were recorded before, in words."""
        recording = self.document.get("recording")
        told = recording.get("problems") if isinstance(recording, dict) else None
        before = [str(one) for one in told] if isinstance(told, list) else []
        return (*before, *(words for words in (*self.unjudged, *self.lost) if words not in before))

    @property
    def words(self) -> str:
        """`3 of 8 runs are flown and kept`."""
        total = len(self.card.runs())
        return f"{len(self.kept)} of {total} run{'s' if total > 1 else ''} flown and kept"

    def flown(self, parameters: Mapping[str, float], planned: Sequence[tuple[CardRun, Plan]], at: str) -> FlownBefore:
        """As `flown_before`."""
        own = self._own(parameters, [plan for _, plan in planned])
        probes = sum(run.probe for run, _ in planned)
        told = self.document.get("left_out")
        return FlownBefore(
            own=own,
            document=self._continued(at),
            runs=tuple(_entries(self.document)),
            kept={probes + number: _peaks(entry) for number, entry in self.kept.items()},
            whole=self.whole,
            logs=self.logs,
            problems=self.problems,
            missing_blocks=self.missing_blocks,
            left_out=tuple(map(str, told)) if isinstance(told, list) else (),
            checks=self._checks(own),
        )

    def _checks(self, own: Mapping[str, float]) -> tuple[Check, ...]:
        """None of it blocks: who confirms it decides."""
        words = [f"{self.words}; {len(self.left)} left", *self.lost, *self.unjudged]
        before = self.document.get("settings")
        if not isinstance(before, dict):
            settings = "what they were before is not known"
        else:
            changed = [
                f"{name} {float(before[name]):g}, now {value:g}"
                for name, value in own.items()
                if _is_number(before.get(name)) and bits_of_float(before[name]) != bits_of_float(value)
            ]
            settings = f"not as before: {', '.join(changed)}" if changed else "as before"
        return (Check("resumed", "; ".join(words)), Check("settings", settings))

    def _own(self, parameters: Mapping[str, float], plans: Sequence[Plan]) -> dict[str, float]:
        """The vehicle's own settings: what stands in it of a run of ours, which nobody lived to put back, is what stood
        there before."""
        before = self.document.get("settings")
        if self.ended or not isinstance(before, dict):
            return dict(parameters)
        ours = {(name, bits_of_float(value)) for plan in plans for name, value in plan.writes}
        return {
            name: float(before[name])
            if (name, bits_of_float(value)) in ours and _is_number(before.get(name))
            else value
            for name, value in parameters.items()
        }

    def _continued(self, at: str) -> dict[str, Any]:
        """What flight.json says of the flight before this time, for it to go on saying; `at` is when it goes on."""
        parts, resumed = self.document.get("parts"), self.document.get("resumed")
        part = {key: self.document.get(key) for key in OF_A_PART}
        resumed = resumed if isinstance(resumed, list) else []
        if resumed:
            part["started"] = resumed[-1]
        return {
            **self.document,
            "resumed": [*resumed, at],
            "parts": [*(parts if isinstance(parts, list) else ()), part],
        }


def unfinished(path: Path) -> Earlier:
    """The flight in a folder, whether anything of it is left or not.

    Raises UsageError where it is no flight's, TippathError where it cannot be gone on with: why, and what to do.
    """
    if not path.is_dir():
        raise UsageError(f"{path}: no such folder; --resume takes a flight's")
    folder = FlightFolder(path)
    try:
        document = folder.read()
    except NoFlightError as error:
        raise UsageError(f"{error}; --resume takes a flight's folder") from error
    except TippathError as error:
        raise TippathError(f"{error}: what was flown is not known, so {ANEW}; its logs are read as they are") from error
    card = _card(folder, document)
    if not os.access(path, os.W_OK):
        raise TippathError(f"{path} cannot be written to: it can be read, and not be gone on with")
    with alone(folder):
        return _earlier(folder, card, document)


def offered(directory: Path) -> Earlier | None:
    """The newest flight in a directory, where something of it is left; None where there is none, or it cannot be gone
    on with."""
    try:
        path = newest(directory)
        earlier = None if path is None else unfinished(path)
    except (TippathError, OSError):
        return None
    return earlier if earlier is not None and earlier.left else None


def flown_before(
    earlier: Earlier | None,
    vehicle: VehicleSnapshot,
    profile: VehicleProfile,
    parameters: Mapping[str, float],
    planned: Sequence[tuple[CardRun, Plan]],
    at: str,
) -> FlownBefore:
    """What a flight begins with; a new one with the vehicle's `parameters` alone. `planned` is the whole card with its
    probes, and `at` when it goes on.

    Raises TippathError where this is not the vehicle that flew it before.
    """
    if earlier is None:
        return FlownBefore(own=parameters)
    require_same_vehicle(earlier, vehicle, profile)
    return earlier.flown(parameters, planned, at)


def require_same_vehicle(earlier: Earlier, snapshot: VehicleSnapshot, profile: VehicleProfile) -> None:
    """Raises TippathError where this is not the vehicle that flew it before."""
    was = earlier.document.get("vehicle")
    if not isinstance(was, dict):
        raise TippathError(f"{earlier.folder.about} does not tell which vehicle flew it: {ANEW}")
    now = {"system": snapshot.system, "type": snapshot.vehicle_type, "autopilot": snapshot.autopilot}
    other = [f"{word} {was.get(key)}, this is {now[key]}" for key, word in SAME.items() if was.get(key) != now[key]]
    if was.get("profile") != profile.name:
        other.append(f"profile {was.get('profile')}, this is {profile.name}")
    if other:
        raise TippathError(
            f"{earlier.folder.path} was flown by another vehicle ({'; '.join(other)}): connect to that one (--system N "
            f"picks one of several on a link), or {ANEW}"
        )


@contextlib.contextmanager
def flown_into(folder: FlightFolder, card: TestCard, earlier: Earlier | None) -> Iterator[None]:
    """Nobody else flies into the folder meanwhile, which gets the card unless a flight goes on in it.

    Raises TippathError where somebody does, or did since `earlier` was read, or the disk does not take the card.
    """
    if earlier is None:
        folder.write_card(card.text)
    with alone(folder):
        if earlier is not None and folder.read() != earlier.document:
            raise TippathError(f"{folder.about} has changed meanwhile: give the command again")
        yield


def card_digest(card: TestCard) -> str:
    """By which a card is known again."""
    return hashlib.sha256(card.text.encode()).hexdigest()


# ------------------------------------------------------------------------------------------------ what the folder tells


def _card(folder: FlightFolder, document: Mapping[str, Any]) -> TestCard:
    """Raises TippathError where it is not there, or not the one that was flown."""
    if not folder.card.is_file():
        raise TippathError(f"{folder.card} is not there, so what was to be flown is not known: put it back, or {ANEW}")
    card = parse_card(read_text(folder.card, "card"), str(folder.card))
    told = document.get("card_sha256")
    if isinstance(told, str) and told != card_digest(card):
        raise TippathError(f"{folder.card} is not the card that was flown, it was changed: put it back, or {ANEW}")
    planned = [_key(run) for run in card.runs()]
    for entry in _entries(document):
        if entry.get("probe") is not True and _entry_key(entry) not in planned:
            label = entry.get("label")
            raise TippathError(f"{folder.card} is not the card that was flown ({label!r} is not on it): {ANEW}")
    return card


def _earlier(folder: FlightFolder, card: TestCard, document: dict[str, Any]) -> Earlier:
    recorded = _Recorded.of(folder, document)
    kept: dict[int, Mapping[str, Any]] = {}
    lost: list[str] = []
    whole = True
    entries = [(place, entry) for place, entry in enumerate(_entries(document), 1) if is_kept(entry)]
    for run in card.runs():
        gone = ""
        for place, entry in [one for one in entries if _entry_key(one[1]) == _key(run)]:
            missing_s = recorded.missing_s(place, entry)
            entries.remove((place, entry))
            if not missing_s or missing_s <= FEW_MISSING * float(entry["duration_s"]):
                kept[run.number], gone = entry, ""
                whole = whole and missing_s == 0
                break
            gone = f"{run.label} was kept, but {missing_s:.1f} s of it are not on disk: it is flown again"
        lost += [gone] if gone else []
    return Earlier(
        folder=folder,
        card=card,
        document=document,
        kept=kept,
        lost=tuple(lost),
        whole=whole,
        logs=recorded.logs,
        missing_blocks=recorded.missing_blocks,
        unjudged=recorded.unjudged,
    )


@dataclass(frozen=True, kw_only=True)
class _Recorded:
    """The logs in a flight's folder."""

    document: Mapping[str, Any]
    held: Mapping[str, Coverage]
    """Name of a file -> what it holds."""
    fetched: Mapping[str, Collection[int]]
    """Name of a file that was fetched -> the runs that it was fetched for, by their places in flight.json."""
    logs: tuple[Mapping[str, Any], ...]
    missing_blocks: int
    """Of those that were streamed, as they lie on disk."""
    unjudged: tuple[str, ...]

    @classmethod
    def of(cls, folder: FlightFolder, document: Mapping[str, Any]) -> _Recorded:
        recording = document.get("recording")
        listed = recording.get("logs") if isinstance(recording, dict) else None
        logs: list[Mapping[str, Any]] = (
            [one for one in listed if isinstance(one, dict)] if isinstance(listed, list) else []
        )
        known = {Path(str(one.get("path"))).name for one in logs}
        held = {path.name: coverage(path) for path in folder.logs()}
        unjudged = []
        for path in folder.logs():
            if path.name not in known:
                log = _unjudged(path, held[path.name])
                logs.append(log_document(log, folder.path))
                unjudged.append(_unjudged_words(log))
        missing = sum(last - first + 1 for one in held.values() for first, last in one.missing)
        fetched = _fetched(document)
        held |= {name: coverage(folder.path / name) for name in fetched if (folder.path / name).is_file()}
        return cls(
            document=document,
            held=held,
            fetched=fetched,
            logs=tuple(logs),
            missing_blocks=missing,
            unjudged=tuple(unjudged),
        )

    def missing_s(self, place: int, entry: Mapping[str, Any]) -> float | None:
        """How much of a run no single file holds, s; None where that cannot be told. `place` is the run's in
        flight.json, from 1."""
        if self.document.get("log") == "card":
            return 0.0
        if not _is_number(entry.get("log_start_s")) or not _is_number(entry.get("duration_s")):
            return None
        start_s, duration_s = float(entry["log_start_s"]), float(entry["duration_s"])
        there = [
            one.missing_s(start_s, start_s + duration_s)
            for name, one in self.held.items()
            if (place in self.fetched[name] if name in self.fetched else entry.get("file") in (None, name))
        ]
        return min(there, default=duration_s)


def _fetched(document: Mapping[str, Any]) -> dict[str, Collection[int]]:
    """As `fetched_for`; where runs were fetched alone, those only."""
    told: dict[str, Collection[int]] = {name: of or () for name, of in fetched_for(document).items()}
    entries = document.get("fetched")
    for one in entries if isinstance(entries, list) else ():
        if isinstance(one, dict) and isinstance(one.get("runs"), list):
            told[Path(str(one.get("file"))).name] = [place for place in one["runs"] if isinstance(place, int)]
    return told


def _unjudged(path: Path, held: Coverage) -> RecordedLog:
    """A log that was being recorded when the program ended."""
    return RecordedLog(
        path=path,
        blocks=held.blocks - sum(last - first + 1 for first, last in held.missing),
        expected=held.blocks,
        missing=held.missing,
        duplicates=0,
        end=LogEnd(log_s=held.last_s),
    )


def _unjudged_words(log: RecordedLog) -> str:
    to = (
        "it holds no time stamp"
        if log.end.log_s is None
        else f"it goes to {log.end.log_s:.1f} s of the vehicle's clock"
    )
    return f"{log.path.name}: what recorded it was cut off, so whether it is whole at its end was not judged; {to}"


def _entries(document: Mapping[str, Any]) -> Sequence[Mapping[str, Any]]:
    entries = document.get("runs")
    return entries if isinstance(entries, list) else []


def _key(run: CardRun) -> tuple[str, Mapping[str, Any]]:
    return run.label, run.maneuver.to_json()


def _entry_key(entry: Mapping[str, Any]) -> tuple[Any, Any]:
    return entry.get("label"), entry.get("maneuver")


def _peaks(entry: Mapping[str, Any]) -> Peaks:
    told = entry.get("peaks")
    known = told if isinstance(told, dict) else {}
    return Peaks(**{name: abs(float(known[name])) for name in PEAKS if _is_number(known.get(name))})


def _is_number(value: Any) -> bool:
    """That a parameter of a vehicle can be."""
    return isinstance(value, int | float) and not isinstance(value, bool) and abs(value) <= LARGEST
