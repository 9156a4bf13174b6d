"""One excitation, from its start to the vehicle being out of it: a pure step that decides, and a context that acts.

The rules that `step` keeps, whatever happens around it:

- The excitation mode is asked for only from the mode the pilot left the vehicle in, and not again once it was seen.
- The way back is the mode before the run, sent again and again, but only while the vehicle's last word is that it is
  in the excitation mode. Any other mode means that the pilot, or a failsafe, has taken over: that ends the run, and
  no mode is commanded after it.
- After a lost link nothing starts again, and after a minute, or when somebody says so, it is no longer waited for.
  What the vehicle does then is decided by a heartbeat heard a second after the link came back: neither by one from
  before nor by one that waited in a buffer, also while this program was stopped.
- After an ordinary end the way back waits for a heartbeat later than the end: it costs a second, and does not talk
  over a pilot who used that second.

`Excitation` is the context that starts a run and cannot be left before the vehicle is out of the excitation mode, or
its pilot has it, or the link is given up.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from enum import Enum
from pathlib import Path
from types import TracebackType
from typing import Protocol, Self, TypeVar

from gcs.envelope import Limits, Peaks, violations
from gcs.link.procedures import NoAnswerError, Procedure, ProcedureError, RefusedError, SetMode
from gcs.logs.live import LiveWindow
from gcs.maneuver import Maneuver
from gcs.profile import FINISHED, PARAMETER_ERROR, STARTING, STOPPED, Plan
from gcs.recorder import RecordingSummary
from gcs.vehicle import STABILIZE, SYSTEMID, Text, VehicleSnapshot

T = TypeVar("T")

TICK_S = 0.05
ASK_EVERY_S = 0.3
"""Between two sends of the mode before the run."""
START_EVERY_S = 0.5
START_TRIES = 6
OTHER_HEARTBEATS = 2
"""So many heartbeats in another mode, after an accepted start that was never seen: one may have been under way."""
LATE_S = 2.0
"""So long after its time a run without the word "Finished" is taken for finished."""
STALL_S = 1.5
"""Between two ticks: longer, and this program was stopped, and what it hears now may be old."""
SETTLE_S = 1.0
"""After a silence of the link or of ourselves, until what is heard is new."""
LOST_PATIENCE_S = 60.0
STUCK_S = 30.0
"""The vehicle answers and stays in the excitation mode for so long: say so, loudly, and leave it to the pilot."""


class Connection(Protocol):
    """What the engine needs of a `gcs.session.Session`."""

    @property
    def station(self) -> int: ...
    def snapshot(self) -> VehicleSnapshot: ...
    def call(
        self,
        procedure: Procedure[T],
        timeout_s: float | None = None,
        *,
        cancelled: Callable[[], bool] | None = None,
    ) -> T: ...
    def texts_since(self, cursor: int) -> tuple[int, list[Text]]: ...
    def samples(self, last_s: float) -> LiveWindow: ...
    def start_recording(self, directory: Path) -> None: ...
    def stop_recording(self) -> RecordingSummary: ...


class Clock(Protocol):
    """Seconds that never go back, and a way to let them pass."""

    def now(self) -> float: ...
    def sleep(self, seconds: float) -> None: ...


class WallClock:
    """The machine's own."""

    def now(self) -> float:
        return time.monotonic()

    def sleep(self, seconds: float) -> None:
        time.sleep(seconds)


# ------------------------------------------------------------------------------------------------ the pure step


class Phase(Enum):
    """Where a run stands."""

    STARTING = "starting"
    FLYING = "flying"
    RETURNING = "returning"
    ENDED = "ended"


class Ending(Enum):
    """Why a run ended."""

    FINISHED = "finished"
    STOPPED = "stopped by the vehicle"
    REFUSED = "refused"
    PILOT = "taken over"
    LIMIT = "limit exceeded"
    LINK = "link lost"
    ABORTED = "aborted"
    STUCK = "stuck"


@dataclass(frozen=True, slots=True)
class Answer:
    """What became of the mode that was asked for."""

    accepted: bool | None
    """None: no answer."""
    reason: str = ""


@dataclass(frozen=True, slots=True)
class Seen:
    """All that the step is told, once a tick."""

    now: float
    mode: int
    mode_name: str
    heartbeats: int
    """Heard so far; the mode is the last one's."""
    armed: bool = True
    lost: bool = False
    texts: tuple[str, ...] = ()
    """New since the last tick."""
    answer: Answer | None = None
    """To the order of the last tick."""
    sweep_s: float | None = None
    """The vehicle's own time in the maneuver, from its log."""
    violations: tuple[str, ...] = ()
    abort: str | None = None
    """Why somebody wants the end."""
    given_up: bool = False
    """Somebody no longer wants to wait for a lost link."""


