"""Telemetry logs (.tlog): what crossed a link, as named series of the one vehicle.

Clock. Messages that carry the vehicle's own time (time_boot_ms, time_usec) keep it, for it says when something was
measured; the time of receipt is later by a delay that varies. All series are in seconds since the vehicle's boot. A
message without a time of its own (HEARTBEAT, STATUSTEXT) came between two that have one: it gets the time of the last
before it and what passed until its receipt, but never more than the time of the next. A time_usec that counts from
elsewhere (1970, or 32 bits that run over) is moved by a constant, so that its spacing stays exact.

Vehicle. Only frames of the autopilot are read, that is of the system and component of its heartbeat. Those of the
ground station, of other components and of other vehicles are counted and told.

Boots. Where the vehicle's time goes back, it was started anew: one log for each boot.
"""

from __future__ import annotations

import hashlib
import re
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gcs.errors import TippathError
from gcs.link.decode import TextAssembly, sanitise
from gcs.link.events import StatusText, StatusTextPart
from gcs.link.tlog import PAD, Frames, Layout, layouts, locate
from gcs.logs.formats.damage import Damage
from gcs.logs.formats.raw import Offsets, read_padded
from gcs.logs.formats.tables import FloatArray, Series, changes, increasing
from gcs.logs.words import printable

HEARTBEAT, STATUSTEXT = 0, 253
NO_AUTOPILOT = 8  # MAV_AUTOPILOT_INVALID: stations, cameras, gimbals
NO_VEHICLE_TYPES = (6, 18, 26, 27, 30)  # station, onboard computer, gimbal, ADSB, camera
STATION = 6
QUADROTOR, X_FRAME = 2, 1
ARMED = 128
TEXT_SIZE = 50
BOOT_S = 1.0  # the clock goes back by more: a new boot, not frames that overtook each other
STAYS = 5  # samples by which a new boot must show
APART_S = 5.0  # a time_usec that is further off counts from elsewhere
WRAP_S = 2**32 * 1e-6
ACTUATORS = ("SERVO_OUTPUT_RAW", "ACTUATOR_CONTROL_TARGET", "ACTUATOR_OUTPUT_STATUS")
RATES = ("HIGHRES_IMU", "ATTITUDE", "ATTITUDE_QUATERNION", "SCALED_IMU", "RAW_IMU")
EVENTS = re.compile(
    r"(PARAM|COMMAND|MISSION|LOG|FILE_TRANSFER|TIMESYNC|STATUSTEXT|AUTOPILOT_VERSION|HOME_POSITION|GPS_GLOBAL_ORIGIN)"
)
"""What such messages tell happens now and then: no channel."""

_FIELD = re.compile(r"([A-Z0-9_]+)(?:\[(\d{1,3})\])?\.([A-Za-z0-9_]+)(?:\[(\d{1,3})\])?")
_CLOCKS = (("time_boot_ms", 1e-3), ("time_usec", 1e-6))
_INSTANCES = {"ACTUATOR_CONTROL_TARGET": "group_mlx"}


@dataclass(frozen=True)
class Sender:
    """A system and component that sent frames."""

    number: int
    """256 * system + component."""
    frames: int
    types: frozenset[int]
    """MAV_TYPE of its heartbeats; empty where it sent none."""
    autopilot: bool

    def __str__(self) -> str:
        kind = ", a ground station" if STATION in self.types else ""
        return f"{self.frames} of system {self.number >> 8}, component {self.number & 255}{kind}"


