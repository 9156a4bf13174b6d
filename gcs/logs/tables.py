"""A log as named series, whatever its format: what profiles take their channels from.

A series is one field with its own clock. Fields that share a clock share every time stamp, so they need no matching.
Here also what a DataFlash log needs for want of checksums: samples are thrown out whose time stamps cannot be right,
because they break the order of their neighbours, and the last one before a gap, which may be two halves of different
messages. Nothing is put in their place.
"""

from __future__ import annotations

import re
from bisect import bisect_left, bisect_right
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from gcs.errors import TippathError
from gcs.logs.csv import CsvFile
from gcs.logs.dataflash import DataFlashLog

FloatArray = NDArray[np.float64]

_FIELD = re.compile(r"([A-Za-z0-9_]{1,4})(?:\[(\d{1,3})\])?\.([A-Za-z0-9_]+)")
_CLOCKS = (("TimeUS", 1e-6), ("TimeMS", 1e-3))
_INSTANCE = ("I", "Instance")
EVENTS = frozenset({"CMD", "ERR", "EV", "FILE", "FMT", "FMTU", "MAVC", "MODE", "MSG", "MULT", "ORGN", "PARM"})
EVENTS |= {"SIDS", "SIDY", "UNIT", "VER"}
"""Messages that tell of something that happened once: several may share a time, and nothing is due after them."""


@dataclass(frozen=True, eq=False)
class Series:
    """One field over time."""

    t: FloatArray
    """s of the log's own clock, increasing, shape (n,); strictly, but for `EVENTS`."""
    values: FloatArray
    """Shape (n,); not finite where the log says so."""
    clock: str
    """Series of one log with equal clocks have equal `t`."""

    @property
    def spacing_s(self) -> float:
        """Median spacing; infinite for fewer than two samples."""
        return float(np.median(np.diff(self.t))) if self.t.size > 1 else np.inf

    def part(self, start_s: float, stop_s: float) -> Series:
        """The samples with start_s <= t <= stop_s."""
        first, last = np.searchsorted(self.t, start_s, "left"), np.searchsorted(self.t, stop_s, "right")
        return Series(self.t[first:last], self.values[first:last], self.clock)


class Log(Protocol):
    """What a profile is applied to."""

    @property
    def path(self) -> str: ...

    @property
    def kind(self) -> str:
        """`dataflash` or `csv`."""

    def has(self, key: str) -> bool:
        """Whether there is a field of that name with samples in it."""

    def series(self, key: str) -> Series:
        """The field. Raises KeyError where `has` says no."""

    def fields(self) -> tuple[str, ...]:
        """What there is to choose from, for messages to the user."""


class DataFlashTables:
    """A DataFlash log; keys are `MESSAGE.Field`, or `MESSAGE[2].Field` for one sensor of several.

    Without a number the lowest that occurs is taken. Time is TimeUS (or TimeMS) unless `time_field` names another.
    """

    kind = "dataflash"

    def __init__(
        self, log: DataFlashLog, path: str, time_field: str | None = None, time_scale: float | None = None
    ) -> None:
        self.log = log
        self.path = path
        self.dropped: dict[str, int] = {}
        """Message type -> samples thrown out for an impossible time stamp."""
        self._time = (time_field, time_scale)
        self._clocks: dict[str, tuple[FloatArray, NDArray[np.int64]]] = {}

    def has(self, key: str) -> bool:
        try:
            message, instance, column = self._parts(key)
        except KeyError:
            return False
        fmt = self.log.formats[message]
        letter = fmt.types[fmt.columns.index(column)]
        return letter not in "aNnZ" and self._clock(message, instance)[0].size > 0

    def series(self, key: str) -> Series:
        message, instance, column = self._parts(key)
        t, starts = self._clock(message, instance)
        values = self.log.column(message, column, starts).astype(np.float64)
        return Series(t, values, message if instance is None else f"{message}[{instance}]")

    def fields(self) -> tuple[str, ...]:
        every = (f"{name}.{column}" for name in self.log.names for column in self.log.formats[name].columns)
        return tuple(key for key in every if not key.endswith((".TimeUS", ".TimeMS")) and self.has(key))

    @property
    def sampled_s(self) -> float:
        """From the first sample to the last of what is logged regularly; 0 where there is nothing but `EVENTS`."""
        names = [name for name in self.log.names if name not in EVENTS and self._time_of(name) is not None]
        clocks = [self._clock(name, None)[0] for name in names]
        return max((float(t[-1] - t[0]) for t in clocks if t.size), default=0.0)

    def texts(self, message: str, column: str) -> list[tuple[float, str]]:
        """A string field with its times, in s."""
        if message not in self.log.formats or column not in self.log.formats[message].columns:
            return []
        field, scale = self._time_of(message) or ("", 1.0)
        if not field:
            return []
        t = (self.log.column(message, field) * scale).tolist()  # several may share a time: nothing is thrown out
        return list(zip(t, self.log.texts(message, column), strict=True))

    def _parts(self, key: str) -> tuple[str, int | None, str]:
        match = _FIELD.fullmatch(key)
        if match is None:
            raise KeyError(key)
        message, number, column = match.groups()
        fmt = self.log.formats.get(message)
        if fmt is None or column not in fmt.columns or self._time_of(message) is None:
            raise KeyError(key)
        return message, None if number is None else int(number), column

    def _time_of(self, message: str) -> tuple[str, float] | None:
        columns = self.log.formats[message].columns
        field, scale = self._time
        for name, unit in _CLOCKS if field is None else ((field, scale or 1.0), *_CLOCKS):
            if name in columns:
                return name, scale if scale is not None and name == field else unit
        return None

    def _clock(self, message: str, instance: int | None) -> tuple[FloatArray, NDArray[np.int64]]:
        """Increasing times and the messages they belong to."""
        name = f"{message}[{instance}]"
        if name not in self._clocks:
            starts = self.log.starts(message)
            column = next((c for c in _INSTANCE if c in self.log.formats[message].columns), None)
            if column is not None and starts.size:
                numbers = self.log.column(message, column, starts)
                starts = starts[numbers == (numbers.min() if instance is None else instance)]
            elif instance is not None:
                starts = starts[:0]
            field, scale = self._time_of(message) or ("", 1.0)
            t = self.log.column(message, field, starts).astype(np.float64) * scale if field else np.empty(0)
            event = message in EVENTS
            keep = increasing(t, strictly=not event)
            if not keep.all():
                self.dropped[name if instance is not None else message] = int(np.count_nonzero(~keep))
            t, starts = t[keep], starts[keep]
            trusted = np.ones(t.size, np.bool_) if event else before_no_gap(t)
            self._clocks[name] = (t[trusted], starts[trusted])
        return self._clocks[name]


