"""Flight folders: numbered, never overwritten, and a file that is whole or not there."""

from __future__ import annotations

import math
from pathlib import Path

import pytest

from gcs.errors import TippathError, UsageError
from gcs.flightdir import FlightFolder, create


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
    with pytest.raises(TippathError, match="cannot be read"):
        FlightFolder(tmp_path).read()
    (tmp_path / "flight.json").write_text('{"format": "else"}')
    with pytest.raises(TippathError, match=r"not a tippath\.flight/1"):
        FlightFolder(tmp_path).read()


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
