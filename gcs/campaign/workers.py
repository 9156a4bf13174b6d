"""Logs worked on by Dask, on this computer's cores or on a cluster, and what was found taken back as it comes.

Everything is on disk before the next is looked at: a worker that dies takes one log's minute with it, a program that is
ended nothing, and a scheduler that is started again is found and given what is still open.
"""

from __future__ import annotations

import contextlib
import os
import queue
import signal
import threading
import time
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import msgspec

from gcs.campaign.identity import program
from gcs.campaign.store import Store
from gcs.campaign.work import Outcome, Predicted, Settings, key_of, predicted_on, prediction_key, worked_on
from gcs.errors import LinkError, TippathError

TRIES = 2
"""Of a log whose workers died, each time until the scheduler gives it up."""
AHEAD = 256
"""Logs that the scheduler knows of: enough for every worker of a cluster, few enough for any number of logs."""
FIRST_S, AGAIN_S = 10.0, 600.0
"""How long a scheduler is waited for that was not there yet, and one that went away."""
POLL_S = 1.0
Work = Callable[[Path, Settings], Outcome]


@dataclass(frozen=True, slots=True, kw_only=True)
class Progress:
    """Where a campaign stands."""

    done: int
    of: int
    kept: int
    """Of those that are done, found on disk."""
    seconds: float
    """Since the first was handed out."""
    newest: Outcome | None
    what: str = "logs"
    waiting_for: str = ""
    """What nothing goes on without: the scheduler, a worker."""

    @property
    def left_s(self) -> float | None:
        """At the rate so far; None before there is one."""
        worked = self.done - self.kept
        return None if not worked else self.seconds / worked * (self.of - self.done)


@dataclass(frozen=True, slots=True)
class Task:
    """Something to be called on a worker."""

    path: Path
    """The log it is about."""
    call: Callable[..., Any]
    arguments: tuple[Any, ...]


class Cluster:
    """Who does the work: processes of our own, begun when there is some, or the cluster at an address.

    The same from one call to the next, and another one where it went away.
    """

    def __init__(self, scheduler: str | None = None, workers: int | None = None) -> None:
        """`workers`: processes of our own; None for as many as there are cores, or tasks."""
        self._scheduler, self._workers = scheduler, workers
        self._opened = contextlib.ExitStack()
        self._client: Any = None
        self._patience_s = FIRST_S

    def __enter__(self) -> Cluster:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def client(self, tasks: int, waiting: Callable[[str], None]) -> Any:
        """Raises as `work_through`."""
        if self._client is None:
            workers = self._workers or min(tasks, os.cpu_count() or 1)
            opening = _client(self._scheduler, workers, self._patience_s, waiting)
            self._client = self._opened.enter_context(opening)
            self._patience_s = AGAIN_S
        return self._client

    def close(self) -> None:
        """Ends what is our own; whoever asks again gets another."""
        self._client = None
        self._opened.close()


def work_through(
    paths: Sequence[Path],
    settings: Settings,
    store: Store,
    cluster: Cluster,
    *,
    on_progress: Callable[[Progress], None] = lambda progress: None,
    work: Work = worked_on,
) -> list[Outcome]:
    """The outcome of every log, in their order. What cannot even be read has one, too, with its reason.

    Raises TippathError where workers run another version of this program, LinkError where no scheduler answers, OSError
    where the store's disk is full.
    """
    paths = [Path(os.path.abspath(path)) for path in paths]
    keys, unread = _keys(paths, settings, store)
    found = {key: before for key in dict.fromkeys(keys.values()) if (before := store.kept(key, Outcome)) is not None}
    open_ = {key: Task(path, work, (path, settings)) for path, key in keys.items() if key not in found}
    of, kept, newest = len(open_) + len(found), len(found), None

    def progress(seconds: float, waiting_for: str = "") -> None:
        on_progress(
            Progress(done=len(found), of=of, kept=kept, seconds=seconds, newest=newest, waiting_for=waiting_for)
        )

    def done(key: str, outcome: Outcome | None, words: str) -> None:
        nonlocal newest
        if outcome is None:  # without having been looked at: it is asked again next time
            outcome = _failed(open_[key].path, key, settings, words)
        elif outcome.version != program():
            raise TippathError(
                f"a worker runs tippath {outcome.version}, and this is {program()}: give all the same program"
            )
        elif outcome.key != key:
            outcome = _failed(open_[key].path, key, settings, "it changed while it was worked on; ask again")
        else:
            store.keep(outcome)
        found[key] = newest = outcome

    progress(0.0)
    try:
        carry_out(open_, done, progress, cluster)
    finally:
        with contextlib.suppress(OSError):
            store.keep_index()
    return [unread[path] if path in unread else _at(found[keys[path]], path) for path in paths]


