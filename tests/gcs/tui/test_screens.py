"""Every screen at both sizes and at every moment: nothing outside or covered, what is next said, F12 from anywhere."""

from __future__ import annotations

import asyncio
import itertools
import threading
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from fake_app import (
    ANALYSED,
    CHECKED,
    DESIGNED,
    FITTED,
    FLYING,
    IDLE,
    MOMENTS,
    RECORDING,
    VEHICLE,
    app_on,
    screen_text,
    settle,
)
from fake_desk import CLEARED, DESKS, MODEL, answer
from more_of_a_kind import thorough
from rich.cells import cell_len
from textual.geometry import Region
from textual.widgets import Input

from gcs.analysis.text.blocks import Block, Sentence
from gcs.desk import DeskState, TimedNote
from gcs.flight.live import LiveWindow
from gcs.tui.app import TippathApp
from gcs.tui.base import Dialog
from gcs.tui.widgets.canvas import Canvas
from gcs.tui.widgets.lines import Lines
from gcs.vehicle.snapshot import Text
from sysid.control.judgement import Limits, judge
from sysid.control.regulator import design

SIZES = [(80, 24), (120, 40), (200, 50)]
SCREENS = tuple("123456789")


async def workers_done(app: TippathApp, pilot) -> None:
    await app.workers.wait_for_complete()
    await pilot.pause()


def fits(app: TippathApp, where: str, size: tuple[int, int]) -> None:
    """Nothing outside, nothing covered, the abort key and what is next are there."""
    width, height = size
    lines = screen_text(app)
    assert lines[0].rstrip().endswith("F12 ABORT"), where
    assert any(line.startswith(" next: ") for line in lines), where
    boxes = [box for box in app.screen.query(Lines) if shown(box) and box.id != "text" and box.region]
    assert len(boxes) >= 4, where
    for box in boxes:
        assert Region(0, 0, width, height).contains_region(box.region), f"{where}: #{box.id} is outside"
        wide = [line for line in box.shown.splitlines() if cell_len(line) > box.region.width]
        assert not wide, f"{where}: #{box.id} is cut: {wide}"
        assert len(box.shown.splitlines()) <= box.region.height, f"{where}: #{box.id} is cut below"
    for text in app.screen.query("#text").results(Lines):
        wide = [line for line in text.shown.splitlines() if cell_len(line) > text.parent.size.width]
        assert not shown(text) or not wide, f"{where}: the text is cut: {wide}"
    drawn = [box for box in app.screen.query(Canvas) if shown(box)]
    for box in drawn:
        assert Region(0, 0, width, height).contains_region(box.region), f"{where}: #{box.id} is outside"
        assert box.region.height >= 4, f"{where}: #{box.id} is too low to be read"
    for one, other in itertools.combinations([*boxes, *drawn], 2):
        assert not one.region.intersection(other.region), f"{where}: #{one.id} covers #{other.id}"


def shown(box) -> bool:
    return all(one.display for one in box.ancestors_with_self if hasattr(one, "display"))


@pytest.mark.parametrize("size", [SIZES[0], *thorough([(SIZES[1],)])])
async def test_every_screen_at_every_moment_of_a_flight_fits_and_says_what_is_next(size):
    app, engine = app_on(IDLE)
    async with app.run_test(size=size) as pilot:
        for key in ("2", "1", "3", "8", "question_mark"):
            await pilot.press(key)
            for name, state in MOMENTS.items():
                if key != "2" and name not in ("no vehicle", "refused", "flying", "hardware", "lost", "designed"):
                    continue  # the others hardly change
                if size != SIZES[0] and name not in ("no vehicle", "refused", "flying", "designed"):
                    continue
                engine.now = state
                await settle(app)
                fits(app, f"{name} on screen {key}", size)


