"""Text DataFlash (.log, as ground stations write it): lines of a message's name and its values, behind FMT lines.

A line's name and its commas are found with numpy for all lines at once; values are parsed when asked for, column by
column. Which lines can be believed is settled before: the line of a message without strings is regular where each byte
may follow the one before it in a list of plain numbers; every other line is held against the pattern of its format.

A line that is not whole, of the wrong number of columns, or with something that is no number where one is due, is left
out as a whole. So is a last line without an end: its last number may be cut. There are no checksums: a digit that
became another cannot be seen, and the head of one line and the tail of another only when their columns do not fit
together, or by the gap behind it (see `gcs.logs.formats.tables`).
"""

from __future__ import annotations

import hashlib
import re
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gcs.errors import TippathError
from gcs.logs.formats.damage import Damage
from gcs.logs.formats.dataflash_scan import CLOCKS, FMT, TYPES, Format
from gcs.logs.formats.raw import Bytes, Offsets, gathered, read_padded
from gcs.logs.words import printable

STRINGS = "nNZ"
FLOATS = "fdg"
LONGEST_NAME = 4
LONGEST_CELL = 48  # bytes of a number
LONGEST_HEADING = 20  # lines before the first FMT...
LONGEST_WORDS = 80  # ... and bytes of each
CHUNK = 1 << 20  # bytes looked at together: what they need stays in the cache
ROWS = 1 << 15  # cells parsed together
BACK_S = 1.0  # the clock goes back by more, and stays there: a new boot
STAYS = 5
MOST_BREAKS = 100

_NAME = re.compile(rb"[A-Za-z0-9_]{1,4}")
_COLUMN = re.compile(r"[A-Za-z0-9_]+")
_WHOLE = rb"[ \t]*[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d{1,2})?[ \t]*"  # of a whole number, which is always finite
_NUMBER = rb"[ \t]*[+-]?(?:\d+\.?\d*(?:[eE][+-]?\d+)?|\.\d+(?:[eE][+-]?\d+)?|[nN][aA][nN]|[iI]nf(?:inity)?)[ \t]*"
_TEXT = rb"[^,\x00-\x08\x0a-\x1f]*"
_REST = rb"[^\x00-\x08\x0a-\x1f]*"
_WORD = rb"[ \t]*[A-Za-z_(][A-Za-z0-9_ ().+-]*"
_ARRAY = rb"[ \t]*(?:\[[-+0-9., eE]*\]|[-+0-9. eE]*)[ \t]*"
_START = re.compile(rb"(?:\xef\xbb\xbf)?[\s\0]*FMT,")


def recognises(head: bytes) -> bool:
    """Whether a file that begins so is text DataFlash."""
    return _START.match(head) is not None


@dataclass(frozen=True, eq=False)
class _Lines:
    """Where the lines of a file stand."""

    data: Bytes
    """The file and some blanks behind it."""
    first: Offsets
    """First and behind the last byte of every line, without what indents it, shape (lines,)."""
    stop: Offsets

    def text(self, line: int) -> bytes:
        return self.data[self.first[line] : self.stop[line]].tobytes()


