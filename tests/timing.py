"""How long work takes, for the benchmarks."""

from __future__ import annotations

import time
from collections.abc import Callable


def best_of(times: int, work: Callable[[], object]) -> float:
    """Seconds of the fastest of so many runs."""
    spent = []
    for _ in range(times):
        begin = time.perf_counter()
        work()
        spent.append(time.perf_counter() - begin)
    return min(spent)


def cpu_of(times: int, work: Callable[[], object]) -> float:
    """CPU seconds of the cheapest of so many runs: on a machine that others use, too."""
    spent = []
    for _ in range(times):
        begin = time.process_time()
        work()
        spent.append(time.process_time() - begin)
    return min(spent)
