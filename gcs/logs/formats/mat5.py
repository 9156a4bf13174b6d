"""MATLAB's format 5 (`save -v6`, `-v7`): elements with a tag of type and size, one inside the other.

MathWorks, "MAT-File Format", chapter 1. SciPy's reader is not used: of a damaged file it ends the whole program, for it
trusts the types that the file names. Here nothing is taken that the bytes do not hold.
"""

from __future__ import annotations

import math
import struct
import zlib
from collections.abc import Iterator, Mapping
from typing import Any, Literal, NamedTuple

import numpy as np

from gcs.logs.formats.raw import most_inflated
from gcs.logs.words import printable

HEADER = 128
ORDERS: Mapping[bytes, Literal["<", ">"]] = {b"IM": "<", b"MI": ">"}
NUMBERS = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 9: "f8", 12: "i8", 13: "u8"}
"""Type of an element -> numpy's, but for the order of bytes."""
ENCODINGS = {"<": {17: "utf-16-le", 18: "utf-32-le"}, ">": {17: "utf-16-be", 18: "utf-32-be"}}
"""Order of bytes -> type of an element -> how its texts are written; all else is UTF-8."""
MATRIX, COMPRESSED = 14, 15
CELL, STRUCT, OBJECT, CHARACTERS, SPARSE, FUNCTION, OPAQUE = 1, 2, 3, 4, 5, 16, 17
NUMERIC = range(6, 16)
"""Classes of a matrix."""
UNREADABLE = {OBJECT: "", SPARSE: "sparse", FUNCTION: "function"}
"""Classes of what is no array of numbers -> what to call it; an object tells its own."""
COMPLEX = 0x0800
DEEPEST = 16
MOST_BYTES = 1 << 31  # of one variable, unpacked
MOST_ENTRIES = 20_000  # of a cell or an array of structs


class DamagedError(ValueError):
    """Bytes that are no whole file of this format."""


class _Element(NamedTuple):
    type: int
    data: memoryview


def parts(raw: bytes) -> Iterator[tuple[str, Any]]:
    """(name, array of numbers), (name, array of texts), or (name, class) of an object. Raises DamagedError."""
    if len(raw) < HEADER:
        raise DamagedError("shorter than its header")
    order = ORDERS.get(raw[126:128])
    if order is None:
        raise DamagedError("its header does not tell the order of bytes")
    reader, left = _Reader(order), most_inflated(len(raw))
    for element in reader.elements(memoryview(raw)[HEADER:]):
        if element.type == COMPRESSED:
            unpacked = memoryview(_unpacked(element.data, left))
            left -= len(unpacked)
            element = next(reader.elements(unpacked), _Element(0, unpacked))
        if element.type == MATRIX:
            yield from reader.matrix(element.data)


def _unpacked(data: memoryview, most: int) -> bytes:
    unpacking = zlib.decompressobj()
    try:
        made = unpacking.decompress(data, max(most, 1))
    except zlib.error as error:
        raise DamagedError("what is compressed in it cannot be unpacked") from error
    if not unpacking.eof:
        raise DamagedError(
            "what is compressed in it is cut, or far more than what is measured packs to; save it with -nocompression"
        )
    return made