@dataclass(frozen=True, slots=True)
class Order:
    """A mode to ask for, once."""

    mode: int


@dataclass(frozen=True, slots=True)
class RunState:
    """One run, between two ticks."""

    mode_before: int
    """What the pilot flew before; the only mode that is ever commanded besides the excitation's."""
    phase: Phase = Phase.STARTING
    asks: int = 0
    """Times the excitation mode was asked for."""
    asked_at: float = -math.inf
    heartbeats_at_word: int = 0
    """Heartbeats heard when the vehicle accepted the start, or it was last asked for."""
    accepted: bool = False
    """The vehicle said that it starts."""
    confirmed: bool = False
    """A heartbeat showed the excitation mode."""
    flying_since: float | None = None
    ending: Ending | None = None
    reason: str = ""
    returning_since: float = 0.0
    fresh_after: int = 0
    """Returning: only a heartbeat after this many decides."""
    held: int = -1
    """Heartbeats heard when the way back was accepted; -1 while it was not."""
    returned_at: float = -math.inf
    """When the way back was last asked for."""
    mode_after: str = ""
    """What the heartbeat that ended the run showed."""
    failsafe: str = ""
    """What the vehicle said about one; its heartbeat follows up to a second later."""
    ticked_at: float = math.inf
    """The last step."""
    settled_at: float = -math.inf
    """Until then a heartbeat may be an old one, and decides nothing on the way back."""


def step(state: RunState, seen: Seen, plan: Plan) -> tuple[RunState, Order | None]:
    """What follows from what was seen; the order, if any, is to be sent once."""
    if seen.lost or seen.now - state.ticked_at > STALL_S:
        state = replace(state, settled_at=seen.now + SETTLE_S)
    state = replace(state, ticked_at=seen.now)
    match state.phase:
        case Phase.STARTING:
            return _starting(state, seen, plan)
        case Phase.FLYING:
            return _flying(state, seen, plan)
        case Phase.RETURNING:
            return _returning(state, seen, plan)
        case Phase.ENDED:
            return state, None


def _starting(state: RunState, seen: Seen, plan: Plan) -> tuple[RunState, Order | None]:
    answer = seen.answer
    if seen.mode == plan.mode and state.asks == 0:
        reason = f"the mode is {seen.mode_name} already: somebody else started it"
        return _ended(_end(state, seen, Ending.PILOT, reason), seen), None
    said = any(text.startswith(STARTING) for text in seen.texts)
    if seen.mode == plan.mode or said or (answer is not None and answer.accepted):
        state = replace(
            state,
            phase=Phase.FLYING,
            accepted=True,
            confirmed=seen.mode == plan.mode,
            flying_since=seen.now,
            heartbeats_at_word=seen.heartbeats,
        )
        return _flying(state, replace(seen, answer=None), plan)
    wanted = _wants_end(seen)
    if wanted is not None and state.asks == 0:
        return replace(state, phase=Phase.ENDED, ending=wanted[0], reason=wanted[1], mode_after=seen.mode_name), None
    if wanted is not None:
        return _returning(_end(state, seen, *wanted), seen, plan)
    if answer is not None and answer.accepted is False:
        return replace(
            state, phase=Phase.ENDED, ending=Ending.REFUSED, reason=answer.reason, mode_after=seen.mode_name
        ), None
    if seen.mode != state.mode_before:
        # Asked for already, it may still come about: only heartbeats will tell.
        ended = _end(state, seen, Ending.PILOT, f"the mode is {seen.mode_name}: the pilot has it")
        return (_returning(ended, seen, plan)) if state.asks else (_ended(ended, seen), None)
    if seen.now - state.asked_at < START_EVERY_S or seen.now < state.settled_at:
        return state, None
    if state.asks >= START_TRIES:
        reason = "the vehicle does not answer to the start"
        return _returning(_end(state, seen, Ending.REFUSED, reason), seen, plan)
    state = replace(state, asks=state.asks + 1, asked_at=seen.now, heartbeats_at_word=seen.heartbeats)
    return state, Order(plan.mode)


