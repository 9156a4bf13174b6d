"""What a click or a finger does: abort, screens, keys, rows and answers, as the keys do."""

from __future__ import annotations

from dataclasses import replace

import pytest
from fake_app import ANALYSED, DESIGNED, FLYING, IDLE, app_on, screen_text, settle
from more_of_a_kind import thorough
from textual.content import Content

from gcs.tui.app import TippathApp
from gcs.tui.base import Dialog
from gcs.tui.connections import Connection
from gcs.tui.pages import PAGES, mode_of
from gcs.tui.pressing import pressing_keys
from gcs.tui.runs import RunsScreen

SIZES = [(80, 24), (120, 40)]


class FakeConnections:
    """Three places to connect to."""

    def __init__(self) -> None:
        self.at = Connection(name="one")
        self.chosen: list[str] = []

    @property
    def connection(self) -> Connection:
        return self.at

    def connections(self) -> tuple[Connection, ...]:
        return tuple(replace(self.at, name=name) for name in ("one", "two", "three"))

    def connect(self, connection: Connection) -> None:
        self.chosen.append(connection.name)


async def press(app: TippathApp, pilot, words: str) -> None:
    """Click where these words stand."""
    await settle(app)
    lines = screen_text(app)
    row = next(i for i, line in enumerate(lines) if words in line)
    await pilot.click(offset=(lines[row].index(words) + 1, row))
    await app.workers.wait_for_complete()
    await pilot.pause()


async def test_abort_can_be_pressed_on_every_screen_and_over_every_question():
    app, engine = app_on(FLYING)
    async with app.run_test(size=(80, 24)) as pilot:
        for key in "123456789":
            await pilot.press(key)
            await press(app, pilot, "F12 ABORT")
            assert engine.asked.pop() == "abort", f"on screen {key}"
        await pilot.press("2", "c")
        await press(app, pilot, "F12 ABORT")
        assert engine.asked.pop() == "abort"
        assert isinstance(app.screen, Dialog)
        await pilot.press("escape", "ctrl+p")
        await press(app, pilot, "F12 ABORT")
        assert engine.asked == ["abort"]


@pytest.mark.parametrize("size", [SIZES[0], *thorough((size,) for size in SIZES[1:])])
async def test_screens_can_be_pressed(size):
    app, _ = app_on(IDLE)
    async with app.run_test(size=size) as pilot:
        for number, page in enumerate(PAGES, 1):
            await press(app, pilot, f"{number} {page.NAME}" if size[0] >= 100 else f"{number}{page.NAME}")
            assert app.current_mode == mode_of(page)


async def test_keys_on_the_footer_can_be_pressed():
    app, engine = app_on(IDLE)
    async with app.run_test(size=(80, 24)) as pilot:
        for words, asked in {"R ready": "ready", "S start": "start", "T take off": "pilot takeoff"}.items():
            await press(app, pilot, words)
            assert engine.asked.pop() == asked
        await press(app, pilot, "? help")
        assert app.current_mode == "help"
        await pilot.press("4")
        await press(app, pilot, "F fit")
        assert engine.asked == ["fit", "desk compare"]


async def test_the_simulated_pilot_is_pressed_on_no_hardware():
    app, engine = app_on(replace(IDLE, plant=None))
    async with app.run_test() as pilot:
        await settle(app)
        assert "T take off" not in "\n".join(screen_text(app))
        await app.run_action("app.pilot('takeoff')")
        await app.workers.wait_for_complete()
        await pilot.pause()
        assert engine.asked == []


async def test_a_question_is_answered_by_pressing():
    app, engine = app_on(DESIGNED)
    async with app.run_test() as pilot:
        await pilot.press("8", "p")
        await press(app, pilot, "N no")
        assert not isinstance(app.screen, Dialog)
        assert engine.asked == []
        await pilot.press("p")
        await press(app, pilot, "Y yes")
        assert engine.asked == ["push"]
        await pilot.press("2", "c", "q", "u")
        await press(app, pilot, "enter takes it")
        assert engine.asked == ["push", "card qu"]
        await pilot.press("c")
        await press(app, pilot, "escape leaves")
        assert not isinstance(app.screen, Dialog)


async def test_runs_are_marked_by_pressing():
    state = next(one for one in ANALYSED.values() if len(one.desk.runs) > 2)
    app, _ = app_on(state)
    async with app.run_test(size=(120, 40)) as pilot:
        await pilot.press("3")
        await press(app, pilot, state.desk.runs[2].id)
        marked = [line for line in screen_text(app) if "▶" in line]
        assert state.desk.runs[2].id in marked[0]


async def test_a_connection_pressed_twice_is_taken():
    app, _ = app_on(replace(IDLE, vehicle=None))
    connections = FakeConnections()
    app.connections = connections
    async with app.run_test() as pilot:
        await pilot.press("1")
        await app.workers.wait_for_complete()
        await press(app, pilot, "three")
        assert connections.chosen == []
        await press(app, pilot, "three")
        assert connections.chosen == ["three"]


async def test_an_entry_of_the_palette_is_pressed():
    app, engine = app_on(IDLE)
    async with app.run_test() as pilot:
        await pilot.press("2", "ctrl+p", *"ready")
        await press(app, pilot, "make the next run ready")
        assert engine.asked == ["ready"]


def test_words_that_are_no_keys_press_nothing():
    assert pressing_keys("R ready, and S", ()).spans == []
    line = pressing_keys(" R ready", (RunsScreen.ACTS[0],))
    assert isinstance(line, Content)
    assert line.spans == []
