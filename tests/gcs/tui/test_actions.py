"""Keys of the analysis screens, palette, questions, connection, colours: what is asked of the engine and the desk."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import pytest
from fake_app import ANALYSED, FLYING, IDLE, NOWHERE, app_on, screen_text, settle
from fake_desk import DESKS
from textual.widgets import Input

from gcs.errors import TippathError, UsageError
from gcs.flight.folder import FlightFolder
from gcs.link.ports import SerialPort
from gcs.tui import connections, themes
from gcs.tui.base import Dialog
from gcs.tui.connections import SIMULATED, UDP, Connection
from gcs.tui.pages import GENERAL, PAGES
from gcs.tui.palette import Entry, matching
from gcs.tui.reconnect import Reconnecting
from gcs.tui.state import Stage, State, joined


async def done(app, pilot) -> None:
    await app.workers.wait_for_complete()
    await pilot.pause()


KEYS = [
    ("open", "3x", ["desk use flight-0007/flight.BIN#1 OUT"]),
    ("open", "3 up up down v", ["desk use flight-0007/flight.BIN#2 VALIDATE"]),
    ("open", "3 up up down down v", ["desk use flight-0007/flight.BIN#3 VALIDATE"]),
    ("open", "4f", ["fit", "desk compare"]),
    ("fitted", "5c", ["desk compare"]),
    ("compared", "5c", []),
    ("compared", "6d", ["desk diagnose"]),
    ("asked", "6d", []),
    ("asked", "6a", ["desk add servo_lag", "desk compare"]),
    ("complete", "6a", []),
    ("asked", "7a", ["desk add servo_lag", "desk compare"]),
    ("added", "7u", ["desk undo"]),
    ("asked", "6w", ["desk next_card"]),
    ("complete", "8d", ["design"]),
    ("designed", "9w", ["desk report"]),
    ("asking", "6k", ["desk cancel"]),
    ("asking", "7 escape", ["desk cancel"]),
]
"""Moment, keys, what they ask."""


async def test_a_key_asks_the_desk():
    app, engine = app_on(NOWHERE)
    async with app.run_test() as pilot:
        for moment, keys, asked in KEYS:
            engine.now = joined(replace(IDLE, vehicle=None), DESKS[moment])
            await pilot.press("2")
            await settle(app)
            engine.asked.clear()
            for key in keys.split() if " " in keys else keys:
                await pilot.press(key)
                await pilot.pause()
            await done(app, pilot)
            assert engine.asked == asked, f"{keys} at {moment}"


QUESTIONS = [
    ("3n", "gusty", "desk note gusty"),
    ("3m", "day 2", "desk rename day 2"),
    ("3o", "/", "flight /"),
    ("4m", "cd", "desk choose_base cd []"),
    ("4m", "TPP + elevator, angular_damping", "desk choose_base tpp ['elevator', 'angular_damping']"),
    ("6i", "mine.py", "desk add mine.py"),
    ("8w", "12.5", "desk design 12.5"),
    ("9d", "elsewhere", "desk keep_in elsewhere"),
    ("2c", "lqr-doublet", "card lqr-doublet"),
]
"""Keys, what is typed, what it asks."""


async def test_a_question_is_asked_and_f12_aborts_in_it():
    app, engine = app_on(ANALYSED["asked"])
    async with app.run_test() as pilot:
        for keys, typed, asked in QUESTIONS:
            engine.asked.clear()
            await pilot.press(*keys)
            assert isinstance(app.screen, Dialog), keys
            await pilot.press("f12")
            assert engine.asked == ["abort"], keys
            app.screen.query_one(Input).value = typed
            await pilot.press("enter")
            await done(app, pilot)
            assert engine.asked[1] == asked


async def test_a_weight_that_is_no_number_is_told():
    app, _ = app_on(ANALYSED["asked"])
    async with app.run_test() as pilot:
        await pilot.press("8", "w")
        app.screen.query_one(Input).value = "[/] much"
        await pilot.press("enter")
        await done(app, pilot)
        await settle(app)
        assert "[/] much is no number" in "\n".join(screen_text(app))


async def test_the_palette_does_what_another_screen_does():
    app, engine = app_on(ANALYSED["open"])
    async with app.run_test(size=(80, 24)) as pilot:
        await pilot.press("ctrl+p", *"chosen")
        await pilot.press("f12")
        assert engine.asked == ["abort"], "also here"
        await settle(app)
        assert screen_text(app)[0].rstrip().endswith("F12 ABORT")
        await pilot.press("enter")
        await done(app, pilot)
        assert engine.asked == ["abort", "fit", "desk compare"]
        assert app.screen.NAME == "Fit"
        await pilot.press("ctrl+p", "escape")
        assert app.screen.NAME == "Fit"


def test_every_action_is_in_the_palette_with_a_name_of_its_own():
    for page in PAGES:
        names = [act.name for act in page.ACTS]
        assert len(set(names)) == len(names), page.NAME
        keys = [key for act in page.ACTS for key in act.keys.split(",")]
        assert len(set(keys)) == len(keys), page.NAME
        assert not {"f12", "space", "q", "question_mark", "k", *"123456789"} & set(keys), page.NAME
    assert {act.key for act in GENERAL} >= {"F12", "1", "9", "?", "q", "K"}
    entries = [
        Entry("Fit", "F", "fit the runs", "x"),
        Entry("", "Q", "quit", "y"),
        Entry("Runs", "F", "use to fit", "z"),
    ]
    assert matching(entries, "") == [0, 1, 2]
    assert matching(entries, "FIT ru") == [0, 2]
    assert matching(entries, "nothing") == []


async def test_colours_change_and_nothing_else_does():
    app, engine = app_on(FLYING)
    async with app.run_test() as pilot:
        await pilot.pause(0.3)  # layouts wait for the next frame
        await settle(app)
        before = screen_text(app)
        for name in ("sun", "contrast", "light", "dark"):
            await pilot.press("f9")
            assert app.theme == name
            await settle(app)
            assert screen_text(app)[-8:] == before[-8:]
        assert engine.asked == []


@pytest.mark.parametrize("theme", themes.THEMES, ids=themes.NAMES)
def test_every_colour_stands_out_from_its_background(theme):
    def light(colour: str) -> float:
        parts = [int(colour[i : i + 2], 16) / 255 for i in (1, 3, 5)]
        linear = [x / 12.92 if x <= 0.04045 else ((x + 0.055) / 1.055) ** 2.4 for x in parts]
        return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]

    def contrast(one: str, other: str) -> float:
        high, low = sorted((light(one), light(other)), reverse=True)
        return (high + 0.05) / (low + 0.05)

    least = 7.0 if theme.name in ("sun", "contrast") else 4.5
    for name in ("foreground", "primary", "accent", "warning", "error", "success"):
        assert contrast(getattr(theme, name), theme.background) >= least, name


# ------------------------------------------------------------------------------------------------ connection


class Connections:
    """Writes down where it was sent."""

    def __init__(self) -> None:
        self.connection = connections.NOWHERE
        self.sent: list[str] = []

    def connections(self) -> tuple[Connection, ...]:
        return (UDP, *SIMULATED)

    def connect(self, connection: Connection) -> None:
        self.sent.append(connection.name)


async def test_connect_by_mark_and_by_word():
    app, engine = app_on(NOWHERE)
    app.connections = harbour = Connections()
    async with app.run_test() as pilot:
        await pilot.press("1")
        await done(app, pilot)
        await pilot.press("down", "enter")
        await done(app, pilot)
        await pilot.press("a", *"nonsense", "enter")
        await settle(app)
        assert "is no link" in "\n".join(screen_text(app))
        await pilot.press("a", *"tcp:10.0.0.1:5760", "enter")
        await done(app, pilot)
        assert harbour.sent == ["simulated hover", "tcp:10.0.0.1:5760"]
        engine.now = replace(IDLE, plant=None)  # armed: somebody's vehicle
        await pilot.press("enter", "n", "enter", "y")
        await done(app, pilot)
        assert len(harbour.sent) == 3
        engine.now = FLYING
        await pilot.press("enter")
        assert len(harbour.sent) == 3
        assert not isinstance(app.screen, Dialog)


async def test_another_address_in_the_vehicles_name_is_shown_and_taken_by_a_key():
    assert IDLE.vehicle is not None
    app, engine = app_on(IDLE)
    async with app.run_test(size=(80, 24)) as pilot:
        await pilot.press("1", "t")
        await done(app, pilot)
        assert engine.asked == []
        vehicle = replace(IDLE.vehicle, newcomer="10.0.0.7:14550", signs=True)
        engine.now = replace(IDLE, vehicle=vehicle)
        await settle(app)
        text = " ".join("\n".join(screen_text(app)).split())
        assert "10.0.0.7:14550 speaks as system 1 now" in text
        assert "T takes it for the vehicle" in text
        assert "obeys only who has its key" in text
        await pilot.press("t")
        await done(app, pilot)
        assert engine.asked == ["take over"]


def test_ports_and_earlier_flights_are_offered(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(connections, "serial_ports", lambda: (SerialPort("/dev/ttyUSB0", "CP2102", 57600),))
    for number, link in enumerate(
        ("udpin:0.0.0.0:14560", "udpin:127.0.0.1:45123", "nonsense", "/dev/ttyUSB0,57600"), start=1
    ):
        folder = tmp_path / f"flight-000{number}"
        folder.mkdir()
        FlightFolder(folder).write({"link": link, "card": "hover", "started": "2026-11-22T10:00:00", "name": "gusty"})
    (tmp_path / "flight-0005").mkdir()
    (tmp_path / "00000012.BIN").write_bytes(b"")
    offered = connections.connections(tmp_path)
    assert [(one.name, one.about) for one in offered if one.flight] == [
        ("flight-0005", "what was flown is not told"),
        ("flight-0004", "gusty: card hover, 0 of 0 runs kept, 2026-11-22"),
        ("flight-0003", "gusty: card hover, 0 of 0 runs kept, 2026-11-22"),
        ("00000012.BIN", "a log"),
    ]
    assert offered[connections.first_marked(offered)].link == "/dev/ttyUSB0,57600"
    assert connections.first_marked(connections.connections(tmp_path / "vehicle-logs")) == 0
    assert [one.link for one in offered if one.link] == [
        connections.ANY_UDP,
        "/dev/ttyUSB0,57600",
        "udpin:0.0.0.0:14560",
    ]
    assert [one.heading for one in offered if one.flight or one is connections.NOWHERE].count(
        "open a recorded flight"
    ) == 5
    with pytest.raises(UsageError, match="is no link"):
        connections.typed("elsewhere")


class Berth:
    """One link's engine."""

    made: list[Berth] = []

    def __init__(self, link: str | None, **options: object) -> None:
        self.link, self.options = link, options
        self.now = State(link=link or "", stage=Stage.IDLE, commands=(f"on {link}",))
        self.desk = options["make_desk"](on_command=lambda _: None, on_said=lambda _: None)
        self.closed = False
        Berth.made.append(self)

    def state(self) -> State:
        return self.now

    def close(self) -> None:
        self.closed = True


