"""Text of a vehicle or a file made harmless."""

from __future__ import annotations

import unicodedata


def printable(raw: bytes | str) -> str:
    """Text of a vehicle or a file made harmless: up to the first zero, control characters replaced by `?`."""
    text = raw.split(b"\0", 1)[0].decode("utf-8", "replace") if isinstance(raw, bytes) else raw
    return "".join(c if c.isprintable() else "?" for c in text)


def harmless(text: str) -> str:
    """Text of several lines without what a terminal would obey, its length unchanged: line ends, tabs and spaces of any
    width stay, other characters that are not printable become `?`."""
    if text.isprintable():
        return text
    return "".join(c if c.isprintable() or c in "\n\t" or unicodedata.category(c) == "Zs" else "?" for c in text)
