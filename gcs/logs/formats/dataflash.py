"""ArduPilot's DataFlash `.BIN`, read with numpy: which messages it has, and their fields as columns.

Where messages may stand is found by `gcs.logs.formats.dataflash_scan`, which of them do by `dataflash_chain`. There are
no checksums in this format, so a flipped bit inside a payload cannot be seen; `gcs.logs.formats.tables` throws out the
time stamps that cannot be.

A file is read in pieces that stay in the processor's cache, once for the chain and once for each type of message that
is asked for; kept are five bytes for each message and what was asked for last, up to `CACHE_BYTES`. It is not mapped
into memory: a file that shrinks meanwhile, or a card that is pulled out, would then end the program instead of raising
an error.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gcs.errors import TippathError
from gcs.logs.formats.damage import Damage
from gcs.logs.formats.dataflash_boots import boots
from gcs.logs.formats.dataflash_chain import chain, settle
from gcs.logs.formats.dataflash_scan import HEAD, TYPES, Format, Places, Source, scan
from gcs.logs.formats.raw import Bytes, Offsets, gathered
from gcs.logs.words import printable

CACHE_BYTES = 1 << 29  # of messages gathered before


@dataclass(frozen=True, eq=False, kw_only=True)
class DataFlashLog:
    """A log whose messages have been located; columns are gathered when asked for.

    Where boots of different firmware give one name to messages of different formats, the log as a whole has those of
    the format with the most messages; each of `boots` has its own.
    """

    damage: Damage
    _source: Source
    _kinds: Mapping[int, Format]
    """What the numbers in `Parts.kinds` mean."""
    _pieces: Sequence[Places]
    _cache: dict[tuple[int, int], Bytes]
    """What was gathered before, by log and kind; the log and its boots share it."""
    _boots: Sequence[DataFlashLog] = field(default=())

    @property
    def size(self) -> int:
        """Bytes of the whole file."""
        return self._source.size

    @property
    def boots(self) -> tuple[DataFlashLog, ...]:
        """The log of each boot of the vehicle, in the file's order; the log itself where there is one."""
        return tuple(self._boots) or (self,)

    @cached_property
    def _counts(self) -> NDArray[np.int64]:
        """How often each kind occurs."""
        counts = np.zeros(max(self._kinds) + 1, np.int64)
        for piece in self._pieces:
            counts += np.bincount(piece.kinds, minlength=counts.size)
        return counts

    @cached_property
    def _by_name(self) -> dict[str, int]:
        """Kinds by name; where several carry one name, the one with the most messages."""
        kinds: dict[str, int] = {}
        for kind, fmt in self._kinds.items():
            other = kinds.get(fmt.name)
            if other is None or self._counts[kind] > self._counts[other]:
                kinds[fmt.name] = kind
        return kinds

    @cached_property
    def formats(self) -> Mapping[str, Format]:
        """By message name, those that occur or are declared."""
        return {name: self._kinds[kind] for name, kind in self._by_name.items()}

    @property
    def names(self) -> tuple[str, ...]:
        """Message types that occur at least once, alphabetically."""
        return tuple(sorted(name for name, kind in self._by_name.items() if self._counts[kind]))

    def starts(self, message: str) -> Offsets:
        """A number for every message of this type, 0, 1, ... in the file's order; empty where there is none."""
        return np.arange(self.count(message))

    def places(self, message: str) -> Offsets:
        """First byte of every message of this type, in the file's order, shape (n,); empty where there is none."""
        kind = self._by_name.get(message, -1)
        places = (piece.base + piece.at[piece.kinds == kind].astype(np.int64) for piece in self._pieces)
        return np.concatenate((np.empty(0, np.int64), *places))

    def count(self, message: str) -> int:
        return int(self._counts[self._by_name[message]]) if message in self._by_name else 0

    def raw(self, message: str) -> Bytes:
        """Every message of a type as its bytes, header included, shape (n, length). Raises KeyError."""
        kind = self._by_name[message]
        bodies = self._bodies(kind)
        return self._gather(kind, 0, self._kinds[kind].length) if bodies is None else bodies

    def column(self, message: str, column: str, starts: Offsets | None = None) -> NDArray[Any]:
        """One field of every message of a type, in the file's order.

        Numbers keep their stored type, except the scaled ones (letters c, C, e, E, L), which are divided into float64.
        Strings are bytes. Shape (n,), (n, 32) for letter a. `starts` limits it to some of the messages.
        Raises KeyError where the log declares no such message or field, TippathError where the file changed.
        """
        kind = self._by_name[message]
        fmt = self._kinds[kind]
        if column not in fmt.columns:
            raise KeyError(f"{message}.{column}")
        stored = np.dtype(TYPES[fmt.types[fmt.columns.index(column)]][0])
        offset = fmt.offset(column)
        bodies = self._bodies(kind)
        if bodies is None:
            bodies, offset = self._gather(kind, offset, stored.itemsize), 0
        shape, strides = (len(bodies), *stored.shape), (bodies.shape[1], *(stored.base.itemsize for _ in stored.shape))
        values = (
            np.ndarray(shape, stored.base, bodies, offset, strides) if len(bodies) else np.empty(shape, stored.base)
        )
        values = values.copy() if starts is None else values[starts]
        divisor = fmt.divisor(column)
        return values if divisor is None else values / divisor

    def texts(self, message: str, column: str) -> list[str]:
        """A string field up to its first zero byte, with what is not printable replaced."""
        return [printable(bytes(raw)) for raw in self.column(message, column)]

    def table(self, message: str, columns: Sequence[str] | None = None) -> dict[str, NDArray[Any]]:
        """Several columns of one message type; all of them where none is named."""
        chosen = self.formats[message].columns if columns is None else columns
        return {name: self.column(message, name) for name in chosen}

    def sha256(self) -> str:
        """Of the whole file, hexadecimal."""
        return self._source.sha256()

    def _bodies(self, kind: int) -> Bytes | None:
        """Every message of a kind, shape (n, length); None where they are too many to be kept."""
        key = (id(self), kind)
        if key in self._cache:
            self._cache[key] = self._cache.pop(key)  # the last one asked for is forgotten last
            return self._cache[key]
        length = self._kinds[kind].length
        need = int(self._counts[kind]) * length
        if need > CACHE_BYTES:
            return None
        while self._cache and need + sum(bodies.size for bodies in self._cache.values()) > CACHE_BYTES:
            del self._cache[next(iter(self._cache))]
        self._cache[key] = self._gather(kind, 0, length)
        return self._cache[key]

    def _gather(self, kind: int, offset: int, width: int) -> Bytes:
        """Some bytes of every message of a kind, shape (n, width)."""
        out = np.empty(int(self._counts[kind]), f"V{width}")
        head = np.array([*HEAD, self._kinds[kind].id], np.uint8)
        done = 0
        pieces = {piece.base: piece for piece in self._pieces}
        for base, data in self._source.pieces():
            piece = pieces.get(base)
            if piece is None:
                continue
            at = np.flatnonzero(piece.kinds == kind)
            if at.size == 0:
                continue
            at = piece.at[at].astype(np.intp)
            if any(int(data[at[k] + i]) != head[i] for k in (0, -1) for i in range(3)):
                raise self._source.changed()
            out[done : done + at.size] = gathered(data, offset, f"V{width}", at)
            done += at.size
        return out.view(np.uint8).reshape(out.size, width)


