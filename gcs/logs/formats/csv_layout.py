"""How a CSV file is laid out: its encoding, its separator, its header, its units, the style of its decimals.

Nothing is asked of the user that the file itself tells. UTF-8 goes first (damaged bytes spoil their own line only),
UTF-16 shows by its mark or its zeros, and what is neither is read as Windows' western code page. The separator is the
one under which the header and most of the first rows have equally many cells. Units stand in brackets behind a name
(`p [deg/s]`) or in a row of their own below the header.
"""

from __future__ import annotations

import codecs
import csv
import re
from collections.abc import Sequence
from dataclasses import dataclass

from gcs.errors import TippathError
from gcs.logs.words import printable

SHOWN = 30  # characters of a wrong value in a message
SEPARATORS = ("\t", ";", "|", ",", " ")
WORDS = {"\t": "tabs", ";": "semicolons", "|": "bars", ",": "commas", " ": "blanks"}
COMMENTS = ("#", "%", "//")
SAMPLE = 50  # rows that are looked at to find the separator
LONGEST_LINE = 1 << 20  # characters; some 50,000 columns
HEAD = 4096  # bytes that decide the encoding

_MARKS = (
    (codecs.BOM_UTF8, "utf-8"),
    (codecs.BOM_UTF16_LE, "utf-16-le"),
    (codecs.BOM_UTF16_BE, "utf-16-be"),
)
_NAME_AND_UNIT = re.compile(r"^(.*?\S)\s*(?:\[(?!\d+\])([^\[\]]*)\]|\(([^()]*)\))$")
_DECIMAL_COMMA = re.compile(r"\d,\d")
_DECIMAL_POINT = re.compile(r"\d\.\d")
_NUMBER = re.compile(r"^[+-]?(\d+([.,]\d*)?|[.,]\d+)([eE][+-]?\d+)?$|^[+-]?(nan|inf|infinity)$", re.IGNORECASE)


@dataclass(frozen=True, kw_only=True)
class Layout:
    """A CSV file's text and how to read it."""

    path: str
    header: tuple[str, ...]
    """Column names as they stand in the file."""
    names: tuple[str, ...]
    """The same without a unit in brackets."""
    units: tuple[str, ...]
    """Unit of each column as written, empty where none is."""
    separator: str
    width: int
    """Cells in a whole row; one more than the header's where rows end in a separator."""
    body: str
    """The rows, with \\n as line end; decimal commas are points already, unless `mixed`."""
    first_line: int
    """Line of the file (from 1) on which the body begins."""
    encoding: str
    mixed: bool = False
    """Decimal points and commas both occur."""
    padding: int = 0
    """Zero bytes at the end of the file, as a card's preallocated file has them."""
    hints: tuple[str, ...] = ()
    """What was found out and is harmless."""

    def cells(self, line: str) -> list[str]:
        """The cells of a line. Raises csv.Error."""
        return cells(line, self.separator)


def cells(line: str, separator: str) -> list[str]:
    """Split one line. Raises csv.Error for what no quoting rule allows."""
    if '"' not in line:
        return line.split() if separator == " " else line.split(separator)
    if separator == " ":
        return next(csv.reader([line.strip()], delimiter=" ", skipinitialspace=True), [])
    return next(csv.reader([line], delimiter=separator, skipinitialspace=True), [])


def is_number(text: str) -> bool:
    """Whether a cell is a number, with a decimal point or comma."""
    return _NUMBER.match(text.strip()) is not None


def layout_of(raw: bytes, path: str) -> Layout:
    """Find out how a file is laid out. Raises TippathError where it is no text with a header and rows."""
    text, encoding, padding = _text_of(raw)
    _check_lines(text, path)
    lines = _Lines(text)
    heading = _header_line(lines, _top(lines, path, padding), path)
    header = tuple(printable(name.strip()) for name in _split(heading.line, heading.separator, path, heading.number))
    if len(header) > 1 and not header[-1] and not _fills_last(lines.ahead(SAMPLE), heading.separator, len(header)):
        header = header[:-1]
    _check(header, path, heading.number)
    names, units = _names_and_units(header)
    at, below = _units_below(lines, heading.separator, len(header))
    units = [unit or other for unit, other in zip(below, units, strict=True)] if below is not None else units
    body = text[at:].replace("\t", " ") if heading.separator == " " else text[at:]
    if not body.strip():
        raise TippathError(f"{path}, line {heading.number}: a header and no rows; the log has no samples")
    body, mixed, hints = _decimals(body, heading.separator)
    nameless = [str(place + 1) for place, name in enumerate(header) if place and not name]
    if nameless:
        hints.append(f"without a name, and not used: column {', '.join(nameless)}")
    return Layout(
        path=path,
        header=header,
        names=tuple(names),
        units=tuple(units),
        separator=heading.separator,
        width=_width(body, heading.separator, len(header)),
        body=body,
        first_line=text.count("\n", 0, at) + 1,
        encoding=encoding,
        mixed=mixed,
        padding=padding,
        hints=tuple(hints),
    )


