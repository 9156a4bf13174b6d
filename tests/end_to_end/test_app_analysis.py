"""A hidden effect found on the screens: runs, fit, comparison, diagnosis, ladder, gains, their push, the commands."""

from __future__ import annotations

from pathlib import Path

import pytest
from fake_app import screen_text, settle, until
from flown_folder import fly_folder
from flying import CHIRP, DOUBLET, LAG, PITCH, ROLL, TWO_CHIRPS, Card
from textual.widgets import Input

from gcs.tui.app import TippathApp
from gcs.tui.base import Dialog
from gcs.tui.connections import simulated
from gcs.tui.reconnect import Reconnecting
from gcs.tui.state import Stage
from gcs.tui.widgets.lines import Lines

CARD = (
    *((CHIRP, axis, size, 8.0) for axis, size in ((ROLL, 0.10), (PITCH, 0.15))),
    *((DOUBLET, axis, size, 4.0) for axis, size in ((ROLL, 0.10), (PITCH, 0.15))),
)

LONG: Card = tuple((CHIRP, axis, size, 10.0) for axis, size in ((ROLL, 0.10), (PITCH, 0.15)))
"""Long enough to be halved."""


@pytest.mark.usefixtures("only_effects", "answers_kept")
@pytest.mark.parametrize("only_effects", [("gyro_lag", "servo_lag", "transport_delay")], indirect=True)
async def test_a_lag_is_found_added_and_gains_are_designed(tmp_path: Path) -> None:
    flight = fly_folder(tmp_path / "flight-0001", LAG, CARD).path
    engine = Reconnecting(folder=tmp_path)
    desk = engine.desk
    app = TippathApp(engine, bell=False, connections=engine, first="connect")
    try:
        async with app.run_test(size=(120, 40)) as pilot:

            async def shown() -> str:
                await settle(app)
                return "\n".join(screen_text(app))

            assert "up/down and enter choose where to connect" in await shown()
            await pilot.press("3", "o")
            app.screen.query_one(Input).value = str(flight)
            await pilot.press("enter")
            await until(lambda: len(desk.state().runs) == 4)
            assert "4 fits 2 runs, checked on 2 others" in await shown()

            await pilot.press("4", "f")
            await until(lambda: desk.state().comparison is not None)
            text = await shown()
            assert "modes  " in text
            assert "measured" in text, "strips beside the tables"
            await pilot.press("5")
            assert "% of the error sits in" in await shown()

            await pilot.press("6")
            app.simulate_key("d")  # the pilot's own press waits until nothing is worked on
            await until(lambda: desk.state().busy != "")
            app.simulate_key("f12")
            await until(lambda: "nothing to abort" in engine.state().said, 2)
            app.simulate_key("k")
            await until(lambda: not desk.state().busy)
            assert desk.state().answer is None
            assert "called off" in await shown()
            await pilot.press("d")
            await until(lambda: desk.state().answer is not None and not desk.state().busy)
            text = await shown()
            assert "missing: servo_lag" in text or "missing: gyro_lag" in text, "the two cannot be told apart here"
            assert "next: A adds" in text
            await pilot.press("e")
            assert "what it is" in await shown()

            await pilot.press("7", "a")
            await until(lambda: len(desk.state().ladder) == 2 and desk.state().comparison is not None)
            text = await shown()
            assert "error beyond noise" in text
            assert "_lag" in text
            bottom, top = desk.state().ladder
            assert top.nrmse_percent["q"] > bottom.nrmse_percent["q"] + 5
            await pilot.press("p")
            assert "error falls on runs that were not fitted" in await shown()
            await pilot.press("escape", "u")
            assert len(desk.state().ladder) == 1
            await pilot.press("a")
            await until(lambda: len(desk.state().ladder) == 2 and not desk.state().busy)

            await pilot.press("8", "d")
            await until(lambda: desk.state().designed is not None and not desk.state().busy)
            assert "gain margin" in await shown()

            commands = engine.state().commands
            for word in ("ingest", "fit", "compare", "diagnose", "add", "design"):
                assert any(f"tippath {word} " in one for one in commands), word
    finally:
        engine.close()


@pytest.mark.usefixtures("answers_kept")
async def test_one_log_is_split_into_fit_and_validation_by_keys(tmp_path: Path) -> None:
    flight = fly_folder(tmp_path / "flight-0001", None, LONG).path
    engine = Reconnecting(folder=tmp_path)
    desk = engine.desk
    app = TippathApp(engine, bell=False, connections=engine, first="connect", flights=[str(flight)])
    try:
        async with app.run_test(size=(80, 24)) as pilot:
            await until(lambda: len(desk.state().runs) == 2 and not desk.state().busy)
            await pilot.press("3")
            await settle(app)
            await pilot.press("h")
            await until(lambda: len(desk.state().runs) == 3 and not desk.state().busy)
            await settle(app)
            await pilot.press("down", "down", "h")
            await until(lambda: len(desk.state().runs) == 4 and not desk.state().busy)
            await settle(app)
            await settle(app)
            assert "4 fits 2 runs, checked on 2 others" in "\n".join(screen_text(app))
            await pilot.press("4", "f")
            await until(lambda: desk.state().comparison is not None and not desk.state().busy)
            fit = desk.state().ladder[0].fit
            first, second = [one.id for one in fit.records], [one.id for one in fit.validation]
            assert first == ["flight.BIN#1@:5", "flight.BIN#2@:5"]
            assert second == ["flight.BIN#1@5:", "flight.BIN#2@5:"]
            assert fit.validation_nrmse_percent is not None
            command = next(one for one in engine.state().commands if "--model tpp" in one)
            assert "flight.BIN#1@:5" in command.partition("--validate")[0]
            assert "flight.BIN#2@5:" in command.partition("--validate")[2]
    finally:
        engine.close()


@pytest.mark.realtime
async def test_gains_of_the_desk_are_pushed_to_a_vehicle_that_comes_later(tmp_path: Path) -> None:
    flight = fly_folder(tmp_path / "flight-0001", None, TWO_CHIRPS).path
    engine = Reconnecting(folder=tmp_path)
    desk = engine.desk
    app = TippathApp(engine, bell=False, connections=engine, first="connect")
    try:
        async with app.run_test(size=(120, 40)) as pilot:
            await pilot.press("3", "o")
            app.screen.query_one(Input).value = str(flight)
            await pilot.press("enter")
            await until(lambda: len(desk.state().runs) == 2)
            await pilot.press("4", "f")
            await until(lambda: desk.state().comparison is not None)
            await pilot.press("8", "d")
            await until(lambda: desk.state().designed is not None and not desk.state().busy)

            app.connect_to(simulated("hover-ideal", seed=3, on_ground=True))
            await until(lambda: engine.state().stage is Stage.IDLE and engine.state().vehicle is not None)
            await pilot.press("p")
            assert isinstance(app.screen, Dialog)
            await pilot.press("y")
            designed = desk.state().designed
            await until(lambda: engine.state().bank is not None and engine.state().bank.active == designed.crc)
            await pilot.press("9")
            await until(lambda: "pushed gains" in app.screen.query_one("#text", Lines).shown)
            assert any("tippath push " in command for command in engine.state().commands)
    finally:
        engine.close()
