"""The DataFlash log: ArduPilot's messages, packed as ArduPilot packs them, to a file and to the block stream alike.

Every log begins with all formats, so that any prefix of it can be read. A log is closed with filler messages to a
whole number of 200-byte blocks: then the last block of a stream is full, and what the ground received equals the
file byte for byte.
"""

from __future__ import annotations

import contextlib
import struct
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Protocol

BLOCK_BYTES = 200
_HEAD = (0xA3, 0x95)
_TYPES = {"M": "B", "c": "h", "n": "4s", "N": "16s", "Z": "64s"}
"""DataFlash letters that `struct` calls otherwise; the rest of those used here are the same. c is in hundredths."""


@dataclass(frozen=True, kw_only=True)
class Format:
    """One kind of message. Units and multipliers are one letter a column, as FMTU explains them."""

    number: int
    name: str
    layout: str
    columns: str
    units: str
    multipliers: str

    @property
    def struct(self) -> struct.Struct:
        """Header and fields, little-endian without padding."""
        return struct.Struct("<BBB" + "".join(_TYPES.get(letter, letter) for letter in self.layout))

    @property
    def length(self) -> int:
        return self.struct.size


_FORMATS = (
    (128, "FMT", "BBnNZ", "Type,Length,Name,Format,Columns", "-b---", "-----"),
    (117, "UNIT", "QbZ", "TimeUS,Id,Label", "s--", "F--"),
    (118, "MULT", "Qbd", "TimeUS,Id,Mult", "s--", "F--"),
    (116, "FMTU", "QBNN", "TimeUS,FmtType,UnitIds,MultIds", "s---", "F---"),
    (32, "PARM", "QNff", "TimeUS,Name,Value,Default", "s---", "F---"),
    (59, "MSG", "QZ", "TimeUS,Message", "s-", "F-"),
    (120, "MODE", "QMBB", "TimeUS,Mode,ModeNum,Rsn", "s---", "F---"),
    (181, "EV", "QB", "TimeUS,Id", "s-", "F-"),
    (72, "ATT", "QffffffB", "TimeUS,DesRoll,Roll,DesPitch,Pitch,DesYaw,Yaw,AEKF", "sddddhh-", "F000000-"),
    (
        75,
        "RATE",
        "Qfffffffffffff",
        "TimeUS,RDes,R,ROut,PDes,P,POut,YDes,Y,YOut,ADes,A,AOut,AOutSlew",
        "skk-kk-kk-oo--",
        "F?????????BB--",
    ),
    (113, "RPM", "QBffB", "TimeUS,I,RPM,Qual,H", "s#q--", "F-000"),
    (
        112,
        "ARSP",
        "QBffcffBBffB",
        "TimeUS,I,Airspeed,DiffPress,Temp,RawPress,Offset,U,H,Hp,TR,Pri",
        "s#nPOPP-----",
        "F-00B00-----",
    ),
    (10, "SIDS", "QBfffffff", "TimeUS,Ax,Mag,FSt,FSp,TFin,TC,TR,TFout", "s--zzssss", "F--------"),
    (9, "SIDD", "Qfffffffff", "TimeUS,Time,Targ,F,Gx,Gy,Gz,Ax,Ay,Az", "ss-zkkkooo", "F---------"),
    # This vehicle's own: the added excitation and the commands that RATE does not carry, and what SIDS leaves out.
    (220, "TPEX", "Qfffff", "TimeUS,EX,EY,EE,Elev,Coll", "s-----", "F-----"),
    (221, "SIDY", "QBBfff", "TimeUS,Kind,Law,C1,Noise,Pulse", "s----s", "F-----"),
    # What the active bank would do while it does not fly: targets, outputs (unclipped), its observer's innovations.
    (224, "LQRO", "Qffffff", "TimeUS,PDes,QDes,X,Y,PInn,QInn", "sEE--EE", "F00--00"),
    (222, "PAD4", "B", "Zero", "-", "-"),
    (223, "PAD5", "H", "Zero", "-", "-"),
)
"""Number, name, layout, columns, units, multipliers."""
FORMATS = tuple(
    Format(number=number, name=name, layout=layout, columns=columns, units=units, multipliers=multipliers)
    for number, name, layout, columns, units, multipliers in _FORMATS
)

UNITS = {
    "-": "",
    "?": "UNKNOWN",
    "#": "instance",
    "b": "B",
    "d": "deg",
    "E": "rad/s",
    "h": "degheading",
    "k": "deg/s",
    "n": "m/s",
    "o": "m/s/s",
    "O": "degC",
    "P": "Pa",
    "q": "rpm",
    "s": "s",
    "z": "Hz",
}
MULTIPLIERS = {"-": 0.0, "?": 1.0, "0": 1.0, "B": 1e-2, "F": 1e-6}