@pytest.mark.parametrize("size", [SIZES[0], *thorough((size,) for size in SIZES[1:])])
async def test_every_screen_at_every_moment_of_the_analysis_fits_and_says_what_is_next(size):
    app, engine = app_on(IDLE)
    async with app.run_test(size=size) as pilot:
        for key in "3456789":
            await pilot.press(key)
            for name, state in ANALYSED.items():
                if name in NOT_NEW.get(key, ()) or (size != SIZES[0] and name not in ("open", "compared", "designed")):
                    continue
                engine.now = state
                await settle(app)
                fits(app, f"{name} on screen {key}", size)
                if (name, key) not in VIEWED:
                    continue
                for view in "vvvv" if key == "5" else "pw" if key == "7" else "v":
                    await pilot.press(view)
                    await settle(app)
                    fits(app, f"{name} on screen {key}, view {view}", size)
                if key == "7":
                    await pilot.press("escape")


VIEWED = (("compared", "4"), ("compared", "5"), ("complete", "6"), ("complete", "7"), ("designed", "8"))
"""Where all views of a screen are looked at."""
NOT_NEW = {
    "3": ("fitted", "compared", "asking", "asked", "unexplained", "added", "complete", "designed", "reported"),
    "4": ("asking", "asked", "unexplained", "complete", "reported"),
    "5": ("fitting", "designed", "reported", "unkept"),
    "6": ("designed", "reported", "unkept"),
    "7": ("designed", "reported", "unkept"),
    "8": ("asking", "asked", "unexplained", "added"),
    "9": ("fitting", "compared", "asking", "asked", "unexplained", "added", "complete"),
}
"""Moments at which a screen shows what it showed before."""


@pytest.mark.thorough
async def test_what_to_set_stands_on_connect_the_worst_in_sight():
    app, engine = app_on(CHECKED)
    async with app.run_test(size=(80, 24)) as pilot:
        await pilot.press("1")
        await settle(app)
        assert "answering the vehicle's log so that it can be armed" in "\n".join(screen_text(app))
        assert "C check" in "\n".join(screen_text(app))
        await pilot.press("c")
        await workers_done(app, pilot)
        assert engine.asked == ["check"]
        await settle(app)
        fits(app, "readiness", (80, 24))
        text = "\n".join(screen_text(app))
        for words in ("set LOG_BACKEND_TYPE 1 and restart", "a failsafe is active", "2 things must be changed"):
            assert words in text
        assert "part 13" not in text
        for _ in range(30):
            await pilot.press("down")
        await settle(app)
        assert "part 13" in "\n".join(screen_text(app))
        await pilot.press("c")
        await settle(app)
        assert "where to" in "\n".join(screen_text(app))
        assert engine.asked == ["check"]


async def test_what_matters_can_be_read_at_80_by_24():
    app, engine = app_on(IDLE)
    async with app.run_test(size=(80, 24)):
        for moment, words in (
            ("no vehicle", "NO VEHICLE"),
            ("flying", "SystemID (tippath)"),
            ("flying", "0 blocks missing"),
            ("flying", "if the link drops: returns home after 5 s"),
            ("lost", "LINK LOST 4.2 s"),
            ("lost", "the PILOT ends it"),
            ("over the limit", "144 %!"),
            ("ready", "nothing moves until S"),
            ("idle", "SIMULATED hover"),
            ("idle", "its pilot: T take off"),
        ):
            engine.now = MOMENTS[moment]
            await settle(app)
            assert words in "\n".join(screen_text(app)), moment


async def test_a_terminal_too_small_keeps_the_abort_key_and_says_so():
    app, engine = app_on(FLYING)
    async with app.run_test(size=(80, 24)) as pilot:
        for size, keys in (((79, 24), SCREENS), ((80, 23), "27"), ((40, 10), "2"), ((12, 4), "27")):
            await pilot.resize_terminal(*size)
            for key in (*keys, "question_mark"):
                await pilot.press(key)
                await settle(app)
                lines = screen_text(app)
                assert lines[0].rstrip().endswith("F12 ABORT"), (size, key)
                assert "too small" in lines[1], (size, key)
                assert not "".join(lines[2:]).strip(), "nothing half hidden"
            await pilot.press("f12")
            assert engine.asked == ["abort"]
            engine.asked.clear()
        await pilot.resize_terminal(80, 24)
        await pilot.press("2")
        await settle(app)
        text = "\n".join(screen_text(app))
        assert "too small" not in text
        assert "next: " in text


