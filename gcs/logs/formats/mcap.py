"""MCAP, in which ROS 2 records its topics, as named arrays; read by the format's own project (`mcap`,
`mcap-ros2-support`).

From its beginning to its end, chunk by chunk: the index that a recorder writes last is not needed, for one that was
stopped hard writes none. A chunk whose checksum is wrong is left out. Fields are `topic.field`, the topic without its
first slash and with `_` for the others; `topic.t` is the time of a message's own stamp where it bears one (a header's,
or PX4's `timestamp_sample` or `timestamp`), else when it was recorded, in s from the first message on.
"""

from __future__ import annotations

import hashlib
import io
import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from gcs.errors import TippathError, to_install
from gcs.logs.formats.damage import Damage
from gcs.logs.formats.raw import most_inflated, unreadable
from gcs.logs.formats.tables import FloatArray
from gcs.logs.words import printable

MARK = b"\x89MCAP0\r\n"
INSTALL = to_install("mcap", "mcap-ros2-support")
LARGEST_MESSAGE = 1 << 16
"""Bytes: larger ones are pictures and clouds of points."""
LARGEST_RECORD = 1 << 28
MOST_NUMBERS = 64  # of an array in a message
DEEPEST = 8
STAMP_WITHIN_S = 60.0
"""That stamps of one topic may be off the clock that recorded it, and still be of the same."""
PX4_CLOCK_OFF_S = 1.0
PX4_OLDEST_SAMPLE_S = 0.1
"""Of which a message of PX4 is published."""


@dataclass(frozen=True, eq=False)
class McapFile:
    """What of a recording are numbers."""

    columns: Mapping[str, FloatArray]
    """`topic.field` -> (n,); `topic.t` is the topic's time, s."""
    damage: Damage
    notes: tuple[str, ...]
    sha256: str


@dataclass(kw_only=True)
class _Topic:
    name: str
    paths: tuple[str, ...] = ()
    """Of the first message's numbers; those that have others are left out."""
    rows: list[list[float]] = field(default_factory=list)
    logged_ns: list[int] = field(default_factory=list)
    stamps: list[float] = field(default_factory=list)
    """Of the header."""
    unlike: int = 0
    failed: int = 0


def recognises(head: bytes) -> bool:
    """Whether a file that begins with these bytes is one."""
    return head.startswith(MARK)


def read(path: Path) -> McapFile:
    """Raises TippathError for what cannot be read at all, and where the packages that read it are not installed."""
    try:
        from mcap.stream_reader import StreamReader
    except ImportError as error:
        raise TippathError(f"{path}: an MCAP, and what reads it is not installed: {INSTALL}") from error
    try:
        raw = path.read_bytes()
    except OSError as error:
        raise unreadable(path, error) from error
    reading = _Reading(most_inflated(len(raw)))
    stream = io.BytesIO(raw)
    try:
        for record in StreamReader(stream, emit_chunks=True, record_size_limit=LARGEST_RECORD).records:
            reading.take(record)
    except Exception as error:  # its reader raises nearly every kind of error for a damaged file
        reading.ended = printable(str(error).splitlines()[0][:80]) if str(error) else type(error).__name__
        reading.read_bytes = stream.tell()
    ahead_s = _px4_ahead(list(reading.topics.values()))
    columns = {name: values for topic in reading.topics.values() for name, values in _columns(topic, ahead_s)}
    if not columns:
        why = f" ({reading.ended})" if reading.ended else ""
        seen = ", ".join(sorted(topic.name for topic in reading.topics.values())[:6]) or "none"
        raise TippathError(
            f"{path}: no message with numbers could be read{why}; topics in it: {seen}. Messages of ROS 2 (cdr with "
            "ros2msg) and JSON are read"
        )
    first_s = min(float(np.min(values)) for name, values in columns.items() if name.endswith(".t"))
    columns = {name: values - first_s if name.endswith(".t") else values for name, values in columns.items()}
    skipped = reading.skipped_bytes + (len(raw) - reading.read_bytes if reading.ended else 0)
    damage = Damage(len(raw), skipped, reading.chunks_lost, {}, bool(reading.ended))
    return McapFile(columns, damage, tuple(reading.notes()), hashlib.sha256(raw).hexdigest())


class _Reading:
    """Records as they come."""

    def __init__(self, most: int) -> None:
        """`most`: bytes that all chunks may become."""
        self._left = most
        self.topics: dict[int, _Topic] = {}
        self.ended = ""
        self.read_bytes = 0
        self.skipped_bytes = 0
        self.chunks_lost = 0
        self._schemas: dict[int, Any] = {}
        self._decoders: dict[int, Callable[[bytes], Any] | None] = {}

    def take(self, record: Any) -> None:
        from mcap.records import Channel, Chunk, Message, Schema
        from mcap.stream_reader import breakup_chunk

        match record:
            case Chunk():
                try:
                    plain = _inflated(record, self._left)
                    self._left -= len(plain.data)
                    inside = breakup_chunk(plain, validate_crc=True)
                except Exception:  # damaged: the next one may be whole
                    self.chunks_lost += 1
                    self.skipped_bytes += len(record.data)
                    return
                for one in inside:
                    self.take(one)
            case Schema():
                self._schemas[record.id] = record
            case Channel():
                if record.id not in self.topics:
                    self.topics[record.id] = _Topic(name=printable(record.topic).lstrip("/").replace("/", "_"))
                    self._decoders[record.id] = _decoder(record, self._schemas.get(record.schema_id))
            case Message():
                self._message(record)

    def _message(self, message: Any) -> None:
        topic, decoder = self.topics.get(message.channel_id), self._decoders.get(message.channel_id)
        if topic is None or decoder is None:
            return
        if len(message.data) > LARGEST_MESSAGE:
            return
        try:
            numbers = list(_numbers(decoder(message.data)))
        except Exception:  # a message that is not of its own kind
            topic.failed += 1
            return
        paths = tuple(path for path, _ in numbers)
        topic.paths = topic.paths or paths
        if paths != topic.paths:
            topic.unlike += 1
            return
        topic.rows.append([value for _, value in numbers])
        topic.logged_ns.append(message.log_time)
        topic.stamps.append(_stamp(dict(numbers)))

    def notes(self) -> Iterator[str]:
        if self.ended:
            yield f"the recording ends early and is read as far as it goes ({self.ended})"
        for topic in self.topics.values():
            if topic.failed or topic.unlike:
                yield f"{topic.failed + topic.unlike} messages of {topic.name} left out: not as its others are"


