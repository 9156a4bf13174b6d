"""The app's engine: two steps to a start, and everything that calls a waiting run off. No vehicle, no sleeping."""

from __future__ import annotations

import threading
import time
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from flown_folder import fly_folder
from flying import TWO_CHIRPS

import gcs.analysis.clearance
import gcs.analysis.pushing
import gcs.tui.card_flight
import gcs.tui.vehicle_link
from gcs.analysis.clearance import cleared_again
from gcs.analysis.pushing import NotClearedError
from gcs.analysis.standing import NOT_ASKED
from gcs.cards.envelope import Limits, Peaks, Use
from gcs.cards.maneuver import load_card, parse_card
from gcs.desk import Choice
from gcs.errors import LinkError, TippathError
from gcs.flight.flown_card import Briefing, SweepResult
from gcs.flight.flyable import NotReadyError
from gcs.flight.folder import FlightFolder
from gcs.flight.gains import PushResult
from gcs.flight.identified import Objection
from gcs.flight.live import LiveWindow
from gcs.flight.preflight import Check
from gcs.flight.prepare import Prepared
from gcs.flight.recorder import RecordedLog, RecordingSummary
from gcs.flight.run import RunProgress, RunReady, RunResult
from gcs.flight.run_state import Ending, Phase
from gcs.flight.verdict import Verdict
from gcs.link.log_end import EndState, LogEnd
from gcs.tui.card_views import unlocked, view_of
from gcs.tui.state import Mark, Stage
from gcs.tui.worker import FlightWorker
from gcs.vehicle.autopilots import SYSTEMID, LinkLoss
from gcs.vehicle.profile import Plan, bundled_profiles
from gcs.vehicle.snapshot import Beat, VehicleSnapshot
from sysid.control import judgement

WITHIN_S = 60.0
"""By the wall clock, and only where something is wrong: what is waited for comes at once."""
REACHED = LogEnd(state=EndState.REACHED)
VEHICLE = VehicleSnapshot(
    system=1, component=1, link_age_s=0.1, lost=False, mode=0, mode_name="Stabilize", armed=True, rpm=1650.0,
    p=0.1, q=0.2, attitude_at_s=1.0,
)  # fmt: skip


def beat(number: int, mode: int) -> Beat:
    now = time.monotonic()
    return Beat(
        number=number,
        at_s=now,
        mode=mode,
        mode_name="Stabilize" if mode == 0 else "SystemID",
        armed=True,
        status=4,
        known_s=now,
        late_s=0.1,
    )


class FakeSession:
    link = "udpin:127.0.0.1:1"

    station = 254

    def __init__(self) -> None:
        self.now = VEHICLE
        self.called: list[str] = []
        self.asked_together = 0
        self.settings = {"LOG_BACKEND_TYPE": 1.0}
        self.answers_log: bool | None = None
        self.closed = threading.Event()

    def snapshot(self) -> VehicleSnapshot:
        return self.now

    def samples(self, last_s: float) -> LiveWindow:
        none = np.empty(0)
        return LiveWindow(t=none, p=none, q=none, delta_x=none, delta_y=none, excitation_x=none, excitation_y=none)

    def call(self, procedure, timeout_s=None, *, cancelled=None):
        if type(procedure).__name__ == "ReadSeveral":
            self.asked_together += 1
            answers = {name: type("Value", (), {"value": value}) for name, value in self.settings.items()}
            return {name: answers.get(name) for name in procedure._reads}
        self.called.append(type(procedure).__name__)
        if type(procedure).__name__ == "SetMode":
            beats = (beat(2, 0), beat(3, 0))
            self.now = replace(self.now, mode=0, mode_name="Stabilize", beats=beats, heartbeats=3)
            return None
        return type("Value", (), {"value": 0.0})()

    def log_health(self):
        return None

    def answer_log(self, wanted=True, *, at_once=False):
        self.answers_log = wanted

    def answered_rate(self):
        return None

    def texts_since(self, cursor):
        return 0, []

    def close(self) -> None:
        self.closed.set()


