"""Blackbox logs of Betaflight, INAV, Rotorflight and Cleanflight: .bbl, .bfl and .TXT as they come off the vehicle.

An own decoder by the format's description: `orangebox`, the one on PyPI, is GPL-3, takes ten times as long, and raises
at damage. GPS frames are passed over.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from gcs.errors import TippathError
from gcs.logs.formats import blackbox_frames as frames
from gcs.logs.formats import blackbox_header
from gcs.logs.formats.blackbox_frames import Chain, chained, main_values, raw_values
from gcs.logs.formats.blackbox_header import MARK, Header
from gcs.logs.formats.blackbox_table import MAIN, BlackboxLog, blackbox_log, scale_of
from gcs.logs.formats.columns import Column
from gcs.logs.formats.damage import Damage
from gcs.logs.formats.raw import Bytes, unreadable
from gcs.logs.formats.tables import FloatArray, before_no_gap, increasing
from gcs.logs.words import printable

SLOW = "blackbox slow"
FEWEST = 10  # frames of a log that is worth a line
NAMED = 3


@dataclass(frozen=True, eq=False, kw_only=True)
class BlackboxFile:
    """A file as logs."""

    logs: tuple[BlackboxLog, ...]
    """At least one."""
    damage: Damage
    sha256: str
    notes: tuple[str, ...]


def recognises(head: bytes) -> bool:
    return head.startswith(MARK)


def read(path: Path) -> BlackboxFile:
    """Raises TippathError where no log in it can be read."""
    try:
        data = path.read_bytes()
    except OSError as error:
        raise unreadable(path, error) from error
    begins = list(_begins(data))
    if not begins:
        raise TippathError(
            f"{path}: no blackbox log; one begins with the line {MARK.decode()}: take the file from the vehicle again"
        )
    padded = np.frombuffer(data + bytes(frames.LONGEST), np.uint8)
    found: list[tuple[BlackboxLog, Chain]] = []
    refused: list[str] = []
    empty = 0
    for number, (start, stop) in enumerate(pairwise([*begins, len(data)]), 1):
        where = f"{path}: log {number}" if len(begins) > 1 else str(path)
        try:
            header = blackbox_header.parse(data[start:stop], where)
        except TippathError as error:
            refused.append(str(error))
            continue
        chain = chained(data, padded, start + header.size, stop, header)
        if chain.main.size >= FEWEST:
            found.append((_log(path, padded, chain, header), chain))
        else:
            empty += 1
    if not found:
        none = f"{path}: no samples: what is in it ends right behind its header; take the file from the vehicle again"
        raise TippathError("\n".join(refused) or none)
    chains = [chain for _, chain in found]
    skipped = begins[0] + sum(chain.skipped_bytes for chain in chains)
    damage = Damage(len(data), skipped, sum(c.breaks for c in chains), {}, chains[-1].tail_cut)
    logs = tuple(log for log, _ in found)
    return BlackboxFile(
        logs=logs, damage=damage, sha256=hashlib.sha256(data).hexdigest(), notes=_notes(logs, empty, refused)
    )


def _begins(data: bytes) -> Iterator[int]:
    at = data.find(MARK)
    while at >= 0:
        yield at
        at = data.find(MARK, at + 1)


def _notes(logs: Sequence[BlackboxLog], empty: int, refused: Sequence[str]) -> tuple[str, ...]:
    notes = [f"{len(logs)} logs in this file, each armed anew"] if len(logs) > 1 else []
    if empty:
        notes.append(f"{empty} more log{'s' if empty > 1 else ''} in it without samples")
    notes += [f"left out: {printable(reason)}" for reason in refused[:NAMED]]
    if len(refused) > NAMED:
        notes.append(f"left out: {len(refused) - NAMED} more logs whose header cannot be used")
    return tuple(notes)


def _log(path: Path, padded: Bytes, chain: Chain, header: Header) -> BlackboxLog:
    names, signed = header.layouts["I"].names, header.layouts["I"].signed
    values = main_values(padded, chain, header)
    t = _seconds(values[:, names.index("time")])
    in_order = increasing(t)
    keep = np.flatnonzero(in_order)
    keep = keep[before_no_gap(t[keep])] if chain.breaks else keep
    columns = {
        name: Column(MAIN, values[keep, place].view(np.int32 if signed[place] else np.uint32), scale_of(name, header))
        for place, name in enumerate(names)
        if name != "time"
    }
    return blackbox_log(
        str(path),
        header,
        t[keep],
        columns,
        slow=_slow(padded, chain, header, t),
        said=[
            (_when(t, event.before), printable(event.text))
            for event in chain.events
            if event.kind == frames.CUSTOM_STRING
        ],
        entered=[
            (_when(t, event.before), event.numbers[0]) for event in chain.events if event.kind == frames.FLIGHT_MODE
        ],
        left_out=int(np.count_nonzero(~in_order)),
    )


def _seconds(stamps: NDArray[np.int32]) -> FloatArray:
    """32 bits of microseconds, which begin anew after 71 minutes."""
    us = stamps.view(np.uint32).astype(np.int64)
    anew = np.cumsum(np.diff(us, prepend=us[:1]) < -(1 << 31))
    return (us + (anew << 32)) * 1e-6


def _when(t: FloatArray, before: int) -> float:
    return float(t[max(before, 1) - 1])


def _slow(
    padded: Bytes, chain: Chain, header: Header, t: FloatArray
) -> tuple[str, FloatArray, dict[str, Column]] | None:
    """Flags that are logged now and then, at the time of the main frame before them."""
    layout = header.layouts.get("S")
    if layout is None or chain.slow.size == 0:
        return None
    values = raw_values(padded, chain.slow, layout)
    times = t[np.maximum(chain.slow_before, 1) - 1]
    keep = np.flatnonzero(increasing(times))
    fields = {name: Column(SLOW, values[keep, place].view(np.uint32)) for place, name in enumerate(layout.names)}
    return SLOW, times[keep], fields