def _check_lines(text: str, path: str) -> None:
    """Refuse a line, among the first, that would take minutes to find a header in."""
    at = 0
    for number in range(1, SAMPLE + 1):
        stop = text.find("\n", at, at + LONGEST_LINE)
        if stop < 0 and len(text) - at > LONGEST_LINE:
            raise TippathError(f"{path}, line {number}: longer than {LONGEST_LINE >> 20} MB, as no row of a log is")
        if stop < 0:
            return
        at = stop + 1


def _text_of(raw: bytes) -> tuple[str, str, int]:
    """The text with \\n as line end, its encoding, and how many zero bytes are left out at its end."""
    text, encoding = _decode(raw)
    whole = len(text)
    text = text.rstrip("\0")
    padding = (whole - len(text)) * (2 if encoding.startswith("utf-16") else 1)
    if "\r" in text:
        text = text.replace("\r\n", "\n").replace("\r", "\n")
    return text, encoding, padding


@dataclass(frozen=True)
class _Top:
    """What stands above the rows."""

    line: str
    """The first that is neither blank nor a comment: a header, or the first row below a header in a comment."""
    number: int
    comment: str
    """The last comment above it that has a text."""
    comment_number: int
    forced: str | None
    """The separator that `sep=;` names, as spreadsheets write it."""


def _top(lines: _Lines, path: str, padding: int) -> _Top:
    forced: str | None = None
    comment, comment_number = "", 0
    while (line := lines.take()) is not None:
        stripped = line.strip()
        if forced is None and re.fullmatch(r"(?i)sep=.", stripped) and lines.number <= 2:
            forced = stripped[-1]
        elif stripped.startswith(COMMENTS):
            text = stripped.lstrip("#%/ ")
            comment, comment_number = (text, lines.number) if text else (comment, comment_number)
        elif stripped:
            if any(not c.isprintable() and c != "\t" for c in line):
                raise TippathError(f"{path}, line {lines.number}: not text; is it a binary log with the wrong name?")
            return _Top(line, lines.number, comment, comment_number, forced)
    what = "nothing but zero bytes" if padding and not lines.text else "the file is empty"
    raise TippathError(f"{path}: {what}; it needs a header such as t,p,q,delta_x,delta_y")


@dataclass(frozen=True)
class _Header:
    line: str
    number: int
    separator: str


def _header_line(lines: _Lines, top: _Top, path: str) -> _Header:
    """The line that names the columns, which may be a comment, and what separates them."""
    sample = lines.ahead(SAMPLE)
    if not _is_row(top.line):
        return _Header(top.line, top.number, _separator(top.line, sample, path, top.number, top.forced) or ",")
    comment, number = top.comment, top.comment_number
    separator = _separator(comment, [top.line, *sample], path, number, top.forced) if comment else None
    if separator is None or len(_split(comment, separator, path, number)) < 2:
        raise TippathError(
            f"{path}, line {top.number}: the first line holds numbers, not names; put a header first, such as "
            "t,p,q,delta_x,delta_y; a frequency response's columns are named by a profile instead: [response] input = "
            '"delta_y", output = "q", columns = ["omega", "real", "imaginary"]'
        )
    lines.back()
    return _Header(comment, number, separator)


def _names_and_units(header: Sequence[str]) -> tuple[list[str], list[str]]:
    """`p [deg/s]` is p in deg/s; no unit is empty."""
    names, units = list(header), [""] * len(header)
    for i, name in enumerate(header):
        if match := _NAME_AND_UNIT.match(name):
            names[i], units[i] = match[1], (match[2] if match[2] is not None else match[3]).strip()
    return names, units


def _units_below(lines: _Lines, separator: str, columns: int) -> tuple[int, list[str] | None]:
    """Where the rows begin, and the units of a row of their own below the header, where there is one."""
    at = lines.position
    below = lines.take()
    while below is not None and not below.strip():
        at = lines.position
        below = lines.take()
    units = None if below is None else _units_row(below, separator, columns)
    return (at if units is None else lines.position), units


def _decimals(body: str, separator: str) -> tuple[str, bool, list[str]]:
    """The rows with decimal commas made points, whether both styles occur, and hints about separator and decimals."""
    if separator == ",":
        return body, False, []
    hints = [f"columns are separated by {WORDS.get(separator, separator)}"]
    if not _DECIMAL_COMMA.search(body):
        return body, False, hints
    if _DECIMAL_POINT.search(body):
        return body, True, hints
    return body.replace(",", "."), False, [*hints, "decimals are written with commas"]


class _Lines:
    """Lines of a text, one after the other, with their numbers; the rest of the text stays in one piece."""

    def __init__(self, text: str) -> None:
        self.text, self.position, self.number = text, 0, 0
        self._before = 0

    def take(self) -> str | None:
        if self.position >= len(self.text):
            return None
        self._before = self.position
        stop = self.text.find("\n", self.position)
        stop = len(self.text) if stop < 0 else stop
        line = self.text[self.position : stop]
        self.position = min(stop + 1, len(self.text))
        self.number += 1
        return line

    def back(self) -> None:
        """Give the line taken last back."""
        self.position = self._before
        self.number -= 1

    def ahead(self, count: int) -> list[str]:
        """The next lines that are neither blank nor comments."""
        next_lines: list[str] = []
        at = self.position
        while at < len(self.text) and len(next_lines) < count:
            stop = self.text.find("\n", at)
            stop = len(self.text) if stop < 0 else stop
            line = self.text[at:stop]
            if line.strip() and not line.lstrip().startswith(COMMENTS):
                next_lines.append(line)
            at = stop + 1
        return next_lines


