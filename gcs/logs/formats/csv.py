"""CSV logs: numbers under a header of names, off a card, with what a card does to them.

numpy's reader takes the whole file at once. Only where it refuses, or the rows are not all as long as the header, are
they sorted out: blocks of rows are read, and a block that is refused is halved until the wrong rows stand alone. They
are left out, counted as damage and named by line; a file with more than a few of them is no damaged log but a
misunderstanding, and refused with the line, the column and what to do.

An empty cell, or nan, is not damage: the logger had no sample. Columns with many of them were logged more slowly and
get a clock of their own. Times that break the order of the others are given up; where the clock begins anew and stays
back, another boot has begun. Nothing is ever put in the place of what is left out.
"""

from __future__ import annotations

import csv
import io
import math
import re
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from gcs.errors import TippathError
from gcs.logs.formats.csv_layout import COMMENTS, SHOWN, Layout, is_number, layout_of
from gcs.logs.formats.damage import Damage
from gcs.logs.formats.tables import FloatArray, Series, increasing

IntArray = NDArray[np.int64]

FEW_ROWS = 3  # may be wrong in any file of `ENOUGH` rows...
ENOUGH = 100
WRONG_SHARE = 0.01  # ... and this share of a long one
BLOCK = 4096  # rows read at a time where not all can be
SPARSE = 0.01  # share of empty cells from which a column has a clock of its own
BACK = 25  # rows that must stay behind the clock's earlier value to be another boot
SHORTEST_BOOT = 10  # rows
LISTED = 8  # line numbers in a note


def allowed(rows: int) -> int:
    """How many of so many rows may be wrong before the file is refused."""
    return max(FEW_ROWS, int(rows * WRONG_SHARE)) if rows >= ENOUGH else 0