@dataclass(frozen=True, eq=False, kw_only=True)
class TextLog:
    """A text log whose lines have been located; columns are parsed when asked for. It is a `MessageLog`."""

    formats: Mapping[str, Format]
    """By message name, those that are declared."""
    damage: Damage
    undeclared: Mapping[str, int]
    """Name of a message without a (readable) FMT -> its lines; they are skipped."""
    _lines: Mapping[str, Offsets]
    """Message -> its lines that can be believed, in the file's order."""
    _where: _Lines
    _commas: Offsets
    """Every comma of the file."""
    _cells: dict[tuple[str, str], NDArray[Any]] = field(default_factory=dict)

    @property
    def notes(self) -> tuple[str, ...]:
        """What is wrong with it."""
        if not self.undeclared:
            return ()
        listed = ", ".join(f"{name} ({count} lines)" for name, count in sorted(self.undeclared.items())[:8])
        return (f"no FMT line for {listed}: their values have no names and are not read",)

    @property
    def names(self) -> tuple[str, ...]:
        return tuple(sorted(name for name, lines in self._lines.items() if lines.size))

    def starts(self, message: str) -> Offsets:
        """The line (from 0) of every message of this type, shape (n,)."""
        return self._lines.get(message, np.empty(0, np.int64))

    def count(self, message: str) -> int:
        return int(self.starts(message).size)

    def column(self, message: str, column: str, starts: Offsets | None = None) -> NDArray[Any]:
        """One field of every message of a type, or of those in the lines `starts`, in the file's order.

        Numbers are float64, strings bytes, arrays (letter a) of shape (n, 32). Raises KeyError.
        """
        fmt = self.formats[message]
        if column not in fmt.columns:
            raise KeyError(f"{message}.{column}")
        key = (message, column)
        lines = self.starts(message)
        if key not in self._cells:
            self._cells[key] = self._parse(fmt, fmt.columns.index(column), lines)
        values = self._cells[key]
        return values if starts is None else values[np.searchsorted(lines, starts)]

    def texts(self, message: str, column: str) -> list[str]:
        """A string field with what is not printable replaced."""
        return [printable(bytes(raw)) for raw in self.column(message, column)]

    def table(self, message: str) -> dict[str, NDArray[Any]]:
        """All columns of one message type."""
        return {name: self.column(message, name) for name in self.formats[message].columns}

    @cached_property
    def boots(self) -> tuple[TextLog, ...]:
        """The log of each boot of the vehicle, in the file's order; the log itself where there is one."""
        firsts = self._boot_lines()
        if not firsts:
            return (self,)
        edges = [0, *firsts, self._where.first.size]
        return tuple(
            replace(
                self,
                _lines={
                    name: lines[slice(*np.searchsorted(lines, (start, stop)))] for name, lines in self._lines.items()
                },
                _cells={},
            )
            for start, stop in pairwise(edges)
        )

    def _boot_lines(self) -> list[int]:
        """The first line of each boot but the first: where the clock goes back for good."""
        lines, times = [], []
        for name, fmt in self.formats.items():
            clock = next((column for column in CLOCKS if column in fmt.columns), None)
            if clock is not None and self.starts(name).size:
                lines.append(self.starts(name))
                times.append(self.column(name, clock) * CLOCKS[clock])
        if not lines:
            return []
        at, t = np.concatenate(lines), np.concatenate(times)
        at, t = at[np.isfinite(t)], t[np.isfinite(t)]
        order = np.argsort(at)
        at, t = at[order], t[order]
        firsts = []
        for k in np.flatnonzero(np.diff(t) < -BACK_S)[:MOST_BREAKS].tolist():
            before = float(np.median(t[max(0, k + 1 - STAYS) : k + 1]))
            after = t[k + 1 :]
            back = before - float(np.median(after[:STAYS]))
            again = np.flatnonzero(after >= before)[:1]
            # lines that stand in the wrong place, or twice, are no boot: behind them the clock jumps to where it was
            jump = np.diff(after[: int(again[0]) + 1]).max(initial=0.0) if again.size else 0.0
            if after.size >= STAYS and back > BACK_S and jump < 0.5 * back:
                declared = self.starts("FMT")
                declared = declared[(declared > at[k]) & (declared < at[k + 1])]
                firsts.append(int(declared[0] if declared.size else at[k + 1]))
        return firsts

    def _parse(self, fmt: Format, place: int, lines: Offsets) -> NDArray[Any]:
        letter = fmt.types[place]
        if "a" in fmt.types:  # its commas are not the columns'
            raw = self._matched(fmt, place, lines)
            return _arrays(raw) if letter == "a" else np.array(raw, "S") if letter in STRINGS else _numbers(raw)
        first = np.searchsorted(self._commas, self._where.first[lines]) + place
        begin = self._commas[first] + 1
        last = place == len(fmt.columns) - 1
        stop = self._where.stop[lines] if last else self._commas[first + 1]
        if letter in STRINGS:
            ends = zip(begin.tolist(), stop.tolist(), strict=True)
            return np.array([self._where.data[a:b].tobytes().strip() for a, b in ends], "S")
        values = np.empty(lines.size)
        for start in range(0, lines.size, ROWS):
            some = slice(start, start + ROWS)
            length = np.minimum(stop[some] - begin[some], LONGEST_CELL)
            width = max(int(length.max()), 1)
            cells = gathered(self._where.data, 0, f"V{width}", begin[some]).view(np.uint8).reshape(-1, width)
            cells[np.arange(width) >= length[:, None]] = ord(" ")
            values[some] = cells.view(f"S{width}").ravel().astype(np.float64)
        return values

    def _matched(self, fmt: Format, place: int, lines: Offsets) -> list[bytes]:
        pattern = _pattern(fmt)
        matches = (pattern.fullmatch(self._where.text(line)) for line in lines.tolist())
        return [match[place + 1].strip() for match in matches if match is not None]


