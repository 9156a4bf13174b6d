"""Messages of one kind out of two logs of one flight: each once, in the order of time.

A sample is known by its TimeUS and its instance. Equal rows count once; where two rows of one key differ, the second
log's is kept, and counted. What happened once (`EVENTS`) may share a time with others, and each of a vehicle's two
writers stamps some of them itself: those are the same where all but the time is, and the times are near each other.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from gcs.logs.formats.dataflash_scan import CLOCKS, Format
from gcs.logs.formats.dataflash_table import EVENTS, INSTANCE, MessageLog
from gcs.logs.formats.raw import Bytes
from gcs.logs.formats.tables import FloatArray, before_no_gap, increasing

Ints = NDArray[np.int64]

SAME_EVENT_S = 0.01
"""By which the two stamps of one event may differ."""


class RowLog(MessageLog, Protocol):
    """The messages of a binary DataFlash log, with their bytes."""

    def raw(self, message: str) -> Bytes:
        """Every message of a type as its bytes, header included, shape (n, length). Raises KeyError."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Rows:
    """The believed messages of one kind."""

    at: Ints
    """Each one's number in its log, shape (n,)."""
    t: FloatArray
    """s, shape (n,)."""
    instance: Ints
    content: NDArray[np.uint64]
    """A hash of all but the time, shape (n,)."""

    @property
    def telling(self) -> NDArray[np.bool_]:
        """Which say something else than the row before them did, shape (n,): a constant proves nothing."""
        new = np.ones(self.at.size, np.bool_)
        order = np.lexsort((self.t, self.instance))
        new[order[1:]] = (np.diff(self.content[order]) != 0) | (np.diff(self.instance[order]) != 0)
        return new


@dataclass(frozen=True, eq=False, kw_only=True)
class Merged:
    """The rows of two logs, each once."""

    order: Ints
    """Numbers of rows, those of the second log behind all of the first's, in the order of time."""
    alone: tuple[int, int]
    """Rows that are in the first alone, and in the second."""
    equal: int
    """That are in both."""
    telling: int
    """Of these, those that a flight like it would not have by chance."""
    unlike: int
    """Rows of one key that differ; the second log's are kept."""


def clock_of(fmt: Format) -> tuple[str, float] | None:
    """A kind's field that holds the time, and its unit in s; None where it has none."""
    return next(((name, unit) for name, unit in CLOCKS.items() if name in fmt.columns), None)


def rows_of(log: RowLog, message: str, *, sifted: bool) -> Rows:
    """The rows of a kind that has a clock; `sifted`: what is not to be believed was left out before."""
    fmt = log.formats[message]
    clock = clock_of(fmt)
    assert clock is not None
    at = log.starts(message)
    t = log.column(message, clock[0]).astype(np.float64) * clock[1]
    column = next((name for name in INSTANCE if name in fmt.columns), None)
    instance = np.zeros(at.size, np.int64) if column is None else log.column(message, column).astype(np.int64)
    keep = np.ones(at.size, np.bool_) if sifted else believed(t, instance, event=message in EVENTS)
    first = fmt.offset(clock[0])
    body = log.raw(message)[keep]
    width = 8 if fmt.types[fmt.columns.index(clock[0])] in "Qq" else 4
    rest = np.concatenate((body[:, 3:first], body[:, first + width :]), axis=1)
    return Rows(at=at[keep], t=t[keep], instance=instance[keep], content=_hashed(rest))


def believed(t: FloatArray, instance: Ints, *, event: bool) -> NDArray[np.bool_]:
    """Which rows a reader of their log alone would take, shape (n,): their times in order, no gap behind them."""
    keep = np.zeros(t.size, np.bool_)
    for number in np.unique(instance).tolist():
        rows = np.flatnonzero(instance == number)
        rows = rows[increasing(t[rows], strictly=False)]
        if not event and rows.size:
            times, which = np.unique(t[rows], return_inverse=True)
            rows = rows[before_no_gap(times)[which]]
        keep[rows] = True
    return keep


def merge_samples(a: Rows, b: Rows, behind: int) -> Merged:
    """Of a kind that is logged again and again; the second log's rows are numbered from `behind` on."""
    both = _Both.of(a, b, behind)
    firsts, seconds = both.pairs(both.every, both.t, both.instance, both.content)
    left = both.without(firsts, seconds)
    unlike, others = both.pairs(left, both.t, both.instance)
    return Merged(
        order=both.in_time(both.without(seconds, unlike)),
        alone=both.counts(both.without(firsts, seconds, unlike, others)),
        equal=firsts.size,
        telling=int(np.count_nonzero(a.telling[firsts])),
        unlike=unlike.size,
    )


def merge_events(a: Rows, b: Rows, behind: int) -> Merged:
    """Of a kind that tells of what happened once: equal rows near each other in time are one, all others are kept."""
    both = _Both.of(a, b, behind)
    firsts, seconds = both.pairs(both.every, both.t, both.content)
    left = both.without(firsts, seconds)
    near = both.near(left)
    return Merged(
        order=both.in_time(both.without(seconds, near)),
        alone=(a.at.size - firsts.size - near.size, b.at.size - firsts.size - near.size),
        equal=firsts.size + near.size,
        telling=0,
        unlike=0,
    )