def predict_through(
    pairs: Sequence[tuple[Outcome, Outcome]],
    store: Store,
    cluster: Cluster,
    *,
    on_progress: Callable[[Progress], None] = lambda progress: None,
) -> dict[str, Predicted]:
    """Of each flight, by another's model: path -> how well. Raises as `work_through`."""
    keys = {prediction_key(of, by): (of, by) for of, by in pairs}
    found = {key: before for key in keys if (before := store.kept(key, Predicted)) is not None}
    tasks = {
        key: Task(Path(of.path), predicted_on, (Path(of.path), of, by))
        for key, (of, by) in keys.items()
        if key not in found
    }
    kept = len(found)

    def tick(seconds: float, waiting_for: str) -> None:
        on_progress(
            Progress(
                done=len(found),
                of=len(keys),
                kept=kept,
                seconds=seconds,
                newest=None,
                what="predictions",
                waiting_for=waiting_for,
            )
        )

    def done(key: str, result: Predicted | None, words: str) -> None:
        if result is None:
            result = Predicted(key=key, by=keys[key][1].key, version="", nrmse_percent=None, words=words)
        else:
            store.keep(result)
        found[key] = result

    if pairs:
        tick(0.0, "")
    carry_out(tasks, done, tick, cluster)
    return {keys[key][0].path: one for key, one in found.items()}


def _keys(paths: Sequence[Path], settings: Settings, store: Store) -> tuple[dict[Path, str], dict[Path, Outcome]]:
    """Path -> key of what can be read; path -> outcome of what cannot."""
    keys, unread = {}, {}
    for path in paths:
        try:
            keys[path] = key_of(store.digest(path), settings)
        except OSError as error:
            unread[path] = _failed(path, "", settings, f"{path}: {error.strerror or error}")
    return keys, unread


def _failed(path: Path, key: str, settings: Settings, words: str) -> Outcome:
    return Outcome(
        key=key, path=str(path), sha256="", version="", settings=settings, reason="cannot be read", words=words
    )


def _at(outcome: Outcome, path: Path) -> Outcome:
    """Under the path it was asked for: equal bytes may lie in several places, or have moved."""
    return outcome if outcome.path == str(path) else msgspec.structs.replace(outcome, path=str(path))


def carry_out(
    tasks: Mapping[str, Task],
    done: Callable[[str, Any, str], None],
    tick: Callable[[float, str], None],
    cluster: Cluster,
) -> None:
    """Every task's result by its key, once each and as they come: `done(key, result, "")`, or None and why there is
    none. `tick(seconds, what nothing goes on without)` about once a second.

    Raises as `work_through`.
    """
    open_, died = dict(tasks), Counter[str]()
    began = time.monotonic()

    def one_done(key: str, result: Any, words: str) -> None:
        done(key, result, words)
        del open_[key]
        tick(time.monotonic() - began, "")

    def waiting(what: str) -> None:
        tick(time.monotonic() - began, what)

    while open_:
        _hand_out(cluster.client(len(open_), waiting), list(open_.items()), died, one_done, waiting)
        if open_:
            cluster.close()


