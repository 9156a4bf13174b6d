"""A DataFlash log read while it grows, for the strip charts: only the last samples, only what they show.

Blocks come as numbers and bytes. They are read in order; a block that is missing is waited for until two seconds of
later ones are there, then what it held is left out and reading begins again at the next message that can be told for
one. The fit reads the finished file, by other code; nothing here is truth.
"""

from __future__ import annotations

import struct
import threading
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

HEAD = b"\xa3\x95"
FMT = 128
FMT_SIZE = 89
_DEGREE = np.pi / 180.0
_CODES = {
    "a": "64s", "b": "b", "B": "B", "h": "h", "H": "H", "i": "i", "I": "I", "f": "f", "d": "d", "n": "4s", "N": "16s",
    "Z": "64s", "c": "h", "C": "H", "e": "i", "E": "I", "L": "i", "M": "B", "q": "q", "Q": "Q", "g": "e",
}  # fmt: skip
WANTED = {
    "RATE": ("TimeUS", "R", "P", "ROut", "POut"),
    "SIDD": ("TimeUS", "Time", "F"),
    "TPEX": ("TimeUS", "EX", "EY"),
}
_WHERE_LOGGED = {"TPEX": ("EE", "Elev")}
_COLUMNS = ("t", "p", "q", "delta_x", "delta_y", "excitation_x", "excitation_y", "excitation_e", "delta_e")


@dataclass(frozen=True, eq=False, slots=True)
class LiveWindow:
    """The last samples of a growing log, oldest first; all arrays have shape (n,)."""

    t: FloatArray
    """s, the log's clock."""
    p: FloatArray
    """rad/s."""
    q: FloatArray
    delta_x: FloatArray
    """Commands, -1..1, excitation included."""
    delta_y: FloatArray
    excitation_x: FloatArray
    """What was added to the command; NaN where the vehicle does not log it."""
    excitation_y: FloatArray
    sweep_s: float | None = None
    """The running maneuver's own time (SIDD.Time), None where the newest samples are of none."""
    sweep_hz: float | None = None
    """Its frequency now."""
    received: int = 0
    """Samples read since the log began."""
    excitation_e: FloatArray | None = None
    """What was added to the elevator, and its command; None or NaN where the vehicle does not log them."""
    delta_e: FloatArray | None = None


@dataclass(frozen=True, slots=True)
class _Reader:
    name: str
    unpack: struct.Struct
    at: tuple[int, ...]
    """Where the wanted columns are among the unpacked; -1 where there is none."""