@dataclass(frozen=True, eq=False, kw_only=True)
class _Both:
    """The rows of two logs behind each other, all of shape (n,)."""

    at: Ints
    t: FloatArray
    instance: Ints
    content: NDArray[np.uint64]
    second: NDArray[np.bool_]

    @classmethod
    def of(cls, a: Rows, b: Rows, behind: int) -> _Both:
        return cls(
            at=np.concatenate((a.at, b.at + behind)),
            t=np.concatenate((a.t, b.t)),
            instance=np.concatenate((a.instance, b.instance)),
            content=np.concatenate((a.content, b.content)),
            second=np.repeat([False, True], (a.at.size, b.at.size)),
        )

    @property
    def every(self) -> Ints:
        return np.arange(self.t.size)

    def pairs(self, rows: Ints, *keys: NDArray[Any]) -> tuple[Ints, Ints]:
        """Of these rows those of the first log that the second has under the same keys, and the second's."""
        rows = rows[np.lexsort((self.second[rows], *(key[rows] for key in keys)))]
        if not rows.size:
            return rows, rows
        new = np.ones(rows.size, np.bool_)
        new[1:] = np.any([key[rows[1:]] != key[rows[:-1]] for key in keys], axis=0)
        group, second = np.cumsum(new) - 1, self.second[rows]
        firsts, seconds = np.bincount(group, ~second)[group], np.bincount(group, second)[group]
        rank = np.arange(rows.size) - np.flatnonzero(new)[group]
        return rows[~second & (rank < seconds)], rows[second & (rank - firsts < firsts)]

    def near(self, rows: Ints) -> Ints:
        """Of these rows those that follow one of equal content in the other log by at most `SAME_EVENT_S`."""
        rows = rows[np.lexsort((self.t[rows], self.content[rows]))]
        same = (
            (self.content[rows[1:]] == self.content[rows[:-1]])
            & (np.diff(self.t[rows]) <= SAME_EVENT_S)
            & (self.second[rows[1:]] != self.second[rows[:-1]])
        )
        found: list[int] = []
        for place in np.flatnonzero(same).tolist():
            if not found or place > found[-1]:  # else the row before is another's already
                found.append(place + 1)
        return rows[found]

    def without(self, *rows: Ints) -> Ints:
        """All other rows."""
        keep = np.ones(self.t.size, np.bool_)
        for some in rows:
            keep[some] = False
        return np.flatnonzero(keep)

    def counts(self, rows: Ints) -> tuple[int, int]:
        """How many of these rows are the first log's, and the second's."""
        second = int(np.count_nonzero(self.second[rows]))
        return rows.size - second, second

    def in_time(self, rows: Ints) -> Ints:
        """These rows' numbers in the order of time; at one time the first log's first."""
        return self.at[rows[np.lexsort((rows, self.t[rows]))]]


def merge_all(a: RowLog, b: RowLog, *, sifted: tuple[bool, bool]) -> Mapping[str, Merged]:
    """Every kind of two logs, as their times and bytes tell; those without a clock are the first's."""
    return {
        message: _merge(a, b, message, sifted)
        for message in sorted({*a.names, *b.names})
        if _alike(a.formats.get(message), b.formats.get(message))
    }


def _alike(a: Format | None, b: Format | None) -> bool:
    """Whether two logs mean the same by a kind: else it is left to the first."""
    return a is None or b is None or (a.types, a.columns) == (b.types, b.columns)


def _merge(a: RowLog, b: RowLog, message: str, sifted: tuple[bool, bool]) -> Merged:
    logs = [(log, known) for log, known in ((a, sifted[0]), (b, sifted[1])) if message in log.names]
    behind = a.starts(message).size if message in a.names else 0
    clock = clock_of(logs[0][0].formats[message])
    if clock is None:
        return _untimed(logs[0][0].starts(message), second=message not in a.names)
    rows = [rows_of(log, message, sifted=known) for log, known in logs]
    if len(rows) == 2:
        return (merge_events if message in EVENTS else merge_samples)(rows[0], rows[1], behind)
    return _untimed(rows[0].at, second=message not in a.names)


def _untimed(order: Ints, *, second: bool) -> Merged:
    """All rows of one log."""
    return Merged(order=order, alone=(0, order.size) if second else (order.size, 0), equal=0, telling=0, unlike=0)


def _hashed(body: Bytes) -> NDArray[np.uint64]:
    """A number for the bytes of each row, shape (n,): rows that differ in any eight of them have different ones."""
    n, width = body.shape
    words = -(-max(1, width) // 8)
    padded = np.zeros((n, 8 * words), np.uint8)
    padded[:, :width] = body
    draw: NDArray[Any] = np.random.default_rng(words).integers(0, 1 << 63, words, dtype=np.uint64)
    mixed = padded.view(np.uint64)
    mixed = (mixed ^ (mixed >> np.uint64(29))) * (2 * draw + np.uint64(1))
    return np.asarray(mixed.sum(axis=1, dtype=np.uint64))