@contextlib.contextmanager
def _client(scheduler: str | None, workers: int, patience_s: float, waiting: Callable[[str], None]) -> Iterator[Any]:
    """A client of a cluster of our own, or of the one at an address."""
    import distributed

    if scheduler is None:
        with _deaf_to_interrupts():
            started = distributed.LocalCluster(
                n_workers=workers,
                threads_per_worker=1,
                processes=True,
                host="127.0.0.1",
                dashboard_address=None,
                silence_logs=50,
            )
        with (
            started as cluster,
            distributed.Client(cluster, set_as_default=False) as client,
        ):
            yield client
        return
    end = time.monotonic() + patience_s
    while True:
        try:
            client = distributed.Client(scheduler, timeout=5, set_as_default=False)
            break
        except (OSError, TimeoutError) as error:
            if time.monotonic() > end:
                raise LinkError(f"no Dask scheduler answers at {scheduler}; start one with `dask scheduler`") from error
            waiting("scheduler")
            time.sleep(POLL_S)
        except ValueError as error:
            raise TippathError(
                f"--scheduler {scheduler}: no address ({error}); wants such as tcp://HOST:8786"
            ) from error
    with client:
        yield client


@contextlib.contextmanager
def _deaf_to_interrupts() -> Iterator[None]:
    """Processes that are started meanwhile leave Ctrl-C to this one, which ends them."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)


def _hand_out(
    client: Any,
    tasks: Iterable[tuple[str, Task]],
    died: Counter[str],
    done: Callable[[str, Any, str], None],
    waiting: Callable[[str], None],
) -> None:
    """Until all are done, or the scheduler is gone; then what is open stays so."""
    import distributed

    arrived: queue.SimpleQueue[Any] = queue.SimpleQueue()
    rest, out = iter(tasks), {}
    while True:
        for key, task in rest:
            # another client's task of the same name would be taken for ours, with what became of it
            future = client.submit(task.call, *task.arguments, key=f"tippath-{key}-{client.id}", pure=False)
            out[future] = key
            future.add_done_callback(arrived.put)
            if len(out) >= AHEAD:
                break
        if not out:
            return
        try:
            future = arrived.get(timeout=POLL_S)
        except queue.Empty:
            if client.status != "running":
                return
            waiting("" if _has_workers(client) else "worker")
            continue
        key = out.pop(future)
        try:
            if future.status == "error":
                _ended_badly(future.exception(), key, died, done)
            elif future.status == "finished":
                done(key, *_result(future))
            else:
                return
        except distributed.CancelledError:
            return
        future.release()


def _result(future: Any) -> tuple[Any, str]:
    """Raises CancelledError where the scheduler is gone."""
    import distributed

    try:
        return future.result(), ""
    except (OSError, TimeoutError) as error:  # of the connection: what the task raised is told before
        raise distributed.CancelledError(str(error)) from error


def _has_workers(client: Any) -> bool:
    try:
        return bool(client.scheduler_info(n_workers=1)["workers"])
    except (OSError, TimeoutError):
        return False


def _ended_badly(error: Exception, key: str, died: Counter[str], done: Callable[[str, Any, str], None]) -> None:
    """A task that has no result: tried again, or why there is none."""
    import distributed

    if isinstance(error, distributed.KilledWorker):
        died[key] += 1
        if died[key] >= TRIES:
            done(key, None, "its worker died while it was worked on, several times: too little memory for it?")
    elif isinstance(error, ModuleNotFoundError):
        raise TippathError(
            f"a worker has no {error.name}: start `dask worker` from the Python that tippath is installed in"
        ) from error
    elif isinstance(error, OSError):
        words = f"a worker cannot read it ({error.strerror or error}): does it have the same folders?"
        done(key, None, words)
    else:
        done(key, None, f"{type(error).__name__}: {error}")
