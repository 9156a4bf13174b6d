"""How well a log arrives while it is recorded, and whether the link carries what the vehicle writes.

The link's share is what was kept. The log's need is read in two ways, and the larger counts: by the numbers that the
vehicle gives its blocks, which go on also where blocks are lost, and by the bytes that one second of the log's own
clock takes, which holds also where the link delays the numbers. All is counted over the last seconds.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

BLOCK_BYTES = 200
OVER_S = 5.0
"""What a rate is counted over: long against the reader's waiting for a lost block, short against a flight."""
LEAST_S = 1.0
"""A shorter time tells no rate."""
ENOUGH = 0.9
"""Of the need: less, and the log falls behind; a block waited for at either end of the time costs some per cent."""


SWEEP_RECORD_BYTES = 47
"""What a sweep adds to the log in every loop (SIDD): 23.5 kB/s at 500 Hz. A rate counted before it lacks them."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Tally:
    """The state of one log being recorded, at one moment of the session's clock."""

    at_s: float
    kept: int
    """Blocks on disk."""
    numbered: int
    """One more than the highest number seen."""
    read: int
    """Blocks read in order up to `log_s`, lost ones included."""
    log_s: float | None
    """The newest time stamp read, on the vehicle's clock."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Capacity:
    """What the link carries against what the log needs, over the last `over_s` seconds."""

    over_s: float
    carried: float
    """Bytes a second that were kept."""
    numbered: float
    """Bytes a second by the highest block number: the vehicle writes at least so much."""
    per_log_s: float | None
    """Bytes that a second of the log's own clock takes, None while that clock has not gone on."""
    advance: float | None
    """Seconds of the log read in a second: 1 where the link keeps up, None before the first stamp."""

    @property
    def needed(self) -> float:
        """Bytes a second that the log needs."""
        return max(self.numbered, self.per_log_s or 0.0)

    @property
    def enough(self) -> bool:
        """Whether the link carries the log. False also where nothing came."""
        return self.carried > 0 and self.carried >= ENOUGH * self.needed


@dataclass(frozen=True, slots=True, kw_only=True)
class LogHealth:
    """The log being recorded, at this moment."""

    file: int
    """From 0; counts up where the vehicle began a new log."""
    blocks: int
    """Kept of this log."""
    open: int
    """Known to exist, and not kept."""
    silent_s: float | None
    """Since the last new block was kept, of whatever log; None before the first."""
    log_s: float | None
    """The newest time stamp read from the log, on the vehicle's clock; None before the first."""
    clock_s: float | None
    """The vehicle's clock now, by its telemetry; None where it does not tell."""
    capacity: Capacity | None
    """None before there is enough to count."""
    reported: str
    """The vehicle's own words about having stopped the stream, empty while it goes on."""
    problem: str | None
    """Why blocks are not being kept (a full disk)."""
    another: bool = False
    """Another station answers the vehicle's log."""
    on_card: bool = False
    """The log stays on the vehicle and nothing of it is sent: `blocks` are attitudes by telemetry, `silent_s` is since
    the newest of them, and `reported` says that the vehicle does not write its log."""

    @property
    def behind_s(self) -> float | None:
        """By how much the log that was read is older than the vehicle's clock; about 0 where the link keeps up."""
        return None if self.log_s is None or self.clock_s is None else max(0.0, self.clock_s - self.log_s)


def capacity(tallies: Sequence[Tally], over_s: float = OVER_S) -> Capacity | None:
    """What the last `over_s` seconds show. `tallies` are of one log, oldest first, the last one of now.

    None where they span less than `LEAST_S`.
    """
    if len(tallies) < 2:
        return None
    last = tallies[-1]
    # Between two tallies nothing changed but what the later one shows: the last before the time is its beginning.
    earlier = [tally for tally in tallies[:-1] if tally.at_s <= last.at_s - over_s]
    inside = [*earlier[-1:], *(tally for tally in tallies if tally.at_s > last.at_s - over_s)]
    first = inside[0]
    span = last.at_s - first.at_s
    span = over_s if span > 1.2 * over_s else span  # a silence began long before: what came since came in this time
    if span < LEAST_S:
        return None
    return Capacity(
        over_s=span,
        carried=(last.kept - first.kept) * BLOCK_BYTES / span,
        numbered=(last.numbered - first.numbered) * BLOCK_BYTES / span,
        per_log_s=_per_log_second(inside),
        advance=_advance(inside, span),
    )


def _advance(tallies: Sequence[Tally], span: float) -> float | None:
    first, last = next((tally for tally in tallies if tally.log_s is not None), None), tallies[-1]
    if first is None or first.log_s is None or last.log_s is None:
        return None
    span = min(span, last.at_s - first.at_s)
    return (last.log_s - first.log_s) / span if span >= LEAST_S else None


def _per_log_second(tallies: Sequence[Tally]) -> float | None:
    stamped = [(tally.log_s, tally.read) for tally in tallies if tally.log_s is not None]
    if not stamped:
        return None
    # Formats and parameters at a log's beginning are many bytes in no time: they say nothing about what follows.
    start_s, start = [pair for pair in stamped if pair[0] - stamped[0][0] < 0.01][-1]
    stop_s, stop = stamped[-1]
    return (stop - start) * BLOCK_BYTES / (stop_s - start_s) if stop_s - start_s > 0.2 else None
