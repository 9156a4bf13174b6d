"""Two binary DataFlash logs of one flight as one: the streamed one and the card's, which drop independently.

They are of one flight where samples of the same TimeUS are equal to the last byte, and enough of them say something
that another flight would not: a clock that two boots share is no evidence. Neither file is changed.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gcs.logs.formats.dataflash import DataFlashLog
from gcs.logs.formats.dataflash_losses import Losses, Stretches, losses
from gcs.logs.formats.dataflash_merge import Ints, Merged, RowLog, clock_of, merge_all
from gcs.logs.formats.dataflash_scan import Format
from gcs.logs.formats.dataflash_table import EVENTS, INSTANCE
from gcs.logs.formats.raw import Bytes
from gcs.logs.formats.tables import LATE, FloatArray, late_after_s

ENOUGH = 20
"""Samples that are equal and tell something: fewer prove no flight."""
MOST_EQUAL = 0.9
"""Of the samples of one key so many are equal; damage alone makes few of them differ."""
MOST_OF = 0.5
"""Of a kind's silence, where it is one that was lost."""


@dataclass(frozen=True, eq=False)
class JoinedLog:
    """Two logs' messages, each once. What a gap follows in its own file was left out before they were joined."""

    first: RowLog
    second: RowLog
    merged: Mapping[str, Merged]
    lost: Losses
    """What both may lack."""

    @cached_property
    def formats(self) -> Mapping[str, Format]:
        return {**self.second.formats, **self.first.formats}

    @cached_property
    def names(self) -> tuple[str, ...]:
        held = {name for name, one in self.merged.items() if one.order.size}
        return tuple(sorted({*held, *(name for name in self.first.names if name not in self.merged)}))

    def starts(self, message: str) -> Ints:
        """A number for every message of this type, in the order of time, shape (n,)."""
        if message in self.merged:
            return np.arange(self.merged[message].order.size)
        return self.first.starts(message) if message in self.first.names else np.empty(0, np.int64)

    def column(self, message: str, column: str, starts: Ints | None = None) -> NDArray[Any]:
        """One field of every message of a type, or of those that `starts` names. Raises KeyError."""
        both = [log.column(message, column) for log in self._holding(message)]
        values = self._ordered(message, np.concatenate(both) if len(both) > 1 else both[0])
        return values if starts is None else values[starts]

    def texts(self, message: str, column: str) -> list[str]:
        """A string field, made printable."""
        every = [text for log in self._holding(message) for text in log.texts(message, column)]
        return [every[k] for k in self._ordered(message, np.arange(len(every))).tolist()]

    def raw(self, message: str) -> Bytes:
        """Every message of a type as its bytes, header included, shape (n, length). Raises KeyError."""
        return self._ordered(message, np.concatenate([log.raw(message) for log in self._holding(message)]))

    @property
    def samples(self) -> int:
        """Of the kinds that both have."""
        return sum(self.merged[name].order.size for name in self._shared)

    @property
    def filled(self) -> tuple[int, int]:
        """Of these, those that the first has alone, and the second."""
        alone = [self.merged[name].alone for name in self._shared]
        return sum(first for first, _ in alone), sum(second for _, second in alone)

    @property
    def added(self) -> tuple[bool, bool]:
        """Whether the first adds anything to the second, and the second to the first, of whatever kind."""
        every = self.merged.values()
        unlike = any(one.unlike for one in every)
        return any(one.alone[0] for one in every), unlike or any(one.alone[1] for one in every)

    @property
    def unlike(self) -> int:
        return sum(one.unlike for one in self.merged.values())

    @property
    def shared(self) -> int:
        return sum(one.telling for one in self.merged.values())

    @property
    def missing(self) -> int:
        """Samples that neither has, by the spacing of those around them."""
        lost = self.lost.inside
        return sum(self._missing_of(name, lost) for name in self._shared) if len(lost) else 0

    def _missing_of(self, message: str, lost: Stretches) -> int:
        clock = clock_of(self.formats[message])
        assert clock is not None
        t = self.column(message, clock[0]).astype(np.float64) * clock[1]
        column = next((name for name in INSTANCE if name in self.formats[message].columns), None)
        instance = np.zeros(t.size) if column is None else self.column(message, column)
        return sum(_missing(np.unique(t[instance == number]), lost) for number in np.unique(instance).tolist())

    @cached_property
    def _shared(self) -> list[str]:
        """Kinds that are logged again and again, and are in both."""
        names = set(self.first.names) & set(self.second.names) & set(self.merged)
        return sorted(name for name in names - EVENTS if clock_of(self.formats[name]) is not None)

    def _holding(self, message: str) -> list[RowLog]:
        """The logs whose rows the order counts."""
        if message not in self.merged or message not in self.second.names:
            return [self.first if message in self.first.formats else self.second]
        return [log for log in (self.first, self.second) if message in log.names]

    def _ordered(self, message: str, values: NDArray[Any]) -> NDArray[Any]:
        return values[self.merged[message].order] if message in self.merged else values


AnyLog = DataFlashLog | JoinedLog


def join(a: AnyLog, b: AnyLog) -> JoinedLog | str:
    """The two as one, the second's rows taken where they differ; or why they are not of one flight."""
    merged = merge_all(a, b, sifted=(isinstance(a, JoinedLog), isinstance(b, JoinedLog)))
    equal, unlike = (sum(getattr(one, what) for one in merged.values()) for what in ("telling", "unlike"))
    if not equal + unlike:
        return "they share no sample, by the vehicle's clock: another flight, another part of it, or another boot"
    if equal < MOST_EQUAL * (equal + unlike):
        return (
            f"of {equal + unlike:,} samples of the same time {unlike:,} differ: another boot with the same clock, or "
            "another vehicle"
        )
    if equal < ENOUGH:
        return f"they share {equal} samples only, too few to show that they are of one flight"
    return JoinedLog(a, b, merged, _losses(a).and_of(_losses(b)))


def _losses(log: AnyLog) -> Losses:
    return log.lost if isinstance(log, JoinedLog) else losses(log)


def _missing(t: FloatArray, lost: Stretches) -> int:
    """How many samples at the pace of t, shape (n,), are missing in the stretches."""
    steps = np.diff(t)
    if steps.size < 2:
        return 0
    late_after = late_after_s(steps)
    late = np.flatnonzero(steps > late_after)
    inside = _lost_before(t[late + 1], lost) - _lost_before(t[late], lost)
    # A kind that is silent for long, and lost for a moment of it, says nothing of that moment.
    hit = late[inside >= MOST_OF * steps[late]]
    pace = late_after[hit] / LATE
    return int(np.sum(np.maximum(0, np.round(steps[hit] / pace) - 1)))


def _lost_before(t: FloatArray, lost: Stretches) -> FloatArray:
    """How much of the stretches lies before each time, s, shape (n,)."""
    lengths = np.concatenate(([0.0], np.cumsum(lost[:, 1] - lost[:, 0])))
    k = np.searchsorted(lost[:, 0], t, "right")
    over = np.where(k > 0, np.maximum(0.0, lost[np.maximum(k - 1, 0), 1] - t), 0.0)
    return np.asarray(lengths[k] - over)
