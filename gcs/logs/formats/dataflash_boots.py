"""Where in a DataFlash `.BIN` each boot of the vehicle begins.

Where the block of formats comes again, and where the clock of all kinds of message goes back for good.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from gcs.logs.formats.dataflash_chain import Chained, Parts, clocks_of
from gcs.logs.formats.dataflash_scan import PIECE, REACH, Source
from gcs.logs.formats.raw import Offsets

BACK_US = 1_000_000  # a clock that goes back less is damage, not a boot
MEDIAN = 5  # samples of the clock
SAME_BYTES = 300  # more than one message
DECLARING = frozenset({"FMT", "FMTU", "MULT", "UNIT"})
MOST_BREAKS = 200  # of the clock that are looked into


def boots(source: Source, parts: Parts, chained: Chained) -> list[int]:
    """First byte of the log of each boot; the first is 0."""
    firsts = [0]
    quiet = np.array([fmt is None or fmt.name in DECLARING for fmt in parts.kinds])
    for start, stop in pairwise((*parts.firsts, source.size)):
        if stop == source.size and len(parts.firsts) == 1:
            sampled = True
        else:
            pieces = (piece.between(start, stop).kinds for piece in chained.messages)
            sampled = any(kinds.size and not quiet[kinds].all() for kinds in pieces)
        if not sampled:  # a piece of the block of formats: it belongs to what follows
            continue
        first, last = np.searchsorted(chained.places, (start, stop))
        breaks = _breaks(chained.places[first:last], chained.times_us[first:last])
        places = [_break(source, parts, chained, int(first) + k) for k in breaks]
        firsts += [start, *(place for place in places if place is not None)]
    return sorted({0, *firsts[2:]})


def _breaks(places: Offsets, times_us: Offsets) -> list[int]:
    """After which of the samples the clock goes back for good.

    Medians of five, so that it takes several messages. Where the clock later jumps to where it was before, what lies
    between was out of place, and no boot.
    """
    if times_us.size < 2 * MEDIAN:
        return []
    middle = np.median(sliding_window_view(np.pad(times_us, MEDIAN // 2, mode="edge"), MEDIAN), axis=1)
    back = []
    for k in np.flatnonzero(np.diff(middle) < -BACK_US)[:MOST_BREAKS].tolist():
        again = np.flatnonzero(middle[k + 1 :] >= middle[k])[:1]
        stretch = middle[k + 1 :] if again.size == 0 else middle[k + 1 : k + 2 + int(again[0])]
        jump = float(np.diff(stretch).max(initial=0.0)) if again.size else 0.0
        if stretch.size >= MEDIAN and jump < 0.5 * (middle[k] - middle[k + 1]):
            back.append(k)
    return back


def _break(source: Source, parts: Parts, chained: Chained, k: int) -> int | None:
    """The first message after the clock went back near sample k; None where what follows was read before.

    A card can write a block twice; what comes twice is left to the order of the time stamps.
    """
    places, times = chained.places, chained.times_us
    low, high = max(0, k - MEDIAN), min(places.size - 1, k + MEDIAN)
    before, after = int(np.median(times[low : k + 1])), int(np.median(times[k + 1 : high + 1]))
    clocks = clocks_of(parts.kinds)
    start, stop = int(places[low]), int(places[high])
    data = source.part(start, stop + REACH)
    stamped: list[tuple[int, bool]] = []
    for piece in chained.messages:
        if piece.base < stop and piece.base + PIECE > start:
            here = piece.between(start, stop)
            for place, kind in zip((here.at.astype(np.int64) + here.base).tolist(), here.kinds.tolist(), strict=True):
                if clocks[kind]:
                    size = 8 if clocks[kind] == 1 else 4
                    stamp = int.from_bytes(data[place - start + 3 : place - start + 3 + size], "little")
                    stamped.append((place, stamp * int(clocks[kind]) > (before + after) // 2))
    late = np.cumsum([0, *(1 if late else -1 for _, late in stamped)])
    first = stamped[min(int(np.argmax(late)), len(stamped) - 1)][0]  # most before it are late, most after it early
    same = int(np.argmin(np.abs(times[: k + 1] - after)))
    earlier = source.part(int(places[max(0, same - MEDIAN)]), int(places[min(k, same + MEDIAN)]) + REACH)
    return None if data[first - start : first - start + SAME_BYTES] in earlier else first
