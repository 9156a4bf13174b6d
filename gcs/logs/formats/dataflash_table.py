"""A DataFlash log, binary or text, as named series."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from gcs.logs.formats.dataflash_scan import CLOCKS, Format
from gcs.logs.formats.tables import FloatArray, Series, before_no_gap, increasing

_FIELD = re.compile(r"([A-Za-z0-9_]{1,4})(?:\[(\d{1,3})\])?\.([A-Za-z0-9_]+)")
INSTANCE = ("I", "Instance")
EVENTS = frozenset({"CMD", "ERR", "EV", "FILE", "FMT", "FMTU", "MAVC", "MODE", "MSG", "MULT", "ORGN", "PARM"})
EVENTS |= {"SIDS", "SIDY", "UNIT", "VER"}
"""Messages that tell of something that happened once: several may share a time, and nothing is due after them."""

KEPT_BYTES = 1 << 26  # of series that were asked for before
KEPT_LEAST = 8  # of them, however long

_ARMED, _DISARMED = (10, 15), (11,)  # Id of EV


class MessageLog(Protocol):
    """The messages of a DataFlash log, in whichever of its two spellings."""

    @property
    def formats(self) -> Mapping[str, Format]: ...

    @property
    def names(self) -> tuple[str, ...]:
        """Message types that occur at least once, alphabetically."""

    def starts(self, message: str) -> NDArray[np.int64]:
        """A number for every message of this type, in the file's order, shape (n,)."""

    def column(self, message: str, column: str, starts: NDArray[np.int64] | None = None) -> NDArray[Any]:
        """One field of every message of a type, or of those that `starts` names. Raises KeyError."""

    def texts(self, message: str, column: str) -> list[str]:
        """A string field, made printable."""


