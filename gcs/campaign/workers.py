"""Logs handed to workers, on this computer's cores or on a Dask cluster, and outcomes taken back as they come.

Every outcome is on disk before the next is looked at: a worker that dies takes one log's minute with it, a program that
is ended nothing, and a scheduler that is started again is found and given what is still open.
"""

from __future__ import annotations

import contextlib
import os
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import msgspec

from gcs.campaign.store import Store
from gcs.campaign.work import Outcome, Settings, key_of, worked_on
from gcs.errors import LinkError, TippathError, to_install

TRIES = 2
"""Of a log whose worker died."""
PATIENCE_S = 60.0
"""How long a scheduler that went away is waited for."""
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

    @property
    def left_s(self) -> float | None:
        """At the rate so far; None before there is one."""
        worked = self.done - self.kept
        return None if not worked else self.seconds / worked * (self.of - self.done)


def work_through(
    paths: Sequence[Path],
    settings: Settings,
    store: Store,
    *,
    scheduler: str | None = None,
    workers: int | None = None,
    on_progress: Callable[[Progress], None] = lambda progress: None,
    work: Work = worked_on,
) -> list[Outcome]:
    """The outcome of every log, in their order. What cannot even be read has one, too, with its reason.

    Raises TippathError where Dask is not installed, LinkError where no scheduler answers, OSError where the store's
    disk is full.
    """
    keys, unread = _keys(paths, settings, store)
    found = {key: before for key in dict.fromkeys(keys.values()) if (before := store.kept(key)) is not None}
    open_ = {key: path for path, key in keys.items() if key not in found}
    of, kept, began = len(open_) + len(found), len(found), time.monotonic()

    def done(outcome: Outcome) -> None:
        if outcome.sha256:  # what failed without having been looked at is asked again next time
            store.keep(outcome)
        found[outcome.key] = outcome
        del open_[outcome.key]
        seconds = time.monotonic() - began
        on_progress(Progress(done=len(found), of=of, kept=kept, seconds=seconds, newest=outcome))

    on_progress(Progress(done=kept, of=of, kept=kept, seconds=0.0, newest=None))
    try:
        while open_:
            with _client(scheduler, workers or min(len(open_), os.cpu_count() or 1)) as client:
                _hand_out(client, open_, settings, work, done)
    finally:
        with contextlib.suppress(OSError):
            store.keep_index()
    return [unread[path] if path in unread else _at(found[keys[path]], path) for path in paths]


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


@contextlib.contextmanager
def _client(scheduler: str | None, workers: int) -> Iterator[Any]:
    """A client of a cluster of our own, or of the one at an address."""
    try:
        import distributed
    except ImportError as error:
        raise TippathError(f"a campaign needs Dask, which is not installed: {to_install('distributed')}") from error
    if scheduler is None:
        with (
            distributed.LocalCluster(
                n_workers=workers,
                threads_per_worker=1,
                processes=True,
                host="127.0.0.1",
                dashboard_address=None,
                silence_logs=50,
            ) as cluster,
            distributed.Client(cluster, set_as_default=False) as client,
        ):
            yield client
        return
    end = time.monotonic() + PATIENCE_S
    while True:
        try:
            client = distributed.Client(scheduler, timeout=5, set_as_default=False)
            break
        except (OSError, TimeoutError) as error:
            if time.monotonic() > end:
                raise LinkError(f"no Dask scheduler answers at {scheduler}; start one with `dask scheduler`") from error
            time.sleep(POLL_S)
    with client:
        yield client


def _hand_out(
    client: Any, open_: dict[str, Path], settings: Settings, work: Work, done: Callable[[Outcome], None]
) -> None:
    """Until nothing is open, or the scheduler is gone: then what is open stays so."""
    import distributed

    futures = {
        client.submit(work, path, settings, key=f"tippath-{key}", retries=0, pure=False): key
        for key, path in open_.items()
    }
    try:
        for future in distributed.as_completed(futures, loop=client.loop):
            key = futures[future]
            error = future.exception()
            if error is None:
                done(future.result())
            elif isinstance(error, distributed.KilledWorker):
                words = "its worker died while it was worked on, several times: too little memory for it?"
                done(_failed(open_[key], key, settings, words))
            elif isinstance(error, Exception) and not isinstance(error, distributed.CancelledError):
                done(_failed(open_[key], key, settings, f"{type(error).__name__}: {error}"))
            future.release()
    except (distributed.CancelledError, distributed.comm.CommClosedError, OSError, TimeoutError):
        if client.scheduler is not None and client.status == "running":
            raise
