"""Beside the runway: notes, the checklist, calls by bell and voice, keys with gloves, contrast in the sun."""

from __future__ import annotations

import subprocess
import threading
from dataclasses import replace
from pathlib import Path

import pytest
from fake_app import ANALYSED, FLYING, IDLE, MOMENTS, NOWHERE, RECORDING, app_on, screen_text, settle
from more_of_a_kind import thorough

from gcs.cards.checklist import Question
from gcs.errors import TippathError, UsageError
from gcs.tui import themes
from gcs.tui.air_time import AirTime
from gcs.tui.calls import LIMIT, START
from gcs.tui.dialogs import Ask, Told
from gcs.tui.pages import PAGES
from gcs.tui.speaking import Speaker, voice
from gcs.tui.state import Stage

BLADES = Question(ask="Blades tracked")
WIND = Question(ask="Wind", kind="number", unit="m/s", most=6.0)
ASKING = replace(IDLE, checklist=(BLADES, WIND), answers=(None, None))


async def done(app, pilot) -> None:
    await app.workers.wait_for_complete()
    await pilot.pause()


async def test_a_note_has_the_moment_at_which_its_key_was_pressed():
    app, engine = app_on(replace(FLYING, air_s=192.4))
    async with app.run_test(size=(80, 24)) as pilot:
        await pilot.press("n")
        await settle(app)
        assert any("flight-0007, with its time in the air, 3:12" in line for line in screen_text(app))
        engine.now = replace(FLYING, air_s=200.0, progress=None, stage=Stage.HELD)
        await pilot.press(*"gust", "enter")
        await done(app, pilot)
        (note,) = engine.notes
        assert (note.text, note.air_s, note.run, note.run_s) == ("gust", 192.4, "pitch chirp 2/2", 12.4)
        assert note.more == {"air_s": 192.4, "run": "pitch chirp 2/2", "run_s": 12.4}


@pytest.mark.parametrize(
    ("state", "keys", "asked"),
    [
        (replace(IDLE, plant=None), "2n", "note x"),
        (NOWHERE, "1n", "note x"),
        (ANALYSED["open"], "3n", "desk note x"),
        *thorough([(ANALYSED["asked"], "7n", "desk note x")]),
        (replace(ANALYSED["asked"], flight=Path("flight-0009")), "2n", "note x"),
    ],
)
async def test_a_note_goes_to_the_flight_that_is_flown_or_to_the_one_that_is_looked_at(state, keys, asked):
    app, engine = app_on(state)
    async with app.run_test(size=(80, 24)) as pilot:
        await pilot.press(*keys, "x", "enter")
        await done(app, pilot)
        assert engine.asked == [asked]


async def test_ready_asks_the_checklist_first_and_goes_on_by_itself_only_when_all_is_well():
    app, engine = app_on(ASKING)
    async with app.run_test(size=(80, 24)) as pilot:
        await pilot.press("2", "r")
        await settle(app)
        assert any("Checklist 1/2: Blades tracked?" in line for line in screen_text(app))
        await pilot.press("n", "o", "enter")
        await settle(app)
        assert any("The card is not begun" in line for line in screen_text(app))
        await pilot.press("escape")
        assert engine.asked == ["answer 0 no"], "nothing is ready"
        await pilot.press("r", "y", "enter", "9", "enter")
        await settle(app)
        assert any("9 m/s is above 6" in line for line in screen_text(app))
        await pilot.press("4", "enter")
        await pilot.pause()
        assert engine.asked[-2:] == ["answer 1 4", "ready"]
        assert engine.now.unanswered is None
        engine.now = replace(engine.now, stage=Stage.HELD)
        await pilot.press("h")
        assert isinstance(app.screen, Told)
        await settle(app)
        assert any("Wind: 4 m/s" in line for line in screen_text(app))


async def test_the_checklist_can_be_answered_before_and_asks_for_nothing_else():
    app, engine = app_on(ASKING)
    async with app.run_test(size=(80, 24)) as pilot:
        await pilot.press("2", "h", "y", "enter", "3", "enter")
        await pilot.pause()
        assert engine.asked == ["answer 0 y", "answer 1 3"]
        await pilot.press("h")
        assert isinstance(app.screen, Ask)
        await pilot.press("f12", "escape")
        assert engine.asked[-1] == "abort"
        engine.now = IDLE
        await pilot.press("h")
        await settle(app)
        assert any("no checklist" in line for line in screen_text(app))


# ------------------------------------------------------------------------------------------------ by ear


async def test_the_bell_rings_a_pattern_and_the_voice_says_all(monkeypatch):
    app, _ = app_on(IDLE)
    rung: list[object] = []
    said: list[str] = []
    app._rings, app._say = True, said.append
    async with app.run_test():
        monkeypatch.setattr(app, "bell", lambda: rung.append("ring"))
        monkeypatch.setattr(app, "set_timer", lambda after_s, do: rung.append(after_s))
        app.call_out([LIMIT, START])
    assert rung == ["ring", *LIMIT.pattern]
    assert said == ["limit, started"]


