"""Where a log without a maneuver was flown: the stretch to name for those who vouch that it was flown as one."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from gcs.logs.formats.tables import FloatArray
from gcs.logs.runs.excited import LONGEST_LOG_S

BLOCK_S = 2.0
MOVING = 0.02
"""rad/s rms in a block: less is a gyro on the bench."""
PART_OF_USUAL = 0.1
"""Of the usual block's motion: less is calm."""
CALM_BLOCKS = 4  # in a row end a flight
TAKEOFF_S = 3.0
"""Left out at either end: take-off, landing, a crash."""
SHORTEST_S = 10.0


def flown_stretch(channels: Mapping[str, FloatArray]) -> tuple[float, float] | None:
    """Start and stop, s, of the longest stretch in which the rates p and q, (n,) on the clock t, move.

    None where they never do for long enough, or the clock has jumped.
    """
    t = channels["t"]
    if t.size < 2 or not SHORTEST_S <= t[-1] - t[0] <= LONGEST_LOG_S:
        return None
    edges = np.arange(t[0], t[-1] + BLOCK_S, BLOCK_S)
    parts = np.split(np.arange(t.size), np.searchsorted(t, edges[1:-1]))
    motion = np.array([_rms(channels["p"][part], channels["q"][part]) for part in parts])
    above = motion[motion > MOVING]
    if not above.size:
        return None
    moving = np.flatnonzero(motion > max(MOVING, PART_OF_USUAL * float(np.median(above))))
    flights = np.split(moving, np.flatnonzero(np.diff(moving) > CALM_BLOCKS) + 1)
    longest = max(flights, key=lambda flight: int(flight[-1] - flight[0]))
    start = np.ceil(edges[longest[0]] + TAKEOFF_S)
    stop = np.floor(min(edges[longest[-1]] + BLOCK_S, t[-1]) - TAKEOFF_S)
    return (float(start), float(stop)) if stop - start >= SHORTEST_S else None


def _rms(p: FloatArray, q: FloatArray) -> float:
    """Of both rates about their means; zero of fewer than two samples."""
    return float(np.sqrt(np.var(p) + np.var(q))) if p.size > 1 else 0.0
