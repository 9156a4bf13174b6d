"""A whole fetch, by either way, in fake time: the file is the vehicle's, byte for byte, whatever the air does."""

from __future__ import annotations

from pathlib import Path

import pytest
from fetched import Air, FileSession, FileVehicle, noise

from gcs.flight.fetching import pick
from gcs.flight.fetching.fetch import Fetching, fetch
from gcs.flight.fetching.ways import list_logs

CONTENT = noise(60_001)
OUTAGE_S = 20.0


@pytest.mark.parametrize("loss", [0.0, 0.02, 0.1])
@pytest.mark.parametrize("outage", [False, True])
@pytest.mark.parametrize("way", ["ftp", "log"])
def test_the_file_is_the_vehicles(way: str, outage: bool, loss: float, tmp_path: Path) -> None:
    card, out = tmp_path / "card", tmp_path / "out"
    for folder in (card, out):
        folder.mkdir()
    (card / "vehicle-7.BIN").write_bytes(CONTENT)
    vehicle = FileVehicle(card, Air(loss=loss))
    session = FileSession(vehicle)
    part = out / "log.BIN.part"

    def fall_silent(_: FileVehicle) -> None:
        """For a while, once some of the file is there."""
        if outage and vehicle.air.outage[1] == 0.0 and part.exists() and part.stat().st_size > 20_000:
            vehicle.air.outage = (vehicle.now, vehicle.now + OUTAGE_S)

    session.meanwhile = fall_silent
    began = session.now()
    log = pick.newest(list_logs(session)).log
    done = fetch(Fetching(session=session, clock=session.now, wait=session.wait, by=way), log, out, "log")
    assert done.path.read_bytes() == CONTENT
    assert [path.name for path in out.iterdir()] == ["log.BIN"]
    assert (session.now() - began > OUTAGE_S) == outage
