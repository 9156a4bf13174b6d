"""Where a DataFlash log may lack something that its vehicle logged, as stretches of the vehicle's clock.

Four things show it: bytes between two messages that are none, a counter of dropped messages (DMS.Dp, DSF.Dp) that
grew, a silence of all that is logged fast, and a log's own beginning and end. What is in none of these stretches is
there.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gcs.logs.formats.dataflash import DataFlashLog
from gcs.logs.formats.dataflash_merge import clock_of, rows_of
from gcs.logs.formats.dataflash_table import EVENTS
from gcs.logs.formats.tables import FloatArray, late_after_s

Stretches = FloatArray
"""Begin and end of each, s, ascending and apart, shape (n, 2); the first may begin and the last end at infinity."""

COUNTERS = (("DMS", "Dp"), ("DSF", "Dp"))
"""What the vehicle itself dropped, for want of room: on its way to the link, and to the card."""
FEW = 10
FAST = 3.0
"""A kind is logged fast where its spacing is at most so many times that of the fastest."""


@dataclass(frozen=True, eq=False, slots=True)
class Losses:
    """Of a log, or of several as one."""

    stretches: Stretches
    """Beyond the ends too."""
    first_s: float
    """Of what is logged fast."""
    last_s: float

    @property
    def inside(self) -> Stretches:
        """Between the first sample and the last: what was beyond nobody knows."""
        rows = np.clip(self.stretches, self.first_s, self.last_s)
        return rows[rows[:, 0] < rows[:, 1]]

    def and_of(self, other: Losses) -> Losses:
        """What both lack, of two logs of one vehicle's clock."""
        return Losses(
            common(self.stretches, other.stretches),
            min(self.first_s, other.first_s),
            max(self.last_s, other.last_s),
        )


def losses(log: DataFlashLog) -> Losses:
    """Of a log as it is in its file."""
    times = _times(log)
    fast = _fast(times)
    if not fast:
        return Losses(np.array([[-np.inf, np.inf]]), np.inf, -np.inf)
    lost = united(_silences(fast), _broken(log, times), _dropped(log))
    return Losses(lost, min(float(t[0]) for t in fast), max(float(t[-1]) for t in fast))


def united(*several: Stretches) -> Stretches:
    """What is in any of them."""
    rows = np.concatenate([np.empty((0, 2)), *several])
    rows = rows[np.argsort(rows[:, 0], kind="stable")]
    if not len(rows):
        return rows
    end = np.maximum.accumulate(rows[:, 1])
    first = np.concatenate(([True], rows[1:, 0] > end[:-1]))
    last = np.concatenate((first[1:], [True]))
    return np.column_stack((rows[first, 0], end[last]))


def common(a: Stretches, b: Stretches) -> Stretches:
    """What is in both."""
    return _beside(united(_beside(a), _beside(b)))


def _beside(stretches: Stretches) -> Stretches:
    """What is in none of them."""
    rows = np.concatenate(([-np.inf], stretches.ravel(), [np.inf])).reshape(-1, 2)
    return rows[rows[:, 0] < rows[:, 1]]


def _times(log: DataFlashLog) -> dict[str, tuple[FloatArray, FloatArray]]:
    """Of each kind that is logged regularly, the believed rows' times and their places in the file."""
    found = {}
    for name in log.names:
        if name in EVENTS or clock_of(log.formats[name]) is None or log.count(name) < FEW:
            continue
        rows = rows_of(log, name, sifted=False)
        if rows.t.size >= FEW:
            found[name] = (rows.t, log.places(name)[rows.at].astype(np.float64))
    return found


def _fast(times: dict[str, tuple[FloatArray, FloatArray]]) -> list[FloatArray]:
    """The times of the kinds that are logged fast."""
    unique = [np.unique(t) for t, _ in times.values()]
    spacings = [float(np.median(np.diff(t))) if t.size >= FEW else np.inf for t in unique]
    fastest = min(spacings, default=np.inf)
    longest = FAST * fastest if np.isfinite(fastest) else 0.0
    return [t for t, spacing in zip(unique, spacings, strict=True) if spacing <= longest]


def _silences(fast: list[FloatArray]) -> Stretches:
    """Where none of them went on, before the first and behind the last too."""
    return _beside(united(*(_going(t) for t in fast)))


def _going(t: FloatArray) -> Stretches:
    """Where one kind went on at its own pace."""
    steps = np.diff(t)
    late = steps > late_after_s(steps)
    rows = np.column_stack((t[:-1], t[1:]))[~late]
    return united(rows)


def _broken(log: DataFlashLog, times: dict[str, tuple[FloatArray, FloatArray]]) -> Stretches:
    """Around the bytes that are no message."""
    begins, ends = [], []
    for name in log.names:
        at = log.places(name)
        begins.append(at)
        ends.append(at + log.formats[name].length)
    begin, end = np.concatenate(begins), np.concatenate(ends)
    order = np.argsort(begin)
    breaks = np.flatnonzero(end[order[:-1]] != begin[order[1:]])
    if not breaks.size:
        return np.empty((0, 2))
    t, places = (np.concatenate([pair[k] for pair in times.values()]) for k in (0, 1))
    along = np.argsort(places)
    places, t = places[along], t[along]
    before = np.concatenate(([-np.inf], np.maximum.accumulate(t)))
    after = np.concatenate((np.minimum.accumulate(t[::-1])[::-1], [np.inf]))
    where = np.searchsorted(places, begin[order[breaks + 1]])
    low, high = before[where], after[where]
    return united(np.column_stack((np.minimum(low, high), np.maximum(low, high))))


def _dropped(log: DataFlashLog) -> Stretches:
    """Between two tellings of a counter of dropped messages that grew."""
    found = []
    for name, column in COUNTERS:
        if name not in log.names or column not in log.formats[name].columns or clock_of(log.formats[name]) is None:
            continue
        rows = rows_of(log, name, sifted=False)
        count = log.column(name, column).astype(np.float64)[rows.at]
        t = np.concatenate(([-np.inf], rows.t))
        grew = np.diff(np.concatenate(([0.0], count))) > 0
        found.append(np.column_stack((t[:-1], t[1:]))[grew])
    return united(*found)
