"""Where the messages of a DataFlash `.BIN` stand, and which formats hold where.

A log is a chain: two header bytes, one id byte, and a length that the FMT messages give per id. `scan` lists every
place where header bytes stand; `chain` computes where each message would end and follows the chain from one to the
next. Where every end meets the next header nothing needs to be walked; Python looks only at the places where it does
not: header bytes inside a payload (skipped, the chain leads over them) and damage.

After damage the chain is taken up at the next header whose own end meets a header. A message whose end meets none is
dropped: it may have been cut and continued with bytes of another, and a sample is never invented.

Formats hold for a part of the file: where the block of formats comes again another log begins, and with it another
boot. So it does where the clock of all kinds of message goes back for good.
"""

from __future__ import annotations

import hashlib
import re
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from gcs.errors import TippathError
from gcs.logs.formats.damage import Damage

Bytes = NDArray[np.uint8]
Offsets = NDArray[np.int64]

HEAD = (0xA3, 0x95)
FMT_ID = 0x80
FMT_LENGTH = 89
LONGEST = 255  # bytes of a message: its length is one byte
PIECE = 1 << 21  # bytes looked at in one go: they stay in the processor's cache
REACH = LONGEST + 3  # how far beyond a piece a message that begins in it may need to look
MOST_DEFINITIONS = 4096  # of FMT messages that differ; a real log has some 200
MOST_PLACES = 1 << 16  # where FMT messages stand
BLOCK = 8  # formats declared again in a row: another log begins
MOST_PARTS = 256  # of a file, with formats of their own
END = 1 << 62  # beyond every file
OFTEN = 10  # messages of an unknown id that tell its length
SAMPLED = 31  # of so many places one is asked for its time, to tell boots; a prime, as loops have other periods
BACK_US = 1_000_000  # a clock that goes back less is damage, not a boot
MEDIAN = 5  # samples of the clock
SAME_BYTES = 300  # more than one message
DECLARING = frozenset({"FMT", "FMTU", "MULT", "UNIT"})
MOST_BREAKS = 200  # of the clock that are looked into

CLOCKS: Mapping[str, float] = MappingProxyType({"TimeUS": 1e-6, "TimeMS": 1e-3})
"""Field that holds the time -> its unit in s, the likelier first."""
TYPES: Mapping[str, tuple[str, float | None]] = MappingProxyType(
    {
        "a": ("(32,)<i2", None),
        "b": ("<i1", None),
        "B": ("<u1", None),
        "g": ("<f2", None),
        "h": ("<i2", None),
        "H": ("<u2", None),
        "i": ("<i4", None),
        "I": ("<u4", None),
        "f": ("<f4", None),
        "d": ("<f8", None),
        "n": ("S4", None),
        "N": ("S16", None),
        "Z": ("S64", None),
        "c": ("<i2", 100.0),
        "C": ("<u2", 100.0),
        "e": ("<i4", 100.0),
        "E": ("<u4", 100.0),
        "L": ("<i4", 1e7),
        "M": ("<u1", None),
        "q": ("<i8", None),
        "Q": ("<u8", None),
    }
)
"""Format letter -> numpy type and what the stored integer is divided by."""

_NAME = re.compile(r"[A-Za-z0-9_]{1,4}")
_COLUMNS = re.compile(r"[A-Za-z0-9_]+(,[A-Za-z0-9_]+)*|")


@dataclass(frozen=True)
class Format:
    """What an FMT message says about one message type."""

    id: int
    name: str
    length: int
    """Bytes of a whole message, its header of three included."""
    types: str
    """One letter of `TYPES` for each field."""
    columns: tuple[str, ...]

    @property
    def dtype(self) -> np.dtype[Any]:
        """The payload's structure, packed, without the header."""
        return np.dtype([(c, TYPES[letter][0]) for c, letter in zip(self.columns, self.types, strict=False)])

    def divisor(self, column: str) -> float | None:
        """What the stored integers of `column` are divided by; None where they are the value."""
        return TYPES[self.types[self.columns.index(column)]][1]

    def offset(self, column: str) -> int:
        """First byte of `column` from the start of the message."""
        before = self.types[: self.columns.index(column)]
        return 3 + sum(np.dtype(TYPES[letter][0]).itemsize for letter in before)


FMT = Format(FMT_ID, "FMT", FMT_LENGTH, "BBnNZ", ("Type", "Length", "Name", "Format", "Columns"))
"""Where its own FMT message is lost."""


