"""A DataFlash writer of the tests' own, so that what the reader reads does not come from the code beside it."""

from __future__ import annotations

import math
import struct
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

PACK = {"B": "B", "b": "b", "M": "B", "h": "h", "H": "H", "i": "i", "I": "I", "q": "q", "Q": "Q", "f": "f", "d": "d"}
PACK |= {"c": "h", "C": "H", "e": "i", "E": "I", "L": "i", "n": "4s", "N": "16s", "Z": "64s", "a": "64s", "g": "e"}

VEHICLE = {
    "PARM": (32, "QNff", "TimeUS,Name,Value,Default"),
    "MSG": (59, "QZ", "TimeUS,Message"),
    "MODE": (120, "QMBB", "TimeUS,Mode,ModeNum,Rsn"),
    "SIDS": (10, "QBfffffff", "TimeUS,Ax,Mag,FSt,FSp,TFin,TC,TR,TFout"),
    "SIDY": (11, "QBBfff", "TimeUS,Kind,Law,C1,Noise,Pulse"),
    "SIDD": (9, "Qfffffffff", "TimeUS,Time,Targ,F,Gx,Gy,Gz,Ax,Ay,Az"),
    "RATE": (75, "Qfffffffffffff", "TimeUS,RDes,R,ROut,PDes,P,POut,YDes,Y,YOut,ADes,A,AOut,AOutSlew"),
    "TPEX": (12, "Qfffff", "TimeUS,EX,EY,EE,Elev,Coll"),
    "RPM": (113, "QBffB", "TimeUS,I,RPM,Qual,H"),
}


class Writer:
    """Collects messages; `data` is the file."""

    def __init__(self, formats: dict[str, tuple[int, str, str]]) -> None:
        self.formats = formats
        self.pieces: list[bytes] = []
        self.structs = {}
        for name, (id, types, columns) in {"FMT": (128, "BBnNZ", "Type,Length,Name,Format,Columns"), **formats}.items():
            self.structs[name] = (id, struct.Struct("<" + "".join(PACK[t] for t in types)))
            length = 3 + self.structs[name][1].size
            self.add("FMT", id, length, name.encode(), types.encode(), columns.encode())

    def add(self, name: str, *values: Any) -> None:
        id, packer = self.structs[name]
        self.pieces.append(b"\xa3\x95" + bytes([id]) + packer.pack(*values))

    @property
    def data(self) -> bytes:
        return b"".join(self.pieces)


def fly(
    entries: list[dict[str, Any]],
    *,
    own_messages: bool = True,
    quiet_s: float = 2.0,
    rate_hz: int = 500,
    leave: bool = True,
) -> bytes:
    """A flight with one entry into SYSTEMID for each of `entries`, quiet STABILIZE before, between and after.

    An entry has axis (10), kind (0), duration (6 s), stop_after (s into the maneuver, with a text), with_sids (True).
    """
    log = Writer(VEHICLE if own_messages else {k: v for k, v in VEHICLE.items() if k not in ("SIDY", "TPEX")})
    step = round(1e6 / rate_hz)
    clock = 10_000_000

    def sample(us: int, target: float, axis: int, sidd: float | None, hertz: float = 0.0) -> None:
        x, y = (target, 0.0) if axis in (10, 7) else (0.0, target)
        t = us * 1e-6
        p, q = 20 * x + 0.3 * math.sin(1.3 * t), 15 * y + 0.2 * math.sin(1.7 * t)
        log.add("RATE", us, 0, p + 1, x + 0.001 * math.sin(t), 0, q + 1, y, 0, 0, 0.1, 0, 0, 0.4, 0)
        if sidd is not None:
            log.add("SIDD", us, sidd, target, hertz, p, q, 0.0, 0.0, 0.0, -9.8)
        if own_messages:
            log.add("TPEX", us, x, y, 0.0, 0.05, 0.4)
        if us % 25_000 < step:
            log.add("RPM", us, 0, 1600.0 + t, 0.9, 1)

    def quiet(seconds: float) -> None:
        nonlocal clock
        for _ in range(round(seconds * rate_hz)):
            sample(clock, 0.0, 10, None)
            clock += step

    log.add("MODE", clock, 0, 0, 1)
    quiet(quiet_s)
    for entry in entries:
        axis, kind, duration = entry.get("axis", 10), entry.get("kind", 0), entry.get("duration", 6.0)
        entered = clock
        log.add("MODE", clock, 25, 25, 2)
        if entry.get("with_sids", True):
            log.add("SIDS", clock, axis, 0.1, 0.5, 10.0, 0.0, 4.0, duration, 0.0)
            if own_messages:
                log.add("SIDY", clock, kind, 1, 4.0, 0.2, 0.3)
        stop_after = entry.get("stop_after", duration)
        for i in range(round((1 + stop_after + 1.5) * rate_hz)):
            clock += step
            since = (i + 1) / rate_hz
            t = since - 1
            flying = 0 <= t < stop_after and kind != 2
            if kind == 1:
                target = (0.1, -0.1, 0, 0, 0, 0)[int(t / 0.3) % 6] if flying else 0.0
            else:
                target = 0.1 * math.sin(2 * math.pi * (0.5 * t + 0.4 * t * t)) if flying else 0.0
            if stop_after < duration and abs(t - stop_after) < 0.5 / rate_hz:
                log.add("MSG", clock, b"SystemID Stopped: lean=31.000000 max=30.000000")
            sample(clock, target, axis, since, 0.5 + 0.8 * t if flying and kind == 0 else 0.0)
        if leave:
            clock += step
            log.add("MODE", clock, 0, 0, 1)
        quiet(quiet_s)
        assert clock > entered
    return log.data


@pytest.fixture(scope="session")
def writer() -> Callable[[dict[str, tuple[int, str, str]]], Writer]:
    return Writer


@pytest.fixture(scope="session")
def flown() -> Callable[..., bytes]:
    return fly


@pytest.fixture(scope="session")
def two_chirps() -> bytes:
    """Roll then pitch, 6 s each, from the simulated vehicle's messages."""
    return fly([{"axis": 10}, {"axis": 11}])


@pytest.fixture
def saved(tmp_path: Path) -> Callable[[bytes, str], Path]:
    def save(data: bytes, name: str = "flight.BIN") -> Path:
        path = tmp_path / name
        path.write_bytes(data)
        return path

    return save