class FakeCard:
    """Stands in for `fly_card`: two runs by the same calls back, and what became of each."""

    def __init__(self) -> None:
        self.flown: list[str] = []
        self.aborts: list[str | None] = []
        self.flying = threading.Event()
        self.land = threading.Event()
        self.folder: Path | None = None
        self.probe: bool | None = None
        self.seen = tuple
        """The checks as they stand later; none: as they were."""
        self.leave = None
        """What flies a log into the folder, where there is to be one."""

    def __call__(
        self,
        session,
        card,
        profile,
        *,
        folder,
        confirm,
        on_progress,
        aborted,
        about,
        probe,
        log,
        left_out,
        earlier,
        choosing,
    ):
        self.folder, self.probe = folder.path, probe
        planned = [(run, _plan(run)) for run in (card.runs() if earlier is None else earlier.left)]
        loss = LinkLoss("returns home after 5 s", True)
        assert confirm(
            Briefing(
                card=card,
                plans=tuple(planned),
                checks=(Check("trim", "centred"),),
                link_loss=loss,
                profile=None,
                seen=self.seen,
            )
        )
        results: list[RunResult] = []
        left = list(planned[:2])
        while left:
            run, plan = left[0]
            on_progress(RunReady(run, plan))
            wish = choosing.chosen()
            if wish is not None:
                left.sort(key=lambda one: one[0].number != wish)
                continue
            self.aborts.append(aborted())
            ending = self._fly(run, plan, on_progress, aborted)
            results.append(_result(run, plan, ending, aborted() or ""))
            on_progress(results[-1])
            if ending is Ending.FINISHED:
                left.remove((run, plan))
            elif not choosing.again(results[-1]):
                break
        stopped = "" if results[-1].ending is Ending.FINISHED else results[-1].reason
        recording = None
        if self.leave is not None:
            log = self.leave(folder.path).log
            recorded = RecordedLog(path=log, blocks=1, expected=1, missing=(), duplicates=0, end=REACHED)
            recording = RecordingSummary(
                directory=folder.path, logs=(recorded,), tlog=None, tlog_frames=0, how="streamed", problems=()
            )
        return SweepResult(
            card=card,
            profile=profile,
            runs=tuple(results),
            planned=2,
            folder=FlightFolder(folder.path),
            recording=recording,
            stopped=stopped,
            link_loss=loss,
        )

    def _fly(self, run, plan, on_progress, aborted) -> Ending:
        if aborted() is not None:
            return Ending.ABORTED
        self.flown.append(run.label)
        on_progress(
            RunProgress(
                run=run,
                plan=plan,
                phase=Phase.FLYING,
                elapsed_s=3.0,
                frequency_hz=1.5,
                peaks=Peaks(p=0.5),
                use=Use(16.0, 1.0, 2.0),
                snapshot=VEHICLE,
            )
        )
        self.flying.set()
        while aborted() is None and not self.land.wait(0.01):
            pass
        self.flying.clear()
        return Ending.FINISHED if aborted() is None else Ending.ABORTED


def _plan(run) -> Plan:
    return Plan(
        maneuver=run.maneuver,
        writes=(),
        asked={},
        words="Table 1",
        axis_number=10,
        mode=SYSTEMID,
        lead_s=1.0,
        over_s=16.0,
        finished_s=17.0,
    )


def _result(run, plan, ending, reason) -> RunResult:
    keep = ending is Ending.FINISHED
    verdict = Verdict(
        keep=keep,
        reasons=() if keep else (reason,),
        samples=100,
        expected=100,
        missing=0,
        gaps=0,
        use=Use(1.0, 1.0, 1.0),
        coherent_hz=(0.5, 9.0),
        coherent_share=0.9,
    )
    return RunResult(
        run=run,
        plan=plan,
        ending=ending,
        reason=reason,
        mode_after="Stabilize",
        started="now",
        duration_s=1.0,
        log_start_s=1.0,
        peaks=Peaks(),
        verdict=verdict,
    )


def as_it_is(session, card, *, otherwise, **_):
    """What this vehicle can fly of a card: all of it."""
    return Prepared(card or otherwise, bundled_profiles()[0])


@pytest.fixture
def engine(monkeypatch, tmp_path):
    card, session = FakeCard(), FakeSession()
    monkeypatch.setattr(gcs.tui.card_flight, "fly_card", card)
    monkeypatch.setattr(gcs.tui.card_flight, "prepared", as_it_is)
    made = FlightWorker("udpin:127.0.0.1:1", folder=tmp_path, card="quick", open_session=lambda *a, **k: session)
    made.fake_card, made.fake_session = card, session
    reach(made, Stage.IDLE)
    yield made
    card.land.set()
    made.close()
    assert session.closed.is_set()


