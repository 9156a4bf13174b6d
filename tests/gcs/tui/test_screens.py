"""Every screen at both sizes and at every moment: nothing outside or covered, what is next said, F12 from anywhere."""

from __future__ import annotations

import asyncio
import itertools
import threading
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from textual.geometry import Region
from textual.widgets import Input

from gcs.envelope import Use
from gcs.errors import TippathError
from gcs.logs.live import LiveWindow
from gcs.tui.app import TippathApp
from gcs.tui.base import Dialog
from gcs.tui.state import Bank, Designed, Fitted, Mark, Progress, RunView, Stage, State
from gcs.tui.widgets.lines import Lines
from gcs.vehicle import Text, VehicleSnapshot

SIZES = [(80, 24), (120, 40)]

VEHICLE = VehicleSnapshot(
    1,
    1,
    link_age_s=0.1,
    lost=False,
    mode=0,
    mode_name="Stabilize",
    armed=True,
    heartbeats=3,
    rpm=1648.0,
    battery_v=22.1,
    texts=(Text(1, 0.0, 6, "Frame: HELI"),),
)
RECORDING = replace(VEHICLE, recording=Path("flight-0007/flight.BIN"), blocks_received=900)
RUNS = tuple(
    RunView(i, f"{axis} {kind} {i % 2 + 1}/2", "0.5-10 Hz  30 s  A 0.10")
    for i, (axis, kind) in enumerate(
        itertools.product(("roll", "pitch", "roll", "pitch"), ("chirp", "doublet")), start=1
    )
)
USE = Use(44.0, 24.0, 13.0, 3.0)
LONG = "not ready: in the air: not armed: the pilot arms and takes off, then fly this again; mode: Land; " * 4

IDLE = State("udpin:127.0.0.1:14550", "hover", VEHICLE, stage=Stage.IDLE, card="hover", runs=RUNS)
FLYING = replace(
    IDLE,
    vehicle=replace(RECORDING, mode=25, mode_name="SystemID"),
    stage=Stage.FLYING,
    current=3,
    runs=(
        replace(RUNS[0], mark=Mark.KEEP, verdict="keep   coherence 0.5-9.6 Hz   gaps 0   44 % of the limits"),
        replace(RUNS[1], mark=Mark.AGAIN, verdict="fly again: the rates did not answer (they vary by 0.0041 rad/s)"),
        replace(RUNS[2], mark=Mark.FLYING),
        replace(RUNS[3], mark=Mark.LOCKED, verdict="until 3 is clean"),
        *RUNS[4:],
    ),
    progress=Progress(12.4, 30.0, 4.6, "Table 1"),
    use=USE,
    link_loss="link lost: RETURNS after 5 s",
    rpm_reference=1650.0,
    samples=9120,
    disk_free=41_000_000_000,
    flight=Path("flight-0007"),
    checks=((True, "link: heard 0.0 s ago"), (True, "trim: delta_x +0.01, delta_y +0.01")),
)
FITTED = replace(
    IDLE,
    flight=Path("flight-0007"),
    fitted=Fitted(
        Path("flight-0007"),
        ("flight.BIN#1",),
        (),
        "\n".join(f"row {i:3d} {'x' * 60}" for i in range(60)),
        ("look at this " * 12,),
        ("tippath fit " + "flight-0007/flight.BIN#1 " * 8,),
    ),
)
DESIGNED = replace(
    FITTED,
    vehicle=replace(VEHICLE, armed=False),
    designed=Designed("K  1 2 3 4", Path("flight-0007/gains.json"), 0xABCDEF, "tippath design"),
    bank=Bank(0x123456, None, True),
)
MOMENTS = {
    "no vehicle": State("udpin:127.0.0.1:14550", card="hover", runs=RUNS, trouble="no vehicle at udpin: " + LONG),
    "idle": IDLE,
    "refused": replace(IDLE, said=LONG),
    "checking": replace(FLYING, stage=Stage.CHECKING, progress=None),
    "ready": replace(FLYING, stage=Stage.READY),
    "flying": FLYING,
    "over the limit": replace(FLYING, use=Use(144.0, None, 99.0)),
    "aborting": replace(FLYING, stage=Stage.ABORTING),
    "held": replace(FLYING, stage=Stage.HELD, said="roll chirp: keep"),
    "closing": replace(FLYING, stage=Stage.CLOSING),
    "lost": replace(FLYING, vehicle=replace(RECORDING, link_age_s=4.2, lost=True)),
    "hardware": replace(FLYING, plant=None, link="/dev/serial/by-id/" + "x" * 70),
    "fitting": replace(IDLE, busy="fitting flight-0007"),
    "fitted": FITTED,
    "designed": DESIGNED,
}


