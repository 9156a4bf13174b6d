"""CSV logs: numbers under a header of names, off a card, with what a card does to them.

numpy's reader takes the whole file at once. Only where it refuses, or the rows are not all as long as the header, are
they sorted out row by row (`gcs.logs.formats.csv_damage`). Nothing is ever put in the place of what is left out.
"""

from __future__ import annotations

import csv
import io
import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np

from gcs.errors import TippathError
from gcs.logs.formats.csv_cells import load
from gcs.logs.formats.csv_damage import IntArray, Rows, another_column, note_on_empty, sorted_out
from gcs.logs.formats.csv_layout import Layout, is_number, layout_of
from gcs.logs.formats.raw import unreadable
from gcs.logs.formats.tables import FloatArray

_COMMENT = re.compile(r"(?m)^[ \t]*(?:#|%|//)")


@dataclass(frozen=True, eq=False)
class CsvFile:
    """The text of a file and its header; columns are read when asked for."""

    layout: Layout
    total_bytes: int
    tail: str = ""
    """The half-written last line, which is left out."""
    notes: tuple[str, ...] = ()
    """What was left out."""

    @classmethod
    def read(cls, path: Path) -> CsvFile:
        """Raises TippathError where the file cannot be read as text with a header and rows."""
        try:
            raw = path.read_bytes()
        except OSError as error:
            raise unreadable(path, error) from error
        return cls.parse(raw, str(path))

    @classmethod
    def parse(cls, raw: bytes, path: str) -> CsvFile:
        """As `read`, from the file's bytes."""
        layout = layout_of(raw, path)
        body, tail, note = _without_half_line(layout)
        if not body.strip():
            raise TippathError(f"{path}, line {layout.first_line - 1}: a header and no rows; the log has no samples")
        notes = [note] if note else []
        if layout.padding:
            notes.append(f"{layout.padding} zero bytes at the end are left out")
        return cls(replace(layout, body=body), len(raw), tail, tuple(notes))

    @property
    def path(self) -> str:
        return self.layout.path

    @property
    def header(self) -> tuple[str, ...]:
        """Column names as they stand in the file."""
        return self.layout.header

    def column(self, key: str) -> int | None:
        """Place of a column by its name, with or without the unit behind it; None where there is none, or several."""
        return self._places.get(key)

    @cached_property
    def _places(self) -> dict[str, int]:
        """Name -> place; of names without their units those that stand once."""
        often = Counter(self.layout.names)
        plain = {name: place for place, name in enumerate(self.layout.names) if name and often[name] == 1}
        return plain | {name: place for place, name in enumerate(self.layout.header) if name}

    def rows(self, required: Sequence[str], others: Sequence[str] = ()) -> Rows:
        """Some columns by name. A row without sound required cells is left out.

        Raises TippathError naming line and column where too much is wrong, KeyError for a name that is not there.
        """
        places = {name: self._place(name) for name in (*required, *others)}
        if not places:
            return Rows({}, np.empty(0, np.int64))
        needed = dict.fromkeys(required)
        table = self._at_once(list(places.values()))
        if table is None:
            others_at = {name: place for name, place in places.items() if name not in needed}
            return sorted_out(self.layout, {name: places[name] for name in needed}, others_at)
        values, lines = dict(zip(places, table, strict=True)), self._numbers(table[0].size)
        return Rows(values, lines, notes=note_on_empty(self.path, values, required, lines))

    def _place(self, name: str) -> int:
        place = self.column(name)
        if place is None:
            raise KeyError(name)
        return place

    def columns(self, names: Sequence[str]) -> dict[str, FloatArray]:
        """Some columns, all of them required; see `rows`."""
        return self.rows(names).values

    def _at_once(self, places: Sequence[int]) -> list[FloatArray] | None:
        """The columns of a file in which nothing is wrong; None where it is another."""
        layout = self.layout
        body = layout.body
        if layout.mixed or "\0" in body or _COMMENT.search(body):
            return None
        try:
            table = load(io.StringIO(body), layout, places)
        except (ValueError, OverflowError, csv.Error):
            return None
        counts = '"' not in body and layout.separator != " "
        if counts and body.count(layout.separator) != table.shape[0] * (layout.width - 1):
            return None
        if not counts and any(  # numpy does not mind
            len(cells) not in (layout.width, len(layout.header)) for cells in self._all_cells()
        ):
            return None
        return [np.ascontiguousarray(table[:, i]) for i in range(len(places))]

    def _all_cells(self) -> list[list[str]]:
        try:
            return [self.layout.cells(line) for line in self.layout.body.split("\n") if line.strip()]
        except csv.Error:
            return [[]]

    def _numbers(self, count: int) -> IntArray:
        """Lines on which the rows of an undamaged body stand."""
        if "\n\n" not in self.layout.body and self.layout.body[:1] != "\n" and " " not in self.layout.body:
            return np.arange(count, dtype=np.int64) + self.layout.first_line
        lines = self.layout.body.split("\n")
        numbers = [number for number, line in enumerate(lines, self.layout.first_line) if line.strip()]
        return np.asarray(numbers[:count], np.int64)

    def read_again(self, name: str, rows: Rows) -> FloatArray:
        """Another column for rows that were read before. Raises KeyError."""
        place = self._place(name)
        table = self._at_once([place])
        if table is not None and table[0].size == rows.lines.size:
            return np.where(np.isfinite(table[0]), table[0], np.nan)
        lines = self.layout.body.split("\n")
        return another_column(
            self.layout, place, [lines[number - self.layout.first_line] for number in rows.lines.tolist()]
        )


def _without_half_line(layout: Layout) -> tuple[str, str, str]:
    """The body without a last line that ends in its middle, that line, and a note about it.

    Such a line has no end, and fewer columns than the header or a last one that is no number where the line before has
    one.
    """
    body = layout.body
    if body.endswith("\n"):
        return body, "", ""
    whole, _, last = body.rpartition("\n")
    try:
        cells, before = layout.cells(last), layout.cells(whole.rpartition("\n")[2])
    except csv.Error:
        return body, "", ""
    if not last.strip() or not cells or not before:
        return body, "", ""
    half = len(cells) == len(before) and is_number(before[-1]) and not is_number(cells[-1]) and before[-1].strip() != ""
    if not (len(cells) < len(layout.header) or half):
        return body, "", ""
    number = layout.first_line + body.count("\n")
    columns = f"{len(cells)} of {len(layout.header)} columns"
    return whole + "\n", last, f"the last line, {number}, is half written ({columns}) and left out"