class CsvTable:
    """A CSV file; keys are column names, and all columns share the time column's clock."""

    kind = "csv"

    def __init__(self, file: CsvFile, path: str, time_column: str = "t", time_scale: float = 1.0) -> None:
        self.file = file
        self.path = path
        self.time_column = time_column
        self._scale = time_scale
        self._columns: dict[str, FloatArray] = {}
        self._t: FloatArray | None = None

    def load(self, keys: Iterable[str]) -> None:
        """Read several columns in one pass; what is asked for later is read alone."""
        wanted = [key for key in dict.fromkeys((self.time_column, *keys)) if key not in self._columns]
        self._columns.update(self.file.columns([key for key in wanted if key in self.file.header]))

    def has(self, key: str) -> bool:
        return key in self.file.header

    def series(self, key: str) -> Series:
        if not self.has(key):
            raise KeyError(key)
        return Series(self.time(), self._column(key), "csv")

    def fields(self) -> tuple[str, ...]:
        return self.file.header

    def time(self) -> FloatArray:
        """Raises TippathError with the line where time does not increase."""
        if self._t is None:
            if not self.has(self.time_column):
                raise TippathError(
                    f"{self.path}: no time: column {self.time_column} is missing; add a column t in seconds, "
                    "or name the time column in a profile: [time] source = ..., scale = ..."
                )
            t = self._column(self.time_column) * self._scale
            back = np.flatnonzero(np.diff(t) <= 0)
            if back.size:
                row = int(back[0])
                raise TippathError(
                    f"{self.path}, line {self.file.line_of(row + 1)}, column {self.time_column}: time does not increase"
                    f" ({float(self._column(self.time_column)[row + 1])!r} after "
                    f"{float(self._column(self.time_column)[row])!r}); "
                    "sort the rows by time and remove repeated ones"
                )
            self._t = t
        return self._t

    def _column(self, key: str) -> FloatArray:
        if key not in self._columns:
            self.load([key])
        return self._columns[key]


def before_no_gap(t: FloatArray) -> NDArray[np.bool_]:
    """Which samples are followed by the next in time, shape (n,); all of them where there is no regular rate to tell.

    Where bytes are missing, the head of one message can by chance be continued by the tail of a later one of just the
    right length. Nothing in the format shows it, but the next message is then late: the last sample before a gap is not
    believed.
    """
    keep = np.ones(t.size, np.bool_)
    if t.size >= 10:
        spacing = np.diff(t)
        keep[:-1] = spacing <= 3 * float(np.median(spacing))
    return keep


def increasing(t: FloatArray, *, strictly: bool = True) -> NDArray[np.bool_]:
    """Which samples form the longest increasing sequence of time stamps, shape (n,).

    A damaged stamp breaks the order of its neighbours; the fewest samples are given up to restore it. A stamp that is
    not finite never stays. Not `strictly`: several may share a time.
    """
    keep = np.isfinite(t)
    steps = np.diff(t)
    if keep.all() and np.all(steps > 0 if strictly else steps >= 0):
        return keep
    place = bisect_left if strictly else bisect_right
    places = np.flatnonzero(keep)
    tails: list[float] = []  # smallest last stamp of an increasing sequence of each length
    ends: list[int] = []
    before = np.full(places.size, -1, np.int64)
    for i, stamp in enumerate(t[places].tolist()):
        length = place(tails, stamp)
        if length == len(tails):
            tails.append(stamp)
            ends.append(i)
        else:
            tails[length] = stamp
            ends[length] = i
        before[i] = ends[length - 1] if length else -1
    keep = np.zeros(t.size, np.bool_)
    i = ends[-1] if ends else -1
    while i >= 0:
        keep[places[i]] = True
        i = int(before[i])
    return keep
