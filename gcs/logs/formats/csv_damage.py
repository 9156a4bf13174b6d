"""Rows of a CSV sorted out, sound from damaged, where the file cannot be read at once.

Blocks of rows are read, and a block that is refused is halved until the wrong rows stand alone. They are left out,
counted as damage and named by line; a file with more than a few of them is no damaged log but a misunderstanding, and
refused with the line, the column and what to do.

An empty cell, or nan, is not damage: the logger had no sample.
"""

from __future__ import annotations

import csv
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from gcs.errors import TippathError
from gcs.logs.formats.csv_cells import filled, load, value_of
from gcs.logs.formats.csv_layout import COMMENTS, SHOWN, Layout, is_number
from gcs.logs.formats.tables import FloatArray

IntArray = NDArray[np.int64]
Row = tuple[int, str]
"""Line of the file, from 1, and its text."""

FEW_ROWS = 3  # may be wrong in any file of `ENOUGH` rows...
ENOUGH = 100
WRONG_SHARE = 0.01  # ... and this share of a long one
BLOCK = 4096  # rows read at a time where not all can be
SPARSE = 0.01  # share of empty cells from which a column has a clock of its own
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


@dataclass(frozen=True)
class _Wrong:
    """A damaged row."""

    line: str
    reason: str
    """Behind `FILE, line 12`: `, column p: 'x' is not a number; ...`."""


def sorted_out(layout: Layout, required: Mapping[str, int], others: Mapping[str, int]) -> Rows:
    """The sound rows of a file, with some columns (name -> place) of them.

    Raises TippathError naming line and column where too much is wrong.
    """
    sound, wrong, headers = _by_shape(layout, required)
    kept, columns = _in_numbers(layout, sound, required, wrong)
    total = len(kept) + len(wrong)
    if len(wrong) > allowed(total) or not kept:
        first = min(wrong) if wrong else layout.first_line
        reason = wrong[first].reason if wrong else ": no rows"
        more = f" ({len(wrong)} of {total} rows are wrong)" if len(wrong) > 1 else ""
        raise TippathError(f"{layout.path}, line {first}{reason}{more}")
    values = dict(zip(required, columns, strict=True))
    lines = [line for _, line in kept]
    for name, place in others.items():
        values[name] = another_column(layout, place, lines)
    numbers = np.asarray([number for number, _ in kept], np.int64)
    order = sorted([*wrong, *(number for number, _ in kept)])
    notes = []
    if wrong:
        notes.append(f"{count_of(len(wrong), 'row')} damaged and left out: {listed(sorted(wrong))}")
    if headers:
        notes.append(f"the header stands {headers} times more among the rows: the logger began anew")
    return Rows(
        values,
        numbers,
        tuple((number, _bytes(layout, wrong[number].line)) for number in sorted(wrong)),
        sum(1 for a, b in pairwise(order) if a in wrong and b not in wrong),
        (*notes, *note_on_empty(layout.path, values, list(required), numbers)),
    )


def note_on_empty(
    path: str, values: Mapping[str, FloatArray], required: Sequence[str], lines: IntArray
) -> tuple[str, ...]:
    """A note on rows without a value where nearly all have one. Raises TippathError for a column without any."""
    empty = np.zeros(lines.size, np.bool_)
    for name in required:
        missing = ~np.isfinite(values[name])
        if missing.all():
            raise TippathError(
                f"{path}, line {lines[0]}, column {name}: no number in the whole column; take another column "
                "in a profile: --profile FILE.toml"
            )
        if np.mean(missing) <= SPARSE:
            empty |= missing
    if not empty.any():
        return ()
    at = lines[empty].tolist()
    return (f"{count_of(len(at), 'row')} without a finite number in a needed column, left out: {listed(at)}",)