@pytest.mark.parametrize("case", [*thorough([str.lower]), str.upper])
async def test_a_key_works_as_it_is_shown_and_as_it_is_typed(case):
    app, engine = app_on(IDLE)
    async with app.run_test() as pilot:
        keys = {"r": "ready", "s": "start", "e": "end card"}
        for key, what in keys.items():
            await pilot.press(case(key))
            assert engine.asked.pop() == what
        for key, what in {"t": "pilot takeoff", "l": "pilot land", "b": "pilot lqr"}.items():
            await pilot.press(case(key))
            await workers_done(app, pilot)
            assert engine.asked.pop() == what
        await pilot.press(case("c"))
        assert isinstance(app.screen, Dialog)
        await pilot.press("escape", "3", case("o"))
        assert isinstance(app.screen, Dialog)
        await pilot.press("escape", "4", case("f"))
        await workers_done(app, pilot)
        assert engine.asked == ["fit", "desk compare"]
        await pilot.press("8", case("d"))
        await workers_done(app, pilot)
        assert engine.asked == ["fit", "desk compare", "design"]
        engine.asked.clear()
        engine.now = DESIGNED
        await pilot.press(case("p"), case("n"))
        assert not isinstance(app.screen, Dialog)
        await pilot.press(case("p"), case("y"))
        await workers_done(app, pilot)
        await pilot.press(case("r"), case("y"))
        await workers_done(app, pilot)
        assert engine.asked == ["push", "revert"]
        await pilot.press(case("q"))
        await pilot.pause()
        assert app._exit


async def test_hardware_has_no_pilot_keys():
    app, engine = app_on(replace(IDLE, plant=None))
    async with app.run_test() as pilot:
        await settle(app)
        await pilot.press("t", "l", "b")
        await workers_done(app, pilot)
        assert engine.asked == []
        assert "simulated" not in "\n".join(screen_text(app)).lower()
        engine.now = IDLE
        await pilot.press("t", "l", "b")
        await workers_done(app, pilot)
        assert sorted(engine.asked) == ["pilot land", "pilot lqr", "pilot takeoff"]


async def test_ready_and_start_are_two_keys():
    app, engine = app_on(IDLE)
    async with app.run_test() as pilot:
        await pilot.press("r")
        assert engine.asked == ["ready"]
        await pilot.press("s")
        assert engine.asked == ["ready", "start"]


async def test_abort_from_every_screen():
    app, engine = app_on(FLYING)
    async with app.run_test() as pilot:
        for key in (*SCREENS, "question_mark"):
            engine.asked.clear()
            await pilot.press(key, "f12", "space")
            assert engine.asked == ["abort", "abort"], f"on screen {key}"


async def test_f12_aborts_while_typing_and_space_is_typed():
    app, engine = app_on(FLYING)
    async with app.run_test(size=(80, 24)) as pilot:
        await pilot.press("c")
        await pilot.press("a", "space", "s", "q", "1")
        assert app.screen.query_one(Input).value == "a sq1"
        assert engine.asked == []
        await pilot.press("f12")
        assert engine.asked == ["abort"]
        await settle(app)
        assert screen_text(app)[0].rstrip().endswith("F12 ABORT"), "the line stays above a dialog"
        await pilot.press("enter")
        await workers_done(app, pilot)
        assert engine.asked == ["abort", "card a sq1"]


async def test_abort_from_a_question():
    app, engine = app_on(FLYING)
    async with app.run_test() as pilot:
        await pilot.press("q")
        assert isinstance(app.screen, Dialog)
        await pilot.press("f12", "space")
        assert engine.asked == ["abort", "abort"]


