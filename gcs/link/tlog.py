"""MAVLink frames in the bytes of a telemetry log, found and checked many at a time.

Before each frame stand 8 bytes: when it was received or sent, in us since 1970, highest byte first. Every byte that may
begin a frame is a candidate; one counts when its checksum is right, so that nothing is read that nobody sent. First
come candidates behind a time that can be one. Where those leave bytes over, whatever a source that is already known may
have sent is looked for, since a damaged time does not spoil the frame behind it.

A checksum of 16 bits takes 16 bits of message at a time from a table, for thousands of frames at once.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pymavlink.dialects.v20 import all as dialect

Bytes = NDArray[np.uint8]
Offsets = NDArray[np.int64]
Numbers = NDArray[np.int32]

MAVLINK1, MAVLINK2 = 0xFE, 0xFD
TIME_BYTES = 8
PAD = 320
"""Bytes behind the file's own that may be looked at: more than the longest frame."""
WINDOW = 1 << 22
BATCH = 1 << 14  # frames whose checksums are computed together: what they need stays in the cache
LATEST_HIGH = 0x0F  # second byte of a time; with a first of 0 up to the year 2103

_SIGNED = 1
_ITEM = re.compile(r"(\d*)([a-zA-Z])")
_NUMPY = {"b": "i1", "B": "u1", "h": "<i2", "H": "<u2", "i": "<i4", "I": "<u4", "q": "<i8", "Q": "<u8"}
_NUMPY |= {"f": "<f4", "d": "<f8"}


@dataclass(frozen=True)
class Layout:
    """What a message of one kind looks like."""

    id: int
    name: str
    dtype: np.dtype[Any]
    """The payload with all its extensions, in the order on the wire."""
    instance: str | None
    """The field that tells several sources of one vehicle apart, where it is a number."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Frames:
    """The frames of a telemetry log, in the file's order; n of them."""

    data: Bytes
    """The file and `PAD` bytes more."""
    size: int
    """Bytes of the file."""
    received_us: Offsets
    """Since 1970, shape (n,); -1 where it cannot be read."""
    ids: Numbers
    sources: Numbers
    """256 * system + component, shape (n,)."""
    payloads: Offsets
    """First byte of each payload, shape (n,)."""
    lengths: Numbers
    """Bytes of each payload, zeros at its end possibly cut, shape (n,)."""
    skipped_bytes: int
    """Bytes in none of these frames."""
    resyncs: int
    tail_cut: bool
    unknown: Mapping[int, int] = field(default_factory=dict)
    """Message id of no known dialect -> how many whole frames of it stand where a frame must; they are skipped."""

    def table(self, id: int, rows: Offsets) -> NDArray[Any]:
        """The payloads of some frames of one kind, as a structured array of shape (rows,), zeros put back."""
        dtype = layouts()[id].dtype
        everywhere = np.ndarray((self.data.size - dtype.itemsize + 1,), f"V{dtype.itemsize}", self.data, 0, (1,))
        raw = everywhere[self.payloads[rows]].view(np.uint8).reshape(rows.size, dtype.itemsize)
        lengths = self.lengths[rows]
        for length in np.unique(lengths[lengths < dtype.itemsize]).tolist():
            raw[lengths == length, length:] = 0
        return raw.reshape(-1).view(dtype)


@cache
def layouts() -> Mapping[int, Layout]:
    """Message id -> layout, of every dialect that is known."""
    return {id: _layout(id, message) for id, message in dialect.mavlink_map.items()}


def _layout(id: int, message: Any) -> Layout:
    fields: list[tuple[Any, ...]] = []
    items = _ITEM.findall(message.unpacker.format)
    for name, (count, letter) in zip(message.ordered_fieldnames, items, strict=True):
        if letter in "sc":
            fields.append((name, f"S{count or 1}"))
        else:
            fields.append((name, _NUMPY[letter], (int(count),)) if count else (name, _NUMPY[letter]))
    dtype = np.dtype(fields)
    instance = message.instance_field
    numeric = instance is not None and dtype[instance].kind in "iu"
    return Layout(id, message.msgname, dtype, instance if numeric else None)


@cache
def _kinds() -> tuple[Offsets, Offsets]:
    """By message id: the byte that its checksum ends with, -1 where unknown; bytes of its payload."""
    known = layouts()
    extra, longest = np.full(max(known) + 2, -1, np.int64), np.zeros(max(known) + 2, np.int64)
    for id, layout in known.items():
        extra[id], longest[id] = dialect.mavlink_map[id].crc_extra, layout.dtype.itemsize
    return extra, longest


@cache
def _crc_tables() -> tuple[NDArray[np.uint16], NDArray[np.uint16]]:
    """The register after 8 zero bits, shape (256,), and after 16, shape (65536,)."""
    register = np.arange(1 << 16)
    after = []
    for step in range(16):
        register = (register >> 1) ^ np.where(register & 1, 0x8408, 0)
        if step in (7, 15):
            after.append(register.astype(np.uint16))
    return after[0][:256].copy(), after[1]