def _flying(state: RunState, seen: Seen, plan: Plan) -> tuple[RunState, Order | None]:
    for text in seen.texts:
        if "failsafe" in text.lower():
            state = replace(state, failsafe=text)
    if seen.mode == plan.mode:
        state = replace(state, confirmed=True)
    elif state.confirmed or seen.heartbeats >= state.heartbeats_at_word + OTHER_HEARTBEATS:
        return _ended(_end(state, seen, *_taken(seen, state)), seen), None
    wanted = _wants_end(seen)
    if wanted is not None:
        return _returning(_end(state, seen, *wanted), seen, plan)
    for text in seen.texts:
        if text.startswith(STARTING) and not _axis_is(text, plan.axis_number):
            reason = f"the vehicle started another axis than {plan.axis_number}: {text}"
            return _returning(_end(state, seen, Ending.ABORTED, reason), seen, plan)
        if text.startswith((STOPPED, PARAMETER_ERROR)):
            return _returning(_end(state, seen, Ending.STOPPED, text), seen, plan)
        if text.startswith(FINISHED):
            return _returning(_end(state, seen, Ending.FINISHED, ""), seen, plan)
    if not seen.armed:
        return _returning(_end(state, seen, Ending.STOPPED, "the vehicle was disarmed"), seen, plan)
    since = 0.0 if state.flying_since is None else seen.now - state.flying_since
    if since > plan.finished_s + LATE_S or (seen.sweep_s is not None and seen.sweep_s > plan.finished_s + 0.5):
        return _returning(_end(state, seen, Ending.FINISHED, "without the vehicle's word"), seen, plan)
    return state, None


def _returning(state: RunState, seen: Seen, plan: Plan) -> tuple[RunState, Order | None]:
    if seen.answer is not None and seen.answer.accepted:
        state = replace(state, held=seen.heartbeats)
    if state.ending is not Ending.STUCK and seen.answer is not None and seen.answer.accepted is False:
        state = replace(state, reason=joined(state.reason, seen.answer.reason))
    waited = seen.now - state.returning_since
    if seen.lost and (waited > LOST_PATIENCE_S or seen.given_up):
        reason = joined(state.reason, f"no link for {waited:.0f} s: what the vehicle does is not known")
        return replace(state, phase=Phase.ENDED, ending=Ending.LINK, reason=reason, mode_after="unknown"), None
    if seen.now < state.settled_at:
        # What was heard last is too old to act on.
        return replace(state, fresh_after=max(state.fresh_after, seen.heartbeats)), None
    fresh = seen.heartbeats > state.fresh_after
    if seen.mode != plan.mode and fresh:
        settled = state.confirmed or seen.heartbeats >= state.heartbeats_at_word + OTHER_HEARTBEATS
        if settled:
            return _ended(state, seen), None
    if seen.mode == plan.mode and fresh:
        state = replace(state, confirmed=True)
    # Its last word is the heartbeat's, or the acceptance of a start that no heartbeat has followed yet.
    newly_started = state.accepted and not state.confirmed and seen.heartbeats == state.heartbeats_at_word
    excited = (seen.mode == plan.mode and fresh) or newly_started
    if waited > STUCK_S and excited:
        reason = joined(state.reason, f"the vehicle stays in {seen.mode_name}: the pilot must take it")
        return replace(state, phase=Phase.ENDED, ending=Ending.STUCK, reason=reason, mode_after=seen.mode_name), None
    if excited and seen.heartbeats > state.held and seen.now - state.returned_at >= ASK_EVERY_S:
        return replace(state, returned_at=seen.now), Order(state.mode_before)
    return state, None


def _wants_end(seen: Seen) -> tuple[Ending, str] | None:
    if seen.lost:
        return Ending.LINK, "the link was lost"
    if seen.abort is not None:
        return Ending.ABORTED, seen.abort
    if seen.violations:
        return Ending.LIMIT, "; ".join(seen.violations)
    return None


def _end(state: RunState, seen: Seen, ending: Ending, reason: str) -> RunState:
    """On the way back. An ordinary end waits for the next heartbeat, and so does a lost link; others act at once."""
    patient = ending in (Ending.FINISHED, Ending.LINK)
    return replace(
        state,
        phase=Phase.RETURNING,
        ending=ending,
        reason=reason,
        returning_since=seen.now,
        fresh_after=seen.heartbeats if patient else seen.heartbeats - 1,
    )


def _ended(state: RunState, seen: Seen) -> RunState:
    return replace(state, phase=Phase.ENDED, mode_after=seen.mode_name)


def _taken(seen: Seen, state: RunState) -> tuple[Ending, str]:
    """Another mode in mid-run: whose, we cannot know."""
    # The vehicle's own end and a mode change by somebody else may fall into one tick.
    if any(text.startswith(FINISHED) for text in seen.texts):
        return Ending.FINISHED, ""
    who = f"the vehicle says {state.failsafe!r}" if state.failsafe else "the pilot, or another station, has taken over"
    return Ending.PILOT, f"the mode is {seen.mode_name}: {who}"


def _axis_is(text: str, number: int) -> bool:
    _, _, axis = text.partition("axis=")
    return not axis.strip().isdigit() or int(axis) == number


def joined(first: str, second: str) -> str:
    """Two reasons as one; what was said already is not said again."""
    if not second or second in first:
        return first
    return f"{first}; {second}" if first else second


