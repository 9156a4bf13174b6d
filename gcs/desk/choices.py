"""Runs as rows, and what each is used for unless the user says otherwise.

Chirps are fitted; where an axis was swept at several amplitudes, those of the amplitude that was flown longest (the
larger of equals), and the others validate, as doublets do. Quiet hover tells the noise. Without a chirp everything that
is usable is fitted. Runs that are not usable, or take their rates from another kind of message than most, are left out.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from gcs.desk.state import Base, Choice, RunRow
from gcs.errors import TippathError
from gcs.flight.folder import FlightFolder, flight_of
from gcs.logs import Run
from gcs.logs.runs.health import BESIDE
from gcs.logs.runs.run import split_mark
from gcs.logs.runs.verdicts import SAME_S, named_all_the_same
from gcs.logs.words import printable
from sysid.data.record import Record
from sysid.fit.result import Fit, RecordUsed
from sysid.model.bases import DEFAULT

SAME_SIZE = 1.4
"""Factor within which two amplitudes are one."""
FORWARD = Base(DEFAULT, ("angular_damping", "elevator"))
COMMAND_OF = {"roll": "x", "pitch": "y", "elevator": "e"}


def rows_of(runs: Sequence[Run], folder: FlightFolder) -> tuple[RunRow, ...]:
    """A row for each run, with the default choice; logs of one name are told apart by their folders."""
    logs = {run.path: Path(run.path) for run in runs}
    own = {log for log, path in logs.items() if path.parent == folder.path and folder.of in ("", path.name)}
    flown = {log: _flown(folder if log in own else flight_of(path)) for log, path in logs.items()}
    names = Counter(path.name for path in logs.values())
    choices = default_choices(runs)
    return tuple(
        RunRow(
            id=printable(f"{Path(run.path).parent.name}/{run.id}" if names[logs[run.path].name] > 1 else run.id),
            word=word_of(run),
            maneuver=run.maneuver,
            axis=run.axis,
            duration_s=run.duration_s,
            rate_hz=run.rate_hz,
            size=size_of(run),
            health=_health(run),
            usable=record_of(run) is not None,
            reasons=tuple(map(printable, run.reasons)),
            notes=tuple(map(printable, run.notes)),
            verdict=_verdict(run, flown[run.path]),
            choice=choice,
            default=choice,
            start_s=run.start_s,
            record=run.record,
        )
        for run, choice in zip(runs, choices, strict=True)
    )


def word_of(run: Run) -> str:
    """As a command names it."""
    plain, window = split_mark(run.id)
    number = plain.rpartition("#")[2]
    mark = "" if window is None else window.mark
    return (f"{run.path}#{number}" if "#" in plain and number.isdigit() else run.path) + mark


def record_of(run: Run) -> Record | None:
    """What a fit would use, when the run is named; None where it cannot be used."""
    taken = named_all_the_same(run)
    return taken.record if taken.usable else None


def size_of(run: Run) -> float | None:
    """Root mean square of what was added to the command of the run's axis, or of the command itself."""
    letter = COMMAND_OF.get(run.axis or "")
    if run.record is None or letter is None:
        return None
    for name in (f"excitation_{letter}", f"delta_{letter}"):
        channel = run.record.channels.get(name)
        if channel is not None and np.any(channel):
            return float(np.std(channel))
    return None


def default_choices(runs: Sequence[Run]) -> list[Choice]:
    """What each run is used for, unasked."""
    usable = [run for run in runs if run.usable and run.record is not None]
    kinds = Counter(run.rate_source for run in usable if run.maneuver != "quiet")
    kind = kinds.most_common(1)[0][0] if kinds else None
    usable = [run for run in usable if run.maneuver == "quiet" or run.rate_source == kind]
    chirps = [run for run in usable if run.maneuver == "chirp" and run.axis not in BESIDE]
    main = {axis: _main_size([run for run in chirps if run.axis == axis]) for axis in {run.axis for run in chirps}}
    return [_default(run, main) if any(run is one for one in usable) else Choice.OUT for run in runs]


