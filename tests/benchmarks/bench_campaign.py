"""Many logs: the cost of each as they grow in number, what a second core brings, what the scheduler takes."""

from __future__ import annotations

import multiprocessing
import os
import time
from collections.abc import Callable
from pathlib import Path

import pytest
from flying import TWO_CHIRPS, flown

from gcs.campaign.store import Store
from gcs.campaign.work import Settings, worked_on
from gcs.campaign.workers import Cluster, Progress, Task, carry_out, work_through

COUNTS = tuple(int(word) for word in os.environ.get("CAMPAIGN_LOGS", "10,100,1000").split(","))
"""How many; the last takes minutes."""
FLAT = 1.15
"""A log among the most costs at most so much of one among the fewest."""
SECOND_CORE = 1.7
MEMORY_LOGS, FLAT_MEMORY = 100, 1.05
OVERHEAD = 0.10
TASKS, TASK_S = 20, 1.0
UNEQUAL = 64


def many(folder: Path, count: int) -> list[Path]:
    """A small flight so often, each file with other bytes at its end: none is known from another."""
    body = flown("hover-ideal", TWO_CHIRPS)
    folder.mkdir()
    paths = [folder / f"{number:05}.BIN" for number in range(count)]
    for number, path in enumerate(paths):
        path.write_bytes(body + str(number).encode().rjust(UNEQUAL, b"x"))
    return paths


class Clock:
    """Seconds from the first outcome to the last: starting workers takes what it takes, once, and is told apart."""

    def __init__(self) -> None:
        self.began, self.first, self.last, self.done = time.monotonic(), 0.0, 0.0, 0

    def __call__(self, progress: Progress) -> None:
        if progress.done > self.done:
            self.last, self.done = time.monotonic(), progress.done
            self.first = self.first or self.last

    @property
    def each_s(self) -> float:
        return (self.last - self.first) / (self.done - 1)


def timed(folder: Path, count: int, workers: int, make: Callable[[Path, int], list[Path]] = many) -> Clock:
    paths = make(folder / "logs", count)
    clock = Clock()
    with Cluster(workers=workers) as cluster:
        outcomes = work_through(paths, Settings(), Store(folder / "out"), cluster, on_progress=clock)
    assert all(one.fit is not None for one in outcomes)
    return clock


@pytest.fixture(autouse=True)
def no_cache(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("TIPPATH_CACHE", "off")


def bench_cost_of_a_log(tmp_path: Path) -> None:
    """Flat from few logs to many."""
    cores = os.cpu_count() or 1
    each = {}
    for count in COUNTS:
        (tmp_path / str(count)).mkdir()
        clock = timed(tmp_path / str(count), count, cores)
        each[count] = clock.each_s
        print(f"\n{count:6} logs: {1e3 * clock.each_s:.0f} ms each, {clock.first - clock.began:.1f} s to the first")
    assert each[COUNTS[-1]] < FLAT * each[COUNTS[0]]


def bench_memory_of_a_worker(tmp_path: Path) -> None:
    """The most that a process ever held, log after log."""
    paths = many(tmp_path / "logs", MEMORY_LOGS)
    with multiprocessing.get_context("spawn").Pool(1) as pool:
        most = pool.map(most_held_mb, paths, chunksize=1)
    first = most[MEMORY_LOGS // 10 - 1]
    print(f"\n{first:.0f} MB after {MEMORY_LOGS // 10} logs, {most[-1]:.0f} MB after {MEMORY_LOGS}")
    assert most[-1] < FLAT_MEMORY * first


def most_held_mb(path: Path) -> float:
    """After a log more."""
    import resource  # POSIX

    assert worked_on(path, Settings()).fit is not None
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


@pytest.mark.skipif((os.cpu_count() or 1) < 2, reason="one core")
def bench_second_core(tmp_path: Path) -> None:
    """Logs a second on two cores over one."""
    each = []
    for workers in (1, 2):
        (tmp_path / str(workers)).mkdir()
        each.append(timed(tmp_path / str(workers), 40, workers).each_s)
    print(f"\none core {1e3 * each[0]:.0f} ms a log, two {1e3 * each[1]:.0f} ms: {each[0] / each[1]:.2f} times")
    assert each[0] / each[1] > SECOND_CORE


def bench_scheduler(tmp_path: Path) -> None:
    """What it takes beside tasks of a second, after its start."""
    ends: list[float] = []
    tasks = {str(number): Task(tmp_path, time.sleep, (TASK_S,)) for number in range(TASKS)}
    began = time.monotonic()
    with Cluster(workers=1) as cluster:
        carry_out(
            tasks,
            lambda key, result, words: ends.append(time.monotonic()),
            lambda seconds, waiting: None,
            cluster,
        )
    over = (ends[-1] - ends[0]) / (TASKS - 1) / TASK_S - 1
    print(f"\n{100 * over:.1f} % over tasks of {TASK_S:g} s; {ends[0] - began - TASK_S:.1f} s to start")
    assert over < OVERHEAD
