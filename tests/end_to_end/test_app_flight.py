"""The app on the real simulated vehicle: connect, see samples, ready, start, abort, leave it as it was."""

from __future__ import annotations

import asyncio
import json
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from fake_app import make_ready, until

from gcs.demo.pilot import SimulatedVehicle
from gcs.tui.app import TippathApp
from gcs.tui.state import Mark, Stage
from gcs.tui.worker import FlightWorker

CARD = """\
name = "short"
[[maneuver]]
kind = "chirp"
axis = "roll"
amplitude = 0.05
duration_s = 8
f_start_hz = 1.0
"""


@pytest.fixture
def engine(tmp_path: Path) -> Iterator[FlightWorker]:
    """On a simulated vehicle of its own, with a short card."""
    card = tmp_path / "short.toml"
    card.write_text(CARD)
    worker = FlightWorker(
        None,
        plant="hover",
        start_vehicle=lambda: SimulatedVehicle("hover", tmp_path / "vehicle", seed=3),
        folder=tmp_path,
        primary=True,
        card=str(card),
    )
    try:
        yield worker
    finally:
        worker.close()


async def connected(engine):
    await until(lambda: engine.state().stage is Stage.IDLE)
    await until(lambda: engine.window(5).t.size > 3)


async def started(pilot, engine, elapsed_s):
    """S, and the chirp so far on."""
    await pilot.press("s")
    await until(lambda: engine.state().progress is not None and engine.state().progress.elapsed_s > elapsed_s)


async def aborted(pilot, engine):
    await pilot.press("f12")
    await until(lambda: engine.state().stage is Stage.HELD)


async def ended(pilot, engine):
    """The card, after an abort."""
    await pilot.press("escape", "e")
    await until(lambda: engine.state().stage is Stage.IDLE)


@pytest.mark.realtime
async def test_connect_see_samples_fly_and_abort(engine):
    app = TippathApp(engine, bell=False)
    async with app.run_test(size=(80, 24)) as pilot:
        await connected(engine)
        assert engine.state().vehicle.armed

        await make_ready(pilot, engine)
        assert engine.state().vehicle.mode_name == "Stabilize", "ready moves nothing"
        assert engine.window(5).t.size > 500, "the log arrives at 500 Hz"
        assert "returns home" in engine.state().link_loss

        await started(pilot, engine, 1.0)
        assert engine.state().vehicle.mode_name == "SystemID"
        # the newest sample's excitation comes in a later message than its rates
        assert np.nanmax(np.abs(engine.window(2).excitation_x)) > 0.02

        await pilot.press("c")
        await pilot.press("x")
        await aborted(pilot, engine)
        assert engine.state().runs[0].mark is Mark.NEXT, "it waits to be flown again, or for the card's end"
        await ended(pilot, engine)
        state = engine.state()
        assert state.vehicle.mode_name == "Stabilize"
        assert state.vehicle.armed
        assert state.runs[0].mark is Mark.AGAIN
        assert "aborted" in " ".join(state.runs[0].why)
        about = json.loads((state.flight / "flight.json").read_text())
        assert [run["ending"] for run in about["runs"]] == ["aborted", "aborted"]
        assert [run["verdict"] is None for run in about["runs"]] == [False, True]
        assert about["missing_blocks"] == 0


@pytest.mark.realtime
@pytest.mark.thorough
async def test_quitting_in_a_chirp_aborts_it_first_and_the_log_is_whole(engine):
    app = TippathApp(engine, bell=False)
    async with app.run_test(size=(80, 24)) as pilot:
        await connected(engine)
        await make_ready(pilot, engine)
        await started(pilot, engine, 0.3)
        await aborted(pilot, engine)
        await ended(pilot, engine)
        before = engine.state().flight

        await make_ready(pilot, engine)
        await started(pilot, engine, 0.3)
        await pilot.press("7", "q", "y")
        await until(lambda: app._exit)
    await asyncio.to_thread(engine.close)
    again = engine.state()
    assert again.flight != before
    about = json.loads((again.flight / "flight.json").read_text())
    assert [run["ending"] for run in about["runs"]] == ["aborted"]
    assert about["missing_blocks"] == 0