class DataFlashTables:
    """A DataFlash log; keys are `MESSAGE.Field`, or `MESSAGE[2].Field` for one sensor of several.

    Without a number the lowest that occurs is taken. Time is TimeUS (or TimeMS) unless `time_field` names another.
    """

    kind = "dataflash"

    def __init__(
        self,
        log: MessageLog,
        path: str,
        time_field: str | None = None,
        time_scale: float | None = None,
        *,
        sifted: bool = False,
    ) -> None:
        """`sifted`: what a gap follows was left out of the log before."""
        self.log = log
        self._sifted = sifted
        self.path = path
        self.dropped: dict[str, int] = {}
        """Message type -> samples thrown out for an impossible time stamp."""
        self.before_gaps: dict[str, int] = {}
        """Message type -> samples left out because a gap follows them, see `tables.before_no_gap`."""
        self._time = (time_field, time_scale)
        self._present = frozenset(log.names)
        self._series: dict[str, Series] = {}
        self._clocks: dict[str, tuple[FloatArray, NDArray[np.int64]]] = {}
        self._told_parameters: list[tuple[float, str, float]] | None = None

    def has(self, key: str) -> bool:
        try:
            message, instance, column = self._parts(key)
        except KeyError:
            return False
        fmt = self.log.formats[message]
        letter = fmt.types[fmt.columns.index(column)]
        if letter in "aNnZ":
            return False
        time = self._time_of(message)
        if instance is None and time is not None and fmt.types[fmt.columns.index(time[0])] in "IQ":
            return message in self._present  # whole numbers are finite: one of them always stays
        return self._clock(message, instance)[0].size > 0

    def series(self, key: str) -> Series:
        if key in self._series:
            self._series[key] = self._series.pop(key)  # the last one asked for is forgotten last
            return self._series[key]
        message, instance, column = self._parts(key)
        t, starts = self._clock(message, instance)
        values = self.log.column(message, column, starts).astype(np.float64)
        self._series[key] = Series(t, values, message if instance is None else f"{message}[{instance}]")
        while len(self._series) > KEPT_LEAST and sum(s.values.nbytes for s in self._series.values()) > KEPT_BYTES:
            del self._series[next(iter(self._series))]
        return self._series[key]

    def fields(self) -> tuple[str, ...]:
        every = (f"{name}.{column}" for name in self.log.names for column in self.log.formats[name].columns)
        return tuple(key for key in every if not key.endswith((".TimeUS", ".TimeMS")) and self.has(key))

    @property
    def sampled(self) -> bool:
        """Whether there is anything but `EVENTS`."""
        return any(name not in EVENTS and self._time_of(name) is not None for name in self._present)

    @property
    def sampled_s(self) -> float:
        """From the first sample to the last of what is logged regularly; 0 where there is nothing but `EVENTS`."""
        names = [name for name in self.log.names if name not in EVENTS and self._time_of(name) is not None]
        clocks = [self._clock(name, None)[0] for name in names]
        return max((float(t[-1] - t[0]) for t in clocks if t.size), default=0.0)

    def strings(self, message: str, column: str) -> list[tuple[float, str]]:
        """A string field with its times, in s."""
        if message not in self.log.formats or column not in self.log.formats[message].columns:
            return []
        field, scale = self._time_of(message) or ("", 1.0)
        if not field:
            return []
        t = (self.log.column(message, field) * scale).tolist()  # several may share a time: nothing is thrown out
        return list(zip(t, self.log.texts(message, column), strict=True))

    def parameters(self, at_s: float = math.inf) -> dict[str, float]:
        """The vehicle's parameters by name, as the log had told them at that time; empty where it tells none."""
        if not self.has("PARM.Value"):
            return {}
        told = self._told_parameters
        if told is None:
            names = self.strings("PARM", "Name")
            values = self.log.column("PARM", "Value").astype(np.float64).tolist()
            told = self._told_parameters = [(t, name, value) for (t, name), value in zip(names, values, strict=True)]
        first: dict[str, float] = {}
        for _, name, value in told:
            first.setdefault(name, value)
        return first | {name: value for t, name, value in told if t <= at_s}

    def texts(self) -> Sequence[tuple[float, str]]:
        return self.strings("MSG", "Message")

    def modes(self) -> Sequence[tuple[float, int]]:
        key = next((key for key in ("MODE.ModeNum", "MODE.Mode") if self.has(key)), None)
        if key is None:
            return ()
        modes = self.series(key)
        entered = zip(modes.t.tolist(), modes.values.tolist(), strict=True)
        return [(t, int(mode)) for t, mode in entered if math.isfinite(mode)]

    def armed(self) -> Sequence[tuple[float, bool]]:
        if self.has("ARM.ArmState"):
            states = self.series("ARM.ArmState")
            return [(t, state != 0) for t, state in zip(states.t.tolist(), states.values.tolist(), strict=True)]
        if not self.has("EV.Id"):
            return ()
        events = self.series("EV.Id")
        told = zip(events.t.tolist(), events.values.tolist(), strict=True)
        return [(t, id in _ARMED) for t, id in told if id in (*_ARMED, *_DISARMED)]

    def _parts(self, key: str) -> tuple[str, int | None, str]:
        match = _FIELD.fullmatch(key)
        if match is None:
            raise KeyError(key)
        message, number, column = match.groups()
        fmt = self.log.formats.get(message)
        if fmt is None or column not in fmt.columns or self._time_of(message) is None:
            raise KeyError(key)
        return message, None if number is None else int(number), column

    def _time_of(self, message: str) -> tuple[str, float] | None:
        columns = self.log.formats[message].columns
        field, scale = self._time
        for name, unit in CLOCKS.items() if field is None else ((field, scale or 1.0), *CLOCKS.items()):
            if name in columns:
                return name, scale if scale is not None and name == field else unit
        return None

    def _clock(self, message: str, instance: int | None) -> tuple[FloatArray, NDArray[np.int64]]:
        """Increasing times and the messages they belong to."""
        name = f"{message}[{instance}]"
        if name not in self._clocks:
            starts = self.log.starts(message)
            column = next((c for c in INSTANCE if c in self.log.formats[message].columns), None)
            if column is not None and starts.size:
                numbers = self.log.column(message, column, starts)
                starts = starts[numbers == (numbers.min() if instance is None else instance)]
            elif instance is not None:
                starts = starts[:0]
            field, scale = self._time_of(message) or ("", 1.0)
            t = self.log.column(message, field, starts).astype(np.float64) * scale if field else np.empty(0)
            event = message in EVENTS
            keep = increasing(t, strictly=not event)
            if not keep.all():
                self.dropped[name if instance is not None else message] = int(np.count_nonzero(~keep))
            t, starts = t[keep], starts[keep]
            trusted = np.ones(t.size, np.bool_) if event or self._sifted else before_no_gap(t)
            if not trusted.all():
                self.before_gaps[name if instance is not None else message] = int(np.count_nonzero(~trusted))
            self._clocks[name] = (t[trusted], starts[trusted])
        return self._clocks[name]