def until(condition) -> None:
    wait = threading.Event()
    for _ in range(int(WITHIN_S / 0.005)):
        if condition():
            return
        wait.wait(0.005)
    raise AssertionError("it did not come about")


def reach(engine, stage, so=lambda state: True) -> None:
    until(lambda: engine.state().stage is stage and so(engine.state()))


def left_in(folder: Path, card: str = "quick") -> Path:
    """A flight of which the first run was flown, its log on the vehicle's card."""
    flight = FlightFolder(folder / "flight-0003")
    flight.path.mkdir()
    bundled = load_card(card)
    flight.write_card(bundled.text)
    first = bundled.runs()[0]
    run = {"label": first.label, "maneuver": first.maneuver.to_json(), "ending": "finished"}
    flight.write({"ended": None, "log": "card", "runs": [run | {"verdict": {"keep": None, "log": "card"}}]})
    return flight.path


def test_what_is_left_of_a_flight_is_offered_and_goes_on(engine, tmp_path):
    assert engine.state().unfinished is None
    flight = left_in(tmp_path)
    engine.choose_card(f"--resume {flight}")
    state = engine.state()
    total = len(state.runs)
    assert state.said == f"flight-0003: 1 of {total} runs flown and kept"
    assert [run.mark for run in state.runs[:2]] == [Mark.KEEP, Mark.WAITING]
    engine.ready()
    reach(engine, Stage.READY)
    assert engine.state().current == 2, "the first is not made ready again"
    engine.start()
    until(engine.fake_card.flying.is_set)
    engine.abort()
    reach(engine, Stage.HELD)
    engine.end_card()
    reach(engine, Stage.IDLE)
    assert engine.fake_card.folder == flight
    assert engine.fake_card.probe is False, "its log stays on the card"
    until(lambda: engine.state().unfinished == flight)
    assert engine.state().left == f"1 of {total} runs flown and kept"
    assert engine.state().commands[-1] == f"tippath sweep --connect udpin:127.0.0.1:1 --resume {flight}"


def test_a_flight_of_which_nothing_is_left_does_not_go_on(engine, tmp_path):
    flight = FlightFolder(left_in(tmp_path))
    (run,) = flight.runs()
    others = [run | {"label": r.label, "maneuver": r.maneuver.to_json()} for r in load_card("quick").runs()]
    flight.write(flight.read() | {"runs": others})
    with pytest.raises(TippathError, match="nothing is left to fly"):
        engine.choose_card(f"--resume {flight.path}")
    with pytest.raises(TippathError, match="no such folder"):
        engine.choose_card("--resume nowhere")


def test_a_log_that_the_vehicle_keeps_is_not_answered_and_one_that_it_streams_after_a_reboot_is(engine):
    session = engine.fake_session
    until(lambda: session.answers_log is False)
    session.settings["LOG_BACKEND_TYPE"] = 3.0
    session.now = replace(session.now, reboots=1)
    until(lambda: session.answers_log is True)


def test_the_vehicle_is_looked_at_for_the_card_and_a_reboot_makes_that_old(engine):
    session = engine.fake_session
    session.settings |= {"SID_AXIS": 0.0, "SID_MAGNITUDE": 0.05}
    session.now = replace(session.now, lag_s=0.02, answer_age_s=0.1, autopilot=3, vehicle_type=4, status=3)
    engine.check()
    found = engine.state().readiness
    assert {item.name for item in found.items} >= {"LOG_BACKEND_TYPE", "card", "mode"}
    assert not found.ready, "card quick has doublets, which this vehicle does not fly"
    session.now = replace(session.now, reboots=1)
    until(lambda: engine.state().readiness is None)


def test_nothing_is_looked_at_while_a_card_is_flown(engine):
    engine.ready()
    reach(engine, Stage.READY)
    with pytest.raises(TippathError, match="before and after"):
        engine.check()


def test_nothing_starts_without_ready(engine):
    engine.start()
    assert "R first" in engine.state().said
    assert engine.state().stage is Stage.IDLE
    assert engine.fake_card.folder is None


def test_a_start_that_comes_too_early_is_told(engine):
    engine.ready()
    engine.start()
    if engine.state().stage is Stage.CHECKING:
        assert "too early" in engine.state().said
    reach(engine, Stage.READY)
    assert engine.state().said == "", "once it stands there, it is over"
    engine.start()
    assert engine.fake_card.flying.wait(WITHIN_S)
    engine.start()
    assert "not yet" in engine.state().said


