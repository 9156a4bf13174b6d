"""The first five minutes: what is offered, the guide at every moment, the glossary, and a sealed answer opened."""

from __future__ import annotations

from dataclasses import replace
from importlib import resources
from pathlib import Path

import pytest
from fake_app import ANALYSED, IDLE, MOMENTS, NOWHERE, app_on, screen_text, settle
from more_of_a_kind import thorough
from rich.cells import cell_len

from gcs.tui.connections import GUIDED, Connection
from gcs.tui.dialogs import Told
from gcs.tui.glossary import glossary, glossary_lines
from gcs.tui.guide import LINES, guide_words
from gcs.tui.words import SCREENS, notice_lines


def name_of(app) -> str:
    """Of the screen that is shown."""
    return app.screen.NAME


class Beginnings:
    """A guided flight, and one that was recorded."""

    connection = Connection(name="elsewhere")

    def __init__(self) -> None:
        self.sent: list[str] = []

    def connections(self) -> tuple[Connection, ...]:
        return (GUIDED, Connection(name="flight-0003", about="card hover", flight=Path("flight-0003")))

    def connect(self, connection: Connection) -> None:
        self.sent.append(connection.name)


async def test_a_recorded_flight_is_opened_and_the_guide_comes_with_its_flight_only():
    app, engine = app_on(NOWHERE)
    app.connections = begin = Beginnings()
    async with app.run_test(size=(80, 24)) as pilot:
        await pilot.press("1")
        await app.workers.wait_for_complete()
        await pilot.press("down", "enter")
        await app.workers.wait_for_complete()
        await pilot.pause()
        assert engine.asked == ["flight flight-0003"]
        assert (name_of(app), app.guided, begin.sent) == ("Runs", False, [])
        await pilot.press("1", "up", "enter")
        await app.workers.wait_for_complete()
        await settle(app)
        assert (begin.sent, app.guided) == (["first flight, guided"], True)
        assert any("F3 leaves" in line for line in screen_text(app))
        engine.asked.clear()
        await pilot.press("f3")
        await settle(app)
        assert not any("F3 leaves" in line for line in screen_text(app))
        assert engine.asked == [], "the guide asks nothing of anybody"


async def test_a_flight_is_chosen_from_the_newest_or_typed_and_completed(tmp_path, monkeypatch):
    for name in ("flight-0001", "flight-0002"):
        (tmp_path / name).mkdir()
    monkeypatch.chdir(tmp_path)
    app, engine = app_on(replace(IDLE, flight=None))
    async with app.run_test(size=(80, 24)) as pilot:
        await pilot.press("3", "o")
        await settle(app)
        text = "\n".join(screen_text(app))
        assert text.index("flight-0002") < text.index("flight-0001"), "the newest first"
        await pilot.press("down", "down", "enter")
        await settle(app)
        assert engine.asked[-1] == "flight flight-0001"
        await pilot.press("o")
        await settle(app)
        await pilot.press(*"flight", "minus", *"0002"[:3])
        await settle(app)
        await pilot.press("right", "enter")
        await settle(app)
        assert engine.asked[-1] == "flight flight-0001", "completed to the first that begins so"


def test_the_guide_says_something_else_at_every_step_and_fits_in_its_lines():
    moments = {**MOMENTS, **ANALYSED, "nowhere": NOWHERE}
    said = {guide_words(state, screen) for state in moments.values() for screen in (*SCREENS, "help")}
    assert len(said) > 25
    cut = [words for words in said if len(notice_lines(words, 80 - len("F3 leaves") - 2, 9)) > LINES]
    assert not cut
    assert "S starts" in guide_words(MOMENTS["ready"], "Fly")
    assert "Z opens" in guide_words(replace(ANALYSED["complete"], secret=Path("vehicle-0001")), "Diagnose")
    assert "Z opens" not in guide_words(ANALYSED["complete"], "Diagnose")


@pytest.mark.parametrize("size", [(80, 24), *thorough([((120, 40),)])])
async def test_every_screen_has_room_for_the_guide(size):
    app, engine = app_on(IDLE)
    app.guided = True
    async with app.run_test(size=size) as pilot:
        for key, moment in (("2", MOMENTS["held"]), ("2", MOMENTS["refused"]), ("7", ANALYSED["added"]), ("1", IDLE)):
            engine.now = moment
            await pilot.press(key)
            await settle(app)
            lines = screen_text(app)
            assert lines[-3].startswith(" next: "), key
            assert any("F3 leaves" in line for line in lines), key


async def test_help_has_the_glossary_of_the_package():
    assert {one.word for one in glossary()} >= {"TPP", "run", "noise floor"}
    text = (resources.files("gcs") / "tui" / "glossary.md").read_text("utf-8")
    assert text.count("\n| ") == len(glossary()) + text.count("| word |")
    assert all(cell_len(line) <= 60 for line in glossary_lines(glossary(), 60))
    app, _ = app_on(IDLE)
    async with app.run_test(size=(80, 24)) as pilot:
        await pilot.press("f1")
        await settle(app)
        assert any("in a pilot's words" in line for line in screen_text(app))
        await pilot.press("w")
        await settle(app)
        assert any("what the words mean" in line for line in screen_text(app))


async def test_a_sealed_answer_is_opened_where_the_diagnosis_was_made(monkeypatch):
    opened = []

    def revealed(directory, diagnoses):
        opened.append((directory, diagnoses))
        return ["hidden: servo_lag: a lag of the servos", "  tau_s = 0.03"]

    monkeypatch.setattr("gcs.tui.field_keys.revealed", revealed)
    app, engine = app_on(replace(ANALYSED["complete"], secret=Path("vehicle-0007")))
    async with app.run_test(size=(80, 24)) as pilot:
        await pilot.press("6", "z", "enter")
        await app.workers.wait_for_complete()
        await pilot.pause()
        assert isinstance(app.screen, Told)
        await settle(app)
        assert any("servo_lag: a lag of the servos" in line for line in screen_text(app))
        assert opened == [(Path("vehicle-0007"), ())]
        assert engine.asked == ["desk audit opened the sealed answer tippath reveal vehicle-0007"]
        await pilot.press("f12", "escape")
        assert engine.asked[-1] == "abort"
        assert name_of(app) == "Diagnose"
