"""Which times a recorded log holds: read from the file alone, whoever did not live to say it.

A block that never came is a hole of zeros (`gcs.flight.recorder`); the messages around it tell the time that it took.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from gcs.flight.fetching.times import HEAD_BYTES, PIECE_BYTES, layout, stamps
from gcs.link.decode import BLOCK_SIZE

LATE_S = 1.0
"""By which a log may end before a run that it holds: the way back to the pilot's mode counts as a part of the run."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Coverage:
    """A log on disk. Times are on the vehicle's clock, s."""

    blocks: int
    """From the first to the last that came."""
    missing: tuple[tuple[int, int], ...]
    """First and last block of each stretch of zeros."""
    first_s: float | None = None
    """Where it begins; None where no time can be read."""
    last_s: float | None = None
    gaps: tuple[tuple[float, float], ...] = ()
    """From the last time before each stretch of zeros to the first behind it."""

    def missing_s(self, start_s: float, stop_s: float) -> float:
        """How much of this time it lacks, s; all of it where it tells no times."""
        if self.first_s is None or self.last_s is None:
            return stop_s - start_s
        outside = max(0.0, min(self.first_s, stop_s) - start_s)
        late = stop_s - max(self.last_s, start_s)
        outside += late if late > LATE_S else 0.0
        return outside + sum(max(0.0, min(stop_s, late) - max(start_s, early)) for early, late in self.gaps)


def coverage(path: Path) -> Coverage:
    """What a DataFlash log holds. Raises OSError."""
    content = path.read_bytes()
    missing = _zeros(content)
    known = layout(content[:HEAD_BYTES])
    head, tail = stamps(content[:HEAD_BYTES], known), stamps(content[-PIECE_BYTES:], known)
    if not head or not tail:
        return Coverage(blocks=-(-len(content) // BLOCK_SIZE), missing=missing)
    gaps = []
    for first, last in missing:
        at, behind = first * BLOCK_SIZE, (last + 1) * BLOCK_SIZE
        before = stamps(content[max(0, at - PIECE_BYTES) : at], known)
        after = stamps(content[behind : behind + PIECE_BYTES], known)
        gaps.append((before[-1].t if before else head[0].t, after[0].t if after else tail[-1].t))
    return Coverage(
        blocks=-(-len(content) // BLOCK_SIZE),
        missing=missing,
        first_s=head[0].t,
        last_s=tail[-1].t,
        gaps=tuple(gaps),
    )


def _zeros(content: bytes) -> tuple[tuple[int, int], ...]:
    """First and last of each stretch of whole blocks that hold nothing."""
    whole = len(content) // BLOCK_SIZE
    blocks: NDArray[np.uint8] = np.frombuffer(content, np.uint8, whole * BLOCK_SIZE).reshape(whole, BLOCK_SIZE)
    edges = np.flatnonzero(np.diff(np.concatenate(([False], ~blocks.any(axis=1), [False]))))
    return tuple((int(first), int(behind) - 1) for first, behind in zip(edges[::2], edges[1::2], strict=True))
