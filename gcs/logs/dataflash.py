"""ArduPilot's DataFlash `.BIN`: a chain of self-describing messages, read with numpy.

A log is a chain: two header bytes, one id byte, and a length that the FMT messages give per id. The reader lists every
place where header bytes stand, computes for all of them at once where each message would end, and follows the chain
from one to the next. Where every end meets the next header nothing needs to be walked; Python looks only at the places
where it does not: header bytes inside a payload (skipped, the chain leads over them) and damage.

After damage the chain is taken up at the next header whose own end meets a header. A message whose end meets none is
dropped: it may have been cut and continued with bytes of another, and a sample is never invented. There are no
checksums in this format, so a flipped bit inside a payload cannot be seen here; `gcs.logs.tables` throws out the time
stamps that cannot be.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gcs.errors import TippathError
from gcs.logs.damage import Damage
from gcs.logs.words import printable

Bytes = NDArray[np.uint8]
Offsets = NDArray[np.int64]

HEAD = (0xA3, 0x95)
FMT_ID = 0x80
FMT_LENGTH = 89
CHUNK = 1 << 20  # header bytes are looked for in pieces that stay in the processor's cache
MOST_DEFINITIONS = 4096  # of FMT messages that differ; a real log has some 200

TYPES: Mapping[str, tuple[str, float | None]] = MappingProxyType(
    {
        "a": ("(32,)<i2", None),
        "b": ("<i1", None),
        "B": ("<u1", None),
        "g": ("<f2", None),
        "h": ("<i2", None),
        "H": ("<u2", None),
        "i": ("<i4", None),
        "I": ("<u4", None),
        "f": ("<f4", None),
        "d": ("<f8", None),
        "n": ("S4", None),
        "N": ("S16", None),
        "Z": ("S64", None),
        "c": ("<i2", 100.0),
        "C": ("<u2", 100.0),
        "e": ("<i4", 100.0),
        "E": ("<u4", 100.0),
        "L": ("<i4", 1e7),
        "M": ("<u1", None),
        "q": ("<i8", None),
        "Q": ("<u8", None),
    }
)
"""Format letter -> numpy type and what the stored integer is divided by."""

_NAME = re.compile(r"[A-Za-z0-9_]{1,4}")
_COLUMNS = re.compile(r"[A-Za-z0-9_]+(,[A-Za-z0-9_]+)*|")


@dataclass(frozen=True)
class Format:
    """What an FMT message says about one message type."""

    id: int
    name: str
    length: int
    """Bytes of a whole message, its header of three included."""
    types: str
    """One letter of `TYPES` for each field."""
    columns: tuple[str, ...]

    @property
    def dtype(self) -> np.dtype[Any]:
        """The payload's structure, packed, without the header."""
        return np.dtype([(c, TYPES[letter][0]) for c, letter in zip(self.columns, self.types, strict=False)])

    def divisor(self, column: str) -> float | None:
        """What the stored integers of `column` are divided by; None where they are the value."""
        return TYPES[self.types[self.columns.index(column)]][1]

    def offset(self, column: str) -> int:
        """First byte of `column` from the start of the message."""
        before = self.types[: self.columns.index(column)]
        return 3 + sum(np.dtype(TYPES[letter][0]).itemsize for letter in before)


