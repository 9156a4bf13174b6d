"""One excitation, from its start to the vehicle being out of it: the context that sees, decides by the rules, and acts.

`Excitation` starts a run and cannot be left before the vehicle is out of the excitation mode, or its pilot has it, or
the link is given up; then it is watched until it is cleared. What it does follows from `gcs.flight.rules`. `abort` ends
an excitation that somebody else started.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from types import TracebackType
from typing import Self

from gcs.cards.envelope import Limits, Peaks, violations
from gcs.cards.maneuver import Maneuver
from gcs.flight.connection import Clock, Connection, WallClock
from gcs.flight.log_health import LogHealth
from gcs.flight.rules import (
    ASK_EVERY_S,
    FRESH_S,
    LOG_SILENCE_S,
    SETTLE_S,
    STALL_S,
    TICK_S,
    given_up,
    joined,
    step,
)
from gcs.flight.run_state import Answer, Ending, Order, Phase, RunState, Seen, Still
from gcs.flight.settings import SettingsInFlight, flown_otherwise
from gcs.link.clock import UNKNOWN
from gcs.link.encode import ParamWrite
from gcs.link.events import ParameterType, bits_of_float
from gcs.link.procedures import NoAnswerError, ProcedureError, RefusedError, SetMode
from gcs.vehicle.autopilots import STABILIZE, SYSTEMID
from gcs.vehicle.profile import Plan
from gcs.vehicle.snapshot import VehicleSnapshot

SAME_RECORD_S = 0.1
"""The vehicle's record of a maneuver and its first sample are no farther apart; else the record is another's."""


class Excitation:
    """One run as a context: inside it the vehicle may be excited, and however it is left the excitation ends first.

    `tick` is called until it says false: then the vehicle has left the excitation mode, or nobody knows. `watch` is
    called after it, until it says false: then the run is over, and `state.cleared` says whether the vehicle may be
    written to. Leaving the context earlier, by an exception or Ctrl-C, brings the vehicle back before the exception
    goes on; only the third Ctrl-C in a row leaves it as it is.
    """

    def __init__(
        self,
        session: Connection,
        plan: Plan,
        limits: Limits,
        clock: Clock,
        *,
        mode_before: int,
    ) -> None:
        """`clock` is the session's."""
        # Who stood still a moment ago may have heard nothing new yet; and what was written a moment ago has landed by
        # then, or is behind the start in the queue: a link swaps only what is closer (`gcs.link.clock.SWAP_S`).
        self.state = RunState(mode_before=mode_before, settled_at=clock.now() + SETTLE_S)
        self.peaks = Peaks()
        self.log_start_s: float | None = None
        self.log_start_within_s = 0.0
        """How far off that may be, where the log is not read and the link's clock told it."""
        self._first_asked_s: float | None = None
        self.frequency_hz: float | None = None
        self.elapsed_s = 0.0
        self.orders = 0
        """Times a mode was asked for on the way back or to start."""
        self.stills = 0
        """Times the maneuver's size was set to 0 unheard: it may be in the vehicle."""
        self.snapshot = session.snapshot()
        self._session = session
        self.plan = plan
        self.limits = limits
        self._clock = clock
        self._answer: Answer | None = None
        self._cursor, _ = session.texts_since(0)
        self._beats = self.snapshot.heartbeats
        self._shed = False
        self._log_before_s = UNKNOWN
        """The log's newest time when the run began: what is older belongs to an earlier run."""
        self._looked_at_log_s = UNKNOWN
        self._log_mode: int | None = None
        self._other_settings = ""
        said = self.snapshot.said
        self._settings = SettingsInFlight(plan, said[-1].number if said else 0)

    def __enter__(self) -> Self:
        window = self._session.samples(0.5)
        if window.log_s is not None:
            self._log_before_s = window.log_s
        if window.t.size:
            self._looked_at_log_s = float(window.t[-1])
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        why = "interrupted" if isinstance(error, KeyboardInterrupt) else f"{error}" if error is not None else "ended"
        interruptions, failures = 0, 0
        while self.out_of_hand:
            try:
                self.tick(why, look_at_log=False)
                self._clock.sleep(TICK_S)
                failures = 0
            except KeyboardInterrupt:
                interruptions += 1
                if interruptions >= 3:
                    raise
            except Exception:
                # The way back is tried again whatever went wrong with it; a closed link ends it.
                failures += 1
                if failures >= 20:
                    self.state = given_up(self.state, Ending.LINK, joined(self.state.reason, why))
                self._clock.sleep(TICK_S)

    @property
    def out_of_hand(self) -> bool:
        """The vehicle may be in the excitation mode, and something can still be done about it."""
        return self.state.phase not in (Phase.WATCHING, Phase.ENDED)

    def resume(self) -> None:
        """The vehicle was given up, and is heard again: the way back goes on, by the same rules (5 and 6)."""
        self.state = replace(self.state, phase=Phase.RETURNING, returning_since=self._clock.now())

    def watch(self, *, given_up: bool = False) -> bool:
        """As `tick`, after the vehicle has left the mode; false once nothing of ours can bring it back any more."""
        self.tick("the run is over", given_up=given_up)
        return self.state.phase is not Phase.ENDED

    def tick(
        self, abort: str | None = None, *, look_at_log: bool = True, given_up: bool = False, blind: bool = False
    ) -> bool:
        """Look, decide, and send what was decided. False once the vehicle has left the excitation mode."""
        snapshot = self.snapshot = self._session.snapshot()
        self._cursor, texts = self._session.texts_since(self._cursor)
        now = self._clock.now()
        sweep_s = self._look(snapshot) if look_at_log else None
        log = self._session.log_health()
        self._look_at_settings(snapshot, now, log)
        seen = Seen(
            now=now,
            mode=snapshot.mode,
            mode_name=snapshot.mode_name,
            heartbeats=snapshot.heartbeats,
            beats=tuple(beat for beat in snapshot.beats if beat.number > self._beats),
            armed=snapshot.armed,
            lost=snapshot.lost,
            link_age_s=snapshot.link_age_s,
            lag_s=snapshot.lag_s,
            answer_age_s=snapshot.answer_age_s,
            log_age_s=None if log is None else log.silent_s,
            log_on_card=log is not None and log.on_card,
            log_taken=log is not None and log.another,
            log_stopped="" if log is None else log.reported,
            log_mode=None if log is None or (log.silent_s or 0.0) > LOG_SILENCE_S else self._log_mode,
            texts=tuple(text.text for text in texts),
            answer=self._answer,
            sweep_s=sweep_s,
            violations=violations(self.limits, self.peaks),
            other_settings=self.other_settings,
            abort=abort,
            given_up=given_up,
            blind=blind,
        )
        self._answer, self._beats = None, snapshot.heartbeats
        if self.state.flying_since is not None and self.state.phase is Phase.FLYING:
            self.elapsed_s = seen.now - self.state.flying_since
            if log is not None and log.on_card and self.log_start_s is None:
                self._enter_by_clock(now, log.clock_s)
        self.state, order = step(self.state, seen, self.plan)
        if self.state.ending is Ending.LATE and not self._shed:
            self._shed = True
            self._session.shed_log()  # what is left of the link is for the way back
        if order is not None:
            self._send(order)
        return self.out_of_hand

    @property
    def other_settings(self) -> str:
        """How what the vehicle flies differs from what was planned; empty where it does not, or is not known."""
        return self._other_settings or self._settings.otherwise

    @property
    def unanswered_settings(self) -> tuple[str, ...]:
        """Those that the vehicle did not tell of since the start; all where its own record of the maneuver tells."""
        return self._settings.unanswered

    def _look_at_settings(self, snapshot: VehicleSnapshot, now: float, log: LogHealth | None) -> None:
        flying = self.state.phase in (Phase.STARTING, Phase.FLYING)
        self._settings.hear(snapshot.said, flying=flying)
        flown = self.state.flying_since is not None and self.state.phase is not Phase.ENDED
        if flown and log is not None and log.on_card:
            self._session.send(*self._settings.ask(now))

    def _enter_by_clock(self, now: float, vehicle_s: float | None) -> None:
        """It entered the mode after the first start was sent, and before it was heard to: half way, give or take."""
        if vehicle_s is not None and self._first_asked_s is not None:
            self.log_start_within_s = 0.5 * (now - self._first_asked_s)
            self.log_start_s = vehicle_s - self.log_start_within_s

    def _send(self, order: Order | Still) -> None:
        if isinstance(order, Order):
            self.orders += 1
            self._answer = self._ask(order)
        elif self.plan.size is not None:
            self.stills += 1
            self._session.send(ParamWrite(self.plan.size, bits_of_float(0.0), ParameterType.REAL32))

    def _ask(self, order: Order) -> Answer:
        # One send each: repeating is the step's business, which looks at the mode in between.
        if order.mode == self.plan.mode and self._first_asked_s is None:
            self._first_asked_s = self._clock.now()
        patience_s = None if order.mode == self.plan.mode else ASK_EVERY_S
        try:
            self._session.call(SetMode(order.mode, tries=1), patience_s)
        except RefusedError as error:
            return Answer(False, str(error))
        except NoAnswerError:
            return Answer(None)
        except ProcedureError as error:
            return Answer(None, str(error))
        return Answer(True)

    def _look(self, snapshot: VehicleSnapshot) -> float | None:
        """Update the peaks from what is new; the vehicle's time in this maneuver, where its log tells."""
        if self.state.phase is Phase.FLYING:
            r = snapshot.r if self.plan.maneuver.axis == "yaw" else None
            self.peaks = self.peaks.with_telemetry(snapshot.p, snapshot.q, snapshot.roll, snapshot.pitch, r)
        window = self._session.samples(1.0)
        self._log_mode = window.mode
        if not window.t.size:
            return None
        newest = float(window.t[-1])
        if newest < self._looked_at_log_s - 1.0:
            self._looked_at_log_s = self._log_before_s = newest  # the vehicle's clock began anew
        new = window.t > self._looked_at_log_s
        if self.state.phase is Phase.FLYING and new.any():
            self.peaks = self.peaks.with_samples(window.p[new], window.q[new], window.delta_x[new], window.delta_y[new])
        self._looked_at_log_s = newest
        if window.sweep_s is None or window.sweep_entered_s is None or window.sweep_entered_s <= self._log_before_s:
            return None  # of no maneuver, or of an earlier one
        settings = window.sweep_settings
        if settings is not None and abs(settings.at_s - window.sweep_entered_s) < SAME_RECORD_S:
            self._other_settings = flown_otherwise(self.plan, settings)
        if self.state.phase is Phase.FLYING:
            self.log_start_s = newest - window.sweep_s
            self.frequency_hz = window.sweep_hz
        return window.sweep_s


