"""A DataFlash log read while it grows: the last samples, what the vehicle says of its sweep and mode, and its clock.

Blocks come as numbers and bytes. They are read in order; a block that is missing is waited for until two seconds of
later ones are there, then what it held is left out and reading begins again at the next message that can be told for
one. The fit reads the finished file, by other code; nothing here is truth. What a lost block may have changed is then
not known: the mode, until the log tells it again.
"""

from __future__ import annotations

import math
import struct
import threading
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

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
    "MODE": ("TimeUS", "Mode"),
    "SIDS": ("TimeUS", "Ax", "Mag", "FSt", "FSp", "TFin", "TC", "TR", "TFout"),
    "SIDY": ("TimeUS", "Kind", "Law", "C1", "Noise", "Pulse"),
}
_TEXT = "anNZ"
_WHERE_LOGGED = {"TPEX": ("EE", "Elev"), "MODE": ("ModeNum",)}
STALE_S = 0.5
"""Of the log's time without a sample of the maneuver: it is over."""
_COLUMNS = ("t", "p", "q", "delta_x", "delta_y", "excitation_x", "excitation_y", "excitation_e", "delta_e")


@dataclass(frozen=True, slots=True, kw_only=True)
class SweepSettings:
    """The vehicle's own record of the maneuver it entered last (SIDS), in its units, as float32 rounds them."""

    at_s: float
    """When it entered, on the log's clock."""
    axis: int
    """SID_AXIS."""
    magnitude: float
    """Of full command, or deg/s where the axis is a rate."""
    f_start_hz: float
    f_stop_hz: float
    fade_in_s: float
    constant_s: float
    """How long the first frequency is held."""
    duration_s: float
    """SID_T_REC."""
    fade_out_s: float
    kind: int | None = None
    """What SIDS leaves out (SIDY), None on a vehicle that has no such record: SIDX_KIND, SIDX_LAW."""
    law: int | None = None
    c1: float | None = None
    noise: float | None = None
    pulse_s: float | None = None


@dataclass(frozen=True, eq=False, slots=True, kw_only=True)
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
    """The running maneuver's own time (SIDD.Time), None where the newest samples are of none, or of one that was left
    or entered again since. A log that no longer grows cannot tell: compare `sweep_entered_s` with your own start."""
    sweep_hz: float | None = None
    """Its frequency now."""
    received: int = 0
    """Samples read since the log began."""
    excitation_e: FloatArray | None = None
    """What was added to the elevator, and its command; None or NaN where the vehicle does not log them."""
    delta_e: FloatArray | None = None
    sweep_entered_s: float | None = None
    """When the maneuver of `sweep_s` was entered, on the log's clock; None with it."""
    sweep_settings: SweepSettings | None = None
    """The vehicle's record of the maneuver it entered last, also after its end; None before the first."""
    mode: int | None = None
    """The newest mode in the log; None before the first, and after a lost block that may have held another."""
    mode_at_s: float | None = None
    """When it was entered, on the log's clock."""
    log_s: float | None = None
    """The newest time stamp of any message, on the log's clock, which is the vehicle's since it booted."""


