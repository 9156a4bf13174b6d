"""PX4's ULog `.ulg`: a chain of self-describing messages, read with numpy; pyulog reads the definitions.

A message is its size (two bytes), a letter for its kind, and so many bytes. Nearly all are D, data: the id of a
subscription (A), whose topic has a format (F), which gives the size. So five bytes of every data message are known
beforehand, and all places where they stand are found at once. Where every end meets the next of them nothing needs to
be walked; Python looks only at the others: messages of another kind, and damage. (pyulog walks every message, believes
a size as it stands, and goes on at the next sync mark, which older logs do not have.)

After damage the chain is taken up at the next message whose own end meets a message. One whose end meets none is
dropped: it may have been cut and continued with bytes of another, and a sample is never invented. A header with one
wrong byte between two good messages is read as what it was. There are no checksums in this format, so a flipped bit
inside the data cannot be seen here; `increasing` throws out the time stamps that cannot be.
"""

from __future__ import annotations

import re
import struct
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gcs.errors import TippathError
from gcs.logs.formats.damage import Damage
from gcs.logs.formats.tables import FloatArray, Series, increasing
from gcs.logs.profile import profiles
from gcs.logs.profile.profiles import Profile
from gcs.logs.runs.health import F_HIGH_HZ
from gcs.logs.words import printable

Bytes = NDArray[np.uint8]
Offsets = NDArray[np.int64]
Ids = NDArray[np.uint16]

MAGIC = b"ULog\x01\x12\x35"
SYNC = bytes.fromhex("2f731320250cbb12")
FIRST = 16  # bytes of the file's header
FLAGS = 40  # bytes of the flags, the first message
CHUNK = 1 << 20  # bytes are looked at in pieces that stay in the processor's cache
LARGEST = 0xFFFF - 2  # bytes of data: what a size can say
DEEPEST = 16  # formats within formats; PX4 has two
MOST_DEFINITIONS = 8192  # of either kind; a real log has some 200
MOST_TEXT = 1 << 25  # bytes looked at as definitions
MOST_PLACES = 1_000_000  # looked at for either kind
MOST_FIELDS = 20_000  # listed for the user
MOST_HOPS = 16  # messages that prove nothing, between two that do
UNKNOWN_LARGEST = 10_000  # bytes of a message of a kind that is not known

TYPES: Mapping[str, str] = {
    "int8_t": "<i1",
    "uint8_t": "<u1",
    "int16_t": "<i2",
    "uint16_t": "<u2",
    "int32_t": "<i4",
    "uint32_t": "<u4",
    "int64_t": "<i8",
    "uint64_t": "<u8",
    "float": "<f4",
    "double": "<f8",
    "bool": "<i1",
    "char": "<i1",
}

_HEAD = np.dtype([("size", "<u2"), ("kind", "u1"), ("id", "<u2")])
_DATA, _FORMAT, _SUBSCRIBE, _FLAGS = ord("D"), ord("F"), ord("A"), ord("B")
_TEXT, _TAGGED, _DROPOUT, _SYNC = ord("L"), ord("C"), ord("O"), ord("S")
_KEYED = {ord("I"): 0, ord("P"): 0, ord("M"): 1, ord("Q"): 1}  # kind -> bytes before the length of the key
_PROVABLE = np.zeros(256, np.bool_)
_PROVABLE[[_FORMAT, _SUBSCRIBE, _FLAGS, _TEXT, _TAGGED, _SYNC, *_KEYED]] = True
_KINDS = frozenset(b"ABCDFILMOPQRS")

