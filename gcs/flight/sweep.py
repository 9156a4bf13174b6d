"""Flying a card: what is looked at first, run after run, the recording, and the file that tells what was flown.

The vehicle is left as it was found: in the mode before the run (see `gcs.flight.rules`), and with its own values
in every parameter that a maneuver wrote (see `gcs.flight.handback`). Nothing is written while it may be excited,
because the vehicle reads some parameters in every loop: only after the last run is cleared, and a run is started only
after all that was written has landed and was read back. Recording goes on during the whole card, and `flight.json` is
replaced after each run; no run is started, and none goes on, on a dead log or dead telemetry (`gcs.flight.log_way`).
"""

from __future__ import annotations

import contextlib
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime
from pathlib import Path
from statistics import median
from types import TracebackType
from typing import Any, Self

from gcs.cards.envelope import Limits
from gcs.cards.maneuver import CardRun, TestCard, preceded
from gcs.errors import TippathError
from gcs.flight import log_way, preflight
from gcs.flight.connection import Clock, Connection, LogWay, WallClock
from gcs.flight.excitation import Excitation
from gcs.flight.flown_card import (
    Briefing,
    FlownBefore,
    SweepResult,
    limits_document,
    recording_document,
    vehicle_documents,
)
from gcs.flight.flyable import NotReadyError, controller, free_bytes, require, require_flyable
from gcs.flight.folder import FlightFolder
from gcs.flight.handback import Handback
from gcs.flight.order import IN_ORDER, Choosing, Order
from gcs.flight.preflight import Check
from gcs.flight.probe import (
    QUIET_S,
    ProbeResult,
    ProbeStep,
    Samples,
    finding_words,
    probe_card,
    result_document,
    result_words,
    too_large_words,
)
from gcs.flight.recorder import RecordingSummary
from gcs.flight.resume import Earlier, card_digest, flown_before, flown_into
from gcs.flight.rules import TICK_S, joined
from gcs.flight.run import Note, Probed, Progress, RunReady, RunResult, contradiction, fly_run, locked
from gcs.flight.run_state import Ending
from gcs.flight.settings import changed_since, read_settings, write_plan
from gcs.flight.verdict import cut
from gcs.link.procedures import ProcedureError
from gcs.vehicle.autopilots import LOOP_RATE, LinkLoss, link_loss, state_trouble
from gcs.vehicle.profile import Plan, VehicleProfile

LOG_WAIT_S = 8.0
HOVER_LOOK_S = 2.0
LOOK_AGAIN_S = 1.0
"""So long a check may fail for a moment, right before the card begins."""
ABORT_S = 0.15
"""From seeing that a run must end to the order on a link without lag, heartbeats not waited for."""
PROBE_AROUND_S = 1.0
"""Hover before and after a probe's step that is judged with it."""


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
    log: LogWay = "stream",
    left_out: Sequence[str] = (),
    earlier: Earlier | None = None,
    choosing: Choosing = IN_ORDER,
) -> SweepResult:
    """Fly every run of a card, record all of it, and leave the vehicle as it was: mode and parameters.

    `aborted` gives a reason once somebody wants the end; `interruptions` as in `fly_run`; `about` goes into
    flight.json. With `probe` a small step on each axis comes first, and the card only where the vehicle answers as it
    should; it needs a log that is streamed: with `log` "card" nothing of it is sent (`gcs.flight.log_way`). `left_out`
    is what of the card this vehicle cannot fly. With `earlier` a flight goes on, in its own folder: `card` is its, and
    only what is left is flown. `choosing` decides which run is next; `profile` spares asking the vehicle what it is.
    Raises CannotFlyError, NotReadyError, LinkError, ProcedureError before anything was flown; later is in the result.
    """
    clock, limits, disk_free = clock or WallClock(), limits or card.limits, disk_free or free_bytes
    profile = require_flyable(session, card, clock, profile=profile, stream=log == "stream")
    probes = probe_card(card, profile).runs() if probe and log == "stream" else ()
    planned = tuple((run, profile.plan(run.maneuver)) for run in preceded(card.runs(), probes))
    parameters = read_settings(session, clock, profile)
    before = flown_before(earlier, session.snapshot(), profile, parameters, planned, _now())
    require(kept := log_way.card_log(session, clock) if log == "card" else ())
    before_it = (*before.checks, *controller(session, clock, card), preflight.lean_stop(parameters), *kept)
    flight = _Flight(
        session=session,
        card=card,
        profile=profile,
        limits=limits,
        planned=tuple((run, plan) for run, plan in planned if run.number not in before.kept),
        folder=folder,
        loss=link_loss(parameters, session.station),
        about={**(about or {}), "left_out": [*before.left_out, *left_out]},
        clock=clock,
        on_progress=on_progress,
        log=log,
        before=before,
        choosing=choosing,
    )
    with flown_into(folder, card, earlier), flight:
        checks = flight.look(disk_free, before_it, parameters.get(LOOP_RATE))
        require(checks)
        if not confirm(flight.briefing(checks)):
            raise NotReadyError("not confirmed: nothing was flown")
        flight.look_again()  # somebody may have thought for minutes
        flight.fly(parameters, aborted, interruptions)
    return flight.result()


