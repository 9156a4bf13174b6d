"""Campaigns in which something is killed with -9: the program, a worker, the scheduler. Nothing is lost or done twice,
and the tables are the same to the byte, whoever did the work."""

from __future__ import annotations

import hashlib
import json
import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import psutil  # type: ignore[import-untyped]
import pytest
from flying import TWO_CHIRPS, flown

pytestmark = [
    pytest.mark.thorough,
    pytest.mark.skipif(os.name == "nt", reason="signals of POSIX"),
]
LOGS, HALF_WAY = 40, 8
LONGEST_S = 240.0
"""What any of this may take on a busy machine."""
DASK = [sys.executable, "-m", "dask"]
Kept = dict[str, tuple[int, str]]


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with logs/ of many flights, and one that is none."""
    folder = tmp_path_factory.mktemp("campaigns")
    (folder / "logs").mkdir()
    for number in range(LOGS - 1):
        body = flown("hover-ideal", TWO_CHIRPS, None, 100 + number)
        (folder / "logs" / f"2026-{1 + number // 20:02}-{1 + number % 20:02}.BIN").write_bytes(body)
    (folder / "logs" / "damaged.BIN").write_bytes(b"no log" * 1000)
    return folder


@contextmanager
def process(words: list[str], folder: Path, told: str) -> Iterator[subprocess.Popen[bytes]]:
    """In a session of its own, which ends with the block; what it says goes to files that begin with `told`."""
    with (folder / f"{told}.out").open("wb") as out, (folder / f"{told}.err").open("wb") as err:
        one = subprocess.Popen(words, cwd=folder, stdout=out, stderr=err, start_new_session=True)
    try:
        yield one
    finally:
        for each in of_session(one.pid):
            each.kill()
        one.wait(LONGEST_S)


def of_session(leader: int) -> list[psutil.Process]:
    """Processes that were started by one, though it may be gone."""
    found = []
    for one in psutil.process_iter():
        try:
            if os.getsid(one.pid) == leader and one.status() != psutil.STATUS_ZOMBIE:
                found.append(one)
        except (psutil.NoSuchProcess, ProcessLookupError, PermissionError):
            continue
    return found


def campaign(place: Path, name: str, *more: str) -> list[str]:
    own = () if "--scheduler" in more else ("--workers", "2")
    return [sys.executable, "-m", "gcs.cli", "campaign", "logs", "-o", name, "--json", *own, *more]


def until(met: Callable[[], bool], what: str, one: subprocess.Popen[bytes] | None = None) -> None:
    end = time.monotonic() + LONGEST_S
    while not met():
        assert time.monotonic() < end, f"waited {LONGEST_S:g} s until {what}"
        assert one is None or one.poll() is None, f"it ended before {what}"
        time.sleep(0.05)


def ended(one: subprocess.Popen[bytes], place: Path, told: str) -> str:
    """What it wrote to standard error; it must have succeeded."""
    status = one.wait(LONGEST_S)
    err = (place / f"{told}.err").read_text()
    assert status == 0, err
    return err


def kept(folder: Path) -> Kept:
    """Of each outcome on disk when it was written, and its digest."""
    return {
        path.name: (path.stat().st_mtime_ns, hashlib.sha256(path.read_bytes()).hexdigest())
        for path in (folder / "logs").glob("*.json")
    }


def result(folder: Path) -> tuple[dict[str, bytes], dict[str, Any]]:
    """The tables byte by byte, and the document without its folder's name."""
    document = json.loads((folder / "campaign.json").read_bytes())
    tables = {path.name: path.read_bytes() for path in sorted((folder / "dataset").glob("*.parquet"))}
    return tables, {name: each for name, each in document.items() if name != "folder"}


@pytest.fixture(scope="module")
def whole(place: Path) -> Path:
    """On own cores, and one of the workers killed half way."""
    with process(campaign(place, "whole"), place, "whole-run") as one:
        until(lambda: len(kept(place / "whole")) >= HALF_WAY, "some logs were done", one)
        working = [each for each in psutil.Process(one.pid).children(True) if "spawn_main" in " ".join(each.cmdline())]
        os.kill(working[0].pid, signal.SIGKILL)
        before = kept(place / "whole")
        ended(one, place, "whole-run")
    after = kept(place / "whole")
    assert len(before) < LOGS
    assert before.items() <= after.items(), "what was done is not done again"
    return place / "whole"


def test_a_worker_that_is_killed_takes_no_log_with_it(whole: Path) -> None:
    _, document = result(whole)
    assert (document["logs"], document["fitted"]) == (LOGS, LOGS - 1)
    assert len(kept(whole)) == LOGS
    (why,) = document["reasons"]
    assert (why["reason"], why["logs"]) == ("cannot be read", ["../logs/damaged.BIN"])


def test_a_program_that_is_killed_goes_on_where_it_was(place: Path, whole: Path) -> None:
    folder = place / "killed"
    with process(campaign(place, "killed"), place, "killed-1") as one:
        until(lambda: len(kept(folder)) >= HALF_WAY, "some logs were done", one)
        one.kill()
        one.wait(LONGEST_S)
        before = kept(folder)
        until(lambda: not of_session(one.pid), "its workers ended by themselves")
    assert HALF_WAY <= len(before) < LOGS
    assert kept(folder) == before, "nobody works on for a program that is gone"
    with process(campaign(place, "killed"), place, "killed-2") as again:
        err = ended(again, place, "killed-2")
    assert f"{len(before)} of {LOGS} logs were done before" in err
    assert before.items() <= kept(folder).items(), "what was done is not done again"
    assert result(folder) == result(whole)


def test_a_scheduler_that_is_killed_and_started_again_is_found_and_finished_with(place: Path, whole: Path) -> None:
    """Two workers reached by address; whoever keeps them running starts those again that end with it."""
    folder = place / "cluster"
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    address = f"tcp://127.0.0.1:{port}"
    scheduler = [*DASK, "scheduler", "--host", "127.0.0.1", "--port", str(port), "--no-dashboard"]
    worker = [*DASK, "worker", address, "--host", "127.0.0.1", "--nthreads", "1", "--no-dashboard"]
    worker += ["--local-directory", "scratch"]
    with (
        process(campaign(place, "cluster", "--scheduler", address), place, "cluster-run") as one,
        process(scheduler, place, "scheduler-1") as first,
    ):
        with process(worker, place, "worker-1"), process(worker, place, "worker-2"):
            until(lambda: len(kept(folder)) >= HALF_WAY, "some logs were done", one)
            first.kill()
            first.wait(LONGEST_S)
            before = kept(folder)
        with (
            process(scheduler, place, "scheduler-2"),
            process(worker, place, "worker-3"),
            process(worker, place, "worker-4"),
        ):
            ended(one, place, "cluster-run")
    assert HALF_WAY <= len(before) < LOGS
    assert before.items() <= kept(folder).items(), "what was done is not done again"
    both = [name for name in ("worker-3", "worker-4") if "Registered to" in (place / f"{name}.err").read_text()]
    assert len(both) == 2
    assert result(folder) == result(whole)
