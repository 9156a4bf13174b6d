"""One excitation, from its start to the vehicle being out of it: a pure step that decides, and a context that acts.

The rules that `step` keeps, whatever the link does (late by any time, deaf one way, lossy, repeating; see
`gcs.link.clock` for what is taken for granted). `tests/excitation_rules.py` checks them over histories of messages.

1. The excitation mode is asked for only from the mode the pilot left the vehicle in, on a link whose lag is known and
   short, after everything written before has landed, and not again once the vehicle said that it starts.
2. The only other mode ever asked for is the one before the run, and only while the vehicle's last word is that it is in
   the excitation mode. One heartbeat with another mode stops every order at once; a second in a row says that the
   vehicle has left, by the pilot's hand, a failsafe's, or ours, and no mode is asked for after it.
3. A heartbeat with the excitation mode after one with another mode is of two vehicles with one id, or an old message:
   that is counted and told, and the way back goes on.
4. A start that was asked for may be under way until the vehicle says something *knowing of it* (a heartbeat stamped, on
   the vehicle's clock, after a ping that was sent after the start). Until then, and while the excitation mode shows,
   the vehicle counts as excited: `cleared` is false, and nothing that scales or moves a maneuver is written.
5. An excitation that shows although the run had ended is ours, come late, until rule 4 has cleared it: it is brought
   back like any other.
6. After silence, the link's or our own, nothing starts again. The first heartbeat that is not older than the silence
   decides: the excitation mode is answered with the way back, any other is left alone. Time without a link does not
   count against a vehicle that does not leave.
7. A run ends where its log has stopped, the link is late for a second, the vehicle no longer answers, a limit is
   broken, or it flies other settings than planned.
8. Every run ends with the mode that the vehicle showed after it, or with the words that it is not known.

After an ordinary end the way back waits for a heartbeat later than the end: it costs a second, and does not talk over a
pilot who used that second. `Excitation` is the context that starts a run and cannot be left before the vehicle is out
of the excitation mode, or its pilot has it, or the link is given up; then it is watched until it is cleared.
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

from gcs.cards.envelope import Limits, Peaks, violations
from gcs.cards.maneuver import Maneuver
from gcs.flight.live import LiveWindow
from gcs.flight.log_health import LogHealth
from gcs.flight.preflight import LAG_LIMIT_S
from gcs.flight.recorder import RecordingSummary
from gcs.flight.settings import flown_otherwise
from gcs.link.clock import LOST_AFTER_S, SWAP_S, UNKNOWN
from gcs.link.procedures import NoAnswerError, Procedure, ProcedureError, RefusedError, SetMode
from gcs.vehicle.profile import FINISHED, PARAMETER_ERROR, STARTING, STOPPED, Plan
from gcs.vehicle.snapshot import STABILIZE, SYSTEMID, Beat, Text, VehicleSnapshot

T = TypeVar("T")

TICK_S = 0.05
ASK_EVERY_S = 0.3
"""Between two sends of the mode before the run."""
START_EVERY_S = 0.5
START_TRIES = 6
LATE_S = 2.0
"""So long after its time a run without the word "Finished" is taken for finished."""
STALL_S = 1.5
"""Between two ticks: longer, and this program was stopped, and what it hears now may be old."""
SETTLE_S = 1.0
"""After a silence of the link or of ourselves, until what is heard is as new as this link lets it be."""
FRESH_S = 1.0
"""A heartbeat younger than this by the vehicle's clock is new, also right after a silence."""
LAG_PATIENCE_S = 1.0
"""How long it may be later in a run."""
LOG_SILENCE_S = 1.5
"""A run ends when no new block of its log came for so long, while the link was heard."""
SAME_RECORD_S = 0.1
"""The vehicle's record of a maneuver and its first sample are no farther apart; else the record is another's."""
LOST_PATIENCE_S = 60.0
STUCK_S = 30.0
"""The vehicle answers and stays in the excitation mode for so long: say so, loudly, and leave it to the pilot."""
UNKNOWN_S = 30.0
"""It is heard for so long, and does not show whether a start that was asked for came about."""
LOOK_S = 4.0
"""How long a vehicle that left by somebody else's order, or while heartbeats contradicted each other, is looked at."""


class Connection(Protocol):
    """What the engine needs of a `gcs.flight.session.Session`."""

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
    def log_health(self) -> LogHealth | None: ...
    def start_recording(self, directory: Path) -> None: ...
    def shed_log(self) -> None: ...
    def stop_recording(self, *, meanwhile: Callable[[], None]) -> RecordingSummary: ...


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
    WATCHING = "watching"
    """Out of the excitation mode; an order of ours that came late might bring it back."""
    ENDED = "ended"