class FakeEngine:
    """Shows what it is told to show and writes down what is asked of it."""

    def __init__(self, state: State) -> None:
        self.now = state
        self.asked: list[str] = []
        self.refusal: str | None = None
        self.closed = threading.Event()
        t = np.arange(10_000) / 500
        quiet = np.zeros(t.size)
        self.samples = LiveWindow(t, np.sin(9 * t), np.cos(5 * t), 0.1 * np.sin(9 * t), quiet, quiet, quiet)

    def state(self) -> State:
        return self.now

    def window(self, last_s: float) -> LiveWindow:
        return self.samples

    def ask(self, what: str) -> None:
        self.asked.append(what)
        if self.refusal is not None:
            raise TippathError(self.refusal)

    def ready(self) -> None:
        self.ask("ready")

    def start(self) -> None:
        self.ask("start")

    def end_card(self) -> None:
        self.ask("end card")

    def abort(self) -> None:
        self.ask("abort")

    def choose_card(self, word: str) -> None:
        self.ask(f"card {word}")

    def open_flight(self, word: str) -> None:
        self.ask(f"flight {word}")

    def fit(self) -> None:
        self.ask("fit")

    def design(self) -> None:
        self.ask("design")

    def push(self) -> None:
        self.ask("push")

    def revert(self) -> None:
        self.ask("revert")

    def pilot(self, line: str) -> None:
        self.ask(f"pilot {line}")

    def close(self) -> None:
        self.closed.set()


def app_on(state: State, style="braille") -> tuple[TippathApp, FakeEngine]:
    engine = FakeEngine(state)
    return TippathApp(engine, style, bell=False), engine


def screen_text(app: TippathApp) -> list[str]:
    """What a terminal would show."""
    return ["".join(segment.text for segment in strip) for strip in app.screen._compositor.render_strips()]


async def settle(app: TippathApp) -> None:
    """Until what the engine says now stands on the screen."""
    for _ in range(2):  # heights that change with the text are known after the first
        before = [box.region for box in app.screen.query(Lines)]
        app.look()
        drawn = asyncio.Event()
        app.screen.call_after_refresh(drawn.set)
        await drawn.wait()
        if before == [box.region for box in app.screen.query(Lines)]:
            break
    app.look()


async def workers_done(app: TippathApp, pilot) -> None:
    await app.workers.wait_for_complete()
    await pilot.pause()


@pytest.mark.parametrize("size", SIZES)
async def test_every_screen_at_every_moment_fits_and_says_what_is_next(size):
    app, engine = app_on(IDLE)
    width, height = size
    async with app.run_test(size=size) as pilot:
        for key in ("1", "2", "3", "question_mark"):
            await pilot.press(key)
            for name, state in MOMENTS.items():
                if key == "question_mark" and name not in ("no vehicle", "refused", "flying", "hardware"):
                    continue  # help hardly changes
                engine.now = state
                await settle(app)
                where = f"{name} on screen {key}"
                lines = screen_text(app)
                assert lines[0].rstrip().endswith("F12 ABORT"), where
                assert any(line.startswith(" next: ") for line in lines), where
                boxes = [box for box in app.screen.query(Lines) if box.display and box.id != "text" and box.region]
                assert len(boxes) >= 4, where
                for box in boxes:
                    assert Region(0, 0, width, height).contains_region(box.region), f"{where}: #{box.id} is outside"
                    wide = [line for line in box.shown.splitlines() if len(line) > width]
                    assert not wide, f"{where}: #{box.id} is cut: {wide}"
                    assert len(box.shown.splitlines()) <= box.region.height, f"{where}: #{box.id} is cut below"
                for one, other in itertools.combinations(boxes, 2):
                    assert not one.region.intersection(other.region), f"{where}: #{one.id} covers #{other.id}"


async def test_what_matters_can_be_read_at_80_by_24():
    app, engine = app_on(IDLE)
    async with app.run_test(size=(80, 24)):
        for moment, words in (
            ("no vehicle", "NO VEHICLE"),
            ("flying", "SystemID (tippath)"),
            ("flying", "0 blocks missing"),
            ("flying", "link lost: RETURNS after 5 s"),
            ("lost", "LINK LOST 4.2 s"),
            ("lost", "the PILOT ends it"),
            ("over the limit", "144 %!"),
            ("ready", "nothing moves until S"),
            ("idle", "SIMULATED hover"),
            ("idle", "simulated pilot: T take off"),
        ):
            engine.now = MOMENTS[moment]
            await settle(app)
            assert words in "\n".join(screen_text(app)), moment


