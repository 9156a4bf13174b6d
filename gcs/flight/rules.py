"""The rules of an excitation, as a pure step: from what was seen follows what is asked for, and when it is over.

The rules that `step` keeps, whatever the link does (late by any time, deaf one way, lossy, repeating; see
`gcs.link.clock` for what is taken for granted). `tests/excitation_rules.py` checks them over histories of messages.

1. The excitation mode is asked for only from the mode the pilot left the vehicle in, on a link whose lag is known and
   short, so long after the last write that it has landed or is lost, and not again once the vehicle said that it
   starts.
2. The only other mode ever asked for is the one before the run, and only while the vehicle's last word is that it is in
   the excitation mode. One heartbeat with another mode stops every order at once; a second in a row says that the
   vehicle has left, by the pilot's hand, a failsafe's, or ours, and no mode is asked for after it.
3. A heartbeat with the excitation mode after one with another mode is of two vehicles with one id, or an old message:
   that is counted and told, and the way back goes on.
4. A start that was asked for may be under way until the vehicle says something *knowing of it* (a heartbeat stamped, on
   the vehicle's clock, after a ping that was sent after the start). Until then, and while the excitation mode shows,
   the vehicle counts as excited: `cleared` is false, and nothing that scales or moves a maneuver is written. Nor is it
   cleared while its own log shows the excitation; without a word of the log, or where heartbeats contradicted each
   other, or it left by somebody else's order, only after a look of some seconds. A silence undoes all proof.
5. An excitation that shows although the run had ended is ours, come late, until rule 4 has cleared it: it is brought
   back like any other.
6. After silence, the link's or our own, nothing starts again. The first heartbeat that is not older than the silence
   decides: the excitation mode is answered with the way back, any other is left alone. Time without a link does not
   count against a vehicle that does not leave.
7. A run ends where its log has stopped (or, where that stays on the vehicle's card, telemetry), the link is late for a
   second, the vehicle no longer answers, a limit is broken, or it flies other settings than planned.
8. Where the vehicle is not heard, nothing is sent of itself: a mode that was asked for unheard could undo what the
   pilot chose meanwhile. Only if somebody asks for it (`Seen.blind`), on the way back, the maneuver's size is set to
   0, again and again until anything is heard: that ends what is ours, in whatever mode, and changes nobody's. It is
   the one write that may reach an excited vehicle, and an order by rule 4.
9. Every run ends with the mode that the vehicle showed after it, or with the words that it is not known.

After an ordinary end the way back waits for a heartbeat later than the end: it costs a second, and does not talk over a
pilot who used that second.
"""

from __future__ import annotations

from dataclasses import replace

from gcs.flight.preflight import LAG_LIMIT_S
from gcs.flight.run_state import Ending, Order, Phase, RunState, Seen, Still
from gcs.link.clock import LOST_AFTER_S, UNKNOWN
from gcs.vehicle.autopilots import FINISHED, PARAMETER_ERROR, STARTING, STOPPED
from gcs.vehicle.profile import Plan
from gcs.vehicle.snapshot import Beat

TICK_S = 0.05
ASK_EVERY_S = 0.3
"""Between two sends of the mode before the run."""
STILL_EVERY_S = 1.0
"""Between two sends of the size of 0 to a vehicle that is not heard."""
START_EVERY_S = 0.5
START_TRIES = 6
EARLY_S = 0.5
"""A word that the maneuver is over this long before it can be is somebody else's, or of other settings."""
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
LOST_PATIENCE_S = 60.0
STUCK_S = 30.0
"""The vehicle answers and stays in the excitation mode for so long: say so, loudly, and leave it to the pilot."""
UNKNOWN_S = 30.0
"""It is heard for so long, and does not show whether a start that was asked for came about."""
LOOK_S = 4.0
"""How long a vehicle that left by somebody else's order, or while heartbeats contradicted each other, is looked at."""


def step(state: RunState, seen: Seen, plan: Plan) -> tuple[RunState, Order | Still | None]:
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
    state = _look_at_link(state, seen)
    for text in seen.texts:
        if "failsafe" in text.lower():
            state = replace(state, failsafe=text)
    for beat in seen.beats:
        state = _hear_in_time(state, beat, seen.now, plan)
    if any(text.startswith(STARTING) for text in seen.texts):
        state = _unproved(state)  # a start of ours came late
    if state.proved_at is None and state.others and state.known_s >= state.ordered_at:
        state = replace(state, proved_at=seen.now)
    return state