def test_a_voice_is_found_or_named_or_refused_in_a_line():
    assert voice("", which=lambda name: name if name == "espeak" else None) == ("espeak", "{}")
    assert voice("talk -s 180", which=lambda name: name) == ("talk", "-s", "180", "{}")
    assert voice("talk {} now", which=lambda name: name) == ("talk", "{}", "now")
    with pytest.raises(TippathError, match="--say: no voice is found"):
        voice("", which=lambda name: None)
    with pytest.raises(UsageError, match="no such program"):
        voice("talk", which=lambda name: None)
    with pytest.raises(UsageError, match="No closing quotation"):
        voice("talk '", which=lambda name: name)


def test_a_slow_voice_leaves_out_what_is_old_and_one_that_fails_is_silent():
    spoken: list[list[str]] = []
    begun, goes_on = threading.Event(), threading.Event()

    def run(command, **options):
        spoken.append(command)
        begun.set()
        assert goes_on.wait(10)
        raise subprocess.TimeoutExpired(command, 10) if len(spoken) == 1 else OSError("gone")

    speaker = Speaker(("talk", "{}"), run)
    speaker.say("one")
    assert begun.wait(10)
    speaker.say("two")
    speaker.say("three")
    goes_on.set()
    speaker.close(10)
    assert spoken in ([["talk", "one"]], [["talk", "one"], ["talk", "three"]])
    assert not speaker._thread.is_alive()


# ------------------------------------------------------------------------------------------------ time in the air


def test_time_in_the_air_is_counted_from_a_take_off_that_was_seen():
    ground = replace(RECORDING, armed=True, status=3)
    aloft = replace(RECORDING, armed=True, status=4)
    air = AirTime().seen(ground, 0.0).seen(aloft, 10.0)
    assert (air.seconds(25.0), air.known) == (15.0, True)
    air = air.seen(replace(aloft, lost=True), 30.0).seen(replace(ground, armed=False), 40.0)
    assert air.seconds(99.0) == 30.0
    assert air.seen(aloft, 100.0).seconds(101.0) == 1.0
    late = AirTime().seen(aloft, 10.0)
    assert (late.seconds(12.0), late.known) == (2.0, False)
    assert AirTime().seen(ground, 1.0).seconds(5.0) is None


# ------------------------------------------------------------------------------------------------ gloves and sun


def test_nothing_needs_two_keys_at_once():
    app, _ = app_on(IDLE)
    owners = [app, *(page("braille") for page in PAGES)]
    by_action: dict[tuple[str, str], list[str]] = {}
    for owner in owners:
        for key, binding in owner._bindings:
            by_action.setdefault((type(owner).__name__, binding.action), []).append(key)
    chords = {
        (owner, action): keys
        for (owner, action), keys in by_action.items()
        if all("+" in key.removesuffix("+") for key in keys) and not owner.startswith("_")
    }
    textual_own = {
        "focus_previous",
        "help_quit",
        "screenshot",
        "screen.copy_text",
        "copy_text",
        "suspend_process",
        "command_palette",
    }
    assert not {one for one in chords if one[1].removeprefix("app.") not in textual_own}


SUN_SCREENS = {"2": FLYING, "1": NOWHERE, "3": ANALYSED["open"], "7": ANALYSED["added"], "8": ANALYSED["designed"]}


@pytest.mark.parametrize("theme", ["sun", *thorough(["contrast"])])
async def test_every_character_stands_out_seven_times_in_the_sun(theme):
    app, engine = app_on(IDLE)
    app.theme = theme
    poor = set()
    async with app.run_test(size=(120, 40)) as pilot:
        for key, state in SUN_SCREENS.items():
            low = replace(state.vehicle, battery_remaining=0.1) if state.vehicle is not None else None
            engine.now = replace(state, vehicle=low)
            app.guided = True
            await pilot.press(key)
            await settle(app)
            for strip in app.screen._compositor.render_strips():
                for segment in strip:
                    style = segment.style
                    if not segment.text.strip() or style is None or style.color is None or style.bgcolor is None:
                        continue
                    fore, back = (tuple(one.get_truecolor()) for one in (style.color, style.bgcolor))
                    if themes.contrast(fore, back) < 7.0:
                        poor.add((key, segment.text.strip()[:30], fore, back))
    assert not poor


def test_contrast_is_that_of_the_web_s_guidelines():
    assert themes.contrast((0, 0, 0), (255, 255, 255)) == pytest.approx(21.0)
    assert themes.contrast((119, 119, 119), (255, 255, 255)) == pytest.approx(4.48, abs=0.01)
    assert themes.contrast((255, 0, 0), (255, 255, 255)) == pytest.approx(4.0, abs=0.01)


async def test_ascii_has_the_battery_s_shape_too():
    app, engine = app_on(replace(MOMENTS["idle"]), "ascii")
    async with app.run_test(size=(120, 40)) as pilot:
        assert engine.now.vehicle is not None
        engine.now = replace(engine.now, vehicle=replace(engine.now.vehicle, battery_remaining=0.5))
        await pilot.press("2")
        await settle(app)
        top = screen_text(app)[0]
        assert "##.. 50 %" in top
        assert top.isascii()