class Source:
    """The bytes of a log, in memory or in a file, handed out in pieces."""

    def __init__(self, name: str, data: Bytes | None = None) -> None:
        self.name = name
        self._data = data
        try:
            self.size = Path(name).stat().st_size if data is None else int(data.size)
        except OSError as error:
            raise self._unreadable(error) from error

    def pieces(self) -> Iterator[tuple[int, Bytes]]:
        """Every `PIECE` bytes and the `REACH` after them, fewer at the end, with the first byte's place in the file.

        Each is overwritten by the next.
        Raises TippathError where the file cannot be read, or is shorter than it was.
        """
        if self._data is not None:
            for base in range(0, self.size, PIECE):
                yield base, self._data[base : base + PIECE + REACH]
            return
        buffer = np.empty(PIECE + REACH, np.uint8)
        filled, left = 0, self.size
        try:
            with open(self.name, "rb", buffering=0) as stream:
                for base in range(0, self.size, PIECE):
                    while left and filled < buffer.size:
                        got = stream.readinto(buffer[filled : filled + min(left, buffer.size - filled)].data)
                        if not got:
                            raise self.changed()
                        filled, left = filled + got, left - got
                    yield base, buffer[:filled]
                    filled = max(0, filled - PIECE)
                    buffer[:filled] = buffer[PIECE : PIECE + filled]
        except OSError as error:
            raise self._unreadable(error) from error

    def sha256(self) -> str:
        """Of all bytes, hexadecimal."""
        digest = hashlib.sha256()
        for _, data in self.pieces():
            digest.update(data[:PIECE].data)
        return digest.hexdigest()

    def part(self, start: int, stop: int) -> bytes:
        """A few bytes from anywhere, fewer where the file ends."""
        if self._data is not None:
            return self._data[start:stop].tobytes()
        try:
            with open(self.name, "rb") as stream:
                stream.seek(start)
                return stream.read(stop - start)
        except OSError as error:
            raise self._unreadable(error) from error

    def changed(self) -> TippathError:
        return TippathError(f"{self.name}: the file changed while it was read; wait until it is whole and try again")

    def _unreadable(self, error: OSError) -> TippathError:
        return TippathError(f"{self.name}: cannot be read ({error.strerror or error})")


@dataclass(frozen=True, eq=False, slots=True)
class Places:
    """Where header bytes stand in a piece of the file; from `chain` only those that are messages."""

    base: int
    """First byte of the piece."""
    at: NDArray[np.uint32]
    """First byte of each from `base`, ascending, shape (n,)."""
    kinds: NDArray[Any]
    """Its message id, from `chain` its number in `Parts.kinds`, shape (n,), uint8 or uint16."""
    stamps: NDArray[np.uint64]
    """The first eight bytes of the payload of every `SAMPLED`th, shape (ceil(n / SAMPLED),); none from `chain`."""

    def between(self, start: int, stop: int) -> Places:
        """Those that begin in a part of the file, without stamps."""
        first, last = np.searchsorted(self.at, np.clip([start - self.base, stop - self.base], 0, PIECE))
        return Places(self.base, self.at[first:last], self.kinds[first:last], self.stamps[:0])


def scan(source: Source) -> tuple[list[Places], list[tuple[int, Format]]]:
    """Every place where the two header bytes and an id byte stand, and the FMT messages among them.

    Those are looked for everywhere, not along the chain, which cannot be followed before they are known.
    """
    places: list[Places] = []
    definitions: list[tuple[int, Format]] = []
    known: dict[bytes, Format | None] = {}
    first, second = np.empty(PIECE, np.bool_), np.empty(PIECE, np.bool_)
    for base, data in source.pieces():
        n = max(0, min(PIECE, data.size - 2))
        np.equal(data[:n], HEAD[0], out=first[:n])
        np.equal(data[1 : n + 1], HEAD[1], out=second[:n])
        first[:n] &= second[:n]
        at = np.flatnonzero(first[:n])
        ids = data[2:][at]
        few = at[::SAMPLED] + 3
        few = np.minimum(few, data.size - 8)  # too near the end: such a place is no message with a time
        stamps = data[few[:, None] + np.arange(8)].view("<u8")[:, 0] if data.size >= 8 else np.zeros(few.size, "<u8")
        places.append(Places(base, at.astype(np.uint32), ids, stamps))
        for place in at[ids == FMT_ID].tolist():
            body = data[place + 3 : place + FMT_LENGTH].tobytes()
            if len(definitions) < MOST_PLACES and len(body) == FMT_LENGTH - 3:
                if body not in known and len(known) < MOST_DEFINITIONS:
                    known[body] = _definition(body)
                fmt = known.get(body)
                if fmt is not None:
                    definitions.append((base + place, fmt))
    return places, definitions