class TlogTables:
    """One boot of one vehicle; keys are `MESSAGE.field`, `MESSAGE.field[2]` of an array.

    `MESSAGE[1].field` is one source of several of one vehicle (IMU, group of actuators); without a number the lowest
    that occurs is taken.
    """

    kind = "tlog"

    def __init__(self, frames: Frames, path: str, rows: Offsets, boot_rows: Offsets, boot_s: FloatArray) -> None:
        """`rows`: its frames; `boot_rows` and `boot_s`: which frames tell the time since boot, in order of the file."""
        self.path = path
        self.dropped: dict[str, int] = {}
        self._frames = frames
        self._rows = rows
        self._ids = frames.ids[rows]
        self._reference = boot_rows, np.maximum.accumulate(boot_s)
        self._by_name = {layouts()[id].name: layouts()[id] for id in np.unique(self._ids).tolist()}
        self._tables: dict[str, tuple[NDArray[Any], FloatArray]] = {}
        self._clocks: dict[str, tuple[FloatArray, NDArray[Any]]] = {}

    @property
    def sampled_s(self) -> float:
        t = self._reference[1]
        return float(t[-1] - t[0]) if t.size else 0.0

    @cached_property
    def type(self) -> int | None:
        """MAV_TYPE of the vehicle; 2 is a quadrotor."""
        if "HEARTBEAT" not in self._by_name:
            return None
        types, counts = np.unique(self._table("HEARTBEAT")[0]["type"], return_counts=True)
        return int(types[np.argmax(counts)])

    def parameter(self, name: str) -> float | None:
        """The last value of a parameter that the vehicle told; None where it did not."""
        if "PARAM_VALUE" not in self._by_name:
            return None
        table = self._table("PARAM_VALUE")[0]
        told = table["param_value"][table["param_id"] == name.encode()]
        return float(told[-1]) if told.size else None

    @property
    def is_quad_x(self) -> bool:
        """Whether it says of itself that it is a quadrotor with an X frame; ArduPilot's numbers."""
        return self.type == QUADROTOR and self.parameter("FRAME_TYPE") == X_FRAME

    def has(self, key: str) -> bool:
        try:
            layout, instance, _, _ = self._parts(key)
        except KeyError:
            return False
        return instance is None or bool(np.any(self._table(layout.name)[0][_instance_field(layout)] == instance))

    def series(self, key: str) -> Series:
        layout, instance, field, place = self._parts(key)
        name = layout.name if instance is None else f"{layout.name}[{instance}]"
        t, table = self._clock(name, layout, instance)
        values = table[field] if place is None else table[field][:, place]
        return Series(t, values.astype(np.float64), name)

    def fields(self) -> tuple[str, ...]:
        keys: list[str] = []
        first = {name: place for place, name in enumerate((*RATES, *ACTUATORS))}
        for name in sorted(self._by_name, key=lambda name: (first.get(name, len(first)), name)):
            layout = self._by_name[name]
            if EVENTS.match(name):
                continue
            for field in layout.dtype.names or ():
                kind = layout.dtype[field]
                if kind.base.kind == "S" or field in ("time_boot_ms", "time_usec"):
                    continue
                keys += [f"{name}.{field}[{i}]" for i in range(kind.shape[0])] if kind.shape else [f"{name}.{field}"]
        return tuple(keys)

    def rate_hz(self, message: str) -> float:
        """How often a message came, on the average; 0 where it did not, or once."""
        if message not in self._by_name:
            return 0.0
        t = self._table(message)[1]
        return float((t.size - 1) / (t[-1] - t[0])) if t.size > 1 and t[-1] > t[0] else 0.0

    def texts(self) -> Sequence[tuple[float, str]]:
        if "STATUSTEXT" not in self._by_name:
            return ()
        table, t = self._table("STATUSTEXT")
        assembly = TextAssembly()
        told: list[tuple[float, StatusText]] = []
        at = 0.0
        for row, at in zip(table, t.tolist(), strict=True):
            text = bytes(row["text"]).split(b"\0", 1)[0].decode("utf-8", "replace")
            severity, number = int(row["severity"]), int(row["id"])
            told += [(at, whole) for whole in assembly.overdue(at)]
            if number == 0:
                told.append((at, StatusText(0, 0, severity, sanitise(text))))
            else:
                last = len(bytes(row["text"])) < TEXT_SIZE
                part = StatusTextPart(
                    0, 0, severity=severity, text=text, id=number, chunk=int(row["chunk_seq"]), last=last
                )
                told += [(at, whole) for whole in assembly.add(part, at)]
        told += [(at, whole) for whole in assembly.overdue(np.inf)]
        return [(at, printable(whole.text)) for at, whole in told]

    def modes(self) -> Sequence[tuple[float, int]]:
        return [(t, int(mode)) for t, mode in self._changes("custom_mode")]

    def armed(self) -> Sequence[tuple[float, bool]]:
        return [(t, bool(armed)) for t, armed in self._changes("base_mode", ARMED)]

    def _changes(self, field: str, bits: int = -1) -> list[tuple[float, int]]:
        """When a field of the heartbeats took another value; the first is its state at the start."""
        if "HEARTBEAT" not in self._by_name:
            return []
        table, t = self._table("HEARTBEAT")
        values = table[field].astype(np.int64) & bits
        return changes(t, values)

    def _parts(self, key: str) -> tuple[Layout, int | None, str, int | None]:
        match = _FIELD.fullmatch(key)
        layout = self._by_name.get(match[1]) if match else None
        if match is None or layout is None or match[3] not in (layout.dtype.names or ()):
            raise KeyError(key)
        kind = layout.dtype[match[3]]
        place = None if match[4] is None else int(match[4])
        if kind.base.kind == "S" or (place is None) != (kind.shape == ()) or (kind.shape and place >= kind.shape[0]):
            raise KeyError(key)
        if match[2] is not None and _instance_field(layout) is None:
            raise KeyError(key)
        return layout, None if match[2] is None else int(match[2]), match[3], place

    def _table(self, name: str) -> tuple[NDArray[Any], FloatArray]:
        """All messages of a kind in the file's order, and when they came, s since boot."""
        if name not in self._tables:
            rows = self._rows[self._ids == self._by_name[name].id]
            self._tables[name] = self._frames.table(self._by_name[name].id, rows), self._came(rows)
        return self._tables[name]

    def _came(self, rows: Offsets) -> FloatArray:
        """The vehicle's clock when frames were received, s, shape (rows,)."""
        places, boot_s = self._reference
        received = _filled(self._frames.received_us)[rows] * 1e-6
        if not places.size:
            return received - (received[0] if received.size else 0.0)
        at_reference = _filled(self._frames.received_us)[places] * 1e-6
        before = np.searchsorted(places, rows, "right") - 1
        last = np.maximum(before, 0)
        following = np.minimum(last + 1, places.size - 1)
        room = np.where(following > last, boot_s[following] - boot_s[last], np.inf)
        after = boot_s[last] + np.clip(received - at_reference[last], 0.0, room)
        came: FloatArray = np.where(before >= 0, after, boot_s[0] - np.maximum(at_reference[0] - received, 0.0))
        return came

    def _clock(self, name: str, layout: Layout, instance: int | None) -> tuple[FloatArray, NDArray[Any]]:
        """Increasing times and the messages they belong to."""
        if name not in self._clocks:
            table, came = self._table(layout.name)
            field = _instance_field(layout)
            if field is not None and table.size:
                chosen = table[field] == (table[field].min() if instance is None else instance)
                table, came = table[chosen], came[chosen]
            t = _own_time(table, came)
            keep = increasing(came if t is None else t, strictly=t is not None)
            if t is not None and not keep.all():
                # the same measurement sent again, or one from before there was a time, is no loss
                lost = ~keep & ~np.isin(t, t[keep]) & (_stamps(table) > 0)
                if lost.any():
                    self.dropped[name] = int(np.count_nonzero(lost))
            self._clocks[name] = (came if t is None else t)[keep], table[keep]
        return self._clocks[name]


