"""A flight whose program is killed goes on in its own folder; what was flown and kept is not flown again, and nothing
that was written is touched.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from io import FileIO
from pathlib import Path
from typing import Any

import pytest
from slow_flight import SlowFlight

from gcs.cli import main
from gcs.flight import recorder
from gcs.flight.folder import FlightFolder
from gcs.flight.syncing import Syncing
from gcs.logs import ingest

FAST = 92_160.0
"""Bytes a second: 921,600 baud."""
CARD = """
name = "three"
rest_s = 1
[[maneuver]]
kind = "doublet"
axis = "roll"
amplitude = 0.1
duration_s = 5
[[maneuver]]
kind = "doublet"
axis = "pitch"
amplitude = 0.1
duration_s = 5
repeat = 2
"""


class Killed(BaseException):
    """As kill -9: nothing that comes after it is done, because time itself raises it."""


@pytest.fixture
def flown(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Iterator[SlowFlight]:
    flown = SlowFlight(monkeypatch, "hover-ideal", None, tmp_path / "sd", bytes_s=FAST, on_ground=False)
    (tmp_path / "three.toml").write_text(CARD)
    yield flown
    flown.close()


class Kill:
    """Flies until a moment, and no further: after it no time goes by for the program, and nothing is sent."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, flown: SlowFlight) -> None:
        self._monkeypatch = monkeypatch
        self._flown = flown
        self._dead = False
        self._open: list[FileIO | Syncing] = []

    def __call__(self, when: Callable[[], bool], *words: str | Path) -> None:
        def look() -> None:
            self._dead = self._dead or when()
            self._alive()

        def send(data: bytes) -> None:
            self._alive()
            on_the_wire(data)

        flown, on_the_wire = self._flown, self._flown.wire.at_ground.send
        with self._monkeypatch.context() as patched:
            patched.setattr(recorder, "FileIO", lambda path, mode: self._opened(FileIO(path, mode)))
            patched.setattr(recorder, "Syncing", lambda: self._opened(Syncing()))
            patched.setattr(flown.wire.at_ground, "send", send)
            flown.between = look
            with pytest.raises(Killed):
                flown.tippath("sweep", *words)
        flown.between = lambda: None
        flown.begin(lambda: None, lambda: None)
        for one in reversed(self._open):  # what the system does for a program that is gone
            one.close()

    def _alive(self) -> None:
        if self._dead:
            raise Killed

    def _opened(self, one: FileIO | Syncing) -> FileIO | Syncing:
        self._open.append(one)
        return one


@pytest.fixture
def kill(monkeypatch: pytest.MonkeyPatch, flown: SlowFlight) -> Kill:
    return Kill(monkeypatch, flown)


def in_second_run(flown: SlowFlight, folder: Path) -> Callable[[], bool]:
    """Two seconds into the second run."""
    began: list[float] = []

    def when() -> bool:
        if flown.vehicle.sweeping and (folder / "flight.json").exists() and len(FlightFolder(folder).runs()) == 1:
            began.append(flown.now())
        return bool(began) and flown.now() > began[0] + 2.0

    return when


def settings(flown: SlowFlight) -> dict[str, float]:
    return {name: flown.vehicle.parameters[name] for name in ("SID_AXIS", "SID_MAGNITUDE", "SID_T_REC", "SIDX_KIND")}


def contents(folder: Path) -> dict[str, bytes]:
    """Of all files but those that tell what was done."""
    return {path.name: path.read_bytes() for path in folder.iterdir() if not path.suffix.startswith(".json")}


