"""Flying a card: what is looked at first, run after run, the recording, and the file that tells what was flown.

The vehicle is left as it was found: in the mode before the run (see `gcs.excitation`), and with its own values in every
parameter that a maneuver wrote. Parameters are never written in the excitation mode, because the vehicle reads some of
them in every loop. Recording goes on during the whole card, and `flight.json` is replaced after each run.
"""

from __future__ import annotations

import contextlib
import math
import shutil
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from types import TracebackType
from typing import Any, Self

from gcs import preflight
from gcs.envelope import Limits, Peaks, Use, use
from gcs.errors import LinkError, TippathError
from gcs.excitation import (
    TICK_S,
    AbortResult,
    Clock,
    Connection,
    Ending,
    Excitation,
    Phase,
    WallClock,
    abort,
    joined,
)
from gcs.flightdir import FlightFolder
from gcs.link.procedures import NoAnswerError, ProcedureError, ReadParameter, RefusedError, WriteParameter
from gcs.maneuver import CardRun, TestCard
from gcs.preflight import Check, LinkLoss
from gcs.profile import Plan, VehicleProfile, choose_profile, wanted_parameters
from gcs.recorder import RecordingSummary
from gcs.vehicle import VehicleSnapshot
from gcs.verdict import Verdict, cut, judge

LOG_WAIT_S = 8.0
HOVER_LOOK_S = 2.0
SILENCES = 4
"""So many unanswered questions, each with a witness, until a vehicle is believed not to have a parameter."""


@dataclass(frozen=True, slots=True)
class RunProgress:
    """A run under way, for a screen or a line."""

    run: CardRun
    plan: Plan
    phase: Phase
    elapsed_s: float
    """Of the maneuver itself; negative before it begins."""
    frequency_hz: float | None
    peaks: Peaks
    use: Use
    snapshot: VehicleSnapshot


@dataclass(frozen=True, slots=True)
class RunReady:
    """Its parameters are in the vehicle, bit for bit."""

    run: CardRun
    plan: Plan


@dataclass(frozen=True, slots=True)
class RunResult:
    """A run that was flown, or not."""

    run: CardRun
    plan: Plan
    ending: Ending
    reason: str
    """What went otherwise than planned, empty where nothing did."""
    mode_after: str
    started: str
    """UTC."""
    duration_s: float
    """From entering the excitation mode to its end."""
    log_start_s: float | None
    """The log's own time of entering the mode; None where no samples came."""
    peaks: Peaks
    verdict: Verdict | None
    """None where nothing was flown."""

    @property
    def clean(self) -> bool:
        return self.ending is Ending.FINISHED and self.verdict is not None and self.verdict.keep

    def to_json(self) -> dict[str, Any]:
        return {
            "number": self.run.number,
            "label": self.run.label,
            "purpose": self.run.maneuver.purpose,
            "maneuver": self.run.maneuver.to_json(),
            "flew": self.plan.words,
            "parameters": dict(self.plan.writes),
            "ending": self.ending.value,
            "reason": self.reason,
            "mode_after": self.mode_after,
            "started": self.started,
            "duration_s": round(self.duration_s, 3),
            "log_start_s": None if self.log_start_s is None else round(self.log_start_s, 6),
            "peaks": {
                name: None if value is None else round(value, 5)
                for name, value in (
                    ("p", self.peaks.p),
                    ("q", self.peaks.q),
                    ("roll", self.peaks.roll),
                    ("pitch", self.peaks.pitch),
                    ("delta_x", self.peaks.delta_x),
                    ("delta_y", self.peaks.delta_y),
                )
            },
            "verdict": None if self.verdict is None else self.verdict.to_json(),
        }


@dataclass(frozen=True, slots=True)
class Note:
    """Something to tell the user."""

    words: str


Progress = Note | RunReady | RunProgress | RunResult


