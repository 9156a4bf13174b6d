"""Diagnose: candidates ranked while they are asked, the answer after it, and what a candidate is."""

from __future__ import annotations

from dataclasses import replace

import pytest
from fake_app import IDLE, app_on, screen_text, settle
from fake_desk import DESKS

from gcs.tui import changing
from gcs.tui.pages import PAGES, mode_of
from gcs.tui.ranking_words import effects_offered
from gcs.tui.state import State, joined


def at(moment: str) -> State:
    return joined(IDLE, DESKS[moment])


async def test_the_table_is_there_while_it_is_asked_and_the_answer_after_it():
    app, engine = app_on(at("asking"))
    async with app.run_test(size=(80, 24)) as pilot:
        await pilot.press("6")
        await settle(app)
        text = "\n".join(screen_text(app))
        assert "refitting with dynamic_inflow (2 of 2)" in text
        assert "best so far servo_lag, 90 %   3 s so far, about 3 s left" in text
        assert "K ends it and keeps the ranking so far" in text
        await pilot.press("k")
        assert engine.asked[-1] == "desk cancel"
        engine.now = at("called off")
        await settle(app)
        text = "\n".join(screen_text(app))
        assert "NOT A VERDICT" in text
        assert "servo_lag" in text
        engine.now = at("asked")
        await settle(app)
        await settle(app)  # the text has its width once it is there
        assert any(line.startswith(" missing: servo_lag") for line in screen_text(app))


async def test_a_candidate_is_told_about_by_enter_and_by_a_press_and_escape_goes_back():
    app, engine = app_on(at("asked"))
    async with app.run_test(size=(80, 24)) as pilot:
        await pilot.press("6")
        await settle(app)
        await pilot.press("v", "down", "enter")
        await settle(app)
        text = "\n".join(screen_text(app))
        assert "added, it removes 90 % of the avoidable error" in text
        assert "physics does not allow its k_l" in text
        assert "what its lack looks like" in text
        await pilot.press("escape")
        await settle(app)
        lines = screen_text(app)
        row = next(number for number, line in enumerate(lines) if "airspeed_scaling" in line)
        assert "not testable: it needs airspeed" in lines[row]
        await pilot.click(offset=(6, row))
        await settle(app)
        assert "not testable on these runs: it needs airspeed" in "\n".join(screen_text(app))
        assert not [one for one in engine.asked if one == "desk cancel"], (
            "escape closed the text, and called nothing off"
        )


async def test_after_an_effect_is_added_it_says_what_changed_and_what_to_press():
    app, _ = app_on(at("added"))
    async with app.run_test(size=(80, 24)) as pilot:
        await pilot.press("6")
        await settle(app)
        text = "\n".join(screen_text(app))
        assert "servo_lag is added: NRMSE p 64.1 → 81.0 %, q 70.9 → 87.6 %" in text
        assert "7 shows the ladder" in text
        assert "next: D asks what TPP + servo_lag lacks" in text


@pytest.mark.parametrize(("size", "offered"), [((80, 24), True), ((120, 40), False)])
async def test_the_key_for_the_next_view_is_offered_only_where_there_is_one(size, offered):
    app, _ = app_on(at("asked"))
    async with app.run_test(size=size) as pilot:
        for screen in ("4", "6"):
            await pilot.press(screen)
            await settle(app)
            footer = next(line for line in screen_text(app) if "D diagnose" in line or "M model" in line)
            assert ("V view" in footer) is offered
        await pilot.press("v")
        await settle(app)
        assert any("both views stand here already" in line for line in screen_text(app)) is not offered


async def test_another_flight_begins_at_the_first_view():
    app, engine = app_on(at("asked"))
    async with app.run_test(size=(80, 24)) as pilot:
        await pilot.press("6", "e")
        await settle(app)
        assert app.screen.full  # type: ignore[attr-defined]
        engine.now = replace(engine.now, desk=replace(engine.now.desk, path=engine.now.desk.path / "other"))
        await settle(app)
        assert not app.screen.full  # type: ignore[attr-defined]


async def test_every_screen_is_made_before_it_is_asked_for_and_the_one_that_is_seen_stays(monkeypatch):
    monkeypatch.setattr(changing, "BEGIN_S", 0.01)
    monkeypatch.setattr(changing, "EVERY_S", 0.01)
    monkeypatch.setattr(changing.gc, "freeze", lambda: None)
    app, _ = app_on(at("asked"))
    async with app.run_test(size=(80, 24)) as pilot:
        first, all_pages = app.current_mode, {mode_of(page) for page in PAGES}
        for _ in range(500):
            if all_pages <= app._screen_stacks.keys() and app.current_mode == first:
                break
            await pilot.pause(0.02)
        assert all_pages <= app._screen_stacks.keys()
        assert app.current_mode == first


async def test_where_nothing_is_named_the_marked_candidate_is_added_once_that_was_said():
    app, engine = app_on(at("unexplained"))
    async with app.run_test(size=(80, 24)) as pilot:
        await pilot.press("6")
        await settle(app)
        await pilot.press("a")
        await settle(app)
        assert "nothing is missing by name; I adds an effect that you choose" in "\n".join(screen_text(app))
        await pilot.press("v", "down", "a")
        await settle(app)
        text = "\n".join(screen_text(app))
        assert "Add dynamic_inflow all the same?" in text
        assert "the diagnosis does not name it: unexplained" in text
        await pilot.press("n")
        assert not [one for one in engine.asked if one.startswith("desk add")]
        await pilot.press("a", "y")
        await settle(app)
        assert "desk add dynamic_inflow" in engine.asked


async def test_what_may_be_added_is_listed():
    app, engine = app_on(at("asked"))
    async with app.run_test(size=(80, 24)) as pilot:
        await pilot.press("6")
        await settle(app)
        await pilot.press("i", "down", "down", "down")
        await settle(app)
        text = "\n".join(screen_text(app))
        assert "servo_lag          94 % of the avoidable error" in text
        assert "airspeed_scaling" not in text
        await pilot.press("enter")
        await settle(app)
        assert "desk add quadratic_damping" in engine.asked
    assert ("servo_lag", "first-order lag of the servos") in effects_offered(DESKS["fitted"])
    assert effects_offered(DESKS["open"]) == []