class Ending(Enum):
    """Why a run ended."""

    FINISHED = "finished"
    STOPPED = "stopped by the vehicle"
    REFUSED = "refused"
    PILOT = "taken over"
    LIMIT = "limit exceeded"
    LINK = "link lost"
    LATE = "link too late"
    LOG = "log stopped"
    SETTINGS = "other settings"
    PROBE = "the probe says no"
    ABORTED = "aborted"
    STUCK = "stuck"


@dataclass(frozen=True, slots=True)
class Answer:
    """What became of the mode that was asked for."""

    accepted: bool | None
    """None: no answer."""
    reason: str = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class Seen:
    """All that the step is told, once a tick. Times are those of the session's clock, s."""

    now: float
    mode: int
    mode_name: str
    heartbeats: int
    """Heard so far; the mode is the last one's."""
    beats: tuple[Beat, ...] = ()
    """New since the last tick."""
    armed: bool = True
    lost: bool = False
    link_age_s: float = 0.0
    lag_s: float | None = None
    """None: not known."""
    answer_age_s: float = 0.0
    """Since the newest question was sent that the vehicle answered."""
    landed: bool = True
    """Everything written before the start has reached the vehicle, or was lost."""
    log_age_s: float | None = None
    """Since the last new block of the log; None where none is recorded."""
    log_stopped: str = ""
    """The vehicle's own words about having stopped its log."""
    log_mode: int | None = None
    """The mode by the vehicle's own log, which no stranger writes; None where that is old, or not told."""
    texts: tuple[str, ...] = ()
    """New since the last tick."""
    answer: Answer | None = None
    """To the order of the last tick."""
    sweep_s: float | None = None
    """The vehicle's own time in this maneuver, from its log."""
    violations: tuple[str, ...] = ()
    other_settings: str = ""
    """How what the vehicle flies differs from what was planned; empty where it does not, or is not known."""
    abort: str | None = None
    """Why somebody wants the end."""
    given_up: bool = False
    """Somebody no longer wants to wait for a lost link."""


@dataclass(frozen=True, slots=True)
class Order:
    """A mode to ask for, once."""

    mode: int


@dataclass(frozen=True, slots=True, kw_only=True)
class RunState:
    """One run, between two ticks."""

    mode_before: int
    """What the pilot flew before; the only mode that is ever commanded besides the excitation's."""
    phase: Phase = Phase.STARTING
    asks: int = 0
    """Times the excitation mode was asked for."""
    asked_at: float = UNKNOWN
    accepted_after: int | None = None
    """Heartbeats heard when the vehicle said that it starts; None while it did not, and after a silence."""
    flying_since: float | None = None
    ending: Ending | None = None
    reason: str = ""

    excited: bool = False
    """The vehicle's last word: the last heartbeat that can be believed showed the excitation mode."""
    excited_number: int = -1
    """That heartbeat's."""
    confirmed: bool = False
    """A heartbeat showed the excitation mode."""
    others: int = 0
    """Heartbeats in a row with another mode that do not date from before the start."""
    known_s: float = UNKNOWN
    """Of the last one of them: what was sent up to then had reached the vehicle."""
    proved_at: float | None = None
    """Since when they are known to be later than every order of ours, without silence or contradiction since."""
    mode_shown: str = ""
    """By the last heartbeat that can be believed."""
    contradictions: int = 0
    """Times the excitation mode showed again after another mode."""

    ticked_at: float = math.inf
    heard_at: float = math.inf
    """When anything was heard last."""
    settled_at: float = UNKNOWN
    """Until then a heartbeat counts only if the vehicle's clock says that it is new."""
    lost_since: float | None = None
    heard_since: float = UNKNOWN
    """There was no silence since then, neither of the link nor of ourselves."""
    late_since: float | None = None
    """The link's lag is beyond the limit since then."""
    log_silent_since: float | None = None
    """The link is heard and its log is not, since then."""
    failsafe: str = ""
    """What the vehicle said about one; its heartbeat follows up to a second later."""

    returning_since: float = 0.0
    fresh_after: int = 0
    """Returning: only a heartbeat after this many decides."""
    held: int = -1
    """Heartbeats heard when the way back was accepted; -1 while it was not."""
    accepted: int = 0
    """Times it was accepted: more than once, and the vehicle does not do what it accepts, or the answer was another's.
    """
    returned_at: float = UNKNOWN
    """When the way back was last asked for."""
    left_at: float = 0.0
    left_after: int = -1
    """Heartbeats heard until then."""
    cleared: bool = False
    """The vehicle is known to be out of the excitation mode, and no start of ours is under way any more."""
    mode_after: str = ""
    """What the heartbeat that ended the run showed; `unknown` where none did."""

    @property
    def ordered_at(self) -> float:
        """When a mode was asked for last, either one."""
        return max(self.asked_at, self.returned_at)