def test_the_checks_of_a_run_that_waits_are_made_again(engine):
    seen: list[Check] = []
    engine.fake_card.seen = lambda: tuple(seen)
    engine.ready()
    reach(engine, Stage.READY)
    seen.append(Check("trim", "off by now", False))
    until(lambda: engine.state().checks == (Check("trim", "off by now", False),))


def test_ready_then_start_flies_and_each_run_asks_again(engine):
    engine.ready()
    reach(engine, Stage.READY)
    state = engine.state()
    assert (state.current, state.link_loss) == (1, "if the link drops: returns home after 5 s")
    assert state.checks == (Check("trim", "centred"),)
    assert engine.fake_card.flown == []
    assert engine.fake_card.probe is True, "the app did not start this vehicle itself"
    engine.start()
    assert engine.fake_card.flying.wait(WITHIN_S)
    assert engine.state().progress.frequency_hz == 1.5
    engine.fake_card.land.set()
    reach(engine, Stage.HELD)
    assert engine.state().current == 2
    assert engine.state().use is None, "no bars of the last run while nothing flies"
    assert engine.state().runs[0].mark is Mark.KEEP
    engine.start()
    assert engine.state().stage is Stage.HELD, "the second run needs its own ready"
    assert "R first" in engine.state().said
    engine.ready()
    assert engine.state().stage is Stage.READY
    engine.start()
    reach(engine, Stage.IDLE)
    assert engine.fake_card.flown == ["roll chirp", "pitch chirp"]
    assert "2 of 2 runs kept" in engine.state().said
    assert engine.state().commands[-1].startswith("tippath sweep --connect udpin:127.0.0.1:1 --card quick -o ")
    assert [run.mark for run in engine.state().runs] == [Mark.KEEP, Mark.KEEP, Mark.SKIPPED, Mark.SKIPPED]


def test_abort_in_flight_ends_the_run_which_waits_to_be_flown_again(engine):
    engine.ready()
    reach(engine, Stage.READY)
    engine.start()
    assert engine.fake_card.flying.wait(WITHIN_S)
    engine.abort()
    reach(engine, Stage.HELD)
    assert engine.state().current == 1
    assert engine.state().runs[0].mark is Mark.NEXT
    assert "F12" in engine.state().said
    engine.start()
    assert engine.fake_card.flown == ["roll chirp"], "nothing starts that was not made ready"
    engine.fake_card.land.set()
    engine.ready()
    engine.start()
    reach(engine, Stage.HELD, lambda state: state.current == 2)
    assert engine.state().runs[0].mark is Mark.KEEP
    engine.end_card()
    reach(engine, Stage.IDLE)
    assert engine.fake_card.flown == ["roll chirp", "roll chirp"]
    assert "1 of 2 runs kept" in engine.state().said
    assert "the card was ended here" in engine.state().said


def test_another_run_is_chosen_while_one_waits(engine):
    engine.choose_run(2)
    assert "between two runs" in engine.state().said
    engine.ready()
    reach(engine, Stage.READY)
    engine.choose_run(2)
    reach(engine, Stage.HELD, lambda state: state.current == 2)
    assert engine.state().runs[0].mark is Mark.WAITING
    engine.start()
    assert engine.fake_card.flown == [], "the other run wants its own R"
    engine.ready()
    engine.choose_run(2)
    assert engine.state().stage is Stage.READY, "it is the next already"
    engine.start()
    assert engine.fake_card.flying.wait(WITHIN_S)
    engine.choose_run(1)
    assert "between two runs" in engine.state().said
    engine.fake_card.land.set()
    reach(engine, Stage.HELD, lambda state: state.current == 1)
    assert engine.fake_card.flown == ["pitch chirp"]
    engine.end_card()
    reach(engine, Stage.IDLE)


def test_a_ready_that_comes_while_the_vehicle_is_looked_at_is_not_lost(engine):
    engine.ready()
    reach(engine, Stage.READY)
    engine._card._judged(
        _result(load_card("quick").runs()[0], _plan(load_card("quick").runs()[0]), Ending.FINISHED, "")
    )
    assert engine.state().stage is Stage.CHECKING
    engine.ready()
    assert "R is taken" in engine.state().said
    assert engine.state().stage is Stage.CHECKING, "nothing is ready yet"


