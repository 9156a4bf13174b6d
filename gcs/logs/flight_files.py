"""Which files of a flight's folder are logs of the flight: what was streamed, and what was fetched afterwards."""

from __future__ import annotations

import os
import re
from collections.abc import Collection, Iterable, Sequence
from pathlib import Path

BELOW = 3  # levels of folders that are looked through for logs which are left out
_FETCHED = re.compile(r"fetched-(\d+)(-\d+)?(\.run-\d+-only|\.runs-only)?(-\d+)?\.BIN")


def is_streamed(path: Path) -> bool:
    """Whether a file is named as those that a flight's log was streamed into."""
    return path.stem.lower().startswith("flight") and path.suffix.lower() == ".bin" and path.is_file()


def fetched(logs: Sequence[Path]) -> list[Path]:
    """Those that `tippath fetch` brought, each run once: a whole log holds them all, `runs-only` all of one flight."""
    came = [path for path in logs if path.name.startswith("fetched-") and path.suffix == ".BIN"]
    whole = [path for path in came if "-only" not in path.name]
    return whole or [path for path in came if ".runs-only" in path.name] or came


def beside(log: Path) -> tuple[Path, ...]:
    """What was fetched into the folder of a streamed log: of each of the vehicle's logs what holds most."""
    by_number: dict[str, list[Path]] = {}
    for path in _files(log.parent):
        match = _FETCHED.fullmatch(path.name)
        if match is not None:
            by_number.setdefault(match[1], []).append(path)
    return tuple(path for _, paths in sorted(by_number.items()) for path in sorted(fetched(paths)))


def streamed_after(log: Path) -> tuple[Path, ...]:
    """The streamed logs of a folder that come behind this one: where the vehicle began anew."""
    every = sorted((path for path in _files(log.parent) if is_streamed(path)), key=lambda path: (len(path.name), path))
    return tuple(every[every.index(log) + 1 :]) if log in every else ()


def hidden_by(log: Path, suffixes: Collection[str]) -> list[Path]:
    """The logs in the folder of a streamed log, and below it, that are none of this flight's and so are not listed."""
    files: list[Path] = []
    for at, below, names in os.walk(log.parent):
        deep = len(Path(at).relative_to(log.parent).parts) >= BELOW
        below[:] = [] if deep else [name for name in below if not name.startswith(".")]
        files += [Path(at) / name for name in names if not name.startswith(".")]
    ours = {path.stem.lower() for path in files if is_streamed(path)}
    return sorted(
        path
        for path in files
        if path.suffix.lower() in suffixes
        and not (path.parent == log.parent and (path.stem.lower() in ours or _FETCHED.fullmatch(path.name)))
    )


def of_flight(folder: Path, log: Path) -> tuple[Path, ...]:
    """The logs in a flight's folder that another log, as one off the vehicle's card, may be of one flight with."""
    if folder.resolve() == log.parent.resolve():
        return ()
    streamed = sorted(path for path in _files(folder) if is_streamed(path))
    return (*streamed, *beside(folder / log.name))


def _files(folder: Path) -> Iterable[Path]:
    try:
        return [path for path in folder.iterdir() if path.suffix.lower() == ".bin" and path.is_file()]
    except OSError:
        return []
