"""A card that was flown: what is told before it, what it came to, and the parts of its flight.json."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from datetime import datetime, timedelta
from pathlib import Path
from typing import Any

from gcs.cards.envelope import Limits, Peaks
from gcs.cards.maneuver import CardRun, TestCard, duration_s
from gcs.flight.connection import Connection, LogWay
from gcs.flight.folder import FlightFolder
from gcs.flight.log_health import LogHealth
from gcs.flight.order import newest
from gcs.flight.preflight import Check
from gcs.flight.recorder import RecordedLog, RecordingSummary
from gcs.flight.run import RunResult
from gcs.flight.run_state import Ending
from gcs.vehicle.autopilots import LinkLoss
from gcs.vehicle.profile import Plan, VehicleProfile
from gcs.vehicle.snapshot import VehicleSnapshot


@dataclass(frozen=True, slots=True, kw_only=True)
class Briefing:
    """What is about to happen, for whoever confirms it."""

    card: TestCard
    plans: tuple[tuple[CardRun, Plan], ...]
    checks: tuple[Check, ...]
    link_loss: LinkLoss
    profile: VehicleProfile
    seen: Callable[[], tuple[Check, ...]] = tuple
    """The checks as they stand when it is called."""

    @property
    def duration_s(self) -> float:
        """About how long flying it takes."""
        return duration_s([run for run, _ in self.plans], self.card.rest_s)


@dataclass(frozen=True, slots=True, kw_only=True)
class FlownBefore:
    """What there is of a flight that is resumed; of a new one nothing."""

    own: Mapping[str, float] = field(default_factory=dict)
    """The vehicle's own settings, by name."""
    document: Mapping[str, Any] = field(default_factory=dict)
    """What flight.json goes on saying."""
    runs: tuple[Mapping[str, Any], ...] = ()
    """All that were flown, as flight.json has them."""
    kept: Mapping[int, Peaks] = field(default_factory=dict)
    """Number of each run that is not flown again -> how far it took the vehicle."""
    whole: bool = True
    """All of them is on disk."""
    logs: tuple[Mapping[str, Any], ...] = ()
    """That were recorded, as flight.json has them."""
    problems: tuple[str, ...] = ()
    """What is to be known of those logs."""
    missing_blocks: int = 0
    left_out: tuple[str, ...] = ()
    """Of the card that was asked for at first, by consent."""
    checks: tuple[Check, ...] = ()
    """What to know before it goes on."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SweepResult:
    """A card that was flown, as far as it went."""

    card: TestCard
    profile: VehicleProfile
    runs: tuple[RunResult, ...]
    planned: int
    """Runs of the card, probes included, and those that are `kept`."""
    folder: FlightFolder
    recording: RecordingSummary | None
    stopped: str
    """Why the card was not flown to its end; empty where it was."""
    ending: Ending | None = None
    """Of the run that stopped the card."""
    link_loss: LinkLoss | None = None
    """What the vehicle does when it no longer hears this station."""
    log: LogWay = "stream"
    document: Mapping[str, Any] = field(default_factory=dict)
    """What flight.json says, or would say if the disk had taken it."""
    unwritten: str = ""
    """Why flight.json does not say it; empty where it does."""
    before: FlownBefore = field(default_factory=FlownBefore)
    """Before the flight was resumed; `runs` come on top."""

    @property
    def flown(self) -> bool:
        """Every run was flown to its end, wherever the log is."""
        return not self.stopped and self.tried == self.planned and self.ended_early == 0

    @property
    def tried(self) -> int:
        """Runs of the card that were flown, however often."""
        return len(self.before.kept) + len(self.last)

    @property
    def last(self) -> Mapping[int, RunResult]:
        """Number of each run -> what its last try came to."""
        return newest(self.runs)

    @property
    def ended_early(self) -> int:
        """Of these, runs whose last try was not flown to its end."""
        return sum(one.ending is not Ending.FINISHED for one in self.last.values())

    @property
    def kept(self) -> int:
        """Runs of the card that are flown and clean, in one of their tries."""
        return len(self.before.kept) + len({run.run.number for run in self.runs if run.clean})

    @property
    def done(self) -> bool:
        """All that was asked for: flown, and recorded whole unless the log was to stay on the card."""
        return self.complete or (self.flown and self.log == "card")

    @property
    def complete(self) -> bool:
        """Every run was flown to its end, and all of it is on disk, as far as the log's own stamps show."""
        recorded = self.recording is not None and self.recording.complete and not self.unwritten
        return self.flown and recorded and self.before.whole

    @property
    def problems(self) -> tuple[str, ...]:
        """What of it is not on disk, in words."""
        unwritten = (self.unwritten,) if self.unwritten else ()
        return (*unwritten, *self.before.problems, *(() if self.recording is None else self.recording.problems))

    @property
    def missing_blocks(self) -> int:
        return 0 if self.recording is None else self.recording.missing_blocks

    @property
    def missing_words(self) -> str:
        """`0 samples missing`, or what is: blocks of the log, samples that were to be flown and did not come, an end
        of the log that is not there."""
        if self.log == "card":
            return "log on the vehicle's card"
        verdicts = [run.verdict for run in self.last.values() if run.verdict is not None]
        samples, planned = sum(v.missing for v in verdicts), sum(v.expected for v in verdicts)
        parts = [f"{self.missing_blocks} blocks of the log missing"] if self.missing_blocks else []
        if any(not v.keep and v.missing for v in verdicts):
            parts.append(f"{samples:,} of {planned:,} planned samples not flown or not received")
        if not parts and (self.recording is None or not self.recording.complete):
            parts.append("that nothing is missing is not shown")
        if not parts and samples:
            parts.append("0 blocks of the log missing")  # a sample more or less at the ends of a run
        return ", ".join(parts) or "0 samples missing"