def _numbers(raw: list[bytes]) -> NDArray[np.float64]:
    return np.array([float(cell) for cell in raw], np.float64)


def _arrays(raw: list[bytes]) -> NDArray[np.float64]:
    """Lists of numbers as (n, 32); what is missing is NaN."""
    values = np.full((len(raw), 32), np.nan)
    for row, cell in zip(values, raw, strict=True):
        numbers = re.findall(rb"[-+]?\d+(?:\.\d+)?", cell)[:32]
        row[: len(numbers)] = [float(number) for number in numbers]
    return values


def read(path: Path) -> tuple[TextLog, str]:
    """Read a text log; also the SHA-256 of its bytes. Raises TippathError where it cannot be opened or is none."""
    data, size = read_padded(path, LONGEST_CELL, ord(" "))
    sha256 = hashlib.sha256(data[:size].data).hexdigest()
    return _located(data, size, str(path)), sha256


def parse(raw: bytes, name: str = "log") -> TextLog:
    """Locate the lines of a log. Raises TippathError where it has no FMT line that can be read."""
    return _located(np.frombuffer(raw + b" " * LONGEST_CELL, np.uint8), len(raw), name)


def _located(data: Bytes, size: int, name: str) -> TextLog:
    """As `parse`, from the first `size` bytes, behind which stand blanks."""
    if size == 0:
        raise TippathError(f"{name}: the file is empty; convert it from the .BIN again")
    if not np.any(data[:size] == ord("\n")):
        data = np.where(data == ord("\r"), np.uint8(ord("\n")), data)
    newlines, commas, odd = _marks(data, size)
    first = np.concatenate(([0], newlines + 1))
    stop = np.concatenate((newlines, [size]))
    whole = np.ones(first.size, np.bool_)
    whole[-1] = False  # ends without a newline: may be cut
    indented, first = first, _unindented(data, first, stop)
    zeros = (data[np.minimum(indented, data.size - 1)] == 0) * (first - indented)
    before = np.searchsorted(commas, first)
    columns = np.searchsorted(commas, stop) - before
    names, name_of = _names(data, first, commas, before, columns)
    blank = (first >= stop) & (zeros == 0)
    blank |= (stop - first == 1) & (data[np.minimum(first, data.size - 1)] == ord("\r"))

    where = _Lines(data, first, stop)
    formats = _formats(where, np.flatnonzero((name_of == names.get("FMT", -2)) & whole))
    if not formats:
        raise TippathError(
            f"{name}: not a text DataFlash log: no line FMT, ... that can be read; take the .BIN that it was "
            "made from, or name it .csv where it is a table"
        )
    regular = whole.copy()
    regular[np.searchsorted(stop, np.maximum(odd, 0))] = False
    good = np.zeros(first.size, np.bool_)
    lines: dict[str, Offsets] = {}
    undeclared: dict[str, int] = {}
    unknown = np.zeros(first.size, np.bool_)
    for text, number in names.items():
        its_own = np.flatnonzero((name_of == number) & whole)
        if text not in formats:
            undeclared[text] = int(its_own.size)
            unknown[its_own] = True
            continue
        fmt = formats[text]
        plain = regular[its_own] & (columns[its_own] == len(fmt.columns))
        if any(letter in "a" + STRINGS for letter in fmt.types):
            plain[:] = False
        formats[text], plain = _judge(where, fmt, plain, its_own)
        lines[text] = its_own[plain]
        good[lines[text]] = True
    blank |= _heading(where, np.flatnonzero(columns == 0), lines["FMT"])
    lengths = np.diff(np.concatenate(([0], newlines + 1, [size])))
    unread = int(lengths[~good & ~blank].sum()) + int(zeros[good].sum())
    # a name that few lines bear and no FMT declares is a damaged one
    undeclared = {text: count for text, count in undeclared.items() if count >= 3}
    return TextLog(
        formats=formats,
        damage=_damage(size, unread, good[~blank], unknown[~blank]),
        undeclared=undeclared,
        _lines=lines,
        _where=where,
        _commas=commas,
    )