def another_column(layout: Layout, place: int, lines: Sequence[str]) -> FloatArray:
    """A column that is not required, of sound rows: nan for whatever is no number. Shape (lines,)."""
    if not layout.mixed:
        try:
            table = load(filled(lines, layout), layout, [place])
        except (ValueError, OverflowError, csv.Error):
            table = np.empty((0, 1))
        if table.shape[0] == len(lines):
            return np.where(np.isfinite(table[:, 0]), table[:, 0], np.nan)
    values = np.full(len(lines), np.nan)
    for i, line in enumerate(lines):
        cell = layout.cells(line)[place]
        value = value_of(cell.replace(",", ".") if layout.mixed else cell)
        values[i] = math.nan if value is None else value
    return values


def _bytes(layout: Layout, line: str) -> int:
    return len(line.encode(layout.encoding, "replace")) + (2 if "16" in layout.encoding else 1)


# ------------------------------------------------------------------------------------------------ by their shape


def _by_shape(layout: Layout, required: Mapping[str, int]) -> tuple[list[Row], dict[int, _Wrong], int]:
    """Rows as long as they should be, the damaged ones by line, and how often the header comes again."""
    sound: list[Row] = []
    wrong: dict[int, _Wrong] = {}
    headers = 0
    for number, line in enumerate(layout.body.split("\n"), layout.first_line):
        if not line.strip() or line.lstrip().startswith(COMMENTS):
            continue
        if _is_plain(layout, line):
            sound.append((number, line))
            continue
        reason = _not_text(layout, line, required)
        if reason is None:
            cells, reason = _cells(layout, line)
            if reason is None and _is_header(layout, cells):
                headers += 1
                continue
        if reason is None:
            sound.append((number, line))
        else:
            wrong[number] = _Wrong(line, reason)
    return sound, wrong, headers


def _is_plain(layout: Layout, line: str) -> bool:
    """Whether a row is of the right length at first sight, as nearly all are."""
    return (
        layout.separator != " "
        and line.count(layout.separator) == layout.width - 1
        and line.isprintable()
        and line.isascii()
        and '"' not in line
        and line.lstrip()[:1] != layout.header[0][:1]
    )


def _not_text(layout: Layout, line: str, required: Mapping[str, int]) -> str | None:
    """What is wrong with a row that is no text; None where it is, or where a required column's own error says it."""
    if "\ufffd" not in line and line.replace("\t", " ").isprintable():
        return None
    zero = " (a zero byte)" if "\0" in line else ""
    if not zero and any(_is_odd(layout, line, place) for place in required.values()):
        return None
    return f": not text{zero}; is the file damaged, or a binary log with the wrong name?"


def _is_odd(layout: Layout, line: str, place: int) -> bool:
    try:
        cell = layout.cells(line)[place]
    except (csv.Error, IndexError):
        return False
    return not cell.isprintable() or "\ufffd" in cell


def _cells(layout: Layout, line: str) -> tuple[list[str], str | None]:
    """The cells of a row, and what is wrong with their number."""
    try:
        cells = layout.cells(line)
    except csv.Error as error:
        return [], f": cannot be read ({error}); remove the row"
    columns = len(layout.header)
    if len(cells) == layout.width or (len(cells) == columns and layout.width > columns):
        return cells, None
    advice = (
        "is the line cut, or a decimal comma used? With decimal commas, separate columns by semicolons or tabs"
        if layout.separator == ","
        else "is the line cut, or the separator another one?"
    )
    return cells, f": {len(cells)} columns where the header has {columns}; {advice}"


def _is_header(layout: Layout, cells: Sequence[str]) -> bool:
    return tuple(cell.strip() for cell in cells[: len(layout.header)]) == layout.header


# ------------------------------------------------------------------------------------------------ by their numbers