def _default(run: Run, main: Mapping[str | None, float | None]) -> Choice:
    """What a usable run is used for; `main` are the sizes of the chirps to be fitted, by axis, if there are any."""
    if run.maneuver == "quiet":
        return Choice.NOISE
    if run.axis in BESIDE:
        return Choice.OUT
    if not main:
        return Choice.FIT
    if run.maneuver == "chirp":
        return Choice.FIT if _same(size_of(run), main[run.axis]) else Choice.VALIDATE
    return Choice.VALIDATE if run.maneuver == "doublet" else Choice.OUT


def default_base(runs: Sequence[Run]) -> Base:
    """Hover's, or forward flight's where the elevator was swept."""
    swept = any(
        run.usable and run.maneuver == "chirp" and run.axis == "elevator" and run.record is not None for run in runs
    )
    return FORWARD if swept else Base()


def _same(one: float | None, other: float | None) -> bool:
    if one is None or other is None or min(one, other) <= 0:
        return True
    return abs(math.log(one / other)) <= math.log(SAME_SIZE)


def _main_size(chirps: Sequence[Run]) -> float | None:
    """The amplitude that was flown longest."""
    sizes = sorted({size for run in chirps if (size := size_of(run)) is not None}, reverse=True)
    flown = {size: sum(run.duration_s for run in chirps if _same(size_of(run), size)) for size in sizes}
    # within a hundredth: no two runs last equally long to the last sample
    return max(sizes, key=lambda size: (round(flown[size] / max(flown.values()), 2), size), default=None)


def _health(run: Run) -> str:
    if run.reasons:
        return printable(f"the sweep's verdict: {run.verdict}" if run.reasons == (run.verdict,) else run.reasons[0])
    said = [] if run.rate_hz is None else [f"{run.rate_hz:.0f} Hz"]
    said.append(f"{len(run.gaps)} gaps" if len(run.gaps) > 1 else "1 gap" if run.gaps else "no gaps")
    if run.swept_band_hz is not None:
        said.append("{:.2g}-{:.2g} Hz".format(*run.swept_band_hz))
    return ", ".join(said)


def _flown(folder: FlightFolder) -> list[Mapping[str, object]]:
    try:
        return list(folder.runs())
    except TippathError:
        return []


def _verdict(run: Run, flown: Sequence[Mapping[str, object]]) -> str:
    """Of whoever flew it: a run of the log and one of flight.json are the same where both began at the same time."""
    if run.verdict is not None:
        return printable(run.verdict)
    if run.entered_s is None:
        return ""
    for one in flown:
        start, verdict = one.get("log_start_s"), one.get("verdict")
        here = one.get("file") in (None, Path(run.path).name)
        if here and isinstance(start, int | float) and abs(start - run.entered_s) <= SAME_S:
            return "keep" if isinstance(verdict, dict) and verdict.get("keep") is True else ""
    return ""


def vehicle_words(folder: FlightFolder) -> str:
    """What flew, as flight.json tells it; empty where it does not."""
    try:
        said = folder.read().get("vehicle")
    except TippathError:
        return ""
    if not isinstance(said, dict):
        return ""
    parts = [said.get("profile"), said.get("version")]
    named = " ".join(str(part) for part in parts if part)
    return printable(f"{named}, system {said['system']}" if said.get("system") is not None else named)


def as_fitted(rows: Sequence[RunRow], runs: Sequence[Run], fit: Fit) -> tuple[RunRow, ...]:
    """The rows with the choices that a fit was made by."""

    def named(used: Sequence[RecordUsed]) -> set[tuple[Path, str]]:
        return {(Path(one.path).resolve(), one.id) for one in used}

    fitted, judged = named(fit.records), named(fit.validation)
    found = []
    for row, run in zip(rows, runs, strict=True):
        key = (Path(run.path).resolve(), run.id)
        choice = Choice.FIT if key in fitted else Choice.VALIDATE if key in judged else Choice.OUT
        found.append(row if row.choice is Choice.NOISE else replace(row, choice=choice))
    return tuple(found)


def base_of(fit: Fit) -> Base:
    """What the ladder above a fit began with."""
    structure = fit.model.structure
    return Base(structure.base, tuple(one.id for one in structure.composed if one.path is None))