@dataclass(frozen=True, eq=False)
class DataFlashLog:
    """A log whose messages have been located; columns are gathered when asked for."""

    data: Bytes
    """The whole file, shape (bytes,)."""
    formats: Mapping[str, Format]
    """By message name, those that occur or are declared."""
    damage: Damage
    _starts: Offsets
    _ids: NDArray[np.uint8]

    @property
    def names(self) -> tuple[str, ...]:
        """Message types that occur at least once, alphabetically."""
        present = {int(id) for id in np.flatnonzero(np.bincount(self._ids, minlength=256))}
        return tuple(sorted(name for name, fmt in self.formats.items() if fmt.id in present))

    def starts(self, message: str) -> Offsets:
        """First byte of every message of this type, in the file's order, shape (n,); empty where there is none."""
        if message not in self.formats:
            return np.empty(0, np.int64)
        starts: Offsets = self._starts[self._ids == self.formats[message].id]
        return starts

    def count(self, message: str) -> int:
        return int(self.starts(message).size)

    def column(self, message: str, column: str, starts: Offsets | None = None) -> NDArray[Any]:
        """One field of every message of a type, in the file's order.

        Numbers keep their stored type, except the scaled ones (letters c, C, e, E, L), which are divided into float64.
        Strings are bytes. Shape (n,), (n, 32) for letter a. `starts` limits it to some of the messages.
        Raises KeyError where the log declares no such message or field.
        """
        fmt = self.formats[message]
        if column not in fmt.columns:
            raise KeyError(f"{message}.{column}")
        stored = np.dtype(TYPES[fmt.types[fmt.columns.index(column)]][0])
        offset = fmt.offset(column)
        at = self.starts(message) if starts is None else starts
        if at.size == 0:
            values = np.empty((0, *stored.shape), stored.base)
        else:
            # every byte as a possible first byte of the field: the gather then copies the field alone
            count = self.data.size - offset - stored.itemsize + 1
            everywhere = np.ndarray((count,), f"V{stored.itemsize}", self.data, offset, (1,))
            values = everywhere[at].view(stored.base).reshape(at.size, *stored.shape)
        divisor = fmt.divisor(column)
        return values if divisor is None else values / divisor

    def texts(self, message: str, column: str) -> list[str]:
        """A string field up to its first zero byte, with what is not printable replaced."""
        return [printable(bytes(raw)) for raw in self.column(message, column)]

    def table(self, message: str, columns: Sequence[str] | None = None) -> dict[str, NDArray[Any]]:
        """Several columns of one message type; all of them where none is named."""
        at = self.starts(message)
        chosen = self.formats[message].columns if columns is None else columns
        return {name: self.column(message, name, at) for name in chosen}


def read(path: Path) -> DataFlashLog:
    """Read a `.BIN` file. Raises TippathError where it cannot be opened or is no DataFlash log."""
    try:
        data = np.fromfile(path, np.uint8)
    except OSError as error:
        raise TippathError(f"{path}: cannot be read ({error.strerror or error})") from error
    return parse(data, str(path))


def parse(data: Bytes, name: str = "log") -> DataFlashLog:
    """Locate the messages in the bytes of a log, shape (bytes,).

    Raises TippathError where there is not one message format in it; any other damage is counted, not raised.
    """
    if data.size == 0:
        raise TippathError(f"{name}: the file is empty; fetch it from the vehicle again")
    at = _headers(data)
    ids = data[at + 2]
    definitions = _definitions(data, at[ids == FMT_ID])
    if not definitions:
        raise TippathError(
            f"{name}: not a DataFlash log: no message format (FMT) was found in its {data.size:,} bytes; "
            "check that it is the .BIN from the vehicle and not an empty or converted file"
        )
    formats = _settle(definitions, at, ids)
    lengths = np.zeros(256, np.int64)
    for fmt in formats.values():
        lengths[fmt.id] = fmt.length
    chosen, damage = _chain(data, at, ids, lengths)
    starts = at[chosen]
    kept = data[starts + 2]
    return DataFlashLog(data, _by_name(formats, kept), damage, starts, kept)


def _headers(data: Bytes) -> Offsets:
    """Every place where the two header bytes and an id byte stand, ascending."""
    last = data.size - 2  # room for the id
    found = [np.empty(0, np.int64)]
    for start in range(0, last, CHUNK):
        stop = min(start + CHUNK, last)
        here = data[start:stop] == HEAD[0]
        here &= data[start + 1 : stop + 1] == HEAD[1]
        found.append(np.flatnonzero(here) + start)
    return np.concatenate(found)


def _definitions(data: Bytes, at: Offsets) -> dict[Format, int]:
    """Formats that make sense, with how often each was declared.

    They are looked for everywhere, not along the chain, which cannot be followed before they are known.
    """
    at = at[at + FMT_LENGTH <= data.size]
    first = data[at + 5] | 0x20  # a name begins with a letter (in lower case here), a digit or _
    at = at[((first >= ord("a")) & (first <= ord("z"))) | ((first >= ord("0")) & (first <= ord("9"))) | (first == 0x7F)]
    if at.size == 0:
        return {}
    bodies = data[at[:, None] + np.arange(3, FMT_LENGTH)]
    distinct, places, counts = np.unique(bodies, axis=0, return_index=True, return_counts=True)
    found: dict[Format, int] = {}
    for row in np.argsort(places)[:MOST_DEFINITIONS]:
        fmt = _definition(distinct[row].tobytes())
        if fmt is not None:
            found[fmt] = found.get(fmt, 0) + int(counts[row])
    return found


