"""The messages of a ULog, followed from one to the next, over damage.

A message is its size (two bytes), a letter for its kind, and so many bytes. Nearly all are D, data, and of those five
bytes are known beforehand: all places where they stand are found at once. Where every end meets the next of them
nothing needs to be walked; Python looks only at the others: messages of another kind, and damage.

After damage the chain is taken up at the next message whose own end meets a message. One whose end meets none is
dropped: it may have been cut and continued with bytes of another, and a sample is never invented. A header with one
wrong byte between two good messages is read as what it was.
"""

from __future__ import annotations

import re
import struct
from collections.abc import Callable, Mapping, Sequence
from functools import partial

import numpy as np
from numpy.typing import NDArray

from gcs.logs.formats.damage import Damage
from gcs.logs.formats.raw import Bytes, Offsets, gathered
from gcs.logs.formats.ulog_definitions import CHUNK, FIRST, FLAGS, FORMAT, NAME, SUBSCRIBE, Topic
from gcs.logs.words import printable

Ids = NDArray[np.uint16]

SYNC = bytes.fromhex("2f731320250cbb12")
MOST_HOPS = 16  # messages that prove nothing, between two that do
UNKNOWN_LARGEST = 10_000  # bytes of a message of a kind that is not known

_HEAD = np.dtype([("size", "<u2"), ("kind", "u1"), ("id", "<u2")])
_DATA, _FLAGS = ord("D"), ord("B")
_TEXT, _TAGGED, _DROPOUT, _SYNC = ord("L"), ord("C"), ord("O"), ord("S")
_KEYED = {ord("I"): 0, ord("P"): 0, ord("M"): 1, ord("Q"): 1}  # kind -> bytes before the length of the key
_PROVABLE = np.zeros(256, np.bool_)
_PROVABLE[[FORMAT, SUBSCRIBE, _FLAGS, _TEXT, _TAGGED, _SYNC, *_KEYED]] = True
_KINDS = frozenset(b"ABCDFILMOPQRS")
_SIZES = {_DATA: (2, 0xFFFF), _DROPOUT: (2, 2), ord("R"): (2, 2), _TEXT: (9, 0xFFFF), _TAGGED: (11, 0xFFFF)}
"""Kind -> fewest and most bytes, where it has other bounds than the rest."""

_OPENING = re.compile(rb"[A-Za-z0-9_]{1,250}:[A-Za-z0-9_]+(?:\[[0-9]{1,5}\])? [A-Za-z0-9_]")
_KEY = re.compile(rb"[A-Za-z0-9_]+(?:\[[0-9]{1,5}\])? [\x21-\x7e]+")
_CONTROL = re.compile(rb"[\x00-\x08\x0e-\x1f]")


def data_messages(
    data: Bytes, low: NDArray[np.int32], high: NDArray[np.int32]
) -> tuple[Offsets, NDArray[np.int32], Ids]:
    """Places where the header of a data message of a known id and size stands, ascending; sizes and ids there."""
    places, sizes, ids = [np.empty(0, np.int64)], [np.empty(0, np.int32)], [np.empty(0, np.uint16)]
    for start in range(2, data.size - 2, CHUNK):
        at = np.flatnonzero(data[start : min(start + CHUNK, data.size - 2)] == _DATA) + (start - 2)
        heads = gathered(data, 0, _HEAD, at)
        id, size = heads["id"], heads["size"].astype(np.int32)
        keep = (size >= low[id]) & (size <= high[id])
        places.append(at[keep])
        sizes.append(size[keep])
        ids.append(id[keep])
    return np.concatenate(places), np.concatenate(sizes), np.concatenate(ids)


def settle(claims: Sequence[tuple[Topic, int]], sizes: NDArray[np.int32], its: NDArray[np.bool_]) -> tuple[Topic, int]:
    """Whose id it is: the one whose size more of `its` messages have."""

    def evidence(claim: tuple[Topic, int]) -> int:
        return int(np.count_nonzero(its & (sizes >= 2 + claim[0].least) & (sizes <= 2 + claim[0].most)))

    return max(claims, key=evidence)


