"""A log as named series, whatever its format: what profiles take their channels from.

A series is one field with its own clock. Fields that share a clock share every time stamp, so they need no matching.
Here also what formats without checksums need: samples are thrown out whose time stamps cannot be right, because they
break the order of their neighbours, and the last one before a gap, which may be two halves of different messages.
Nothing is put in their place.
"""

from __future__ import annotations

from bisect import bisect_left, bisect_right
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Series:
    """One field over time."""

    t: FloatArray
    """s of the log's own clock, increasing, shape (n,); strictly, but for events,
    several of which may share a time."""
    values: FloatArray
    """Shape (n,); not finite where the log says so."""
    clock: str
    """Series of one log with equal clocks have equal `t`."""

    @cached_property
    def spacing_s(self) -> float:
        """Median spacing; infinite for fewer than two samples."""
        return float(np.median(np.diff(self.t))) if self.t.size > 1 else np.inf

    def part(self, start_s: float, stop_s: float) -> Series:
        """The samples with start_s <= t <= stop_s."""
        first, last = np.searchsorted(self.t, start_s, "left"), np.searchsorted(self.t, stop_s, "right")
        return Series(self.t[first:last], self.values[first:last], self.clock)


TABLES = ("csv", "mat", "mcap", "parquet")
"""Kinds of log that tell of no mode, text or maneuver, as somebody saved them: all of one is one run."""


class Log(Protocol):
    """One boot of a vehicle as it was logged; what a profile is applied to, and where runs are looked for."""

    @property
    def path(self) -> str: ...

    @property
    def kind(self) -> str:
        """`dataflash`, `ulog`, `tlog`, `blackbox`, `crazyflie`, `paparazzi`, or one of `TABLES`."""

    @property
    def sampled_s(self) -> float:
        """From the first sample to the last of what is logged regularly; 0 where there is nothing but events."""

    @property
    def dropped(self) -> Mapping[str, int]:
        """Kind of message -> samples thrown out for an impossible time stamp, of those read so far."""

    def has(self, key: str) -> bool:
        """Whether there is a field of that name with samples in it."""

    def series(self, key: str) -> Series:
        """The field. Raises KeyError where `has` says no."""

    def fields(self) -> tuple[str, ...]:
        """What there is to choose from, for messages to the user."""

    def texts(self) -> Sequence[tuple[float, str]]:
        """What the vehicle said, made printable, with its times in s of the log's clock."""

    def modes(self) -> Sequence[tuple[float, int]]:
        """When which mode was entered, by the autopilot's own number; empty where the log does not tell."""

    def armed(self) -> Sequence[tuple[float, bool]]:
        """When it was armed (True) and disarmed; the first may be the state at the start. Empty where not logged."""


class SavedTable:
    """What the kinds in `TABLES` have in common: nothing but series."""

    def texts(self) -> Sequence[tuple[float, str]]:
        return ()

    def modes(self) -> Sequence[tuple[float, int]]:
        return ()

    def armed(self) -> Sequence[tuple[float, bool]]:
        return ()


NEARBY = 64  # spacings that tell the rate of a place in a log
LATE = 3  # spacings like those nearby


def before_no_gap(t: FloatArray) -> NDArray[np.bool_]:
    """Which samples are followed by the next in time, shape (n,); all of them where there is no regular rate to tell.

    Where bytes are missing, the head of one message can by chance be continued by the tail of a later one of just the
    right length. Nothing in the format shows it, but the next message is then late: the last sample before a gap is not
    believed. What is late is judged by the rate nearby, for a vehicle may change it while it logs.
    """
    keep = np.ones(t.size, np.bool_)
    if t.size >= 10:
        spacing = np.diff(t)
        keep[:-1] = spacing <= late_after_s(spacing)
    return keep


