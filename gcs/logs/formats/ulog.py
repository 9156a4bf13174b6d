"""PX4's ULog `.ulg`: a chain of self-describing messages, read with numpy; fields are gathered when asked for.

`gcs.logs.formats.ulog_definitions` finds what messages there are, `gcs.logs.formats.ulog_chain` where they stand. (The
format's own reader, pyulog, walks every message, believes a size as it stands, and goes on at the next sync mark, which
older logs do not have. It takes as long to import as a log to read, and is what the tests measure this one against.)
There are no checksums in this format, so a flipped bit inside the data cannot be seen here; `increasing` throws out the
time stamps that cannot be.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gcs.errors import TippathError
from gcs.logs.formats.damage import Damage
from gcs.logs.formats.raw import Bytes, Offsets, gathered, unreadable
from gcs.logs.formats.tables import FloatArray
from gcs.logs.formats.ulog_chain import Chain, Ids, data_messages, settle
from gcs.logs.formats.ulog_definitions import FIRST, TYPES, Format, Topic, appended_at, claims_in, flat, formats_in

MAGIC = b"ULog\x01\x12\x35"


@dataclass(frozen=True, eq=False, kw_only=True)
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
            fields = ((key, place) for key, place in flat(self.formats, topic, 0, "") if place[0] < least)
            self._layouts[topic] = dict(fields)
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
        return gathered(self.data, 5 + offset, TYPES[kind], starts)

    def next_stamps(self, starts: Offsets) -> FloatArray:
        """Time in us of the data message that follows each without a byte between them; NaN where none does."""
        after = np.searchsorted(self.starts, starts) + 1
        ends = starts + 3 + gathered(self.data, 0, "<u2", starts)
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
        raise unreadable(path, error) from error
    return parse(data, str(path))


def parse(data: Bytes, path: str = "log") -> ULogFile:
    """As `read`, from the file's bytes."""
    if data.size == 0:
        raise TippathError(f"{path}: the file is empty; fetch the log from the vehicle again")
    known = data[: len(MAGIC)].tobytes() == MAGIC
    formats = formats_in(data)
    claims = claims_in(data, formats)
    if not claims:
        raise TippathError(
            f"{path}: "
            + (
                "the log ends before its first sample: fetch it from the vehicle again, whole"
                if known
                else "not a ULog: no topic that has a format was found; check that it is the .ulg from the vehicle"
            )
        )
    appended = appended_at(data, path) if known else ()
    low, high = np.full(1 << 16, 1 << 16, np.int32), np.zeros(1 << 16, np.int32)
    for id, topics in claims.items():
        low[id] = 2 + min(topic.least for topic, _ in topics)
        high[id] = 2 + max(topic.most for topic, _ in topics)
    at, sizes, ids = data_messages(data, low, high)
    settled = {id: settle(topics, sizes, ids == id) if len(topics) > 1 else topics[0] for id, topics in claims.items()}
    for id, (topic, _) in settled.items():
        low[id], high[id] = 2 + topic.least, 2 + topic.most
    keep = (sizes == low[ids]) | (sizes == high[ids])
    for offset in appended:  # what was being written when the vehicle crashed is cut there
        keep &= (at >= offset) | (at + 3 + sizes <= offset)
    chain = Chain(data, at[keep], ids[keep], 3 + sizes[keep].astype(np.int64), settled)
    starts, its_ids, damage = chain.follow(FIRST if known else 0)
    present = set(np.unique(its_ids).tolist())
    ids_of: dict[tuple[str, int], tuple[int, ...]] = {}
    for id, (topic, instance) in sorted(settled.items()):
        if id in present:
            ids_of[topic.name, instance] = (*ids_of.get((topic.name, instance), ()), id)
    return ULogFile(
        data=data,
        formats=formats,
        topics={topic.name: topic for topic, _ in settled.values()},
        ids=ids_of,
        texts=tuple(chain.texts),
        dropouts_ms=tuple(chain.dropouts_ms),
        damage=damage,
        starts=starts,
        _ids=its_ids,
    )
