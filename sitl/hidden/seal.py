"""The sealed answer: what is hidden, in a file that nobody reads by accident.

A seal against peeking, not cryptography: with this text anybody can open it. It keeps the answer out of the way of
`cat`, `grep` and a glance at its size, and its SHA-256, told before the flight, commits the vehicle to it.

    8 bytes    TPSEAL1 and a line feed
    16 bytes   nonce
    32 bytes   SHA-256 of nonce and body
    the rest   the body, with a keystream laid over it by exclusive or; block i of the keystream (32 bytes, from 0) is
               SHA-256 of the nonce and i as 8 bytes big-endian
    the body   4 bytes big-endian: length of what follows; JSON in UTF-8, deflated (zlib); zeros up to a multiple of
               2048 bytes

The document has the format tippath.answer/1: what `Hidden.to_json` says, and the seed.
"""

from __future__ import annotations

import hashlib
import json
import os
import zlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from sitl.hidden import Hidden

FILE_NAME = "answer"
MAGIC = b"TPSEAL1\n"
_BLOCK = 2048


def seal(document: Mapping[str, Any], nonce: bytes) -> bytes:
    """The file's bytes. `nonce` is 16 bytes that nobody could guess."""
    packed = zlib.compress(json.dumps(document, allow_nan=False).encode(), 9)
    body = len(packed).to_bytes(4, "big") + packed
    body += bytes(-len(body) % _BLOCK)
    stream = b"".join(hashlib.sha256(nonce + block.to_bytes(8, "big")).digest() for block in range(len(body) // 32))
    covered = bytes(a ^ b for a, b in zip(body, stream, strict=True))
    return MAGIC + nonce + hashlib.sha256(nonce + body).digest() + covered


def seal_answer(hidden: Hidden, seed: int, directory: Path) -> tuple[Path, str]:
    """Write `answer` into the directory; its path and the SHA-256 of the file.

    Raises FileExistsError rather than overwrite one, OSError where it cannot be written.
    """
    data = seal({"format": "tippath.answer/1", "seed": seed, **hidden.to_json()}, os.urandom(16))
    path = directory / FILE_NAME
    with path.open("xb") as stream:
        stream.write(data)
    return path, hashlib.sha256(data).hexdigest()