class Excitation:
    """One run as a context: inside it the vehicle may be excited, and however it is left the excitation ends first.

    `tick` is called until it says false. Leaving the context earlier, by an exception or Ctrl-C, brings the vehicle
    back before the exception goes on; only the third Ctrl-C in a row leaves it as it is.
    """

    def __init__(self, session: Connection, plan: Plan, limits: Limits, clock: Clock, mode_before: int) -> None:
        self.state = RunState(mode_before)
        self.peaks = Peaks()
        self.log_start_s: float | None = None
        self.frequency_hz: float | None = None
        self.elapsed_s = 0.0
        self.orders = 0
        self.snapshot = session.snapshot()
        self._session = session
        self._plan = plan
        self._limits = limits
        self._clock = clock
        self._answer: Answer | None = None
        self._cursor, _ = session.texts_since(0)
        self._looked_at_log_s = math.inf

    def __enter__(self) -> Self:
        window = self._session.samples(0.5)
        if window.t.size:
            self._looked_at_log_s = float(window.t[-1])
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        why = "interrupted" if isinstance(error, KeyboardInterrupt) else f"{error}" if error is not None else "ended"
        interruptions, failures = 0, 0
        while self.state.phase is not Phase.ENDED:
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
                    self.state = replace(
                        self.state, phase=Phase.ENDED, ending=Ending.LINK, reason=joined(self.state.reason, why)
                    )
                self._clock.sleep(TICK_S)

    def tick(self, abort: str | None = None, *, look_at_log: bool = True, given_up: bool = False) -> bool:
        """Look, decide, and send what was decided. False once the run has ended."""
        snapshot = self.snapshot = self._session.snapshot()
        self._cursor, texts = self._session.texts_since(self._cursor)
        sweep_s = self._look(snapshot) if look_at_log else None
        seen = Seen(
            now=self._clock.now(),
            mode=snapshot.mode,
            mode_name=snapshot.mode_name,
            heartbeats=snapshot.heartbeats,
            armed=snapshot.armed,
            lost=snapshot.lost,
            texts=tuple(text.text for text in texts),
            answer=self._answer,
            sweep_s=sweep_s,
            violations=violations(self._limits, self.peaks),
            abort=abort,
            given_up=given_up,
        )
        self._answer = None
        if self.state.flying_since is not None and self.state.phase is Phase.FLYING:
            self.elapsed_s = seen.now - self.state.flying_since
        self.state, order = step(self.state, seen, self._plan)
        if order is not None:
            self.orders += 1
            self._answer = self._ask(order)
        return self.state.phase is not Phase.ENDED

    def _ask(self, order: Order) -> Answer:
        # One send each: repeating is the step's business, which looks at the mode in between.
        patience_s = None if order.mode == self._plan.mode else ASK_EVERY_S
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
        """Update the peaks from what is new; the vehicle's time in the maneuver, where its log tells."""
        if self.state.phase is Phase.FLYING:
            self.peaks = self.peaks.with_telemetry(snapshot.p, snapshot.q, snapshot.roll, snapshot.pitch)
        window = self._session.samples(1.0)
        if not window.t.size:
            return None
        newest = float(window.t[-1])
        if newest < self._looked_at_log_s - 1.0:
            self._looked_at_log_s = newest  # another log: its clock began anew
        new = window.t > self._looked_at_log_s
        if self.state.phase is Phase.FLYING and new.any():
            self.peaks = self.peaks.with_samples(window.p[new], window.q[new], window.delta_x[new], window.delta_y[new])
        self._looked_at_log_s = newest
        if window.sweep_s is not None and self.state.phase is Phase.FLYING:
            self.log_start_s = newest - window.sweep_s
            self.frequency_hz = window.sweep_hz
        return window.sweep_s


# ------------------------------------------------------------------------------------------------ ending one


@dataclass(frozen=True, slots=True)
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
        return AbortResult(False, True, first.mode_name, first.mode_name, 0, "")
    silent = Maneuver("quiet")
    plan = Plan(silent, (), "", 0, excitation_mode, 0.0, silent.duration_s, silent.duration_s)
    state = RunState(
        mode,
        phase=Phase.RETURNING,
        accepted=True,
        confirmed=True,
        ending=Ending.ABORTED,
        returning_since=clock.now(),
        fresh_after=first.heartbeats - 1,
    )
    returning = Excitation(session, plan, Limits(), clock, mode)
    returning.state = state
    while returning.tick(look_at_log=False):
        clock.sleep(TICK_S)
    state = returning.state
    return AbortResult(
        True, state.ending is Ending.ABORTED, first.mode_name, state.mode_after, returning.orders, state.reason
    )