@dataclass(frozen=True, slots=True)
class Dialect:
    """Which messages a vehicle's logs are made of."""

    formats: tuple[Format, ...] = FORMATS
    units: Mapping[str, str] = field(default_factory=lambda: UNITS)
    """By letter, as UNIT explains them."""
    multipliers: Mapping[str, float] = field(default_factory=lambda: MULTIPLIERS)
    padded: bool = True
    """Whether a log is filled to a whole block when it is closed."""


OWN = Dialect()


class Sink(Protocol):
    """Takes the bytes of one log, in order, whole messages at a time."""

    def write(self, data: bytes) -> None: ...

    def close(self) -> None: ...


class FileSink:
    """A new file. Raises FileExistsError rather than overwrite one."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self._stream = path.open("xb")

    def write(self, data: bytes) -> None:
        self._stream.write(data)

    def close(self) -> None:
        self._stream.close()


def filler(size: int) -> tuple[int, int]:
    """How many messages of 4 and of 5 bytes fill a log of `size` bytes up to a whole number of blocks."""
    gap = -size % BLOCK_BYTES
    # 1, 2, 3, 6, 7 and 11 bytes are no sum of fours and fives: then a block more.
    while True:
        fives = gap % 4
        if gap >= 5 * fives:
            return (gap - 5 * fives) // 4, fives
        gap += BLOCK_BYTES


class DataFlashLog:
    """One log being written. `write` only packs; `flush` hands the bytes to the sinks."""

    def __init__(self, sinks: Sequence[Sink], time_us: int, dialect: Dialect = OWN) -> None:
        self._sinks = list(sinks)
        self._buffer = bytearray()
        self._size = 0
        self._dialect = dialect
        self._pack = {f.name: (f.struct.pack, f.number) for f in dialect.formats}
        self.trouble: str | None = None
        """Why a sink was given up, until somebody reads and clears it."""
        self._begin(time_us)

    def _begin(self, time_us: int) -> None:
        """All formats, then what their units are."""
        dialect = self._dialect
        for f in dialect.formats:
            self.write("FMT", f.number, f.length, f.name.encode(), f.layout.encode(), f.columns.encode())
        for letter, label in dialect.units.items():
            self.write("UNIT", time_us, ord(letter), label.encode())
        for letter, factor in dialect.multipliers.items():
            self.write("MULT", time_us, ord(letter), factor)
        for f in dialect.formats:
            self.write("FMTU", time_us, f.number, f.units.encode(), f.multipliers.encode())

    def attach(self, sink: Sink, time_us: int, write_first: Callable[[], None]) -> None:
        """This sink takes all that comes; the formats, and what `write_first` writes, go to it alone."""
        self.flush()
        others, self._sinks = self._sinks, [sink]
        self._begin(time_us)
        write_first()
        self.flush()
        self._sinks = [*others, *self._sinks]

    def write(self, name: str, *values: int | float | bytes) -> None:
        """One message, values in the order of its columns. Text is cut to its field.

        A message that the dialect does not have is left out.
        """
        known = self._pack.get(name)
        if known is not None:
            self._buffer += known[0](*_HEAD, known[1], *values)

    def flush(self) -> None:
        """Hand over what was written since the last time."""
        if not self._buffer:
            return
        data = bytes(self._buffer)
        self._buffer.clear()
        self._size += len(data)
        for sink in list(self._sinks):
            try:
                sink.write(data)
            except OSError as error:  # a full disk must not take the vehicle out of the air
                self._give_up(sink, error)

    def detach(self, sink: Sink) -> None:
        """This sink gets no more; the others go on."""
        if sink in self._sinks:
            self._sinks.remove(sink)
            sink.close()

    def close(self) -> None:
        """Fill up to a whole block, where the dialect does, and end all sinks."""
        fours, fives = filler(self._size + len(self._buffer)) if self._dialect.padded else (0, 0)
        for _ in range(fours):
            self.write("PAD4", 0)
        for _ in range(fives):
            self.write("PAD5", 0)
        self.flush()
        for sink in list(self._sinks):
            try:
                sink.close()
            except OSError as error:
                self._give_up(sink, error)
        self._sinks.clear()

    def _give_up(self, sink: Sink, error: OSError) -> None:
        self.trouble = error.strerror or type(error).__name__
        self._sinks.remove(sink)
        with contextlib.suppress(OSError):
            sink.close()


def next_log_path(directory: Path) -> Path:
    """The first `vehicle-N.BIN` after the highest that is there."""
    taken = [0]
    for path in directory.glob("vehicle-*.BIN"):
        number = path.stem.removeprefix("vehicle-")
        if number.isascii() and number.isdigit():
            taken.append(int(number))
    return directory / f"vehicle-{max(taken) + 1}.BIN"
