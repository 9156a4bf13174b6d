"""The pure step of one excitation: every rule about modes, tick by tick."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import pytest

from gcs.excitation import (
    ASK_EVERY_S,
    LOST_PATIENCE_S,
    START_EVERY_S,
    START_TRIES,
    STUCK_S,
    Answer,
    Ending,
    Order,
    Phase,
    RunState,
    Seen,
    step,
)
from gcs.maneuver import Maneuver
from gcs.profile import Plan, bundled_profiles

STABILIZE, ALT_HOLD, RTL, SYSTEMID = 0, 2, 6, 25
NAMES = {STABILIZE: "Stabilize", ALT_HOLD: "AltHold", RTL: "RTL", SYSTEMID: "SystemID"}


@pytest.fixture
def plan() -> Plan:
    return bundled_profiles()[0].plan(Maneuver("chirp", "roll", 0.1, 30.0))


def seen(now: float, mode: int, heartbeats: int, **more: object) -> Seen:
    return replace(Seen(now, mode, NAMES[mode], heartbeats), **more)  # type: ignore[arg-type]


def flying(heartbeats: int = 5, *, confirmed: bool = True) -> RunState:
    return RunState(
        STABILIZE,
        phase=Phase.FLYING,
        asks=1,
        asked_at=0.0,
        heartbeats_at_word=heartbeats,
        accepted=True,
        confirmed=confirmed,
        flying_since=0.0,
    )


def test_the_excitation_mode_is_asked_for_once_and_again_only_after_a_pause(plan: Plan) -> None:
    state, order = step(RunState(STABILIZE), seen(0.0, STABILIZE, 3), plan)
    assert order == Order(SYSTEMID)
    state, order = step(state, seen(0.1, STABILIZE, 3, answer=Answer(None)), plan)
    assert order is None
    state, order = step(state, seen(START_EVERY_S + 0.01, STABILIZE, 3), plan)
    assert order == Order(SYSTEMID)
    assert state.phase is Phase.STARTING


def test_a_start_that_is_never_answered_is_given_up(plan: Plan) -> None:
    state, asked, now, beats = RunState(STABILIZE), 0, 0.0, 3
    while state.phase is not Phase.ENDED and now < 30:
        state, order = step(state, seen(now, STABILIZE, beats + int(now)), plan)
        asked += order == Order(SYSTEMID)
        assert order in (None, Order(SYSTEMID))
        now += 0.1
    assert asked == START_TRIES
    assert state.ending is Ending.REFUSED
    assert "does not answer" in state.reason


def test_a_refusal_carries_the_vehicles_reason_and_commands_nothing(plan: Plan) -> None:
    state, _ = step(RunState(STABILIZE), seen(0.0, STABILIZE, 3), plan)
    state, order = step(state, seen(0.3, STABILIZE, 3, answer=Answer(False, "No axis selected")), plan)
    assert (state.phase, state.ending, state.reason, order) == (
        Phase.ENDED,
        Ending.REFUSED,
        "No axis selected",
        None,
    )


def test_a_pilot_who_changes_mode_before_the_start_is_not_talked_over(plan: Plan) -> None:
    state, order = step(RunState(STABILIZE), seen(0.0, ALT_HOLD, 3), plan)
    assert (state.phase, state.ending, order) == (Phase.ENDED, Ending.PILOT, None)


def test_an_excitation_that_somebody_else_started_is_left_alone(plan: Plan) -> None:
    state, order = step(RunState(STABILIZE), seen(0.0, SYSTEMID, 3), plan)
    assert (state.phase, state.ending, order) == (Phase.ENDED, Ending.PILOT, None)


@pytest.mark.parametrize("mode", [STABILIZE, ALT_HOLD, RTL])
def test_any_other_mode_in_mid_run_ends_it_without_a_command(plan: Plan, mode: int) -> None:
    state, order = step(flying(), seen(4.0, mode, 9), plan)
    assert (state.phase, state.ending, order) == (Phase.ENDED, Ending.PILOT, None)
    for tick in range(100):
        state, order = step(state, seen(4.1 + tick, SYSTEMID, 10 + tick, abort="Ctrl-C"), plan)
        assert order is None


def test_a_pilot_who_takes_over_right_after_the_start_is_believed_at_once(plan: Plan) -> None:
    state, order = step(flying(5), seen(0.4, ALT_HOLD, 6), plan)
    assert (state.phase, state.ending, order) == (Phase.ENDED, Ending.PILOT, None)


def test_a_start_that_may_have_arrived_before_the_link_was_lost_is_waited_for(plan: Plan) -> None:
    state, order = step(RunState(STABILIZE), seen(0.0, STABILIZE, 5), plan)
    assert order == Order(SYSTEMID)
    for now, beats in ((0.3, 6), (0.4, 7)):
        state, _ = step(state, seen(now, STABILIZE, beats), plan)
    state, _ = step(state, seen(4.0, STABILIZE, 7, lost=True), plan)
    now = 4.0
    while now < 6.0:
        now += 0.1
        state, order = step(state, seen(now, STABILIZE, 7), plan)
        assert (state.phase, order) == (Phase.RETURNING, None), "only a new heartbeat tells"
    state, order = step(state, seen(6.1, SYSTEMID, 8), plan)
    assert order == Order(STABILIZE)


def test_a_failsafe_is_told_apart_from_the_pilot(plan: Plan) -> None:
    state, _ = step(flying(), seen(4.0, SYSTEMID, 9, texts=("GCS Failsafe",)), plan)
    state, order = step(state, seen(4.5, RTL, 10), plan)
    assert (state.ending, order) == (Ending.PILOT, None)
    assert "'GCS Failsafe'" in state.reason


def test_a_heartbeat_that_was_under_way_at_the_start_is_no_pilot(plan: Plan) -> None:
    state = flying(5, confirmed=False)
    state, _ = step(state, seen(0.2, STABILIZE, 6), plan)
    assert state.phase is Phase.FLYING
    state, _ = step(state, seen(1.2, SYSTEMID, 7), plan)
    assert state.confirmed
    other, _ = step(flying(5, confirmed=False), seen(1.2, STABILIZE, 7), plan)
    assert other.ending is Ending.PILOT


def test_an_abort_is_sent_at_once_and_again_only_while_the_excitation_mode_shows(plan: Plan) -> None:
    state, order = step(flying(), seen(4.0, SYSTEMID, 9, abort="Ctrl-C"), plan)
    assert order == Order(STABILIZE)
    times = []
    for tick in range(1, 40):
        now = 4.0 + 0.05 * tick
        state, order = step(state, seen(now, SYSTEMID, 9, answer=Answer(None)), plan)
        if order is not None:
            assert order == Order(STABILIZE)
            times.append(now)
    assert len(times) == 5
    assert all(ASK_EVERY_S <= b - a < ASK_EVERY_S + 0.06 for a, b in pairwise(times))
    state, order = step(state, seen(7.0, RTL, 10), plan)
    assert (state.phase, state.ending, order, state.mode_after) == (Phase.ENDED, Ending.ABORTED, None, "RTL")


def test_an_accepted_abort_waits_for_the_next_heartbeat_before_it_is_sent_again(plan: Plan) -> None:
    state, _ = step(flying(), seen(4.0, SYSTEMID, 9, abort="Ctrl-C"), plan)
    state, order = step(state, seen(4.1, SYSTEMID, 9, answer=Answer(True)), plan)
    for tick in range(20):
        state, order = step(state, seen(4.2 + 0.05 * tick, SYSTEMID, 9), plan)
        assert order is None
    state, order = step(state, seen(5.3, SYSTEMID, 10), plan)
    assert order == Order(STABILIZE)


def test_an_abort_before_the_first_heartbeat_of_the_run_goes_by_the_vehicles_acceptance(plan: Plan) -> None:
    state, order = step(flying(5, confirmed=False), seen(0.1, STABILIZE, 5, abort="Ctrl-C"), plan)
    assert order == Order(STABILIZE)
    state, order = step(state, seen(0.2, STABILIZE, 5, answer=Answer(True)), plan)
    assert order is None
    state, order = step(state, seen(1.0, STABILIZE, 6), plan)
    assert (state.phase, order) == (Phase.RETURNING, None)
    state, order = step(state, seen(2.0, STABILIZE, 7), plan)
    assert (state.phase, state.ending) == (Phase.ENDED, Ending.ABORTED)


def test_an_abort_after_an_unanswered_start_waits_until_heartbeats_tell(plan: Plan) -> None:
    state, _ = step(RunState(STABILIZE), seen(0.0, STABILIZE, 5), plan)
    state, order = step(state, seen(0.1, STABILIZE, 5, abort="Ctrl-C"), plan)
    assert (state.phase, order) == (Phase.RETURNING, None)
    state, order = step(state, seen(0.8, SYSTEMID, 6), plan)
    assert order == Order(STABILIZE), "the lost start had arrived"


def test_an_abort_before_anything_was_asked_ends_at_once(plan: Plan) -> None:
    state, order = step(RunState(STABILIZE), seen(0.0, STABILIZE, 5, abort="Ctrl-C"), plan)
    assert (state.phase, state.ending, order) == (Phase.ENDED, Ending.ABORTED, None)


def test_after_an_ordinary_end_only_a_later_heartbeat_brings_the_way_back(plan: Plan) -> None:
    state, order = step(flying(), seen(32.0, SYSTEMID, 40, texts=("SystemID Finished",)), plan)
    assert (state.phase, state.ending, order) == (Phase.RETURNING, Ending.FINISHED, None)
    state, order = step(state, seen(32.5, SYSTEMID, 40), plan)
    assert order is None
    state, order = step(state, seen(32.9, SYSTEMID, 41), plan)
    assert order == Order(STABILIZE)


def test_a_pilot_who_takes_over_at_the_end_keeps_it(plan: Plan) -> None:
    state, _ = step(flying(), seen(32.0, SYSTEMID, 40, texts=("SystemID Finished",)), plan)
    state, order = step(state, seen(32.9, ALT_HOLD, 41), plan)
    assert (state.phase, state.ending, state.mode_after, order) == (Phase.ENDED, Ending.FINISHED, "AltHold", None)


@pytest.mark.parametrize("text", ["SystemID Stopped: lean=31.000000 max=30.000000", "SystemID Parameter Error"])
def test_the_vehicles_own_stop_is_told_and_it_is_brought_back(plan: Plan, text: str) -> None:
    state, order = step(flying(), seen(8.0, SYSTEMID, 12, texts=(text,)), plan)
    assert (state.ending, state.reason, order) == (Ending.STOPPED, text, Order(STABILIZE))


def test_another_axis_than_planned_is_ended(plan: Plan) -> None:
    state, order = step(flying(), seen(0.1, SYSTEMID, 6, texts=("SystemID Starting: axis=7",)), plan)
    assert (state.ending, order) == (Ending.ABORTED, Order(STABILIZE))
    state, order = step(flying(), seen(0.1, SYSTEMID, 6, texts=("SystemID Starting: axis=10",)), plan)
    assert state.phase is Phase.FLYING


def test_a_limit_ends_the_run_at_once(plan: Plan) -> None:
    state, order = step(flying(), seen(8.0, SYSTEMID, 12, violations=("p 4.00 rad/s is beyond 3.00",)), plan)
    assert (state.ending, order) == (Ending.LIMIT, Order(STABILIZE))


def test_a_run_without_the_word_finished_ends_by_the_logs_time_and_by_the_clock(plan: Plan) -> None:
    state, _ = step(flying(), seen(20.0, SYSTEMID, 40, sweep_s=plan.finished_s + 0.6), plan)
    assert state.ending is Ending.FINISHED
    state, _ = step(flying(), seen(plan.finished_s + 2.1, SYSTEMID, 40), plan)
    assert state.ending is Ending.FINISHED
    state, _ = step(flying(), seen(plan.finished_s + 1.0, SYSTEMID, 40, sweep_s=plan.finished_s + 0.3), plan)
    assert state.phase is Phase.FLYING


def test_nothing_is_sent_on_a_lost_link_and_a_heartbeat_from_before_decides_nothing(plan: Plan) -> None:
    state, order = step(flying(), seen(8.0, SYSTEMID, 12, lost=True), plan)
    assert (state.phase, state.ending, order) == (Phase.RETURNING, Ending.LINK, None)
    state, order = step(state, seen(12.0, SYSTEMID, 12, lost=True, abort="Ctrl-C"), plan)
    assert order is None
    state, order = step(state, seen(13.1, SYSTEMID, 12), plan)
    assert order is None, "something was heard, but no heartbeat yet"
    _, order = step(state, seen(13.5, SYSTEMID, 13), plan)
    assert order == Order(STABILIZE), "still excited: end it, do not go on"
    home, order = step(state, seen(13.5, RTL, 13), plan)
    assert (home.phase, home.ending, order) == (Phase.ENDED, Ending.LINK, None)


def test_heartbeats_that_waited_in_a_buffer_decide_nothing(plan: Plan) -> None:
    # The program was stopped for 7 s; the failsafe's RTL stands in the buffer behind five old heartbeats.
    state, _ = step(flying(), seen(8.0, SYSTEMID, 12), plan)
    state, order = step(state, seen(15.0, SYSTEMID, 12, lost=True), plan)
    for tick, (mode, beats) in enumerate([(SYSTEMID, 14), (SYSTEMID, 17), (RTL, 18), (RTL, 18)]):
        state, order = step(state, seen(15.05 + 0.05 * tick, mode, beats), plan)
        assert order is None
    state, order = step(state, seen(16.4, RTL, 19), plan)
    assert (state.phase, state.ending, state.mode_after, order) == (Phase.ENDED, Ending.LINK, "RTL", None)


def test_an_abort_after_a_stop_of_our_own_waits_for_news(plan: Plan) -> None:
    state, _ = step(flying(), seen(8.0, SYSTEMID, 12), plan)
    state, order = step(state, seen(11.0, SYSTEMID, 12, abort="Ctrl-C"), plan)
    assert (state.phase, order) == (Phase.RETURNING, None), "no lost link yet, but three seconds of our own missing"
    state, order = step(state, seen(11.2, SYSTEMID, 14), plan)
    assert order is None
    _, order = step(state, seen(12.3, SYSTEMID, 16), plan)
    assert order == Order(STABILIZE)


def test_a_link_that_stays_lost_is_given_up(plan: Plan) -> None:
    state, _ = step(flying(), seen(8.0, SYSTEMID, 12, lost=True), plan)
    state, order = step(state, seen(8.0 + LOST_PATIENCE_S + 1, SYSTEMID, 12, lost=True), plan)
    assert (state.phase, state.mode_after, order) == (Phase.ENDED, "unknown", None)
    assert "not known" in state.reason


def test_a_vehicle_that_will_not_leave_is_told_of_loudly(plan: Plan) -> None:
    state, _ = step(flying(), seen(8.0, SYSTEMID, 12, abort="Ctrl-C"), plan)
    order, now = None, 8.0
    while state.phase is not Phase.ENDED:
        now += 0.5
        state, order = step(state, seen(now, SYSTEMID, 12 + int(now)), plan)
    assert now == pytest.approx(8.0 + STUCK_S, abs=1.0)
    assert (state.phase, state.ending, order) == (Phase.ENDED, Ending.STUCK, None)
    assert "pilot must take it" in state.reason


def test_a_disarmed_vehicle_ends_the_run(plan: Plan) -> None:
    state, order = step(flying(), seen(8.0, SYSTEMID, 12, armed=False), plan)
    assert (state.ending, order) == (Ending.STOPPED, Order(STABILIZE))
