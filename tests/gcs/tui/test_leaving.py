"""Leaving the app while something flies: what is asked says what does, and who ends it."""

from __future__ import annotations

from dataclasses import replace

import pytest
from fake_app import IDLE, VEHICLE, app_on, screen_text, settle

from gcs.tui.leaving import before_quitting
from gcs.tui.state import Bank, Replaying, Stage
from gcs.tui.widgets.lines import Lines


@pytest.mark.parametrize(("stage", "words"), [(Stage.HELD, "no run flies"), (Stage.FLYING, "aborts the run first")])
async def test_between_two_runs_nothing_is_said_to_be_aborted(stage: Stage, words: str) -> None:
    app, _ = app_on(replace(IDLE, stage=stage))
    async with app.run_test(size=(80, 24)) as pilot:
        await pilot.press("q")
        await settle(app)
        assert words in " ".join("\n".join(screen_text(app)).split())


LQR = Bank(0xB9E9E2, None, True)
REAL = replace(IDLE, plant=None)


async def test_a_vehicle_under_the_lqr_is_left_after_a_yes() -> None:
    app, engine = app_on(replace(REAL, bank=LQR))
    async with app.run_test(size=(80, 24)) as pilot:
        await pilot.press("q")
        await settle(app)
        assert "only the pilot's switch ends it" in " ".join(app.screen.query_one("#hint", Lines).shown.split())
        await pilot.press("n")
        assert not app._exit
        await pilot.press("q", "y")
        await pilot.pause()
        assert app._exit
        assert engine.asked == [], "nothing is sent to a vehicle that the pilot has"


def test_only_what_flies_here_is_asked_about() -> None:
    assert IDLE.vehicle is not None
    assert IDLE.vehicle.armed
    assert before_quitting(IDLE) == (), "a simulated one ends with the app"
    assert "ends with the app" in before_quitting(replace(IDLE, bank=LQR))[0]
    assert "the pilot has it" in before_quitting(REAL)[0]
    off = replace(LQR, switch_on=False)
    assert "LQR" not in before_quitting(replace(REAL, bank=off))[0]
    assert before_quitting(replace(REAL, vehicle=replace(VEHICLE, armed=False))) == ()
    assert before_quitting(replace(REAL, replay=Replaying("flight-0001", 0.0, 1.0, 1.0, False))) == ()
    unkept = replace(REAL, bank=LQR, desk=replace(REAL.desk, unkept=("TPP",)))
    assert [line.split()[0] for line in before_quitting(unkept)] == ["The", "This", "Not"]
