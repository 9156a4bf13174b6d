"""Screens are made before they are asked for, and none while the app is left."""

from __future__ import annotations

from fake_app import IDLE, app_on

from gcs.tui import changing
from gcs.tui.pages import PAGES, mode_of


async def test_screens_that_were_made_are_styled_and_laid_out(monkeypatch):
    monkeypatch.setattr(changing, "BEGIN_S", 0.001)
    monkeypatch.setattr(changing, "EVERY_S", 0.001)
    app, _ = app_on(IDLE)

    def ready(page):
        made = app._screen_stacks.get(mode_of(page), [None])[0]
        return made is not None and made._css_update_count == app._css_update_count and made.query_one("#keys").size

    async with app.run_test(size=(80, 24)) as pilot:
        for _ in range(500):
            if all(map(ready, PAGES)):
                break
            await pilot.pause(0.01)
        assert [page for page in PAGES if not ready(page)] == []
        assert mode_of(PAGES[-1]) != app.current_mode


async def test_no_screen_is_made_while_the_app_closes_its_screens():
    app, _ = app_on(IDLE)
    async with app.run_test(size=(80, 24)):
        before, left = [*app._screen_stacks], len(app._unmade)
    await app._make_one()
    assert left == len(app._unmade) > 0
    assert [*app._screen_stacks] == before