def vehicle_documents(session: Connection, profile: VehicleProfile, utc: datetime) -> dict[str, Any]:
    """Which vehicle it is, which boot of it, and which station flies it."""
    snapshot = session.snapshot()
    vehicle = {
        "system": snapshot.system,
        "component": snapshot.component,
        "type": snapshot.vehicle_type,
        "autopilot": snapshot.autopilot,
        "version": snapshot.version,
        "profile": profile.name,
    }
    return {"vehicle": vehicle, "boot": _boot(snapshot, session.log_health(), utc), "station": session.station}


def _boot(snapshot: VehicleSnapshot, health: LogHealth | None, utc: datetime) -> dict[str, Any]:
    """Its clock's zero in UTC, as far as this computer's clock is right, and how often it went back while this station
    listened."""
    clock_s = None if health is None else health.clock_s
    booted = None if clock_s is None else (utc - timedelta(seconds=clock_s)).isoformat(timespec="milliseconds")
    return {"booted": booted, "reboots": snapshot.reboots}


def limits_document(limits: Limits) -> dict[str, Any]:
    """Which limits it was flown within."""
    return {
        "rate_rad_s": limits.rate,
        "attitude_deg": round(math.degrees(limits.attitude), 6),
        "command": limits.command,
    }


def recording_document(summary: RecordingSummary | None, folder: Path, before: FlownBefore) -> dict[str, Any] | None:
    """The summary with paths relative to the folder, which may be moved; None before there is one. What was recorded
    before stands first, also before there is a summary."""
    if summary is None:
        return (
            {"logs": list(before.logs), "complete": False, "problems": list(before.problems)} if before.logs else None
        )
    about = summary.to_json()
    about["logs"] = [*before.logs, *(log_document(log, folder) for log in summary.logs)]
    about["tlog"] = None if summary.tlog is None else _relative(summary.tlog, folder)
    about["complete"] = summary.complete and not before.problems
    about["problems"] = [*before.problems, *summary.problems]
    return about


def log_document(log: RecordedLog, folder: Path) -> dict[str, Any]:
    """One log, its path relative to the folder."""
    return {**log.to_json(), "path": _relative(log.path, folder)}


def _relative(path: Path, folder: Path) -> str:
    try:
        return str(path.relative_to(folder))
    except ValueError:
        return str(path)
