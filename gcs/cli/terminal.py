"""The one place where text leaves for standard output and error: what a terminal would obey is `?` there.

Text of vehicles, logs and documents is made harmless by whoever reads it, too; this holds for whatever was forgotten.
Codes of our own, which redraw a line, go through `control`.
"""

from __future__ import annotations

import contextlib
import sys
from collections.abc import Iterable, Iterator
from typing import Any, Final, TextIO, cast

from gcs.logs.words import harmless

REDRAW: Final = "\r\x1b[K"
"""To the beginning of the line, and nothing behind."""
BELL: Final = "\a"


class _Harmless:
    """A stream through which only harmless text comes; all else as the stream beneath."""

    def __init__(self, beneath: TextIO) -> None:
        self.beneath = beneath

    def write(self, text: str) -> int:
        self.beneath.write(harmless(text))
        return len(text)

    def writelines(self, lines: Iterable[str]) -> None:
        for line in lines:
            self.write(line)

    def __getattr__(self, name: str) -> Any:
        return getattr(self.beneath, name)


@contextlib.contextmanager
def harmless_streams() -> Iterator[None]:
    """While it is open standard output and error are harmless; one that is closed stays so."""
    before = sys.stdout, sys.stderr
    sys.stdout, sys.stderr = (None if one is None else cast(TextIO, _Harmless(one)) for one in before)
    try:
        yield
    finally:
        sys.stdout, sys.stderr = before


def control(stream: TextIO, code: str) -> None:
    """Write a code of our own, unchanged."""
    (stream.beneath if isinstance(stream, _Harmless) else stream).write(code)