@pytest.mark.parametrize("lost", [True, False])
def test_a_second_abort_is_sent_unheard_only_while_the_link_is_lost(engine, lost: bool) -> None:
    engine.ready()
    reach(engine, Stage.READY)
    card = engine._card
    engine._moment.set(stage=Stage.ABORTING)  # as the run's end by the link shows
    engine._link.session.now = replace(VEHICLE, lost=lost)
    engine.abort()
    assert card.blind() is lost
    assert ("unheard" in engine.state().said) is lost
    engine._moment.set(stage=Stage.READY)
    engine.abort()
    engine.end_card()


def test_abort_while_ready_calls_off_and_moves_nothing(engine):
    engine.ready()
    reach(engine, Stage.READY)
    engine.abort()
    assert engine.state().stage is Stage.HELD
    engine.start()
    assert engine.fake_card.flown == []
    engine.end_card()
    reach(engine, Stage.IDLE)
    assert engine.fake_card.flown == []


def test_abort_on_the_heels_of_a_start_wins(engine):
    engine.ready()
    reach(engine, Stage.READY)
    with engine._moment.lock:  # the card's thread cannot see the start before the abort
        engine.start()
        engine.abort()
    assert not engine.fake_card.flying.wait(0.25)
    assert engine.state().stage is Stage.HELD
    engine.end_card()
    reach(engine, Stage.IDLE)
    assert engine.fake_card.flown == []


@pytest.mark.parametrize(
    ("change", "word"),
    [
        ({"lost": True, "link_age_s": 4.0}, "link was lost"),
        ({"armed": False}, "disarmed"),
        ({"mode": 6, "mode_name": "RTL"}, "RTL: the pilot has it"),
    ],
)
def test_what_happens_while_a_run_waits_calls_it_off(engine, change, word):
    engine.ready()
    reach(engine, Stage.READY)
    engine.fake_session.now = replace(VEHICLE, **change)
    reach(engine, Stage.IDLE)
    assert word in engine.state().said
    engine.fake_session.now = VEHICLE
    engine.start()
    assert engine.fake_card.flown == [], "nothing resumes unasked"


def test_closing_in_flight_aborts_first(engine):
    engine.ready()
    reach(engine, Stage.READY)
    engine.start()
    assert engine.fake_card.flying.wait(WITHIN_S)
    engine.close()
    assert engine.fake_session.closed.is_set()
    assert not engine.fake_card.flying.is_set(), "the run had ended before the link was let go"
    assert engine.state().runs[0].mark is Mark.AGAIN


def test_a_fault_in_the_card_is_told_and_ends_it(engine, monkeypatch):
    def broken(*args, **kwargs):
        raise RuntimeError("no such thing")

    monkeypatch.setattr(gcs.tui.card_flight, "fly_card", broken)
    engine.ready()
    until(lambda: "no such thing" in engine.state().said)
    assert engine.state().stage is Stage.IDLE


def test_a_card_that_cannot_be_flown_leaves_no_folder(engine, monkeypatch, tmp_path):
    def refuse(session, card, **_):
        raise NotReadyError("not ready: not armed")

    monkeypatch.setattr(gcs.tui.card_flight, "prepared", refuse)
    engine.ready()
    until(lambda: engine.state().said == "not ready: not armed")
    reach(engine, Stage.IDLE)
    assert list(tmp_path.iterdir()) == []
    assert engine.state().flight is None


def test_f12_ends_an_excitation_of_somebody_else(engine):
    excited = (beat(1, SYSTEMID),)
    engine.fake_session.now = replace(VEHICLE, mode=SYSTEMID, mode_name="SystemID", beats=excited, heartbeats=1)
    engine.abort()
    until(lambda: "SetMode" in engine.fake_session.called)
    until(lambda: engine.state().said == "the mode is Stabilize")


def test_f12_commands_no_mode_where_nothing_is_excited(engine):
    engine.abort()
    assert engine.state().said == "nothing to abort: no maneuver is running"
    assert "SetMode" not in engine.fake_session.called


def test_no_card_is_changed_and_no_gains_moved_in_flight(engine):
    engine.ready()
    reach(engine, Stage.READY)
    for forbidden in (lambda: engine.choose_card("hover"), engine.push, engine.revert, engine.fit):
        with pytest.raises(TippathError, match="card is"):
            forbidden()


