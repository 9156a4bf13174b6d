"""What a flight's own verdicts have against its runs: flight.json, where it lies beside the log.

Whoever flew saw things that the log does not show: that somebody aborted, that the pilot took over, that the limits
were left. A run that is to be flown again does not enter a fit unasked; named by itself it does, with a note. A run of
the log and a run of flight.json are the same where both entered the excitation mode at the same time of the log, and
flight.json names that log: the vehicle's clock begins anew with every boot, so that two logs of one flight may show the
same times. Where the log stayed on the vehicle's card, that time is the vehicle's clock as the link told it, give or
take what flight.json says, and any log in the flight's folder may be the one.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from gcs.errors import TippathError
from gcs.flight.folder import FlightFolder, NoFlightError, fetched_for, is_kept
from gcs.logs.formats.joined import Joined
from gcs.logs.runs.run import Run
from gcs.logs.runs.settings import with_settings
from gcs.logs.words import printable

SAME_S = 0.25
"""Between the two times of one entry; a run takes seconds."""
UNSEEN = "nobody saw how it ended: what flew this flight was cut off, and flight.json tells nothing of this run"


def with_verdicts(runs: Sequence[Run], log: Path, joined: Joined | None = None) -> list[Run]:
    """The runs of a log, those not usable that the flight.json beside it says are to be flown again.

    Where there is none, or it speaks of other logs, the runs as they are; where it is damaged, they say so. What the
    flight had against a run for samples that did not come counts no more where the log is `joined` with others of the
    flight, and the run has no gap.
    """
    try:
        flown = _flown(
            log, {log.name} if joined is None else {log.name, *(Path(one.path).name for one in joined.files)}
        )
    except TippathError as error:
        note = printable(f"what was said of this run in flight is not known: {error}")
        return [_noted(run, note) for run in runs]
    if flown is None:
        return list(runs)
    return [_unseen(judged(as_set(run, flown.runs), flown.runs, joined), flown) for run in runs]


def as_set(run: Run, flown: Sequence[Mapping[str, Any]]) -> Run:
    """With the excitation that the flight's own settings tell, where the log does not."""
    entry = next((entry for entry in flown if same(run, entry)), None)
    return run if entry is None else with_settings(run, entry)


def _noted(run: Run, note: str) -> Run:
    if note in run.notes:
        return run
    record = None if run.record is None else replace(run.record, notes=(*run.record.notes, note))
    return replace(run, record=record, notes=(*run.notes, note))


@dataclass(frozen=True, slots=True)
class _Flown:
    """What the flight.json beside a log says."""

    runs: Sequence[Mapping[str, Any]]
    """Those that may be of the log."""
    cut_off: bool
    """What recorded it did not live to end it, at least once."""


def _flown(log: Path, names: Collection[str]) -> _Flown | None:
    """None where there is none, or it speaks of other logs; `names` are the log's own and of those read with it."""
    folder = FlightFolder(log.parent)
    if not folder.about.is_file():
        return None
    try:
        about, flown = folder.read(), folder.runs()
    except NoFlightError:
        return None  # not a flight.json of ours; the log speaks for itself
    fetched = fetched_for(about)
    recording, parts = about.get("recording"), about.get("parts")
    logs = recording.get("logs") if isinstance(recording, dict) else None
    going_on = _not_ended(about)
    if about.get("log") == "card":
        known = True
    elif isinstance(logs, list) and not going_on:
        listed = [Path(str(entry.get("path"))).name for entry in logs if isinstance(entry, dict)]
        known = log.name in [*listed, *fetched]
    else:
        known = log.stem.lower().startswith("flight") or log.name in fetched  # it ended before that was summed up
    if not known:
        return None
    cut_off = going_on or (isinstance(parts, list) and any(_not_ended(part) for part in parts))
    cut_off = cut_off and about.get("log") != "card"  # the card's log may hold other flights
    return _Flown([run for place, run in enumerate(flown, 1) if _lies_in(names, place, run, fetched)], cut_off)