class Chain:
    """The messages of a file, followed from one to the next."""

    def __init__(
        self, data: Bytes, at: Offsets, ids: Ids, lengths: Offsets, topics: Mapping[int, tuple[Topic, int]]
    ) -> None:
        """`at`, `ids`, `lengths`: where headers of data messages stand, ascending, what they say and what they span."""
        self.texts: list[tuple[float, str]] = []
        self.dropouts_ms: list[int] = []
        self._data, self._bytes, self._size = data, data.data, data.size
        self._at, self._ids, self._lengths, self._ends = at, ids, lengths, at + lengths
        self._topics = topics
        regular = np.zeros(at.size, np.bool_)  # ends where the next stands: nothing to look at
        regular[:-1] = self._ends[:-1] == at[1:]
        self._irregular = np.flatnonzero(~regular)
        self._steps = np.zeros(at.size + 1, np.int64)  # +1 where a stretch of whole messages begins, -1 behind it
        self._mended_at: list[tuple[int, int]] = []
        self._unknown: dict[int, int] = {}
        self._other_bytes = self._resyncs = self._last = 0

    def follow(self, first: int) -> tuple[Offsets, Ids, Damage]:
        """Places and ids of the data messages that are whole, ascending, and what lies between them."""
        self._other_bytes = self._last = here = first
        while here < self._size:
            k = self._index(here)
            if k >= 0:
                here = self._along(k)
            elif self._size - here < 3:
                break
            else:
                here = self._step(here)
        starts, ids, kept_bytes = self._chosen()
        lost = max(0, self._size - self._other_bytes - kept_bytes)
        return starts, ids, Damage(self._size, lost, self._resyncs, self._unknown, self._last < self._size)

    def _along(self, k: int) -> int:
        """From the k-th data message over all that follow one another; where to look next."""
        odd = int(self._irregular[np.searchsorted(self._irregular, k)])  # the last is always irregular
        end = int(self._ends[odd])
        whole = self._fits(end)
        self._steps[k] += 1
        self._steps[odd + whole] -= 1
        if whole:
            self._last = end
            return end
        if odd > k:
            self._last = int(self._at[odd])
        return self._resync(int(self._at[odd]) + 1)

    def _step(self, here: int) -> int:
        """Over a message that is not among the data messages, or over damage; where to look next."""
        end, proved = self._header(here)
        mend = None if proved else self._mended(here)
        if mend is not None:
            id, length = mend
            self._mended_at.append((here, id))
            self._resyncs += 1
            self._last = here + length
            return self._last
        if end < 0 or end > self._size or not self._fits(end):
            return self._resync(here + 1)
        kind = self._bytes[here + 2]
        if kind == _DATA:
            id = self._bytes[here + 3] | self._bytes[here + 4] << 8
            if id not in self._topics:
                self._unknown[id] = self._unknown.get(id, 0) + 1
        elif proved or kind in b"CLOR":
            self._other_bytes += end - here
            self._note(kind, here, end)
        self._last = end
        return end

    def _chosen(self) -> tuple[Offsets, Ids, int]:
        """Places and ids of what was believed, ascending, and how many bytes of it are as they were."""
        chosen = np.cumsum(self._steps[:-1]) > 0
        starts, ids = self._at[chosen], self._ids[chosen]
        kept = int(self._lengths[chosen].sum())
        if not self._mended_at:
            return starts, ids, kept
        kept += sum(2 + self._topics[id][0].least for _, id in self._mended_at)  # without the header's three bytes
        starts = np.concatenate((starts, np.array([place for place, _ in self._mended_at], np.int64)))
        ids = np.concatenate((ids, np.array([id for _, id in self._mended_at], np.uint16)))
        order = np.argsort(starts, kind="stable")
        return starts[order], ids[order], kept

    def _index(self, place: int) -> int:
        """Which of the data messages stands there; -1 for none."""
        k = int(np.searchsorted(self._at, place))
        return k if k < self._at.size and self._at[k] == place else -1

    def _fits(self, place: int) -> bool:
        """Whether a message stands there, or the end of the file: what ends there may be believed."""
        for _ in range(MOST_HOPS):
            if place >= self._size:
                return place == self._size
            if self._index(place) >= 0:
                return True
            if self._size - place < 3:
                return True  # too little of a header to tell
            if self._size - place < 5 and self._bytes[place + 2] in _KINDS:
                return True
            end, proved = self._header(place)
            if proved or self._mended(place) is not None:
                return True
            if end < 0:
                return False
            place = end
        return False

    def _header(self, place: int) -> tuple[int, bool]:
        """Where a message that may stand there would end (-1: none can), and whether its contents prove it.

        A data message proves nothing here: those of a known id and size are in the list, and not asked for.
        """
        size, kind = self._bytes[place] | self._bytes[place + 1] << 8, self._bytes[place + 2]
        least, most = _SIZES.get(kind, (1, 0xFFFF if kind in _KINDS else UNKNOWN_LARGEST))
        if kind == 0 or not least <= size <= most:
            return -1, False
        end, proves = place + 3 + size, _PROOFS.get(kind)
        return end, proves is not None and proves(self._bytes, place + 3, end)

    def _mended(self, place: int) -> tuple[int, int] | None:
        """Id and length of a data message whose header has one wrong byte and whose end meets another."""
        if place + 5 > self._size:
            return None
        size, kind, id = struct.unpack_from("<HBH", self._bytes, place)
        if id not in self._topics:
            return None
        topic = self._topics[id][0]
        for true in {2 + topic.least, 2 + topic.most}:
            right = (size & 255 == true & 255) + (size >> 8 == true >> 8) + (kind == _DATA)
            if right == 2 and self._index(place + 3 + true) >= 0:
                return id, 3 + true
        return None

    def _resync(self, place: int) -> int:
        """The next place from which on messages meet messages; the file's end where there is none."""
        k = int(np.searchsorted(self._at, place))
        while k < self._at.size and not self._fits(int(self._ends[k])):
            k += 1
        stop = int(self._at[k]) if k < self._at.size else self._size
        there = self._proved_between(place, stop)
        self._resyncs += there < self._size
        return there

    def _proved_between(self, place: int, stop: int) -> int:
        """The first message between two places whose contents prove it, and that meets another; `stop` for none."""
        for start in range(place, stop, CHUNK):
            kinds = self._data[start + 2 : min(start + CHUNK, stop) + 2]
            for there in (np.flatnonzero(_PROVABLE[kinds]) + start).tolist():
                end, proved = self._header(there)
                if proved and end <= self._size and self._fits(end):
                    return int(there)
        return stop

    def _note(self, kind: int, place: int, end: int) -> None:
        if kind == _DROPOUT:
            self.dropouts_ms.append(int(struct.unpack_from("<H", self._bytes, place + 3)[0]))
        elif kind in (_TEXT, _TAGGED):
            stamp = place + (4 if kind == _TEXT else 6)
            us = struct.unpack_from("<Q", self._bytes, stamp)[0]
            self.texts.append((us * 1e-6, printable(bytes(self._bytes[stamp + 8 : end]))))


