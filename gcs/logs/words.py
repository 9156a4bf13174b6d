"""Text of a vehicle or a file made harmless."""

from __future__ import annotations


def printable(raw: bytes | str) -> str:
    """Text of a vehicle or a file made harmless: up to the first zero, control characters replaced by `?`."""
    text = raw.split(b"\0", 1)[0].decode("utf-8", "replace") if isinstance(raw, bytes) else raw
    return "".join(c if c.isprintable() else "?" for c in text)