# ------------------------------------------------------------------------------------------------ ending one


@dataclass(frozen=True, slots=True, kw_only=True)
class AbortResult:
    """What an abort from outside came to."""

    was_excited: bool
    """Whether the vehicle was in an excitation mode at all; where not, nothing was sent."""
    ended: bool
    mode_before: str
    mode_after: str
    asked: int
    """Times the mode was sent."""
    reason: str


def abort(
    session: Connection,
    mode: int = STABILIZE,
    *,
    excitation_mode: int = SYSTEMID,
    clock: Clock | None = None,
) -> AbortResult:
    """End an excitation that somebody else started: ask for `mode` until the vehicle shows that it has left its own.

    Which mode there was before, a newcomer cannot know; sweeps start from one with manual throttle. In any other mode
    nothing is sent. Ctrl-C leaves it as it is.
    """
    clock = clock or WallClock()
    first = session.snapshot()
    if first.mode != excitation_mode:
        return AbortResult(
            was_excited=False,
            ended=True,
            mode_before=first.mode_name,
            mode_after=first.mode_name,
            asked=0,
            reason="",
        )
    last = first.beats[-1] if first.beats else None
    now = clock.now()
    # A link found again may carry anything before the heartbeat that tells what became of the vehicle meanwhile.
    new = last is not None and now - last.at_s <= STALL_S and (last.late_s is None or last.late_s <= FRESH_S)
    returning = Excitation(session, _nothing(excitation_mode), Limits(), clock, mode_before=mode)
    returning.state = RunState(
        mode_before=mode,
        phase=Phase.RETURNING,
        excited=new,
        excited_number=first.heartbeats,
        confirmed=True,
        mode_shown=first.mode_name,
        settled_at=UNKNOWN if new else now + SETTLE_S,
        ending=Ending.ABORTED,
        returning_since=now,
        fresh_after=first.heartbeats - 1,
    )
    while returning.tick(look_at_log=False):
        clock.sleep(TICK_S)
    state = returning.state
    return AbortResult(
        was_excited=True,
        ended=state.phase is Phase.WATCHING,
        mode_before=first.mode_name,
        mode_after=state.mode_after,
        asked=returning.orders,
        reason=state.reason,
    )


def _nothing(excitation_mode: int) -> Plan:
    """What somebody else flies is not known."""
    silent = Maneuver(kind="quiet")
    return Plan(
        maneuver=silent,
        writes=(),
        asked={},
        words="",
        axis_number=0,
        mode=excitation_mode,
        lead_s=0.0,
        over_s=silent.duration_s,
        finished_s=silent.duration_s,
    )
