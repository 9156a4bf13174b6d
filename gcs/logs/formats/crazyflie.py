"""Logs of the Crazyflie's uSD card deck, versions 1 and 2: usually a file without an ending, `log15`.

A header names the kinds of event and the variables of each with their types; then events of fixed lengths follow, each
with its kind and its time, and the file ends with a checksum of all before. Fields are `event.variable`, such as
`fixedFrequency.gyro.x`. An own reader: the firmware's (tools/usdlog/cfusdlog.py) is a script that stops at damage.
"""

from __future__ import annotations

import hashlib
import struct
import zlib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from gcs.errors import TippathError
from gcs.logs.formats.columns import Column, ColumnLog
from gcs.logs.formats.damage import Damage
from gcs.logs.formats.raw import gathered, unreadable
from gcs.logs.formats.tables import before_no_gap, increasing
from gcs.logs.words import printable

MARK = 0xBC
VERSIONS: Mapping[int, tuple[str, float]] = {1: ("<HI", 1e-3), 2: ("<HQ", 1e-6)}
"""Version -> what stands before the variables of an event (kind and time), and the time's unit in s."""
TYPES: Mapping[str, str] = {kind: kind for kind in "bBhHiIqQefd"} | {"?": "u1"}
CHECKSUM = 4  # bytes
MOST_KINDS, MOST_VARIABLES, LONGEST_NAME = 64, 512, 200
IN_A_ROW = 3
"""Events that must follow each other for a place in a damaged file to be believed."""
LARGEST_STEP_S = 10.0


@dataclass(frozen=True, eq=False)
class Kind:
    """A kind of event."""

    name: str
    variables: tuple[tuple[str, str], ...]
    """Name, and numpy's code of the type."""

    @property
    def size(self) -> int:
        """Bytes of the variables."""
        return sum(np.dtype(code).itemsize for _, code in self.variables)


@dataclass(frozen=True, eq=False, kw_only=True)
class CrazyflieFile:
    """A file as a log."""

    log: ColumnLog
    damage: Damage
    sha256: str
    notes: tuple[str, ...]


def recognises(head: bytes) -> bool:
    """By the mark, the version, and the name of the first event, which is text."""
    if len(head) < 8 or head[0] != MARK or int.from_bytes(head[1:3], "little") not in VERSIONS:
        return False
    name, end, _ = head[7:].partition(b"\0")
    return 0 < int.from_bytes(head[3:5], "little") <= MOST_KINDS and bool(name) and name.isascii() and bool(end)


def read(path: Path) -> CrazyflieFile:
    """Raises TippathError for what cannot be read at all."""
    try:
        data = path.read_bytes()
    except OSError as error:
        raise unreadable(path, error) from error
    try:
        kinds, head, unit_s, start = _header(data)
    except (ValueError, struct.error) as error:
        raise TippathError(
            f"{path}: the head of this uSD log cannot be read ({error}); copy it from the card again"
        ) from error
    whole = len(data) - CHECKSUM > start and zlib.crc32(data[:-CHECKSUM]) == int.from_bytes(data[-CHECKSUM:], "little")
    stop = len(data) - CHECKSUM if whole else len(data)
    places, skipped, breaks, tail = _chain(data, start, stop, kinds, struct.Struct(head), unit_s)
    log = _log(path, data, kinds, places, head, unit_s, broken=breaks > 0)
    if not log.sampled_s:
        raise TippathError(f"{path}: no samples behind the head of this uSD log; copy it from the card again")
    notes = () if whole else ("its checksum is missing or wrong: the log was not closed, or is damaged",)
    return CrazyflieFile(
        log=log,
        damage=Damage(len(data), skipped, breaks, {}, tail),
        sha256=hashlib.sha256(data).hexdigest(),
        notes=notes,
    )


