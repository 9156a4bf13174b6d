"""Flying a card: what is looked at first, run after run, the recording, and the file that tells what was flown.

The vehicle is left as it was found: in the mode before the run (see `gcs.flight.excitation`), and with its own values
in every parameter that a maneuver wrote (see `gcs.flight.settings`). Nothing is written while it may be excited,
because the vehicle reads some parameters in every loop: only after the last run is cleared, and a run is started only
after all that was written has landed and was read back. Recording goes on during the whole card, and `flight.json` is
replaced after each run; a run is not started, and does not go on, without fresh blocks of the log.
"""

from __future__ import annotations

import contextlib
import itertools
import math
import shutil
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime
from pathlib import Path
from statistics import median
from types import TracebackType
from typing import Any, Self

from gcs.cards.envelope import Limits, Peaks, Use, use
from gcs.cards.maneuver import CardRun, TestCard, preceded
from gcs.errors import TippathError
from gcs.flight import preflight
from gcs.flight.excitation import (
    LOG_SILENCE_S,
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
from gcs.flight.folder import FlightFolder
from gcs.flight.preflight import Check, LinkLoss
from gcs.flight.probe import QUIET_S, ProbeResult, ProbeStep, Samples, judge_probe, largest_amplitude, probe_card
from gcs.flight.recorder import RecordingSummary
from gcs.flight.settings import ask_all, changed_since, give_back, read_settings, recognise, write_plan
from gcs.flight.verdict import Verdict, cut, judge
from gcs.link.clock import UNKNOWN
from gcs.link.procedures import ProcedureError
from gcs.vehicle.profile import Plan, VehicleProfile
from gcs.vehicle.snapshot import VehicleSnapshot

LOG_WAIT_S = 8.0
HOVER_LOOK_S = 2.0
LAG_WAIT_S = 4.0
"""How long a vehicle's first answer, which tells how late the link is, is waited for."""
ABORT_S = 0.15
"""From seeing that a run must end to the order on a link without lag, heartbeats not waited for."""
PROBE_AROUND_S = 1.0
"""Hover before and after a probe's step that is judged with it."""
TELL_AFTER_S = 2.0
"""A run that takes longer to clear is told of."""


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
    ending: Ending | None = None
    """Why it is being ended, once it is."""
    reason: str = ""


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
            "probe": self.run.probe,
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
class Probed:
    """The probe was flown; where it is `wrong`, the card is not."""

    result: ProbeResult


@dataclass(frozen=True, slots=True)
class Note:
    """Something to tell the user."""

    words: str


Progress = Note | Probed | RunReady | RunProgress | RunResult


def fly_run(
    session: Connection,
    run: CardRun,
    flown: Excitation,
    *,
    clock: Clock,
    on_progress: Callable[[Progress], None],
    aborted: Callable[[], str | None],
    rate_hz: float | None,
    interruptions: Callable[[], int] = lambda: 0,
) -> RunResult:
    """Fly one run whose parameters are in the vehicle, from the mode that the pilot left it in.

    `interruptions` counts how often somebody pressed Ctrl-C: once more while the link is lost, and it is not waited for
    any longer. Afterwards `flown` is to be watched until it is cleared, before anything is written. Raises what
    `on_progress` raises, after the excitation ended.
    """
    started = datetime.now(UTC).isoformat(timespec="milliseconds")
    contradicted = False
    with flown:
        pressed_before: int | None = None  # the link was lost
        while flown.tick(aborted(), given_up=pressed_before is not None and interruptions() > pressed_before):
            if not flown.snapshot.lost:
                pressed_before = None
            elif pressed_before is None:
                pressed_before = interruptions()
            if flown.state.contradictions and not contradicted:
                contradicted = True
                on_progress(Note(contradiction(flown)))
            on_progress(_progress(run, flown))
            clock.sleep(TICK_S)
    state = flown.state
    assert state.ending is not None
    verdict = None if state.flying_since is None else _verdict(session, flown, rate_hz)
    return RunResult(
        run,
        flown.plan,
        state.ending,
        joined(state.reason, contradiction(flown)),
        state.mode_after,
        started,
        flown.elapsed_s,
        flown.log_start_s,
        flown.peaks,
        verdict,
    )


def _progress(run: CardRun, flown: Excitation) -> RunProgress:
    return RunProgress(
        run,
        flown.plan,
        flown.state.phase,
        flown.elapsed_s - flown.plan.lead_s,
        flown.frequency_hz,
        flown.peaks,
        use(flown.limits, flown.peaks, flown.snapshot.link_age_s),
        flown.snapshot,
        flown.state.ending,
        flown.state.reason,
    )


def _verdict(session: Connection, flown: Excitation, rate_hz: float | None) -> Verdict:
    state, plan, start = flown.state, flown.plan, flown.log_start_s
    window = session.samples(flown.elapsed_s + 5.0)
    first = math.inf if start is None else start + plan.lead_s
    finished = state.ending is None or state.ending is Ending.FINISHED
    interruption = None if finished or state.ending is None else f"{state.ending.value}: {state.reason}"
    samples = cut(window, first, first + plan.maneuver.duration_s)
    return judge(plan, flown.limits, flown.peaks, samples, rate_hz, interruption, start_s=first)


def contradiction(flown: Excitation) -> str:
    """What heartbeats that contradict each other may mean; empty where they do not."""
    count = flown.state.contradictions
    if not count:
        return ""
    return f"heartbeats contradicted each other {count} time(s): two vehicles with id {flown.snapshot.system}?"


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
        """Every run was flown to its end, and all of it is on disk, as far as the log's own stamps show."""
        recorded = self.recording is not None and self.recording.complete
        return not self.stopped and len(self.runs) == self.planned and recorded

    @property
    def missing_blocks(self) -> int:
        return 0 if self.recording is None else self.recording.missing_blocks

    @property
    def missing_words(self) -> str:
        """`0 samples missing`, or what is: blocks of the log, samples that were to be flown and did not come, an end
        of the log that is not there."""
        verdicts = [run.verdict for run in self.runs if run.verdict is not None]
        samples, planned = sum(v.missing for v in verdicts), sum(v.expected for v in verdicts)
        parts = [f"{self.missing_blocks} blocks of the log missing"] if self.missing_blocks else []
        if any(not v.keep and v.missing for v in verdicts):
            parts.append(f"{samples:,} of {planned:,} planned samples not flown or not received")
        if not parts and (self.recording is None or not self.recording.complete):
            parts.append("that nothing is missing is not shown")
        if not parts and samples:
            parts.append("0 blocks of the log missing")  # a sample more or less at the ends of a run
        return ", ".join(parts) or "0 samples missing"


class NotReadyError(TippathError):
    """A check before the start failed; the message lists what and why."""


def require_flyable(session: Connection, card: TestCard, clock: Clock | None = None) -> VehicleProfile:
    """Before a folder is made: whether this vehicle, as it is now, can fly the card at all, and what it is.

    Raises CannotFlyError, NotReadyError, LinkError or ProcedureError; `fly_card` looks again.
    """
    clock = clock or WallClock()
    _wait_for_lag(session, clock)
    _require(preflight.lag(session.snapshot()))
    profile = recognise(session, clock)
    for run in card.runs():
        profile.plan(run.maneuver)
    _require((*preflight.flying(session.snapshot(), profile), *_controller(session, clock, card)))
    return profile


def _wait_for_lag(session: Connection, clock: Clock) -> None:
    """Until it is known how late the link is, or that the vehicle does not answer."""
    end = clock.now() + LAG_WAIT_S
    while session.snapshot().lag_s is None and clock.now() < end:
        clock.sleep(TICK_S)


def _controller(session: Connection, clock: Clock, card: TestCard) -> tuple[Check, ...]:
    """Which controller follows the rates that a card commands; nothing where it commands none."""
    if all(maneuver.target != "rate" for maneuver in card.maneuvers):
        return ()
    return preflight.controller(ask_all(session, clock, ["LQR_SW"]).get("LQR_SW"))


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
    probe: bool = False,
) -> SweepResult:
    """Fly every run of a card, record all of it, and leave the vehicle as it was: mode and parameters.

    `aborted` gives a reason once somebody wants the end; `interruptions` as in `fly_run`. `about` goes into
    flight.json. With `probe` a small step on each axis comes first, and the card only where the vehicle answers as it
    should. Recording begins here and ends here. `profile` spares asking the vehicle what it is. Raises
    CannotFlyError, NotReadyError, LinkError and ProcedureError before anything was flown; what happens later is in the
    result. flight.json is written in every case where recording began.
    """
    clock = clock or WallClock()
    limits = limits or card.limits
    disk_free = disk_free or free_bytes
    _wait_for_lag(session, clock)
    _require(preflight.lag(session.snapshot()))
    profile = profile or recognise(session, clock)
    probes = probe_card(card, profile).runs() if probe else ()
    planned = tuple((run, profile.plan(run.maneuver)) for run in preceded(card.runs(), probes))
    controller = _controller(session, clock, card)
    _require((*preflight.flying(session.snapshot(), profile), *controller))
    parameters = read_settings(session, clock, profile)
    controller = (*controller, preflight.lean_stop(parameters))
    loss = preflight.link_loss(parameters, session.station)
    flight = _Flight(session, card, profile, limits, planned, folder, loss, dict(about or {}), clock, on_progress)
    folder.write_card(card.text)
    with flight:
        checks = flight.look(disk_free, controller, parameters.get("SCHED_LOOP_RATE"))
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
    settings: dict[str, float] = field(default_factory=dict)
    """What is in the vehicle now, of what a maneuver writes."""
    written_at: float = UNKNOWN
    flown: Excitation | None = None
    """The last run, which is watched until it is cleared before anything is written."""
    unrestored: Mapping[str, float] | None = None
    """The vehicle's own settings, where they could not be put back."""
    quiet: Samples | None = None
    """Hover before the first probe."""
    steps: list[ProbeStep] = field(default_factory=list)
    probed: ProbeResult | None = None

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
            self.recording = self.session.stop_recording(meanwhile=self._watch_on)
        except TippathError as problem:
            self.stopped = self.stopped or str(problem)
        self._last_look()
        if error is None:
            self.write()
        else:
            with contextlib.suppress(TippathError):  # the first error is the one to tell
                self.write()

    def look(
        self, disk_free: Callable[[Path], int | None], before_it: Sequence[Check] = (), loop_hz: float | None = None
    ) -> tuple[Check, ...]:
        """Wait for the log to arrive and for some seconds of hover, and check both; with what was looked at before."""
        self.clock.sleep(4 * TICK_S)  # until the count of blocks is this recording's
        before = self.session.snapshot()
        deadline = self.clock.now() + LOG_WAIT_S
        lags = []
        while self.clock.now() < deadline:
            lags.append(self.session.snapshot().lag_s)
            window, health = self.session.samples(HOVER_LOOK_S), self.session.log_health()
            counted = None if health is None else health.capacity
            hovered = window.t.size and float(window.t[-1] - window.t[0]) > 0.9 * HOVER_LOOK_S
            if hovered and counted is not None and counted.enough:
                break
            self.clock.sleep(TICK_S)
        snapshot = self.session.snapshot()
        known = [lag_s for lag_s in lags if lag_s is not None]
        if known and snapshot.lag_s is not None:
            snapshot = replace(snapshot, lag_s=median(known))
        window = self.session.samples(HOVER_LOOK_S)
        plans = [plan for _, plan in self.planned]
        self.checks = (
            *preflight.lag(snapshot),
            *preflight.flying(snapshot, self.profile),
            *before_it,
            *preflight.recording(before, snapshot, disk_free(self.folder.path), self.card.duration_s),
            *preflight.carried(self.session.log_health(), loop_hz),
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
        mode_before = self.session.snapshot().mode
        self.settings = dict(parameters)
        try:
            for run, plan in self.planned:
                self.stopped = (
                    self._unfit(mode_before, aborted) or self._log_dead() or self._locked(run) or self._capped(run)
                )
                if self.stopped:
                    return
                if run.probe and self.quiet is None:
                    self._look_at_hover()
                result = self._fly_next(run, plan, mode_before, aborted, interruptions)
                if result is None:
                    return
                if result.ending is not Ending.FINISHED:
                    self.ending = result.ending
                    self.stopped = joined(f"{run.label} {result.ending.value}", result.reason)
                    return
                if not self._clear(interruptions):
                    self.stopped = joined(f"after {run.label} nothing more is written", self._uncleared)
                    return
                self._rest(mode_before, aborted)
                if run.probe:
                    self.stopped = self._probed(run, result)
                    if self.stopped:
                        return
        finally:
            self._restore(parameters, interruptions)

    def _fly_next(
        self,
        run: CardRun,
        plan: Plan,
        mode_before: int,
        aborted: Callable[[], str | None],
        interruptions: Callable[[], int],
    ) -> RunResult | None:
        """Write, wait until somebody starts it, read back, fly; None where it was not started."""
        try:
            self.written_at = self.clock.now()
            write_plan(self.session, plan, self.profile, self.settings)
            self.written_at = self.clock.now()
        except TippathError as error:
            # Between two runs nothing is excited; what was flown stays.
            self.stopped, self.ending = str(error), Ending.REFUSED
            return None
        self.on_progress(RunReady(run, plan))
        if aborted() is None:  # minutes may have passed
            self.stopped = self._changed(plan) or self._log_dead()
            if self.stopped:
                return None
            self._audit(f"starting {run.label}: {run.maneuver.numbers}, {plan.words}")
        self.flown = Excitation(self.session, plan, self.limits, self.clock, mode_before, self.written_at)
        result = fly_run(
            self.session,
            run,
            self.flown,
            clock=self.clock,
            on_progress=self.on_progress,
            aborted=aborted,
            rate_hz=self.settings.get("SCHED_LOOP_RATE"),
            interruptions=interruptions,
        )
        self.runs.append(result)
        self.write()
        words = "" if result.verdict is None else result.verdict.words
        self._audit(joined(f"{run.label} {result.ending.value}", result.reason or words))
        self.on_progress(result)
        return result

    def _look_at_hover(self) -> None:
        """The quiet seconds that a probe's answers are measured against."""
        end = self.clock.now() + 2 * QUIET_S
        while self.clock.now() < end:
            window = self.session.samples(QUIET_S)
            if window.t.size and float(window.t[-1] - window.t[0]) > 0.98 * QUIET_S:
                break
            self.clock.sleep(TICK_S)
        self.quiet = cut(window, -math.inf, math.inf)

    def _probed(self, run: CardRun, result: RunResult) -> str:
        """Note a probe's samples; after the last one, why the card must not be flown, empty where it may."""
        start = math.inf if result.log_start_s is None else result.log_start_s + result.plan.lead_s
        around = run.maneuver.duration_s + 2 * PROBE_AROUND_S
        window = self.session.samples(around + self.card.rest_s + 10.0)
        samples = cut(window, start - PROBE_AROUND_S, start + around - PROBE_AROUND_S)
        self.steps.append(ProbeStep(run.maneuver, samples, start if math.isfinite(start) else None))
        if any(later.probe and later.number > run.number for later, _ in self.planned) or self.quiet is None:
            return ""
        self.probed = judge_probe(self.quiet, self.steps, self.settings.get("SCHED_LOOP_RATE"))
        self.write()
        self._audit(f"probe: {'; '.join(self.probed.words)}")
        self.on_progress(Probed(self.probed))
        if not self.probed.wrong:
            return ""
        self.ending = Ending.PROBE
        serious = "; ".join(finding.words for finding in self.probed.findings if finding.serious)
        return f"the probe says: {serious}; nothing more was flown"

    def _capped(self, run: CardRun) -> str:
        """Why a run's amplitude is too large for what the probe saw, empty where it is not, or not known."""
        if self.probed is None or run.maneuver.kind == "quiet" or run.maneuver.target != "command":
            return ""
        abort_s = ABORT_S + 2 * (self.session.snapshot().lag_s or 0.0)
        largest = largest_amplitude(self.probed, self.limits, abort_s, run.maneuver)
        if largest is None or run.maneuver.amplitude <= largest:
            return ""
        self.ending = Ending.LIMIT
        return (
            f"{run.label}: amplitude {run.maneuver.amplitude:g} is predicted, from the probe, to leave "
            f"{math.degrees(self.limits.attitude):.0f}° or {self.limits.rate:g} rad/s before an abort acts "
            f"({abort_s:.1f} s); at most {largest:.2g} on this axis"
        )

    def _changed(self, plan: Plan) -> str:
        """What flies is what was shown: why not, empty where the vehicle holds it bit for bit."""
        try:
            changed = changed_since(self.session, plan)
        except ProcedureError as error:
            changed = str(error)
        self.ending = Ending.SETTINGS if changed else None
        return changed

    def _log_dead(self) -> str:
        """Why no run may start as far as the log goes: a new block must come now. Empty where one does."""
        before, end = self.session.snapshot().blocks_received, self.clock.now() + LOG_SILENCE_S
        while self.session.snapshot().blocks_received == before:
            if self.clock.now() >= end:
                self.ending = Ending.LOG
                return f"the vehicle's log no longer arrives (no new block in {LOG_SILENCE_S:g} s); nothing was started"
            self.clock.sleep(TICK_S)
        return ""

    def _clear(self, interruptions: Callable[[], int] = lambda: 0) -> bool:
        """Watch the last run until nothing of ours can excite the vehicle any more; false where that is not known.

        Ctrl-C ends the watch, but while the vehicle is being brought back only the third does.
        """
        flown, began, told, pressed, interrupted = self.flown, self.clock.now(), False, interruptions(), 0
        if flown is None:
            return True
        while True:
            try:
                if not flown.watch(given_up=interruptions() > pressed):
                    return flown.state.cleared
                if not told and self.clock.now() - began > TELL_AFTER_S:
                    told = True
                    self.on_progress(Note("watching the mode until no order of ours can be under way any more"))
                self.clock.sleep(TICK_S)
            except KeyboardInterrupt:
                interrupted += 1
                if not flown.out_of_hand or interrupted >= 3:
                    raise

    @property
    def _uncleared(self) -> str:
        return "" if self.flown is None else self.flown.state.reason or "whether the vehicle is excited is not known"

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

    def _restore(self, parameters: Mapping[str, float], interruptions: Callable[[], int] = lambda: 0) -> None:
        """The vehicle's own settings again, once it is certainly not excited."""
        self.unrestored = parameters
        cleared = self._clear(interruptions)
        snapshot = self.session.snapshot()
        if cleared and not snapshot.lost and snapshot.mode != self.profile.excitation_mode:
            self._give_back(parameters)

    def _give_back(self, parameters: Mapping[str, float]) -> None:
        for words in give_back(self.session, self.profile, self.settings, parameters):
            self.on_progress(Note(words))
        self.unrestored = None

    def _last_look(self) -> None:
        """The rest of the log took its time: a vehicle that was not heard may be heard again, and still be excited."""
        with contextlib.suppress(TippathError):
            snapshot, flown = self.session.snapshot(), self.flown
            ours = flown is not None and flown.state.asks > 0 and not flown.state.cleared
            if not snapshot.lost and snapshot.mode == self.profile.excitation_mode:
                if ours and flown is not None and flown.state.ending is not Ending.STUCK:
                    self._bring_back(flown)
                else:
                    self.on_progress(Note(f"the mode is {snapshot.mode_name} again: `tippath abort` ends it"))
            if self.unrestored is not None and self._out(ours):
                self._give_back(self.unrestored)
        if self.unrestored is not None:
            self.on_progress(Note("the maneuver's parameters stay in the vehicle: it could not be told otherwise"))

    def _watch_on(self) -> None:
        """A watch that Ctrl-C cut short goes on while the rest of the log arrives."""
        if self.flown is not None and self.flown.state.phase in (Phase.WATCHING, Phase.RETURNING):
            with contextlib.suppress(TippathError):
                self.flown.watch()

    def _bring_back(self, flown: Excitation) -> None:
        """A vehicle that a start of ours still excites after its run was given up; in words what came of it."""
        try:
            ended = abort(self.session, flown.state.mode_before, excitation_mode=flown.plan.mode, clock=self.clock)
        except KeyboardInterrupt:
            self.on_progress(Note("it was still excited, and bringing it back was interrupted: the pilot must take it"))
            raise
        words = ended.reason or f"brought back to {ended.mode_after}"
        if flown.state.contradictions:
            words += ", as far as heartbeats of two vehicles with one id show: which of them is not known"
        self.on_progress(Note(f"it was still excited: {words}"))

    def _out(self, ours: bool) -> bool:
        """Whether the vehicle shows another mode, and where a start is `ours`, said so knowing of it, twice, and was
        never contradicted: its log, which would tell it from a stranger, has ended."""
        snapshot, flown = self.session.snapshot(), self.flown
        if snapshot.lost or snapshot.mode == self.profile.excitation_mode:
            return False
        if not ours or flown is None:
            return True
        excited = [b.mode == flown.plan.mode for b in snapshot.beats if b.at_s >= flown.state.asked_at]
        first = excited.index(True) if True in excited else len(excited)
        back_again = any(now and not before for before, now in itertools.pairwise(excited[first:]))
        if flown.state.contradictions or back_again:
            return False
        last = snapshot.beats[-2:]
        return len(last) == 2 and all(
            beat.mode != flown.plan.mode and beat.known_s >= flown.state.ordered_at for beat in last
        )

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
                "probe": None if self.probed is None else self.probed.to_json(),
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
    "Probed",
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
    "require_flyable",
]