async def test_quitting_in_a_run_asks_and_aborts_first():
    app, engine = app_on(FLYING)
    async with app.run_test() as pilot:
        await pilot.press("q", "n")
        assert not isinstance(app.screen, Dialog)
        assert engine.asked == []
        await pilot.press("q", "y")
        assert engine.asked == ["abort"]
        await pilot.pause()
        assert not app.is_running or app._exit


@pytest.mark.parametrize("key", ["q", "ctrl+q", "ctrl+c"])
async def test_quitting_without_a_run_does_not_ask(key):
    app, engine = app_on(IDLE)
    async with app.run_test() as pilot:
        await pilot.press(key)
        await pilot.pause()
        assert app._exit
        assert engine.asked == []


async def test_gains_that_fail_are_pushed_with_words_why_only():
    limits = Limits(gain_db=60.0)
    failing = judge(design(MODEL), [("fit", MODEL)], limits)
    gains = replace(DESIGNED.desk.designed, clearance=replace(CLEARED, judgement=failing))
    app, engine = app_on(replace(DESIGNED, desk=replace(DESIGNED.desk, designed=gains)))
    async with app.run_test(size=(100, 30)) as pilot:
        await pilot.press("8")
        await settle(app)
        assert "judged: FAILS" in "\n".join(screen_text(app))
        await pilot.press("p", "y", "escape", "p", "enter")
        await workers_done(app, pilot)
        assert engine.asked == []
        await pilot.press("p", *"rig", "enter")
        await workers_done(app, pilot)
        assert engine.asked == ["push because rig"]


async def test_push_asks_first_and_only_on_the_ground():
    app, engine = app_on(replace(DESIGNED, vehicle=VEHICLE))
    async with app.run_test() as pilot:
        await pilot.press("8", "p")
        assert not isinstance(app.screen, Dialog)
        await settle(app)
        assert "armed: gains are moved on the ground" in "\n".join(screen_text(app))
        engine.now = DESIGNED
        await pilot.press("p", "n", "p", "escape", "p", "x")
        assert engine.asked == []
        assert isinstance(app.screen, Dialog), "another key answers nothing"
        await pilot.press("y")
        await workers_done(app, pilot)
        assert engine.asked == ["push"]
        await pilot.press("r", "y")
        await workers_done(app, pilot)
        assert engine.asked == ["push", "revert"]


async def test_a_refusal_is_told_in_words():
    app, engine = app_on(FITTED)
    engine.refusal = "roll is not identifiable: fly a roll chirp"
    async with app.run_test() as pilot:
        await pilot.press("4", "f")
        await workers_done(app, pilot)
        await settle(app)
        assert engine.refusal in "\n".join(screen_text(app))


HOSTILE = [
    "[/]",
    "[bold red]RED[/bold red]",
    "[@click=app.exit]x[/]",
    "\x1b[2J\x1b]0;title\x07clear",
    "\x9b31mC1",
    "a\nb\rc\td\0e",
    "\u202eright to left\u202c",
    "[" * 50,
    "$text-error \\[x] {x} %s",
    "全角" * 40,
    "e" + "\u0301" * 60,
]


def hostile_desk(text: str) -> DeskState:
    """A desk whose every word comes from a file that somebody made to do harm."""
    desk = DESKS["added"]
    row = replace(desk.runs[0], id=text, health=text, notes=(text,), reasons=(text,), verdict=text, maneuver=text)
    blocks = (Block("answer", (Sentence(text),)), Block("measures", (text,)))
    rung = replace(desk.ladder[0], name=text, comparison_text=blocks, answer=answer(brief=blocks))
    path = Path(text.replace("/", "_").replace("\0", "_"))
    return replace(
        desk, path=path, name=text, vehicle=text, runs=(row,), unread=(text,),
        notes=(TimedNote(text, text),), ladder=(rung, replace(desk.ladder[1], name=text, addition_text=blocks)),
        commands=(text,), said=text,
    )  # fmt: skip


