"""What damages a document: one value, key or entry changed somewhere, bytes lost, and what a program would choke on."""

from __future__ import annotations

import random
from typing import Any

HOSTILE: tuple[Any, ...] = (
    *(None, True, 0, -1, 10**400, 1e308, float("nan"), float("-inf"), "", "x" * 500, "\x1b[2J", "\u202e"),
    *([], {}, [[1]], {"a": 1}, [[1], [2, 3]]),
)

FILES = {
    "empty": b"",
    "zeros": bytes(500),
    "binary": bytes(range(256)),
    "half a character": "ä".encode()[:1],
    "deep lists": b"a = " + b"[" * 100_000,
    "deep JSON": b"[" * 200_000,
    "deep objects": b'{"a":' * 100_000,
    "long key": b"a." * 50_000 + b"b = 1",
    "long number": b"a = " + b"9" * 10_000,
    "huge": b"#" * 65 * 2**20,
    "a list": b"[1, 2]",
    "nothing": b"null",
    "endless": b'{"a": NaN}',
}
"""Name -> the bytes of a file that is no document of ours."""


def changed(document: Any, rng: random.Random) -> Any:
    """The document with one value, key or entry changed somewhere."""
    if not isinstance(document, dict | list) or not document or rng.random() < 0.2:
        return rng.choice(HOSTILE)
    if isinstance(document, list):
        at = rng.randrange(len(document))
        return [changed(child, rng) if k == at else child for k, child in enumerate(document)]
    key = rng.choice(list(document))
    if rng.random() < 0.3:
        return {rng.choice(["", "nam", "\x1b", key.upper()]) if k == key else k: v for k, v in document.items()}
    return {k: changed(v, rng) if k == key else v for k, v in document.items()}


def bytes_changed(body: bytes, rng: random.Random) -> bytes:
    """A file cut, or with some of its bytes changed."""
    if rng.random() < 0.3:
        return body[: rng.randrange(len(body))]
    out = bytearray(body)
    for _ in range(rng.randrange(1, 4)):
        out[rng.randrange(len(out))] = rng.randrange(256)
    return bytes(out)