def late_after_s(spacing: FloatArray) -> FloatArray:
    """The spacing above which a message of a log came late, at each of its spacings, shape (n,), n at least 1.

    Three medians of the `NEARBY` spacings around, or of those before or behind where they are longer: where the rate
    falls, the first of the longer spacings are no gaps. (What counts as a gap for a fit is
    `sysid.data.preprocess.gap_threshold_s`.)
    """
    whole = max(1, spacing.size // NEARBY)
    stretch = np.minimum(np.arange(spacing.size) // NEARBY, whole - 1)  # the rest belongs to the last
    last = (whole - 1) * NEARBY
    medians = np.append(np.median(spacing[:last].reshape(-1, NEARBY), axis=1), np.median(spacing[last:]))
    padded = np.concatenate((medians[:1], medians, medians[-1:]))
    return np.asarray(LATE * np.maximum(np.maximum(padded[:-2], medians), padded[2:])[stretch])


def covered_s(t: FloatArray) -> float:
    """How much time samples at t, shape (n,), cover: what lies between them but for the gaps."""
    if t.size < 2:
        return 0.0
    spacing = np.diff(t)
    return float(spacing[spacing <= late_after_s(spacing)].sum())


def changes(t: FloatArray, values: NDArray[Any]) -> list[tuple[float, Any]]:
    """The first value and every other one that is not as the one before, with their times; shapes (n,)."""
    new = np.concatenate(([True], np.diff(values) != 0))
    return list(zip(t[new].tolist(), values[new].tolist(), strict=True))


def stretches(mask: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """First place of each run of True, and the place behind its last."""
    edges = np.flatnonzero(np.diff(np.concatenate(([0], mask.astype(np.int8), [0])))).tolist()
    return list(zip(edges[::2], edges[1::2], strict=True))


LATEST_S = 1e20  # nanoseconds since 1970, taken for seconds, are below it
AROUND = 64  # stamps on either side of a break among which the damaged one is looked for


def increasing(t: FloatArray, *, strictly: bool = True) -> NDArray[np.bool_]:
    """Which samples form the longest increasing sequence of time stamps, shape (n,).

    A damaged stamp breaks the order of its neighbours; the fewest samples are given up to restore it, among those
    around each break where that is enough. A stamp that is not finite, or that no clock shows, never stays. Not
    `strictly`: several may share a time.
    """
    keep = np.abs(t) < LATEST_S
    places = np.flatnonzero(keep)
    stamps = t[places]

    def in_order(values: FloatArray) -> bool:
        steps = np.diff(values)
        return bool(np.all(steps > 0 if strictly else steps >= 0))

    if in_order(stamps):
        return keep
    steps = np.diff(stamps)
    breaks = np.flatnonzero(steps <= 0 if strictly else steps < 0)
    near = np.zeros(stamps.size + 1, np.int64)
    np.add.at(near, np.maximum(breaks - AROUND, 0), 1)
    np.add.at(near, np.minimum(breaks + AROUND, stamps.size), -1)
    looked_at = np.cumsum(near[:-1]) > 0
    if not in_order(stamps[~looked_at]):  # the clock goes back for good: no neighbourhood is enough
        looked_at[:] = True
    chosen = ~looked_at
    for start, stop in stretches(looked_at):
        low = stamps[start - 1] if start else -np.inf
        high = stamps[stop] if stop < stamps.size else np.inf
        part = stamps[start:stop]
        inside = np.flatnonzero((part > low) & (part < high) if strictly else (part >= low) & (part <= high))
        chosen[start + inside[_longest(part[inside], strictly)]] = True
    keep[places] = chosen
    return keep


def _longest(stamps: FloatArray, strictly: bool) -> NDArray[np.int64]:
    """Places of the longest increasing sequence, by patience sorting."""
    place = bisect_left if strictly else bisect_right
    tails: list[float] = []  # smallest last stamp of an increasing sequence of each length
    ends: list[int] = []
    before = np.full(stamps.size, -1, np.int64)
    for i, stamp in enumerate(stamps.tolist()):
        length = place(tails, stamp)
        if length == len(tails):
            tails.append(stamp)
            ends.append(i)
        else:
            tails[length] = stamp
            ends[length] = i
        before[i] = ends[length - 1] if length else -1
    chosen = []
    i = ends[-1] if ends else -1
    while i >= 0:
        chosen.append(i)
        i = int(before[i])
    return np.array(chosen[::-1], np.int64)
