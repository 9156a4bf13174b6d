"""`tippath fetch`: what it says and leaves, and once for real over loopback, cut by Ctrl-C and gone on with."""

from __future__ import annotations

import functools
import json
import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from fetched import FileSession, FileVehicle, dataflash, noise

from gcs.cli import main
from gcs.flight.fetching import fetch as fetching
from gcs.flight.folder import FlightFolder
from gcs.flight.session import Session

LINK = ("--connect", "udpout:127.0.0.1:1")
FLIGHT = dataflash(60.0, start_s=100.0)


@pytest.fixture
def session(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> FileSession:
    """A vehicle in fake time with two logs: the older is the flight's."""
    card = tmp_path / "card"
    card.mkdir()
    (card / "vehicle-4.BIN").write_bytes(FLIGHT)
    (card / "vehicle-5.BIN").write_bytes(noise(20_000))
    made = FileSession(FileVehicle(card))
    monkeypatch.setattr(Session, "open", lambda *_, **__: made)
    in_fake_time = functools.partial(fetching.Fetching, clock=made.now, wait=made.wait)
    monkeypatch.setattr(fetching, "Fetching", in_fake_time)
    return made


def run(capsys: pytest.CaptureFixture[str], *words: str | Path) -> tuple[int, str, str]:
    try:
        status = main(["fetch", *LINK, *map(str, words)])
    except SystemExit as ended:
        status = int(ended.code or 0)
    return (status, *capsys.readouterr())


def flight_folder(path: Path) -> Path:
    path.mkdir()
    folder = FlightFolder(path)
    folder.log.write_bytes(FLIGHT[:50_000])
    folder.write({"runs": [{"label": "roll", "log_start_s": 110.0, "duration_s": 9.0}], "name": "mine"})
    return path


def test_the_newest_log_comes_into_any_folder(
    session: FileSession, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    status, out, err = run(capsys, "-o", tmp_path / "deep" / "out")
    assert (status, (tmp_path / "deep" / "out" / "00000005.BIN").read_bytes()) == (0, noise(20_000))
    assert "fetched" in out
    assert "as on the vehicle" in out
    assert "log 5 (the newest): 20.0 kB" in err
    assert "is there already" in run(capsys, "-o", tmp_path / "deep" / "out")[1]


def test_a_flights_own_log_comes_beside_what_was_streamed(
    session: FileSession, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = flight_folder(tmp_path / "flight-0001")
    status, out, _ = run(capsys, "-o", folder, "--run", "1", "--json")
    document = json.loads(out)
    assert status == 0
    assert (folder / "fetched-00000004.BIN").read_bytes() == FLIGHT
    assert (folder / "flight.BIN").read_bytes() == FLIGHT[:50_000]
    assert document["format"] == "tippath.fetch/1"
    assert (document["log"], document["checked"], document["run"]) == (4, True, None)
    about = FlightFolder(folder).read()
    assert (about["name"], len(about["runs"])) == ("mine", 1)
    assert [(entry["file"], entry["log"]) for entry in about["fetched"]] == [("fetched-00000004.BIN", 4)]


def test_logs_are_listed(session: FileSession, capsys: pytest.CaptureFixture[str]) -> None:
    status, out, _ = run(capsys, "--list", "--json")
    assert status == 0
    assert [(log["log"], log["bytes"]) for log in json.loads(out)["logs"]] == [(4, len(FLIGHT)), (5, 20_000)]
    assert "logs/00000005.BIN" in run(capsys, "--list")[1]


def test_an_armed_vehicle_says_no_with_its_reason(
    session: FileSession, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    session.vehicle.vehicle.armed = True
    status, out, err = run(capsys, "-o", tmp_path / "out", "--json")
    assert status == 1
    assert "Disarm for log download" in json.loads(out)["reason"]
    assert "Land, disarm" in err


def test_what_makes_no_sense_is_refused_before_the_vehicle_is_asked(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "file").write_text("x")
    folder = flight_folder(tmp_path / "flight")
    for words in ((), ("-o", tmp_path / "file"), ("-o", tmp_path / "new", "--run", "1"), ("-o", folder, "--run", "2")):
        status, out, err = run(capsys, *words)
        assert (status, out) == (2, "")
        assert err.startswith("tippath fetch: ")
    assert not (tmp_path / "new").exists()


@pytest.mark.realtime
@pytest.mark.thorough
def test_ctrl_c_leaves_a_beginning_that_is_gone_on_with(
    tmp_path: Path, until: Callable[..., Any], capsys: pytest.CaptureFixture[str]
) -> None:
    content = noise(400_000)
    (tmp_path / "vehicle").mkdir()
    (tmp_path / "vehicle" / "vehicle-1.BIN").write_bytes(content)
    words = ("--on-ground", "--listen", "udpin:127.0.0.1:0", "--log-rate", "300000", "--loss", "0.02")
    command = [sys.executable, "-m", "sitl", "-o", str(tmp_path / "vehicle"), *words]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as vehicle:
        try:
            assert vehicle.stdout is not None
            link = json.loads(vehicle.stdout.readline())["ground_link"]
            ours = ["fetch", "--connect", link, "-o", str(tmp_path / "out")]
            part = tmp_path / "out" / "00000001.BIN.part"
            with subprocess.Popen([sys.executable, "-m", "gcs.cli", *ours], stderr=subprocess.PIPE) as first:
                until(lambda: part.exists() and part.stat().st_size > 60_000)
                first.send_signal(signal.SIGINT)
                assert first.stderr is not None
                assert b"the same command goes on with it" in first.stderr.read()
                assert first.wait(20) == 130
            assert content.startswith(part.read_bytes())
            assert main([*ours, "--json"]) == 0
            document = json.loads(capsys.readouterr().out)
            assert document["resumed_from"] > 60_000
            assert (tmp_path / "out" / "00000001.BIN").read_bytes() == content
        finally:
            vehicle.terminate()
