"""The pure step of one excitation: every rule about modes, tick by tick."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from typing import Any

import pytest

from gcs.cards.maneuver import Maneuver
from gcs.flight.rules import (
    ASK_EVERY_S,
    LAG_PATIENCE_S,
    LOG_SILENCE_S,
    LOOK_S,
    LOST_PATIENCE_S,
    START_EVERY_S,
    START_TRIES,
    STUCK_S,
    UNKNOWN_S,
    step,
)
from gcs.flight.run_state import Answer, Ending, Order, Phase, RunState, Seen
from gcs.vehicle.profile import Plan, bundled_profiles
from gcs.vehicle.snapshot import Beat

STABILIZE, ALT_HOLD, RTL, SYSTEMID = 0, 2, 6, 25
NAMES = {STABILIZE: "Stabilize", ALT_HOLD: "AltHold", RTL: "RTL", SYSTEMID: "SystemID"}


@pytest.fixture
def plan() -> Plan:
    return bundled_profiles()[0].plan(Maneuver(kind="chirp", axis="roll", amplitude=0.1, duration_s=30.0))


class Run:
    """One run, ticked by hand. Heartbeats know of everything sent 1.2 s before them, unless told otherwise."""

    def __init__(
        self, plan: Plan, state: RunState | None = None, *, mode: int = STABILIZE, heartbeats: int = 3
    ) -> None:
        self.plan = plan
        self.state = state or RunState(mode_before=STABILIZE)
        self.mode = mode
        self.heartbeats = heartbeats
        self.orders: list[tuple[float, int]] = []

    @classmethod
    def flying(cls, plan: Plan, *, confirmed: bool = True) -> Run:
        state = RunState(
            mode_before=STABILIZE,
            phase=Phase.FLYING,
            asks=1,
            asked_at=0.0,
            accepted_after=5,
            confirmed=confirmed,
            excited=confirmed,
            excited_number=5 if confirmed else -1,
            mode_shown=NAMES[SYSTEMID] if confirmed else "",
            flying_since=0.0,
            ticked_at=3.9,
        )
        return cls(plan, state, mode=SYSTEMID if confirmed else STABILIZE, heartbeats=5)

    def tick(
        self, now: float, *modes: int, known_s: float | None = None, late_s: float = 0.05, **more: Any
    ) -> int | None:
        """One tick, with these heartbeats new in it; the mode ordered, if any."""
        beats = []
        for mode in modes:
            self.heartbeats, self.mode = self.heartbeats + 1, mode
            beats.append(
                Beat(
                    number=self.heartbeats,
                    at_s=now,
                    mode=mode,
                    mode_name=NAMES[mode],
                    armed=True,
                    status=4,
                    known_s=now - 1.2 if known_s is None else known_s,
                    late_s=late_s,
                )
            )
        seen = Seen(
            now=now,
            mode=self.mode,
            mode_name=NAMES[self.mode],
            heartbeats=self.heartbeats,
            beats=tuple(beats),
            lag_s=0.02,
        )
        self.state, order = step(self.state, replace(seen, **more), self.plan)
        assert order is None or isinstance(order, Order)
        if order is not None:
            self.orders.append((now, order.mode))
        return None if order is None else order.mode

    def ticks(self, start: float, stop: float, every: float = 0.05, **more: Any) -> None:
        """Ticks without a heartbeat."""
        count = round((stop - start) / every)
        for i in range(count):
            self.tick(start + i * every, **more)

    @property
    def outcome(self) -> tuple[Phase, Ending | None, str]:
        return self.state.phase, self.state.ending, self.state.mode_after


# ------------------------------------------------------------------------------------------------ the start


def test_the_excitation_mode_is_asked_for_once_and_again_only_after_a_pause(plan: Plan) -> None:
    run = Run(plan)
    assert run.tick(0.0) == SYSTEMID
    assert run.tick(0.1, answer=Answer(None)) is None
    assert run.tick(START_EVERY_S + 0.01) == SYSTEMID
    assert run.state.phase is Phase.STARTING


def test_a_start_that_is_never_answered_is_given_up_and_counts_as_started_until_a_heartbeat_knows_better(
    plan: Plan,
) -> None:
    run = Run(plan)
    now = 0.0
    while run.state.phase is Phase.STARTING:
        beats = (STABILIZE,) if abs(now - round(now)) < 0.01 else ()
        run.tick(now, *beats, known_s=-1.0)  # the vehicle is heard, and answers nothing
        now += 0.1
    assert [mode for _, mode in run.orders] == [SYSTEMID] * START_TRIES
    assert run.state.phase is Phase.RETURNING
    last_ask = run.orders[-1][0]
    run.tick(now, STABILIZE, STABILIZE, STABILIZE, known_s=last_ask - 0.01)
    assert run.state.phase is Phase.RETURNING, "those three may have been said before the start arrived"
    run.tick(now + 1, STABILIZE, known_s=last_ask + 0.01)
    run.tick(now + 2, STABILIZE, known_s=last_ask + 0.02)
    run.ticks(now + 2, now + 2.1 + LOOK_S)
    assert run.outcome == (Phase.ENDED, Ending.REFUSED, "Stabilize")
    assert run.state.cleared
    assert "does not answer" in run.state.reason


def test_a_start_that_arrives_late_is_brought_back_and_only_then_cleared(plan: Plan) -> None:
    """A link 3.5 s late each way: six asks, no answer, and a vehicle that starts 3.5 s after the first."""
    run = Run(plan)
    run.ticks(0.0, 3.05)
    assert len(run.orders) == START_TRIES
    run.tick(3.5, STABILIZE, known_s=-4.0)
    run.tick(4.5, STABILIZE, known_s=-3.0)
    assert not run.state.cleared
    assert run.tick(7.0, SYSTEMID, known_s=-1.0) == STABILIZE
    for second in range(8, 11):
        run.tick(float(second), SYSTEMID, known_s=second - 8.5)
    run.tick(10.6, STABILIZE, known_s=2.0)
    run.tick(11.5, STABILIZE, known_s=2.4)
    assert run.state.phase is Phase.WATCHING
    run.ticks(11.5, 11.6 + LOOK_S)
    assert not run.state.cleared, "the sixth ask, at 2.5 s, may still be under way"
    assert run.tick(15.7, SYSTEMID, known_s=2.45) == STABILIZE
    run.tick(20.0, STABILIZE, known_s=12.0, answer=Answer(True))
    run.tick(21.0, STABILIZE, known_s=13.0)
    run.ticks(21.0, 21.1 + LOOK_S)
    assert not run.state.cleared, "the way back itself may still be under way"
    run.tick(25.2, STABILIZE, known_s=16.0)
    run.ticks(25.25, 25.3 + LOOK_S)
    assert run.state.cleared
    assert {mode for _, mode in run.orders[START_TRIES:]} == {STABILIZE}


def test_a_refusal_carries_the_vehicles_reason_and_commands_nothing(plan: Plan) -> None:
    run = Run(plan)
    run.tick(0.0)
    assert run.tick(0.3, answer=Answer(False, "No axis selected")) is None
    assert run.state.phase is Phase.RETURNING, "the refusal may be of another order than the last"
    run.tick(1.5, STABILIZE, known_s=0.3)
    run.tick(2.5, STABILIZE, known_s=1.3)
    run.ticks(2.5, 2.6 + LOOK_S)
    assert run.outcome == (Phase.ENDED, Ending.REFUSED, "Stabilize")
    assert run.state.reason == "No axis selected"
    assert [mode for _, mode in run.orders] == [SYSTEMID]


def test_a_pilot_who_changes_mode_before_the_start_is_not_talked_over(plan: Plan) -> None:
    run = Run(plan, mode=ALT_HOLD)
    assert run.tick(0.0) is None
    assert run.outcome == (Phase.ENDED, Ending.PILOT, "AltHold")
    assert run.state.cleared


def test_an_excitation_that_somebody_else_started_is_left_alone_and_nothing_may_be_written(plan: Plan) -> None:
    run = Run(plan, mode=SYSTEMID)
    assert run.tick(0.0) is None
    assert run.outcome == (Phase.ENDED, Ending.PILOT, "SystemID")
    assert not run.state.cleared


@pytest.mark.parametrize(
    ("more", "ending", "words"),
    [
        ({"lag_s": 0.6}, Ending.LATE, "0.6 s late"),
        ({"lag_s": None}, Ending.REFUSED, "no TIMESYNC"),
        ({"answer_age_s": 4.0}, Ending.LINK, "answered nothing"),
        ({"abort": "Ctrl-C"}, Ending.ABORTED, "Ctrl-C"),
        ({"lost": True}, Ending.LINK, "lost"),
    ],
)
def test_what_forbids_a_start_ends_the_run_before_anything_is_asked(
    plan: Plan, more: dict[str, Any], ending: Ending, words: str
) -> None:
    run = Run(plan)
    assert run.tick(0.0, **more) is None
    assert run.state.phase is Phase.ENDED
    assert run.state.ending is ending
    assert words in run.state.reason
    assert run.state.cleared


def test_a_heartbeat_that_was_under_way_at_the_start_is_no_pilot(plan: Plan) -> None:
    run = Run.flying(plan, confirmed=False)
    for now, known_s in ((4.0, -0.9), (4.1, -0.8), (4.2, -0.1)):
        run.tick(now, STABILIZE, known_s=known_s)
        assert run.state.phase is Phase.FLYING
    run.tick(5.2, SYSTEMID)
    assert run.state.confirmed
    other = Run.flying(plan, confirmed=False)
    other.tick(4.0, STABILIZE, known_s=0.1)
    other.tick(5.0, STABILIZE, known_s=1.1)
    assert other.state.ending is Ending.PILOT


# ------------------------------------------------------------------------------------------------ taken over


@pytest.mark.parametrize("mode", [STABILIZE, ALT_HOLD, RTL])
def test_another_mode_twice_in_mid_run_ends_it_without_a_command(plan: Plan, mode: int) -> None:
    run = Run.flying(plan)
    run.tick(4.0, mode, abort="Ctrl-C")
    assert run.state.phase is Phase.RETURNING, "a first one stops every order, and decides nothing yet"
    run.tick(5.0, mode)
    assert run.state.phase is Phase.WATCHING
    run.ticks(5.05, 5.1 + LOOK_S)
    assert run.state.phase is Phase.ENDED
    assert run.state.cleared
    run.tick(6.3 + LOOK_S, SYSTEMID, abort="Ctrl-C")
    assert run.orders == []


def test_a_single_heartbeat_of_somebody_else_with_our_vehicles_id_ends_nothing(plan: Plan) -> None:
    run = Run.flying(plan)
    run.tick(4.0, STABILIZE)
    assert run.state.phase is Phase.FLYING
    run.tick(4.8, SYSTEMID)
    assert (run.state.phase, run.state.contradictions) == (Phase.FLYING, 1)
    run.tick(5.0, abort="Ctrl-C")
    assert run.orders == [(5.0, STABILIZE)], "and the way back works"


def test_two_strange_heartbeats_in_a_row_stop_the_orders_only_until_the_excitation_shows_again(plan: Plan) -> None:
    run = Run.flying(plan)
    run.tick(4.0, STABILIZE)
    run.tick(4.3, STABILIZE)
    assert run.state.phase is Phase.WATCHING
    run.ticks(4.35, 5.0)
    assert run.orders == []
    assert run.tick(5.0, SYSTEMID) == STABILIZE
    assert run.state.contradictions == 1
    assert not run.state.cleared


def test_a_first_heartbeat_with_another_mode_stops_every_order_at_once(plan: Plan) -> None:
    run = Run.flying(plan)
    assert run.tick(4.0, SYSTEMID, abort="Ctrl-C") == STABILIZE
    assert run.tick(4.35) == STABILIZE
    run.tick(4.5, ALT_HOLD)
    run.ticks(4.55, 5.5)
    assert len(run.orders) == 2
    run.tick(5.5, ALT_HOLD)
    assert run.outcome == (Phase.WATCHING, Ending.ABORTED, "AltHold")


def test_a_failsafe_is_told_apart_from_the_pilot(plan: Plan) -> None:
    run = Run.flying(plan)
    run.tick(4.0, SYSTEMID, texts=("GCS Failsafe",))
    run.tick(4.5, RTL)
    run.tick(5.5, RTL)
    assert run.state.ending is Ending.PILOT
    assert "'GCS Failsafe'" in run.state.reason
    assert run.orders == []


def left_by_our_order(plan: Plan, **more: Any) -> Run:
    """Brought back at 4.0 s, and shown so twice, the second time knowing of the order."""
    run = Run.flying(plan)
    assert run.tick(4.0, SYSTEMID, abort="Ctrl-C") == STABILIZE
    run.tick(4.1, STABILIZE, answer=Answer(True), **more)
    run.tick(5.1, STABILIZE, known_s=3.95, **more)
    run.tick(5.15, **more)
    assert run.state.phase is Phase.WATCHING, "said before it is shown that the order has arrived"
    run.tick(6.1, STABILIZE, known_s=4.9, **more)
    return run


def test_a_vehicle_that_left_by_our_order_is_cleared_once_its_heartbeat_and_its_log_know_of_it(plan: Plan) -> None:
    run = left_by_our_order(plan, log_mode=STABILIZE)
    assert run.outcome == (Phase.ENDED, Ending.ABORTED, "Stabilize")
    assert run.state.cleared


def test_without_a_word_of_the_log_heartbeats_alone_are_watched_longer(plan: Plan) -> None:
    run = left_by_our_order(plan)
    assert run.state.phase is Phase.WATCHING, "they may be a stranger's"
    run.ticks(6.15, 6.05 + LOOK_S)
    assert not run.state.cleared
    run.ticks(6.05 + LOOK_S, 6.2 + LOOK_S)
    assert run.state.cleared


def test_while_its_own_log_shows_the_excitation_no_heartbeat_clears_it(plan: Plan) -> None:
    run = left_by_our_order(plan, log_mode=SYSTEMID)
    run.ticks(6.15, 8.0 + LOOK_S, log_mode=SYSTEMID)
    assert run.state.phase is Phase.WATCHING
    run.tick(8.05 + LOOK_S, log_mode=STABILIZE)
    assert run.state.cleared


def test_a_silence_undoes_the_proof_that_it_has_left(plan: Plan) -> None:
    run = left_by_our_order(plan)
    run.tick(11.5, STABILIZE, late_s=3.0, log_mode=STABILIZE)  # this program stood still for five seconds
    run.ticks(11.55, 12.6, log_mode=STABILIZE)
    assert not run.state.cleared
    run.tick(12.65, STABILIZE, log_mode=STABILIZE)
    run.ticks(12.7, 12.8 + LOOK_S, log_mode=STABILIZE)
    assert run.state.cleared


def test_a_late_start_that_says_so_undoes_the_proof(plan: Plan) -> None:
    run = Run.flying(plan)
    run.tick(4.0, RTL)
    run.tick(5.0, RTL)
    run.ticks(5.05, 3.9 + LOOK_S)
    run.tick(3.9 + LOOK_S, texts=("SystemID Starting: axis=10",))
    run.ticks(3.95 + LOOK_S, 6.0 + LOOK_S)
    assert not run.state.cleared


def test_right_after_a_silence_an_old_heartbeat_with_another_mode_still_stops_orders(plan: Plan) -> None:
    run = Run.flying(plan)
    run.tick(9.0, SYSTEMID, abort="Ctrl-C")  # stood still since 3.9 s
    assert len(run.orders) == 1
    run.tick(9.1, STABILIZE, late_s=1.4)
    run.ticks(9.15, 9.9)
    assert len(run.orders) == 1


# ------------------------------------------------------------------------------------------------ the way back


def test_an_abort_is_sent_at_once_and_again_only_while_the_excitation_mode_shows(plan: Plan) -> None:
    run = Run.flying(plan)
    assert run.tick(4.0, SYSTEMID, abort="Ctrl-C") == STABILIZE
    run.ticks(4.05, 6.0, answer=Answer(None))
    times = [at for at, _ in run.orders]
    assert len(times) == 6
    assert all(ASK_EVERY_S <= b - a < ASK_EVERY_S + 0.06 for a, b in pairwise(times[1:]))
    run.tick(6.9, RTL)
    run.tick(7.0, RTL)
    assert run.outcome == (Phase.WATCHING, Ending.ABORTED, "RTL")
    run.ticks(7.1, 7.5)
    assert len(run.orders) == 6


def test_an_accepted_abort_waits_for_the_next_heartbeat_before_it_is_sent_again(plan: Plan) -> None:
    run = Run.flying(plan)
    run.tick(4.0, SYSTEMID, abort="Ctrl-C")
    run.tick(4.1, answer=Answer(True))
    run.ticks(4.2, 5.2)
    assert len(run.orders) == 1
    assert run.tick(5.3, SYSTEMID) == STABILIZE


def test_an_abort_before_the_first_heartbeat_of_the_run_goes_by_the_vehicles_acceptance(plan: Plan) -> None:
    run = Run.flying(plan, confirmed=False)
    assert run.tick(4.0, abort="Ctrl-C") == STABILIZE
    assert run.tick(4.1, answer=Answer(True)) is None
    run.tick(5.0, STABILIZE, known_s=-0.1)
    assert run.state.phase is Phase.RETURNING
    run.tick(6.0, STABILIZE, known_s=0.9)
    run.tick(7.0, STABILIZE, known_s=5.8, log_mode=STABILIZE)
    run.tick(7.05, log_mode=STABILIZE)
    assert run.outcome == (Phase.ENDED, Ending.ABORTED, "Stabilize")


def test_an_abort_after_an_unanswered_start_waits_until_heartbeats_tell(plan: Plan) -> None:
    run = Run(plan)
    run.tick(0.0)
    assert run.tick(0.1, abort="Ctrl-C") is None
    assert run.state.phase is Phase.RETURNING
    assert run.tick(0.8, SYSTEMID) == STABILIZE, "the lost start had arrived"


def test_after_an_ordinary_end_only_a_later_heartbeat_brings_the_way_back(plan: Plan) -> None:
    run = Run.flying(plan)
    run.tick(31.0)
    run.tick(32.0, SYSTEMID, texts=("SystemID Finished",))
    assert (run.state.phase, run.state.ending) == (Phase.RETURNING, Ending.FINISHED)
    assert run.tick(32.5) is None
    assert run.tick(32.9, SYSTEMID) == STABILIZE


def test_a_pilot_who_takes_over_at_the_end_keeps_it(plan: Plan) -> None:
    run = Run.flying(plan)
    run.tick(31.9)
    run.tick(32.0, SYSTEMID, texts=("SystemID Finished",))
    run.tick(32.9, ALT_HOLD)
    run.tick(33.9, ALT_HOLD)
    assert run.outcome == (Phase.WATCHING, Ending.FINISHED, "AltHold")
    assert run.orders == []


@pytest.mark.parametrize("text", ["SystemID Stopped: lean=31.000000 max=30.000000", "SystemID Parameter Error"])
def test_the_vehicles_own_stop_is_told_and_it_is_brought_back(plan: Plan, text: str) -> None:
    run = Run.flying(plan)
    assert run.tick(4.0, texts=(text,)) == STABILIZE
    assert (run.state.ending, run.state.reason) == (Ending.STOPPED, text)


def test_another_axis_than_planned_is_ended(plan: Plan) -> None:
    run = Run.flying(plan)
    assert run.tick(4.0, texts=("SystemID Starting: axis=7",)) == STABILIZE
    assert run.state.ending is Ending.SETTINGS
    right = Run.flying(plan)
    right.tick(4.0, texts=("SystemID Starting: axis=10",))
    assert right.state.phase is Phase.FLYING


@pytest.mark.parametrize(
    ("more", "ending"),
    [
        ({"violations": ("p 4.00 rad/s is beyond 3.00",)}, Ending.LIMIT),
        ({"other_settings": "SID_MAGNITUDE 0.15, not 0.1"}, Ending.SETTINGS),
        ({"armed": False}, Ending.STOPPED),
    ],
)
def test_what_must_end_a_run_ends_it_at_once(plan: Plan, more: dict[str, Any], ending: Ending) -> None:
    run = Run.flying(plan)
    assert run.tick(4.0, SYSTEMID, **more) == STABILIZE
    assert run.state.ending is ending


def test_a_run_without_the_word_finished_ends_by_the_logs_time_and_by_the_clock(plan: Plan) -> None:
    run = Run.flying(plan)
    run.tick(plan.finished_s - 1.0, sweep_s=plan.finished_s + 0.6)
    assert run.state.ending is Ending.FINISHED
    run = Run.flying(plan)
    run.tick(plan.finished_s + 1.0, sweep_s=plan.finished_s + 0.3)
    assert run.state.phase is Phase.FLYING
    run.tick(plan.finished_s + 2.1)
    assert run.state.ending is Ending.FINISHED


def test_a_word_that_it_finished_long_before_it_can_have_finishes_no_run(plan: Plan) -> None:
    run = Run.flying(plan)
    assert run.tick(plan.over_s - 1.0, SYSTEMID, texts=("SystemID Finished",)) == STABILIZE
    assert run.state.ending is Ending.STOPPED
    assert run.state.reason == "it says that it finished, 1.0 s before the maneuver was over"


def test_a_vehicles_clock_that_jumps_finishes_no_run(plan: Plan) -> None:
    run = Run.flying(plan)
    run.tick(4.0, sweep_s=3600.0)
    assert run.state.phase is Phase.FLYING


def test_a_vehicle_that_hears_again_after_half_a_minute_is_still_brought_back(plan: Plan) -> None:
    """Heard all the time, but nothing reached it: it does not stay in the excitation of its own will."""
    run = Run.flying(plan)
    run.tick(4.0, SYSTEMID, answer_age_s=4.0)
    for second in range(5, 50):
        run.tick(float(second), SYSTEMID, answer_age_s=float(second))
    assert run.outcome[:2] == (Phase.RETURNING, Ending.LINK)
    assert run.tick(50.0, SYSTEMID, answer_age_s=0.1) == STABILIZE
    for second in range(51, 79):
        run.tick(float(second), SYSTEMID, answer_age_s=0.1)
    assert run.state.phase is Phase.RETURNING
    run.tick(79.0, SYSTEMID, answer_age_s=0.1)
    run.tick(80.0, SYSTEMID, answer_age_s=0.1)
    assert run.state.ending is Ending.STUCK


# ------------------------------------------------------------------------------------------------ the link and the log


def test_a_log_that_stops_while_the_link_is_heard_ends_the_run_within_two_seconds(plan: Plan) -> None:
    run = Run.flying(plan)
    now = 4.0
    while run.state.phase is Phase.FLYING:
        now += 0.05
        run.tick(now, log_age_s=now - 4.0, link_age_s=0.02)
    assert now - 4.0 == pytest.approx(LOG_SILENCE_S, abs=0.2)
    assert run.state.ending is Ending.LOG
    assert run.orders[0][1] == STABILIZE


def test_a_silence_of_the_whole_link_is_no_silence_of_the_log(plan: Plan) -> None:
    run = Run.flying(plan)
    for i in range(50):
        run.tick(4.0 + 0.05 * i, log_age_s=0.05 * i, link_age_s=0.05 * i)
    run.tick(6.5, log_age_s=2.5, link_age_s=0.0)
    run.tick(6.6, log_age_s=0.05, link_age_s=0.0)
    assert run.state.phase is Phase.FLYING


def test_a_link_that_is_late_for_a_second_ends_the_run_and_a_shorter_lag_does_not(plan: Plan) -> None:
    run = Run.flying(plan)
    run.ticks(4.0, 4.8, lag_s=0.9)
    run.tick(4.8, lag_s=0.1)
    run.ticks(4.85, 4.85 + LAG_PATIENCE_S, lag_s=0.9)
    assert run.state.phase is Phase.FLYING
    run.tick(5.0 + LAG_PATIENCE_S, SYSTEMID, lag_s=0.9)
    assert run.state.ending is Ending.LATE
    assert run.orders[0][1] == STABILIZE


def test_a_vehicle_that_is_heard_and_does_not_answer_ends_the_run(plan: Plan) -> None:
    run = Run.flying(plan)
    run.tick(4.0, SYSTEMID, answer_age_s=3.6)
    assert run.state.ending is Ending.LINK
    assert run.tick(4.9, SYSTEMID, answer_age_s=4.5) == STABILIZE, "it may be heard all the same"


def test_nothing_is_sent_on_a_lost_link_and_a_heartbeat_from_before_decides_nothing(plan: Plan) -> None:
    run = Run.flying(plan)
    run.tick(8.0, SYSTEMID)
    run.tick(8.05, lost=True)
    assert (run.state.phase, run.state.ending) == (Phase.RETURNING, Ending.LINK)
    run.ticks(8.1, 12.0, lost=True, abort="Ctrl-C")
    assert run.tick(12.05) is None, "something was heard, but no heartbeat yet"
    home = Run(plan, run.state, mode=SYSTEMID, heartbeats=run.heartbeats)
    assert run.tick(12.1, SYSTEMID) == STABILIZE, "still excited: end it at once, do not go on"
    home.tick(12.1, RTL)
    home.tick(13.1, RTL)
    assert home.outcome == (Phase.WATCHING, Ending.LINK, "RTL")
    assert home.orders == []


def test_heartbeats_that_waited_in_a_buffer_decide_nothing(plan: Plan) -> None:
    # The program was stopped for 7 s; the failsafe's RTL stands in the buffer behind five old heartbeats.
    run = Run.flying(plan)
    run.tick(8.0, SYSTEMID)
    run.tick(15.0, lost=True)
    run.tick(15.05, SYSTEMID, SYSTEMID, late_s=6.0)
    run.tick(15.1, SYSTEMID, SYSTEMID, SYSTEMID, late_s=3.0)
    run.tick(15.15, RTL, late_s=1.1)
    run.tick(15.2)
    assert run.orders == []
    run.tick(16.4, RTL)
    run.tick(17.4, RTL)
    assert run.outcome == (Phase.WATCHING, Ending.LINK, "RTL")
    assert run.orders == []


def test_an_abort_after_a_stop_of_our_own_waits_for_news(plan: Plan) -> None:
    run = Run.flying(plan)
    run.tick(8.0, SYSTEMID)
    assert run.tick(11.0, abort="Ctrl-C") is None
    assert run.state.phase is Phase.RETURNING, "no lost link yet, but three seconds of our own missing"
    assert run.tick(11.2, SYSTEMID, SYSTEMID, late_s=2.0) is None
    assert run.tick(11.3, SYSTEMID, late_s=0.3) == STABILIZE


def test_a_link_on_which_everything_is_late_is_acted_on_once_it_is_as_new_as_it_gets(plan: Plan) -> None:
    run = Run.flying(plan)
    run.tick(8.0, SYSTEMID)
    run.tick(11.7, lost=True)
    assert run.tick(12.0, SYSTEMID, late_s=3.5) is None
    assert run.tick(13.0, SYSTEMID, late_s=3.5) == STABILIZE


def test_time_without_a_link_does_not_count_against_a_vehicle_that_does_not_leave(plan: Plan) -> None:
    """A link out for 40 s in mid-chirp: heard again, the vehicle still in it is asked, and is not called stuck."""
    run = Run.flying(plan)
    run.tick(4.0, SYSTEMID)
    run.ticks(7.5, 47.5, every=0.5, lost=True)
    assert run.tick(47.6, SYSTEMID) == STABILIZE
    run.ticks(47.65, 48.6)
    assert len(run.orders) > 2
    run.tick(48.6, STABILIZE, answer=Answer(True))
    run.ticks(48.65, 49.6)
    run.tick(49.6, STABILIZE, known_s=48.6, log_mode=STABILIZE)
    run.tick(49.65, log_mode=STABILIZE)
    assert run.outcome == (Phase.ENDED, Ending.LINK, "Stabilize")
    assert run.state.cleared


def test_a_link_that_stays_lost_is_given_up_and_the_mode_is_not_known(plan: Plan) -> None:
    run = Run.flying(plan)
    run.tick(8.0, lost=True)
    run.tick(8.0 + LOST_PATIENCE_S + 1, lost=True)
    assert run.outcome == (Phase.ENDED, Ending.LINK, "unknown")
    assert "not known" in run.state.reason
    assert not run.state.cleared
    assert run.orders == []


def test_a_vehicle_that_will_not_leave_is_told_of_loudly(plan: Plan) -> None:
    run = Run.flying(plan)
    run.tick(8.0, SYSTEMID, abort="Ctrl-C")
    now = 8.0
    while run.state.phase is not Phase.ENDED:
        now += 0.5
        run.tick(now, SYSTEMID)
    assert now == pytest.approx(8.0 + STUCK_S, abs=1.0)
    assert run.outcome == (Phase.ENDED, Ending.STUCK, "SystemID")
    assert "pilot must take it" in run.state.reason
    assert not run.state.cleared


def test_a_vehicle_that_does_not_tell_is_not_waited_for_for_ever_and_not_claimed_to_be_out(plan: Plan) -> None:
    run = Run(plan)
    run.tick(0.0)
    run.tick(0.1, abort="Ctrl-C")
    now = 0.1
    while run.state.phase is not Phase.ENDED:
        now += 0.5
        run.tick(now, STABILIZE, known_s=-1.0)
    assert now == pytest.approx(UNKNOWN_S, abs=1.0)
    assert run.state.mode_after == "unknown"
    assert not run.state.cleared
