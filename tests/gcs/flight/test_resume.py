"""A flight that was cut off: what of it is kept, what is left, and every folder that is not gone on with."""

from __future__ import annotations

import errno
import json
import os
import shutil
import subprocess
import sys
from collections.abc import Callable
from copy import deepcopy
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from fake_flight import PARAMETERS, FakeSession, FakeVehicle
from fetched import dataflash

import gcs.flight.lock
from gcs.cards.envelope import Limits
from gcs.cards.maneuver import parse_card
from gcs.cli import main
from gcs.errors import TippathError, UsageError
from gcs.flight.coverage import coverage
from gcs.flight.flown_card import SweepResult
from gcs.flight.flyable import NotReadyError
from gcs.flight.folder import FlightFolder
from gcs.flight.lock import alone
from gcs.flight.resume import offered, unfinished
from gcs.flight.run import Progress, RunProgress, RunReady
from gcs.flight.sweep import fly_card
from gcs.link.decode import BLOCK_SIZE

CARD = """
name = "stepped"
rest_s = 1
[[step]]
amplitude = 0.5
[[maneuver]]
kind = "chirp"
axis = "roll"
amplitude = 0.1
duration_s = 10
[[maneuver]]
kind = "quiet"
duration_s = 5
"""
CUT_AT_S = 60.0
"""On the vehicle's clock: behind the first run, in the middle of the second."""


class Killed(BaseException):
    """As kill -9."""


@pytest.fixture
def session(request: pytest.FixtureRequest) -> FakeSession:
    """Before any flight, or behind the one that was cut off."""
    if "cut_off" not in request.fixturenames:
        return FakeSession(FakeVehicle())
    flown: FakeSession = request.getfixturevalue("cut_off_once")[0]
    return deepcopy(flown)


def fly(session: FakeSession, folder: Path, **more: Any) -> SweepResult:
    card = more.pop("card", None) or parse_card(CARD, "stepped")
    return fly_card(session, card, folder=FlightFolder(folder), clock=session, disk_free=lambda _: 10**12, **more)


def go_on(session: FakeSession, folder: Path, **more: Any) -> SweepResult:
    """As the command does; then there is a log."""
    began = session.now()
    earlier = unfinished(folder)
    result = fly(session, folder, card=earlier.card, earlier=earlier, **more)
    if result.log == "stream":
        session.log_path.write_bytes(dataflash(session.now() - began, start_s=began, rate_hz=20))
    return result


@pytest.fixture(scope="module")
def cut_off_once(tmp_path_factory: pytest.TempPathFactory) -> tuple[FakeSession, Path]:
    """A flight that was killed in its second run; the vehicle got out of it, and keeps what was written for it."""
    session, home = FakeSession(FakeVehicle()), tmp_path_factory.mktemp("cut-off")
    folder = home / "flight-0001"
    folder.mkdir()

    def on_progress(progress: Progress) -> None:
        if isinstance(progress, RunReady) and progress.run.number == 2:
            (home / "about").write_bytes((folder / "flight.json").read_bytes())
            written.update(session.vehicle.parameters)
        if isinstance(progress, RunProgress) and progress.run.number == 2 and progress.elapsed_s > 3:
            raise Killed

    written: dict[str, float] = {}
    with pytest.raises(Killed):
        fly(session, folder, on_progress=on_progress)
    (folder / "flight.json").write_bytes((home / "about").read_bytes())
    (folder / "flight.BIN").write_bytes(dataflash(CUT_AT_S, start_s=1.0))
    session.vehicle.parameters.update(written)
    session.vehicle.asked.clear()
    return session, folder


@pytest.fixture
def cut_off(session: FakeSession, cut_off_once: tuple[FakeSession, Path], tmp_path: Path) -> Path:
    """Its folder, for one test."""
    folder = shutil.copytree(cut_off_once[1], tmp_path / "flight-0001")
    session.recordings = [folder for _ in session.recordings]
    return folder


def change(folder: Path, **changes: Any) -> None:
    about = json.loads((folder / "flight.json").read_text())
    (folder / "flight.json").write_text(json.dumps(about | changes))


def labels(result: SweepResult) -> list[str]:
    return [run.run.label for run in result.runs]


def test_what_is_left_is_flown_in_order_and_the_rest_is_kept(session: FakeSession, cut_off: Path) -> None:
    assert session.vehicle.parameters != PARAMETERS
    before = FlightFolder(cut_off).read()
    result = go_on(session, cut_off)
    assert labels(result) == ["roll chirp", "quiet hover"]
    assert (result.complete, result.planned, len(result.before.kept)) == (True, 3, 1)
    about = FlightFolder(cut_off).read()
    assert about["runs"][: len(before["runs"])] == before["runs"]
    assert [run["number"] for run in about["runs"]] == [1, 2, 3]
    assert about["started"] == before["started"]
    assert session.vehicle.parameters == PARAMETERS, "what the killed run left is not taken for the vehicle's own"
    assert unfinished(cut_off).left == ()


