"""What a ULog says about its messages: formats of topics, and which id was subscribed to which.

Looked for everywhere in the file, for the chain of messages cannot be followed before they are known.
"""

from __future__ import annotations

import re
import struct
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import islice

import numpy as np
from numpy.typing import NDArray

from gcs.errors import TippathError

Bytes = NDArray[np.uint8]

FIRST = 16  # bytes of the file's header
FLAGS = 40  # bytes of the flags, the first message
CHUNK = 1 << 20  # bytes are looked at in pieces that stay in the processor's cache
LARGEST = 0xFFFF - 2  # bytes of data: what a size can say
DEEPEST = 16  # formats within formats; PX4 has two
MOST_DEFINITIONS = 8192  # of either kind; a real log has some 200
MOST_TEXT = 1 << 25  # bytes looked at as definitions
MOST_PLACES = 1_000_000  # looked at for either kind

TYPES: Mapping[str, str] = {
    "int8_t": "<i1",
    "uint8_t": "<u1",
    "int16_t": "<i2",
    "uint16_t": "<u2",
    "int32_t": "<i4",
    "uint32_t": "<u4",
    "int64_t": "<i8",
    "uint64_t": "<u8",
    "float": "<f4",
    "double": "<f8",
    "bool": "<i1",
    "char": "<i1",
}

_PARAMETERS_WITHIN = 1 << 22  # bytes from the start: they come before the samples
_PARAMETER = re.compile(rb"(..)P(.)(int32_t|float) ([A-Z0-9_]{1,16})", re.DOTALL)
FORMAT, SUBSCRIBE = ord("F"), ord("A")
_FLAGS = ord("B")

