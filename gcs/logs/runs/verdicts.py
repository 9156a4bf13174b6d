"""What a flight's own verdicts have against its runs: flight.json, where it lies beside the log.

Whoever flew saw things that the log does not show: that somebody aborted, that the pilot took over, that the limits
were left. A run that is to be flown again does not enter a fit unasked; named by itself it does, with a note. A run of
the log and a run of flight.json are the same where both entered the excitation mode at the same time of the log. Where
the log stayed on the vehicle's card, that time is the vehicle's clock as the link told it, give or take what
flight.json says, and any log in the flight's folder may be the one.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from gcs.errors import TippathError
from gcs.flight.folder import FlightFolder, NoFlightError
from gcs.logs.formats.joined import Joined
from gcs.logs.runs.run import Run
from gcs.logs.runs.settings import with_settings
from gcs.logs.words import printable

SAME_S = 0.25
"""Between the two times of one entry; a run takes seconds."""


def with_verdicts(runs: Sequence[Run], log: Path, joined: Joined | None = None) -> list[Run]:
    """The runs of a log, those not usable that the flight.json beside it says are to be flown again.

    Where there is none, or it speaks of other logs, the runs as they are; where it is damaged, they say so. What the
    flight had against a run for samples that did not come counts no more where the log is `joined` with others of the
    flight, and the run has no gap.
    """
    try:
        flown = _flown(log)
    except TippathError as error:
        note = printable(f"what was said of this run in flight is not known: {error}")
        return [_noted(run, note) for run in runs]
    return [judged(as_set(run, flown), flown, joined) for run in runs]


def as_set(run: Run, flown: Sequence[Mapping[str, Any]]) -> Run:
    """With the excitation that the flight's own settings tell, where the log does not."""
    entry = next((entry for entry in flown if same(run, entry)), None)
    return run if entry is None else with_settings(run, entry)


def _noted(run: Run, note: str) -> Run:
    if note in run.notes:
        return run
    record = None if run.record is None else replace(run.record, notes=(*run.record.notes, note))
    return replace(run, record=record, notes=(*run.notes, note))


def _flown(log: Path) -> list[Mapping[str, Any]]:
    folder = FlightFolder(log.parent)
    if not folder.about.is_file():
        return []
    try:
        about, flown = folder.read(), folder.runs()
    except NoFlightError:
        return []  # not a flight.json of ours; the log speaks for itself
    if about.get("log") == "card":
        return list(flown)
    recording = about.get("recording")
    logs = recording.get("logs") if isinstance(recording, dict) else None
    if isinstance(logs, list):
        fetched = about.get("fetched")
        named = [(one, "path") for one in logs]
        named += [(one, "file") for one in (fetched if isinstance(fetched, list) else ())]
        known = log.name in [Path(str(entry.get(key))).name for entry, key in named if isinstance(entry, dict)]
    else:
        known = log.stem.lower().startswith("flight")  # it ended before the recording was summed up
    return list(flown) if known else []


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
        sound = verdict.get("keep") is True or (verdict.get("log") == "card" and verdict.get("keep") is None)
        if sound and ending == "finished":
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