def fly_run(
    session: Connection,
    run: CardRun,
    plan: Plan,
    limits: Limits,
    *,
    mode_before: int,
    clock: Clock,
    on_progress: Callable[[Progress], None],
    aborted: Callable[[], str | None],
    rate_hz: float | None,
    interruptions: Callable[[], int] = lambda: 0,
) -> RunResult:
    """Fly one run whose parameters are in the vehicle, from the mode that the pilot left it in.

    `interruptions` counts how often somebody pressed Ctrl-C: once more while the link is lost, and it is not waited for
    any longer. Raises what `on_progress` raises, after the excitation ended.
    """
    started = datetime.now(UTC).isoformat(timespec="milliseconds")
    with Excitation(session, plan, limits, clock, mode_before) as flown:
        pressed_before: int | None = None  # the link was lost
        while flown.tick(aborted(), given_up=pressed_before is not None and interruptions() > pressed_before):
            if not flown.snapshot.lost:
                pressed_before = None
            elif pressed_before is None:
                pressed_before = interruptions()
            elapsed = flown.elapsed_s - plan.lead_s
            on_progress(
                RunProgress(
                    run,
                    plan,
                    flown.state.phase,
                    elapsed,
                    flown.frequency_hz,
                    flown.peaks,
                    use(limits, flown.peaks, flown.snapshot.link_age_s),
                    flown.snapshot,
                )
            )
            clock.sleep(TICK_S)
    state = flown.state
    assert state.ending is not None
    verdict = None
    if state.flying_since is not None:
        window = session.samples(flown.elapsed_s + 5.0)
        start = flown.log_start_s
        first = math.inf if start is None else start + plan.lead_s
        interruption = None if state.ending is Ending.FINISHED else f"{state.ending.value}: {state.reason}"
        samples = cut(window, first, first + plan.maneuver.duration_s)
        verdict = judge(plan, limits, flown.peaks, samples, rate_hz, interruption)
    return RunResult(
        run,
        plan,
        state.ending,
        state.reason,
        state.mode_after,
        started,
        flown.elapsed_s,
        flown.log_start_s,
        flown.peaks,
        verdict,
    )


# ------------------------------------------------------------------------------------------------ a whole card


@dataclass(frozen=True, slots=True)
class Briefing:
    """What is about to happen, for whoever confirms it."""

    card: TestCard
    plans: tuple[tuple[CardRun, Plan], ...]
    checks: tuple[Check, ...]
    link_loss: LinkLoss
    profile: VehicleProfile


@dataclass(frozen=True, slots=True)
class SweepResult:
    """A card that was flown, as far as it went."""

    card: TestCard
    profile: VehicleProfile
    runs: tuple[RunResult, ...]
    planned: int
    folder: FlightFolder
    recording: RecordingSummary | None
    stopped: str
    """Why the card was not flown to its end; empty where it was."""
    ending: Ending | None = None
    """Of the run that stopped the card."""
    link_loss: LinkLoss | None = None
    """What the vehicle does when it no longer hears this station."""

    @property
    def complete(self) -> bool:
        return not self.stopped and len(self.runs) == self.planned

    @property
    def missing_blocks(self) -> int:
        return 0 if self.recording is None else self.recording.missing_blocks

    @property
    def missing_words(self) -> str:
        """`0 samples missing`, or what is: blocks of the log, or samples that were to be flown and did not come."""
        verdicts = [run.verdict for run in self.runs if run.verdict is not None]
        samples, planned = sum(v.missing for v in verdicts), sum(v.expected for v in verdicts)
        parts = [f"{self.missing_blocks} blocks of the log missing"] if self.missing_blocks else []
        if any(not v.keep and v.missing for v in verdicts):
            parts.append(f"{samples:,} of {planned:,} planned samples not flown or not received")
        if not parts and samples:
            parts.append("0 blocks of the log missing")  # a sample more or less at the ends of a run
        return ", ".join(parts) or "0 samples missing"


class NotReadyError(TippathError):
    """A check before the start failed; the message lists what and why."""


def require_flyable(session: Connection, card: TestCard) -> VehicleProfile:
    """Before a folder is made: whether this vehicle, as it is now, can fly the card at all, and what it is.

    Raises CannotFlyError, NotReadyError or LinkError; `fly_card` looks again.
    """
    profile = recognise(session)
    for run in card.runs():
        profile.plan(run.maneuver)
    _require((*preflight.flying(session.snapshot(), profile), *_controller(session, card)))
    return profile


def _controller(session: Connection, card: TestCard) -> tuple[Check, ...]:
    """Which controller follows the rates that a card commands; nothing where it commands none."""
    if all(maneuver.target != "rate" for maneuver in card.maneuvers):
        return ()
    return preflight.controller(read_parameters(session, ["LQR_SW"]).get("LQR_SW"))


def read_parameters(session: Connection, names: Sequence[str]) -> dict[str, float]:
    """Those of `names` that the vehicle has. Raises LinkError where the link is lost meanwhile."""
    found: dict[str, float] = {}
    for name in names:
        if session.snapshot().lost:
            raise LinkError("the link was lost while the parameters were read; nothing was flown")
        with contextlib.suppress(ProcedureError):
            found[name] = session.call(ReadParameter(name, tries=3)).value
    return found