@dataclass(frozen=True, eq=False, kw_only=True)
class _Candidates:
    """Places where a frame may begin; arrays of shape (n,)."""

    at: Offsets
    length: Numbers
    """Bytes of the frame, checksum and signature included."""
    payload: Offsets
    payload_length: Numbers
    id: Numbers
    source: Numbers
    timely: NDArray[np.bool_]
    """Behind a time that can be one."""

    def part(self, which: Any) -> _Candidates:
        return _Candidates(
            at=self.at[which],
            length=self.length[which],
            payload=self.payload[which],
            payload_length=self.payload_length[which],
            id=self.id[which],
            source=self.source[which],
            timely=self.timely[which],
        )

    @property
    def begin(self) -> Offsets:
        """First byte of the frame with its time, where that can be one."""
        return self.at - TIME_BYTES * self.timely


def locate(data: Bytes, size: int) -> Frames:
    """Find the frames in the first `size` bytes of `data`, which has `PAD` bytes more."""
    found, others = [], []
    for start in range(0, size, WINDOW):
        here = _candidates(data, size, start, min(start + WINDOW, size))
        timely = here.part(here.timely)
        right = _right(data, timely, start)
        found.append(timely.part(right))
        # kept for a second look: all that the first did not believe
        others.append((here.part(~here.timely), start))
    frames = _apart(_joined(found))
    found.clear()
    sources = np.unique(frames.source)
    begin, end = frames.begin, frames.at + frames.length
    second = []
    for candidates, start in others:
        free = _free(begin, end, candidates) & np.isin(candidates.source, sources)
        candidates = candidates.part(free)
        second.append(candidates.part(_right(data, candidates, start)))
    late = _joined(second)
    if late.at.size:
        both = _joined([frames, late])
        frames = _apart(both.part(np.argsort(both.at)))
    return _counted(data, size, frames)


def _joined(parts: list[_Candidates]) -> _Candidates:
    if not parts:
        at, number = np.empty(0, np.int64), np.empty(0, np.int32)
        return _Candidates(
            at=at,
            length=number,
            payload=at,
            payload_length=number,
            id=number,
            source=number,
            timely=np.empty(0, np.bool_),
        )
    return _Candidates(
        at=np.concatenate([part.at for part in parts]),
        length=np.concatenate([part.length for part in parts]),
        payload=np.concatenate([part.payload for part in parts]),
        payload_length=np.concatenate([part.payload_length for part in parts]),
        id=np.concatenate([part.id for part in parts]),
        source=np.concatenate([part.source for part in parts]),
        timely=np.concatenate([part.timely for part in parts]),
    )


def _candidates(data: Bytes, size: int, start: int, stop: int) -> _Candidates:
    """Whole frames of known ids that may begin in [start, stop), their checksums not looked at."""
    extra, longest = _kinds()
    here = data[start:stop]
    at = np.flatnonzero((here == MAVLINK1) | (here == MAVLINK2)) + start
    second = data[at] == MAVLINK2
    count, flags = data[at + 1].astype(np.int32), data[at + 2]
    signed = second & (flags == _SIGNED)
    head = np.where(second, np.int32(10), np.int32(6))
    length = head + count + 2 + np.int32(13) * signed
    id = np.minimum(np.where(second, _id_of(data, at), data[at + 5]), np.int32(extra.size - 1))
    good = (at + length <= size) & (extra[id] >= 0)
    good &= np.where(second, flags <= _SIGNED, count <= longest[id])
    at, second = at[good], second[good]
    head, length, count, id = (numbers[good] for numbers in (head, length, count, id))
    system = np.where(second, data[at + 5], data[at + 3]).astype(np.int32)
    component = np.where(second, data[at + 6], data[at + 4]).astype(np.int32)
    before = np.maximum(at - TIME_BYTES, 0)
    timely = (at >= TIME_BYTES) & (data[before] == 0) & (data[before + 1] < LATEST_HIGH)
    return _Candidates(
        at=at,
        length=length,
        payload=at + head,
        payload_length=count,
        id=id,
        source=256 * system + component,
        timely=timely,
    )


def _id_of(data: Bytes, at: Offsets) -> Numbers:
    """Message id of MAVLink 2 frames, three bytes."""
    low, middle, high = (data[at + k].astype(np.int32) for k in (7, 8, 9))
    return low | middle << 8 | high << 16