@dataclass(kw_only=True)
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
    log: LogWay
    before: FlownBefore
    choosing: Choosing = IN_ORDER
    runs: list[RunResult] = field(default_factory=list)
    checks: tuple[Check, ...] = ()
    seen: Callable[[], tuple[Check, ...]] = tuple
    """The checks as they stand at this moment, once they were made."""
    recording: RecordingSummary | None = None
    stopped: str = ""
    ending: Ending | None = None
    started: str = ""
    quiet: Samples | None = None
    """Hover before the first probe."""
    judge: Callable[[Samples, Sequence[ProbeStep], float | None], ProbeResult] | None = None
    steps: list[ProbeStep] = field(default_factory=list)
    probed: ProbeResult | None = None
    document: dict[str, Any] = field(default_factory=dict)
    """What flight.json says, if the disk took it the last time."""
    unwritten: str = ""
    """Why it did not."""
    ended: str | None = None

    def __post_init__(self) -> None:
        self.handback = Handback(session=self.session, profile=self.profile, clock=self.clock, tell=self._tell)
        self.order = Order(
            runs=[run for run, _ in self.planned],
            flown=self.runs,
            choosing=self.choosing,
            locked=lambda run: locked(run, self.runs, self.limits, self.before.kept),
            tell=self._tell,
        )

    def _tell(self, words: str) -> None:
        self.on_progress(Note(words))

    def briefing(self, checks: tuple[Check, ...]) -> Briefing:
        """For whoever confirms it, with what was looked at."""
        return Briefing(
            card=self.card,
            plans=tuple(self.planned),
            checks=checks,
            link_loss=self.loss,
            profile=self.profile,
            seen=self.seen,
        )

    def __enter__(self) -> Self:
        self.started = str(self.before.document.get("started") or _now())
        self.session.start_recording(self.folder.path, self.log)
        self.write()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if error is not None and not self.stopped:
            self.stopped = str(error) or type(error).__name__
        try:
            self.recording = self.session.stop_recording(meanwhile=self.handback.watch_on)
        except TippathError as problem:
            self.stopped = self.stopped or str(problem)
        self.handback.last_look()
        self._note_what_came_after()
        self.ended = _now()
        self.write()

    def _note_what_came_after(self) -> None:
        """A vehicle that was given up in its last run may have been heard again while the rest of the log arrived."""
        flown = self.handback.flown
        if flown is not None and self.runs and self.runs[-1].plan is flown.plan:
            reason = joined(flown.state.reason, contradiction(flown))
            self.runs[-1] = replace(self.runs[-1], mode_after=flown.state.mode_after, reason=reason)

    def look(
        self, disk_free: Callable[[Path], int | None], before_it: Sequence[Check] = (), loop_hz: float | None = None
    ) -> tuple[Check, ...]:
        """Wait for the log, or telemetry, to arrive and for some seconds of hover, and check both; with what was looked
        at before."""
        began = self.clock.now()
        self.clock.sleep(4 * TICK_S)  # until the count of blocks is this recording's
        before = self.session.snapshot()
        deadline = self.clock.now() + LOG_WAIT_S
        lags = []
        while self.clock.now() < deadline:
            lags.append(self.session.snapshot().lag_s)
            if log_way.hovered(self.session, self.log, HOVER_LOOK_S):
                break
            self.clock.sleep(TICK_S)
        plans = [plan for _, plan in self.planned]

        def seen(lag_s: float | None = None) -> tuple[Check, ...]:
            snapshot = self.session.snapshot()
            if lag_s is not None and snapshot.lag_s is not None:
                snapshot = replace(snapshot, lag_s=lag_s)
            window, over_s = self.session.samples(HOVER_LOOK_S), self.clock.now() - began
            look = log_way.Look(before, snapshot, self.session.log_health(), over_s)
            return (
                *preflight.lag(snapshot),
                *preflight.flying(snapshot, self.profile),
                *before_it,
                *log_way.arriving(self.log, look, disk_free(self.folder.path), self.card.duration_s, loop_hz),
                *preflight.hover(snapshot, window, plans, self.limits, telemetry=self.log == "card"),
            )

        known = [lag_s for lag_s in lags if lag_s is not None]
        self.seen, self.checks = seen, seen(median(known) if known else None)
        return self.checks

    def look_again(self) -> None:
        """The same checks as they stand now, and for a moment more. Raises NotReadyError."""
        end = self.clock.now() + LOOK_AGAIN_S
        while not all(check.ok for check in self.seen()) and self.clock.now() < end:
            self.clock.sleep(TICK_S)
        self.checks = self.seen()
        require(self.checks)

    def fly(
        self,
        parameters: Mapping[str, float],
        aborted: Callable[[], str | None],
        interruptions: Callable[[], int] = lambda: 0,
    ) -> None:
        """Run after run, until one of them says stop; then the parameters as they were."""
        mode_before = self.session.snapshot().mode
        self.handback.settings, self.handback.own = dict(parameters), self.before.own
        try:
            while self.order.place is not None:
                run, plan = self.planned[self.order.place]
                self.stopped = (
                    self._unfit(mode_before, aborted) or self._log_dead() or self.order.locked(run) or self._capped(run)
                )
                if self.stopped:
                    return
                if run.probe and self.quiet is None:
                    self._look_at_hover()
                result = self._fly_next(run, plan, mode_before, aborted, interruptions)
                if result is None:
                    if self.order.take_wish():
                        continue
                    return
                again = self.order.again(result)
                if result.ending is not Ending.FINISHED and not again:
                    self.ending = result.ending
                    self.stopped = result.why_early
                    return
                if not self.handback.clear(interruptions):
                    self.stopped = joined(f"after {run.label} nothing more is written", self.handback.uncleared)
                    return
                if not again:
                    self.order.move_on()
                if run.probe or self.order.place is not None:
                    self._rest(mode_before, aborted)
                self.stopped = self._probed(run, result) if run.probe else ""
                if self.stopped:
                    return
        finally:
            self.handback.restore(interruptions)

    def _fly_next(
        self,
        run: CardRun,
        plan: Plan,
        mode_before: int,
        aborted: Callable[[], str | None],
        interruptions: Callable[[], int],
    ) -> RunResult | None:
        """Write, wait until somebody starts it, read back, fly; None where it was not started, and where nothing
        forbade that another is wished for."""
        try:
            write_plan(self.session, plan, self.profile, self.handback.settings)
        except TippathError as error:
            # Between two runs nothing is excited; what was flown stays.
            self.stopped, self.ending = str(error), Ending.REFUSED
            return None
        self.on_progress(RunReady(run, plan))
        if aborted() is None and self.order.wished():
            return None
        if aborted() is None:  # minutes may have passed
            trouble = state_trouble(self.session.snapshot().status)
            if trouble:
                self.ending = Ending.REFUSED
            self.stopped = trouble or self._changed(plan) or self._log_dead()
            if self.stopped:
                return None
            self._audit(f"starting {run.label}: {run.maneuver.numbers}, {plan.words}")
        flown = self.handback.flown = Excitation(self.session, plan, self.limits, self.clock, mode_before=mode_before)
        result = fly_run(
            self.session,
            run,
            flown,
            clock=self.clock,
            on_progress=self.on_progress,
            aborted=aborted,
            rate_hz=self.handback.settings.get(LOOP_RATE),
            interruptions=interruptions,
            blind=self.order.choosing.blind,
        )
        self.runs.append(result)
        self.write()
        words = "" if result.verdict is None else result.verdict.words
        self._audit(joined(f"{run.label} {result.ending.value}", result.reason or words))
        self.on_progress(result)
        return result

    def _look_at_hover(self) -> None:
        """The quiet seconds that a probe's answers are measured against; what judges them is loaded meanwhile."""
        from gcs.flight.probe.judge import judge_probe  # not above: a second at the start of what flies no probe

        self.judge = judge_probe
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
        if any(later.probe and later.number > run.number for later, _ in self.planned):
            return ""
        assert self.quiet is not None
        assert self.judge is not None
        self.probed = self.judge(self.quiet, self.steps, self.handback.settings.get(LOOP_RATE))
        self.write()
        self._audit(f"probe: {'; '.join(result_words(self.probed))}")
        self.on_progress(Probed(self.probed))
        if not self.probed.wrong:
            return ""
        self.ending = Ending.PROBE
        serious = "; ".join(finding_words(finding) for finding in self.probed.findings if finding.serious)
        return f"the probe says: {serious}; nothing more was flown"

    def _capped(self, run: CardRun) -> str:
        """Why a run's amplitude is too large for what the probe saw, empty where it is not, or not known."""
        abort_s = ABORT_S + 2 * (self.session.snapshot().lag_s or 0.0)
        too_large = too_large_words(self.probed, self.limits, abort_s, run.maneuver)
        if not too_large:
            return ""
        self.ending = Ending.LIMIT
        return f"{run.label}: {too_large}"

    def _changed(self, plan: Plan) -> str:
        """What flies is what was shown: why not, empty where the vehicle holds it bit for bit."""
        try:
            changed = changed_since(self.session, plan)
        except ProcedureError as error:
            changed = str(error)
        self.ending = Ending.SETTINGS if changed else None
        return changed

    def _log_dead(self) -> str:
        """Why no run may start as far as the log goes: a new block, or attitude, must come now."""
        silent = log_way.silent(self.session, self.clock, self.log)
        if silent:
            self.ending = Ending.LOG if self.log == "stream" else Ending.TELEMETRY
            return silent
        failed = log_way.not_written(self.session, self.log)
        if failed:
            self.ending = Ending.LOG
            return f"the vehicle does not write its log: it says {failed!r}; nothing was started"
        return ""

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
            return joined("the link was lost", snapshot.newcomer_words)
        if snapshot.mode != mode_before or not snapshot.armed:
            self.ending = Ending.PILOT
            return "disarmed" if not snapshot.armed else f"the mode is {snapshot.mode_name}: the pilot has it"
        return ""

    def _rest(self, mode_before: int, aborted: Callable[[], str | None]) -> None:
        end = self.clock.now() + self.card.rest_s
        while self.clock.now() < end and not self._unfit(mode_before, aborted):
            self.clock.sleep(TICK_S)
        self.ending = None  # told again, and acted on, before the next run

    def write(self) -> None:
        """flight.json, as far as the flight has come. A disk that does not take it ends no flight and swallows no
        verdict: it is tried again after the next run, and told at the end."""
        before = self.before
        missing = self.session.snapshot().missing if self.recording is None else self.recording.missing_blocks
        self.document = {
            **before.document,
            **self.about,
            "started": self.started,
            "written": _now(),
            "ended": self.ended,
            "card": self.card.name,
            "card_sha256": card_digest(self.card),
            **vehicle_documents(self.session, self.profile, datetime.now(UTC)),
            "settings": {name: value for name, value in before.own.items() if math.isfinite(value)},
            "link_loss": self.loss.words,
            "limits": limits_document(self.limits),
            "log": self.log,
            "checks": [{"name": c.name, "ok": c.ok, "words": c.words} for c in self.checks],
            "planned": len(before.kept) + len(self.planned),
            "runs": [*before.runs, *(run.to_json() for run in self.runs)],
            "probe": None if self.probed is None else result_document(self.probed),
            "stopped": self.stopped,
            "recording": recording_document(self.recording, self.folder.path, before),
            "missing_blocks": before.missing_blocks + missing,
        }
        try:
            self.folder.write(self.document)
            self.unwritten = ""
        except TippathError as problem:
            self.unwritten = str(problem)

    def result(self) -> SweepResult:
        return SweepResult(
            card=self.card,
            profile=self.profile,
            runs=tuple(self.runs),
            planned=len(self.before.kept) + len(self.planned),
            folder=self.folder,
            recording=self.recording,
            stopped=self.stopped,
            ending=self.ending,
            link_loss=self.loss,
            log=self.log,
            document=self.document,
            unwritten=self.unwritten,
            before=self.before,
        )


def _now() -> str:
    return datetime.now(UTC).isoformat(timespec="milliseconds")
