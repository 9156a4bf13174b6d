"""Results written into the flight's folder, in order; what it does not take waits to be kept in another one."""

from __future__ import annotations

import json
import threading
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import Any

from gcs.errors import TippathError
from gcs.flight.folder import FlightFolder, keep_text

Write = Callable[[FlightFolder], None]
"""Raises TippathError where the folder does not take it."""


@dataclass(frozen=True)
class _Result:
    """Something to be written."""

    what: str
    """In words; empty where nobody need know that it waits."""
    write: Write


@dataclass(frozen=True, kw_only=True)
class ToKeep:
    """A file that a command would write, and what the flight's audit says of it. All are called when it is written."""

    what: str
    """`a comparison`, in words."""
    name: Callable[[], str]
    text: Callable[[Path], str]
    """Of the folder it will stand in."""
    command: Callable[[Path], str]
    """That writes the same, of the place where it stands."""
    did: str
    """For the audit."""


class Keeping:
    """`lock` is held while results are written, so that they come in order."""

    def __init__(
        self,
        now: Callable[[], datetime],
        on_command: Callable[[str], None],
        on_kept: Callable[[tuple[str, ...], str], None],
    ) -> None:
        """`on_kept` hears what is not kept yet, and why; nothing where all is."""
        self._now = now
        self._on_command = on_command
        self._on_kept = on_kept
        self.lock = threading.RLock()
        self._folder: FlightFolder | None = None
        self._pending: list[_Result] = []

    @property
    def begun(self) -> bool:
        """Whether a flight is open."""
        return self._folder is not None

    def begin(self, folder: FlightFolder) -> None:
        """With another flight; what waited is forgotten."""
        self._folder, self._pending = folder, []

    def folder(self) -> FlightFolder:
        """Where results go. Raises TippathError where no flight is open."""
        if self._folder is None:
            raise TippathError("no flight yet: fly a card, or open a flight folder or a log")
        return self._folder

    def move(self, folder: FlightFolder) -> None:
        """Into another folder from now on, what waits first."""
        self._folder = folder
        self._flush()

    def keep(self, what: str, write: Write) -> None:
        """Write something now, or when a folder takes it."""
        with self.lock:
            self._pending.append(_Result(what, write))
            self._flush()

    def keep_file(self, file: ToKeep) -> None:
        """Write a file, and tell the audit."""

        def write(folder: FlightFolder) -> None:
            path = keep_text(file.text(folder.path), folder.path / file.name())
            command = file.command(path)
            self._on_command(command)
            self.audit(file.did, command)

        self.keep(file.what, write)

    def audit(self, did: str, command: str | None = None) -> None:
        """Tell the audit what was done; it waits in silence where the folder does not take it."""
        time = self._now()

        def write(folder: FlightFolder) -> None:
            folder.audit(time, did, command, by="app")

        with self.lock:
            folder = self.folder()
            try:
                write(folder)
            except TippathError:
                self._pending.append(_Result("", write))

    def _flush(self) -> None:
        folder = self.folder()
        left, problem = [], ""
        for one in self._pending:
            try:
                one.write(folder)
            except TippathError as error:
                left.append(one)
                problem = problem or str(error)
        self._pending = left
        self._on_kept(tuple(dict.fromkeys(one.what for one in left if one.what)), problem)


def document_text(document: Mapping[str, Any]) -> str:
    """As commands write and print it."""
    return json.dumps(document, indent=1, allow_nan=False) + "\n"