def test_it_goes_on_more_than_once(session: FakeSession, cut_off: Path) -> None:
    wish: list[str] = []
    session.vehicle.in_sweep(4.0, lambda: wish.append("Ctrl-C"))
    first = go_on(session, cut_off, aborted=lambda: wish[0] if wish else None)
    assert (labels(first), first.complete) == (["roll chirp"], False)
    second = go_on(session, cut_off)
    assert labels(second) == ["roll chirp", "quiet hover"]
    about = FlightFolder(cut_off).read()
    assert [(run["label"], run["ending"]) for run in about["runs"]] == [
        ("roll chirp 50 %", "finished"),
        ("roll chirp", "aborted"),
        ("roll chirp", "finished"),
        ("quiet hover", "finished"),
    ]
    assert len(about["resumed"]) == len(about["parts"]) == 2
    assert about["parts"][1]["started"] == about["resumed"][0]
    assert [part["ended"] is None for part in about["parts"]] == [True, False]
    assert second.complete


def test_a_probe_is_flown_again(session: FakeSession, cut_off: Path) -> None:
    result = go_on(session, cut_off, probe=True)
    assert labels(result) == ["probe roll", "roll chirp", "quiet hover"]
    assert (result.planned, result.flown) == (4, True)
    assert len(unfinished(cut_off).kept) == 3


@pytest.mark.parametrize(
    ("peaks", "why"),
    [({}, "how far the step before took the vehicle is not known"), ({"p": 2.9}, "of the limits")],
)
def test_a_step_that_a_kept_one_unlocks_is_locked_by_what_that_showed(
    session: FakeSession, cut_off: Path, peaks: dict[str, float], why: str
) -> None:
    (run,) = FlightFolder(cut_off).runs()
    change(cut_off, runs=[run | {"peaks": peaks}])
    result = go_on(session, cut_off)
    assert (result.runs, session.vehicle.asked) == ((), [])
    assert why in result.stopped


def test_a_run_that_did_not_reach_the_disk_is_flown_again(session: FakeSession, cut_off: Path) -> None:
    (run,) = FlightFolder(cut_off).runs()
    stop_s = run["log_start_s"] + 6.0
    (cut_off / "flight.BIN").write_bytes(dataflash(stop_s, start_s=0.0))
    earlier = unfinished(cut_off)
    assert [left.label for left in earlier.left] == ["roll chirp 50 %", "roll chirp", "quiet hover"]
    (lost,) = earlier.lost
    assert lost.startswith("roll chirp 50 % was kept, but 6.")
    assert labels(go_on(session, cut_off)) == ["roll chirp 50 %", "roll chirp", "quiet hover"]


def test_a_block_that_never_came_lies_in_a_run_that_is_kept(session: FakeSession, cut_off: Path) -> None:
    (run,) = FlightFolder(cut_off).runs()
    log = bytearray((cut_off / "flight.BIN").read_bytes())
    bytes_a_second = len(log) / CUT_AT_S
    hole = round((run["log_start_s"] + 4.0) * bytes_a_second) // BLOCK_SIZE
    log[hole * BLOCK_SIZE : (hole + 1) * BLOCK_SIZE] = bytes(BLOCK_SIZE)
    (cut_off / "flight.BIN").write_bytes(log)
    held = coverage(cut_off / "flight.BIN")
    assert held.missing == ((hole, hole),)
    assert 0.05 < held.missing_s(run["log_start_s"], run["log_start_s"] + run["duration_s"]) < 0.15
    assert held.missing_s(0.0 + held.first_s, run["log_start_s"]) == 0  # type: ignore[operator]
    result = go_on(session, cut_off)
    assert (result.flown, result.complete) == (True, False), "all is flown, and one block of it is missing"
    assert result.document["missing_blocks"] == 1


def test_the_same_block_elsewhere_is_in_no_runs_way(session: FakeSession, cut_off: Path) -> None:
    log = bytearray((cut_off / "flight.BIN").read_bytes())
    log[-3 * BLOCK_SIZE : -2 * BLOCK_SIZE] = bytes(BLOCK_SIZE)
    (cut_off / "flight.BIN").write_bytes(log)
    assert go_on(session, cut_off).complete


