"""The file that a fetched log grows into: `X.BIN.part`, whole from its first byte on, and `X.BIN` when it is complete.

Only bytes in order are written, so whatever cuts it leaves a beginning of the log, from whose length it goes on. What
came is handed to the disk once a second.
"""

from __future__ import annotations

import contextlib
import os
from collections.abc import Callable
from pathlib import Path
from types import TracebackType
from typing import Self

from gcs.errors import TippathError
from gcs.link.ftp import checksum

SYNC_S = 1.0
_BITE = 1 << 20


class PartFile:
    """Opened for going on; a context manager that leaves on disk all that came. OSError becomes TippathError."""

    def __init__(self, target: Path, clock: Callable[[], float]) -> None:
        """Raises TippathError where the file cannot be made."""
        self.target = target
        self.path = part_of(target)
        self._clock = clock
        try:
            self._stream = self.path.open("ab", buffering=0)
            self.resumed_from = self.size = self._stream.tell()
        except OSError as error:
            raise self._refusal(error) from error
        self._began = clock()
        self._sync_at = self._began + SYNC_S

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        with contextlib.suppress(OSError, ValueError):  # closed already
            os.fsync(self._stream.fileno())
        self._stream.close()
        if self.size == 0:
            self.path.unlink(missing_ok=True)

    @property
    def seconds(self) -> float:
        """Since it was opened."""
        return self._clock() - self._began

    def append(self, data: bytes) -> None:
        """The next bytes. Raises TippathError where the disk does not take them; what it took stays and counts."""
        rest = memoryview(data)
        try:
            while rest:
                taken = self._stream.write(rest) or 0
                self.size += taken
                rest = rest[taken:]
            if self._clock() >= self._sync_at:
                self._sync_at = self._clock() + SYNC_S
                os.fsync(self._stream.fileno())
        except OSError as error:
            raise self._refusal(error) from error

    def checksum(self) -> int:
        """As the vehicle counts it."""
        return checksum_of(self.path)

    def finish(self) -> None:
        """Give it its name. Raises TippathError where that is taken meanwhile, or the disk does not do it."""
        try:
            os.fsync(self._stream.fileno())
            self._stream.close()
            if self.target.exists():
                raise FileExistsError(None, "a file of that name has come meanwhile")
            self.path.rename(self.target)
        except OSError as error:
            raise self._refusal(error) from error

    def _refusal(self, error: OSError) -> TippathError:
        why = error.strerror or str(error)
        return TippathError(
            f"{self.path} cannot be written ({why}); what came is kept there: make room, or mend it, and give the same "
            "command again to go on"
        )


def part_of(target: Path) -> Path:
    """Where a log grows that is to become `target`."""
    return target.with_name(f"{target.name}.part")


def checksum_of(path: Path) -> int:
    """The CRC32 of a file as autopilots count it. Raises TippathError where it cannot be read."""
    crc = 0
    try:
        with path.open("rb") as stream:
            while bite := stream.read(_BITE):
                crc = checksum(bite, crc)
    except OSError as error:
        raise TippathError(f"{path} cannot be read ({error.strerror or error})") from error
    return crc


def piece_of(path: Path, start: int, stop: int) -> bytes:
    """Some bytes of a file. Raises TippathError where it cannot be read."""
    try:
        with path.open("rb") as stream:
            stream.seek(start)
            return stream.read(stop - start)
    except OSError as error:
        raise TippathError(f"{path} cannot be read ({error.strerror or error})") from error