def _instance_field(layout: Layout) -> str | None:
    return _INSTANCES.get(layout.name, layout.instance)


def _stamps(table: NDArray[Any]) -> NDArray[Any]:
    """The times that messages carry, as they stand there; zeros where they have no such field."""
    names = table.dtype.names or ()
    field = next((field for field, _ in _CLOCKS if field in names), None)
    return np.zeros(table.size, np.uint32) if field is None else table[field].astype(table.dtype[field])


def _own_time(table: NDArray[Any], came: FloatArray) -> FloatArray | None:
    """The times that messages carry, in s since boot; None where they carry none, or leave it at zero."""
    stamps = _stamps(table)
    if np.count_nonzero(stamps) <= table.size / 2:
        return None
    told = stamps > 0
    if "time_boot_ms" in (table.dtype.names or ()):
        return np.where(told, stamps * 1e-3, np.nan)
    t: FloatArray = stamps * 1e-6
    if stamps.dtype.itemsize == 4:
        t = t + WRAP_S * np.round((came - t) / WRAP_S)
    if abs(float(np.median((t - came)[told]))) > APART_S:
        # of 16 digits a double holds too few: the difference is taken first
        t = (stamps - stamps[-1]).astype(np.int64) * 1e-6 if stamps.dtype.itemsize == 8 else t
        t = t - float(np.median((t - came)[told]))
    return np.where(told, t, np.nan)


