"""A CSV log as named series, one table for each boot of the vehicle.

Columns with many empty cells were logged more slowly and get a clock of their own. Times that break the order of the
others are given up; where the clock begins anew and stays back, another boot has begun.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np

from gcs.errors import TippathError
from gcs.logs.formats.csv import CsvFile
from gcs.logs.formats.csv_damage import SPARSE, IntArray, Rows, allowed, count_of, listed
from gcs.logs.formats.damage import Damage
from gcs.logs.formats.tables import FloatArray, SavedTable, Series, increasing

BACK = 25  # rows that must stay behind the clock's earlier value to be another boot
SHORTEST_BOOT = 10  # rows
NAMED = 8  # columns in a message


class CsvTable(SavedTable):
    """One boot of a CSV log; keys are column names, and columns without empty cells share the time column's clock."""

    kind = "csv"

    def __init__(self, file: CsvFile, rows: Rows, t: FloatArray, keep: IntArray) -> None:
        self.file = file
        self.path = file.path
        self.dropped: dict[str, int] = {}
        self._rows = rows
        self._t = t
        self._keep = keep
        self._columns: dict[str, FloatArray] = {}

    def has(self, key: str) -> bool:
        return self.file.column(key) is not None and bool(np.isfinite(self._column(key)).any())

    def series(self, key: str) -> Series:
        if self.file.column(key) is None:
            raise KeyError(key)
        values = self._column(key)
        finite = np.isfinite(values)
        if np.mean(~finite) > SPARSE:
            return Series(self._t[finite], values[finite], f"csv:{key}")
        return Series(self._t, values, "csv")

    def fields(self) -> tuple[str, ...]:
        return tuple(name for name in self.file.header if name)

    @property
    def names(self) -> tuple[str, ...]:
        """Of the columns, without the units behind them."""
        return tuple(name for name in self.file.layout.names if name)

    @property
    def span_s(self) -> tuple[float, float]:
        """The first time and the last."""
        return float(self._t[0]), float(self._t[-1])

    @property
    def sampled_s(self) -> float:
        return self.span_s[1] - self.span_s[0]

    def _column(self, key: str) -> FloatArray:
        if key not in self._columns:
            if key not in self._rows.values:
                self._rows.values[key] = self.file.read_again(key, self._rows)
            values = self._rows.values[key][self._keep]
            self._columns[key] = np.where(np.isfinite(values), values, np.nan)
        return self._columns[key]


@dataclass(frozen=True, eq=False)
class CsvLog:
    """A CSV file as logs: one for each boot."""

    boots: tuple[CsvTable, ...]
    damage: Damage
    notes: tuple[str, ...] = field(default=())
    """What is wrong with the file."""


def open_table(
    file: CsvFile, time_column: str, time_scale: float, required: Sequence[str], others: Sequence[str]
) -> CsvLog:
    """Read the columns in one pass and cut the file where its clock begins anew.

    Raises TippathError naming line and column where time is missing or does not increase, or too much is wrong.
    """
    if file.column(time_column) is None:
        do = "add the time in seconds as t, or name the time column in a profile"
        if time_column != "t":
            do = f"the profile takes the time from it; name one of {', '.join(file.header[:NAMED])}"
        raise TippathError(
            f"{file.path}, line 1: column {time_column} missing; {do} ([time] source = ..., scale = ...)"
        )
    rows = file.rows([time_column, *required], others)
    t = rows.values[time_column] * time_scale
    boots, dropped = _boots(t)
    if len(dropped) > allowed(t.size):
        first = next((i for i in dropped if i and not t[i] > t[i - 1]), dropped[0])
        now, before = (float(rows.values[time_column][i]) for i in (first, max(first - 1, 0)))
        raise TippathError(
            f"{file.path}, line {rows.lines[first]}, column {time_column}: time does not increase ({now!r} after "
            f"{before!r}), nor does it in {len(dropped)} of {t.size} rows; sort the rows by time, log it with more "
            "digits, or name another time column in a profile ([time] source = ...)"
        )
    notes = [*file.notes, *rows.notes]
    if dropped:
        lines = [int(rows.lines[i]) for i in dropped]
        notes.append(f"{count_of(len(lines), 'row')} left out, whose times break the order: {listed(lines)}")
    if len(boots) > 1:
        begun = ", ".join(str(int(rows.lines[keep[0]])) for keep in boots[1:])
        notes.append(f"the clock begins anew on line {begun}: {len(boots)} boots in one file, each read as its own log")
    skipped = sum(size for _, size in rows.wrong) + file.layout.padding
    tail = len(file.tail.encode(file.layout.encoding, "replace"))
    damage = Damage(file.total_bytes, skipped + tail, rows.breaks, {}, bool(tail or file.layout.padding))
    return CsvLog(tuple(CsvTable(file, rows, t[keep], keep) for keep in boots), damage, tuple(notes))


def _boots(t: FloatArray) -> tuple[list[IntArray], list[int]]:
    """Rows of each boot, increasing in time, and the rows that are given up."""
    cuts = [0]
    for i in (np.flatnonzero(np.diff(t) < 0) + 1).tolist():
        before, after = t[max(cuts[-1], i - BACK) : i], t[i : i + BACK]
        if i - cuts[-1] >= SHORTEST_BOOT and after.size >= SHORTEST_BOOT and np.nanmedian(after) < np.nanmedian(before):
            cuts.append(i)
    boots: list[IntArray] = []
    taken = np.zeros(t.size, np.bool_)
    for start, stop in pairwise([*cuts, t.size]):
        keep = start + np.flatnonzero(increasing(t[start:stop]))
        if keep.size >= SHORTEST_BOOT or (len(cuts) == 1 and keep.size):
            boots.append(keep)
            taken[keep] = True
    return boots, np.flatnonzero(~taken).tolist()
