"""Only what a flight's runs need of a log, for a slow link: its head, and what it holds around each run.

These pieces follow each other in one file, whole messages each, so that it is read as a log that was silent between
them. It grows in order and is gone on with as a whole log is, because the pieces do not depend on where the log ends.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from gcs.flight.fetching.fetch import Fetched, Fetching, target_of
from gcs.flight.fetching.part import PartFile
from gcs.flight.fetching.times import BLOCK_BYTES, HEAD_BYTES, Read, layout, offset_of, span, stamps
from gcs.flight.fetching.ways import VehicleLog

SLOW_FROM_S = 60.0
"""Where the whole log takes longer, the runs alone are fetched."""
AROUND_S = 1.0
"""Before and after a run, fetched with it: a record holds half a second before and one after its maneuver."""
HEAD_S = 1.0
"""After its first stamp a log's head is over: formats, units, parameters."""
MOST_HEAD_BYTES = 131_072
NEAR_BYTES = 4 * BLOCK_BYTES
"""Pieces that are no farther apart are one."""


@dataclass(frozen=True, slots=True)
class Windows:
    """Pieces of a log, in order: from which byte up to which. The first is its head."""

    pieces: tuple[tuple[int, int], ...]

    @property
    def size(self) -> int:
        """Bytes of all."""
        return sum(stop - start for start, stop in self.pieces)

    def of(self, read: Read) -> Read:
        """Bytes counted along the pieces, by a function that reads the log's own."""
        return lambda start, stop: b"".join(read(low, high) for low, high in self.within(start, stop))

    def within(self, start: int, stop: int) -> list[tuple[int, int]]:
        """Where on the log the bytes `start` up to `stop` of the pieces stand."""
        out, before = [], 0
        for low, high in self.pieces:
            first, last = max(start - before, 0), min(stop - before, high - low)
            if first < last:
                out.append((low + first, low + last))
            before += high - low
        return out


def windows(fetching: Fetching, log: VehicleLog, times: Sequence[tuple[float, float]]) -> Windows | None:
    """The pieces around runs that began and ended at these times, s of the vehicle's clock; None where the log tells
    no times.

    Raises TippathError where the log cannot be read.
    """
    read = fetching.reading(log)
    head = read(0, min(log.size, HEAD_BYTES))
    known = layout(head)
    first, whole = stamps(head, known), span(read, log.size, known)
    if not first or whole is None:
        return None
    head_end = min(MOST_HEAD_BYTES, offset_of(read, log.size, known, first[0].t + HEAD_S))
    pieces = [(0, head_end)]
    for start_s, stop_s in sorted(times):
        start = offset_of(read, log.size, known, start_s - AROUND_S)
        stop = log.size if stop_s + AROUND_S > whole[1] else offset_of(read, log.size, known, stop_s + AROUND_S)
        if start <= pieces[-1][1] + NEAR_BYTES:
            pieces[-1] = (pieces[-1][0], max(pieces[-1][1], stop))
        else:
            pieces.append((start, stop))
    return Windows(tuple(pieces))


def fetch_runs(
    fetching: Fetching, log: VehicleLog, wanted: Windows, folder: Path, stem: str, numbers: Sequence[int]
) -> Fetched:
    """These pieces of the log, with the runs of these numbers, into `folder` as `stem`.BIN or the next free name.

    Raises as `gcs.flight.fetching.fetch.fetch`.
    """
    part_of_log = replace(log, size=wanted.size)
    target, already = target_of(folder, stem, part_of_log, wanted.of(fetching.reading(log)))
    way = fetching.ways_of(log)[0]
    if already:
        return Fetched.there(target, log, way, runs=numbers)
    with PartFile(target, fetching.clock) as part:
        for start, stop in wanted.within(part.size, wanted.size):
            fetching.read(log, way, part.append, start, stop, wanted.size, lambda: part.size)
        crc = part.checksum()
        part.finish()
        return Fetched.of_part(part, log, way, crc32=crc, runs=numbers)
