"""Which places of a DataFlash `.BIN` are messages, and which formats hold where.

`chain` computes where each message would end and follows the chain from one to the next. Where every end meets the next
header nothing needs to be walked; Python looks only at the places where it does not: header bytes inside a payload
(skipped, the chain leads over them) and damage.

After damage the chain is taken up at the next header whose own end meets a header. A message whose end meets none is
dropped: it may have been cut and continued with bytes of another, and a sample is never invented.

Formats hold for a part of the file: where the block of formats comes again another log begins, and with it another
boot.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gcs.logs.formats.damage import Damage
from gcs.logs.formats.dataflash_scan import (
    FMT,
    FMT_ID,
    HEAD,
    LONGEST,
    PIECE,
    REACH,
    SAMPLED,
    Format,
    Places,
    Source,
)
from gcs.logs.formats.raw import Offsets

BLOCK = 8  # formats declared again in a row: another log begins
MOST_PARTS = 256  # of a file, with formats of their own
END = 1 << 62  # beyond every file
OFTEN = 10  # messages of an unknown id that tell its length


@dataclass(eq=False)
class Parts:
    """Which formats hold where."""

    firsts: list[int]
    """First byte of each part of the file, ascending; the first is 0."""
    kinds: list[Format | None]
    """Every format of the file; a number among the first 256 is also its message id. None: no format is known."""
    kind_of: NDArray[np.uint16]
    """Message id -> kind, shape (parts, 256)."""
    lengths: NDArray[np.uint32]
    """Message id -> bytes of the whole message, shape (parts, 256); 0 where nobody knows."""

    def of(self, place: int) -> int:
        """In which part a byte of the file lies."""
        return int(np.searchsorted(self.firsts, place, "right")) - 1


def settle(definitions: Sequence[tuple[int, Format]], places: Sequence[Places]) -> Parts:
    """One format for each id and part. Where several claim an id, the one whose length most messages have."""
    firsts = _firsts(definitions)
    claims: list[dict[int, Counter[Format]]] = [{} for _ in firsts]
    everywhere: dict[int, Counter[Format]] = {}
    parts = Parts(
        firsts,
        [None] * 256,
        np.tile(np.arange(256, dtype=np.uint16), (len(firsts), 1)),
        np.zeros((len(firsts), 256), np.uint32),
    )
    for place, fmt in definitions:
        claims[parts.of(place)].setdefault(fmt.id, Counter())[fmt] += 1
        everywhere.setdefault(fmt.id, Counter())[fmt] += 1
    numbers: dict[Format, int] = {}
    everywhere.setdefault(FMT_ID, Counter({FMT: 1}))
    for k, (start, stop) in enumerate(pairwise((*firsts, END))):
        doubtful = np.zeros(256, np.bool_)
        doubtful[[id for id in everywhere if len(claims[k].get(id, ())) != 1]] = True
        distances = _distances(places, doubtful, start, stop) if doubtful.any() else None
        for id, anywhere in everywhere.items():
            here = claims[k].get(id)
            if distances is None or not doubtful[id]:
                fmt = next(iter(here or anywhere))
            else:  # several, or its FMT is lost here and one from elsewhere may stand in
                counts, candidates = distances[id], here or anywhere
                fmt = max(candidates, key=lambda f: (counts[f.length], candidates[f], len(f.columns)))
                if here is None and 2 * counts[fmt.length] <= counts.sum():
                    continue
            if fmt not in numbers:
                free = parts.kinds[id] is None
                numbers[fmt] = id if free else len(parts.kinds)
                if free:
                    parts.kinds[id] = fmt
                else:
                    parts.kinds.append(fmt)
            parts.kind_of[k, id], parts.lengths[k, id] = numbers[fmt], fmt.length
    return parts


def _firsts(definitions: Sequence[tuple[int, Format]]) -> list[int]:
    """Where the block of formats begins again: several ids in a row, each of which was declared before."""
    firsts = [0]
    declared: set[int] = set()
    again: dict[int, int] = {}  # id -> place, of the row that is going on
    for place, fmt in definitions:
        if fmt.id not in declared or fmt.id in again:
            declared.update(again)
            again.clear()
        if fmt.id not in declared:
            declared.add(fmt.id)
            continue
        again[fmt.id] = place
        if len(again) >= max(2, min(BLOCK, len(declared) // 2)) and len(firsts) < MOST_PARTS:
            firsts.append(next(iter(again.values())))
            declared = set(again)
            again.clear()
    return firsts


def _distances(places: Sequence[Places], asked: NDArray[np.bool_], start: int, stop: int) -> NDArray[np.int64]:
    """How often the next header stands so many bytes after one of the ids asked for; 0 stands for further.

    In a part of the file; shape (256, 256), ids and bytes; `asked` has shape (256,).
    """
    counts = np.zeros((256, 256), np.int64)
    for piece in places[start // PIECE : stop // PIECE + 1]:
        here = piece if start <= piece.base and piece.base + PIECE <= stop else piece.between(start, stop)
        which = np.flatnonzero(asked[here.kinds[:-1]])
        apart = here.at[which + 1] - here.at[which]
        np.add.at(counts, (here.kinds[which], np.where(apart > LONGEST, 0, apart)), 1)
    return counts


@dataclass(frozen=True, eq=False, slots=True)
class Chained:
    """The messages of a file."""

    messages: list[Places]
    damage: Damage
    places: Offsets
    """Some messages that tell their time: the first byte of each, shape (n,)."""
    times_us: Offsets
    """Their times, shape (n,)."""


def chain(source: Source, parts: Parts, places: list[Places]) -> Chained:
    """The messages among the header places, and what lies between them; `places` is used up.

    An id without a format whose messages are many is stepped over by the length that most of them have.
    """
    _learn_lengths(parts, places)
    walk = _Walk(source, parts)
    for k, piece in enumerate(places):
        places[k] = walk.messages(piece, places[k + 1] if k + 1 < len(places) else None)
    none = np.empty(0, np.int64)
    return Chained(places, walk.damage, np.concatenate((none, *walk.places)), np.concatenate((none, *walk.times_us)))


def _learn_lengths(parts: Parts, places: Sequence[Places]) -> None:
    """Lengths of the messages whose format is lost: how far behind most of them the next header stands."""
    for k, (start, stop) in enumerate(pairwise((*parts.firsts, END))):
        counts = _distances(places, parts.lengths[k] == 0, start, stop)
        length = np.argmax(counts[:, 4:], axis=1) + 4
        most = counts[np.arange(256), length]
        learned = (most >= OFTEN) & (2 * most > counts.sum(axis=1))
        parts.lengths[k, learned] = length[learned]
        parts.kind_of[k, learned] = len(parts.kinds)
    if np.any(parts.kind_of == len(parts.kinds)):
        parts.kinds.append(None)


def clocks_of(kinds: Sequence[Format | None]) -> NDArray[np.int64]:
    """What the first bytes of the payload of each kind tell: 1 microseconds, 1000 milliseconds, 0 no time."""
    units = {("TimeUS", "Q"): 1, ("TimeMS", "I"): 1000}
    return np.array([0 if f is None else units.get((*f.columns[:1], f.types[:1]), 0) for f in kinds])  # type: ignore[arg-type]


class _Walk:
    """The way along the chain, piece by piece."""

    def __init__(self, source: Source, parts: Parts) -> None:
        self.size = source.size
        self.tail = source.part(max(0, source.size - 2), source.size)
        self.parts = parts
        self.real = np.array([fmt is not None for fmt in parts.kinds])
        self.learned = len(parts.kinds) > 256 and bool(np.any(parts.lengths[~self.real[parts.kind_of]]))
        self.clocks = clocks_of(parts.kinds)
        self.places: list[Offsets] = []
        self.times_us: list[Offsets] = []
        self.unknown: Counter[int] = Counter()
        self.kept = 0
        self.resyncs = 0
        self.end = 0
        """Where the last message ends."""
        self.link = -1
        """First byte of the next message; -1 where it is not known and has to be found."""

    @property
    def damage(self) -> Damage:
        unknown = dict(sorted(self.unknown.items()))
        return Damage(self.size, self.size - self.kept, self.resyncs, unknown, self.end < self.size)

    def messages(self, piece: Places, following: Places | None) -> Places:
        """Those places of a piece that are messages."""
        n = piece.at.size
        if n == 0:
            return piece
        length, kinds = self._tables(piece)
        ahead = np.empty(0, np.uint32) if following is None else following.at[: np.searchsorted(following.at, REACH)]
        at = np.concatenate((piece.at, ahead + np.uint32(PIECE), np.array([0xFFFFFFFF], np.uint32)))
        chosen = self._select(piece, at, piece.at + length, length)
        if self.learned:
            lost = chosen & ~self.real[kinds]
            self.unknown.update(piece.kinds[lost].tolist())
            self.kept -= int(length[lost].sum())
            chosen &= ~lost
        self._ask(piece, kinds, chosen)
        none = np.empty(0, np.uint64)  # a slice would keep the rest
        if chosen.all():
            return Places(piece.base, piece.at, kinds, none)
        return Places(piece.base, piece.at[chosen], kinds[chosen], none)

    def _tables(self, piece: Places) -> tuple[NDArray[np.uint32], NDArray[Any]]:
        """Length and kind of what begins at each place."""
        ids, parts = piece.kinds, self.parts
        low, high = parts.of(piece.base), parts.of(piece.base + PIECE - 1)
        if low == high:
            return parts.lengths[low][ids], ids if len(parts.kinds) == 256 else parts.kind_of[low][ids]
        which = np.searchsorted(parts.firsts, piece.base + piece.at.astype(np.int64), "right") - 1
        return parts.lengths[which, ids], ids if len(parts.kinds) == 256 else parts.kind_of[which, ids]

    def _ask(self, piece: Places, kinds: NDArray[Any], chosen: NDArray[np.bool_]) -> None:
        """Note the time of some of the messages."""
        unit = self.clocks[kinds[::SAMPLED]] * chosen[::SAMPLED]
        told = np.flatnonzero(unit)
        stamps, unit = piece.stamps[told].view(np.int64), unit[told]
        stamps = np.where(unit == 1, stamps, stamps & 0xFFFFFFFF) & 0x7FFFFFFFFFFFF  # no overflow below
        self.times_us.append(stamps * unit)
        self.places.append(piece.base + piece.at[told * SAMPLED].astype(np.int64))

    def _select(
        self, piece: Places, at: NDArray[np.uint32], ends: NDArray[np.uint32], length: NDArray[np.uint32]
    ) -> NDArray[np.bool_]:
        """Which places of a piece lie on the chain; `at` has those just after the piece too."""
        n = ends.size
        odd_ones = np.append(np.flatnonzero(ends != at[1 : n + 1]), n)  # the others end where the next place stands
        others = odd_ones[:-1]
        others = others[length[others] > 0]
        where = np.searchsorted(at, ends[others])
        meets = at[where] == ends[others]
        onward = dict(zip(others[meets].tolist(), where[meets].tolist(), strict=True))
        if piece.base + PIECE + REACH >= self.size:
            for k in others[~meets].tolist():
                rest = self.size - piece.base - int(ends[k])  # too few bytes for a header
                if rest == 0 or (0 < rest < 3 and self.tail[-rest:] == bytes(HEAD[:rest])):
                    onward[k] = n
        entries: Offsets | None = None

        def enter(after: int) -> int:
            """The next place where the chain can be taken up: a known message that ends at a header."""
            nonlocal entries
            if entries is None:
                linked = np.ones(n, np.bool_)
                linked[odd_ones[:-1]] = False
                linked[list(onward)] = True
                if self.learned:
                    linked &= self.real[self._tables(piece)[1]]
                entries = np.append(np.flatnonzero(linked), n)
            entry = int(entries[np.searchsorted(entries, after)])
            if entry < n:
                self.resyncs += piece.base + int(at[entry]) > 0
            return entry

        chosen = np.zeros(n, np.bool_)
        here = enter(0) if self.link < 0 else int(np.searchsorted(piece.at, self.link - piece.base))
        while here < n:
            odd = int(odd_ones[np.searchsorted(odd_ones, here)])
            goes_on = odd == n or odd in onward
            stop = min(odd + goes_on, n)
            if stop > here:
                chosen[here:stop] = True
                self.end = piece.base + int(ends[stop - 1])
                self.kept += int(ends[stop - 1]) - int(at[here])
            if goes_on:
                self.link = self.end
                here = onward.get(odd, n)
                continue
            self.link = -1
            if length[odd] == 0:
                self.unknown[int(piece.kinds[odd])] += 1
            here = enter(odd + 1)
        return chosen
