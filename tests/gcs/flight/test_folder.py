"""Flight folders: numbered, never overwritten, and a file that is whole or not there."""

from __future__ import annotations

import json
import math
from datetime import UTC, datetime, timedelta, timezone
from pathlib import Path

import pytest
from damaged_documents import FILES

from gcs.errors import TippathError, UsageError
from gcs.flight.folder import AuditEntry, FlightFolder, create, flight_of, keep


def test_folders_are_numbered_after_the_highest(tmp_path: Path) -> None:
    assert create(None, tmp_path).path.name == "flight-0001"
    (tmp_path / "flight-0041").mkdir()
    (tmp_path / "flight-x").mkdir()
    assert create(None, tmp_path).path.name == "flight-0042"
    (tmp_path / "flight-9999").mkdir()
    assert create(None, tmp_path).path.name == "flight-10000"
    assert create(None, tmp_path).path.name == "flight-10001"


def test_a_given_folder_may_be_empty_but_not_occupied(tmp_path: Path) -> None:
    folder = create(tmp_path / "a" / "b")
    assert create(folder.path).path == folder.path
    (folder.path / "flight.BIN").touch()
    with pytest.raises(UsageError, match="never overwritten"):
        create(folder.path)
    (tmp_path / "file").touch()
    with pytest.raises(UsageError, match="is a file"):
        create(tmp_path / "file")


def test_what_is_written_is_read_again(tmp_path: Path) -> None:
    folder = create(None, tmp_path)
    folder.write({"runs": [{"number": 1}], "card": "hover"})
    folder.write({"runs": [{"number": 1}, {"number": 2}], "card": "hover"})
    assert folder.read()["format"] == "tippath.flight/1"
    assert [run["number"] for run in folder.runs()] == [1, 2]
    assert [path.name for path in folder.path.iterdir()] == ["flight.json"]


def test_a_number_that_json_lacks_is_never_written(tmp_path: Path) -> None:
    folder = create(None, tmp_path)
    with pytest.raises(ValueError, match="not JSON compliant"):
        folder.write({"x": math.nan})


def test_what_is_no_flight_folder_says_so(tmp_path: Path) -> None:
    with pytest.raises(TippathError, match="no flight folder"):
        FlightFolder(tmp_path).read()
    (tmp_path / "flight.json").write_text("{")
    with pytest.raises(TippathError, match=r"flight\.json: not JSON: .*line 1"):
        FlightFolder(tmp_path).read()
    (tmp_path / "flight.json").write_text('{"format": "else"}')
    with pytest.raises(TippathError, match=r"not a tippath\.flight/1"):
        FlightFolder(tmp_path).read()


@pytest.mark.parametrize("damage", FILES)
def test_a_damaged_flight_json_is_an_error_that_names_it(damage: str, tmp_path: Path) -> None:
    folder = FlightFolder(tmp_path)
    folder.about.write_bytes(FILES[damage])
    with pytest.raises(TippathError, match=r"flight\.json: "):
        folder.read()
    assert (folder.name, folder.notes()) == ("", [])


@pytest.mark.parametrize(
    "line", [b"[" * 100_000, b'{"time": 1, "did": "x", "command": null, "by": "app"}', b"\xff", b"[]"]
)
def test_a_damaged_line_of_the_audit_is_counted(line: bytes, tmp_path: Path) -> None:
    folder = FlightFolder(tmp_path)
    folder.audit(WHEN, "fitted")
    folder.audit_file.write_bytes(folder.audit_file.read_bytes() + line + b"\n")
    found, damaged = folder.audited()
    assert ([entry.did for entry in found], damaged) == (["fitted"], 1)


def test_a_card_is_kept_once(tmp_path: Path) -> None:
    folder = create(None, tmp_path)
    folder.write_card("name = 'x'\n")
    assert folder.card.read_text() == "name = 'x'\n"
    with pytest.raises(TippathError, match="cannot be written"):
        folder.write_card("again")


def test_a_full_disk_leaves_neither_half_a_card_nor_half_a_file(tmp_path: Path) -> None:
    resource = pytest.importorskip("resource")
    folder = create(tmp_path / "flight")
    folder.write({"runs": []})
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (1000, limits[1]))  # as good as full
    try:
        with pytest.raises(TippathError, match="cannot be written"):
            folder.write_card("# " + "x" * 5000)
        with pytest.raises(TippathError, match="cannot be written"):
            folder.write({"runs": ["x" * 5000]})
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    assert [entry.name for entry in folder.path.iterdir()] == ["flight.json"]
    assert folder.runs() == []