def _right(data: Bytes, candidates: _Candidates, start: int) -> NDArray[np.bool_]:
    """Whose checksums are right, shape (n,). The candidates begin at `start` or within a window behind it."""
    right = np.zeros(candidates.at.size, np.bool_)
    if not right.size:
        return right
    last = int(candidates.at[-1]) + PAD
    words = data[start:last].astype(np.uint16)
    words[:-1] |= words[1:] << 8  # the 16 bits that begin at each byte
    by_byte, by_word = _crc_tables()
    extra, _ = _kinds()
    for first in range(0, right.size, BATCH):
        some = slice(first, first + BATCH)
        at, end = candidates.at[some] + 1, candidates.payload[some] + candidates.payload_length[some]
        order = np.argsort(at - end, kind="stable")  # longest first: those still going on are a prefix
        at, end = at[order], end[order]
        pairs = (end - at) // 2
        going = np.searchsorted(-pairs, -np.arange(1, int(pairs[0]) + 1), "right") if pairs.size else pairs
        crc = np.full(at.size, 0xFFFF, np.uint16)
        place = at - start
        for count in going.tolist():
            crc[:count] = by_word[crc[:count] ^ words[place[:count]]]
            place[:count] += 2
        odd = at + 2 * pairs < end
        crc[odd] = by_byte[(crc[odd] ^ data[end[odd] - 1]) & 0xFF] ^ (crc[odd] >> 8)
        crc = by_byte[(crc ^ extra[candidates.id[some]][order].astype(np.uint16)) & 0xFF] ^ (crc >> 8)
        right[some][order] = crc == words[end - start]
    return right


def _apart(candidates: _Candidates) -> _Candidates:
    """Without those that lie inside an earlier one: frames that a message carries were not sent for themselves."""
    begin, end = candidates.begin, candidates.at + candidates.length
    if np.all(begin[1:] >= end[:-1]):
        return candidates
    keep, timely = np.zeros(begin.size, np.bool_), candidates.timely.copy()
    free = 0
    for i, (first, at, stop) in enumerate(zip(begin.tolist(), candidates.at.tolist(), end.tolist(), strict=True)):
        if at >= free:
            keep[i] = True
            timely[i] &= first >= free  # else bytes of the frame before were taken for its time
            free = stop
    return replace(candidates, timely=timely).part(keep)


def _free(begin: Offsets, end: Offsets, candidates: _Candidates) -> NDArray[np.bool_]:
    """Which candidates lie in none of the frames, that go from `begin` to `end`, and run into none."""
    if not begin.size:
        return np.ones(candidates.at.size, np.bool_)
    after = np.searchsorted(begin, candidates.at, "right")
    clear = (after == 0) | (end[np.maximum(after - 1, 0)] <= candidates.at)
    beyond = begin[np.minimum(after, begin.size - 1)]
    free: NDArray[np.bool_] = clear & ((after == begin.size) | (candidates.at + candidates.length <= beyond))
    return free


def _counted(data: Bytes, size: int, frames: _Candidates) -> Frames:
    """The frames, and what lies between them."""
    begin, end = frames.begin, frames.at + frames.length
    edges_first = np.concatenate(([0], end))
    edges_stop = np.concatenate((begin, [size]))
    open_at = np.flatnonzero(edges_first < edges_stop)
    unknown: dict[int, int] = {}
    resyncs, tail_cut = 0, False
    for k in open_at.tolist():
        here, stop = int(edges_first[k]), int(edges_stop[k])
        while (step := _unknown(data, here, stop)) is not None:
            id, here = step
            unknown[id] = unknown.get(id, 0) + 1
        if here < stop:
            resyncs += stop < size
            tail_cut = tail_cut or stop == size
    received = np.full(frames.at.size, -1, np.int64)
    at = frames.at[frames.timely]
    stamp = np.zeros(at.size, np.int64)
    for k in range(TIME_BYTES):
        stamp = stamp << 8 | data[at - TIME_BYTES + k]
    received[frames.timely] = stamp
    return Frames(
        data=data,
        size=size,
        received_us=received,
        ids=frames.id,
        sources=frames.source,
        payloads=frames.payload,
        lengths=frames.payload_length,
        skipped_bytes=int(np.sum(edges_stop - edges_first)),
        resyncs=resyncs,
        tail_cut=tail_cut,
        unknown=unknown,
    )


def _unknown(data: Bytes, at: int, stop: int) -> tuple[int, int] | None:
    """Id and end of a frame of an unknown id that stands here with its time and is followed by another or by `stop`."""
    head = data[at : at + TIME_BYTES + 10].tolist()
    if at + TIME_BYTES + 8 > stop or head[0] != 0 or head[1] >= LATEST_HIGH or head[8] not in (MAVLINK1, MAVLINK2):
        return None
    count = head[9]
    if head[8] == MAVLINK1:
        id, end = head[13], at + TIME_BYTES + 8 + count
    elif head[10] <= _SIGNED:
        id = head[15] | head[16] << 8 | head[17] << 16
        end = at + TIME_BYTES + 12 + count + 13 * head[10]
    else:
        return None
    if id in layouts() or end > stop:
        return None
    met = end == stop or (end + TIME_BYTES < stop and int(data[end + TIME_BYTES]) in (MAVLINK1, MAVLINK2))
    return (id, end) if met else None