def _heading(where: _Lines, without_commas: Offsets, formats: Offsets) -> NDArray[np.bool_]:
    """Which lines are the words with which old logs begin (`ArduCopter V3.0.1`, `Free RAM: 1331`), shape (lines,)."""
    heading = np.zeros(where.first.size, np.bool_)
    before = without_commas[without_commas < formats[:1].sum()]
    for line in before[:LONGEST_HEADING].tolist():
        words = where.text(line).rstrip(b"\r")
        heading[line] = len(words) <= LONGEST_WORDS and words.isascii() and words.decode().isprintable()
    return heading


def _marks(data: Bytes, size: int) -> tuple[Offsets, Offsets, Offsets]:
    """Where newlines and commas stand, and places that a line of plain numbers does not have.

    Pairs of bytes that do not follow each other in such a line, a second point in one cell, cells that are too long.
    """
    allowed = _allowed()
    newlines, commas, odd = [], [], []
    last_point, last_mark = -1, -1
    for start in range(0, size, CHUNK):
        stop = min(start + CHUNK, size)
        here = data[start:stop]
        newline, comma, point = here == ord("\n"), here == ord(","), here == ord(".")
        newlines.append(np.flatnonzero(newline) + start)
        commas.append(np.flatnonzero(comma) + start)
        pairs = here.astype(np.uint16) << 8
        pairs |= data[start + 1 : stop + 1]
        odd.append(np.flatnonzero(~allowed[pairs]) + start)
        marks = np.flatnonzero(newline | comma) + start
        odd.append(marks[np.diff(marks, prepend=last_mark) > LONGEST_CELL + 1] - 1)
        points = np.flatnonzero(point) + start
        before = np.searchsorted(marks, points)
        mark = np.where(before > 0, marks[np.maximum(before - 1, 0)] if marks.size else last_mark, last_mark)
        # a point with no mark between it and the one before
        previous = np.concatenate(([last_point], points[:-1])) if points.size else points
        odd.append(points[(previous > mark) & (previous >= 0)])
        last_point = int(points[-1]) if points.size else last_point
        last_mark = int(marks[-1]) if marks.size else last_mark
    together = [np.concatenate(parts) if parts else np.empty(0, np.int64) for parts in (newlines, commas, odd)]
    places = together[2]
    return together[0], together[1], places[places < size]


def _allowed() -> NDArray[np.bool_]:
    """By 256 * byte + next byte: whether they may follow each other in `NAME, 1, -2.5`, shape (65536,)."""
    digits = b"0123456789"
    letters = b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz_"
    after = {
        letters: letters + digits + b",",
        digits: digits + b",.\r\n",
        b",": b" -" + digits,
        b" ": b"-" + digits,
        b"-": digits,
        b".": digits,
        b"\r": b"\n",
        b"\n": letters + digits + b"\r\n",
    }
    allowed = np.zeros((256, 256), np.bool_)
    for some, others in after.items():
        allowed[np.ix_(list(some), list(others))] = True
    allowed[ord("\n"), ord(" ")] = True  # behind the last line; within the file the name shows it
    return allowed.ravel()


def _unindented(data: Bytes, first: Offsets, stop: Offsets) -> Offsets:
    """First bytes of the lines behind blanks, zeros and a byte order mark."""
    first = first.copy()
    if data[:3].tobytes() == b"\xef\xbb\xbf":
        first[0] = 3
    going = np.arange(first.size)
    for _ in range(1 << 12):
        byte = data[np.minimum(first[going], data.size - 1)]
        going = going[(first[going] < stop[going]) & ((byte == 0x20) | (byte == 0x09) | (byte == 0))]
        if not going.size:
            break
        first[going] += 1
    return first


def _names(
    data: Bytes, first: Offsets, commas: Offsets, before: Offsets, columns: Offsets
) -> tuple[dict[str, int], Offsets]:
    """Message names with a number each, and the number of each line's name, -1 where it has none; shape (lines,)."""
    numbers = np.full(first.size, -1, np.int64)
    named = np.flatnonzero(columns > 0)
    if not named.size:
        return {}, numbers
    length = commas[before[named]] - first[named]
    short = (length > 0) & (length <= LONGEST_NAME)
    named, length = named[short], length[short]
    key = np.zeros(named.size, np.uint32)
    for k in range(LONGEST_NAME):
        key |= np.where(k < length, data[first[named] + k], 0).astype(np.uint32) << (8 * k)
    keys, inverse = np.unique(key, return_inverse=True)
    names: dict[str, int] = {}
    number_of = np.full(keys.size, -1, np.int64)
    for i, packed in enumerate(keys.tolist()):
        raw = packed.to_bytes(LONGEST_NAME, "little").rstrip(b"\0")
        if _NAME.fullmatch(raw):
            number_of[i] = names[raw.decode()] = i
    numbers[named] = number_of[inverse]
    return names, numbers