_WORD = np.zeros(256, np.bool_)
_WORD[list(b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789_")] = True
_NAME = re.compile(rb"[A-Za-z0-9_]{1,250}")
_ITEM = rb"[A-Za-z0-9_]+(?:\[[0-9]{1,5}\])? [A-Za-z0-9_]+"
_DEFINITION = re.compile(rb"[A-Za-z0-9_]{1,250}:" + _ITEM + rb"(?:;" + _ITEM + rb")*;?")
_OPENING = re.compile(rb"[A-Za-z0-9_]{1,250}:[A-Za-z0-9_]+(?:\[[0-9]{1,5}\])? [A-Za-z0-9_]")
_KEY = re.compile(rb"[A-Za-z0-9_]+(?:\[[0-9]{1,5}\])? [\x21-\x7e]+")
_CONTROL = re.compile(rb"[\x00-\x08\x0e-\x1f]")


@dataclass(frozen=True)
class Format:
    """What an F message says about one type."""

    name: str
    fields: tuple[tuple[str, int, str], ...]
    """Type, elements (0: no array), name."""


@dataclass(frozen=True)
class Topic:
    """A topic that was subscribed to."""

    name: str
    least: int
    """Bytes of its data, without the padding at its end."""
    most: int
    """The same with it; writers may leave it out."""


@dataclass(frozen=True, eq=False)
class ULogFile:
    """A log whose messages have been located; fields are gathered when asked for."""

    data: Bytes
    """The whole file, shape (bytes,)."""
    formats: Mapping[str, Format]
    topics: Mapping[str, Topic]
    """By name, those subscribed to."""
    ids: Mapping[tuple[str, int], tuple[int, ...]]
    """Topic and instance -> ids of its messages; those that occur."""
    texts: tuple[tuple[float, str], ...]
    """What the vehicle said, made printable, at s of the log's clock, in the file's order."""
    dropouts_ms: tuple[int, ...]
    """How long the logger lost samples, each time, as it said itself."""
    damage: Damage
    starts: Offsets
    """First byte of every data message that was read, ascending."""
    _ids: Ids
    _layouts: dict[str, dict[str, tuple[int, str]]] = field(default_factory=dict)

    @property
    def notes(self) -> tuple[str, ...]:
        """What the logger said of itself."""
        if not self.dropouts_ms:
            return ()
        times = "once" if len(self.dropouts_ms) == 1 else f"{len(self.dropouts_ms)} times"
        return (
            f"the logger itself lost samples {times}, {sum(self.dropouts_ms)} ms in all, which are gaps: "
            "take a faster card, or log fewer topics",
        )

    def instances(self, topic: str) -> tuple[int, ...]:
        """Those that occur, ascending."""
        return tuple(sorted(instance for name, instance in self.ids if name == topic))

    def layout(self, topic: str) -> Mapping[str, tuple[int, str]]:
        """Field (`xyz[0]`, `esc[1].esc_rpm`) -> first byte in the data, and type; without padding at the end."""
        if topic not in self._layouts:
            least = self.topics[topic].least
            flat = ((key, place) for key, place in _flat(self.formats, topic, 0, "") if place[0] < least)
            self._layouts[topic] = dict(flat)
        return self._layouts[topic]

    def messages(self, topic: str, instance: int) -> Offsets:
        """First byte of every message, in the file's order, shape (n,)."""
        ids = self.ids.get((topic, instance), ())
        mask = np.zeros(self._ids.size, np.bool_)
        for id in ids:
            mask |= self._ids == id
        starts: Offsets = self.starts[mask]
        return starts

    def column(self, topic: str, key: str, starts: Offsets) -> NDArray[Any]:
        """A field as it is stored, shape (n,). Raises KeyError."""
        offset, kind = self.layout(topic)[key]
        return _gather(self.data, 5 + offset, TYPES[kind], starts)

    def next_stamps(self, starts: Offsets) -> FloatArray:
        """Time in us of the data message that follows each without a byte between them; NaN where none does."""
        after = np.searchsorted(self.starts, starts) + 1
        ends = starts + 3 + _gather(self.data, 0, "<u2", starts)
        place = np.minimum(after, self.starts.size - 1)
        follows = (after < self.starts.size) & (self.starts[place] == ends)
        stamps = np.full(starts.size, np.nan)
        topic_of = {id: topic for (topic, _), ids in self.ids.items() for id in ids}
        for id in np.unique(self._ids[place[follows]]).tolist():
            topic = topic_of[id]
            if "timestamp" in self.layout(topic):
                its = follows & (self._ids[place] == id)
                stamps[its] = self.column(topic, "timestamp", self.starts[place[its]])
        return stamps


def is_ulog(head: bytes) -> bool:
    """Whether a file begins as a ULog."""
    return head.startswith(MAGIC)


def read(path: Path) -> ULogFile:
    """Read a `.ulg` file. Raises TippathError where it cannot be opened or nothing in it can be read."""
    try:
        data = np.fromfile(path, np.uint8)
    except OSError as error:
        raise TippathError(f"{path}: cannot be read ({error.strerror or error})") from error
    return parse(data, str(path))


def parse(data: Bytes, path: str = "log") -> ULogFile:
    """As `read`, from the file's bytes."""
    if data.size == 0:
        raise TippathError(f"{path}: the file is empty; fetch the log from the vehicle again")
    known = data[: len(MAGIC)].tobytes() == MAGIC
    formats = _formats(data)
    claims = _claims(data, formats)
    if not claims:
        raise TippathError(
            f"{path}: "
            + (
                "the log ends before its first sample: fetch it from the vehicle again, whole"
                if known
                else "not a ULog: no topic that has a format was found; check that it is the .ulg from the vehicle"
            )
        )
    appended = _flags(data, path) if known else ()
    low, high = np.full(1 << 16, 1 << 16, np.int32), np.zeros(1 << 16, np.int32)
    for id, topics in claims.items():
        low[id] = 2 + min(topic.least for topic, _ in topics)
        high[id] = 2 + max(topic.most for topic, _ in topics)
    at, sizes, ids = _data_messages(data, low, high)
    settled = {id: _settle(topics, sizes, ids == id) if len(topics) > 1 else topics[0] for id, topics in claims.items()}
    for id, (topic, _) in settled.items():
        low[id], high[id] = 2 + topic.least, 2 + topic.most
    keep = (sizes == low[ids]) | (sizes == high[ids])
    for offset in appended:  # what was being written when the vehicle crashed is cut there
        keep &= (at >= offset) | (at + 3 + sizes <= offset)
    chain = _Chain(data, at[keep], ids[keep], 3 + sizes[keep].astype(np.int64), settled)
    starts, its_ids, damage = chain.follow(FIRST if known else 0)
    present = set(np.unique(its_ids).tolist())
    ids_of: dict[tuple[str, int], tuple[int, ...]] = {}
    for id, (topic, instance) in sorted(settled.items()):
        if id in present:
            ids_of[topic.name, instance] = (*ids_of.get((topic.name, instance), ()), id)
    return ULogFile(
        data,
        formats,
        {topic.name: topic for topic, _ in settled.values()},
        ids_of,
        tuple(chain.texts),
        tuple(chain.dropouts_ms),
        damage,
        starts,
        its_ids,
    )


# ------------------------------------------------------------------------------------------------ definitions


def _formats(data: Bytes) -> dict[str, Format]:
    """Every format that makes sense, wherever it stands: the chain cannot be followed before they are known."""
    from pyulog import ULog  # here, for it takes as long to import as a small log to read

    formats: dict[str, Format] = {}
    looked_at = 0
    for start in islice(_places(data, _FORMAT, 5, 0xFFFF), MOST_PLACES):
        size = int(data[start]) | int(data[start + 1]) << 8
        text = data[start + 3 : start + 3 + size].tobytes()
        looked_at += size
        if looked_at > MOST_TEXT or len(formats) >= MOST_DEFINITIONS:
            break
        if not _DEFINITION.fullmatch(text):
            continue
        try:
            theirs = ULog.MessageFormat(text, None)
        except (ValueError, IndexError):
            continue
        fields = tuple((str(kind), int(count), str(name)) for kind, count, name in theirs.fields)
        if len({name for *_, name in fields}) == len(fields):
            formats.setdefault(str(theirs.name), Format(str(theirs.name), fields))
    return formats


def _claims(data: Bytes, formats: Mapping[str, Format]) -> dict[int, tuple[tuple[Topic, int], ...]]:
    """Id of a subscription -> the topics and instances that claim it; several only where one is damaged."""
    sizes = _sizes(formats)
    found: dict[int, dict[tuple[Topic, int], None]] = {}
    count = 0
    for start in islice(_places(data, _SUBSCRIBE, 4, 3 + 250), MOST_PLACES):
        size = int(data[start]) | int(data[start + 1]) << 8
        name = data[start + 6 : start + 3 + size].tobytes()
        topic = sizes.get(name.decode("latin-1")) if _NAME.fullmatch(name) else None
        if topic is not None and count < MOST_DEFINITIONS:
            id = int(data[start + 4]) | int(data[start + 5]) << 8
            found.setdefault(id, {})[topic, int(data[start + 3])] = None
            count += 1
    return {id: tuple(topics) for id, topics in found.items()}


def _places(data: Bytes, kind: int, least: int, most: int) -> Iterator[int]:
    """Where a message of this kind with a name in it may stand, ascending."""
    name = {_FORMAT: 3, _SUBSCRIBE: 6}[kind]
    for start in range(2, data.size - 4, CHUNK):
        at = np.flatnonzero(data[start : min(start + CHUNK, data.size - 4)] == kind) + (start - 2)
        at = at[at + 3 + least <= data.size]
        size = data[at].astype(np.int64) | data[at + 1].astype(np.int64) << 8
        at = at[(size >= least) & (size <= most) & (at + 3 + size <= data.size)]
        yield from at[_WORD[data[at + name]]].tolist()


def _sizes(formats: Mapping[str, Format]) -> dict[str, Topic]:
    """Topics whose size can be told; not those that hold themselves, something unknown, or more than a message can."""
    known: dict[str, int | None] = {kind: np.dtype(stored).itemsize for kind, stored in TYPES.items()}

    def size(name: str, depth: int) -> int | None:
        if name in known:
            return known[name]
        if depth > DEEPEST or name not in formats:
            return None
        known[name] = None
        total = 0
        for kind, count, _ in formats[name].fields:
            one = size(kind, depth + 1)
            if one is None:
                return None
            total += one * max(count, 1)
            if total > LARGEST:
                return None
        known[name] = total
        return total

    topics: dict[str, Topic] = {}
    for name, format in formats.items():
        most = size(name, 0)
        if most is None:
            continue
        least = most
        for kind, count, its_name in reversed(format.fields):
            if not its_name.startswith("_padding"):
                break
            least -= (known[kind] or 0) * max(count, 1)
        if least > 0:
            topics[name] = Topic(name, least, most)
    return topics


def _flat(formats: Mapping[str, Format], name: str, offset: int, prefix: str) -> Iterator[tuple[str, tuple[int, str]]]:
    """Every plain field of a topic whose size is known, types within types and arrays spread out."""
    for kind, count, its_name in formats[name].fields:
        for i in range(max(count, 1)):
            key = f"{prefix}{its_name}[{i}]" if count else prefix + its_name
            if kind in TYPES:
                yield key, (offset, kind)
                offset += np.dtype(TYPES[kind]).itemsize
            else:
                last = offset
                for inner, place in _flat(formats, kind, offset, key + "."):
                    last = place[0] + np.dtype(TYPES[place[1]]).itemsize
                    yield inner, place
                offset = last


def _flags(data: Bytes, path: str) -> tuple[int, ...]:
    """Where data was appended after a crash. Raises TippathError for a log that says it is of another kind."""
    head = data[FIRST : FIRST + 3 + FLAGS].tobytes()
    if len(head) < 3 + FLAGS or head[:3] != struct.pack("<HB", FLAGS, _FLAGS):
        return ()
    incompatible = head[11:19]
    if incompatible[0] & ~1 or any(incompatible[1:]):
        raise TippathError(
            f"{path}: the log says that it is of a later kind of ULog (flags {incompatible.hex()}), which is not read "
            "here; convert it (ulog2csv of pyulog) and name the columns in a profile"
        )
    return tuple(offset for offset in struct.unpack("<3Q", head[19:43]) if incompatible[0] and offset)


# ------------------------------------------------------------------------------------------------ the chain


def _data_messages(
    data: Bytes, low: NDArray[np.int32], high: NDArray[np.int32]
) -> tuple[Offsets, NDArray[np.int32], Ids]:
    """Places where the header of a data message of a known id and size stands, ascending; sizes and ids there."""
    places, sizes, ids = [np.empty(0, np.int64)], [np.empty(0, np.int32)], [np.empty(0, np.uint16)]
    for start in range(2, data.size - 2, CHUNK):
        at = np.flatnonzero(data[start : min(start + CHUNK, data.size - 2)] == _DATA) + (start - 2)
        heads = _gather(data, 0, _HEAD, at)
        id, size = heads["id"], heads["size"].astype(np.int32)
        keep = (size >= low[id]) & (size <= high[id])
        places.append(at[keep])
        sizes.append(size[keep])
        ids.append(id[keep])
    return np.concatenate(places), np.concatenate(sizes), np.concatenate(ids)


def _settle(claims: Sequence[tuple[Topic, int]], sizes: NDArray[np.int32], its: NDArray[np.bool_]) -> tuple[Topic, int]:
    """Whose id it is: the one whose size more of `its` messages have."""

    def evidence(claim: tuple[Topic, int]) -> int:
        return int(np.count_nonzero(its & (sizes >= 2 + claim[0].least) & (sizes <= 2 + claim[0].most)))

    return max(claims, key=evidence)


class _Chain:
    """The messages of a file, followed from one to the next."""

    def __init__(
        self, data: Bytes, at: Offsets, ids: Ids, lengths: Offsets, topics: Mapping[int, tuple[Topic, int]]
    ) -> None:
        self.texts: list[tuple[float, str]] = []
        self.dropouts_ms: list[int] = []
        self._data, self._bytes, self._size = data, data.data, data.size
        self._at, self._ids, self._lengths, self._ends = at, ids, lengths, at + lengths
        self._topics = topics

    def follow(self, first: int) -> tuple[Offsets, Ids, Damage]:
        """Places and ids of the data messages that are whole, ascending, and what lies between them."""
        at, ends, count = self._at, self._ends, self._at.size
        regular = np.zeros(count, np.bool_)  # ends where the next stands: nothing to look at
        regular[:-1] = ends[:-1] == at[1:]
        irregular = np.flatnonzero(~regular)
        steps = np.zeros(count + 1, np.int64)
        mended: list[tuple[int, int]] = []
        unknown: dict[int, int] = {}
        other_bytes, resyncs, last = first, 0, first
        here = first
        while here < self._size:
            k = self._index(here)
            if k >= 0:
                odd = int(irregular[np.searchsorted(irregular, k)])  # the last is always irregular
                whole = self._fits(int(ends[odd]))
                steps[k] += 1
                steps[odd + whole] -= 1
                if whole or odd > k:
                    last = int(ends[odd] if whole else at[odd])
                if whole:
                    here = int(ends[odd])
                    continue
                here = self._resync(int(at[odd]) + 1)
                resyncs += here < self._size
                continue
            if self._size - here < 3:
                break
            end, proved = self._header(here)
            mend = None if proved else self._mended(here)
            if mend is not None:
                id, length = mend
                mended.append((here, id))
                resyncs += 1
                last = here = here + length
                continue
            if end < 0 or end > self._size or not self._fits(end):
                here = self._resync(here + 1)
                resyncs += here < self._size
                continue
            kind = self._bytes[here + 2]
            if kind == _DATA:
                id = self._bytes[here + 3] | self._bytes[here + 4] << 8
                if id not in self._topics:
                    unknown[id] = unknown.get(id, 0) + 1
            elif proved or kind in b"CLOR":
                other_bytes += end - here
                self._note(kind, here, end)
            last = here = end
        chosen = np.cumsum(steps[:-1]) > 0
        starts, ids = at[chosen], self._ids[chosen]
        kept = other_bytes + int(self._lengths[chosen].sum())
        if mended:
            places = np.array([place for place, _ in mended], np.int64)
            its = np.array([id for _, id in mended], np.uint16)
            for _, id in mended:
                topic = self._topics[id][0]
                kept += 2 + topic.least  # the three bytes of its header are not as they were
            order = np.argsort(np.concatenate((starts, places)), kind="stable")
            starts = np.concatenate((starts, places))[order]
            ids = np.concatenate((ids, its))[order]
        damage = Damage(self._size, max(0, self._size - kept), resyncs, unknown, last < self._size)
        return starts, ids, damage

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
        view = self._bytes
        size, kind = view[place] | view[place + 1] << 8, view[place + 2]
        end, body = place + 3 + size, place + 3
        if size == 0 or kind == 0:
            return -1, False
        if kind == _DATA:
            return (end, False) if size >= 2 else (-1, False)
        if kind not in _KINDS:
            return (end, False) if size <= UNKNOWN_LARGEST else (-1, False)
        if kind in b"OR":
            return (end, False) if size == 2 else (-1, False)
        proved = False
        if kind == _SYNC:
            proved = size == len(SYNC) and bytes(view[body:end]) == SYNC
        elif kind == _FORMAT:
            proved = _OPENING.match(bytes(view[body : min(end, body + 600)])) is not None
        elif kind == _SUBSCRIBE:
            proved = size <= 3 + 250 and _NAME.fullmatch(bytes(view[body + 3 : end])) is not None
        elif kind in (_TEXT, _TAGGED):
            text = body + (9 if kind == _TEXT else 11)
            if text > end:
                return -1, False
            level = view[body] if body < self._size else 255
            proved = level & ~ord("0") < 8 and not _CONTROL.search(bytes(view[text:end]))
        elif kind == _FLAGS:
            proved = place == FIRST and size >= FLAGS
        elif kind in _KEYED and body + _KEYED[kind] < self._size:
            key = body + _KEYED[kind]
            stop = key + 1 + view[key]
            proved = stop <= end and _KEY.fullmatch(bytes(view[key + 1 : stop])) is not None
        return end, proved

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


def _gather(data: Bytes, offset: int, stored: Any, starts: Offsets) -> NDArray[Any]:
    """What stands `offset` bytes after each of the places, shape (n,)."""
    dtype = np.dtype(stored)
    if starts.size == 0:
        return np.empty(0, dtype)
    # every byte as a possible first byte: the gather then copies the field alone
    count = data.size - offset - dtype.itemsize + 1
    everywhere = np.ndarray((count,), f"V{dtype.itemsize}", data, offset, (1,))
    return everywhere[starts].view(dtype)


# ------------------------------------------------------------------------------------------------ as series

_FIELD = re.compile(r"([A-Za-z0-9_]+)(?:\[(\d{1,3})\])?\.([A-Za-z0-9_.\[\]]+)")
_ARMED = 2  # vehicle_status.arming_state
REGULAR = 10  # messages from which on a topic is taken to be logged regularly


class UlogTables:
    """A ULog; keys are `topic.field`, `topic.field[2]`, or `topic[1].field` for one instance of several.

    Without a number the lowest instance that occurs is taken. Time is `timestamp`, in us; `time_field` names another
    (`timestamp_sample`: when the gyro sample was taken that a message is based on) for all topics that have it, or,
    as `topic.field`, for one of them.
    """

    kind = "ulog"

    def __init__(
        self, log: ULogFile, path: str, time_field: str | None = None, time_scale: float | None = None
    ) -> None:
        self.log = log
        self.path = path
        self.dropped: dict[str, int] = {}
        """Topic -> samples thrown out for an impossible time stamp."""
        topic, _, name = (time_field or "").rpartition(".")
        self._time = (topic, name, 1e-6 if time_scale is None else time_scale)
        self._clocks: dict[tuple[str, int], tuple[FloatArray, Offsets, int]] = {}
        self._fields: tuple[str, ...] | None = None

    def has(self, key: str) -> bool:
        try:
            topic, instance, name = self._parts(key)
        except KeyError:
            return False
        return self.log.layout(topic)[name][1] != "char" and self._clock(topic, instance)[0].size > 0

    def series(self, key: str) -> Series:
        topic, instance, name = self._parts(key)
        t, starts, out = self._clock(topic, instance)
        lowest = instance == self.log.instances(topic)[0]
        clock = topic if lowest else f"{topic}[{instance}]"
        if out:
            self.dropped[clock] = out
        return Series(t, self.log.column(topic, name, starts).astype(np.float64), clock)

    def fields(self) -> tuple[str, ...]:
        if self._fields is None:
            self._fields = tuple(self._listed())
        return self._fields

    @property
    def sampled_s(self) -> float:
        """From the first sample to the last of a topic with at least `REGULAR` of them; the longest."""
        clocks = (self._clock(topic, self.log.instances(topic)[0])[0] for topic in self._topics())
        return max((float(t[-1] - t[0]) for t in clocks if t.size >= REGULAR), default=0.0)

    def texts(self) -> Sequence[tuple[float, str]]:
        return self.log.texts

    def modes(self) -> Sequence[tuple[float, int]]:
        return [(t, int(mode)) for t, mode in self._changes("vehicle_status.nav_state")]

    def armed(self) -> Sequence[tuple[float, bool]]:
        if self.has("vehicle_status.arming_state"):
            told = [(t, state == _ARMED) for t, state in self._changes("vehicle_status.arming_state")]
        else:
            told = [(t, state != 0) for t, state in self._changes("actuator_armed.armed")]
        return [one for one, before in zip(told, [None, *told], strict=False) if before is None or one[1] != before[1]]

    def _changes(self, key: str) -> list[tuple[float, float]]:
        """The first value and every other one that is not as the one before, with their times."""
        if not self.has(key):
            return []
        series = self.series(key)
        new = np.concatenate(([True], np.diff(series.values) != 0))
        return list(zip(series.t[new].tolist(), series.values[new].tolist(), strict=True))

    def _topics(self) -> list[str]:
        return sorted({topic for topic, _ in self.log.ids if "timestamp" in self.log.layout(topic)})

    def _listed(self) -> Iterator[str]:
        count = 0
        for topic in self._topics():
            if self._clock(topic, self.log.instances(topic)[0])[0].size == 0:
                continue
            for name, (_, stored) in self.log.layout(topic).items():
                if stored != "char" and name != "timestamp" and not name.rpartition(".")[2].startswith("_padding"):
                    yield f"{topic}.{name}"
                    count += 1
                    if count == MOST_FIELDS:
                        return

    def _parts(self, key: str) -> tuple[str, int, str]:
        match = _FIELD.fullmatch(key)
        if match is None:
            raise KeyError(key)
        topic, number, name = match.groups()
        instances = self.log.instances(topic)
        instance = int(number) if number is not None else (instances or (0,))[0]
        if instance not in instances or name not in self.log.layout(topic) or "timestamp" not in self.log.layout(topic):
            raise KeyError(key)
        return topic, instance, name

    def _clock(self, topic: str, instance: int) -> tuple[FloatArray, Offsets, int]:
        """Increasing times, the messages they belong to, and how many were thrown out; none where time stands still."""
        if (topic, instance) not in self._clocks:
            starts = self.log.messages(topic, instance)
            only, name, scale = self._time
            asked = name in self.log.layout(topic) and only in ("", topic)
            t = self._stamps(topic, name, starts, scale) if asked else np.empty(0)
            if t.size == 0:
                t = self._stamps(topic, "timestamp", starts, 1e-6)
            if t.size == 0:
                starts = starts[:0]
            keep = increasing(t)
            out = int(np.count_nonzero(~keep))
            t, starts = t[keep], starts[keep]
            trusted = self._trusted(t, starts)
            self._clocks[topic, instance] = (t[trusted], starts[trusted], out)
        return self._clocks[topic, instance]

    def _stamps(self, topic: str, name: str, starts: Offsets, scale: float) -> FloatArray:
        """Times in s; empty where several messages have but one: PX4 leaves 0 where it does not set them."""
        stamps = self.log.column(topic, name, starts)
        if stamps.size > 1 and stamps[0] == stamps[-1] and not np.any(stamps != stamps[0]):
            return np.empty(0)
        return stamps.astype(np.float64) * scale

    def _trusted(self, t: FloatArray, starts: Offsets) -> NDArray[np.bool_]:
        """All but a sample before a gap that the whole file has at this very message, shape (n,).

        Where bytes are missing, the head of one message can by chance be continued by the tail of a later one of just
        the right length. Nothing in the format shows it, but the message behind it is then as late as the gap is long.
        Gaps that the logger itself made end at its dropout message, and the sample before them is good.
        """
        trusted = np.ones(t.size, np.bool_)
        if t.size < REGULAR:
            return trusted
        spacing = np.diff(t)
        late = 3 * float(np.median(spacing))
        before = np.flatnonzero(spacing > late)
        with np.errstate(invalid="ignore"):
            trusted[before] = ~(self.log.next_stamps(starts[before]) * 1e-6 - t[before] > late)
        return trusted


def choose(log: ULogFile, path: str, profile: Profile | None, bundled: Sequence[Profile]) -> tuple[Profile, UlogTables]:
    """The profile asked for, or the bundled one that suits the log best, and the log on that profile's time."""
    chosen = profile or profiles.choose(UlogTables(log, path), bundled)
    if chosen is None:
        chosen = next(one for one in bundled if one.name == "px4")
    return chosen, UlogTables(log, path, chosen.time_source, chosen.time_scale)


def advice(tables: UlogTables, profile: Profile) -> tuple[str, ...]:
    """What to set for the next flight, where PX4's usual settings have logged rates or commands too slowly."""
    slowest = 0.0
    for channel in ("p", "delta_x"):
        sources = profile.channels[channel].sources if channel in profile.channels else ()
        spacings = [tables.series(key).spacing_s for key in sources if tables.has(key)]
        slowest = max(slowest, min(spacings, default=0.0))
    if slowest <= 1 / (4 * F_HIGH_HZ):
        return ()
    return ("rates or commands are logged too slowly: set bit 3 (system identification) of PX4's SDLOG_PROFILE",)