def test_a_killed_flight_goes_on_in_its_folder(
    flown: SlowFlight, kill: Kill, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / "flight-0001"
    own = settings(flown)
    kill(in_second_run(flown, folder), "--no-probe", "--card", tmp_path / "three.toml", "-o", folder)
    before, about = contents(folder), FlightFolder(folder).read()
    assert (about["ended"], [run["label"] for run in about["runs"]]) == (None, ["roll doublet"])
    flown.sleep(6.0)
    assert settings(flown) != own
    assert flown.tippath("sweep", "--no-probe", "--resume", folder) == 1
    assert "an excitation is on already; `tippath abort` ends it" in capsys.readouterr().err
    assert contents(folder) == before
    flown.pilot("mode stabilize")
    assert flown.tippath("sweep", "--dry-run", "--resume", folder) == 0
    assert " card three: 2 runs, about 16 s; nothing was sent" in capsys.readouterr().out
    assert contents(folder) == before
    assert flown.tippath("sweep", "--no-probe", "--resume", folder, "--json") == 0
    out, err = capsys.readouterr()
    assert "resumed: 1 of 3 runs flown and kept; 2 left; flight.BIN: what recorded it was cut off" in err
    assert "settings: as before" in err
    assert "card three: 2 runs, about 16 s" in err
    assert settings(flown) == own, "what the killed run left is put back"

    result: dict[str, Any] = json.loads(out)
    assert (result["complete"], result["planned"], result["stopped"]) == (True, 3, "")
    assert [(run["label"], run["file"]) for run in result["runs"]] == [
        ("roll doublet", "flight.BIN"),
        ("pitch doublet 1/2", "flight-2.BIN"),
        ("pitch doublet 2/2", "flight-2.BIN"),
    ]
    assert [(log["path"], log["end"]) for log in result["recording"]["logs"]] == [
        ("flight.BIN", "not known"),
        ("flight-2.BIN", "reached"),
    ]
    (said,) = result["recording"]["problems"]
    assert "whether it is whole at its end was not judged" in said
    (resumed,) = result["resumed"]
    (part,) = result["parts"]
    assert part["started"] == about["started"] == result["started"] < resumed < result["ended"]
    after = contents(folder)
    assert {name: after[name] for name in before} == before, "nothing that was written is touched"
    assert set(after) - set(before) == {"flight-2.BIN", "flight-2.tlog"}
    assert after["flight-2.BIN"] in (path.read_bytes() for path in (tmp_path / "sd").glob("*.BIN"))

    usable = {run.id: run.usable for run in ingest([folder]).runs}
    assert usable == {"flight.BIN#1": True, "flight.BIN#2": False, "flight-2.BIN#1": True, "flight-2.BIN#2": True}

    assert main(["sweep", "--connect", "tcp:127.0.0.1:1", "--resume", str(folder)]) == 0, "nobody is connected to"
    assert "3 of 3 runs flown and kept; nothing is left to fly" in capsys.readouterr().out
    assert contents(folder) == after


@pytest.mark.thorough
def test_a_vehicle_that_rebooted_in_between_is_read_by_both_its_clocks(
    flown: SlowFlight, kill: Kill, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / "flight-0001"
    kill(in_second_run(flown, folder), "--no-probe", "--card", tmp_path / "three.toml", "-o", folder)
    flown.pilot("mode stabilize")
    flown.pilot("land")
    flown.sleep(20.0)
    flown.pilot("reboot")
    flown.sleep(3.0)
    flown.pilot("takeoff")
    flown.sleep(10.0)
    assert flown.tippath("sweep", "--no-probe", "--resume", folder) == 0
    flown.pilot("land")
    flown.sleep(30.0)
    capsys.readouterr()

    assert flown.tippath("fetch", "-o", folder, "--json") == 0
    first = json.loads(capsys.readouterr().out)
    (second,) = first["more"]
    assert [(one["runs"], one["joined"]["complete"]) for one in (first, second)] == [([1], True), ([2, 3], True)]
    assert [Path(one["joined"]["files"][0]["path"]).name for one in (first, second)] == ["flight.BIN", "flight-2.BIN"]
    assert first["log"] != second["log"]
    runs = {run.id: (run.usable, run.reasons) for run in ingest([folder]).runs}
    assert [id for id, (usable, _) in runs.items() if usable] == ["flight.BIN#1", "flight-2.BIN#1", "flight-2.BIN#2"]
    assert any("nobody saw how it ended" in reason for reason in runs["flight.BIN#2"][1])