def _decode(raw: bytes) -> tuple[str, str]:
    for mark, encoding in _MARKS:
        if raw.startswith(mark):
            return raw[len(mark) :].decode(encoding, "replace"), encoding
    if len(raw) > 7 and raw[0] and not any(raw[1:8:2]) and all(raw[0:8:2]):
        return raw.decode("utf-16-le", "replace"), "utf-16-le"
    if len(raw) > 7 and raw[1] and not any(raw[0:8:2]) and all(raw[1:8:2]):
        return raw.decode("utf-16-be", "replace"), "utf-16-be"
    try:
        return raw.decode("utf-8"), "utf-8"
    except UnicodeDecodeError:
        head = raw[:HEAD]
    try:  # damage further on spoils its own lines only
        head[: head.rfind(b"\n") + 1 or len(head)].decode("utf-8")
        return raw.decode("utf-8", "replace"), "utf-8"
    except UnicodeDecodeError:
        return raw.decode("cp1252", "replace"), "cp1252"


def _is_row(line: str) -> bool:
    """Whether all cells of a line are numbers, whatever separates them."""
    return any(
        all(is_number(cell) for cell in parts)
        for separator in SEPARATORS
        if (parts := line.strip().strip(separator).split(separator if separator != " " else None))
    )


def _separator(header: str, sample: Sequence[str], path: str, number: int, forced: str | None) -> str | None:
    """The separator under which the header and most of the sample have equally many cells; None for one column."""
    if forced is not None:
        return forced
    best: tuple[float, int, str] | None = None
    for separator in SEPARATORS:
        try:
            count = len(_trimmed(cells(header.strip(), separator)))
        except csv.Error as error:
            raise TippathError(f"{path}, line {number}: cannot be read ({error}); is it a CSV file?") from error
        if count < 2:
            continue
        same = sum(1 for line in sample if _count(line, separator) == count)
        # Where nothing fits, the error is told for commas, or what the header has most of.
        score = (same / len(sample) if sample else 1.0, (separator != " ") * count, separator)
        if best is None or score[:2] > best[:2]:
            best = score
    return None if best is None else best[2]


def _trimmed(parts: list[str]) -> list[str]:
    return parts[:-1] if len(parts) > 1 and not parts[-1].strip() else parts


def _count(line: str, separator: str) -> int:
    try:
        return len(_trimmed(cells(line, separator)))
    except csv.Error:
        return 0


def _split(line: str, separator: str, path: str, number: int) -> list[str]:
    try:
        return cells(line.strip() if separator != "\t" else line.strip(" "), separator)
    except csv.Error as error:
        raise TippathError(f"{path}, line {number}: cannot be read ({error}); is it a CSV file?") from error


def _check(header: Sequence[str], path: str, number: int) -> None:
    where = f"{path}, line {number}"
    last = max((place for place, name in enumerate(header) if name), default=0)
    seen: set[str] = set()
    for place, name in enumerate(header):
        if not name and 0 < place < last:  # the first is the row number of many programs
            raise TippathError(f"{where}, column {place + 1}: no name in the header; name it or remove the column")
        if name and name in seen:
            raise TippathError(f"{where}, column {place + 1}: {name[:SHOWN]!r} stands twice in the header; rename one")
        seen.add(name)


def _fills_last(sample: Sequence[str], separator: str, columns: int) -> bool:
    """Whether rows have something in the last of so many columns."""
    try:
        rows = [cells(line, separator) for line in sample]
    except csv.Error:
        return False
    return any(len(row) == columns and row[-1].strip() for row in rows)


def _units_row(line: str, separator: str, columns: int) -> list[str] | None:
    """The cells of a row without any number; None where it is a row of values."""
    try:
        units = [printable(cell.strip()).strip("[]()") for cell in cells(line, separator)]
    except csv.Error:
        return None
    if len(units) > columns and not any(units[columns:]):
        units = units[:columns]
    if len(units) != columns or not any(units) or any(is_number(cell) and cell != "1" for cell in units):
        return None
    return units if any(not is_number(cell) for cell in units if cell) else None


def _width(body: str, separator: str, columns: int) -> int:
    """Cells of a row: one more than there are names where most of the first rows end in a separator."""
    if separator == " ":
        return columns
    sample = _Lines(body).ahead(SAMPLE)
    longer = 0
    for line in sample:
        try:
            row = cells(line, separator)
        except csv.Error:
            continue
        longer += len(row) == columns + 1 and not row[-1].strip()
    return columns + 1 if longer > len(sample) / 2 else columns
