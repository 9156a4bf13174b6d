"""Named arrays as a log: what MATLAB files and tables of columns hold. Each array stands beside the time of its length.

A matrix is its columns, `gyro[0]` to `gyro[2]`, counted from 0 as in all logs. The time of an array is the vector of
equal length beside it, in its own struct or one around it, that is called as the profile's time or as times are.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from gcs.logs.formats.tables import FloatArray, SavedTable, Series, increasing

TIMES = ("t", "time", "tout", "timestamp", "time_s")
"""Names of a time vector, in lower case, where the profile names none."""
MOST_COLUMNS = 256  # of a matrix: one that has more is no set of channels
FEWEST = 2  # samples of a channel


@dataclass(frozen=True, eq=False, kw_only=True)
class ArrayLog(SavedTable):
    """One boot; a `gcs.logs.formats.tables.Log`."""

    path: str
    kind: str
    columns: Mapping[str, FloatArray]
    """Name -> (n,), as written; some may be times of others."""
    time: str | None
    """The array that the profile names as time."""
    scale: float
    """Of times, to s."""
    dropped: dict[str, int] = field(default_factory=dict)
    _clocks: dict[str, tuple[FloatArray, NDArray[np.intp]]] = field(default_factory=dict)

    def has(self, key: str) -> bool:
        return key in self.columns and self.clock_of(key) is not None and bool(np.isfinite(self.columns[key]).any())

    def series(self, key: str) -> Series:
        values = self.columns[key]
        clock = self.clock_of(key)
        if clock is None:
            raise KeyError(key)
        t, keep = self._increasing(clock)
        return Series(t, values[keep], clock)

    @cached_property
    def _of_size(self) -> dict[int, dict[str, str]]:
        """Samples -> name in lower case -> name; of equal ones the first."""
        found: dict[int, dict[str, str]] = {}
        for name, values in self.columns.items():
            found.setdefault(values.size, {}).setdefault(name.lower(), name)
        return found

    def clock_of(self, key: str) -> str | None:
        """The name of the time vector that belongs to an array; None where there is none."""
        size = self.columns[key].size
        wanted = () if self.time is None else (self.time.rpartition(".")[2].lower(),)
        by_name = self._of_size[size]
        for around in _structs_around(key):
            for name in (*wanted, *TIMES):
                found = by_name.get(f"{around}{name}".lower())
                if found is not None:
                    return found
        return self.time if self.time is not None and self.time in by_name.values() else None

    def fields(self) -> tuple[str, ...]:
        return tuple(self.columns)

    @property
    def sampled_s(self) -> float:
        clocks = {clock for key in self.columns if (clock := self.clock_of(key)) is not None}
        spans = (self._increasing(clock)[0] for clock in clocks)
        return max((float(t[-1] - t[0]) for t in spans if t.size), default=0.0)

    def _increasing(self, clock: str) -> tuple[FloatArray, NDArray[np.intp]]:
        """Times in s that increase, and which samples they are of, (n,) each."""
        if clock not in self._clocks:
            t = self.columns[clock] * self.scale
            keep = increasing(t)
            if not keep.all():
                self.dropped[clock] = int(np.count_nonzero(~keep))
            self._clocks[clock] = (t[keep], np.flatnonzero(keep))
        return self._clocks[clock]


def columns_of(arrays: Mapping[str, np.ndarray]) -> dict[str, FloatArray]:
    """Arrays of numbers as columns: a vector is one, a matrix has one for each place on its shorter side."""
    columns: dict[str, FloatArray] = {}
    for name, array in arrays.items():
        if np.iscomplexobj(array):
            continue
        flat = np.squeeze(array)
        if flat.ndim == 1 and flat.size >= FEWEST:
            columns[name] = flat.astype(np.float64)
        elif flat.ndim == 2 and min(flat.shape) <= MOST_COLUMNS:
            rows = flat if flat.shape[0] < flat.shape[1] else flat.T
            columns |= {f"{name}[{i}]": np.ascontiguousarray(row, np.float64) for i, row in enumerate(rows)}
    return columns


def _structs_around(key: str) -> Iterator[str]:
    """`a.b.` and `a.` and nothing of `a.b.c[2]`: where its time may stand, nearest first."""
    while key:
        key = key.rpartition(".")[0]
        yield f"{key}." if key else ""