def _filled(received_us: Offsets) -> Offsets:
    """Times of receipt with those that could not be read taken from the frame before."""
    good = received_us >= 0
    if good.all() or not good.any():
        return received_us
    last = np.maximum.accumulate(np.where(good, np.arange(good.size), -1))
    return received_us[np.where(last >= 0, last, np.flatnonzero(good)[0])]


@dataclass(frozen=True)
class Read:
    """A telemetry log, opened."""

    boots: tuple[TlogTables, ...]
    damage: Damage
    notes: tuple[str, ...]
    """What is wrong with it."""
    hints: tuple[str, ...]
    """What else whoever reads it should know."""
    sha256: str
    """Of the file, hexadecimal."""


def read(path: Path) -> Read:
    """Read a `.tlog` file. Raises TippathError where it cannot be opened, is none, or nothing in it is a vehicle's."""
    data, size = read_padded(path, PAD)
    return parse(data, size, str(path))


def parse(data: NDArray[np.uint8], size: int, path: str = "log") -> Read:
    """As `read`, from the first `size` bytes of data, behind which stand `PAD` zeros."""
    if size == 0:
        raise TippathError(f"{path}: the file is empty; copy it from the ground station again")
    frames = locate(data, size)
    if not frames.ids.size:
        raise TippathError(
            f"{path}: not a telemetry log: no MAVLink frame behind a time was found in its {size:,} bytes; "
            "check that it is the .tlog that the ground station wrote"
        )
    sources = _sources(frames)
    vehicles = sorted((sender for sender in sources if sender.autopilot), key=lambda sender: -sender.frames)
    if not vehicles:
        raise TippathError(
            f"{path}: nothing in it comes from a vehicle: its {frames.ids.size} frames are "
            f"{'; '.join(map(str, sources))}. It holds what was sent to the vehicle; "
            "name the log of the other direction, or the vehicle's own .BIN or .ulg"
        )
    vehicle = vehicles[0]
    boots = _boots(frames, path, np.flatnonzero(frames.sources == vehicle.number))
    damage = Damage(size, frames.skipped_bytes, frames.resyncs, frames.unknown, frames.tail_cut)
    return Read(
        boots,
        damage,
        _notes(boots, vehicles),
        _hints(boots, vehicle, sources),
        hashlib.sha256(data[:size].data).hexdigest(),
    )


def _sources(frames: Frames) -> list[Sender]:
    """Who sent frames, in order of their numbers.

    An autopilot is known by its heartbeat. Where there is none in the log, it is whoever sends as component 1 and is
    no ground station.
    """
    numbers, counts = np.unique(frames.sources, return_counts=True)
    beats = np.flatnonzero(frames.ids == HEARTBEAT)
    table, by = frames.table(HEARTBEAT, beats), frames.sources[beats]
    flies = (table["autopilot"] != NO_AUTOPILOT) & ~np.isin(table["type"], NO_VEHICLE_TYPES)
    senders = []
    for number, count in zip(numbers.tolist(), counts.tolist(), strict=True):
        its_own = by == number
        types = frozenset(table["type"][its_own].tolist())
        autopilot = bool(np.any(flies[its_own])) if types else number & 255 == 1 and not np.any(flies)
        senders.append(Sender(number, count, types, autopilot))
    return senders