def _look_at_link(state: RunState, seen: Seen) -> RunState:
    """Silences, the link's or our own, a late link, a log that stopped."""
    heard_at = seen.now - seen.link_age_s
    lost = seen.lost or heard_at - state.heard_at > LOST_AFTER_S  # it may lie between two ticks
    silent = lost or seen.now - state.ticked_at > STALL_S
    if silent:
        # What was heard before the silence is too old to act on.
        state = _unproved(replace(state, settled_at=seen.now + SETTLE_S, excited=False, accepted_after=None))
    if state.heard_since == UNKNOWN or silent:
        state = replace(state, heard_since=seen.now)
    silent_log = seen.log_age_s is not None and seen.log_age_s > LAG_LIMIT_S and seen.link_age_s < LAG_LIMIT_S
    # A lag that is not known, because the vehicle's clock jumped, is as late as it was.
    late = state.late_since is not None if seen.lag_s is None else seen.lag_s > LAG_LIMIT_S
    return replace(
        state,
        ticked_at=seen.now,
        heard_at=heard_at,
        lost_since=_since(lost, state.lost_since, seen.now),
        late_since=_since(late and not seen.lost, state.late_since, seen.now),
        log_silent_since=_since(silent_log, state.log_silent_since, seen.now),
    )


def _hear_in_time(state: RunState, beat: Beat, now: float, plan: Plan) -> RunState:
    """A heartbeat; right after a silence only one that is certainly new."""
    age_s = None if beat.late_s is None else beat.late_s + now - beat.at_s
    if now >= state.settled_at or (age_s is not None and age_s <= FRESH_S):
        return _hear(state, beat, plan)
    # Too old to act on; not too old to wait for the next.
    return replace(state, others=0, proved_at=None) if beat.mode == plan.mode else replace(state, excited=False)


def _unproved(state: RunState) -> RunState:
    """What showed so far that no order of ours is under way does not show it any more."""
    return replace(state, known_s=UNKNOWN, proved_at=None)


def _since(condition: bool, since: float | None, now: float) -> float | None:
    return None if not condition else now if since is None else since


def _hear(state: RunState, beat: Beat, plan: Plan) -> RunState:
    if beat.mode == plan.mode:
        return replace(
            _unproved(state),
            excited=True,
            excited_number=beat.number,
            confirmed=True,
            contradictions=state.contradictions + (state.others > 0 and state.confirmed),
            others=0,
            mode_shown=beat.mode_name,
        )
    if state.asks and not state.confirmed and beat.mode == state.mode_before and beat.known_s < state.asked_at:
        return state  # it may date from before the start
    return replace(state, excited=False, others=state.others + 1, known_s=beat.known_s, mode_shown=beat.mode_name)


# What is done.


def _starting(state: RunState, seen: Seen, plan: Plan) -> tuple[RunState, Order | Still | None]:
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
    if seen.now < state.settled_at:
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


def _flying(state: RunState, seen: Seen, plan: Plan) -> tuple[RunState, Order | Still | None]:
    if state.others > 1:
        return _leave(_end(state, seen, *_taken(state)), seen)
    wanted = _wants_end(state, seen) or _said(state, seen, plan)
    if wanted is None and not seen.armed:
        wanted = Ending.STOPPED, "the vehicle was disarmed"
    since = 0.0 if state.flying_since is None else seen.now - state.flying_since
    over_s = plan.finished_s + 0.5
    # By the log's stamps, unless they ran ahead of our own clock: then the vehicle's jumped.
    logged = seen.sweep_s is not None and over_s < seen.sweep_s <= since + LATE_S
    if wanted is None and (logged or since > plan.finished_s + LATE_S):
        wanted = Ending.FINISHED, "without the vehicle's word"
    return (state, None) if wanted is None else _returning(_end(state, seen, *wanted), seen, plan)


def _said(state: RunState, seen: Seen, plan: Plan) -> tuple[Ending, str] | None:
    """What the vehicle's texts say about the run's end."""
    for text in seen.texts:
        if text.startswith(STARTING) and not _axis_is(text, plan.axis_number):
            return Ending.SETTINGS, f"the vehicle started another axis than {plan.axis_number}: {text}"
        if text.startswith((STOPPED, PARAMETER_ERROR)):
            return Ending.STOPPED, text
        if text.startswith(FINISHED):
            # Since the first of our orders: it cannot have flown for longer.
            early_s = plan.over_s - (seen.now - state.asked_at) - (state.asks - 1) * START_EVERY_S
            if early_s > EARLY_S:
                return Ending.STOPPED, f"it says that it finished, {early_s:.1f} s before the maneuver was over"
            return Ending.FINISHED, ""
    return None