@dataclass(frozen=True, eq=False)
class Rows:
    """The rows of a file whose required columns are sound."""

    values: dict[str, FloatArray]
    """Column -> shape (n,); nan where a cell is empty, or (in columns that are not required) no number."""
    lines: IntArray
    """Line of the file (from 1) of each row, shape (n,)."""
    wrong: tuple[tuple[int, int], ...] = ()
    """Line and length in bytes of each damaged row."""
    breaks: int = 0
    """Stretches of damaged rows that good ones follow."""
    notes: tuple[str, ...] = ()


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
            raise TippathError(f"{path}: cannot be read ({error.strerror or error})") from error
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
        if key and key in self.layout.header:
            return self.layout.header.index(key)
        places = [place for place, name in enumerate(self.layout.names) if name == key and name]
        return places[0] if len(places) == 1 else None

    def rows(self, required: Sequence[str], others: Sequence[str] = ()) -> Rows:
        """Some columns by name. A row without sound required cells is left out.

        Raises TippathError naming line and column where too much is wrong, KeyError for a name that is not there.
        """
        names = list(dict.fromkeys((*required, *others)))
        places = [self.column(name) for name in names]
        if None in places:
            raise KeyError(names[places.index(None)])
        if not names:
            return Rows({}, np.empty(0, np.int64))
        known = [place for place in places if place is not None]
        table = self._at_once(known)
        if table is None:
            return self._sorted_out(names[: len(set(required))], names[len(set(required)) :])
        values, lines = dict(zip(names, table, strict=True)), self._numbers(table[0].size)
        return Rows(values, lines, notes=self._empty(values, required, lines))

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
            table = _load(io.StringIO(body), layout, places)
        except (ValueError, OverflowError, csv.Error):
            return None
        counts = '"' not in body and layout.separator != " "
        if counts and body.count(layout.separator) != table.shape[0] * (layout.width - 1):
            return None
        if not counts and any(
            len(found) not in (layout.width, len(layout.header)) for found in self._all_cells()
        ):  # numpy does not mind
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

    def _sorted_out(self, required: Sequence[str], others: Sequence[str]) -> Rows:
        layout = self.layout
        sound: list[tuple[int, str]] = []
        wrong: list[tuple[int, str]] = []
        reasons: dict[int, str] = {}
        again = 0
        for number, line in enumerate(layout.body.split("\n"), layout.first_line):
            if not line.strip() or line.lstrip().startswith(COMMENTS):
                continue
            reason = self._shape(line, required)
            if reason is None:
                sound.append((number, line))
            elif reason:
                wrong.append((number, line))
                reasons[number] = reason
            else:
                again += 1
        places = [place for name in required if (place := self.column(name)) is not None]
        kept, tables = self._halved(sound, places, required, wrong, reasons)
        total = len(kept) + len(wrong)
        if len(wrong) > allowed(total) or not kept:
            first = min(number for number, _ in wrong) if wrong else layout.first_line
            more = f" ({len(wrong)} of {total} rows are wrong)" if len(wrong) > 1 else ""
            raise TippathError(f"{self.path}, line {first}{reasons.get(first, ': no rows')}{more}")
        values = dict(zip(required, tables, strict=True))
        lines = [line for _, line in kept]
        for name in others:
            values[name] = self._another(name, lines)
        numbers = np.asarray([number for number, _ in kept], np.int64)
        wrong.sort()
        bad = {number for number, _ in wrong}
        order = sorted([*bad, *(number for number, _ in kept)])
        breaks = sum(1 for a, b in pairwise(order) if a in bad and b not in bad)
        notes = []
        if wrong:
            notes.append(f"{_count(len(wrong), 'row')} damaged and left out: {_listed([n for n, _ in wrong])}")
        if again:
            notes.append(f"the header stands {again} times more among the rows: the logger began anew")
        return Rows(
            values,
            numbers,
            tuple((number, self._bytes(line)) for number, line in wrong),
            breaks,
            (*notes, *self._empty(values, required, numbers)),
        )

    def _empty(self, values: dict[str, FloatArray], required: Sequence[str], lines: IntArray) -> tuple[str, ...]:
        """A note on rows without a value where nearly all have one. Raises TippathError for a column without any."""
        empty = np.zeros(lines.size, np.bool_)
        for name in required:
            missing = ~np.isfinite(values[name])
            if missing.all():
                raise TippathError(
                    f"{self.path}, line {lines[0]}, column {name}: no number in the whole column; take another column "
                    "in a profile: --profile FILE.toml"
                )
            if np.mean(missing) <= SPARSE:
                empty |= missing
        if not empty.any():
            return ()
        at = lines[empty].tolist()
        return (f"{_count(len(at), 'row')} without a finite number in a needed column, left out: {_listed(at)}",)

    def _bytes(self, line: str) -> int:
        return len(line.encode(self.layout.encoding, "replace")) + (2 if "16" in self.layout.encoding else 1)

    def _shape(self, line: str, names: Sequence[str]) -> str | None:
        """None for a row of the right length; empty for the header once more; else what is wrong with it."""
        layout = self.layout
        if (
            layout.separator != " "
            and line.count(layout.separator) == layout.width - 1
            and line.isprintable()
            and line.isascii()
            and '"' not in line
            and line.lstrip()[:1] != layout.header[0][:1]
        ):
            return None  # nearly all of them
        if "\ufffd" in line or not line.replace("\t", " ").isprintable():
            zero = " (a zero byte)" if "\0" in line else ""
            shown = next((i for i, name in enumerate(names) if self._is_odd(line, name)), None)
            if shown is None or zero:
                return f": not text{zero}; is the file damaged, or a binary log with the wrong name?"
        try:
            found = layout.cells(line)
        except csv.Error as error:
            return f": cannot be read ({error}); remove the row"
        count = len(found)
        if count == layout.width or (count == len(layout.header) and layout.width > count):
            return "" if tuple(cell.strip() for cell in found[: len(layout.header)]) == layout.header else None
        advice = (
            "is the line cut, or a decimal comma used? With decimal commas, separate columns by semicolons or tabs"
            if layout.separator == ","
            else "is the line cut, or the separator another one?"
        )
        return f": {count} columns where the header has {len(layout.header)}; {advice}"

    def _is_odd(self, line: str, name: str) -> bool:
        """Whether what is not text in a line lies in this column: its error is then told with the column's name."""
        try:
            cell = self.layout.cells(line)[self.column(name) or 0]
        except (csv.Error, IndexError):
            return False
        return not cell.isprintable() or "\ufffd" in cell

    def _halved(
        self,
        rows: list[tuple[int, str]],
        places: Sequence[int],
        names: Sequence[str],
        wrong: list[tuple[int, str]],
        reasons: dict[int, str],
    ) -> tuple[list[tuple[int, str]], list[FloatArray]]:
        """Read blocks of rows, halving those that numpy refuses; rows that are refused alone go to `wrong`."""
        layout = self.layout
        most = allowed(len(rows))
        comma = layout.mixed and self._decimal_comma(rows, places, names)
        kept: list[tuple[int, str]] = []
        parts: list[FloatArray] = []
        blocks = [rows[i : i + BLOCK] for i in range(0, len(rows), BLOCK)][::-1]
        while blocks:
            block = blocks.pop()
            lines = [line.replace(",", ".") if comma else line for _, line in block]
            try:
                table = _load(_filled(lines, layout), layout, places)
                if table.shape[0] != len(block):
                    raise ValueError
            except (ValueError, OverflowError, csv.Error):
                if len(block) > 1:
                    half = len(block) // 2
                    blocks += [block[half:], block[:half]]
                    continue
                number, line = block[0]
                alone = self._alone(line.replace(",", ".") if comma else line, places)
                if alone is None:
                    wrong.append(block[0])
                    reasons[number] = self._what_is_wrong(line, places, names)
                    if len(wrong) > most:  # refused anyway, whatever follows
                        kept += [row for rest in blocks for row in rest]
                        return kept, [np.full(len(kept), np.nan) for _ in places]
                    continue
                table = alone
            kept += block
            parts.append(table)
        whole = np.concatenate(parts) if parts else np.empty((0, len(places)))
        whole[~np.isfinite(whole)] = np.nan
        return kept, [np.ascontiguousarray(whole[:, i]) for i in range(len(places))]

    def _alone(self, line: str, places: Sequence[int]) -> FloatArray | None:
        found = self.layout.cells(line)
        values = [_value(found[place]) for place in places]
        return None if None in values else np.array([values], np.float64)

    def _what_is_wrong(self, line: str, places: Sequence[int], names: Sequence[str]) -> str:
        found = self.layout.cells(line)
        for place, name in zip(places, names, strict=True):
            cell = found[place].strip()
            if _value(cell) is None:
                quoted = self.layout.separator == "," and "," in cell and is_number(cell)
                if quoted:
                    return (
                        f", column {name}: {cell[:SHOWN]!r} may be a thousand or a decimal comma; write decimals with "
                        "points and thousands without a mark"
                    )
                return f", column {name}: {cell[:SHOWN]!r} is not a number; remove the row or correct it"
        return ": cannot be read as numbers; remove the row"

    def _decimal_comma(self, rows: list[tuple[int, str]], places: Sequence[int], names: Sequence[str]) -> bool:
        """Whether the columns asked for have decimal commas. Raises TippathError where both styles occur in them."""
        comma = point = ""
        for number, line in rows:
            found = self.layout.cells(line)
            for place, name in zip(places, names, strict=True):
                cell = found[place].strip()
                comma = cell if "," in cell and is_number(cell) else comma
                point = cell if "." in cell else point
                if (comma and point) or ("," in cell and "." in cell):
                    other = f" beside {(point if cell == comma else comma)[:SHOWN]!r}" if cell in (comma, point) else ""
                    raise TippathError(
                        f"{self.path}, line {number}, column {name}: {cell[:SHOWN]!r}{other}: is the comma a decimal "
                        "or a thousand? Write all decimals alike and thousands without a mark"
                    )
        return bool(comma)

    def _another(self, name: str, lines: Sequence[str]) -> FloatArray:
        """A column that is not required, of sound rows."""
        place = self.column(name)
        assert place is not None
        if not self.layout.mixed:
            try:
                table = _load(_filled(lines, self.layout), self.layout, [place])
            except (ValueError, OverflowError, csv.Error):
                table = np.empty((0, 1))
            if table.shape[0] == len(lines):
                return np.where(np.isfinite(table[:, 0]), table[:, 0], np.nan)
        return self._leniently(name, lines)

    def _leniently(self, name: str, lines: Sequence[str]) -> FloatArray:
        """A column that is not required: nan for whatever is no number."""
        place = self.column(name)
        assert place is not None
        values = np.full(len(lines), np.nan)
        for i, line in enumerate(lines):
            cell = self.layout.cells(line)[place]
            value = _value(cell.replace(",", ".") if self.layout.mixed else cell)
            values[i] = math.nan if value is None else value
        return values

    def read_again(self, name: str, rows: Rows) -> FloatArray:
        """Another column for rows that were read before."""
        place = self.column(name)
        assert place is not None
        table = self._at_once([place])
        if table is not None and table[0].size == rows.lines.size:
            return np.where(np.isfinite(table[0]), table[0], np.nan)
        lines = self.layout.body.split("\n")
        return self._another(name, [lines[number - self.layout.first_line] for number in rows.lines.tolist()])