async def test_hostile_text_is_shown_as_text():
    app, engine = app_on(IDLE)
    async with app.run_test(size=(80, 24)) as pilot:
        for key, text in itertools.product("98765432", HOSTILE):
            if key != "2" and (HOSTILE.index(text) + int(key)) % 3 and text != HOSTILE[0]:
                continue  # what a screen has in common with others shows there
            engine.now = replace(
                FLYING,
                vehicle=replace(RECORDING, texts=(Text(1, 0.0, 2, text),), mode_name=text, recording_problem=text),
                card=text,
                said=text,
                link=text,
                flight=Path(text.replace("/", "_").replace("\0", "_")),
                desk=hostile_desk(text),
            )
            if text == HOSTILE[0]:
                await pilot.press(key)
            await settle(app)
            lines = screen_text(app)
            seen = {c for line in lines for c in line}
            assert not [c for c in seen if ord(c) < 32 or 0x7F <= ord(c) < 0xA0 or c in "\u202e\u202c"], repr(text)
            assert lines[0].rstrip().endswith("F12 ABORT"), repr(text)
            if key == "2" and text.startswith("[b"):
                assert "vehicle: [bold red]RED[/bold red]" in "\n".join(lines)
        assert engine.asked == []


@pytest.mark.thorough
async def test_any_size_is_survived_and_the_layout_comes_back():
    app, _ = app_on(FLYING)
    async with app.run_test(size=(120, 40)) as pilot:
        await settle(app)
        for size in ((12, 4), (1, 1), (200, 60)):
            await pilot.resize_terminal(*size)
            for key in "4752":
                await pilot.press(key)
                app.look()
                await pilot.pause()
        await pilot.resize_terminal(80, 24)
        await pilot.press("2")
        await settle(app)
        lines = screen_text(app)
        assert lines[0].rstrip().endswith("F12 ABORT")
        assert any("▶ flying" in line for line in lines)
        assert any(0x2800 < ord(c) < 0x2900 for line in lines for c in line)


async def test_no_vehicle_no_samples():
    app, engine = app_on(MOMENTS["no vehicle"])
    none = np.empty(0)
    engine.samples = LiveWindow(
        t=none, p=none, q=none, delta_x=none, delta_y=none, excitation_x=none, excitation_y=none
    )
    async with app.run_test() as pilot:
        for key in ("r", "s", "e", "f12", "4", "f", "8", "d", "p", "r"):
            await pilot.press(key)
        await pilot.press("2")
        await settle(app)
        assert "no vehicle at udpin" in "\n".join(screen_text(app))


@pytest.mark.thorough
async def test_ascii_means_ascii():
    app, engine = app_on(IDLE, "ascii")
    async with app.run_test() as pilot:
        for key in ("2", "c", "escape", "ctrl+p", "escape", "1", *"3456789", "question_mark"):
            await pilot.press(key)
            for state in (MOMENTS["flying"], ANALYSED["designed"]):
                engine.now = state
                await settle(app)
                strange = {c for line in screen_text(app) for c in line if ord(c) > 126}
                assert not strange, f"{strange} after {key}"


async def test_without_colour_nothing_is_lost(monkeypatch):
    monkeypatch.setenv("NO_COLOR", "1")
    app, _ = app_on(MOMENTS["over the limit"])
    async with app.run_test():
        await settle(app)
        assert app.no_color
        text = "\n".join(screen_text(app))
        for word in ("keep", "fly again", "▶ flying", "144 %!", "ARMED"):
            assert word in text


async def test_a_slow_engine_does_not_hold_the_keys():
    app, engine = app_on(FITTED)
    going = threading.Event()
    engine.fit = lambda: going.wait(60) and None
    async with app.run_test() as pilot:
        await pilot.press("4", "f")
        await asyncio.wait_for(pilot.press("f12"), 30)
        assert engine.asked == ["abort"]
        going.set()
        await workers_done(app, pilot)
