"""What a flight's folder tells of how it came about: excitations started and ended, files written, by whom."""

from __future__ import annotations

import contextlib
import io
from pathlib import Path

import pytest
from fake_flight import SYSTEMID, FakeSession, FakeVehicle
from flown_folder import fly_folder
from flying import TWO_CHIRPS

from gcs.cards.maneuver import Maneuver, TestCard
from gcs.cli import main
from gcs.flight.folder import FlightFolder
from gcs.flight.run_state import Ending
from gcs.flight.sweep import fly_card

ROLL_CHIRP = Maneuver(kind="chirp", axis="roll", amplitude=0.1, duration_s=8.0)


def fly(folder: Path, session: FakeSession, aborting: bool = False, **about: object) -> FlightFolder:
    folder.mkdir()

    def aborted() -> str | None:
        return "F12 in the app" if aborting and session.snapshot().mode == SYSTEMID else None

    card = TestCard(name="test", maneuvers=(ROLL_CHIRP,))
    result = fly_card(
        session,
        card,
        folder=FlightFolder(folder),
        clock=session,
        disk_free=lambda _: 10**12,
        aborted=aborted,
        about=about,
    )
    assert result.ending is (Ending.ABORTED if aborting else None)
    return FlightFolder(folder)


@pytest.mark.parametrize(("about", "by"), [({"command": "fly"}, "app"), ({}, "command")])
def test_a_flown_run_is_there_from_start_to_end(tmp_path: Path, about: dict[str, str], by: str) -> None:
    found, damaged = fly(tmp_path / "flight-0001", FakeSession(FakeVehicle()), **about).audited()
    assert damaged == 0
    assert [one.by for one in found] == [by, by]
    assert found[0].did.startswith("starting roll chirp: 0.5-10 Hz")
    assert found[1].did.startswith("roll chirp finished; ")


def test_an_aborted_run_says_why(tmp_path: Path) -> None:
    found, _ = fly(tmp_path / "flight-0001", FakeSession(FakeVehicle()), aborting=True).audited()
    assert found[-1].did == "roll chirp aborted; F12 in the app"


def test_a_command_that_writes_into_a_flight_s_folder_is_noted(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    flight = fly_folder(Path("flight-0001"), None, TWO_CHIRPS)
    words = ["fit", "flight-0001/flight.BIN#1", "flight-0001/flight.BIN#2", "--model", "tpp"]

    def typed(*more: str) -> int:
        with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()):
            return main([*more])

    assert typed(*words, "-o", "flight-0001/tpp.json") == 0
    assert typed(*words, "-o", "flight-0001/tpp.json") == 2, "refused, and nothing was done"
    assert typed(*words, "-o", "elsewhere.json") == 0
    found, _ = flight.audited()
    assert [(one.did, one.by) for one in found] == [("fit: wrote tpp.json", "command")]
    assert found[0].command == " ".join(["tippath", *words, "-o", "flight-0001/tpp.json"])
    assert not Path("audit.jsonl").exists(), "no flight lies here"