def rates_alone(rows: Sequence[tuple[float, float, float]], last_s: float) -> LiveWindow:
    """The last seconds of (t, p, q) as telemetry tells them, s and rad/s; commands are not known."""
    told = np.array(rows, dtype=float).reshape(-1, 3)
    told = told[told[:, 0] >= told[-1, 0] - last_s] if len(told) else told
    unknown = np.full(len(told), np.nan)
    return LiveWindow(
        t=told[:, 0],
        p=told[:, 1],
        q=told[:, 2],
        delta_x=unknown,
        delta_y=unknown,
        excitation_x=unknown,
        excitation_y=unknown,
    )


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
            self._settings: SweepSettings | None = None
            self._mode: tuple[float, int] | None = None
            self._stamped: set[int] = set()  # kinds whose first column is the time
            self._log_s: float | None = None
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
                self._pass_over()
            self._take()

    def progress(self) -> tuple[float | None, int]:
        """The newest time stamp read, and how many blocks were read or passed over up to it."""
        with self._lock:
            return self._log_s, self._next_block

    def end_s(self) -> float | None:
        """The newest time stamp of a log that has ended: what is missing of it is no longer waited for."""
        with self._lock:
            while self._waiting:
                if self._next_block not in self._waiting:
                    self._pass_over()
                self._take()
            return self._log_s

    def _pass_over(self) -> None:
        """Go on behind what is missing."""
        self._next_block = min(self._waiting)
        self._buffer.clear()
        self._in_step = False
        self._mode = None

    def _take(self) -> None:
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
            sweep, entered_s = self._current_sweep(float(used[-1, 0])) if len(used) else (None, None)
            mode_at_s, mode = (None, None) if self._mode is None else self._mode
            return LiveWindow(
                **columns,
                sweep_s=None if sweep is None else sweep[1],
                sweep_hz=None if sweep is None else sweep[2],
                received=self._received,
                sweep_entered_s=entered_s,
                sweep_settings=self._settings,
                mode=mode,
                mode_at_s=mode_at_s,
                log_s=self._log_s,
            )

    def _current_sweep(self, newest_s: float) -> tuple[tuple[float, float, float] | None, float | None]:
        """The newest sample of the maneuver that goes on, and when that was entered."""
        sweep, settings, mode = self._sweep, self._settings, self._mode
        if sweep is None or newest_s - sweep[0] > STALE_S:
            return None, None
        at_s, since_s, _ = sweep
        entered_again = settings is not None and settings.at_s > at_s
        if entered_again or (mode is not None and mode[0] > at_s):
            return None, None
        # SIDD.Time may count loops of nominal length: the record at the entry is the better stamp, where it is its own.
        if settings is not None and abs(at_s - since_s - settings.at_s) < 0.2 + 0.05 * since_s:
            return sweep, settings.at_s
        return sweep, at_s - since_s

    def _read(self) -> None:
        buffer = self._buffer
        at, stamped_at = 0, -1
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
                self._mode = None
                at += 1
                continue
            if len(buffer) - at < size:
                break
            kind = buffer[at + 2]
            if kind == FMT:
                self._format(bytes(buffer[at + 3 : at + FMT_SIZE]))
            elif kind in self._readers:
                self._sample(self._readers[kind], buffer, at + 3)
            if kind in self._stamped:
                stamped_at = at + 3
            at += size
        if stamped_at >= 0:
            self._log_s = int.from_bytes(buffer[stamped_at : stamped_at + 8], "little") * 1e-6
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
        if columns[0] == "TimeUS" and codes[:1] == "Q" and size >= 11:
            self._stamped.add(kind)
        else:
            self._stamped.discard(kind)
        if wanted is None or not set(wanted) <= set(columns) or not set(codes) <= set(_CODES):
            return
        if any(code in _TEXT and column in wanted for code, column in zip(codes, columns, strict=False)):
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
            case "MODE":
                # ArduPilot logs the number twice; what calls itself a number is one.
                self._mode = (t, _whole(values[2] if reader.at[2] >= 0 else values[1]))
            case "SIDS":
                self._settings = _settings(t, values)
            case "SIDY":
                if self._settings is not None and self._settings.at_s == t:
                    self._settings = _more_settings(self._settings, values)
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


def _settings(at_s: float, values: Sequence[float]) -> SweepSettings:
    _, axis, magnitude, f_start_hz, f_stop_hz, fade_in_s, constant_s, duration_s, fade_out_s = values
    return SweepSettings(
        at_s=at_s,
        axis=_whole(axis),
        magnitude=magnitude,
        f_start_hz=f_start_hz,
        f_stop_hz=f_stop_hz,
        fade_in_s=fade_in_s,
        constant_s=constant_s,
        duration_s=duration_s,
        fade_out_s=fade_out_s,
    )


def _more_settings(settings: SweepSettings, values: Sequence[float]) -> SweepSettings:
    _, kind, law, c1, noise, pulse_s = values
    return replace(settings, kind=_whole(kind), law=_whole(law), c1=c1, noise=noise, pulse_s=pulse_s)


def _whole(value: float) -> int:
    """A whole number in whatever type a log has it; -1 for none."""
    return int(value) if math.isfinite(value) else -1