def test_another_link_keeps_the_desk_and_what_was_done(tmp_path: Path):
    Berth.made = []
    vehicles: list[tuple[object, ...]] = []

    def make_vehicle(plant, directory, **options):
        vehicles.append((plant, directory.name, options["more"]))
        return SimpleNamespace()

    engine = Reconnecting(folder=tmp_path, make=Berth, make_vehicle=make_vehicle)
    engine.connect(connections.typed("tcp:10.0.0.1:5760"))
    first, second = Berth.made
    assert first.closed
    assert (first.link, second.link) == (None, "tcp:10.0.0.1:5760")
    assert first.desk is second.desk is engine.desk
    assert engine.state().commands == ("on None", "on tcp:10.0.0.1:5760")
    assert second.options["primary"] is False
    second.now = replace(second.now, stage=Stage.FLYING)
    with pytest.raises(TippathError, match="being flown"):
        engine.connect(UDP)
    assert not second.closed
    second.now = replace(second.now, stage=Stage.IDLE)
    engine.connect(next(one for one in SIMULATED if one.hidden))
    third = Berth.made[-1]
    assert third.options["primary"] is True
    assert third.options["plant"] == "hover-ideal + secret"
    third.options["start_vehicle"]()
    assert vehicles == [("hover-ideal", "vehicle-0001", ("--hidden", "random"))]