@pytest.mark.parametrize("content", [b"", b"\xa3\x95\x80", bytes(5 * BLOCK_SIZE)])
def test_a_log_that_tells_no_time_holds_no_run(tmp_path: Path, content: bytes) -> None:
    (tmp_path / "flight.BIN").write_bytes(content)
    assert coverage(tmp_path / "flight.BIN").missing_s(10.0, 15.0) == 5.0


def test_what_was_set_otherwise_is_said(session: FakeSession, cut_off: Path) -> None:
    session.vehicle.parameters["ANGLE_MAX"] = 4500.0
    result = go_on(session, cut_off)
    words = {check["name"]: check["words"] for check in result.document["checks"]}
    assert words["settings"] == "not as before: ANGLE_MAX 3000, now 4500"
    assert session.vehicle.parameters["ANGLE_MAX"] == 4500.0
    assert words["resumed"].startswith("1 of 3 runs flown and kept; 2 left; flight.BIN: what recorded it was cut off")


def test_nothing_starts_without_the_word(session: FakeSession, cut_off: Path) -> None:
    runs = FlightFolder(cut_off).runs()
    with pytest.raises(NotReadyError, match="not confirmed"):
        go_on(session, cut_off, confirm=lambda briefing: False)
    assert (session.vehicle.asked, FlightFolder(cut_off).runs()) == ([], runs)
    assert len(unfinished(cut_off).left) == 2


def test_a_flight_whose_log_stays_on_the_card_goes_on_so(session: FakeSession, tmp_path: Path) -> None:
    folder = tmp_path / "flight"
    folder.mkdir()
    wish: list[str] = []
    session.vehicle.in_sweep(4.0, lambda: wish.append("Ctrl-C"))
    fly(session, folder, log="card", aborted=lambda: wish[0] if wish else None)
    earlier = unfinished(folder)
    assert (earlier.log, len(earlier.left), earlier.logs) == ("card", 3, ())
    result = go_on(session, folder, log=earlier.log)
    assert (result.done, result.problems) == (True, ())
    assert [run["file"] for run in result.document["runs"]] == [None] * 4
    assert unfinished(folder).complete is None


# -------------------------------------------------------------------------------------------- what is not gone on with

OTHERS: list[tuple[dict[str, Any], str]] = [
    ({"system": 2}, "another vehicle (system 2, this is 1)"),
    ({"type": 2}, "another vehicle (type 2, this is 4)"),
    ({"profile": "mine"}, "(profile mine, this is "),
    ({"system": 2, "autopilot": 12}, "(system 2, this is 1; autopilot 12, this is 3)"),
]


@pytest.mark.parametrize(("other", "words"), OTHERS)
def test_another_vehicle_is_refused(session: FakeSession, cut_off: Path, other: dict[str, Any], words: str) -> None:
    change(cut_off, vehicle=FlightFolder(cut_off).read()["vehicle"] | other)
    with pytest.raises(TippathError, match="connect to that one") as refused:
        go_on(session, cut_off)
    assert words in str(refused.value)
    assert (session.vehicle.asked, len(session.recordings)) == ([], 1)


def rewrite_card(folder: Path) -> None:
    (folder / "card.toml").write_text(CARD.replace("0.5", "0.6"))


def older_rewritten_card(folder: Path) -> None:
    """As `rewrite_card`, where flight.json does not know its card's digest."""
    rewrite_card(folder)
    change(folder, card_sha256=None)


DAMAGED: dict[str, tuple[Callable[[Path], object], str]] = {
    "cut": (lambda folder: (folder / "flight.json").write_text('{"format": "tippath.flight/1", "ru'), "fly the card"),
    "empty": (lambda folder: (folder / "flight.json").write_bytes(b""), "fly the card anew"),
    "zeroed": (lambda folder: (folder / "flight.json").write_bytes(bytes(500)), "fly the card anew"),
    "gone": (lambda folder: (folder / "flight.json").unlink(), "--resume takes a flight's folder"),
    "of no vehicle": (lambda folder: change(folder, vehicle=None), "does not tell which vehicle"),
    "no card": (lambda folder: (folder / "card.toml").unlink(), "put it back"),
    "a card that is none": (lambda folder: (folder / "card.toml").write_text("rest_s = -1"), "card.toml"),
    "another card": (rewrite_card, "was changed: put it back"),
    "an older flight's card": (older_rewritten_card, "'roll chirp 50 %' is not on it"),
}