def test_gains_are_not_pushed_to_an_armed_vehicle(engine):
    with pytest.raises(TippathError, match="armed"):
        engine.push()
    with pytest.raises(TippathError, match="armed"):
        engine.revert()
    assert set(engine.fake_session.called) <= {"ReadParameter"}


def test_there_is_no_pilot_on_a_link_that_the_app_did_not_make(engine):
    assert not engine.state().simulated
    with pytest.raises(TippathError, match="no simulated pilot"):
        engine.pilot("takeoff")


def test_telemetry_is_shown_until_the_log_comes(engine):
    until(lambda: engine.window(10.0).t.size == 1)
    engine.fake_session.now = replace(VEHICLE, attitude_at_s=1.1, p=0.3)
    until(lambda: engine.window(10.0).t.size == 2)
    window = engine.window(10.0)
    assert window.p.tolist() == [0.1, 0.3]
    assert np.isnan(window.delta_x).all()


def test_what_was_flown_lies_on_the_desk_by_itself(engine, tmp_path):
    """The card's log is read away from the card's thread; nobody has to open anything."""
    engine.fake_card.leave = lambda folder: fly_folder(folder, None, TWO_CHIRPS)
    engine.ready()
    reach(engine, Stage.READY)
    engine.start()
    assert engine.fake_card.flying.wait(WITHIN_S)
    with pytest.raises(TippathError, match="card is"):
        engine.open_flight(str(tmp_path))
    engine.fake_card.land.set()
    reach(engine, Stage.HELD)
    engine.end_card()
    until(lambda: engine.state().desk.path == tmp_path / "flight-0001")
    state = engine.state()
    assert [(run.axis, run.choice) for run in state.desk.runs] == [("roll", Choice.FIT), ("pitch", Choice.FIT)]
    assert state.flight == state.desk.path
    engine.fit()
    state = engine.state()
    assert state.desk.path == tmp_path / "flight-0001"
    assert state.fitted.commands == state.commands[-2:] == state.desk.commands[-2:]
    engine.design()
    state = engine.state()
    assert state.designed.crc == state.desk.designed.crc
    assert state.said == "gains designed"
    with pytest.raises(TippathError, match="no such folder"):
        engine.open_flight(str(tmp_path / "nowhere"))
    assert engine.state().fitted is not None, "what was there stays"


def test_no_flight_is_no_fit(engine, tmp_path):
    with pytest.raises(TippathError, match="no flight yet"):
        engine.fit()
    with pytest.raises(TippathError, match="no log"):
        engine.open_flight(str(tmp_path))
    with pytest.raises(TippathError, match="no flight yet"):
        engine.design()


def take_pushes(monkeypatch, push, objections=()):
    """Pushes go here instead of to a vehicle, which has this against them."""
    monkeypatch.setattr(gcs.analysis.pushing, "require_ready", lambda session: None)
    monkeypatch.setattr(gcs.analysis.pushing, "objections", lambda session, then: tuple(objections))
    monkeypatch.setattr(gcs.analysis.pushing, "push", push)


def test_another_vehicle_than_the_identified_one_is_pushed_to_with_words_why_only(engine, tmp_path, monkeypatch):
    flight = fly_folder(tmp_path / "flight-0007", None, TWO_CHIRPS)
    engine.open_flight(str(flight.path))
    engine.fit()
    engine.design()
    engine.fake_session.now = replace(VEHICLE, armed=False)
    sent = []

    def push(session, gains, *, on_progress):
        sent.append(gains.crc)
        return PushResult(gains.crc, 0xABCDEF, True, gains.values, False)

    against = Objection(kind="filters", words="filters: not as identified: INS_GYRO_FILTER was 0, is 20")
    take_pushes(monkeypatch, push, [against])
    with pytest.raises(NotClearedError, match="INS_GYRO_FILTER was 0, is 20; nothing was written") as refused:
        engine.push()
    assert (refused.value.reason, sent) == ("filters", [])
    engine.push("it is the same gyro")
    assert flight.audited()[0][-1].did.endswith("because: it is the same gyro")
    assert len(sent) == 1


