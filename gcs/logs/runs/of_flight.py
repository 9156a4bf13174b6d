"""Which runs of a log, taken off the vehicle's card, are which of a flight: by the vehicle's clock.

The clock begins at zero with every boot. A log of another boot, or of another vehicle, shows other times, and that is
said; one whose times happen to be the same is not told from the right one but by its axes.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Any

from gcs.errors import TippathError
from gcs.flight.folder import FlightFolder
from gcs.logs.formats.joined import Joined
from gcs.logs.runs.run import Run
from gcs.logs.runs.verdicts import as_set, judged, same
from gcs.logs.words import printable


@dataclass(frozen=True, slots=True)
class Match:
    """One run of a flight, and where it is in the log."""

    label: str
    run: Run | None
    """None where the log does not have it."""
    off_s: float | None
    """The log's time of its entry less the flight's."""

    @property
    def words(self) -> str:
        """`roll chirp 1/2 is 00000007.BIN#1 (+0.03 s)`."""
        if self.run is None or self.off_s is None:
            return f"{self.label} is not in this log"
        return f"{self.label} is {self.run.id} ({self.off_s:+.2f} s)"


@dataclass(frozen=True, slots=True)
class FlightRuns:
    """A log's runs with what their flight says of them."""

    runs: tuple[Run, ...]
    matches: tuple[Match, ...]
    problem: str
    """Why this is not the flight's log; empty where it is."""

    def to_json(self) -> dict[str, Any]:
        """As `tippath ingest --json` has it."""
        rows = [{"label": m.label, "run": None if m.run is None else m.run.id, "off_s": m.off_s} for m in self.matches]
        return {"matches": rows, "problem": self.problem or None}


def of_flight(runs: Sequence[Run], folder: Path, joined: Mapping[str, Joined] = MappingProxyType({})) -> FlightRuns:
    """What the flight in this folder says of a log's runs; `joined` has by their paths the logs read with others of it.

    Raises TippathError where the folder has no flight.json, or that tells no times.
    """
    flown = [entry for entry in FlightFolder(folder).runs() if isinstance(entry.get("log_start_s"), int | float)]
    if not flown:
        raise TippathError(f"{folder}: its flight.json tells no run's time by the vehicle's clock")
    matches = tuple(_match(entry, runs) for entry in flown)
    problem = "" if any(match.run is not None for match in matches) else _another(flown, runs)
    return FlightRuns(tuple(judged(as_set(run, flown), flown, joined.get(run.path)) for run in runs), matches, problem)


def _match(entry: Mapping[str, Any], runs: Sequence[Run]) -> Match:
    label, start = printable(str(entry.get("label", "a run"))), float(entry["log_start_s"])
    fitting = [(abs(run.entered_s - start), run) for run in runs if run.entered_s is not None and same(run, entry)]
    if not fitting:
        return Match(label, None, None)
    _, run = min(fitting, key=lambda pair: pair[0])
    assert run.entered_s is not None
    return Match(label, run, run.entered_s - start)


def _another(flown: Sequence[Mapping[str, Any]], runs: Sequence[Run]) -> str:
    starts = ", ".join(f"{float(entry['log_start_s']):.0f}" for entry in flown)
    entered = ", ".join(f"{run.entered_s:.0f}" for run in runs if run.entered_s is not None) or "none"
    return (
        f"this log is of another boot, or another vehicle: the flight's runs began at {starts} s of the vehicle's "
        f"clock, the log's at {entered} s"
    )
