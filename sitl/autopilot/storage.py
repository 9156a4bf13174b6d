"""The logs on board as the ground may ask for them: numbered, of a size, read at any byte, one of them still growing.

On the simulated vehicle's disk log N is `vehicle-N.BIN`; towards the ground it is ArduPilot's `logs/0000000N.BIN`.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

BY_MESSAGES, BY_FTP = "log", "ftp"
WAYS = (BY_MESSAGES, BY_FTP)
DEFAULT_BYTES_PER_S = 250_000
"""Between ArduPilot's MAVFTP (44 kB/s) and its LOG_DATA over TCP (5 MB/s), of which Python sends a tenth."""


@dataclass(frozen=True, slots=True)
class StoredLog:
    """One log."""

    number: int
    path: Path
    size: int
    """Bytes, at this moment."""
    written_s: int
    """When it was written last, seconds since 1970."""


@dataclass(frozen=True, slots=True)
class LogStorage:
    """The folder of a vehicle's logs, and how it is given away."""

    directory: Path | None
    """None keeps no logs."""
    ways: tuple[str, ...] = WAYS
    """`log` for LOG_REQUEST_DATA, `ftp` for MAVFTP."""
    bytes_per_s: float = DEFAULT_BYTES_PER_S
    """That a download takes of the link, so that telemetry lives beside it."""

    def offers(self, way: str) -> bool:
        return self.directory is not None and way in self.ways

    def logs(self) -> list[StoredLog]:
        """By number, the oldest first."""
        paths = [] if self.directory is None else self.directory.glob("vehicle-*.BIN")
        found = [log for path in paths if (log := _stored(path)) is not None]
        return sorted(found, key=lambda log: log.number)


def _stored(path: Path) -> StoredLog | None:
    number = path.stem.removeprefix("vehicle-")
    if not (number.isascii() and number.isdigit()):
        return None
    try:
        about = path.stat()
    except OSError:  # gone since it was listed
        return None
    return StoredLog(int(number), path, about.st_size, int(about.st_mtime))


def read(path: Path, offset: int, size: int) -> bytes | None:
    """Up to `size` bytes from `offset`, fewer at the end; None where the file cannot be read."""
    try:
        with path.open("rb") as stream:
            stream.seek(offset)
            return stream.read(size)
    except OSError:
        return None


class Allowance:
    """So many bytes a second; what was not used is not saved up for more than a moment."""

    MOMENT_S = 0.05

    def __init__(self, bytes_per_s: float) -> None:
        self._bytes_per_s = bytes_per_s
        self._bytes = 0.0
        self._at_s = 0.0

    def grow(self, now_s: float) -> None:
        most = max(300.0, self._bytes_per_s * self.MOMENT_S)
        self._bytes = min(most, self._bytes + self._bytes_per_s * max(0.0, now_s - self._at_s))
        self._at_s = now_s

    def take(self, size: int) -> bool:
        """Whether so many may go out now; they count as gone then."""
        if self._bytes <= 0:
            return False
        self._bytes -= size
        return True
