"""Whole flights of a stock vehicle on which something goes wrong, in fake time: each is told, with what to do next, and
nothing that was flown is lost.
"""

from __future__ import annotations

import errno
import json
from pathlib import Path

import pytest
from fetched import dataflash
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from slow_flight import TWO_CHIRPS, SlowFlight, in_one_line

from gcs.cli import main
from gcs.flight.fetching.part import PartFile
from gcs.flight.folder import FlightFolder
from gcs.logs import ingest
from sitl.autopilot.logger import FileSink
from sitl.faults.others import start_of_log


def test_a_client_takes_the_log_in_mid_run_and_the_laptops_disk_is_full_when_the_rest_is_fetched(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    flown = SlowFlight(
        monkeypatch,
        "hover-ideal",
        "ardupilot-heli",
        tmp_path / "sd",
        bytes_s=300_000.0,
        settings={"LOG_BACKEND_TYPE": 3, "LOG_MAV_BUFSIZE": 50},
    )
    (tmp_path / "card.toml").write_text(TWO_CHIRPS)
    flight = tmp_path / "flight-0001"
    flown.sleep(42.0)  # it boots
    began, swept = flown.now(), 0.0

    def others_act() -> None:
        nonlocal swept
        if flown.now() > began + 8.0 and not flown.vehicle.armed and not swept:
            flown.pilot("takeoff")
        if flown.vehicle.sweeping and not swept:
            swept = flown.now()
        if swept and began and flown.now() > swept + 4.0 and not flown.wire.others_say and others:
            flown.wire.others_say.append(others.pop())

    others = [bytes(start_of_log().pack(mavlink.MAVLink(None, 253, 190)))]
    flown.between = others_act
    card = ("--card", tmp_path / "card.toml")
    assert flown.tippath("sweep", "--wait", "--no-probe", *card, "-o", flight) == 1
    flown.between = lambda: None
    said, err = capsys.readouterr()
    assert "no new block of the vehicle's log" in in_one_line(said), err
    assert f"`tippath fetch --connect LINK -o {flight}`; both are read together" in said
    streamed = (flight / "flight.BIN").read_bytes()
    (run,) = FlightFolder(flight).runs()
    assert run["ending"] == "log stopped"

    flown.pilot("land")
    flown.sleep(30.0)
    flown.pilot("reboot")
    flown.sleep(3.0)
    (flown.vehicle.storage.directory / "vehicle-9.BIN").write_bytes(dataflash(200.0, rate_hz=20))  # type: ignore[operator, union-attr]
    append = PartFile.append

    def full(self: PartFile, data: bytes) -> None:
        if self.size > 100_000:
            raise self._refusal(OSError(errno.ENOSPC, "No space left on device"))
        append(self, data)

    with monkeypatch.context() as patched:
        patched.setattr(PartFile, "append", full)
        assert flown.tippath("fetch", "--whole", "-o", flight) == 1
    said = in_one_line(capsys.readouterr().err)
    assert "No space left on device" in said
    assert "give the same command again to go on" in said

    assert flown.tippath("fetch", "--whole", "-o", flight, "--json") == 0
    out, err = capsys.readouterr()
    fetched = json.loads(out)
    assert "by its bytes, of 2 logs with the same clock" in err
    assert fetched["resumed_from"] > 100_000
    assert Path(fetched["file"]).read_bytes() == (tmp_path / "sd" / "vehicle-1.BIN").read_bytes()
    assert fetched["joined"]["complete"] is True
    assert fetched["joined"]["files"][1]["filled"] > 1000
    assert (flight / "flight.BIN").read_bytes() == streamed

    assert main(["ingest", str(flight)]) == 1, "a run that was ended is not taken unasked"
    out = in_one_line(capsys.readouterr().out)
    assert "0 missing" in out
    assert "flight.BIN#1" in out
    assert not ingest([flight]).runs[0].gaps

    assert flown.tippath("fetch", "--whole", "--log", "9", "-o", flight) == 0
    assert "not read with the streamed log: they share no sample" in capsys.readouterr().out
    assert main(["ingest", str(flight)]) == 1
    out = capsys.readouterr().out
    assert "fetched-00000009.BIN is not read with it: they share no sample" in out
    assert "0 missing" in out


@pytest.mark.thorough
def test_a_card_that_gets_full_ends_the_run_and_gives_the_one_before(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    flown = SlowFlight(monkeypatch, "hover-ideal", "ardupilot-heli", tmp_path / "sd")
    (tmp_path / "card.toml").write_text(TWO_CHIRPS)
    flight = tmp_path / "flight-0001"
    flown.sleep(42.0)
    flown.pilot("takeoff")
    flown.sleep(8.0)
    starts: list[float] = []
    sweeping = False

    def look() -> None:
        nonlocal sweeping
        if flown.vehicle.sweeping and not sweeping:
            starts.append(flown.now())
        sweeping = flown.vehicle.sweeping

    write = FileSink.write

    def full(self: FileSink, data: bytes) -> None:
        if len(starts) == 2 and flown.now() > starts[1] + 3.0:
            raise OSError(errno.ENOSPC, "No space left on device")
        write(self, data)

    monkeypatch.setattr(FileSink, "write", full)
    flown.between = look
    assert flown.tippath("sweep", "--log", "card", "--card", tmp_path / "card.toml", "-o", flight) == 1
    flown.between = lambda: None
    said = in_one_line(capsys.readouterr().out)
    assert "the vehicle says 'Logging failed: No space left on device'" in said
    assert [run["ending"] for run in FlightFolder(flight).runs()] == ["finished", "log stopped"]
    flown.pilot("land")
    flown.sleep(25.0)
    monkeypatch.setattr(FileSink, "write", write)
    assert flown.tippath("fetch", "-o", flight) == 0
    in_one_line(capsys.readouterr().err)
    assert main(["ingest", str(flight)]) == 0
    out = in_one_line(capsys.readouterr().out)
    assert [run.usable for run in ingest([flight]).runs] == [True, False]
    assert "Logging failed: No space left on device" in out


def test_a_vehicle_without_the_systemid_mode_says_what_to_put_on_it(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    flown = SlowFlight(monkeypatch, "hover-ideal", "ardupilot-heli", tmp_path / "sd", bytes_s=100_000.0)
    table = flown.vehicle.parameters.table
    for name in [name for name in table if name.startswith("SID_")]:
        del table[name]
    flown.sleep(2.0)
    (tmp_path / "card.toml").write_text(TWO_CHIRPS)
    assert flown.tippath("sweep", "--log", "card", "--card", tmp_path / "card.toml", "-o", tmp_path / "f") == 1
    said = in_one_line(capsys.readouterr().err)
    assert "it has no SID_AXIS" in said
    assert "put a build with it on the vehicle" in said
    assert not (tmp_path / "f").exists()
    assert flown.tippath("check", "--card", tmp_path / "card.toml") == 1
    assert "built without the SystemID mode" in in_one_line(capsys.readouterr().out)
