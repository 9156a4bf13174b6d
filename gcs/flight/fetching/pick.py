"""Which of the vehicle's logs is the flight's: by the vehicle's clock, and where two show the same, by its bytes.

The clock begins anew with every start of the vehicle, so that two logs may cover the same seconds. Where the flight has
its own streamed log, a message of it stands in one of them only; else the one that was written when the flight was
flown is taken, where the vehicle knows the date.
"""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import Any

from gcs.errors import TippathError
from gcs.flight.fetching.part import piece_of
from gcs.flight.fetching.times import HEAD_BYTES, PIECE_BYTES, Read, layout, offset_of, span, stamps
from gcs.flight.fetching.ways import VehicleLog
from gcs.vehicle.readiness import LOGS_TO_CARD

LOOKED_AT = 12
"""Logs, the newest first, of which the times are read."""
SLACK_S = 1.0
"""By which a run may stand outside of its log: the last block is written late."""
SAME_BOOT_S = 60.0
"""By which the vehicle's date of a log may be off, a log going on for 15 s after disarming; another boot is farther."""
SAME_BYTES = 24
"""A message shorter than this proves nothing."""


@dataclass(frozen=True, slots=True)
class Choice:
    """A log, and why it is the one."""

    log: VehicleLog
    words: str


def numbered(logs: Sequence[VehicleLog], number: int) -> Choice:
    """The log with this number. Raises TippathError where there is none, or it cannot be read."""
    log = next((log for log in logs if log.number == number), None)
    if log is None:
        raise TippathError(f"the vehicle has no log {number}; it has {_list(logs)}")
    if not log.readable:
        raise TippathError(f"log {number} cannot be fetched: the vehicle says that it has {log.size:,} bytes")
    return Choice(log, "as named")


def newest(logs: Sequence[VehicleLog]) -> Choice:
    """The newest log that has bytes. Raises TippathError where there is none."""
    log = next((log for log in reversed(logs) if log.readable), None)
    if log is None:
        empty = f"of its {len(logs)} logs none has bytes" if logs else "it has no logs"
        raise TippathError(f"nothing to fetch from this vehicle: {empty}; does it log to its card ({LOGS_TO_CARD})?")
    return Choice(log, "the newest")


def run_times(runs: Sequence[Mapping[str, Any]]) -> list[tuple[float, float] | None]:
    """Begin and end of each run on the vehicle's clock, s; None where flight.json does not tell."""
    return [_times(run) for run in runs]


def _times(run: Mapping[str, Any]) -> tuple[float, float] | None:
    start, duration = run.get("log_start_s"), run.get("duration_s")
    if not isinstance(start, int | float) or not isinstance(duration, int | float):
        return None
    return float(start), float(start) + float(duration)


def boots(runs: Sequence[Mapping[str, Any]]) -> list[list[int]]:
    """The places in flight.json, from 1, of the runs of each log that a flight was recorded into, in order; where the
    log stayed on the card, of each start of the vehicle, as far as the ground's clock tells that."""
    groups: list[tuple[str | None, float | None, list[int]]] = []
    for place, run in enumerate(runs, 1):
        file, booted_s = run.get("file"), booted([run])
        for known, other_s, places in groups:
            apart = booted_s is not None and other_s is not None and abs(booted_s - other_s) > SAME_BOOT_S
            if known == file and (file is not None or not apart):
                places.append(place)
                break
        else:
            groups.append((file, booted_s, [place]))
    return [places for *_, places in groups]


def booted(runs: Sequence[Mapping[str, Any]]) -> float | None:
    """When the vehicle's clock began, s since 1970, by the first of these runs that tells it; None where none does."""
    for run in runs:
        times = _times(run)
        with contextlib.suppress(TypeError, ValueError):
            if times is not None:
                return datetime.fromisoformat(run.get("started", "")).timestamp() - times[0]
    return None