def step(state: RunState, seen: Seen, plan: Plan) -> tuple[RunState, Order | None]:
    """What follows from what was seen; the order, if any, is to be sent once."""
    state = _listen(state, seen, plan)
    match state.phase:
        case Phase.STARTING:
            return _starting(state, seen, plan)
        case Phase.FLYING:
            return _flying(state, seen, plan)
        case Phase.RETURNING:
            return _returning(state, seen, plan)
        case Phase.WATCHING:
            return _watching(state, seen, plan)
        case Phase.ENDED:
            return state, None


# What is heard.


def _listen(state: RunState, seen: Seen, plan: Plan) -> RunState:
    heard_at = seen.now - seen.link_age_s
    silent = seen.lost or seen.now - state.ticked_at > STALL_S or heard_at - state.heard_at > LOST_AFTER_S
    if silent:
        # What was heard before the silence is too old to act on; it may lie between two ticks.
        state = replace(state, settled_at=seen.now + SETTLE_S, excited=False, accepted_after=None)
        state = replace(state, known_s=UNKNOWN, proved_at=None)
    if state.heard_since == UNKNOWN or silent:
        state = replace(state, heard_since=seen.now)
    silent_log = seen.log_age_s is not None and seen.log_age_s > LAG_LIMIT_S and seen.link_age_s < LAG_LIMIT_S
    late = seen.lag_s is not None and seen.lag_s > LAG_LIMIT_S
    state = replace(
        state,
        ticked_at=seen.now,
        heard_at=heard_at,
        lost_since=_since(seen.lost, state.lost_since, seen.now),
        late_since=_since(late and not seen.lost, state.late_since, seen.now),
        log_silent_since=_since(silent_log, state.log_silent_since, seen.now),
    )
    for text in seen.texts:
        if "failsafe" in text.lower():
            state = replace(state, failsafe=text)
    for beat in seen.beats:
        age_s = None if beat.late_s is None else beat.late_s + seen.now - beat.at_s
        if seen.now >= state.settled_at or (age_s is not None and age_s <= FRESH_S):
            state = _hear(state, beat, plan)
        elif beat.mode != plan.mode:
            state = replace(state, excited=False)  # too old to act on; not too old to wait for the next
    if any(text.startswith(STARTING) for text in seen.texts):
        state = replace(state, known_s=UNKNOWN, proved_at=None)  # a start of ours came late
    if state.proved_at is None and state.others and state.known_s >= state.ordered_at:
        state = replace(state, proved_at=seen.now)
    return state


def _since(condition: bool, since: float | None, now: float) -> float | None:
    return None if not condition else now if since is None else since


def _hear(state: RunState, beat: Beat, plan: Plan) -> RunState:
    if beat.mode == plan.mode:
        return replace(
            state,
            excited=True,
            excited_number=beat.number,
            confirmed=True,
            contradictions=state.contradictions + (state.others > 0 and state.confirmed),
            others=0,
            known_s=UNKNOWN,
            proved_at=None,
            mode_shown=beat.mode_name,
        )
    if state.asks and not state.confirmed and beat.mode == state.mode_before and beat.known_s < state.asked_at:
        return state  # it may date from before the start
    return replace(state, excited=False, others=state.others + 1, known_s=beat.known_s, mode_shown=beat.mode_name)


# What is done.


