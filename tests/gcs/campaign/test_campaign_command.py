"""`tippath campaign` over flown logs: on real workers once, and then with what they left."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import pytest
from flying import TWO_CHIRPS, flown

from gcs.campaign import workers

Tippath = Callable[..., tuple[int, str, str]]


def nobody(*_: object) -> object:
    raise AssertionError("everything is done already: no worker is to be asked")


def test_a_campaign_is_worked_on_once(tippath: Tippath, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Two flights, a copy of one, and a file that is no log: each told once; again, nothing is done twice."""
    logs = tmp_path / "logs"
    logs.mkdir()
    for seed in (5, 6):
        (logs / f"2026-05-0{seed}.BIN").write_bytes(flown("hover-ideal", TWO_CHIRPS, None, seed))
    first = (logs / "2026-05-05.BIN").read_bytes()
    (logs / "cut.BIN").write_bytes(first[: len(first) * 3 // 4])
    (logs / "damaged.BIN").write_bytes(b"no log at all" * 100)
    folder = tmp_path / "out"
    status, out, err = tippath("campaign", logs, "-o", folder, "--workers", 1, "--json")
    assert status == 0, err
    made = json.loads(out)
    assert made["format"] == "tippath.campaign/1"
    assert made["copies"] == {"../logs/cut.BIN": "../logs/2026-05-05.BIN"}
    assert [(why["reason"], why["count"]) for why in made["reasons"]] == [("cannot be read", 1)]
    (group,) = made["groups"]
    assert [flight["flown"][:10] for flight in group["flights"]] == ["2026-05-05", "2026-05-06"]
    assert all(flight["predicted_nrmse_percent"]["p"] > 80 for flight in group["flights"])
    assert abs(group["parameters"]["L_b"]["mean"] - 147.5) < 8, "the simulated vehicle's, by the paper"
    kept = {path: path.stat().st_mtime_ns for path in folder.glob("*/*.json")}
    assert len(kept) == 4 + 2

    monkeypatch.setattr(workers, "_client", nobody)
    status, out, _ = tippath("campaign", logs, "-o", folder, "--json")
    assert status == 0
    assert json.loads(out) == made
    assert {path: path.stat().st_mtime_ns for path in folder.glob("*/*.json")} == kept


def test_a_folder_that_holds_something_else_is_left_alone(tippath: Tippath, tmp_path: Path) -> None:
    (tmp_path / "mine.txt").write_text("mine")
    status, _, err = tippath("campaign", tmp_path / "x.BIN", "-o", tmp_path)
    assert status == 2
    assert "another folder" in err
    status, _, err = tippath("campaign", tmp_path / "gone", "-o", tmp_path / "new")
    assert status == 1
    assert "gone is not there" in err
    assert not (tmp_path / "new").exists()
