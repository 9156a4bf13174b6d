"""The state that the screens show, replaced whole under one lock by whoever has news."""

from __future__ import annotations

import contextlib
import threading
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

from gcs.errors import TippathError
from gcs.tui.state import Mark, RunView, State


class Moment:
    """The newest `State`. `pressed` is told when a key wished something; its lock guards every change."""

    def __init__(self, state: State) -> None:
        self.lock = threading.RLock()
        self.pressed = threading.Condition(self.lock)
        self.now = state

    def set(self, **changes: Any) -> None:
        """Change fields of the state. What is said is the worker's own word unless `said_by_desk` is given."""
        if "said" in changes:
            changes.setdefault("said_by_desk", False)
        with self.lock:
            self.now = replace(self.now, **changes)

    def mark(self, number: int, mark: Mark, why: tuple[str, ...] | None = None) -> None:
        """What became of a run, and why where that is news."""

        def marked(run: RunView) -> RunView:
            if run.number != number:
                return run
            return replace(run, mark=mark, why=run.why if why is None else why)

        with self.lock:
            self.set(runs=tuple(map(marked, self.now.runs)))

    def did(self, command: str) -> None:
        """Append what a shell would do."""
        with self.lock:
            self.set(commands=(*self.now.commands, command))

    @contextlib.contextmanager
    def working(self, what: str) -> Iterator[None]:
        """One thing at a time. Raises TippathError while something else is worked on."""
        with self.lock:
            if self.now.busy:
                raise TippathError(f"wait: {self.now.busy}")
            self.set(busy=what)
        try:
            yield
        finally:
            self.set(busy="")
