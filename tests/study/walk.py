"""Through which rooms does a measured run go? Traced while a command of `tippath` works.

    python tests/study/walk.py diagnose FIT.json
    python tests/study/walk.py fit --model tpp flight.BIN -o FIT.json

A log that is in the cache is not read again: copy it, to see the rooms that read it. A room is reached where one of its
functions is handed something that holds the run (a log, a series, a record, bins); `called again` counts the times that
this happens after another room was reached, and not from within.
"""

from __future__ import annotations

import sys
from collections import Counter
from pathlib import Path
from types import FrameType

ROOT = Path(__file__).parents[2]
HOLDS_THE_RUN = frozenset(
    {
        "DataFlashLog",
        "Log",
        "Series",
        "Mapped",
        "Stretch",
        "Content",
        "Run",
        "Record",
        "Dataset",
        "Piece",
        "Stack",
        "Bins",
    }
)


class Walk:
    """The rooms that were reached, in their order."""

    def __init__(self) -> None:
        self.rooms: list[str] = []
        self.again: Counter[str] = Counter()
        self._stack: list[str | None] = []
        self._last = ""

    def __call__(self, frame: FrameType, event: str, _: object) -> None:
        """As `sys.setprofile` wants it."""
        if event == "call":
            room = _room(frame)
            if room is not None and _is_handed_the_run(frame):
                self._reach(room)
            self._stack.append(room)
        elif event == "return" and self._stack:
            self._stack.pop()

    def _reach(self, room: str) -> None:
        if room not in self.rooms:
            self.rooms.append(room)
        elif room != self._last and room not in self._stack:
            self.again[room] += 1
        self._last = room


def _room(frame: FrameType) -> str | None:
    path = Path(frame.f_code.co_filename)
    if not path.is_relative_to(ROOT):
        return None
    *folders, _ = path.relative_to(ROOT).parts
    return "/".join(folders) if folders and folders[0] in ("gcs", "sysid") else None


def _is_handed_the_run(frame: FrameType) -> bool:
    code = frame.f_code
    names = code.co_varnames[: code.co_argcount + code.co_kwonlyargcount]
    return not code.co_name.startswith("<") and any(_holds_the_run(frame.f_locals.get(name)) for name in names)


def _holds_the_run(value: object, depth: int = 0) -> bool:
    if isinstance(value, list | tuple) and value and depth < 2:
        return _holds_the_run(value[0], depth + 1)
    return type(value).__name__ in HOLDS_THE_RUN


def main(words: list[str]) -> None:
    """Run `tippath` with these words, and tell its walk on standard error."""
    import gcs.cli

    walk = Walk()
    sys.setprofile(walk)
    try:
        gcs.cli.main(words)
    finally:
        sys.setprofile(None)
        for number, room in enumerate(walk.rooms, start=1):
            times = walk.again[room]
            print(f"{number:3d}  {room}{f'  called again {times} times' if times else ''}", file=sys.stderr)


if __name__ == "__main__":
    sys.path.insert(0, str(ROOT))
    main(sys.argv[1:])
