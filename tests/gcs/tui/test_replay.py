"""A recorded flight watched again: where it is, what was known then, and that nothing can be sent."""

from __future__ import annotations

import json
import threading
from dataclasses import replace
from pathlib import Path
from typing import Any, cast

import numpy as np
import pytest
from fake_app import FLYING, IDLE, app_on, screen_text, settle

from gcs.cards.envelope import Limits
from gcs.cli import fly
from gcs.errors import TippathError, UsageError
from gcs.flight.live import LiveWindow
from gcs.logs.replay import PastFlight, PastRun, past_flight
from gcs.tui.replay import NOTHING_SENT, Player, ReplayWorker
from gcs.tui.state import Mark, Replaying, Stage, as_flown

T = np.arange(0.0, 60.0, 0.02) + 100.0
QUIET = np.zeros(T.size)


def run(label: str, start_s: float, *, keep: bool = True, why: str = "gaps 0") -> PastRun:
    return PastRun(
        label=label, numbers="0.5-10 Hz", kind="chirp", start_s=start_s, stop_s=start_s + 15.0, keep=keep, why=(why,)
    )


FLIGHT = PastFlight(
    name="flight-0001",
    samples=LiveWindow(
        t=T,
        p=np.where(T > 110.0, 1.5, 0.1),
        q=QUIET,
        delta_x=QUIET,
        delta_y=QUIET,
        excitation_x=QUIET,
        excitation_y=QUIET,
    ),
    omega=np.full(T.size, 172.6),
    frequency=(T, T - 104.0),
    runs=(run("roll chirp", 105.0), run("pitch chirp", 130.0, keep=False, why="the rates did not answer")),
    card="quick",
    limits=Limits(rate=3.0),
)


def test_a_player_runs_pauses_and_moves_by_the_clock_that_is_handed_in():
    player = Player(60.0, 2.0, since_s=10.0)
    assert player.at(15.0) == 10.0
    paused = player.pausing(15.0)
    assert (paused.at(99.0), paused.paused) == (10.0, True)
    assert paused.pausing(100.0).at(101.0) == 12.0
    assert player.moved(15.0, 70.0).at(15.0) == 60.0
    assert player.moved(15.0, -3.0).at(15.0) == 0.0
    slower = player.faster(15.0, -1)
    assert (slower.speed, slower.at(15.0), slower.at(16.0)) == (1.0, 10.0, 11.0)
    assert replace(player, speed=32.0).faster(0.0, 1).speed == 32.0
    over = player.pausing(999.0)
    assert (over.at(999.0), over.paused) == (0.0, False), "from its end it begins again"


class Clock:
    def __init__(self) -> None:
        self.now = 0.0

    def __call__(self) -> float:
        return self.now


class Desk:
    """Opens anything."""

    def __init__(self) -> None:
        self.opened = threading.Event()

    def state(self):
        return IDLE.desk

    def open(self, path: str, *, wait: bool = False) -> None:
        self.opened.set()

    def cancel(self) -> None:
        pass


def worker(read=lambda path: FLIGHT) -> tuple[ReplayWorker, Clock, Desk]:
    clock, desk = Clock(), Desk()
    made = ReplayWorker(Path("flight-0001"), read=read, clock=clock, make_desk=cast(Any, lambda **_: desk))
    return made, clock, desk


def test_what_is_shown_is_what_was_known_then():
    made, clock, desk = worker()
    assert desk.opened.wait(10)
    clock.now = 2.0
    state = made.state()
    assert (state.replay, state.progress) == (
        Replaying("flight-0001", 2.0, FLIGHT.stop_s - FLIGHT.start_s, 1.0, False),
        None,
    )
    assert [one.mark for one in state.runs] == [Mark.WAITING, Mark.WAITING]
    clock.now = 12.0
    state = made.state()
    assert state.progress is not None
    assert (state.progress.elapsed_s, state.progress.frequency_hz) == (pytest.approx(7.0), pytest.approx(8.0))
    assert (state.current, state.runs[0].mark, state.runs[0].why) == (1, Mark.FLYING, ())
    assert state.use is not None
    assert state.use.rate == pytest.approx(50.0)
    assert state.vehicle is not None
    assert state.vehicle.rpm == pytest.approx(1648, abs=1)
    assert made.window(5.0).t[-1] <= 112.0
    assert (state.stage, as_flown(state).stage) == (Stage.IDLE, Stage.FLYING)
    clock.now = 46.0
    state = made.state()
    assert [one.mark for one in state.runs] == [Mark.KEEP, Mark.AGAIN]
    assert state.runs[1].why == ("the rates did not answer",)
    made.replay("before")
    assert made.state().replay.at_s == pytest.approx(29.0)
    made.replay("after")
    assert made.state().replay.at_s == pytest.approx(29.0), "none is behind"
    made.choose_run(1)
    assert made.state().replay.at_s == pytest.approx(4.0)


