"""I on Runs: the flight's log off the vehicle, in the way of `tippath fetch`, called off by a key."""

from __future__ import annotations

import functools
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from fake_app import IDLE, FakeWorker, app_on, screen_text, settle
from fake_desk import DESKS
from fetched import FileSession, FileVehicle, dataflash, noise

from gcs.errors import TippathError
from gcs.flight.fetching import fetch as fetching
from gcs.flight.folder import FlightFolder
from gcs.tui.log_fetching import LogFetching
from gcs.tui.state import FETCHING, joined

FLIGHT = dataflash(400.0, start_s=100.0)


@pytest.fixture
def session(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Any:
    """A vehicle in fake time with two logs: the older is the flight's."""
    card = tmp_path / "card"
    card.mkdir()
    (card / "vehicle-4.BIN").write_bytes(FLIGHT)
    (card / "vehicle-5.BIN").write_bytes(noise(20_000))
    made = FileSession(FileVehicle(card))
    monkeypatch.setattr(fetching, "Fetching", functools.partial(fetching.Fetching, clock=made.now, wait=made.wait))
    return made


@pytest.fixture
def flight(tmp_path: Path) -> Path:
    path = tmp_path / "flight-0001"
    path.mkdir()
    folder = FlightFolder(path)
    folder.log.write_bytes(FLIGHT[:50_000])
    folder.write({"runs": [{"label": "roll", "log_start_s": 110.0, "duration_s": 9.0}]})
    return path


def test_the_flights_own_log_comes_beside_what_was_streamed(session: Any, flight: Path) -> None:
    said: list[str] = []
    (came,) = LogFetching().bring(session, flight, said.append)
    assert came == flight / "fetched-00000004.BIN"
    assert came.read_bytes() == FLIGHT
    assert FlightFolder(flight).read()["fetched"][0]["file"] == came.name
    assert any("left" in text for text in said)


def test_what_is_called_off_is_gone_on_with(session: Any, flight: Path) -> None:
    fetch = LogFetching()

    def off(text: str) -> None:
        if "left" in text:
            fetch.call_off()

    with pytest.raises(TippathError, match="called off"):
        fetch.bring(session, flight, off)
    assert not (flight / "fetched-00000004.BIN").exists()
    assert (flight / "fetched-00000004.BIN.part").stat().st_size > 0
    (came,) = fetch.bring(session, flight, lambda _: None)
    assert came.read_bytes() == FLIGHT


async def test_the_keys_and_what_stands_meanwhile():
    app, engine = app_on(joined(IDLE, DESKS["open"]))
    assert isinstance(engine, FakeWorker)
    async with app.run_test(size=(80, 24)) as pilot:
        await pilot.press("3", "i")
        await app.workers.wait_for_complete()
        assert engine.asked == ["fetch"]
        engine.now = replace(engine.now, busy=f"{FETCHING}: 12 %")
        await settle(app)
        assert "fetching the log: 12 %; K calls it off" in "\n".join(screen_text(app))
        await pilot.press("k")
        assert engine.called_off == 1