def _definition(body: bytes) -> Format | None:
    """What an FMT message says, where it makes sense."""
    id, length = body[0], body[1]
    name, types, columns = (part.split(b"\0", 1)[0].decode("latin-1") for part in (body[2:6], body[6:22], body[22:86]))
    if not _NAME.fullmatch(name) or not _COLUMNS.fullmatch(columns) or any(letter not in TYPES for letter in types):
        return None
    if length != 3 + sum(np.dtype(TYPES[letter][0]).itemsize for letter in types):
        return None
    names = tuple(columns.split(","))[: len(types)] if columns else ()
    if len(set(names)) != len(names):
        return None
    return Format(id, name, length, types, names)


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


def _clocks(kinds: Sequence[Format | None]) -> NDArray[np.int64]:
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
        self.clocks = _clocks(parts.kinds)
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
        one, other = parts.of(piece.base), parts.of(piece.base + PIECE - 1)
        if one == other:
            return parts.lengths[one][ids], ids if len(parts.kinds) == 256 else parts.kind_of[one][ids]
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
            found = int(entries[np.searchsorted(entries, after)])
            if found < n:
                self.resyncs += piece.base + int(at[found]) > 0
            return found

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


def boots(source: Source, parts: Parts, chained: Chained) -> list[int]:
    """First byte of the log of each boot; the first is 0."""
    firsts = [0]
    quiet = np.array([fmt is None or fmt.name in DECLARING for fmt in parts.kinds])
    for start, stop in pairwise((*parts.firsts, source.size)):
        if stop == source.size and len(parts.firsts) == 1:
            said = True
        else:
            pieces = (piece.between(start, stop).kinds for piece in chained.messages)
            said = any(kinds.size and not quiet[kinds].all() for kinds in pieces)
        if not said:  # a piece of the block of formats: it belongs to what follows
            continue
        first, last = np.searchsorted(chained.places, (start, stop))
        breaks = _breaks(chained.places[first:last], chained.times_us[first:last])
        found = [_break(source, parts, chained, int(first) + k) for k in breaks]
        firsts += [start, *(place for place in found if place is not None)]
    return sorted({0, *firsts[2:]})


def _breaks(places: Offsets, times_us: Offsets) -> list[int]:
    """After which of the samples the clock goes back for good.

    Medians of five, so that it takes several messages. Where the clock later jumps to where it was before, what lies
    between was out of place, and no boot.
    """
    if times_us.size < 2 * MEDIAN:
        return []
    middle = np.median(sliding_window_view(np.pad(times_us, MEDIAN // 2, mode="edge"), MEDIAN), axis=1)
    found = []
    for k in np.flatnonzero(np.diff(middle) < -BACK_US)[:MOST_BREAKS].tolist():
        again = np.flatnonzero(middle[k + 1 :] >= middle[k])[:1]
        stretch = middle[k + 1 :] if again.size == 0 else middle[k + 1 : k + 2 + int(again[0])]
        jump = float(np.diff(stretch).max(initial=0.0)) if again.size else 0.0
        if stretch.size >= MEDIAN and jump < 0.5 * (middle[k] - middle[k + 1]):
            found.append(k)
    return found


def _break(source: Source, parts: Parts, chained: Chained, k: int) -> int | None:
    """The first message after the clock went back near sample k; None where what follows was read before.

    A card can write a block twice; what comes twice is left to the order of the time stamps.
    """
    places, times = chained.places, chained.times_us
    low, high = max(0, k - MEDIAN), min(places.size - 1, k + MEDIAN)
    before, after = int(np.median(times[low : k + 1])), int(np.median(times[k + 1 : high + 1]))
    clocks = _clocks(parts.kinds)
    start, stop = int(places[low]), int(places[high])
    data = source.part(start, stop + REACH)
    found: list[tuple[int, bool]] = []
    for piece in chained.messages:
        if piece.base < stop and piece.base + PIECE > start:
            here = piece.between(start, stop)
            for place, kind in zip((here.at.astype(np.int64) + here.base).tolist(), here.kinds.tolist(), strict=True):
                if clocks[kind]:
                    size = 8 if clocks[kind] == 1 else 4
                    stamp = int.from_bytes(data[place - start + 3 : place - start + 3 + size], "little")
                    found.append((place, stamp * int(clocks[kind]) > (before + after) // 2))
    late = np.cumsum([0, *(1 if late else -1 for _, late in found)])
    first = found[min(int(np.argmax(late)), len(found) - 1)][0]  # most before it are late, most after it early
    same = int(np.argmin(np.abs(times[: k + 1] - after)))
    earlier = source.part(int(places[max(0, same - MEDIAN)]), int(places[min(k, same + MEDIAN)]) + REACH)
    return None if data[first - start : first - start + SAME_BYTES] in earlier else first