_WORD = np.zeros(256, np.bool_)
_WORD[list(b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789_")] = True
NAME = re.compile(rb"[A-Za-z0-9_]{1,250}")
_ITEM = rb"[A-Za-z0-9_]+(?:\[[0-9]{1,5}\])? [A-Za-z0-9_]+"
_DEFINITION = re.compile(rb"[A-Za-z0-9_]{1,250}:" + _ITEM + rb"(?:;" + _ITEM + rb")*;?")
_FIELD = re.compile(r"([A-Za-z0-9_]+)(?:\[([0-9]+)\])? ([A-Za-z0-9_]+)")


@dataclass(frozen=True)
class Format:
    """What an F message says about one type."""

    name: str
    fields: tuple[tuple[str, int, str], ...]
    """Type, elements (0: no array), name."""


@dataclass(frozen=True)
class Topic:
    """A topic that was subscribed to."""

    name: str
    least: int
    """Bytes of its data, without the padding at its end."""
    most: int
    """The same with it; writers may leave it out."""


def formats_in(data: Bytes) -> dict[str, Format]:
    """Every format that makes sense, by the name of its type; the first where several bear one name."""
    formats: dict[str, Format] = {}
    looked_at = 0
    for start in islice(_places(data, FORMAT, 5, 0xFFFF), MOST_PLACES):
        size = int(data[start]) | int(data[start + 1]) << 8
        text = data[start + 3 : start + 3 + size].tobytes()
        looked_at += size
        if looked_at > MOST_TEXT or len(formats) >= MOST_DEFINITIONS:
            break
        format = _format(text)
        if format is not None:
            formats.setdefault(format.name, format)
    return formats


def _format(text: bytes) -> Format | None:
    """`vehicle_status:uint64_t timestamp;uint8_t[4] mode;`; None for what is no such text, or names a field twice."""
    if not _DEFINITION.fullmatch(text):
        return None
    name, _, items = text.decode("ascii").partition(":")
    fields = tuple((kind, int(count or 0), its_name) for kind, count, its_name in _FIELD.findall(items))
    sound = len({its_name for *_, its_name in fields}) == len(fields) and all(n <= 0xFFFF for _, n, _ in fields)
    return Format(name, fields) if sound else None


def claims_in(data: Bytes, formats: Mapping[str, Format]) -> dict[int, tuple[tuple[Topic, int], ...]]:
    """Id of a subscription -> the topics and instances that claim it; several only where one is damaged."""
    sizes = _sizes(formats)
    claims: dict[int, dict[tuple[Topic, int], None]] = {}
    count = 0
    for start in islice(_places(data, SUBSCRIBE, 4, 3 + 250), MOST_PLACES):
        size = int(data[start]) | int(data[start + 1]) << 8
        name = data[start + 6 : start + 3 + size].tobytes()
        topic = sizes.get(name.decode("latin-1")) if NAME.fullmatch(name) else None
        if topic is not None and count < MOST_DEFINITIONS:
            id = int(data[start + 4]) | int(data[start + 5]) << 8
            claims.setdefault(id, {})[topic, int(data[start + 3])] = None
            count += 1
    return {id: tuple(topics) for id, topics in claims.items()}


def parameters_in(data: Bytes) -> dict[str, float]:
    """The vehicle's parameters at the start of a log, by name."""
    head = data[:_PARAMETERS_WITHIN].tobytes()
    found: dict[str, float] = {}
    for match in _PARAMETER.finditer(head):
        kind, length = match[3].decode("ascii"), match[2][0]
        first = match.start(3)
        name, value = head[first + len(kind) + 1 : first + length], head[first + length : first + length + 4]
        if int.from_bytes(match[1], "little") == 1 + length + 4 and NAME.fullmatch(name) and len(value) == 4:
            found.setdefault(name.decode("ascii"), float(np.frombuffer(value, TYPES[kind])[0]))
    return found


def _places(data: Bytes, kind: int, least: int, most: int) -> Iterator[int]:
    """Where a message of this kind with a name in it may stand, ascending."""
    name = {FORMAT: 3, SUBSCRIBE: 6}[kind]
    for start in range(2, data.size - 4, CHUNK):
        at = np.flatnonzero(data[start : min(start + CHUNK, data.size - 4)] == kind) + (start - 2)
        at = at[at + 3 + least <= data.size]
        size = data[at].astype(np.int64) | data[at + 1].astype(np.int64) << 8
        at = at[(size >= least) & (size <= most) & (at + 3 + size <= data.size)]
        yield from at[_WORD[data[at + name]]].tolist()


def _sizes(formats: Mapping[str, Format]) -> dict[str, Topic]:
    """Topics whose size can be told; not those that hold themselves, something unknown, or more than a message can."""
    known: dict[str, int | None] = {kind: np.dtype(stored).itemsize for kind, stored in TYPES.items()}

    def size(name: str, depth: int) -> int | None:
        if name in known:
            return known[name]
        if depth > DEEPEST or name not in formats:
            return None
        known[name] = None
        total = 0
        for kind, count, _ in formats[name].fields:
            each = size(kind, depth + 1)
            if each is None:
                return None
            total += each * max(count, 1)
            if total > LARGEST:
                return None
        known[name] = total
        return total

    topics: dict[str, Topic] = {}
    for name, format in formats.items():
        most = size(name, 0)
        if most is None:
            continue
        least = most
        for kind, count, its_name in reversed(format.fields):
            if not its_name.startswith("_padding"):
                break
            least -= (known[kind] or 0) * max(count, 1)
        if least > 0:
            topics[name] = Topic(name, least, most)
    return topics


def flat(formats: Mapping[str, Format], name: str, offset: int, prefix: str) -> Iterator[tuple[str, tuple[int, str]]]:
    """Every plain field of a topic whose size is known, types within types and arrays spread out."""
    for kind, count, its_name in formats[name].fields:
        for i in range(max(count, 1)):
            key = f"{prefix}{its_name}[{i}]" if count else prefix + its_name
            if kind in TYPES:
                yield key, (offset, kind)
                offset += np.dtype(TYPES[kind]).itemsize
            else:
                last = offset
                for inner, place in flat(formats, kind, offset, key + "."):
                    last = place[0] + np.dtype(TYPES[place[1]]).itemsize
                    yield inner, place
                offset = last


def appended_at(data: Bytes, path: str) -> tuple[int, ...]:
    """Where data was appended after a crash. Raises TippathError for a log that says it is of another kind."""
    head = data[FIRST : FIRST + 3 + FLAGS].tobytes()
    if len(head) < 3 + FLAGS or head[:3] != struct.pack("<HB", FLAGS, _FLAGS):
        return ()
    incompatible = head[11:19]
    if incompatible[0] & ~1 or any(incompatible[1:]):
        raise TippathError(
            f"{path}: the log says that it is of a later kind of ULog (flags {incompatible.hex()}), which is not read "
            "here; convert it (ulog2csv of pyulog) and name the columns in a profile"
        )
    return tuple(offset for offset in struct.unpack("<3Q", head[19:43]) if incompatible[0] and offset)
