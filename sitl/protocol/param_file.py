"""`@PARAM/param.pck` as ArduPilot packs it: the parameter list as a file, `?start=N&count=C&withdefaults=1` behind it.

Three numbers of 16 bits (magic, parameters here, parameters in all), then for each parameter its type with a flag for a
default, how many characters it shares with the name before and how many follow less one, those characters, the value
and, where it is another one, the default. Zeros before an entry keep a value from lying across two reads, so all reads
must be of one size, the first one's; any other fails.
"""

from __future__ import annotations

import struct
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import takewhile

from sitl.autopilot.parameters import Kind, Parameters, cast

FOLDER, NAME = "@PARAM", "param.pck"
MAGIC, MAGIC_WITH_DEFAULTS = 0x671B, 0x671C
_HEADER = struct.Struct("<HHH")
_KINDS = {Kind.INT8: (1, "b"), Kind.INT16: (2, "h"), Kind.INT32: (3, "i"), Kind.REAL32: (4, "f")}
_BYTES_EACH = 12
"""Of which the size is guessed that opening tells."""


@dataclass(frozen=True, slots=True)
class Entry:
    """A parameter at this moment."""

    name: str
    kind: Kind
    value: float
    default: float


@dataclass(frozen=True, slots=True)
class Part:
    """Which of the list, `count` 0 for all from `start` on."""

    start: int = 0
    count: int = 0
    with_defaults: bool = False


def part_of(path: str) -> Part | None:
    """What a file's name asks for; None where it is no parameter file. Raises ValueError for numbers out of range."""
    name, _, query = path.partition("?")
    if name.removeprefix("/") != f"{FOLDER}/{NAME}":
        return None
    numbers = dict.fromkeys(("start", "count", "withdefaults"), 0)
    for word in query.split("&"):
        key, _, digits = word.partition("=")
        if key in numbers:
            numbers[key] = int(digits)
    if not all(0 <= number < 0xFFFF for number in numbers.values()) or numbers["withdefaults"] > 1:
        raise ValueError(f"{query}: out of range")
    return Part(numbers["start"], numbers["count"], bool(numbers["withdefaults"]))


def entries_of(parameters: Parameters) -> list[Entry]:
    """Those in the list, in its order."""
    entries = []
    for name in parameters.visible():
        about = parameters.table[name]
        value, default = (cast(about.kind, number) for number in (parameters[name], about.default))
        entries.append(Entry(name, about.kind, value, default))
    return entries


def packed(entries: Sequence[Entry], part: Part, read_size: int) -> bytes:
    """The file for reads of so many bytes."""
    chosen = entries[part.start : part.start + part.count if part.count else None]
    magic = MAGIC_WITH_DEFAULTS if part.with_defaults else MAGIC
    out = bytearray(_HEADER.pack(magic, len(chosen), len(entries)))
    before = ""
    for entry in chosen:
        raw = _entry(entry, before, part.with_defaults)
        width = struct.calcsize(_KINDS[entry.kind][1])
        beyond = (len(out) + len(raw)) % read_size
        if width > 1 and 0 < beyond < width:
            out += bytes(width - beyond)
        out += raw
        before = entry.name
    return bytes(out)


def _entry(entry: Entry, before: str, with_defaults: bool) -> bytes:
    number, layout = _KINDS[entry.kind]
    alike = takewhile(lambda pair: pair[0] == pair[1], zip(entry.name, before, strict=False))
    shared = min(sum(1 for _ in alike), len(entry.name) - 1)
    rest = entry.name[shared:].encode()
    values = [entry.value]
    if with_defaults and entry.value != entry.default:
        values.append(entry.default)
    numbers = values if entry.kind is Kind.REAL32 else [int(value) for value in values]
    flags = len(values) - 1
    head = bytes((number | flags << 4, shared | (len(rest) - 1) << 4))
    return head + rest + struct.pack(f"<{len(values)}{layout}", *numbers)


class ParamFile:
    """The list as it was when the file was opened."""

    def __init__(self, parameters: Parameters, part: Part) -> None:
        self._entries = entries_of(parameters)
        self._part = part
        self._read_size = 0
        self._content = b""

    @property
    def size(self) -> int:
        """Bytes, as ArduPilot guesses them from the number of parameters: a reader goes on to the end of the file."""
        return _BYTES_EACH * len(self._entries)

    def read(self, offset: int, size: int) -> bytes | None:
        """None for another size than the first, and for a part behind the list's end."""
        if self._read_size == 0 and size > 0 and self._part.start < len(self._entries):
            self._read_size, self._content = size, packed(self._entries, self._part, size)
        if size != self._read_size or size == 0:
            return None
        return self._content[offset : offset + size]