def read(path: Path) -> DataFlashLog:
    """Read a `.BIN` file. Raises TippathError where it cannot be opened or is no DataFlash log."""
    return _locate(Source(str(path)))


def parse(data: Bytes, name: str = "log") -> DataFlashLog:
    """Locate the messages in the bytes of a log, shape (bytes,).

    Raises TippathError where there is not one message format in it; any other damage is counted, not raised.
    """
    return _locate(Source(name, data))


def _locate(source: Source) -> DataFlashLog:
    if source.size == 0:
        raise TippathError(f"{source.name}: the file is empty; fetch it from the vehicle again")
    places, definitions = scan(source)
    if not definitions:
        raise TippathError(
            f"{source.name}: not a DataFlash log: no message format (FMT) was found in its {source.size:,} bytes; "
            "check that it is the .BIN from the vehicle and not an empty or converted file"
        )
    parts = settle(definitions, places)
    chained = chain(source, parts, places)
    kinds = {kind: fmt for kind, fmt in enumerate(parts.kinds) if fmt is not None}
    cache: dict[tuple[int, int], Bytes] = {}

    def log(pieces: Sequence[Places], its_boots: Sequence[DataFlashLog] = ()) -> DataFlashLog:
        return DataFlashLog(
            damage=chained.damage, _source=source, _kinds=kinds, _pieces=pieces, _cache=cache, _boots=its_boots
        )

    firsts = boots(source, parts, chained)
    edges = pairwise((*firsts, source.size)) if len(firsts) > 1 else ()
    its_boots = [log([piece.between(start, stop) for piece in chained.messages]) for start, stop in edges]
    return log(chained.messages, its_boots)