def _inflated(chunk: Any, most: int) -> Any:
    """The chunk without its compression. Raises ValueError for more bytes than `most`, and what its packers raise."""
    import zstandard
    from lz4 import frame as lz4  # both come with mcap

    data = chunk.data
    if chunk.compression == "zstd":
        data = zstandard.ZstdDecompressor().stream_reader(data).read(most + 1)
    elif chunk.compression == "lz4":
        data = lz4.LZ4FrameDecompressor().decompress(data, max_length=most + 1)
    if len(data) > most:
        raise ValueError("far more than what is measured packs to")
    return replace(chunk, compression="", data=data)


def _decoder(channel: Any, schema: Any) -> Callable[[bytes], Any] | None:
    """None for a kind of message that is not read."""
    from mcap_ros2.decoder import DecoderFactory

    if channel.message_encoding == "json":
        return json.loads
    try:
        found: Callable[[bytes], Any] | None = DecoderFactory().decoder_for(channel.message_encoding, schema)
    except Exception:  # a schema that is none
        return None
    return found


def _numbers(value: Any, path: str = "", depth: int = 0) -> Iterator[tuple[str, float]]:
    """(`angular_velocity.x`, its value) of every number in a message."""
    if isinstance(value, bool | int | float):
        yield path, float(value)
    elif depth > DEEPEST or isinstance(value, str | bytes):
        return
    elif isinstance(value, Sequence):
        for i, entry in enumerate(value[:MOST_NUMBERS]):
            yield from _numbers(entry, f"{path}[{i}]", depth + 1)
    else:
        names = value if isinstance(value, Mapping) else getattr(value, "__slots__", ())
        for name in names:
            entry = value[name] if isinstance(value, Mapping) else getattr(value, name)
            yield from _numbers(entry, f"{path}.{name}" if path else printable(str(name)), depth + 1)


def _stamp(numbers: Mapping[str, float]) -> float:
    """Of its header, s; NaN where it bears none."""
    return numbers.get("header.stamp.sec", np.nan) + 1e-9 * numbers.get("header.stamp.nanosec", np.nan)


def _columns(topic: _Topic, px4_ahead_s: float) -> Iterator[tuple[str, FloatArray]]:
    if len(topic.rows) < 2 or not topic.paths:
        return
    logged_s = np.array(topic.logged_ns, np.float64) * 1e-9
    stamps, px4 = np.array(topic.stamps), _px4_times(topic)
    if bool(np.all(np.isfinite(stamps))) and float(np.max(np.abs(stamps - logged_s))) < STAMP_WITHIN_S:
        yield f"{topic.name}.t", stamps
    else:
        yield f"{topic.name}.t", logged_s if px4 is None else px4 + px4_ahead_s
    for path, values in zip(topic.paths, np.array(topic.rows).T, strict=True):
        if path != "t" and not path.startswith("header."):
            yield f"{topic.name}.{path}", np.ascontiguousarray(values)


def _px4_times(topic: _Topic) -> FloatArray | None:
    """(n,) s, of PX4's messages, which bear no header: of the sample that a message is about, where it has one, else
    of the message. None where `timestamp` is none in us on a clock that goes as the recorder's does."""
    if "timestamp" not in topic.paths or len(topic.rows) < 2:
        return None
    times = 1e-6 * np.array([row[topic.paths.index("timestamp")] for row in topic.rows])
    recorded_s = 1e-9 * (topic.logged_ns[-1] - topic.logged_ns[0])
    if not abs(float(times[-1] - times[0]) - recorded_s) < PX4_CLOCK_OFF_S + 0.01 * recorded_s:
        return None
    if "timestamp_sample" in topic.paths:
        sampled = 1e-6 * np.array([row[topic.paths.index("timestamp_sample")] for row in topic.rows])
        if bool(np.all(np.abs(times - sampled) < PX4_OLDEST_SAMPLE_S)):
            return sampled
    return times


def _px4_ahead(topics: Sequence[_Topic]) -> float:
    """By how much the recorder's clock is ahead of PX4's, s: one number for all topics, which share that clock."""
    of_px4 = [(topic, times) for topic in topics if (times := _px4_times(topic)) is not None]
    if not of_px4:
        return 0.0
    topic, times = max(of_px4, key=lambda each: each[1].size)
    return float(np.median(np.array(topic.logged_ns, np.float64) * 1e-9 - times))
