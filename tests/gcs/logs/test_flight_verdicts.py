"""Runs that flight.json says are to be flown again: not taken unasked, taken when named."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from fake_flight import FakeSession, FakeVehicle

from gcs.cards.maneuver import Maneuver, TestCard
from gcs.errors import TippathError
from gcs.flight.folder import create
from gcs.flight.sweep import fly_card
from gcs.logs import ingest, resolve_runs

Flown = Callable[..., bytes]

ENTERED_S = (12.0, 22.5)
"""Of the two runs of `two_chirps`, in the log's own time."""


@pytest.fixture(scope="module")
def flown_about(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    """flight.json as a sweep writes it: one run kept, one ended by Ctrl-C."""
    vehicle = FakeVehicle()
    session = FakeSession(vehicle)
    started: list[float] = []
    folder = create(tmp_path_factory.mktemp("flown") / "flight")

    def aborted() -> str | None:
        if vehicle.entered is not None and vehicle.entered not in started:
            started.append(vehicle.entered)
        return "Ctrl-C" if len(started) == 2 and vehicle.now > started[1] + 4.0 else None

    card = TestCard(
        name="two",
        maneuvers=(
            Maneuver(kind="chirp", axis="roll", amplitude=0.1, duration_s=10.0),
            Maneuver(kind="chirp", axis="pitch", amplitude=0.1, duration_s=10.0),
        ),
    )
    fly_card(session, card, folder=folder, clock=session, disk_free=lambda _: 10**12, aborted=aborted)
    about: dict[str, Any] = folder.read()
    assert [run["ending"] for run in about["runs"]] == ["finished", "aborted"]
    return about


def flight(folder: Path, log: bytes, about: dict[str, Any], **changes: Any) -> Path:
    """A flight folder whose log is `log`, its runs at `ENTERED_S`."""
    folder.mkdir()
    runs = [run | {"log_start_s": start} for run, start in zip(about["runs"], ENTERED_S, strict=True)]
    (folder / "flight.json").write_text(json.dumps(about | {"runs": runs} | changes))
    (folder / "flight.BIN").write_bytes(log)
    return folder


@pytest.mark.parametrize("word", ["", "flight.BIN"])
def test_an_aborted_run_is_not_taken_unasked(
    two_chirps: bytes, flown_about: dict[str, Any], tmp_path: Path, word: str
) -> None:
    path = flight(tmp_path / "flight-0001", two_chirps, flown_about) / word
    kept, aborted = ingest([path]).runs
    assert kept.usable
    assert not aborted.usable
    (reason,) = aborted.reasons
    assert reason.startswith("the sweep's verdict: fly again: aborted: Ctrl-C")
    (taken,) = resolve_runs([str(path)])
    assert taken.id == "flight.BIN#1"
    told = f"left out of {path}, not usable: flight.BIN#2 (the sweep's verdict: fly again: aborted: Ctrl-C"
    assert any(note.startswith(told) for note in taken.notes)


def test_an_aborted_run_is_taken_when_it_is_named(
    two_chirps: bytes, flown_about: dict[str, Any], tmp_path: Path
) -> None:
    folder = flight(tmp_path / "flight-0001", two_chirps, flown_about)
    (record,) = resolve_runs([f"{folder}#2"])
    assert record.id == "flight.BIN#2"
    assert "used because it was named, against the sweep's verdict: fly again: aborted: Ctrl-C" in record.notes


def test_a_probe_enters_no_fit_unasked(two_chirps: bytes, flown_about: dict[str, Any], tmp_path: Path) -> None:
    first, second = flown_about["runs"]
    assert first["probe"] is False
    path = flight(tmp_path / "flight-0001", two_chirps, flown_about | {"runs": [first | {"probe": True}, second]})
    probe, _ = ingest([path]).runs
    assert not probe.usable
    assert "a probe, a small step" in probe.reasons[0]
    (record,) = resolve_runs([f"{path}#1"])
    assert record.id == "flight.BIN#1"


def test_a_flight_of_nothing_but_refused_runs_says_how_to_take_one(
    two_chirps: bytes, flown_about: dict[str, Any], tmp_path: Path
) -> None:
    both = {"runs": [flown_about["runs"][1] | {"log_start_s": start} for start in ENTERED_S]}
    folder = flight(tmp_path / "flight-0001", two_chirps, flown_about, **both)
    with pytest.raises(TippathError, match=r"fly again: aborted.*named by itself \(flight.BIN#1\)"):
        resolve_runs([str(folder)])


def test_what_is_wrong_with_the_samples_stays_wrong_when_named(
    flown: Flown, flown_about: dict[str, Any], tmp_path: Path
) -> None:
    folder = flight(tmp_path / "flight-0001", flown([{}, {"stop_after": 0.0}]), flown_about)
    with pytest.raises(TippathError, match="before the maneuver began"):
        resolve_runs([f"{folder}#2"])


@pytest.mark.parametrize(
    "changes",
    [
        {"format": "somebody's"},
        {"recording": {"logs": [{"path": "flight-2.BIN"}]}},
        {"runs": [{"log_start_s": None, "ending": "aborted"}, {"ending": "aborted", "log_start_s": 17.0}]},
    ],
)
def test_a_file_that_says_nothing_of_these_runs_changes_nothing(
    two_chirps: bytes, flown_about: dict[str, Any], tmp_path: Path, changes: dict[str, Any]
) -> None:
    folder = flight(tmp_path / "flight-0001", two_chirps, flown_about, **changes)
    assert [run.usable for run in ingest([folder]).runs] == [True, True]


def test_a_flight_that_ended_before_its_recording_was_summed_up_is_judged_too(
    two_chirps: bytes, flown_about: dict[str, Any], tmp_path: Path
) -> None:
    folder = flight(tmp_path / "flight-0001", two_chirps, flown_about, recording=None)
    assert [run.usable for run in ingest([folder]).runs] == [True, False]


def test_logs_that_show_the_same_times_each_have_their_own_verdicts(
    two_chirps: bytes, flown_about: dict[str, Any], tmp_path: Path
) -> None:
    """The vehicle rebooted in between, and its clock began anew."""
    (kept, aborted), (first, second) = flown_about["runs"], ENTERED_S
    runs = [
        kept | {"log_start_s": first, "file": "flight.BIN"},
        aborted | {"log_start_s": second, "file": "flight-2.BIN"},
        kept | {"log_start_s": second, "file": "flight.BIN"},
        kept | {"log_start_s": first, "file": "flight-2.BIN"},
    ]
    folder = tmp_path / "flight-0001"
    folder.mkdir()
    about = {"runs": runs, "recording": {"logs": [{"path": "flight.BIN"}, {"path": "flight-2.BIN"}]}}
    (folder / "flight.json").write_text(json.dumps(flown_about | about))
    (folder / "flight.BIN").write_bytes(two_chirps)
    (folder / "flight-2.BIN").write_bytes(two_chirps[:-200])
    usable = {run.id: run.usable for run in ingest([folder]).runs}
    assert usable == {"flight.BIN#1": True, "flight.BIN#2": True, "flight-2.BIN#1": True, "flight-2.BIN#2": False}
    (folder / "flight-2.BIN").rename(folder / "fetched-00000002.BIN")
    about["fetched"] = [{"file": "fetched-00000002.BIN", "of": [2, 4]}]
    (folder / "flight.json").write_text(json.dumps(flown_about | about))
    usable = {run.id: run.usable for run in ingest([folder / "fetched-00000002.BIN"]).runs}
    assert usable == {"fetched-00000002.BIN#1": True, "fetched-00000002.BIN#2": False}


@pytest.mark.parametrize("cut_off", [{"ended": None}, {"parts": [{"ended": None}]}])
def test_a_run_that_was_cut_off_with_the_program_is_not_taken_unasked(
    two_chirps: bytes, flown_about: dict[str, Any], tmp_path: Path, cut_off: dict[str, Any]
) -> None:
    folder = flight(tmp_path / "flight-0001", two_chirps, flown_about)
    about = json.loads((folder / "flight.json").read_text())
    (folder / "flight.json").write_text(json.dumps(about | {"runs": about["runs"][:1]} | cut_off))
    kept, unseen = ingest([folder]).runs
    assert (kept.usable, unseen.usable) == (True, False)
    assert "nobody saw how it ended" in unseen.reasons[0]
    (record,) = resolve_runs([f"{folder}#2"])
    assert record.id == "flight.BIN#2"


DAMAGED = {
    "empty": b"",
    "cut": b'{"format": "tippath.flight/1", "runs": [',
    "zeroed": bytes(400),
    "binary": b"\xff\xfe",
    "nested": b"[" * 200_000,
    "runs that are none": b'{"format": "tippath.flight/1", "runs": "none"}',
    "a number that is none": b'{"format": "tippath.flight/1", "x": NaN}',
}


@pytest.mark.parametrize("damage", DAMAGED)
def test_a_damaged_file_is_told_with_every_run(two_chirps: bytes, tmp_path: Path, damage: str) -> None:
    (tmp_path / "flight.BIN").write_bytes(two_chirps)
    (tmp_path / "flight.json").write_bytes(DAMAGED[damage])
    runs = ingest([tmp_path / "flight.BIN"]).runs
    assert [run.usable for run in runs] == [True, True]
    for run in runs:
        (note,) = [note for note in run.notes if "flight.json" in note]
        assert note.startswith("what was said of this run in flight is not known: ")
        assert run.record is not None
        assert note in run.record.notes
