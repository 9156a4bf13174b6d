"""CSV files of numbers under a header of names: fast where they are right, exact about what is wrong where not.

numpy's reader takes the whole file at once. Only when it refuses, or what it read is not all finite numbers, are the
lines looked at one by one, to tell the user the line, the column and what to do.

Two things are forgiven, because they are how files come: comment lines (#) before the header, or the header itself
behind a #, as numpy writes it; and a last line that was being written when the power went, which is left out and said.
"""

from __future__ import annotations

import codecs
import csv
import io
import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from gcs.errors import TippathError
from gcs.logs.tables import FloatArray, Series

_SHOWN = 30  # characters of a wrong value in a message
_UTF16 = (codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)


@dataclass(frozen=True, eq=False)
class CsvFile:
    """The text of a file and its header; columns are read when asked for."""

    path: str
    header: tuple[str, ...]
    _body: str
    _header_line: int
    notes: tuple[str, ...] = ()
    """What was left out."""

    @classmethod
    def read(cls, path: Path) -> CsvFile:
        """Raises TippathError where the file cannot be read as comma-separated text with a header."""
        try:
            raw = path.read_bytes()
        except OSError as error:
            raise TippathError(f"{path}: cannot be read ({error.strerror or error})") from error
        return cls.parse(raw, str(path))

    @classmethod
    def parse(cls, raw: bytes, path: str) -> CsvFile:
        """As `read`, from the file's bytes. A UTF-8 byte order mark is taken off."""
        if raw.startswith(_UTF16):
            raise TippathError(f"{path}, line 1: the file is UTF-16; save it again as UTF-8 (or plain ASCII) CSV")
        try:
            text = raw.decode("utf-8-sig")
        except UnicodeDecodeError as error:
            number = raw.count(b"\n", 0, error.start) + 1
            raise TippathError(
                f"{path}, line {number}: not text (byte 0x{raw[error.start]:02x}); save it again as UTF-8 CSV"
            ) from error
        if "\0" in text:
            number = text.count("\n", 0, text.index("\0")) + 1
            raise TippathError(
                f"{path}, line {number}: not text (a zero byte); is it a binary log with the wrong name?"
            )
        if "\r" in text:
            text = text.replace("\r\n", "\n").replace("\r", "\n")
        start, number, comment = 0, 1, ""
        while True:  # the header is the first line that is neither blank nor a comment
            stop = text.find("\n", start)
            line = text[start : stop if stop >= 0 else len(text)].strip()
            if line and not line.startswith("#"):
                break
            if stop < 0:
                raise TippathError(f"{path}: the file is empty; it needs a header such as t,p,q,delta_x,delta_y")
            comment = line.lstrip("# ") or comment
            start, number = stop + 1, number + 1
        if _are_numbers(_cells(line, path, number)) and len(_cells(comment, path, number - 1)) > 1:
            line, stop, number = comment, start - 1, number - 1
        header = _header(line, path, number)
        body = text[stop + 1 :] if stop >= 0 else ""
        body, note = _without_half_line(body, len(header), number)
        if not body.strip():
            raise TippathError(f"{path}, line {number}: a header and no rows; the log has no samples")
        return cls(path, header, body, number, (note,) if note else ())

    def columns(self, names: Sequence[str]) -> dict[str, FloatArray]:
        """Some columns by name, each of shape (n,), all finite.

        Raises TippathError naming line and column of the first value that is no finite number, KeyError for a name
        that is not in the header.
        """
        if not names:
            return {}
        places = [self.header.index(name) if name in self.header else -1 for name in names]
        if -1 in places:
            raise KeyError(names[places.index(-1)])
        try:
            table = np.loadtxt(
                io.StringIO(self._body), delimiter=",", usecols=places, ndmin=2, comments=None, quotechar='"'
            )
        except (ValueError, OverflowError, csv.Error) as error:
            self._complain(names, places)
            raise TippathError(f"{self.path}: cannot be read as numbers ({error})") from error
        if not np.all(np.isfinite(table)):
            self._complain(names, places)
        if '"' not in self._body and self._body.count(",") != table.shape[0] * (len(self.header) - 1):
            self._complain(names, places)
        return {name: np.ascontiguousarray(table[:, i]) for i, name in enumerate(names)}

    def line_of(self, row: int) -> int:
        """Line of the file (from 1) in which the data row (from 0) stands."""
        for number, (line, _) in enumerate(self._rows()):
            if number == row:
                return line
        return self._header_line

    def _rows(self) -> Iterator[tuple[int, list[str]]]:
        reader = csv.reader(io.StringIO(self._body))
        while True:
            try:
                cells = next(reader)
            except StopIteration:
                return
            except csv.Error as error:
                raise TippathError(
                    f"{self.path}, line {self._header_line + reader.line_num}: cannot be read ({error})"
                ) from error
            if cells:
                yield self._header_line + reader.line_num, cells

    def _complain(self, names: Sequence[str], places: Sequence[int]) -> None:
        """Raise for the first wrong row; return where all of them are right after all."""
        for line, cells in self._rows():
            if len(cells) != len(self.header):
                raise TippathError(
                    f"{self.path}, line {line}: {len(cells)} columns where the header has {len(self.header)}; "
                    "is the line cut, or a decimal comma used? Columns are separated by commas, decimals by points"
                )
            for name, place in zip(names, places, strict=True):
                cell = cells[place].strip()
                where = f"{self.path}, line {line}, column {name}"
                if not cell:
                    raise TippathError(f"{where}: empty; remove the row, gaps in time are allowed")
                try:
                    value = float(cell)
                except ValueError:
                    raise TippathError(
                        f"{where}: {cell[:_SHOWN]!r} is not a number; remove the row or correct it"
                    ) from None
                if not math.isfinite(value):
                    raise TippathError(
                        f"{where}: {cell[:_SHOWN]} is not a finite number; remove the row, gaps are allowed"
                    )