def test_results_never_overwrite_others(tmp_path: Path) -> None:
    first = keep({"K": 1}, tmp_path / "gains.json")
    again = keep({"K": 1}, tmp_path / "gains.json")
    other = keep({"K": 2}, tmp_path / "gains.json")
    assert (first.name, again.name, other.name) == ("gains.json", "gains.json", "gains-2.json")
    assert json.loads(first.read_text()) == {"K": 1}


def test_a_full_disk_leaves_no_half_fit(tmp_path: Path) -> None:
    resource = pytest.importorskip("resource")
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (1000, limits[1]))  # as good as full
    try:
        with pytest.raises(TippathError, match="cannot be written"):
            keep({"K": "x" * 5000}, tmp_path / "gains.json")
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    assert list(tmp_path.iterdir()) == []


WHEN = datetime(2026, 5, 4, 12, 30, tzinfo=UTC)


def test_name_and_notes_are_the_user_s_and_outlive_the_sweep_s_writing(tmp_path: Path) -> None:
    folder = create(None, tmp_path)
    folder.rename("gusty")
    folder.note(WHEN, "tail boom changed")
    folder.write({"runs": [{"number": 1}], "card": "hover"})
    folder.note(WHEN.replace(hour=13), "and back")
    assert folder.name == "gusty"
    assert folder.notes() == [
        ("2026-05-04T12:30:00.000+00:00", "tail boom changed"),
        ("2026-05-04T13:30:00.000+00:00", "and back"),
    ]
    assert [run["number"] for run in folder.runs()] == [1]
    assert folder.read()["format"] == "tippath.flight/1"


def test_a_damaged_flight_json_is_not_written_over(tmp_path: Path) -> None:
    folder = FlightFolder(tmp_path)
    folder.about.write_text('{"format": "tippath.flight/1", "runs": [')
    with pytest.raises(TippathError, match="not JSON"):
        folder.rename("x")
    assert folder.about.read_text().endswith("[")
    assert folder.name == ""
    assert folder.notes() == []


def test_the_audit_only_grows_and_survives_its_damage(tmp_path: Path) -> None:
    folder = FlightFolder(tmp_path)
    assert folder.audited() == ([], 0)
    folder.audit(WHEN, "fitted TPP", "tippath fit a", by="app")
    with folder.audit_file.open("ab") as stream:
        stream.write(b'{"time": "2026-05-04T12:3\xff')  # the laptop died here
    folder.audit(WHEN.astimezone(timezone(timedelta(hours=2))), "aborted: \x1b[2J\n")
    found, damaged = folder.audited()
    assert damaged == 1
    assert found == [
        AuditEntry("2026-05-04T12:30:00.000+00:00", "fitted TPP", "tippath fit a", "app"),
        AuditEntry("2026-05-04T12:30:00.000+00:00", "aborted: \x1b[2J\n", None, "command"),
    ]
    assert b"\x1b" not in folder.audit_file.read_bytes()
    assert len(folder.audit_file.read_bytes().splitlines()) == 3


def test_a_lone_log_is_a_flight_of_its_own(tmp_path: Path) -> None:
    for name in ("a.BIN", "b.BIN", "flight.BIN"):
        (tmp_path / name).touch()
    flight_of(tmp_path / "a.BIN").rename("first")
    assert flight_of(tmp_path / "b.BIN").name == ""
    assert flight_of(tmp_path / "a.BIN").name == "first"
    FlightFolder(tmp_path).write({"runs": []})
    assert flight_of(tmp_path / "flight.BIN") == flight_of(tmp_path) == FlightFolder(tmp_path)
    assert flight_of(tmp_path / "b.BIN").of == "b.BIN"


def test_a_folder_that_cannot_be_written_says_so(tmp_path: Path) -> None:
    folder = FlightFolder(tmp_path / "gone")
    for write in (lambda: folder.rename("x"), lambda: folder.note(WHEN, "x"), lambda: folder.audit(WHEN, "x")):
        with pytest.raises(TippathError, match="cannot be written"):
            write()
