"""Reading a large ULog: the chain reader against pyulog in the same run, of the same topics and of all of them."""

from __future__ import annotations

import time
import tracemalloc
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pyulog import ULog

from gcs.logs.formats import ulog

REPEATS = 25
FIRST_DATA = 36_093  # where the definitions and subscriptions of sample.ulg end
TOPICS = ("sensor_combined", "actuator_controls_0")


def _best(read: Callable[[], Any], times: int) -> float:
    best = float("inf")
    for _ in range(times):
        start = time.perf_counter()
        read()
        best = min(best, time.perf_counter() - start)
    return best


def _columns(path: Path, topics: tuple[str, ...] | None) -> dict[str, dict[str, np.ndarray]]:
    log = ulog.read(path)
    found = {}
    for topic, instance in log.ids:
        if topics is None or topic in topics:
            starts = log.messages(topic, instance)
            found[topic] = {key: log.column(topic, key, starts) for key in log.layout(topic)}
    return found


@pytest.mark.data
def bench_ulog_against_pyulog(shared_data: Path, tmp_path: Path) -> None:
    once = (shared_data / "px4" / "sample.ulg").read_bytes()
    path = tmp_path / "large.ulg"
    path.write_bytes(once[:FIRST_DATA] + once[FIRST_DATA:] * REPEATS)
    size = path.stat().st_size

    bytes_alone = _best(lambda: np.fromfile(path, np.uint8), 3)
    two = _best(lambda: _columns(path, TOPICS), 3)
    two_theirs = _best(lambda: ULog(str(path), list(TOPICS)), 1)
    every = _best(lambda: _columns(path, None), 3)
    every_theirs = _best(lambda: ULog(str(path)), 1)
    tracemalloc.start()
    _columns(path, TOPICS)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()

    theirs = ULog(str(path), list(TOPICS))
    ours = _columns(path, TOPICS)
    for one in theirs.data_list:
        for key, values in one.data.items():
            assert ours[one.name][key].tobytes() == values.tobytes()
    print(
        f"\n{size / 1e6:.0f} MB of ULog: two topics {two:.2f} s, pyulog {two_theirs:.1f} s, "
        f"{two_theirs / two:.1f} times faster; all {every:.2f} s, pyulog {every_theirs:.1f} s, "
        f"{every_theirs / every:.1f} times; "
        f"{two / bytes_alone:.0f} times np.fromfile, memory {peak / size:.1f} times the file"
    )
    assert two < two_theirs
    assert every < every_theirs
    assert peak < 3 * size
