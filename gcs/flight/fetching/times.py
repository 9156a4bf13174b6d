"""A DataFlash log's times from pieces of it: its formats stand at its head, and most messages carry the clock.

Pure; reading is the caller's, as a function (start, stop) -> bytes. A piece cut anywhere is read from the first place
on from which several messages follow each other.
"""

from __future__ import annotations

import struct
from collections.abc import Callable
from dataclasses import dataclass

HEAD_BYTES = 32_768
"""Holds an ArduPilot's formats."""
PIECE_BYTES = 4_096
"""Holds some tens of messages, far more than are needed to find their beat."""
BLOCK_BYTES = 2_048
"""Where a time is looked for: it comes in some tenths of a second over 57,600 baud."""
_MARK = b"\xa3\x95"
_FORMAT, _FORMAT_SIZE = 128, 89
_IN_A_ROW = 3

Read = Callable[[int, int], bytes]


@dataclass(frozen=True, slots=True)
class Layout:
    """What is known of a log's messages."""

    sizes: dict[int, int]
    """Number of a kind of message -> bytes of one."""
    stamped: frozenset[int]
    """Kinds that begin with TimeUS."""


@dataclass(frozen=True, slots=True)
class Stamp:
    """A message with a time."""

    at: int
    """Where it begins in the piece."""
    size: int
    t: float
    """s, of the vehicle's clock."""


def layout(head: bytes) -> Layout:
    """The formats at a log's beginning; empty where this is no DataFlash log."""
    sizes, stamped = {_FORMAT: _FORMAT_SIZE}, set()
    at = 0
    while head[at : at + 2] == _MARK and at + 3 <= len(head) and head[at + 2] in sizes:
        size = sizes[head[at + 2]]
        if head[at + 2] == _FORMAT and at + size <= len(head):
            kind, length, _, codes, names = struct.unpack_from("<BB4s16s64s", head, at + 3)
            if length >= 3:
                sizes[kind] = length
            if codes[:1] == b"Q" and names.startswith(b"TimeUS") and length >= 11:
                stamped.add(kind)
        at += size
    return Layout(sizes, frozenset(stamped))


def stamps(piece: bytes, known: Layout) -> list[Stamp]:
    """The messages with a time in a piece, in order."""
    found: list[Stamp] = []
    at, sure = 0, False
    while (at := piece.find(_MARK, at)) >= 0 and at + 3 <= len(piece):
        size = known.sizes.get(piece[at + 2], 0)
        sure = sure and size > 0
        if not sure and not _follow(piece, at, known):
            at += 1
            continue
        if at + size > len(piece):
            break
        if piece[at + 2] in known.stamped:
            found.append(Stamp(at, size, int.from_bytes(piece[at + 3 : at + 11], "little") * 1e-6))
        at += size
        sure = piece[at : at + 2] == _MARK
    return found


def _follow(piece: bytes, at: int, known: Layout) -> bool:
    """Whether messages follow each other from here on."""
    for _ in range(_IN_A_ROW):
        size = known.sizes.get(piece[at + 2], 0) if at + 3 <= len(piece) else 0
        if size == 0 or piece[at : at + 2] != _MARK:
            return False
        at += size
        if at == len(piece):
            return True
    return True


def span(read: Read, size: int, known: Layout) -> tuple[float, float] | None:
    """The first and the last time of a log of `size` bytes, s; None where it has none."""
    first = stamps(read(0, min(size, HEAD_BYTES)), known)
    last = stamps(read(max(0, size - PIECE_BYTES), size), known)
    # A log begins with stamps of when its formats were written; a log without later ones is over with them.
    return (first[0].t, last[-1].t) if first and last else None


def offset_of(read: Read, size: int, known: Layout, t: float) -> int:
    """A byte at which a message begins, with none before it that is later than `t`, and not far before `t`.

    The same wherever the log ends, so that a fetch can be gone on with after it has grown. Times are taken to grow over
    the log, but for messages that stand a little out of order; where they grow evenly, few pieces are read.
    """
    first, times = stamps(read(0, min(size, HEAD_BYTES)), known), span(read, size, known)
    if not first or times is None or first[0].t >= t:
        return 0
    at = first[0].at  # what stands before has no times
    low, high, (earlier, later) = at // BLOCK_BYTES, -(-size // BLOCK_BYTES), times
    while high - low > 1:
        share = (t - earlier) / max(1e-9, later - earlier)
        block = min(high - 1, max(low + 1, low + int(min(0.9, max(0.1, share)) * (high - low))))
        found = stamps(read(block * BLOCK_BYTES, min(size, (block + 1) * BLOCK_BYTES)), known)
        if found and found[0].t < t:
            low, at, earlier = block, block * BLOCK_BYTES + found[0].at, found[0].t
        else:
            high, later = block, found[0].t if found else later
    return at
