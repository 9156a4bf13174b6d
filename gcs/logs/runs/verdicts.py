"""What a flight's own verdicts have against its runs: flight.json, where it lies beside the log.

Whoever flew saw things that the log does not show: that somebody aborted, that the pilot took over, that the limits
were left. A run that is to be flown again does not enter a fit unasked; named by itself it does, with a note. A run of
the log and a run of flight.json are the same where both entered the excitation mode at the same time of the log.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from gcs.errors import TippathError
from gcs.flight.folder import FlightFolder, NoFlightError
from gcs.logs.runs.run import Run
from gcs.logs.words import printable

SAME_S = 0.25
"""Between the two times of one entry; a run takes seconds."""


def with_verdicts(runs: Sequence[Run], log: Path) -> list[Run]:
    """The runs of a log, those not usable that the flight.json beside it says are to be flown again.

    Where there is none, or it speaks of other logs, the runs as they are; where it is damaged, they say so.
    """
    try:
        flown = _flown(log)
    except TippathError as error:
        note = printable(f"what was said of this run in flight is not known: {error}")
        return [_noted(run, note) for run in runs]
    return [_judged(run, flown) for run in runs]


def _noted(run: Run, note: str) -> Run:
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
    recording = about.get("recording")
    logs = recording.get("logs") if isinstance(recording, dict) else None
    if isinstance(logs, list):
        known = log.name in [Path(str(entry.get("path"))).name for entry in logs if isinstance(entry, dict)]
    else:
        known = log.stem.lower().startswith("flight")  # it ended before the recording was summed up
    return list(flown) if known else []


def _judged(run: Run, flown: Sequence[Mapping[str, Any]]) -> Run:
    if run.entered_s is None:
        return run
    for entry in flown:
        start, against = entry.get("log_start_s"), _against(entry)
        if isinstance(start, int | float) and abs(start - run.entered_s) <= SAME_S and against:
            judged = replace(run, usable=False, verdict=against)
            return replace(judged, reasons=(*run.reasons, _reason(judged)))
    return run


def _reason(run: Run) -> str:
    return f"the sweep's verdict: {run.verdict}; named by itself ({run.id}) it can still be fitted"


def _against(flown: Mapping[str, Any]) -> str:
    """Why it does not enter a fit unasked; empty where it does."""
    if flown.get("probe") is True:
        return "a probe, a small step flown to see that the vehicle answers as it should"
    verdict = flown.get("verdict")
    ending, reason = str(flown.get("ending", "")), str(flown.get("reason", ""))
    if isinstance(verdict, dict):
        if verdict.get("keep") is True and ending == "finished":
            return ""
        reasons = verdict.get("reasons")
        listed = [str(reason) for reason in reasons] if isinstance(reasons, list) else []
        return printable("fly again: " + ("; ".join(listed) or f"{ending}: {reason}"))
    return "" if ending == "finished" else printable(f"{ending}: {reason}")


def named_all_the_same(run: Run) -> Run:
    """A run whose verdict alone is against it, usable, because the user named it; others as they are."""
    if run.verdict is None or run.record is None or run.reasons != (_reason(run),):
        return run
    notes = (*run.notes, f"used because it was named, against the sweep's verdict: {run.verdict}")
    record = replace(run.record, notes=(*run.record.notes, notes[-1]))
    return replace(run, record=record, usable=True, reasons=(), notes=notes)