class CsvTable:
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
    def sampled_s(self) -> float:
        return float(self._t[-1] - self._t[0])

    def texts(self) -> Sequence[tuple[float, str]]:
        return ()

    def modes(self) -> Sequence[tuple[float, int]]:
        return ()

    def armed(self) -> Sequence[tuple[float, bool]]:
        return ()

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
            do = f"the profile takes the time from it; name one of {', '.join(file.header[:LISTED])}"
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
        notes.append(f"{_count(len(lines), 'row')} left out, whose times break the order: {_listed(lines)}")
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


_COMMENT = re.compile(r"(?m)^[ \t]*(?:#|%|//)")


def _load(stream: io.StringIO, layout: Layout, places: Sequence[int]) -> FloatArray:
    delimiter = None if layout.separator == " " else layout.separator
    return np.loadtxt(stream, delimiter=delimiter, usecols=places, ndmin=2, comments=None, quotechar='"')


def _has_empty(text: str, layout: Layout) -> bool:
    """Whether empty cells occur, which numpy refuses."""
    mark = layout.separator
    if mark == " ":
        return False
    return (
        mark * 2 in text or f"\n{mark}" in text or text.startswith(mark) or _blank_cell(mark).search(text) is not None
    )


def _blank_cell(mark: str) -> re.Pattern[str]:
    return re.compile(rf"{re.escape(mark)} *(?:{re.escape(mark)}|\n|$)")