@pytest.mark.parametrize("damage", DAMAGED)
def test_a_damaged_folder_is_refused_and_left_as_it_is(session: FakeSession, cut_off: Path, damage: str) -> None:
    do, words = DAMAGED[damage]
    do(cut_off)
    before = {path.name: path.read_bytes() for path in cut_off.iterdir()}
    with pytest.raises(TippathError) as refused:
        go_on(session, cut_off)
    assert words in str(refused.value)
    assert "\n" not in str(refused.value)
    assert {path.name: path.read_bytes() for path in cut_off.iterdir()} == before


def test_a_folder_that_another_program_flies_into_is_refused(session: FakeSession, cut_off: Path) -> None:
    seen: list[str] = []

    def look(progress: Progress) -> None:
        with pytest.raises(TippathError) as refused:
            unfinished(cut_off)
        seen.append(str(refused.value))
        assert offered(cut_off.parent) is None

    go_on(session, cut_off, on_progress=look)
    assert set(seen) == {f"{cut_off} is being flown into by a tippath that still runs: end that one first"}
    with alone(FlightFolder(cut_off)):
        pass


def test_a_disk_that_knows_no_locks_is_flown_to(cut_off: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(stream: object) -> None:
        raise OSError(errno.ENOLCK, "No locks available")

    monkeypatch.setattr(gcs.flight.lock, "_lock", refuse)
    assert len(unfinished(cut_off).left) == 2


def test_a_lock_goes_with_the_process_that_is_killed(cut_off: Path) -> None:
    program = (
        "import pathlib, sys\nfrom gcs.flight.folder import FlightFolder\nfrom gcs.flight.lock import alone\n"
        "with alone(FlightFolder(pathlib.Path(sys.argv[1]))):\n    print('held', flush=True)\n    sys.stdin.read()"
    )
    with subprocess.Popen(
        [sys.executable, "-c", program, str(cut_off)], stdin=subprocess.PIPE, stdout=subprocess.PIPE
    ) as other:
        assert other.stdout is not None
        assert other.stdout.readline() == b"held\n"
        with pytest.raises(TippathError, match="end that one first"):
            unfinished(cut_off)
        other.kill()
        other.wait(10)
        assert len(unfinished(cut_off).left) == 2


def test_a_folder_that_somebody_flew_into_meanwhile_is_read_again(session: FakeSession, cut_off: Path) -> None:
    earlier = unfinished(cut_off)
    go_on(session, cut_off)
    with pytest.raises(TippathError, match="has changed meanwhile"):
        fly(session, cut_off, card=earlier.card, earlier=earlier)


def test_a_folder_that_cannot_be_written_to_is_refused(cut_off: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(os, "access", lambda path, how: how != os.W_OK)
    with pytest.raises(TippathError, match="cannot be written to"):
        unfinished(cut_off)


def test_a_vehicle_in_its_excitation_mode_is_not_fought(session: FakeSession, cut_off: Path) -> None:
    session.vehicle.mode = 25
    session.sleep(2.0)
    with pytest.raises(NotReadyError, match="`tippath abort` ends it"):
        go_on(session, cut_off)
    assert session.vehicle.asked == []


@pytest.mark.parametrize(
    "words",
    [
        ["--card", "hover"],
        ["--axis", "roll"],
        ["--amplitude", "0.1"],
        ["--duration", "20"],
        ["-o", "elsewhere"],
        ["--log", "card"],
    ],
)
def test_a_resumed_flight_is_told_nothing_new(
    cut_off: Path, words: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["sweep", "--connect", "udpin:127.0.0.1:0", "--resume", str(cut_off), *words]) == 2
    said = capsys.readouterr().err
    assert "leave out --" in said or "was begun with --log stream, and goes on so" in said


def test_a_folder_that_is_none_is_wrong_usage(tmp_path: Path) -> None:
    for path in (tmp_path, tmp_path / "nowhere"):
        with pytest.raises(UsageError, match="--resume takes a flight's"):
            unfinished(path)


def test_the_newest_flight_of_which_something_is_left_is_offered(session: FakeSession, cut_off: Path) -> None:
    (cut_off.parent / "flight-0000").mkdir()
    (cut_off.parent / "notes").mkdir()
    found = offered(cut_off.parent)
    assert found is not None
    assert (found.folder.path, len(found.left), found.words) == (cut_off, 2, "1 of 3 runs flown and kept")
    go_on(session, cut_off)
    assert offered(cut_off.parent) is None
    assert offered(cut_off) is None
    assert offered(cut_off / "nowhere") is None


def test_limits_of_the_envelope_are_those_of_the_card(session: FakeSession, cut_off: Path) -> None:
    earlier = unfinished(cut_off)
    assert earlier.card.limits == Limits()
    assert replace(earlier.card, text="") == replace(parse_card(CARD, "stepped"), text="")