def _not_ended(part: Any) -> bool:
    return isinstance(part, dict) and "ended" in part and part["ended"] is None


def _lies_in(
    names: Collection[str], place: int, entry: Mapping[str, Any], fetched: Mapping[str, Collection[int] | None]
) -> bool:
    """Whether a run of flight.json may be in logs with these names, by what it says itself."""
    file = entry.get("file")
    told = [fetched[name] for name in names if name in fetched]
    if any(places is None or place in places for places in told):
        return True
    return file in names if isinstance(file, str) else not told


def judged(run: Run, flown: Sequence[Mapping[str, Any]], joined: Joined | None = None) -> Run:
    """The run, not usable where one of these runs of a flight.json is the same and has something against it."""
    if run.entered_s is None or run.verdict is not None:
        return run
    for entry in flown:
        against = _against(entry)
        if against and same(run, entry):
            if joined is not None and run.usable and not run.gaps and _for_samples_alone(entry):
                return _noted(run, f"the flight's verdict on the stream no longer holds ({against})")
            judged = replace(run, usable=False, verdict=against)
            return replace(judged, reasons=(*run.reasons, _reason(judged)))
    return run


def _unseen(run: Run, flown: _Flown) -> Run:
    """Not usable where nobody judged it, because what flew it was cut off."""
    if not flown.cut_off or run.entered_s is None or run.verdict is not None:
        return run
    if any(same(run, entry) for entry in flown.runs):
        return run
    unseen = replace(run, usable=False, verdict=UNSEEN)
    return replace(unseen, reasons=(*run.reasons, _reason(unseen)))


def same(run: Run, flown: Mapping[str, Any]) -> bool:
    """Whether a log's run and one of flight.json are the same by the vehicle's clock; where that is told by the link
    only, by the axis too."""
    start, within = flown.get("log_start_s"), flown.get("log_start_within_s")
    if run.entered_s is None or not isinstance(start, int | float):
        return False
    off_s = abs(start - run.entered_s)
    if not isinstance(within, int | float) or not within:
        return off_s <= SAME_S
    maneuver = flown.get("maneuver")
    axis = maneuver.get("axis") if isinstance(maneuver, dict) else None
    return off_s <= SAME_S + within and (run.axis is None or axis is None or run.axis == axis)


def _reason(run: Run) -> str:
    return f"the sweep's verdict: {run.verdict}; named by itself ({run.id}) it can still be fitted"


def _against(flown: Mapping[str, Any]) -> str:
    """Why it does not enter a fit unasked; empty where it does."""
    if flown.get("probe") is True:
        return "a probe, a small step flown to see that the vehicle answers as it should"
    verdict = flown.get("verdict")
    ending, reason = str(flown.get("ending", "")), str(flown.get("reason", ""))
    if isinstance(verdict, dict):
        if is_kept(flown):
            return ""
        reasons = verdict.get("reasons")
        listed = [str(reason) for reason in reasons] if isinstance(reasons, list) else []
        return printable("fly again: " + ("; ".join(listed) or f"{ending}: {reason}"))
    return "" if ending == "finished" else printable(f"{ending}: {reason}")


def _for_samples_alone(flown: Mapping[str, Any]) -> bool:
    """Whether nothing is against it but samples that did not come."""
    verdict = flown.get("verdict")
    if not isinstance(verdict, dict) or flown.get("ending") != "finished" or flown.get("probe") is True:
        return False
    return verdict.get("lost") is not None and verdict.get("reasons") == [verdict["lost"]]


def named_all_the_same(run: Run) -> Run:
    """A run whose verdict alone is against it, usable, because the user named it; others as they are."""
    if run.verdict is None or run.record is None or run.reasons != (_reason(run),):
        return run
    notes = (*run.notes, f"used because it was named, against the sweep's verdict: {run.verdict}")
    record = replace(run.record, notes=(*run.record.notes, notes[-1]))
    return replace(run, record=record, usable=True, reasons=(), notes=notes)
