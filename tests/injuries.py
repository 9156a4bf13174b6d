"""Bytes injured at random, as cards, radios and pilots do it, repeatable from a seed."""

from __future__ import annotations

import contextlib
import random
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

import pytest

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


LONGEST_S, MOST_BYTES = 10.0, 300e6
"""What one file may take of a reader, whatever is in it."""
COUNTS = [40, pytest.param(2000, marks=pytest.mark.thorough)]
"""Mutated files of a kind: in the suite, and in `make study`."""


@contextlib.contextmanager
def bounded() -> Iterator[None]:
    """What is done within takes no more than `LONGEST_S` of a processor, nor `MOST_BYTES` (Linux tells)."""
    before, begun = _memory("VmRSS", anew=True), time.process_time()
    yield
    assert time.process_time() - begun < LONGEST_S
    assert _memory("VmHWM") - before < MOST_BYTES


def _memory(key: str, *, anew: bool = False) -> float:
    """Bytes of this process, 0 where the system does not tell; `anew` forgets the highest so far."""
    try:
        if anew:
            Path("/proc/self/clear_refs").write_text("5")
        status = Path("/proc/self/status").read_text()
    except OSError:
        return 0.0
    return next((1024.0 * float(line.split()[1]) for line in status.splitlines() if line.startswith(key)), 0.0)


STEP = 50
FIRSTS = [*range(0, 100, STEP), *(pytest.param(at, marks=pytest.mark.thorough) for at in range(100, 2000, STEP))]
"""The same, `STEP` seeds at a time."""


def bounded_turns(count: int, first: int = 0) -> Iterator[int]:
    """`count` numbers from the first; what is done with each is `bounded`."""
    for turn in range(first, first + count):
        with bounded():
            yield turn
