"""What an outcome depends on, in digests: the log with the files read beside it, the settings, this program's code."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterator
from functools import cache
from importlib import resources
from importlib.metadata import version
from importlib.resources.abc import Traversable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from gcs.flight.folder import flight_of
from gcs.logs.cache import digest_of
from gcs.logs.flight_files import beside, is_streamed
from sysid.data.record import FloatArray

WINDOW = 8
"""Samples that are taken together: so many of a moving gyro are equal in two flights only if these are one."""
MOVING = 6
"""Of their steps that are not zero: a gyro at rest says the same in all flights."""
SKETCH = 64
"""Hashes that are kept of a flight, the smallest: of a piece that holds a share of it, that share of them are equal."""
SAME = 4
"""Equal hashes from which on two logs are of one flight: a piece of a tenth of it has 6."""
_CODE = (*(("gcs", room) for room in ("analysis", "logs", "vehicle")), ("sysid", "data"), ("sysid", "model"))
_MORE_CODE = (
    ("sysid", "fit"),
    ("sysid", "effects"),
    ("sysid", "diagnose"),
    ("sysid", "compare"),
    ("sysid", "response"),
)
_FILES = (("gcs", "campaign", "work.py"), ("gcs", "campaign", "identity.py"), ("gcs", "campaign", "when.py"))


def contents(path: Path, digest: Callable[[Path], str] = digest_of) -> str:
    """SHA-256 of a log, or of all files that are read with it: what was fetched of its flight, its flight.json.

    Raises OSError where the log cannot be read.
    """
    files = [path, *(beside(path) if is_streamed(path) else ())]
    about = flight_of(path).about
    if about.is_file():
        files.append(about)
    each = [digest(file) for file in files]
    return each[0] if len(each) == 1 else hashlib.sha256("".join(each).encode()).hexdigest()


@cache
def program() -> str:
    """This program's version, and a digest of its code that outcomes depend on: `0.1.0+1c9f...`."""
    digest = hashlib.sha256()
    for place in (*_CODE, *_MORE_CODE, *_FILES):
        at = resources.files(place[0]).joinpath(*place[1:])
        for name, body in _code(at):
            digest.update(name.encode() + b"\0" + body)
    return f"{version('tippath')}+{digest.hexdigest()[:12]}"


def _code(at: Traversable) -> Iterator[tuple[str, bytes]]:
    if at.is_file():
        if at.name.endswith((".py", ".toml")):
            yield at.name, at.read_bytes()
        return
    for one in sorted(at.iterdir(), key=lambda one: one.name):
        yield from _code(one)


def sketch(series: list[FloatArray]) -> tuple[int, ...]:
    """The smallest hashes of what a gyro saw (MinHash), rad/s: of flights that share samples, some are equal.

    However a copy was cut, stored or thinned by gaps, as long as its values are the same to 1e-5 rad/s.
    """
    found = [_hashes(np.round(one * 1e5).astype(np.int64)) for one in series]
    return tuple(int(one) for one in np.unique(np.concatenate(found))[:SKETCH]) if found else ()


def _hashes(values: NDArray[np.int64]) -> NDArray[np.uint64]:
    """Of every window in which something moves, below 2^53: JSON's numbers."""
    count = len(values) - WINDOW + 1
    if count < 1:
        return np.empty(0, np.uint64)
    moving = np.convolve(np.diff(values) != 0, np.ones(WINDOW - 1), "valid") >= MOVING
    mixed = np.zeros(count, np.uint64)
    for place in range(WINDOW):
        mixed = _mix(mixed ^ values[place : place + count].view(np.uint64))
    return mixed[moving] >> np.uint64(11)


def _mix(x: NDArray[np.uint64]) -> NDArray[np.uint64]:
    """Splitmix64's."""
    x = x + np.uint64(0x9E3779B97F4A7C15)
    x = (x ^ (x >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    x = (x ^ (x >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return x ^ (x >> np.uint64(31))
