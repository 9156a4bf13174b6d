"""What was written reaches the disk itself, once a second: a block that was acknowledged does not go with the power.

In a thread of its own: a slow card keeps a caller waiting for a tenth of a second and more.
"""

from __future__ import annotations

import contextlib
import os
import threading
from io import FileIO

EVERY_S = 1.0


class Syncing:
    """Begins with the first file. `close` ends it; files are their owner's to close, before or after."""

    def __init__(self, every_s: float = EVERY_S) -> None:
        self._every_s = every_s
        self._lock = threading.Lock()
        self._written: dict[int, FileIO] = {}
        self._ending = threading.Event()
        self._thread: threading.Thread | None = None
        self.count = 0
        """How often a file was brought to the disk."""

    def written(self, stream: FileIO) -> None:
        """There is something new in it. Never waits for a disk."""
        with self._lock:
            self._written[id(stream)] = stream
        if self._thread is None:
            self._thread = threading.Thread(target=self._go_on, name="tippath sync", daemon=True)
            self._thread.start()

    def close(self) -> None:
        self._ending.set()
        if self._thread is not None:
            self._thread.join(5.0)

    def _go_on(self) -> None:
        while not self._ending.wait(self._every_s):
            with self._lock:
                streams, self._written = list(self._written.values()), {}
            for stream in streams:
                # It may have been closed since; a disk that fails here failed its writer, who tells it.
                with contextlib.suppress(OSError, ValueError):
                    os.fsync(stream.fileno())
                    self.count += 1


def sync_folder(path: os.PathLike[str]) -> None:
    """The names of new files in a folder, where the system can."""
    with contextlib.suppress(OSError):
        folder = os.open(path, os.O_RDONLY)
        try:
            os.fsync(folder)
        finally:
            os.close(folder)