def _starting(state: RunState, seen: Seen, plan: Plan) -> tuple[RunState, Order | None]:
    if not state.asks:
        return _not_asked_yet(state, seen, plan)
    started = any(text.startswith(STARTING) for text in seen.texts)
    if state.confirmed or started or (seen.answer is not None and seen.answer.accepted):
        return _flying(_started(state, seen), replace(seen, answer=None), plan)
    wanted = _wants_end(state, seen)
    if wanted is None and seen.answer is not None and seen.answer.accepted is False:
        wanted = Ending.REFUSED, seen.answer.reason
    if wanted is None and seen.mode not in (state.mode_before, plan.mode):
        wanted = Ending.PILOT, f"the mode is {seen.mode_name}: the pilot has it"
    if wanted is None and state.settled_at > state.asked_at:
        wanted = Ending.LINK, "nothing was heard for a while, or this program stood still: it is not asked for again"
    if wanted is None and state.asks >= START_TRIES and seen.now - state.asked_at >= START_EVERY_S:
        wanted = Ending.REFUSED, "the vehicle does not answer to the start"
    if wanted is not None:
        # Asked for already, it may still come about: only heartbeats will tell.
        return _returning(_end(state, seen, *wanted), seen, plan)
    if seen.now - state.asked_at < START_EVERY_S:
        return state, None
    return _ask(state, seen, plan)


def _not_asked_yet(state: RunState, seen: Seen, plan: Plan) -> tuple[RunState, Order | None]:
    """Nothing of ours is under way: whatever forbids the start ends the run at once."""
    wanted = _wants_end(state, seen)
    if seen.mode == plan.mode:
        wanted = Ending.PILOT, f"the mode is {seen.mode_name} already: somebody else started it"
    elif wanted is None and seen.mode != state.mode_before:
        wanted = Ending.PILOT, f"the mode is {seen.mode_name}: the pilot has it"
    elif wanted is None and seen.lag_s is None:
        wanted = Ending.REFUSED, "how late the link is, is not known: the vehicle answers no TIMESYNC"
    elif wanted is None and seen.lag_s is not None and seen.lag_s > LAG_LIMIT_S:
        wanted = Ending.LATE, f"the link is {seen.lag_s:.1f} s late: nothing was started"
    if wanted is not None:
        state = replace(state, phase=Phase.ENDED, ending=wanted[0], reason=wanted[1], mode_after=seen.mode_name)
        return replace(state, cleared=seen.mode != plan.mode), None
    if seen.now < state.settled_at or not seen.landed:
        return state, None
    return _ask(state, seen, plan)


def _ask(state: RunState, seen: Seen, plan: Plan) -> tuple[RunState, Order | None]:
    return replace(state, asks=state.asks + 1, asked_at=seen.now, others=0, proved_at=None), Order(plan.mode)


def _started(state: RunState, seen: Seen) -> RunState:
    """It said that it starts: to be acted on unless that came with a silence, or a heartbeat shows another mode."""
    return replace(
        state,
        phase=Phase.FLYING,
        accepted_after=seen.heartbeats if seen.now >= state.settled_at and not state.others else None,
        flying_since=seen.now,
    )


def _flying(state: RunState, seen: Seen, plan: Plan) -> tuple[RunState, Order | None]:
    if state.others > 1:
        return _leave(_end(state, seen, *_taken(state)), seen)
    wanted = _wants_end(state, seen) or _said(seen, plan)
    if wanted is None and not seen.armed:
        wanted = Ending.STOPPED, "the vehicle was disarmed"
    since = 0.0 if state.flying_since is None else seen.now - state.flying_since
    overdue = since > plan.finished_s + LATE_S
    if wanted is None and (overdue or (seen.sweep_s is not None and seen.sweep_s > plan.finished_s + 0.5)):
        wanted = Ending.FINISHED, "without the vehicle's word"
    return (state, None) if wanted is None else _returning(_end(state, seen, *wanted), seen, plan)


def _said(seen: Seen, plan: Plan) -> tuple[Ending, str] | None:
    """What the vehicle's texts say about the run's end."""
    for text in seen.texts:
        if text.startswith(STARTING) and not _axis_is(text, plan.axis_number):
            return Ending.SETTINGS, f"the vehicle started another axis than {plan.axis_number}: {text}"
        if text.startswith((STOPPED, PARAMETER_ERROR)):
            return Ending.STOPPED, text
        if text.startswith(FINISHED):
            return Ending.FINISHED, ""
    return None