def _filled(lines: Sequence[str], layout: Layout) -> io.StringIO:
    """Rows with nan in their empty cells."""
    text = "\n".join(lines)
    if _has_empty(text, layout):
        mark = re.escape(layout.separator)
        text = re.sub(rf"(?m)(^|(?<={mark}))[ ]*(?={mark}|$)", "nan", text)
    return io.StringIO(text)


def _value(cell: str) -> float | None:
    """nan for an empty cell, None for what is no number."""
    text = cell.strip()
    if not text:
        return math.nan
    if "_" in text or not text.isascii():
        return None
    try:
        return float(text)
    except ValueError:
        return None


def _count(number: int, word: str) -> str:
    return f"{number} {word}{'' if number == 1 else 's'}"


def _listed(lines: Sequence[int]) -> str:
    shown = ", ".join(str(line) for line in lines[:LISTED])
    return f"line{'' if len(lines) == 1 else 's'} {shown}" + ("" if len(lines) <= LISTED else ", ...")


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
        found, before = layout.cells(last), layout.cells(whole.rpartition("\n")[2])
    except csv.Error:
        return body, "", ""
    if not last.strip() or not found or not before:
        return body, "", ""
    half = len(found) == len(before) and is_number(before[-1]) and not is_number(found[-1]) and before[-1].strip() != ""
    if not (len(found) < len(layout.header) or half):
        return body, "", ""
    number = layout.first_line + body.count("\n")
    told = f"{len(found)} of {len(layout.header)} columns"
    return whole + "\n", last, f"the last line, {number}, is half written ({told}) and left out"
