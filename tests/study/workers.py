"""Cases worked off by processes that share nothing: one that dies or takes too long costs its case, not the study.

A process takes a case, answers it, and takes the next. What it does not answer is answered for it, with the reason.
"""

from __future__ import annotations

import multiprocessing
import os
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from multiprocessing.connection import Connection, wait
from typing import Any

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
"""For the processes begun here: of these small matrices more threads take five times the seconds and bring nothing."""
Answer = dict[str, Any]


@dataclass(kw_only=True)
class _Worker:
    """A process and the case that it has."""

    process: multiprocessing.process.BaseProcess
    pipe: Connection
    case: Any = None
    since: float = 0.0


def worked_off(
    cases: Sequence[Any],
    work: Callable[[Any], Answer],
    *,
    workers: int,
    longest_s: float,
    budget_s: float | None = None,
) -> Iterator[tuple[Any, Answer]]:
    """Each case with what `work` makes of it, as they come; `work` and cases go to other processes.

    A case that takes longer than `longest_s` of wall-clock, or whose process ends, is answered {"failed": reason}. No
    case begins after `budget_s`; those under way are waited for.
    """
    stop = time.monotonic() + budget_s if budget_s is not None else None
    todo, busy = iter(cases), [_started(work) for _ in range(min(workers, len(cases)))]
    try:
        for worker in busy:
            _next_for(worker, todo, stop)
        while under_way := [worker for worker in busy if worker.case is not None]:
            ready = wait([worker.pipe for worker in under_way], timeout=1.0)
            for worker in under_way:
                answer = _answer_of(worker, worker.pipe in ready, longest_s)
                if answer is None:
                    continue
                case = worker.case
                if "failed" in answer and not worker.process.is_alive():
                    busy[busy.index(worker)] = worker = _started(work)
                _next_for(worker, todo, stop)
                yield case, answer
    finally:
        for worker in busy:
            worker.process.kill()


def _started(work: Callable[[Any], Answer]) -> _Worker:
    context = multiprocessing.get_context("spawn")
    here, there = context.Pipe()
    process = context.Process(target=_serve, args=(there, work), daemon=True)
    process.start()
    there.close()
    return _Worker(process=process, pipe=here)


def _serve(pipe: Connection, work: Callable[[Any], Answer]) -> None:
    """In its own process: answer until nobody asks."""
    while True:
        try:
            case = pipe.recv()
        except (EOFError, OSError):
            return
        pipe.send(work(case))


def _next_for(worker: _Worker, todo: Iterator[Any], stop: float | None) -> None:
    over = stop is not None and time.monotonic() >= stop
    worker.case, worker.since = None if over else next(todo, None), time.monotonic()
    if worker.case is not None:
        worker.pipe.send(worker.case)


def _answer_of(worker: _Worker, ready: bool, longest_s: float) -> Answer | None:
    """None while it is at work; a process that answers no more is ended."""
    if ready:
        try:
            return dict(worker.pipe.recv())
        except (EOFError, OSError):
            worker.process.join()
            return {"failed": f"the process ended by itself ({_ending(worker.process.exitcode)})"}
    if time.monotonic() - worker.since < longest_s:
        return None
    worker.process.kill()
    worker.process.join()
    return {"failed": f"took longer than {longest_s:g} s"}


def _ending(code: int | None) -> str:
    return f"signal {-code}" if code is not None and code < 0 else f"exit status {code}"


def cores() -> int:
    """That this process may use."""
    return len(os.sched_getaffinity(0))