def test_pushed_gains_are_in_the_flight_s_audit(engine, tmp_path, monkeypatch):
    flight = fly_folder(tmp_path / "flight-0007", None, TWO_CHIRPS)
    engine.open_flight(str(flight.path))
    engine.fit()
    engine.design()
    crc = engine.state().desk.designed.crc
    engine.fake_session.now = replace(VEHICLE, armed=False)

    def push(session, gains, *, on_progress):
        on_progress("the shadow bank")
        assert gains.crc == crc
        assert gains.identified.parameters["SCHED_LOOP_RATE"] == 500
        return PushResult(gains.crc, 0xABCDEF, True, gains.values, False)

    take_pushes(monkeypatch, push)
    assert not engine.state().desk.designed.clearance.standing.complete
    engine.push()
    last = flight.audited()[0][-1]
    assert last.did == f"pushed gains {crc:06x}, before abcdef"
    assert last.command == engine.state().commands[-1]
    assert last.by == "app"
    assert cleared_again(engine.state().desk.designed.path).standing == NOT_ASKED


def test_gains_that_fail_are_pushed_with_words_why_only_and_the_audit_has_them(engine, tmp_path, monkeypatch):
    flight = fly_folder(tmp_path / "flight-0007", None, TWO_CHIRPS)
    engine.open_flight(str(flight.path))
    engine.fit()
    monkeypatch.setattr(gcs.analysis.clearance, "Limits", partial(judgement.Limits, gain_db=60.0))
    engine.design()
    engine.fake_session.now = replace(VEHICLE, armed=False)
    sent = []

    def push(session, gains, *, on_progress):
        sent.append(gains.crc)
        return PushResult(gains.crc, 0xABCDEF, True, gains.values, False)

    take_pushes(monkeypatch, push)
    with pytest.raises(TippathError, match=r"not cleared: TPP: gain margin .* nothing was sent") as refused:
        engine.push()
    assert (refused.value.reason, sent) == ("margins", [])
    engine.push("a tethered rig")
    last = flight.audited()[0][-1]
    assert last.did.endswith("although something speaks against them, because: a tethered rig")
    assert "--why 'a tethered rig'" in last.command
    assert len(sent) == 1


def test_no_vehicle_is_told_and_tried_again(monkeypatch, tmp_path):
    monkeypatch.setattr(gcs.tui.vehicle_link, "AGAIN_S", 0.01)
    tries = threading.Semaphore(0)
    session = FakeSession()

    def open_session(link, **_):
        tries.release()
        if not opened.is_set():
            raise LinkError(f"no vehicle at {link}: nothing heard")
        return session

    opened = threading.Event()
    engine = FlightWorker("udpin:127.0.0.1:1", folder=tmp_path, open_session=open_session)
    try:
        assert tries.acquire(timeout=WITHIN_S)
        until(lambda: engine.state().trouble == "no vehicle at udpin:127.0.0.1:1: nothing heard")
        engine.ready()
        assert engine.state().said == "there is no vehicle"
        opened.set()
        reach(engine, Stage.IDLE)
        assert engine.state().trouble is None
    finally:
        engine.close()


@pytest.mark.parametrize(
    ("peaks", "ending", "mark", "said"),
    [
        (Peaks(p=0.1, q=0.1), Ending.FINISHED, Mark.WAITING, ()),
        (Peaks(p=99.0, q=0.1), Ending.FINISHED, Mark.LOCKED, "of the limits"),
        (Peaks(p=0.1, q=0.1), Ending.ABORTED, Mark.LOCKED, "is clean"),
    ],
)
def test_a_run_that_stays_locked_says_what_holds_it(peaks, ending, mark, said):
    chirp = '[[maneuver]]\nkind = "chirp"\naxis = "roll"\namplitude = 0.1\nduration_s = 30\n'
    runs = parse_card(f'name = "built up"\n{chirp}[[step]]\namplitude = 0.5\n', "x").runs()
    higher = next(run for run in runs if run.locked_by is not None)
    lower = next(run for run in runs if run.number == higher.locked_by)
    flown = replace(_result(lower, _plan(lower), ending, "F12"), peaks=peaks)
    views = unlocked([view_of(run) for run in runs], runs, [flown], Limits())
    view = next(one for one in views if one.number == higher.number)
    assert view.mark is mark
    assert view.why == () if said == () else said in view.why[0]
    assert "stays locked" not in "".join(view.why), "the mark says that"


def test_the_card_brings_its_limits(engine):
    assert engine.state().limits == Limits()
