"""Leaving the app while a card is under way: what is asked says what flies."""

from __future__ import annotations

from dataclasses import replace

import pytest
from fake_app import IDLE, app_on, screen_text, settle

from gcs.tui.state import Stage


@pytest.mark.parametrize(("stage", "words"), [(Stage.HELD, "no run flies"), (Stage.FLYING, "aborts the run first")])
async def test_between_two_runs_nothing_is_said_to_be_aborted(stage: Stage, words: str) -> None:
    app, _ = app_on(replace(IDLE, stage=stage))
    async with app.run_test(size=(80, 24)) as pilot:
        await pilot.press("q")
        await settle(app)
        assert words in " ".join("\n".join(screen_text(app)).split())
