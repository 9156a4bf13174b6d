"""A ULog as named series."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from gcs.logs.formats.raw import Offsets
from gcs.logs.formats.tables import FloatArray, Series, changes, increasing, late_after_s
from gcs.logs.formats.ulog import ULogFile
from gcs.logs.formats.ulog_definitions import parameters_in

MOST_FIELDS = 20_000  # listed for the user
REGULAR = 10  # messages from which on a topic is taken to be logged regularly

_FIELD = re.compile(r"([A-Za-z0-9_]+)(?:\[(\d{1,3})\])?\.([A-Za-z0-9_.\[\]]+)")
_ARMED = 2  # vehicle_status.arming_state


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

    def parameters(self) -> dict[str, float]:
        """The vehicle's parameters at the start of the log, by name."""
        return parameters_in(self.log.data)

    def texts(self) -> Sequence[tuple[float, str]]:
        return self.log.texts

    def modes(self) -> Sequence[tuple[float, int]]:
        return [(t, int(mode)) for t, mode in self._changes("vehicle_status.nav_state")]

    def armed(self) -> Sequence[tuple[float, bool]]:
        if self.has("vehicle_status.arming_state"):
            told = [(t, state == _ARMED) for t, state in self._changes("vehicle_status.arming_state")]
        else:
            told = [(t, state != 0) for t, state in self._changes("actuator_armed.armed")]
        return [told[k] for k in range(len(told)) if k == 0 or told[k][1] != told[k - 1][1]]

    def _changes(self, key: str) -> list[tuple[float, float]]:
        """The first value and every other one that is not as the one before, with their times."""
        if not self.has(key):
            return []
        series = self.series(key)
        return changes(series.t, series.values)

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
        longest = late_after_s(spacing)
        before = np.flatnonzero(spacing > longest)
        with np.errstate(invalid="ignore"):
            trusted[before] = ~(self.log.next_stamps(starts[before]) * 1e-6 - t[before] > longest[before])
        return trusted
