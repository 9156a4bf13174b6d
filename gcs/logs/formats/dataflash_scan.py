"""The bytes of a DataFlash `.BIN`, and every place where a message may begin, its format, and the formats declared.

A log is a chain: two header bytes, one id byte, and a length that the FMT messages give per id.
"""

from __future__ import annotations

import hashlib
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gcs.errors import TippathError
from gcs.logs.formats.raw import Bytes, unreadable

HEAD = (0xA3, 0x95)
FMT_ID = 0x80
FMT_LENGTH = 89
LONGEST = 255  # bytes of a message: its length is one byte
PIECE = 1 << 21  # bytes looked at in one go: they stay in the processor's cache
REACH = LONGEST + 3  # how far beyond a piece a message that begins in it may need to look
MOST_DEFINITIONS = 4096  # of FMT messages that differ; a real log has some 200
MOST_PLACES = 1 << 16  # where FMT messages stand
SAMPLED = 31  # of so many places one is asked for its time, to tell boots; a prime, as loops have other periods

CLOCKS: Mapping[str, float] = MappingProxyType({"TimeUS": 1e-6, "TimeMS": 1e-3})
"""Field that holds the time -> its unit in s, the likelier first."""
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


FMT = Format(FMT_ID, "FMT", FMT_LENGTH, "BBnNZ", ("Type", "Length", "Name", "Format", "Columns"))
"""Where its own FMT message is lost."""


class Source:
    """The bytes of a log, in memory or in a file, handed out in pieces."""

    def __init__(self, name: str, data: Bytes | None = None) -> None:
        self.name = name
        self._data = data
        try:
            self.size = Path(name).stat().st_size if data is None else int(data.size)
        except OSError as error:
            raise unreadable(self.name, error) from error

    def pieces(self) -> Iterator[tuple[int, Bytes]]:
        """Every `PIECE` bytes and the `REACH` after them, fewer at the end, with the first byte's place in the file.

        Each is overwritten by the next.
        Raises TippathError where the file cannot be read, or is shorter than it was.
        """
        if self._data is not None:
            for base in range(0, self.size, PIECE):
                yield base, self._data[base : base + PIECE + REACH]
            return
        buffer = np.empty(PIECE + REACH, np.uint8)
        filled, left = 0, self.size
        try:
            with open(self.name, "rb", buffering=0) as stream:
                for base in range(0, self.size, PIECE):
                    while left and filled < buffer.size:
                        got = stream.readinto(buffer[filled : filled + min(left, buffer.size - filled)].data)
                        if not got:
                            raise self.changed()
                        filled, left = filled + got, left - got
                    yield base, buffer[:filled]
                    filled = max(0, filled - PIECE)
                    buffer[:filled] = buffer[PIECE : PIECE + filled]
        except OSError as error:
            raise unreadable(self.name, error) from error

    def sha256(self) -> str:
        """Of all bytes, hexadecimal."""
        digest = hashlib.sha256()
        for _, data in self.pieces():
            digest.update(data[:PIECE].data)
        return digest.hexdigest()

    def part(self, start: int, stop: int) -> bytes:
        """A few bytes from anywhere, fewer where the file ends."""
        if self._data is not None:
            return self._data[start:stop].tobytes()
        try:
            with open(self.name, "rb") as stream:
                stream.seek(start)
                return stream.read(stop - start)
        except OSError as error:
            raise unreadable(self.name, error) from error

    def changed(self) -> TippathError:
        return TippathError(f"{self.name}: the file changed while it was read; wait until it is whole and try again")


@dataclass(frozen=True, eq=False, slots=True)
class Places:
    """Where header bytes stand in a piece of the file; from `chain` only those that are messages."""

    base: int
    """First byte of the piece."""
    at: NDArray[np.uint32]
    """First byte of each from `base`, ascending, shape (n,)."""
    kinds: NDArray[Any]
    """Its message id, from `chain` its number in `Parts.kinds`, shape (n,), uint8 or uint16."""
    stamps: NDArray[np.uint64]
    """The first eight bytes of the payload of every `SAMPLED`th, shape (ceil(n / SAMPLED),); none from `chain`."""

    def between(self, start: int, stop: int) -> Places:
        """Those that begin in a part of the file, without stamps."""
        first, last = np.searchsorted(self.at, np.clip([start - self.base, stop - self.base], 0, PIECE))
        return Places(self.base, self.at[first:last], self.kinds[first:last], self.stamps[:0])


def scan(source: Source) -> tuple[list[Places], list[tuple[int, Format]]]:
    """Every place where the two header bytes and an id byte stand, and the FMT messages among them.

    Those are looked for everywhere, not along the chain, which cannot be followed before they are known.
    """
    places: list[Places] = []
    definitions: list[tuple[int, Format]] = []
    known: dict[bytes, Format | None] = {}
    first, second = np.empty(PIECE, np.bool_), np.empty(PIECE, np.bool_)
    for base, data in source.pieces():
        n = max(0, min(PIECE, data.size - 2))
        np.equal(data[:n], HEAD[0], out=first[:n])
        np.equal(data[1 : n + 1], HEAD[1], out=second[:n])
        first[:n] &= second[:n]
        at = np.flatnonzero(first[:n])
        ids = data[2:][at]
        few = at[::SAMPLED] + 3
        few = np.minimum(few, data.size - 8)  # too near the end: such a place is no message with a time
        stamps = data[few[:, None] + np.arange(8)].view("<u8")[:, 0] if data.size >= 8 else np.zeros(few.size, "<u8")
        places.append(Places(base, at.astype(np.uint32), ids, stamps))
        for place in at[ids == FMT_ID].tolist():
            body = data[place + 3 : place + FMT_LENGTH].tobytes()
            if len(definitions) < MOST_PLACES and len(body) == FMT_LENGTH - 3:
                if body not in known and len(known) < MOST_DEFINITIONS:
                    known[body] = _definition(body)
                fmt = known.get(body)
                if fmt is not None:
                    definitions.append((base + place, fmt))
    return places, definitions


def _definition(body: bytes) -> Format | None:
    """What an FMT message says, where it makes sense."""
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
