"""How far a long calculation, or the reading of many logs, has come, on a terminal's standard error."""

from __future__ import annotations

import sys
from typing import TextIO

from gcs.cli.terminal import REDRAW, control
from gcs.logs.reading import Progress
from gcs.logs.words import printable


class Counting:
    """A line on a terminal's standard error that says what is being worked on; nothing elsewhere."""

    def __init__(self, word: str, stream: TextIO | None = None) -> None:
        self._word = word
        self._stream = stream or sys.stderr
        self._count = 0

    def __enter__(self) -> Counting:
        return self

    def __call__(self, what: str) -> None:
        self._count += 1
        if self._stream.isatty():
            control(self._stream, REDRAW)
            self._stream.write(f" {self._word} {self._count}: {printable(what)[:60]}")
            self._stream.flush()

    def __exit__(self, *_: object) -> None:
        if self._stream.isatty():
            control(self._stream, REDRAW)
            self._stream.flush()


class Bar:
    """A bar with words behind it, drawn over itself on a terminal."""

    WIDTH = 24

    def __init__(self, stream: TextIO) -> None:
        self._stream = stream
        self._drawn = False

    def draw(self, share: float, words: str) -> None:
        """`share`: of 1."""
        bar = ("▓" * round(share * self.WIDTH)).ljust(self.WIDTH, "░")
        control(self._stream, REDRAW)
        self._stream.write(f" {bar} {words}")
        self._stream.flush()
        self._drawn = True

    def close(self) -> None:
        """Leave an empty line."""
        if self._drawn:
            control(self._stream, REDRAW)
            self._stream.flush()
            self._drawn = False


class ReadingBar:
    """A bar on a terminal's standard error while many logs are read; nothing elsewhere, nor for one log."""

    def __init__(self, stream: TextIO | None = None) -> None:
        self._stream = stream or sys.stderr
        self._bar = Bar(self._stream)

    def __enter__(self) -> ReadingBar:
        return self

    def __call__(self, progress: Progress) -> None:
        if progress.total < 2 or not self._stream.isatty():
            return
        share = progress.done_bytes / progress.total_bytes if progress.total_bytes else progress.done / progress.total
        self._bar.draw(
            share,
            f"{progress.done} of {progress.total} logs, {progress.done_bytes / 1e6:,.0f} of "
            f"{progress.total_bytes / 1e6:,.0f} MB   {printable(progress.path.name)[:30]}",
        )

    def __exit__(self, *_: object) -> None:
        self._bar.close()