def recognise(session: Connection) -> VehicleProfile:
    """What kind of vehicle this is. Raises CannotFlyError, LinkError.

    A vehicle does not say that it lacks a parameter, it is silent; so is a link that lost the answer. Taking the one
    for the other would fly ArduPilot's law where Table 1 was asked for, so a silence counts only where another
    parameter, asked right after it, is answered, several times in a row.
    """
    found: dict[str, float] = {}
    absent: set[str] = set()
    for names in wanted_parameters():
        for name in names:
            if name not in found and not absent.intersection(names):
                value = _look_for(session, name, witness=next(iter(found), None))
                if value is None:
                    absent.add(name)
                else:
                    found[name] = value
    return choose_profile(found, session.snapshot().autopilot)


def _look_for(session: Connection, name: str, witness: str | None) -> float | None:
    for _ in range(SILENCES):
        with contextlib.suppress(NoAnswerError):
            try:
                return session.call(ReadParameter(name, tries=2)).value
            except RefusedError:
                return None  # newer firmware says so
        if witness is not None:
            session.call(ReadParameter(witness))
    return None


def read_settings(session: Connection, profile: VehicleProfile) -> dict[str, float]:
    """The vehicle's present values of all that a maneuver writes, and of what decides about a lost link.

    Raises ProcedureError where a maneuver's parameter is not answered: what is not known cannot be put back.
    """
    parameters = {name: session.call(ReadParameter(name)).value for name in profile.settings}
    # ArduPilot renamed the last: only one of the two is there.
    parameters |= read_parameters(session, ["FS_GCS_ENABLE", "FS_OPTIONS", "FS_GCS_TIMEOUT", "SCHED_LOOP_RATE"])
    return parameters | (read_parameters(session, ["SYSID_MYGCS"]) or read_parameters(session, ["MAV_GCS_SYSID"]))


def write_plan(session: Connection, plan: Plan, profile: VehicleProfile) -> None:
    """Write a maneuver's parameters, each until the vehicle echoes its very bits.

    Raises ProcedureError where one is refused, TippathError in the excitation mode, which reads them at once.
    """
    for name, value in plan.writes:
        if session.snapshot().mode == profile.excitation_mode:
            raise TippathError("the vehicle is in its excitation mode: no parameter is written now")
        session.call(WriteParameter(name, value))


def fly_card(
    session: Connection,
    card: TestCard,
    profile: VehicleProfile | None = None,
    limits: Limits | None = None,
    *,
    folder: FlightFolder,
    confirm: Callable[[Briefing], bool] = lambda briefing: True,
    on_progress: Callable[[Progress], None] = lambda progress: None,
    aborted: Callable[[], str | None] = lambda: None,
    interruptions: Callable[[], int] = lambda: 0,
    about: Mapping[str, Any] | None = None,
    clock: Clock | None = None,
    disk_free: Callable[[Path], int | None] | None = None,
) -> SweepResult:
    """Fly every run of a card, record all of it, and leave the vehicle as it was: mode and parameters.

    `aborted` gives a reason once somebody wants the end; `interruptions` as in `fly_run`. `about` goes into
    flight.json. Recording begins here and ends here. `profile` spares asking the vehicle what it is. Raises
    CannotFlyError, NotReadyError, LinkError and ProcedureError before anything was flown; what happens later is in the
    result. flight.json is written in every case where recording began.
    """
    clock = clock or WallClock()
    limits = limits or card.limits
    disk_free = disk_free or free_bytes
    profile = profile or recognise(session)
    planned = tuple((run, profile.plan(run.maneuver)) for run in card.runs())
    controller = _controller(session, card)
    _require((*preflight.flying(session.snapshot(), profile), *controller))
    parameters = read_settings(session, profile)
    loss = preflight.link_loss(parameters, session.station)
    flight = _Flight(session, card, profile, limits, planned, folder, loss, dict(about or {}), clock, on_progress)
    folder.write_card(card.text)
    with flight:
        checks = flight.look(disk_free, controller)
        _require(checks)
        if not confirm(Briefing(card, tuple(planned), checks, loss, profile)):
            raise NotReadyError("not confirmed: nothing was flown")
        _require(preflight.flying(session.snapshot(), profile))  # somebody may have thought for minutes
        flight.fly(parameters, aborted, interruptions)
    return flight.result()


def free_bytes(path: Path) -> int | None:
    """Bytes free on the disk of `path`, None where the system does not tell."""
    try:
        return shutil.disk_usage(path).free
    except OSError:
        return None


def _require(checks: Sequence[Check]) -> None:
    failed = [check for check in checks if not check.ok]
    if failed:
        raise NotReadyError("not ready: " + "; ".join(f"{check.name}: {check.words}" for check in failed))