def _in_numbers(
    layout: Layout, rows: list[Row], required: Mapping[str, int], wrong: dict[int, _Wrong]
) -> tuple[list[Row], list[FloatArray]]:
    """The rows whose required cells are numbers, and those columns, shape (rows,) each; the others go to `wrong`.

    Blocks that numpy refuses are halved. Where more than are allowed are wrong, the columns are nan: whoever asked
    refuses the file.
    """
    places = list(required.values())
    most = allowed(len(rows))
    comma = layout.mixed and _decimal_comma(layout, rows, required)
    kept: list[Row] = []
    parts: list[FloatArray] = []
    blocks = [rows[i : i + BLOCK] for i in range(0, len(rows), BLOCK)][::-1]
    while blocks:
        block = blocks.pop()
        lines = [line.replace(",", ".") if comma else line for _, line in block]
        table = _block(layout, lines, places)
        if table is None and len(block) > 1:
            half = len(block) // 2
            blocks += [block[half:], block[:half]]
            continue
        if table is None:
            table = _alone(layout, lines[0], places)
        if table is None:
            number, line = block[0]
            wrong[number] = _Wrong(line, _what_is_wrong(layout, line, required))
            if len(wrong) > most:  # refused anyway, whatever follows
                kept += [row for rest in blocks for row in rest]
                return kept, [np.full(len(kept), np.nan) for _ in places]
            continue
        kept += block
        parts.append(table)
    whole = np.concatenate(parts) if parts else np.empty((0, len(places)))
    whole[~np.isfinite(whole)] = np.nan
    return kept, [np.ascontiguousarray(whole[:, i]) for i in range(len(places))]


def _block(layout: Layout, lines: Sequence[str], places: Sequence[int]) -> FloatArray | None:
    """Rows as numbers, shape (rows, columns); None where numpy refuses them."""
    try:
        table = load(filled(lines, layout), layout, places)
    except (ValueError, OverflowError, csv.Error):
        return None
    return table if table.shape[0] == len(lines) else None


def _alone(layout: Layout, line: str, places: Sequence[int]) -> FloatArray | None:
    cells = layout.cells(line)
    values = [value_of(cells[place]) for place in places]
    return None if None in values else np.array([values], np.float64)


def _what_is_wrong(layout: Layout, line: str, required: Mapping[str, int]) -> str:
    cells = layout.cells(line)
    for name, place in required.items():
        cell = cells[place].strip()
        if value_of(cell) is None:
            if layout.separator == "," and "," in cell and is_number(cell):
                return (
                    f", column {name}: {cell[:SHOWN]!r} may be a thousand or a decimal comma; write decimals with "
                    "points and thousands without a mark"
                )
            return f", column {name}: {cell[:SHOWN]!r} is not a number; remove the row or correct it"
    return ": cannot be read as numbers; remove the row"


def _decimal_comma(layout: Layout, rows: Sequence[Row], required: Mapping[str, int]) -> bool:
    """Whether the columns asked for have decimal commas. Raises TippathError where both styles occur in them."""
    comma = point = ""
    for number, line in rows:
        cells = layout.cells(line)
        for name, place in required.items():
            cell = cells[place].strip()
            comma = cell if "," in cell and is_number(cell) else comma
            point = cell if "." in cell else point
            if (comma and point) or ("," in cell and "." in cell):
                other = f" beside {(point if cell == comma else comma)[:SHOWN]!r}" if cell in (comma, point) else ""
                raise TippathError(
                    f"{layout.path}, line {number}, column {name}: {cell[:SHOWN]!r}{other}: is the comma a decimal "
                    "or a thousand? Write all decimals alike and thousands without a mark"
                )
    return bool(comma)


def count_of(number: int, word: str) -> str:
    """`1 row`, `3 rows`."""
    return f"{number} {word}{'' if number == 1 else 's'}"


def listed(lines: Sequence[int]) -> str:
    """`lines 3, 7, ...`: the first few numbers."""
    shown = ", ".join(str(line) for line in lines[:LISTED])
    return f"line{'' if len(lines) == 1 else 's'} {shown}" + ("" if len(lines) <= LISTED else ", ...")
