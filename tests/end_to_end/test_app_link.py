"""The app on the real simulated vehicle when the link is lost and found: what it says, and what it leaves undone."""

from __future__ import annotations

import asyncio
import json
import re
import time
from pathlib import Path

import pytest
from fake_app import make_ready, screen_text, settle, until
from radio import Radio, on_radio

from gcs.tui.app import TippathApp
from gcs.tui.state import Mark, Stage
from gcs.tui.worker import FlightWorker

CARD = """\
name = "short"
[[maneuver]]
kind = "chirp"
axis = "roll"
amplitude = 0.05
duration_s = 12
f_start_hz = 1.0
"""
OUTAGE_S = 4.2
"""Longer than the 3.5 s after which a link counts as lost."""


@pytest.mark.realtime
async def test_a_link_lost_in_a_chirp_is_told_and_nothing_is_flown_after_it(tmp_path: Path) -> None:
    card = tmp_path / "short.toml"
    card.write_text(CARD)
    radio: list[Radio] = []

    def start() -> Radio:
        radio.append(on_radio("hover-ideal", tmp_path / "vehicle", seed=3))
        return radio[0]

    # Not the station that holds the vehicle's failsafe: so the vehicle chirps on, and is to be brought back.
    engine = FlightWorker(None, plant="hover-ideal", start_vehicle=start, folder=tmp_path, card=str(card))
    try:
        app = TippathApp(engine, bell=False)
        async with app.run_test(size=(80, 24)) as pilot:

            async def shown() -> str:
                await settle(app)
                return "\n".join(screen_text(app))

            await until(lambda: engine.state().stage is Stage.IDLE)
            await make_ready(pilot, engine)
            await pilot.press("s")
            await until(lambda: engine.state().progress is not None and engine.state().progress.elapsed_s > 0.5)

            radio[0].cut, cut_at = True, time.monotonic()
            await until(lambda: app._seen is not None and app._seen.lost and app._seen.stage is Stage.ABORTING)
            text = await shown()
            silent = re.search(r"LINK LOST (\d+\.\d) s", text.splitlines()[0])
            assert silent is not None
            assert 3.5 <= float(silent[1]) <= time.monotonic() - cut_at + 0.5, "since a message was heard, not longer"
            assert "SystemID (last heard)" in text.splitlines()[0]
            assert "LINK LOST IN THE RUN" in text
            assert "next: the PILOT ends it with the transmitter" in text
            await asyncio.sleep(max(0.0, cut_at + OUTAGE_S - time.monotonic()))
            radio[0].cut = False

            await until(lambda: engine.state().stage is Stage.IDLE)
            state = engine.state()
            assert (state.vehicle.mode_name, state.vehicle.armed) == ("Stabilize", True)
            assert state.runs[0].mark is Mark.AGAIN
            assert "link lost" in " ".join(state.runs[0].why)
            await asyncio.sleep(1.0)
            assert engine.state().stage is Stage.IDLE, "nothing goes on by itself"
            assert engine.state().vehicle.mode_name == "Stabilize"
            text = await shown()
            assert "LINK LOST" not in text.splitlines()[0]
            assert "planned samples not flown or not received" in " ".join(text.split())
            about = json.loads((state.flight / "flight.json").read_text())
            assert [run["ending"] for run in about["runs"]] == ["link lost"]
            assert about["missing_blocks"] == 0
            assert about["recording"]["complete"] is True
    finally:
        for one in radio:
            one.cut = False
        engine.close()
    log = (state.flight / "flight.BIN").read_bytes()
    own = [path.read_bytes() for path in (tmp_path / "vehicle").glob("*.BIN")]
    assert log in own, "what was recorded is the vehicle's own log, byte for byte"