class LiveLog:
    """Reads blocks as they come and keeps the last `keep_s` seconds. `feed` and `window` may be on two threads."""

    PATIENCE_BLOCKS = 700
    """Two seconds of a fast log: how many later blocks a missing one is waited for."""

    def __init__(self, keep_s: float = 60.0, rate_hz: float = 1000.0, block_size: int = 200) -> None:
        self._capacity = int(keep_s * rate_hz)
        self._block_size = block_size
        self._lock = threading.Lock()
        self._ring = np.empty((2 * self._capacity, len(_COLUMNS)))
        self.restart()

    def restart(self) -> None:
        """Forget everything: another log begins."""
        with self._lock:
            self._end = 0
            self._received = 0
            self._next_block = 0
            self._waiting: dict[int, bytes] = {}
            self._buffer = bytearray()
            self._sizes: dict[int, int] = {FMT: FMT_SIZE}
            self._readers: dict[int, _Reader] = {}
            self._in_step = True
            self._excitation: tuple[float, ...] = (np.nan,) * 5
            self._sweep: tuple[float, float, float] | None = None
            self._rows: list[tuple[float, ...]] = []

    def feed(self, number: int, data: bytes) -> None:
        """One block by its number, in any order, twice if need be."""
        with self._lock:
            if number < self._next_block or number in self._waiting:
                return
            self._waiting[number] = data
            if self._next_block not in self._waiting:
                if len(self._waiting) <= self.PATIENCE_BLOCKS:
                    return
                self._next_block = min(self._waiting)
                self._buffer.clear()
                self._in_step = False
            while self._next_block in self._waiting:
                self._buffer += self._waiting.pop(self._next_block)
                self._next_block += 1
            self._read()

    def window(self, last_s: float) -> LiveWindow:
        """The samples of the last `last_s` seconds of the log's own time, empty before the first."""
        with self._lock:
            used = self._ring[max(0, self._end - self._capacity) : self._end]
            if len(used):
                # Time restarts with the log, so it increases; a damaged stamp must not empty the chart.
                first = int(np.searchsorted(used[:, 0], used[-1, 0] - last_s))
                used = used[first:]
            columns: Mapping[str, FloatArray] = {name: used[:, i].copy() for i, name in enumerate(_COLUMNS)}
            sweep = self._sweep
            if sweep is not None and (not len(used) or used[-1, 0] - sweep[0] > 0.5):
                sweep = None
            return LiveWindow(
                **columns,
                sweep_s=None if sweep is None else sweep[1],
                sweep_hz=None if sweep is None else sweep[2],
                received=self._received,
            )

    def _read(self) -> None:
        buffer = self._buffer
        at = 0
        while True:
            if not self._in_step:
                at = self._resynchronise(at)
                if not self._in_step:
                    break
            if len(buffer) - at < 3:
                break
            size = self._sizes.get(buffer[at + 2]) if buffer[at] == 0xA3 and buffer[at + 1] == 0x95 else None
            if size is None:
                self._in_step = False
                at += 1
                continue
            if len(buffer) - at < size:
                break
            kind = buffer[at + 2]
            if kind == FMT:
                self._format(bytes(buffer[at + 3 : at + FMT_SIZE]))
            elif kind in self._readers:
                self._sample(self._readers[kind], buffer, at + 3)
            at += size
        del buffer[:at]
        self._append()

    def _resynchronise(self, at: int) -> int:
        """Where two known messages follow each other; or, not in step yet, where to look on with more bytes."""
        buffer = self._buffer
        while True:
            at = buffer.find(HEAD, at)
            if at < 0:
                return max(0, len(buffer) - 1)
            if len(buffer) - at < 3:
                return at
            size = self._sizes.get(buffer[at + 2])
            if size is not None:
                if len(buffer) - at < size + 3:
                    return at
                follows = at + size
                if buffer[follows : follows + 2] == HEAD and buffer[follows + 2] in self._sizes:
                    self._in_step = True
                    return at
            at += 1

    def _format(self, body: bytes) -> None:
        kind, size, raw_name, raw_codes, raw_labels = struct.unpack("<BB4s16s64s", body)
        name, codes, labels = (
            raw.split(b"\0", 1)[0].decode("ascii", errors="replace") for raw in (raw_name, raw_codes, raw_labels)
        )
        if size < 3 or kind == FMT:
            return
        self._sizes[kind] = size
        self._readers.pop(kind, None)
        wanted = WANTED.get(name)
        columns = labels.split(",")
        if wanted is None or not set(wanted) <= set(columns) or not set(codes) <= set(_CODES):
            return
        unpack = struct.Struct("<" + "".join(_CODES[code] for code in codes))
        if unpack.size == size - 3 and len(codes) == len(columns):
            names = (*wanted, *_WHERE_LOGGED.get(name, ()))
            at = tuple(columns.index(column) if column in columns else -1 for column in names)
            self._readers[kind] = _Reader(name, unpack, at)

    def _sample(self, reader: _Reader, buffer: bytearray, at: int) -> None:
        fields = reader.unpack.unpack_from(buffer, at)
        values = [fields[i] if i >= 0 else np.nan for i in reader.at]
        t = values[0] * 1e-6
        match reader.name:
            case "RATE":
                _, p, q, delta_x, delta_y = values
                added = self._excitation[1:] if self._excitation[0] == t else (np.nan,) * 4
                self._rows.append((t, p * _DEGREE, q * _DEGREE, delta_x, delta_y, *added))
            case "SIDD":
                self._sweep = (t, values[1], values[2])
            case _:
                self._excitation = (t, *values[1:])
                # Whichever of the two is logged first, they belong together where their stamps are equal.
                if self._rows and self._rows[-1][0] == t:
                    self._rows[-1] = (*self._rows[-1][:5], *values[1:])
                elif not self._rows and self._end and self._ring[self._end - 1, 0] == t:
                    self._ring[self._end - 1, 5:] = values[1:]

    def _append(self) -> None:
        rows = self._rows[-self._capacity :]
        self._received += len(self._rows)
        self._rows = []
        if not rows:
            return
        if self._end + len(rows) > len(self._ring):
            keep = self._ring[self._end - self._capacity : self._end].copy()
            self._ring[: self._capacity] = keep
            self._end = self._capacity
        self._ring[self._end : self._end + len(rows)] = rows
        self._end += len(rows)
