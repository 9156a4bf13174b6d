"""One program at a time flies into a flight's folder, whatever happens to it: the lock goes with the process."""

from __future__ import annotations

import contextlib
import errno
import sys
from collections.abc import Iterator
from io import FileIO

from gcs.errors import TippathError
from gcs.flight.folder import FlightFolder

HELD = (errno.EAGAIN, errno.EACCES, errno.EDEADLK)
"""How systems say that somebody else has it."""

if sys.platform == "win32":
    import msvcrt

    FAR = 1 << 30
    """Behind every card: Windows lets nobody read what is locked."""

    def _lock(stream: FileIO) -> None:
        stream.seek(FAR)
        msvcrt.locking(stream.fileno(), msvcrt.LK_NBLCK, 1)
else:
    import fcntl

    def _lock(stream: FileIO) -> None:
        fcntl.flock(stream, fcntl.LOCK_EX | fcntl.LOCK_NB)


@contextlib.contextmanager
def alone(folder: FlightFolder) -> Iterator[None]:
    """Hold the folder, by its card, which is written once and never replaced. Raises TippathError where another program
    holds it, or it cannot be written to."""
    try:
        stream = FileIO(folder.card, "r+")
    except OSError as error:
        raise TippathError(f"{folder.card} cannot be opened ({error.strerror or error})") from error
    with stream:
        try:
            _lock(stream)
        except OSError as error:
            if error.errno in HELD:  # else this disk knows no locks, which is no reason not to fly
                raise TippathError(
                    f"{folder.path} is being flown into by a tippath that still runs: end that one first"
                ) from error
        yield