def _returning(state: RunState, seen: Seen, plan: Plan) -> tuple[RunState, Order | None]:
    if seen.answer is not None and seen.answer.accepted:
        state = replace(state, held=seen.heartbeats, accepted=state.accepted + 1)
    if seen.answer is not None and seen.answer.accepted is False:
        state = replace(state, reason=joined(state.reason, seen.answer.reason))
    lost = _given_up(state, seen)
    if lost is not None:
        return lost, None
    if state.others > 1 and seen.heartbeats > state.fresh_after:
        return _leave(state, seen)
    waited = seen.now - max(state.returning_since, state.heard_since)
    if state.excited and waited > STUCK_S:
        reason = joined(state.reason, f"the vehicle stays in {state.mode_shown}: the pilot must take it")
        return _unknown(state, Ending.STUCK, reason, state.mode_shown), None
    if waited > UNKNOWN_S:
        reason = joined(state.reason, "the vehicle does not tell whether it is out of the excitation: pilot, look")
        return _unknown(state, state.ending or Ending.LINK, reason), None
    # A vehicle that said that it starts is excited also before a heartbeat shows it.
    newly_started = not state.confirmed and state.accepted_after == seen.heartbeats and seen.now >= state.settled_at
    fresh = state.excited and state.excited_number > max(state.fresh_after, state.held)
    if (fresh or (newly_started and state.held < 0)) and seen.now - state.returned_at >= ASK_EVERY_S:
        return replace(state, returned_at=seen.now, proved_at=None), Order(state.mode_before)
    return state, None


def _watching(state: RunState, seen: Seen, plan: Plan) -> tuple[RunState, Order | None]:
    """Out of the excitation mode: until nothing of ours can bring it back, and nobody contradicts."""
    if state.excited_number > state.left_after:
        again = replace(state, reason=joined(state.reason, "the excitation mode showed again and was ended"))
        assert again.ending is not None
        return _returning(_end(again, seen, again.ending, again.reason, at_once=True), seen, plan)
    lost = _given_up(state, seen)
    if lost is not None:
        return lost, None
    ours = state.accepted == 1 and not state.contradictions and state.heard_since <= state.left_at
    look_s = 0.0 if not state.asks or (ours and seen.log_mode is not None) else LOOK_S
    looked = state.proved_at is not None and seen.now - state.proved_at >= look_s
    if looked and seen.log_mode != plan.mode:
        return replace(state, phase=Phase.ENDED, cleared=True), None
    if seen.now - max(state.left_at, state.heard_since) > UNKNOWN_S:
        reason = joined(state.reason, "whether a late start of ours still arrives is not known")
        return replace(state, phase=Phase.ENDED, reason=reason), None
    return state, None


def _given_up(state: RunState, seen: Seen) -> RunState | None:
    if state.lost_since is None:
        return None
    waited = seen.now - state.lost_since
    if waited <= LOST_PATIENCE_S and not seen.given_up:
        return None
    reason = joined(state.reason, f"no link for {seen.link_age_s:.0f} s: what the vehicle does is not known")
    return _unknown(state, Ending.LINK, reason)


def _unknown(state: RunState, ending: Ending, reason: str, mode_after: str = "unknown") -> RunState:
    return replace(state, phase=Phase.ENDED, ending=ending, reason=reason, mode_after=mode_after)


def _wants_end(state: RunState, seen: Seen) -> tuple[Ending, str] | None:
    if seen.lost:
        return Ending.LINK, "the link was lost"
    if seen.abort is not None:
        return Ending.ABORTED, seen.abort
    if seen.violations:
        return Ending.LIMIT, "; ".join(seen.violations)
    if seen.other_settings:
        return Ending.SETTINGS, seen.other_settings
    if seen.log_stopped:
        return Ending.LOG, f"the vehicle says {seen.log_stopped!r}"
    if state.log_silent_since is not None and seen.now - state.log_silent_since > LOG_SILENCE_S - LAG_LIMIT_S:
        return Ending.LOG, f"no new block of the vehicle's log for {seen.log_age_s:.1f} s"
    if seen.answer_age_s > LOST_AFTER_S:
        return Ending.LINK, f"the vehicle is heard, but has answered nothing for {seen.answer_age_s:.1f} s"
    if state.late_since is not None and seen.now - state.late_since > LAG_PATIENCE_S:
        return Ending.LATE, f"the link is {seen.lag_s or 0.0:.1f} s late"
    return None


def _end(state: RunState, seen: Seen, ending: Ending, reason: str, *, at_once: bool = False) -> RunState:
    """On the way back. An ordinary end waits for the next heartbeat, and so does a lost link; others act at once."""
    patient = ending in (Ending.FINISHED, Ending.LINK) and not at_once
    return replace(
        state,
        phase=Phase.RETURNING,
        ending=ending,
        reason=reason,
        returning_since=seen.now,
        fresh_after=seen.heartbeats if patient else seen.heartbeats - 1,
        held=-1,
    )