class _Reader:
    """Of one order of bytes."""

    def __init__(self, order: Literal["<", ">"]) -> None:
        self.order = order
        self._tag = struct.Struct(f"{order}II")

    def elements(self, data: memoryview) -> Iterator[_Element]:
        """What lies side by side in these bytes."""
        at = 0
        while at < len(data):
            if len(data) - at < 8:
                raise DamagedError("it ends in the middle of a tag")
            kind, size = self._tag.unpack_from(data, at)
            if kind >> 16:  # four bytes at most, in the tag itself
                kind, size, start, step = kind & 0xFFFF, kind >> 16, at + 4, 8
                if size > 4:
                    raise DamagedError("a small element of more than 4 bytes")
            else:
                start = at + 8
                step = 8 + (size if kind == COMPRESSED else -(-size // 8) * 8)
            if start + size > len(data):
                raise DamagedError("it ends in the middle of an array")
            yield _Element(kind, data[start : start + size])
            at += step

    def matrix(self, data: memoryview, name: str = "", depth: int = 0) -> Iterator[tuple[str, Any]]:
        """As `parts`, of the bytes of one matrix; inside another it has no name of its own but that."""
        if not len(data) or depth > DEEPEST:
            return
        inside = self.elements(data)
        flags = int(self._numbers(_next(inside))[:1].sum())
        kind = flags & 0xFF
        if kind == OPAQUE:
            own, _, of = (_text(_next(inside)) for _ in range(3))
            yield name or own, of
            return
        shape = [int(size) for size in self._numbers(_next(inside))]
        if not shape or min(shape) < 0 or math.prod(shape) > MOST_BYTES:
            raise DamagedError("an array of impossible size")
        own = _text(_next(inside))
        name = name or own
        if kind in NUMERIC:
            if math.prod(shape) and name:
                yield name, self._array(inside, shape, bool(flags & COMPLEX))
        elif kind in (CELL, STRUCT):
            fields = [""] if kind == CELL else self._fields(inside)
            yield from self._entries(inside, name, shape, fields, depth)
        elif kind in UNREADABLE:
            yield name, UNREADABLE[kind] or _text(_next(inside))
        elif kind == CHARACTERS:
            yield name, self._texts(_next(inside), shape)
        else:
            raise DamagedError(f"an array of an unknown class, {kind}")

    def _fields(self, inside: Iterator[_Element]) -> list[str]:
        """Names of a struct's fields, each with its dot."""
        length = int(self._numbers(_next(inside))[:1].sum())
        names = _next(inside).data
        if length <= 0:
            raise DamagedError("a struct whose fields have no names")
        return [f".{printable(bytes(names[at : at + length]))}" for at in range(0, len(names), length)]

    def _entries(
        self, inside: Iterator[_Element], name: str, shape: list[int], fields: list[str], depth: int
    ) -> Iterator[tuple[str, Any]]:
        """The only entry by the array's own name, several by their numbers, each with its fields."""
        count = math.prod(shape)
        for i in range(min(count, MOST_ENTRIES)):
            for field in fields:
                element = _next(inside)
                if element.type != MATRIX:
                    raise DamagedError("a cell or a struct that holds no arrays")
                label = f"{name}[{i}]" if count > 1 else name
                yield from self.matrix(element.data, f"{label}{field}", depth + 1)

    def _texts(self, element: _Element, shape: list[int]) -> np.ndarray:
        """Rows of characters as texts, without the blanks that fill them up; none where they are none."""
        if element.type in NUMBERS:
            numbers = (int(number) for number in np.nan_to_num(self._numbers(element), nan=-1).tolist())
            characters = "".join(chr(number) if 0 <= number < 0xD800 else "?" for number in numbers)
        else:
            characters = bytes(element.data).decode(ENCODINGS[self.order].get(element.type, "utf-8"), "replace")
        count = shape[0] if len(shape) == 2 and len(characters) == math.prod(shape) else 1
        return np.array([printable(characters[i::count]).rstrip() for i in range(count)], dtype=str)

    def _array(self, inside: Iterator[_Element], shape: list[int], complex_too: bool) -> np.ndarray:
        values = self._numbers(_next(inside))
        if complex_too:
            imaginary = self._numbers(_next(inside))
            if imaginary.size != values.size:
                raise DamagedError("an array whose imaginary part has another size")
            values = values + 1j * imaginary
        if values.size != math.prod(shape):
            raise DamagedError("an array of another size than it says")
        return values.reshape(shape, order="F")

    def _numbers(self, element: _Element) -> np.ndarray:
        stored = NUMBERS.get(element.type)
        if stored is None or len(element.data) % np.dtype(stored).itemsize:
            raise DamagedError(f"an element of type {element.type} where numbers belong")
        return np.frombuffer(element.data, np.dtype(stored).newbyteorder(self.order))


def _next(inside: Iterator[_Element]) -> _Element:
    element = next(inside, None)
    if element is None:
        raise DamagedError("an array that ends too early")
    return element


def _text(element: _Element) -> str:
    return printable(bytes(element.data))