@dataclass
class _Flight:
    """Recording, the runs so far, and flight.json: a context that ends the one and writes the other."""

    session: Connection
    card: TestCard
    profile: VehicleProfile
    limits: Limits
    planned: Sequence[tuple[CardRun, Plan]]
    folder: FlightFolder
    loss: LinkLoss
    about: dict[str, Any]
    clock: Clock
    on_progress: Callable[[Progress], None]
    runs: list[RunResult] = field(default_factory=list)
    checks: tuple[Check, ...] = ()
    recording: RecordingSummary | None = None
    stopped: str = ""
    ending: Ending | None = None
    started: str = ""
    unrestored: Mapping[str, float] | None = None
    """The vehicle's own settings, where they could not be put back because it was not heard."""

    def __enter__(self) -> Self:
        self.started = datetime.now(UTC).isoformat(timespec="milliseconds")
        self.session.start_recording(self.folder.path)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if error is not None and not self.stopped:
            self.stopped = str(error) or type(error).__name__
        try:
            self.recording = self.session.stop_recording()
        except TippathError as problem:
            self.stopped = self.stopped or str(problem)
        if self.unrestored is not None:  # the rest of the log took its time: the vehicle may be heard again
            with contextlib.suppress(TippathError):
                self._restore(self.unrestored)
        if self.unrestored is not None:
            self.on_progress(Note("the maneuver's parameters stay in the vehicle: it could not be told otherwise"))
        if error is None:
            self.write()
        else:
            with contextlib.suppress(TippathError):  # the first error is the one to tell
                self.write()

    def look(self, disk_free: Callable[[Path], int | None], before_it: Sequence[Check] = ()) -> tuple[Check, ...]:
        """Wait for the log to arrive and for some seconds of hover, and check both; with what was looked at before."""
        self.clock.sleep(4 * TICK_S)  # until the count of blocks is this recording's
        before = self.session.snapshot()
        deadline = self.clock.now() + LOG_WAIT_S
        while self.clock.now() < deadline:
            snapshot = self.session.snapshot()
            window = self.session.samples(HOVER_LOOK_S)
            if window.t.size and float(window.t[-1] - window.t[0]) > 0.9 * HOVER_LOOK_S:
                break
            self.clock.sleep(TICK_S)
        snapshot = self.session.snapshot()
        window = self.session.samples(HOVER_LOOK_S)
        plans = [plan for _, plan in self.planned]
        self.checks = (
            *preflight.flying(snapshot, self.profile),
            *before_it,
            *preflight.recording(before, snapshot, disk_free(self.folder.path), self.card.duration_s),
            *preflight.hover(snapshot, window, plans, self.limits),
        )
        return self.checks

    def fly(
        self,
        parameters: Mapping[str, float],
        aborted: Callable[[], str | None],
        interruptions: Callable[[], int] = lambda: 0,
    ) -> None:
        """Run after run, until one of them says stop; then the parameters as they were."""
        rate_hz = parameters.get("SCHED_LOOP_RATE")
        mode_before = self.session.snapshot().mode
        try:
            for run, plan in self.planned:
                self.stopped = self._unfit(mode_before, aborted) or self._locked(run)
                if self.stopped:
                    return
                try:
                    write_plan(self.session, plan, self.profile)
                except TippathError as error:
                    # Between two runs nothing is excited; what was flown stays.
                    self.stopped, self.ending = str(error), Ending.REFUSED
                    return
                self.on_progress(RunReady(run, plan))
                if aborted() is None:
                    self._audit(f"starting {run.label}: {run.maneuver.numbers}, {plan.words}")
                result = fly_run(
                    self.session,
                    run,
                    plan,
                    self.limits,
                    mode_before=mode_before,
                    clock=self.clock,
                    on_progress=self.on_progress,
                    aborted=aborted,
                    rate_hz=rate_hz,
                    interruptions=interruptions,
                )
                self.runs.append(result)
                self.write()
                said = "" if result.verdict is None else result.verdict.words
                self._audit(joined(f"{run.label} {result.ending.value}", result.reason or said))
                self.on_progress(result)
                if result.ending is not Ending.FINISHED:
                    self.ending = result.ending
                    self.stopped = joined(f"{run.label} {result.ending.value}", result.reason)
                    return
                self._rest(mode_before, aborted)
        finally:
            self._restore(parameters)

    def _audit(self, did: str) -> None:
        """A disk that does not take it is told by what else is written, and is no reason to stop in flight."""
        by = "app" if self.about.get("command") == "fly" else "command"
        with contextlib.suppress(TippathError):
            self.folder.audit(datetime.now(UTC), did, by=by)

    def _unfit(self, mode_before: int, aborted: Callable[[], str | None]) -> str:
        """Why no further run may start, empty where it may."""
        snapshot = self.session.snapshot()
        abort = aborted()
        if abort is not None:
            self.ending = Ending.ABORTED
            return abort
        if snapshot.lost:
            self.ending = Ending.LINK
            return "the link was lost"
        if snapshot.mode != mode_before or not snapshot.armed:
            self.ending = Ending.PILOT
            return "disarmed" if not snapshot.armed else f"the mode is {snapshot.mode_name}: the pilot has it"
        return ""

    def _locked(self, run: CardRun) -> str:
        """Why a build-up goes no further: the step before was not clean, or the next would leave the envelope."""
        if run.locked_by is None:
            return ""
        below = self.runs[run.locked_by - 1]
        if not below.clean:
            why = "; ".join(below.verdict.reasons) if below.verdict is not None else below.reason
            return f"{run.label} stays locked: {below.run.label} was not clean ({why})"
        expected = use(self.limits, below.peaks).largest * run.unlocks_at
        if expected > 100:
            return f"{run.label} stays locked: from {below.run.label} it would reach {expected:.0f} % of the limits"
        return ""

    def _rest(self, mode_before: int, aborted: Callable[[], str | None]) -> None:
        end = self.clock.now() + self.card.rest_s
        while self.clock.now() < end and not self._unfit(mode_before, aborted):
            self.clock.sleep(TICK_S)
        self.ending = None  # told again, and acted on, before the next run

    def _restore(self, parameters: Mapping[str, float]) -> None:
        """The vehicle's own settings again, the axis last: with it 0 no switch of the pilot's can start a sweep."""
        snapshot = self.session.snapshot()
        self.unrestored = parameters
        if snapshot.lost or snapshot.mode == self.profile.excitation_mode:
            return
        names = [name for name in self.profile.settings if name in parameters]
        for name in [*names[1:], *names[:1]]:
            try:
                self.session.call(WriteParameter(name, parameters[name]))
            except ProcedureError as error:
                self.on_progress(Note(f"{name} is not as it was before: {error}"))
                break
        self.unrestored = None

    def write(self) -> None:
        snapshot = self.session.snapshot()
        self.folder.write(
            {
                **self.about,
                "started": self.started,
                "written": datetime.now(UTC).isoformat(timespec="milliseconds"),
                "card": self.card.name,
                "vehicle": {
                    "system": snapshot.system,
                    "component": snapshot.component,
                    "type": snapshot.vehicle_type,
                    "autopilot": snapshot.autopilot,
                    "version": snapshot.version,
                    "profile": self.profile.name,
                },
                "station": self.session.station,
                "link_loss": self.loss.words,
                "limits": {
                    "rate_rad_s": self.limits.rate,
                    "attitude_deg": round(math.degrees(self.limits.attitude), 6),
                    "command": self.limits.command,
                },
                "checks": [{"name": c.name, "ok": c.ok, "words": c.words} for c in self.checks],
                "planned": len(self.planned),
                "runs": [run.to_json() for run in self.runs],
                "stopped": self.stopped,
                "recording": None if self.recording is None else _portable(self.recording, self.folder.path),
                "missing_blocks": snapshot.missing if self.recording is None else self.recording.missing_blocks,
            }
        )

    def result(self) -> SweepResult:
        return SweepResult(
            self.card,
            self.profile,
            tuple(self.runs),
            len(self.planned),
            self.folder,
            self.recording,
            self.stopped,
            self.ending,
            self.loss,
        )


def _portable(summary: RecordingSummary, folder: Path) -> dict[str, Any]:
    """The summary with paths relative to the folder, which may be moved."""

    def relative(path: str) -> str:
        try:
            return str(Path(path).relative_to(folder))
        except ValueError:
            return path

    about = summary.to_json()
    about["logs"] = [{**log, "path": relative(log["path"])} for log in about["logs"]]
    about["tlog"] = None if about["tlog"] is None else relative(about["tlog"])
    return about


__all__ = [
    "AbortResult",
    "Briefing",
    "Clock",
    "Connection",
    "Ending",
    "Excitation",
    "NotReadyError",
    "Note",
    "Phase",
    "Progress",
    "RunProgress",
    "RunReady",
    "RunResult",
    "SweepResult",
    "WallClock",
    "abort",
    "fly_card",
    "fly_run",
    "free_bytes",
    "read_parameters",
    "read_settings",
    "recognise",
    "require_flyable",
    "write_plan",
]