async def test_a_terminal_too_small_keeps_the_abort_key_and_says_so():
    app, engine = app_on(FLYING)
    async with app.run_test(size=(80, 24)) as pilot:
        for size in ((79, 24), (80, 23), (40, 10), (12, 4)):
            await pilot.resize_terminal(*size)
            for key in ("1", "2", "3", "question_mark"):
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
        await pilot.press("1")
        await settle(app)
        text = "\n".join(screen_text(app))
        assert "too small" not in text
        assert "next: " in text


@pytest.mark.parametrize("case", [str.lower, str.upper])
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
        await pilot.press("escape", "2", case("o"))
        assert isinstance(app.screen, Dialog)
        await pilot.press("escape", case("f"), "3", case("d"))
        await workers_done(app, pilot)
        assert sorted(engine.asked) == ["design", "fit"]
        engine.asked.clear()
        engine.now = DESIGNED
        await pilot.press(case("p"), case("n"))
        assert not isinstance(app.screen, Dialog)
        await pilot.press(case("p"), case("y"))
        await workers_done(app, pilot)
        await pilot.press(case("v"), case("y"))
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
        for key in ("1", "2", "3", "question_mark"):
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


async def test_push_asks_first_and_only_on_the_ground():
    app, engine = app_on(replace(DESIGNED, vehicle=VEHICLE))
    async with app.run_test() as pilot:
        await pilot.press("3", "p")
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
        await pilot.press("v", "y")
        await workers_done(app, pilot)
        assert engine.asked == ["push", "revert"]


async def test_a_refusal_is_told_in_words():
    app, engine = app_on(FITTED)
    engine.refusal = "roll is not identifiable: fly a roll chirp"
    async with app.run_test() as pilot:
        await pilot.press("2", "f")
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


async def test_hostile_text_is_shown_as_text():
    app, engine = app_on(IDLE)
    async with app.run_test(size=(80, 24)) as pilot:
        for key, text in itertools.product(("3", "2", "1"), HOSTILE):
            engine.now = replace(
                FLYING,
                vehicle=replace(RECORDING, texts=(Text(1, 0.0, 2, text),), mode_name=text, recording_problem=text),
                card=text,
                said=text,
                link=text,
                flight=Path(text.replace("/", "_").replace("\0", "_")),
            )
            if text == HOSTILE[0]:
                await pilot.press(key)
            await settle(app)
            lines = screen_text(app)
            seen = {c for line in lines for c in line}
            assert not [c for c in seen if ord(c) < 32 or 0x7F <= ord(c) < 0xA0 or c in "\u202e\u202c"], repr(text)
            assert lines[0].rstrip().endswith("F12 ABORT"), repr(text)
            if key == "1" and text.startswith("[b"):
                assert "vehicle: [bold red]RED[/bold red]" in "\n".join(lines)
        assert engine.asked == []


async def test_any_size_is_survived_and_the_layout_comes_back():
    app, _ = app_on(FLYING)
    async with app.run_test(size=(120, 40)) as pilot:
        await settle(app)
        for size in ((12, 4), (1, 1), (200, 60)):
            await pilot.resize_terminal(*size)
            for key in ("2", "3", "1"):
                await pilot.press(key)
                app.look()
                await pilot.pause()
        await pilot.resize_terminal(80, 24)
        await pilot.press("1")
        await settle(app)
        lines = screen_text(app)
        assert lines[0].rstrip().endswith("F12 ABORT")
        assert any("▶ flying" in line for line in lines)
        assert any(0x2800 < ord(c) < 0x2900 for line in lines for c in line)


async def test_no_vehicle_no_samples():
    app, engine = app_on(MOMENTS["no vehicle"])
    none = np.empty(0)
    engine.samples = LiveWindow(none, none, none, none, none, none, none)
    async with app.run_test() as pilot:
        for key in ("r", "s", "e", "f12", "2", "f", "3", "d", "p", "v"):
            await pilot.press(key)
        await pilot.press("1")
        await settle(app)
        assert "no vehicle at udpin" in "\n".join(screen_text(app))


async def test_ascii_means_ascii():
    app, engine = app_on(IDLE, "ascii")
    async with app.run_test() as pilot:
        for key in ("1", "c", "escape", "2", "3", "question_mark"):
            await pilot.press(key)
            for moment in ("flying", "designed"):
                engine.now = MOMENTS[moment]
                await settle(app)
                strange = {c for line in screen_text(app) for c in line if ord(c) > 126}
                assert not strange, f"{strange} after {key}, {moment}"


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
    engine.fit = lambda: going.wait(10) and None
    async with app.run_test() as pilot:
        await pilot.press("2", "f")
        await asyncio.wait_for(pilot.press("f12"), 2)
        assert engine.asked == ["abort"]
        going.set()
        await workers_done(app, pilot)
