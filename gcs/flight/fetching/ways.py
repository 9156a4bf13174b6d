"""How a log comes off the vehicle: MAVFTP, or LOG_REQUEST_DATA; and which logs there are, by either.

What was begun is ended whatever happens: a download that nobody ends goes on and starves the link.
"""

from __future__ import annotations

import contextlib
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Protocol, TypeVar

from gcs.errors import TippathError
from gcs.link import ftp, log_files
from gcs.link.encode import Send
from gcs.link.events import CAPABILITY_FTP, LogEntry
from gcs.link.ftp import FileChecksum, FtpEntry, ListFolder, ReadFile
from gcs.link.log_files import EndLogs, ListLogs, ReadLog
from gcs.link.procedures import NoAnswerError, Procedure, ProcedureError, RefusedError
from gcs.vehicle.snapshot import VehicleSnapshot

T = TypeVar("T")

BY_FTP, BY_MESSAGES = "ftp", "log"
NAMES = {BY_FTP: ftp.NAME, BY_MESSAGES: log_files.NAME}
FOLDERS = ("/APM/LOGS", "logs")
"""Where ArduPilot keeps logs: on a card, and in its simulator."""
_LOG_NAME = re.compile(r"(\d{1,9})\.(?:BIN|bin)")
LARGEST = 0xFFFF_FFF0
"""Bytes; a size above it is none."""


class Connection(Protocol):
    """What fetching needs of a `gcs.flight.session.Session`."""

    def snapshot(self) -> VehicleSnapshot: ...
    def call(
        self, procedure: Procedure[T], timeout_s: float | None = None, *, cancelled: Callable[[], bool] | None = None
    ) -> T: ...
    def send(self, *sends: Send) -> None: ...


class Reader(Procedure[int], Protocol):
    """A reading under way."""

    @property
    def at(self) -> int: ...
    def farewell(self) -> list[Send]: ...


@dataclass(frozen=True, slots=True, kw_only=True)
class VehicleLog:
    """A log on board."""

    number: int
    """Of its file; of its entry where the vehicle has no file server."""
    size: int
    """Bytes, as last told."""
    path: str | None = None
    """By MAVFTP."""
    id: int | None = None
    """By LOG_REQUEST_DATA."""
    utc_s: int = 0
    """When it was written, seconds since 1970; 0 where that is not known."""

    @property
    def ways(self) -> tuple[str, ...]:
        """Those by which it can be read."""
        return tuple(way for way, name in ((BY_FTP, self.path), (BY_MESSAGES, self.id)) if name is not None)

    @property
    def readable(self) -> bool:
        return 0 < self.size < LARGEST


def list_logs(session: Connection) -> tuple[VehicleLog, ...]:
    """The logs on board, the oldest first, by all ways that there are.

    Raises ProcedureError where the vehicle refuses or answers by none.
    """
    capabilities = session.snapshot().capabilities
    serves_files = capabilities is None or bool(capabilities & CAPABILITY_FTP)
    files: tuple[VehicleLog, ...] = ()
    problem: ProcedureError | None = None
    if serves_files:
        try:
            files = _files(session)
        except ProcedureError as error:
            problem = error
    try:
        entries = session.call(ListLogs())
    except ProcedureError as error:
        end_logs(session)
        if not files:
            raise _neither(problem, error) from error
        return files
    return _joined(files, entries)


def _neither(first: ProcedureError | None, second: ProcedureError) -> ProcedureError:
    if first is None or isinstance(second, RefusedError):
        return second
    return NoAnswerError(
        f"the vehicle gives its logs neither by {ftp.NAME} ({first}) nor by {log_files.NAME} ({second}); take them off "
        "its card"
    )


def _files(session: Connection) -> tuple[VehicleLog, ...]:
    problem: ProcedureError | None = None
    for folder in FOLDERS:
        try:
            return _of_folder(folder, session.call(ListFolder(folder)))
        except NoAnswerError:
            raise
        except ProcedureError as error:
            problem = error
    raise problem or NoAnswerError("no folder of logs")


def _of_folder(folder: str, entries: Sequence[FtpEntry]) -> tuple[VehicleLog, ...]:
    found = [(int(match[1]), entry) for entry in entries if (match := _LOG_NAME.fullmatch(entry.name))]
    return tuple(
        VehicleLog(number=number, size=entry.size, path=f"{folder}/{entry.name}")
        for number, entry in sorted(found, key=lambda pair: pair[0])
    )


def _joined(files: Sequence[VehicleLog], entries: Sequence[LogEntry]) -> tuple[VehicleLog, ...]:
    """Files and entries that are the same logs. ArduPilot counts entries from the oldest, whatever its number is."""
    if not files:
        return tuple(VehicleLog(number=one.id, size=one.size, id=one.id, utc_s=one.utc_s) for one in entries)
    alike = len(files) == len(entries) and all(
        file.size == entry.size for file, entry in list(zip(files, entries, strict=False))[:-1]
    )
    if not alike:
        return tuple(files)
    return tuple(
        VehicleLog(number=file.number, size=max(file.size, entry.size), path=file.path, id=entry.id, utc_s=entry.utc_s)
        for file, entry in zip(files, entries, strict=True)
    )


def read(
    session: Connection,
    log: VehicleLog,
    way: str,
    store: Callable[[bytes], None],
    *,
    start: int,
    stop: int,
    watch: Callable[[], None] = lambda: None,
) -> None:
    """The bytes `start` up to `stop` of a log, handed to `store` in order; `watch` is called meanwhile.

    Raises ProcedureError, and what `store` raises; the vehicle has been told to end whatever happens.
    """

    def go_on() -> bool:
        watch()
        return False

    reader = _reader(log, way, store, start, stop)
    try:
        session.call(reader, cancelled=go_on)
    except BaseException:
        with contextlib.suppress(TippathError):
            session.send(*reader.farewell())
            if way == BY_MESSAGES:
                end_logs(session)
        raise


def _reader(log: VehicleLog, way: str, store: Callable[[bytes], None], start: int, stop: int) -> Reader:
    if way == BY_FTP and log.path is not None:
        return ReadFile(log.path, store, start=start, stop=stop)
    if way == BY_MESSAGES and log.id is not None:
        return ReadLog(log.id, store, start=start, stop=stop)
    raise ProcedureError(f"log {log.number} cannot be had by {NAMES.get(way, way)}")


def end_logs(session: Connection) -> None:
    """Have the vehicle send nothing more of its logs, as far as it hears."""
    with contextlib.suppress(TippathError):
        session.call(EndLogs(), 3.0)


def checksum_on_board(session: Connection, log: VehicleLog, watch: Callable[[], None] = lambda: None) -> int | None:
    """The CRC32 that the vehicle counts of a log, None where it does not tell."""
    if log.path is None:
        return None

    def go_on() -> bool:
        watch()
        return False

    with contextlib.suppress(ProcedureError):
        return session.call(FileChecksum(log.path), cancelled=go_on)
    return None