def _returning(state: RunState, seen: Seen, plan: Plan) -> tuple[RunState, Order | Still | None]:
    if seen.answer is not None and seen.answer.accepted:
        state = replace(state, held=seen.heartbeats, accepted=state.accepted + 1)
    if seen.answer is not None and seen.answer.accepted is False:
        state = replace(state, reason=joined(state.reason, seen.answer.reason))
    if _deaf(seen):
        state = replace(state, deaf_until=seen.now)
    lost = _link_given_up(state, seen)
    if lost is not None:
        return lost, None
    if seen.blind and seen.lost and state.asks and seen.now - state.stilled_at >= STILL_EVERY_S:
        return replace(state, stilled_at=seen.now, proved_at=None), Still()
    if state.others > 1 and seen.heartbeats > state.fresh_after:
        return _leave(state, seen)
    since = max(state.returning_since, state.heard_since)
    if state.excited and _stuck(state, seen, since):
        reason = joined(state.reason, f"the vehicle stays in {state.mode_shown}: the pilot must take it")
        return given_up(state, Ending.STUCK, reason, state.mode_shown), None
    waited = seen.now - since
    if not state.excited and waited > UNKNOWN_S:
        reason = joined(state.reason, "the vehicle does not tell whether it is out of the excitation: pilot, look")
        return given_up(state, state.ending or Ending.LINK, reason), None
    return _asked_again(state, seen)


def _asked_again(state: RunState, seen: Seen) -> tuple[RunState, Order | None]:
    """The order back, while the vehicle shows that it is excited."""
    # A vehicle that said that it starts is excited also before a heartbeat shows it.
    newly_started = not state.confirmed and state.accepted_after == seen.heartbeats and seen.now >= state.settled_at
    fresh = state.excited and state.excited_number > max(state.fresh_after, state.held)
    if (fresh or (newly_started and state.held < 0)) and seen.now - state.returned_at >= ASK_EVERY_S:
        return replace(state, returned_at=seen.now, proved_at=None), Order(state.mode_before)
    return state, None


def _stuck(state: RunState, seen: Seen, since: float) -> bool:
    """It stays in the excitation though it answers, or while a link of one way is waited for as a lost one is."""
    if _deaf(seen):
        return seen.now - since > LOST_PATIENCE_S
    return seen.now - max(since, state.deaf_until) > STUCK_S


def _deaf(seen: Seen) -> bool:
    """The vehicle is heard, and what is said to it gets no answer."""
    return seen.answer_age_s > LOST_AFTER_S


def _watching(state: RunState, seen: Seen, plan: Plan) -> tuple[RunState, Order | Still | None]:
    """Out of the excitation mode: until nothing of ours can bring it back, and nobody contradicts."""
    if state.excited:
        again = replace(state, reason=joined(state.reason, "the excitation mode showed again and was ended"))
        assert again.ending is not None
        return _returning(_end(again, seen, again.ending, again.reason, at_once=True), seen, plan)
    lost = _link_given_up(state, seen)
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


def _link_given_up(state: RunState, seen: Seen) -> RunState | None:
    if state.lost_since is None or not seen.lost:
        return None
    waited = seen.now - state.lost_since
    if waited <= LOST_PATIENCE_S and not seen.given_up:
        return None
    reason = joined(state.reason, f"no link for {seen.link_age_s:.0f} s: what the vehicle does is not known")
    return given_up(state, Ending.LINK, reason)


def given_up(state: RunState, ending: Ending, reason: str, mode_after: str = "unknown") -> RunState:
    """The end of a run that leaves open, in words, what the vehicle does."""
    return replace(state, phase=Phase.ENDED, ending=ending, reason=reason, mode_after=mode_after)


def _wants_end(state: RunState, seen: Seen) -> tuple[Ending, str] | None:
    if state.lost_since is not None:
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
        return _silence(seen)
    if _deaf(seen):
        return Ending.LINK, f"the vehicle is heard, but has answered nothing for {seen.answer_age_s:.1f} s"
    if state.late_since is not None and seen.now - state.late_since > LAG_PATIENCE_S:
        return Ending.LATE, f"the link is {seen.lag_s or 0.0:.1f} s late"
    return None


def _silence(seen: Seen) -> tuple[Ending, str]:
    if seen.log_on_card:
        return Ending.TELEMETRY, f"no attitude by telemetry for {seen.log_age_s:.1f} s"
    taken = ": another station's log client has taken it; end that one first" if seen.log_taken else ""
    return Ending.LOG, f"no new block of the vehicle's log for {seen.log_age_s:.1f} s{taken}"


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
    return replace(state, phase=Phase.WATCHING, left_at=seen.now, mode_after=state.mode_shown), None


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
