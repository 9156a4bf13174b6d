"""`tippath campaign` over flown logs: on real workers once, and then with what they left."""

from __future__ import annotations

import json
import os
import signal
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

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
    began: list[object] = []
    client = workers._client

    def counted(*given: Any) -> Any:
        began.append(given)
        return client(*given)

    monkeypatch.setattr(workers, "_client", counted)
    status, out, err = tippath("campaign", logs, "-o", folder, "--workers", 1, "--json")
    assert status == 0, err
    assert len(began) == 1, "predictions are made by those who made the fits"
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
    status, out, err = tippath("campaign", logs, "-o", folder, "--json")
    assert status == 0
    assert err.splitlines() == [" 4 of 4 logs were done before", " 2 of 2 predictions were done before"]
    assert json.loads(out) == made
    assert {path: path.stat().st_mtime_ns for path in folder.glob("*/*.json")} == kept


def dies_once(mark: Path, number: int) -> int:
    """Takes its worker with it the first time."""
    if number == 2 and not mark.exists():
        mark.touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return number


@pytest.mark.thorough
@pytest.mark.skipif(os.name == "nt", reason="signals of POSIX")
def test_a_killed_worker_s_task_is_done_by_the_next(tmp_path: Path) -> None:
    done: list[Any] = []
    tasks = {str(n): workers.Task(tmp_path, dies_once, (tmp_path / "mark", n)) for n in range(4)}
    with workers.Cluster(workers=1) as cluster:
        workers.carry_out(tasks, lambda *result: done.append(result), lambda seconds, waiting: None, cluster)
    assert sorted(done) == [(str(n), n, "") for n in range(4)]
    assert (tmp_path / "mark").exists()


def test_what_is_missing_is_told_before_anything_is_done(
    tippath: Tippath, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("distributed", "pyarrow"):
        monkeypatch.setitem(sys.modules, name, None)
    status, _, err = tippath("campaign", tmp_path / "x.BIN", "-o", tmp_path / "out")
    assert status == 1
    assert err.startswith("tippath campaign: a campaign needs distributed and pyarrow, which are not installed: ")
    assert err.strip().endswith("-m pip install distributed pyarrow")
    assert not (tmp_path / "out").exists()


def test_a_folder_that_holds_something_else_is_left_alone(tippath: Tippath, tmp_path: Path) -> None:
    (tmp_path / "mine.txt").write_text("mine")
    status, _, err = tippath("campaign", tmp_path / "x.BIN", "-o", tmp_path)
    assert status == 2
    assert "another folder" in err
    status, _, err = tippath("campaign", tmp_path / "gone", "-o", tmp_path / "new")
    assert status == 1
    assert "gone is not there" in err
    assert not (tmp_path / "new").exists()