def _formats(where: _Lines, lines: Offsets) -> dict[str, Format]:
    """What the FMT lines declare, by name. Of two for one name the one whose length is right, else the first."""
    formats = {}
    sound: set[str] = set()
    for line in lines.tolist():
        fmt = _definition(where.text(line))
        if fmt is None:
            continue
        right = fmt.length == 3 + sum(np.dtype(TYPES[letter][0]).itemsize for letter in fmt.types)
        if fmt.name not in formats or (right and fmt.name not in sound):
            formats[fmt.name] = fmt
            if right:
                sound.add(fmt.name)
    if formats:
        formats["FMT"] = FMT
    return formats


def _definition(line: bytes) -> Format | None:
    cells = [cell.strip().decode("latin-1") for cell in line.split(b",", 5)]
    if len(cells) < 5 or not cells[1].isdecimal() or not cells[2].isdecimal() or max(map(len, cells[1:3])) > 4:
        return None
    name, types = cells[3], cells[4]
    columns = tuple(cell.strip() for cell in cells[5].split(",")) if len(cells) > 5 and cells[5] else ()
    if not re.fullmatch(r"[A-Za-z0-9_]{1,4}", name) or any(letter not in TYPES for letter in types):
        return None
    if not columns or len(columns) != len(types) or len(set(columns)) != len(columns):
        return None
    if not all(_COLUMN.fullmatch(column) for column in columns):
        return None
    return Format(int(cells[1]), name, int(cells[2]), types, columns)


def _pattern(fmt: Format) -> re.Pattern[bytes]:
    """What a line of this format looks like, one group for each column."""
    parts = []
    for place, letter in enumerate(fmt.types):
        last = place == len(fmt.types) - 1
        if letter in STRINGS:
            parts.append(_REST if last else _TEXT)
        elif letter == "a":
            parts.append(_ARRAY)
        elif letter == "M":
            parts.append(_WHOLE + rb"|" + _WORD)
        else:
            parts.append(_NUMBER if letter in FLOATS else _WHOLE)
    return re.compile(re.escape(fmt.name.encode()) + b"".join(rb",(" + part + rb")" for part in parts) + rb"\r?")


def _judge(where: _Lines, fmt: Format, plain: NDArray[np.bool_], lines: Offsets) -> tuple[Format, NDArray[np.bool_]]:
    """The format, and which of its lines can be believed: those that are plain, or that its pattern fits.

    A flight mode (letter M) written as a word makes its column one of strings.
    """
    pattern = _pattern(fmt)
    modes = [place for place, letter in enumerate(fmt.types) if letter == "M"]
    words: set[int] = set()
    good = plain.copy()
    for k in np.flatnonzero(~plain).tolist():
        match = pattern.fullmatch(where.text(int(lines[k])))
        if match is None or any(len(match[i + 1]) > LONGEST_CELL for i, x in enumerate(fmt.types) if x not in "anNZ"):
            continue
        good[k] = True
        words.update(place for place in modes if re.fullmatch(_WHOLE, match[place + 1]) is None)
    if words:
        types = "".join("N" if place in words else letter for place, letter in enumerate(fmt.types))
        fmt = replace(fmt, types=types)
    return fmt, good


def _damage(size: int, unread: int, good: NDArray[np.bool_], unknown: NDArray[np.bool_]) -> Damage:
    """`unread` of `size` bytes; broken lines with a good one behind are one resync.

    `good`, `unknown`: which lines are read, and which have a name that is not declared, of those that are not blank.
    """
    broken = ~good & ~unknown
    begins = np.flatnonzero(broken & ~np.concatenate(([False], broken[:-1]))) if good.size else np.empty(0, np.int64)
    believed = np.flatnonzero(good)
    resyncs = int(np.count_nonzero(begins < (believed[-1] if believed.size else 0)))
    return Damage(size, unread, resyncs, {}, bool(good.size and broken[-1]))