def _header(data: bytes) -> tuple[dict[int, Kind], str, float, int]:
    """The kinds of event by number, what stands before each, the unit of time and where the first begins."""
    version, count = struct.unpack_from("<HH", data, 1)
    if version not in VERSIONS or not 0 < count <= MOST_KINDS:
        raise ValueError(f"version {version}, {count} kinds of event")
    head, unit_s = VERSIONS[version]
    at = 5
    kinds: dict[int, Kind] = {}
    for _ in range(count):
        (number,) = struct.unpack_from("<H", data, at)
        name, at = _text(data, at + 2)
        (how_many,) = struct.unpack_from("<H", data, at)
        if how_many > MOST_VARIABLES:
            raise ValueError(f"{how_many} variables")
        at += 2
        variables = []
        for _ in range(how_many):
            written, at = _text(data, at)
            variable, code = written[:-3], written[-2:-1]
            if written[-3:] != f"({code})" or code not in TYPES:
                raise ValueError(f"variable {printable(written[:40])!r}")
            variables.append((variable, f"<{TYPES[code]}"))
        kinds[number] = Kind(name, tuple(variables))
    return kinds, head, unit_s, at


def _text(data: bytes, at: int) -> tuple[str, int]:
    end = data.find(b"\0", at, at + LONGEST_NAME)
    if end < 0:
        raise ValueError("a name without an end")
    return data[at:end].decode("ascii"), end + 1


def _chain(
    data: bytes, start: int, stop: int, kinds: Mapping[int, Kind], head: struct.Struct, unit_s: float
) -> tuple[dict[int, list[int]], int, int, bool]:
    """Where the events of each kind begin; skipped bytes, breaks, and whether the end is cut.

    Events have no mark. One is believed where its kind is known and its time is near the last (kinds may wait for each
    other); where that fails, the next place is taken from which several in a row are so.
    """
    sizes = {number: head.size + kind.size for number, kind in kinds.items()}
    step = LARGEST_STEP_S / unit_s
    places: dict[int, list[int]] = {number: [] for number in kinds}
    at, last, skipped, breaks, lost = start, -1, 0, 0, False

    def follows(at: int, last: int, count: int) -> bool:
        """Whether so many events in a row can begin here, fewer at the end of the file."""
        for _ in range(count):
            if at + head.size > stop:
                return at == stop
            number, now = head.unpack_from(data, at)
            if number not in sizes or at + sizes[number] > stop or (last >= 0 and abs(now - last) > step):
                return False
            at, last = at + sizes[number], now
        return True

    while at + head.size <= stop:
        # behind a break the clock is asked again: the last time may have been damage
        if not follows(at, -1 if lost else last, IN_A_ROW if lost else 1):
            skipped, lost = skipped + 1, True
            at += 1
            continue
        breaks += lost
        lost = False
        number, last = head.unpack_from(data, at)
        places[number].append(at)
        at += sizes[number]
    return places, skipped + stop - at, breaks, lost or at < stop


def _log(
    path: Path,
    data: bytes,
    kinds: Mapping[int, Kind],
    places: Mapping[int, list[int]],
    head: str,
    unit_s: float,
    *,
    broken: bool,
) -> ColumnLog:
    raw = np.frombuffer(data, np.uint8)
    clocks, columns, dropped = {}, {}, {}
    for number, kind in kinds.items():
        starts = np.array(places[number], np.int64)
        if starts.size == 0:
            continue
        t = gathered(raw, 2, "<u4" if head == VERSIONS[1][0] else "<u8", starts).astype(np.float64) * unit_s
        in_order = increasing(t)
        keep = np.flatnonzero(in_order)
        keep = keep[before_no_gap(t[keep])] if broken else keep
        if not in_order.all():
            dropped[kind.name] = int(np.count_nonzero(~in_order))
        clocks[kind.name] = t[keep]
        offset = struct.calcsize(head)
        for variable, code in kind.variables:
            columns[f"{kind.name}.{variable}"] = Column(kind.name, gathered(raw, offset, code, starts[keep]))
            offset += np.dtype(code).itemsize
    return ColumnLog(path=str(path), kind="crazyflie", clocks=clocks, columns=columns, dropped=dropped)