def test_nothing_can_be_sent():
    made, _, desk = worker()
    assert desk.opened.wait(10)
    for wish in (made.abort, made.ready, made.start, made.end_card):
        wish()
        assert made.state().said == NOTHING_SENT
        assert made.state().stage is Stage.IDLE
    for ask in (made.check, made.take_over, made.fetch_log, made.push, made.revert, lambda: made.pilot("land")):
        with pytest.raises(TippathError, match="REPLAY"):
            ask()
    assert made.state().link == ""
    assert not hasattr(made, "session")
    made.close()


def test_a_flight_that_cannot_be_read_is_told():
    tried = threading.Event()

    def read(path):
        tried.set()
        raise TippathError("there is no such log")

    made, _, _ = worker(read)
    assert tried.wait(10)
    for _ in range(1000):
        if made.state().trouble == "flight-0001 cannot be replayed: there is no such log":
            break
        threading.Event().wait(0.005)
    assert "cannot be replayed" in (made.state().trouble or "")
    assert made.window(5.0).t.size == 0
    made.replay("pause")


async def test_it_says_replay_loudly_and_its_keys_work_in_a_replay_only():
    app, engine = app_on(FLYING)
    async with app.run_test(size=(80, 24)) as pilot:
        await pilot.press("2", "p", "left", "plus")
        assert engine.asked == []
        replay = Replaying("flight-0001", 12.0, 60.0, 4.0, False)
        engine.now = replace(FLYING, stage=Stage.IDLE, replay=replay, plant=None)
        await settle(app)
        lines = screen_text(app)
        assert lines[0].startswith(" REPLAY  flight-0001  4x  0:12 of 1:00")
        assert lines[0].rstrip().endswith("F12 ABORT")
        assert any("REPLAY, nothing is sent" in line for line in lines)
        assert any("▶ 12.4 s of 30" in line for line in lines)
        await pilot.press("p", "left", "right", "plus", "minus", "up", "down")
        assert engine.asked == [
            f"replay {w}" for w in ("pause", "back", "forward", "faster", "slower", "before", "after")
        ]
        engine.asked.clear()
        await pilot.press("q")
        await pilot.pause()
        assert engine.asked == [], "nothing is aborted for leaving it"


def test_a_log_of_any_kind_is_watched_with_the_verdicts_beside_it(tmp_path: Path):
    t = np.arange(0.0, 30.0, 0.01)
    sweep = np.where((t > 5) & (t < 20), np.sin(0.3 * (t - 5) ** 2), 0.0)
    rows = np.stack([t, 0.5 * sweep, 0.1 * sweep, 0.1 * sweep, 0 * t, 0.1 * sweep, 0 * t], axis=1)
    log = tmp_path / "mine.csv"
    header = "t,p,q,delta_x,delta_y,excitation_x,excitation_y"
    np.savetxt(log, rows, delimiter=",", header=header, comments="", fmt="%.6f")
    flight = past_flight(log)
    assert flight.name == "mine.csv"
    assert (flight.start_s, flight.stop_s, flight.frequency) == (0.0, pytest.approx(29.99), None)
    (only,) = flight.runs
    assert not only.numbers.startswith("0.5")
    verdict = {
        "keep": True,
        "coherent_hz": [0.5, 9.1],
        "gaps": 0,
        "percent_of_limits": {"rate": 17.0, "attitude": None},
    }
    told = {
        "label": "roll chirp",
        "log_start_s": only.start_s - 1.0,
        "verdict": verdict,
        "maneuver": {"amplitude": 0.1},
    }
    about = {"format": "tippath.flight/1", "runs": [told], "card": "mine", "limits": {"rate_rad_s": 2.0}}
    (tmp_path / "mine.csv.flight.json").write_text(json.dumps(about))
    flight = past_flight(log)
    assert flight.runs[0].why == ("coherence 0.5-9.1 Hz", "gaps 0", "17 % of the limits")
    assert (flight.runs[0].label, flight.runs[0].numbers, flight.card) == ("roll chirp", "A 0.10", "mine")
    assert flight.limits.rate == 2.0
    with pytest.raises(TippathError, match="no log to replay"):
        past_flight(tmp_path)
    with pytest.raises(TippathError, match="no such folder or log"):
        past_flight(tmp_path / "none")


def test_a_replay_wants_a_flight_and_no_vehicle(capsys):
    import argparse

    top = argparse.ArgumentParser()
    fly.add_parser(top.add_subparsers())
    assert top.parse_args(["fly", "x", "--replay"]).replay == 1.0
    assert top.parse_args(["fly", "x", "--replay", "4x"]).replay == 4.0
    for words in (["fly", "--replay"], ["fly", "x", "--replay", "--sim", "hover"]):
        with pytest.raises(UsageError, match="--replay watches a FLIGHT"):
            fly.run(top.parse_args(words))
    with pytest.raises(SystemExit):
        top.parse_args(["fly", "x", "--replay", "0"])
    assert "such as 4" in capsys.readouterr().err