def _leave(state: RunState, seen: Seen) -> tuple[RunState, Order | None]:
    left = replace(state, phase=Phase.WATCHING, left_at=seen.now, left_after=seen.heartbeats)
    return replace(left, mode_after=state.mode_shown), None


def _taken(state: RunState) -> tuple[Ending, str]:
    """Another mode in mid-run: whose, we cannot know."""
    who = f"the vehicle says {state.failsafe!r}" if state.failsafe else "the pilot, or another station, has taken over"
    return Ending.PILOT, f"the mode is {state.mode_shown}: {who}"


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
        mode_before: int,
        written_at: float = UNKNOWN,
    ) -> None:
        """`clock` is the session's; `written_at` is when something was written to the vehicle last."""
        # Who stood still a moment ago may have heard nothing new yet.
        self.state = RunState(mode_before=mode_before, settled_at=clock.now() + SETTLE_S)
        self.peaks = Peaks()
        self.log_start_s: float | None = None
        self.frequency_hz: float | None = None
        self.elapsed_s = 0.0
        self.orders = 0
        self.snapshot = session.snapshot()
        self._session = session
        self.plan = plan
        self.limits = limits
        self._clock = clock
        self._written_at = written_at
        self._answer: Answer | None = None
        self._cursor, _ = session.texts_since(0)
        self._beats = self.snapshot.heartbeats
        self._shed = False
        self._log_before_s = UNKNOWN
        """The log's newest time when the run began: what is older belongs to an earlier run."""
        self._looked_at_log_s = UNKNOWN
        self._log_mode: int | None = None
        self._other_settings = ""

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
                    self.state = _unknown(self.state, Ending.LINK, joined(self.state.reason, why))
                self._clock.sleep(TICK_S)

    @property
    def out_of_hand(self) -> bool:
        """The vehicle may be in the excitation mode, and something can still be done about it."""
        return self.state.phase not in (Phase.WATCHING, Phase.ENDED)

    def watch(self, *, given_up: bool = False) -> bool:
        """As `tick`, after the vehicle has left the mode; false once nothing of ours can bring it back any more."""
        self.tick("the run is over", given_up=given_up)
        return self.state.phase is not Phase.ENDED

    def tick(self, abort: str | None = None, *, look_at_log: bool = True, given_up: bool = False) -> bool:
        """Look, decide, and send what was decided. False once the vehicle has left the excitation mode."""
        snapshot = self.snapshot = self._session.snapshot()
        self._cursor, texts = self._session.texts_since(self._cursor)
        now = self._clock.now()
        sweep_s = self._look(snapshot) if look_at_log else None
        log = self._session.log_health()
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
            landed=now - self._written_at >= snapshot.answer_age_s + SWAP_S,
            log_age_s=None if log is None else log.silent_s,
            log_stopped="" if log is None else log.reported,
            log_mode=None if log is None or (log.silent_s or 0.0) > LOG_SILENCE_S else self._log_mode,
            texts=tuple(text.text for text in texts),
            answer=self._answer,
            sweep_s=sweep_s,
            violations=violations(self.limits, self.peaks),
            other_settings=self._other_settings,
            abort=abort,
            given_up=given_up,
        )
        self._answer, self._beats = None, snapshot.heartbeats
        if self.state.flying_since is not None and self.state.phase is Phase.FLYING:
            self.elapsed_s = seen.now - self.state.flying_since
        self.state, order = step(self.state, seen, self.plan)
        if self.state.ending is Ending.LATE and not self._shed:
            self._shed = True
            self._session.shed_log()  # what is left of the link is for the way back
        if order is not None:
            self.orders += 1
            self._answer = self._ask(order)
        return self.out_of_hand

    def _ask(self, order: Order) -> Answer:
        # One send each: repeating is the step's business, which looks at the mode in between.
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
            self.peaks = self.peaks.with_telemetry(snapshot.p, snapshot.q, snapshot.roll, snapshot.pitch)
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
    last = first.beats[-1] if first.beats else None
    now = clock.now()
    # A link found again may carry anything before the heartbeat that tells what became of the vehicle meanwhile.
    new = last is not None and now - last.at_s <= STALL_S and (last.late_s is None or last.late_s <= FRESH_S)
    silent = Maneuver("quiet")
    plan = Plan(silent, (), {}, "", 0, excitation_mode, 0.0, silent.duration_s, silent.duration_s)
    returning = Excitation(session, plan, Limits(), clock, mode)
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
        True, state.phase is Phase.WATCHING, first.mode_name, state.mode_after, returning.orders, state.reason
    )