def _proves_text(view: memoryview, body: int, end: int, head: int) -> bool:
    """A level as a digit, and behind the head no control characters."""
    if body >= len(view) or view[body] & ~ord("0") >= 8:
        return False
    return not _CONTROL.search(bytes(view[body + head : end]))


def _proves_key(view: memoryview, body: int, end: int, before: int) -> bool:
    """The length of a key, and a key of so many bytes."""
    key = body + before
    if key >= len(view):
        return False
    stop = key + 1 + view[key]
    return stop <= end and _KEY.fullmatch(bytes(view[key + 1 : stop])) is not None


_PROOFS: Mapping[int, Callable[[memoryview, int, int], bool]] = {
    _SYNC: lambda view, body, end: end - body == len(SYNC) and bytes(view[body:end]) == SYNC,
    FORMAT: lambda view, body, end: _OPENING.match(bytes(view[body : min(end, body + 600)])) is not None,
    SUBSCRIBE: lambda view, body, end: (
        end - body <= 3 + 250 and NAME.fullmatch(bytes(view[body + 3 : end])) is not None
    ),
    _FLAGS: lambda view, body, end: body == FIRST + 3 and end - body >= FLAGS,
    _TEXT: partial(_proves_text, head=9),
    _TAGGED: partial(_proves_text, head=11),
    **{kind: partial(_proves_key, before=before) for kind, before in _KEYED.items()},
}
"""Kind -> whether the bytes from `body` to `end` can be nothing but such a message."""