def _boots(frames: Frames, path: str, rows: Offsets) -> tuple[TlogTables, ...]:
    """The vehicle's frames, one log for each boot."""
    places, boot_s = _reference(frames, rows)
    starts: list[int] = []
    for back in np.flatnonzero(np.diff(boot_s) < -BOOT_S).tolist():
        before = boot_s[starts[-1] if starts else 0 : back + 1].max()
        if np.median(boot_s[back + 1 : back + 1 + STAYS]) < before - BOOT_S:
            starts.append(back + 1)
    received = _filled(frames.received_us)
    cuts = [0]
    for start in starts:
        # what came before the first sample, but after the vehicle was started, belongs to the new boot
        begun_us = received[places[start]] - 1e6 * boot_s[start]
        between = rows[(rows > places[start - 1]) & (rows < places[start])]
        first = between[received[between] >= begun_us]
        cuts.append(int(first[0] if first.size else places[start]))
    ends = [*cuts[1:], frames.ids.size]
    edges = [*starts, boot_s.size]
    begins = [0, *starts]
    return tuple(
        TlogTables(
            frames,
            path,
            rows[(rows >= cut) & (rows < end)],
            places[first:stop],
            boot_s[first:stop],
        )
        for cut, end, first, stop in zip(cuts, ends, begins, edges, strict=True)
    )


def _reference(frames: Frames, rows: Offsets) -> tuple[Offsets, FloatArray]:
    """The frames that tell the time since boot, in the file's order, and that time in s.

    All with time_boot_ms; where there is none, those with a time_usec that does not count from 1970.
    """
    ids = frames.ids[rows]
    present = [layouts()[id] for id in np.unique(ids).tolist()]
    for field, unit in _CLOCKS:
        places, times = [], []
        for layout in present:
            names = layout.dtype.names or ()
            if field not in names or layout.dtype[field].itemsize < (8 if field == "time_usec" else 4):
                continue
            its_own = rows[ids == layout.id]
            count = frames.table(layout.id, its_own)[field]
            good = (count > 0) & (count * unit < 1e8)  # s; three years since boot, or thirty after 1970
            places.append(its_own[good])
            times.append(count[good] * unit)
        if places and sum(place.size for place in places):
            at, t = np.concatenate(places), np.concatenate(times)
            order = np.argsort(at)
            return at[order], t[order]
    return np.empty(0, np.int64), np.empty(0)


def _notes(boots: Sequence[TlogTables], vehicles: Sequence[Sender]) -> tuple[str, ...]:
    notes = []
    if len(vehicles) > 1:
        notes.append(
            f"{len(vehicles)} vehicles in it: frames {'; '.join(map(str, vehicles))}; "
            f"system {vehicles[0].number >> 8}, which sent most, is read, the others are not"
        )
    if len(boots) > 1:
        notes.append(f"the vehicle was started {len(boots)} times in it: each boot has its own clock")
    return tuple(notes)


def _hints(boots: Sequence[TlogTables], vehicle: Sender, sources: Sequence[Sender]) -> tuple[str, ...]:
    log = max(boots, key=lambda boot: boot.sampled_s)
    rates = [f"{name} {log.rate_hz(name):.1f} Hz" for name in (*RATES, *ACTUATORS) if log.rate_hz(name)]
    hints = [
        f"as received: {', '.join(rates) or 'neither body rates nor actuators'}; "
        "the vehicle's own log (.BIN, .ulg) has every sample"
    ]
    others = [sender for sender in sources if sender.number != vehicle.number and not sender.autopilot]
    if others:
        hints.append(f"frames of others than the autopilot are left out: {'; '.join(map(str, others))}")
    return tuple(hints)