def _definition(body: bytes) -> Format | None:
    id, length = body[0], body[1]
    name, types, columns = (part.split(b"\0", 1)[0].decode("latin-1") for part in (body[2:6], body[6:22], body[22:86]))
    if not _NAME.fullmatch(name) or not _COLUMNS.fullmatch(columns) or any(letter not in TYPES for letter in types):
        return None
    if length != 3 + sum(np.dtype(TYPES[letter][0]).itemsize for letter in types):
        return None
    names = tuple(columns.split(","))[: len(types)] if columns else ()
    if len(set(names)) != len(names):
        return None
    return Format(id, name, length, types, names)


def _settle(definitions: Mapping[Format, int], at: Offsets, ids: NDArray[np.uint8]) -> dict[int, Format]:
    """One format for each id. Where a damaged FMT claims an id twice, the one by which more messages meet a header."""
    by_id: dict[int, list[Format]] = {}
    for fmt in definitions:
        by_id.setdefault(fmt.id, []).append(fmt)
    settled = {}
    for id, claims in by_id.items():
        if len(claims) > 1:
            places = at[ids == id]

            def evidence(fmt: Format, places: Offsets = places) -> tuple[int, int, int]:
                ends = places + fmt.length
                where = np.minimum(np.searchsorted(at, ends), at.size - 1)
                return int(np.count_nonzero(at[where] == ends)), definitions[fmt], len(fmt.columns)

            claims = [max(claims, key=evidence)]
        settled[id] = claims[0]
    return settled


def _chain(data: Bytes, at: Offsets, ids: NDArray[np.uint8], lengths: Offsets) -> tuple[NDArray[np.bool_], Damage]:
    """Which of the header places are messages, and what lies between them."""
    count, end_of_file = at.size, data.size
    length = lengths[ids]
    ends = at + length
    known = length > 0
    regular = np.zeros(count, np.bool_)  # ends where the next place stands: nothing to look at
    regular[:-1] = known[:-1] & (ends[:-1] == at[1:])
    linked = regular.copy()  # ends at some header, or with the file
    onward = np.full(count, -1, np.int64)
    others = np.flatnonzero(~regular & known)
    if others.size:
        where = np.searchsorted(at, ends[others])
        meets = at[np.minimum(where, count - 1)] == ends[others]
        linked[others] = meets
        onward[others[meets]] = where[meets]
        for k in others[ends[others] >= end_of_file - 2]:  # too near the end for a whole header
            rest = data[ends[k] :].tolist() if ends[k] <= end_of_file else None
            linked[k] |= rest is not None and rest == list(HEAD[: len(rest)])
    irregular = np.flatnonzero(~regular)
    entries = np.flatnonzero(linked)

    starts: list[int] = []
    stops: list[int] = []
    unknown: dict[int, int] = {}
    resyncs = 0

    def entry(after: int) -> int:
        place = int(np.searchsorted(entries, after))
        return int(entries[place]) if place < entries.size else count

    here = entry(0)
    if here < count and at[here] > 0:
        resyncs += 1
    while here < count:
        odd = int(irregular[np.searchsorted(irregular, here)])  # the last place is always irregular
        starts.append(here)
        if linked[odd]:
            stops.append(odd + 1)
            here = int(onward[odd]) if onward[odd] >= 0 else count
            continue
        stops.append(odd)
        if not known[odd]:
            id = int(ids[odd])
            unknown[id] = unknown.get(id, 0) + 1
        here = entry(odd + 1)
        resyncs += here < count

    steps = np.zeros(count + 1, np.int64)
    np.add.at(steps, np.asarray(starts, np.int64), 1)
    np.add.at(steps, np.asarray(stops, np.int64), -1)
    chosen = np.cumsum(steps[:-1]) > 0
    kept = int(length[chosen].sum())
    last = int(ends[np.flatnonzero(chosen)[-1]]) if chosen.any() else 0
    return chosen, Damage(end_of_file, end_of_file - kept, resyncs, unknown, last < end_of_file)


def _by_name(formats: Mapping[int, Format], kept: NDArray[np.uint8]) -> dict[str, Format]:
    """Formats by name; where two ids carry one name, the one with more messages."""
    counts = np.bincount(kept, minlength=256)
    by_name: dict[str, Format] = {}
    for fmt in formats.values():
        other = by_name.get(fmt.name)
        if other is None or counts[fmt.id] > counts[other.id]:
            by_name[fmt.name] = fmt
    return by_name