class CsvTable:
    """A CSV file; keys are column names, and all columns share the time column's clock."""

    kind = "csv"

    def __init__(self, file: CsvFile, path: str, time_column: str = "t", time_scale: float = 1.0) -> None:
        self.file = file
        self.path = path
        self.time_column = time_column
        self._scale = time_scale
        self.dropped: dict[str, int] = {}
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

    @property
    def sampled_s(self) -> float:
        t = self.time()
        return float(t[-1] - t[0])

    def texts(self) -> Sequence[tuple[float, str]]:
        return ()

    def modes(self) -> Sequence[tuple[float, int]]:
        return ()

    def armed(self) -> Sequence[tuple[float, bool]]:
        return ()

    def _column(self, key: str) -> FloatArray:
        if key not in self._columns:
            self.load([key])
        return self._columns[key]


def _header(line: str, path: str, number: int) -> tuple[str, ...]:
    names = tuple(name.strip() for name in _cells(line, path, number))
    where = f"{path}, line {number}"
    if len(names) == 1:
        for separator, word in ((";", "semicolons"), ("\t", "tabs"), ("|", "bars"), (" ", "blanks")):
            if separator in line:
                raise TippathError(
                    f"{where}: columns are separated by {word}; save it with commas (and decimal points)"
                )
    if _are_numbers(names):
        raise TippathError(
            f"{where}: the first line holds numbers, not names; put a header first, such as t,p,q,delta_x,delta_y"
        )
    for place, name in enumerate(names):
        if not name:
            raise TippathError(f"{where}, column {place + 1}: no name in the header; name it or remove the column")
        if name in names[:place]:
            raise TippathError(f"{where}, column {place + 1}: {name[:_SHOWN]!r} stands twice in the header; rename one")
    return names


def _cells(line: str, path: str, number: int) -> list[str]:
    try:
        return next(csv.reader([line]), [])
    except csv.Error as error:
        raise TippathError(f"{path}, line {number}: cannot be read ({error}); is it a CSV file?") from error


def _without_half_line(body: str, columns: int, header_line: int) -> tuple[str, str]:
    """The body without a last line that ends in its middle, and a note about it where there is one.

    Such a line has no end, and fewer columns than the header or a last one that is no number where the line before has
    one.
    """
    if body.endswith("\n"):
        return body, ""
    whole, _, last = body.rpartition("\n")
    before = whole.rpartition("\n")[2].split(",")
    cells = last.split(",")
    half = len(cells) == columns and _is_number(before[-1]) and not _is_number(cells[-1])
    if not last.strip() or not (len(cells) < columns or half):
        return body, ""
    number = header_line + 1 + body.count("\n")
    return whole + "\n", f"the last line, {number}, is half written ({len(cells)} of {columns} columns) and left out"


def _are_numbers(cells: Sequence[str]) -> bool:
    return bool(cells) and all(_is_number(cell) for cell in cells)


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True
