"""JSON that was saved, read as a stranger's: bounded in size, depth and numbers, and of the kinds that it should be.

What a document holds is written once, as msgspec structs; keys that are not in them may be added, and are left alone.
"""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any, Final, TypeVar

import msgspec

LARGEST: Final = 64 << 20
"""Bytes."""
DEEPEST: Final = 64
"""Tables within tables."""
LARGEST_NUMBER: Final = 1e15
"""No quantity of a vehicle comes near it, and what is computed of it stays finite."""

T = TypeVar("T")


class Open(msgspec.Struct, frozen=True, kw_only=True):
    """A table that programs write."""


def parsed(path: Path) -> Any:
    """A file's dict, list, number, text, bool or None.

    Raises ValueError, in one line, and OSError where it cannot be read.
    """
    with path.open("rb") as stream:
        raw = stream.read(LARGEST + 1)
    if len(raw) > LARGEST:
        raise ValueError(f"larger than {LARGEST >> 20} MB")
    return parsed_bytes(raw)


def parsed_bytes(raw: bytes) -> Any:
    """The same, of what was read."""
    try:
        return json.loads(raw.decode("utf-8-sig"))
    except RecursionError:
        raise ValueError("nested too deep") from None


def converted(document: Any, kind: type[T]) -> T:
    """What was parsed, as a struct of this kind. Raises ValueError, in one line, with the place."""
    _check(document)
    return msgspec.convert(document, kind)  # its ValidationError is a ValueError


def _check(document: Any) -> None:
    """Refuse what is nested too deep, numbers that are none, and text that is none; without recursion."""
    level, depth = [document], 0
    while level:
        if depth > DEEPEST:
            raise ValueError(f"nested more than {DEEPEST} deep")
        below: list[Any] = []
        for node in level:
            if isinstance(node, dict):
                below += [*node, *node.values()]
            elif isinstance(node, list | tuple):
                below += node
            elif isinstance(node, int | float) and not _is_number(node):
                raise ValueError(f"a number that is not finite, or above {LARGEST_NUMBER:g}")
            elif isinstance(node, str) and any("\ud800" <= c <= "\udfff" for c in node):
                raise ValueError("text with half a character")
        level, depth = below, depth + 1


def _is_number(value: float) -> bool:
    return abs(value) <= LARGEST_NUMBER and not math.isnan(value)