def of_flight(
    logs: Sequence[VehicleLog],
    runs: Sequence[Mapping[str, Any]],
    streamed: Path,
    reading: Callable[[VehicleLog], Read],
    *,
    booted_s: float | None = None,
) -> Choice:
    """The log of a flight with these runs; `streamed` is its own log, which need not be there. `booted_s` is when the
    vehicle's clock began, seconds since 1970, None where that is not known.

    Raises TippathError where none of the logs covers the runs.
    """
    known = [times for times in run_times(runs) if times is not None]
    if not known:
        choice = newest(logs)
        return Choice(choice.log, "the newest: the flight tells no times of the vehicle's clock")
    first, last = min(start for start, _ in known), max(stop for _, stop in known)
    covering = [log for log in _latest(logs) if _covers(log, reading(log), first, last)]
    if not covering:
        return _of_most(logs, known, reading)
    if len(covering) == 1:
        return Choice(covering[0], "by the vehicle's clock")
    same = [log for log in covering if _holds(log, reading(log), streamed, (first + last) / 2.0)]
    if len(same) == 1:
        return Choice(same[0], f"by its bytes, of {len(covering)} logs with the same clock")
    dated = _of_boot(covering, reading, booted_s)
    if dated is not None:
        return Choice(dated, f"by its date, of {len(covering)} logs with the same clock")
    return Choice(
        covering[0],
        f"the newest of {len(covering)} logs that show the same times of the vehicle's clock ({_list(covering)}); "
        "--log NUMBER takes another",
    )


def _of_most(
    logs: Sequence[VehicleLog],
    known: Sequence[tuple[float, float]],
    reading: Callable[[VehicleLog], Read],
) -> Choice:
    """The log with the most of the runs, where none has all: the vehicle ended it early, or began another in between.

    Raises TippathError where none has one.
    """
    latest = _latest(logs)
    counts = [sum(_covers(log, reading(log), first, last) for first, last in known) for log in latest]
    most = max(counts, default=0)
    if not most:
        first, last = min(first for first, _ in known), max(last for _, last in known)
        raise TippathError(
            f"none of the vehicle's newest logs covers the flight's runs ({first:.0f} to {last:.0f} s of the vehicle's "
            "clock): was its card full, or another one, or are they erased? What was recorded in flight stays as it "
            f"is. It has {_list(logs)}; --log NUMBER takes one"
        )
    words = f"by the vehicle's clock; it has {most} of the flight's {len(known)} runs, no log has more"
    return Choice(latest[counts.index(most)], words)


def _latest(logs: Sequence[VehicleLog]) -> list[VehicleLog]:
    return [log for log in reversed(logs) if log.readable][:LOOKED_AT]


def _of_boot(
    logs: Sequence[VehicleLog], reading: Callable[[VehicleLog], Read], booted_s: float | None
) -> VehicleLog | None:
    """The only one of these whose last message is as old as its date says; None where there is not one."""
    if booted_s is None or not all(log.utc_s for log in logs):
        return None
    ends = [(log, span(read := reading(log), log.size, layout(read(0, min(log.size, HEAD_BYTES))))) for log in logs]
    near = [log for log, times in ends if times and abs(log.utc_s - times[1] - booted_s) <= SAME_BOOT_S]
    return near[0] if len(near) == 1 else None


def _covers(log: VehicleLog, read: Read, first: float, last: float) -> bool:
    times = span(read, log.size, layout(read(0, min(log.size, HEAD_BYTES))))
    return times is not None and times[0] <= first + SLACK_S and times[1] >= last - SLACK_S


def _holds(log: VehicleLog, read: Read, streamed: Path, t: float) -> bool:
    """Whether the log holds a message that the flight's own has at about this time."""
    try:
        size = streamed.stat().st_size
        ours: Read = lambda start, stop: piece_of(streamed, start, stop)  # noqa: E731
        message = _message_at(ours, size, t)
    except (OSError, TippathError):
        return False
    if message is None:
        return False
    stamp, content = message
    at = offset_of(read, log.size, layout(read(0, min(log.size, HEAD_BYTES))), stamp)
    return content in read(max(0, at - PIECE_BYTES), min(log.size, at + 3 * PIECE_BYTES))


def _message_at(read: Read, size: int, t: float) -> tuple[float, bytes] | None:
    known = layout(read(0, min(size, HEAD_BYTES)))
    at = offset_of(read, size, known, t)
    piece = read(at, min(size, at + PIECE_BYTES))
    return next(
        ((one.t, piece[one.at : one.at + one.size]) for one in stamps(piece, known) if one.size >= SAME_BYTES), None
    )


def _list(logs: Sequence[VehicleLog]) -> str:
    shown = ", ".join(str(log.number) for log in logs[-8:])
    return "no logs at all" if not logs else f"{'... ' if len(logs) > 8 else ''}{shown}"
