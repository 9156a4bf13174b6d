"""Bytes injured at random, as cards, radios and pilots do it, repeatable from a seed."""

from __future__ import annotations

import random
from collections.abc import Callable, Sequence

SIZES = (1, 3, 40, 200, 4096)


def injure(
    data: bytes,
    chance: random.Random,
    inserted: Callable[[random.Random], bytes],
    sizes: Sequence[int] = SIZES,
    *,
    cut: bool = False,
) -> bytes:
    """A few injuries: flips, deletions, insertions, zeroed and repeated stretches, what the format itself has anywhere.

    `inserted` gives a piece of the format; `cut` ends the file somewhere, too.
    """
    out = bytearray(data)
    for _ in range(chance.randrange(1, 12)):
        at = chance.randrange(len(out))
        size = min(chance.choice(sizes), len(out) - 1)
        match chance.randrange(7 if cut else 6):
            case 0:
                out[at] = chance.randrange(256)
            case 1:
                del out[at : at + size]
            case 2:
                out[at:at] = chance.randbytes(size)
            case 3:
                out[at : at + size] = bytes(len(out[at : at + size]))
            case 4:
                out[at:at] = out[at : at + size]
            case 5:
                out[at:at] = inserted(chance)
            case 6:
                out = out[: max(at, 10)]
        if len(out) < 10:
            break
    return bytes(out)
