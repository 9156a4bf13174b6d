"""Fetching in fake time: the vehicle's file servers at one end, a conversation at the other, bad air between them.

The servers are the simulated vehicle's own, around a vehicle of a few lines; every message crosses as bytes.
"""

from __future__ import annotations

import heapq
import random
import struct
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from gcs.link.decode import decode
from gcs.link.encode import Encoder, Send
from gcs.link.events import Event, StatusText
from gcs.link.procedures import Failed, NoAnswerError, Procedure
from gcs.vehicle.snapshot import VehicleSnapshot
from sitl.autopilot.storage import WAYS, LogStorage
from sitl.protocol.ftp import FtpServer
from sitl.protocol.links import Address
from sitl.protocol.log_download import LogDownload

TURN_S = 0.01


@dataclass
class StillVehicle:
    """What the file servers need of a vehicle."""

    storage: LogStorage
    armed: bool = False
    time_s: float = 0.0
    said: list[str] = field(default_factory=list)

    def say(self, severity: int, text: str) -> None:
        self.said.append(text)


@dataclass(kw_only=True)
class Air:
    """What happens on the way, both ways alike."""

    loss: float = 0.0
    doubled: float = 0.0
    late: float = 0.0
    """Share that comes up to 60 ms later, and so out of order."""
    lag_s: float = 0.002
    outage: tuple[float, float] = (0.0, 0.0)
    """From, to: nothing passes."""


class FileVehicle:
    """The vehicle's servers and the air. `hear` is what the ground hears now."""

    address: Address = "air"

    def __init__(self, directory: Path, air: Air | None = None, *, ways: tuple[str, ...] = WAYS, seed: int = 1) -> None:
        self.air = Air() if air is None else air
        self.vehicle: Any = StillVehicle(LogStorage(directory, ways, 600_000.0))
        self.capabilities = 32 if "ftp" in ways else 0
        self.now = 100.0
        self.sent_of_logs = 0
        self._random = random.Random(seed)
        self._encoder = Encoder(254)
        self._encoder.target = (1, 1)
        self._mav = mavlink.MAVLink(None, 1, 1)
        self._up: list[tuple[float, int, bytes]] = []
        self._down: list[tuple[float, int, bytes]] = []
        self._count = 0
        self.restart()

    def restart(self) -> None:
        """A vehicle that forgets what it was doing."""
        self._logs, self._files = LogDownload(self.vehicle), FtpServer(self.vehicle)

    def send(self, message: Any) -> None:
        """As the servers' peer: down to the ground."""
        self.sent_of_logs += message.get_msgId() in (118, 120)
        self._put(self._down, bytes(message.pack(self._mav)))

    def tell(self, sends: list[Send]) -> None:
        for send in sends:
            self._put(self._up, self._encoder.encode(send))

    def _put(self, way: list[tuple[float, int, bytes]], data: bytes) -> None:
        air, chance = self.air, self._random.random
        if chance() < air.loss or air.outage[0] <= self.now < air.outage[1]:
            return
        for _ in range(1 + (chance() < air.doubled)):
            late_s = chance() * 0.06 if chance() < air.late else 0.0
            self._count += 1
            heapq.heappush(way, (self.now + air.lag_s + late_s, self._count, data))

    def _due(self, way: list[tuple[float, int, bytes]]) -> list[Any]:
        parser, due = mavlink.MAVLink(None), []
        while way and way[0][0] <= self.now:
            due.append(parser.decode(bytearray(heapq.heappop(way)[2])))
        return due

    def turn(self) -> list[Event]:
        """Ten milliseconds go by; what the ground hears then."""
        self.now += TURN_S
        self.vehicle.time_s = self.now
        for message in self._due(self._up):
            (self._files if message.get_msgId() == 110 else self._logs).hear(self, message)
        self._logs.poll(self.now, True)
        self._files.poll(self.now, True)
        events = [event for message in self._due(self._down) if (event := decode(message)) is not None]
        said, self.vehicle.said = self.vehicle.said, []
        return [*(StatusText(1, 1, 3, text) for text in said), *events]


class FileSession:
    """As much of a session as fetching needs, in fake time."""

    def __init__(self, vehicle: FileVehicle) -> None:
        self.vehicle = vehicle
        self.meanwhile: Callable[[FileVehicle], None] = lambda vehicle: None

    def __enter__(self) -> FileSession:
        return self

    def __exit__(self, *_: object) -> None:
        pass

    def snapshot(self) -> VehicleSnapshot:
        snapshot = VehicleSnapshot(system=1, component=1)
        armed = self.vehicle.vehicle.armed
        return replace(snapshot, lost=False, armed=armed, capabilities=self.vehicle.capabilities)

    def now(self) -> float:
        return self.vehicle.now

    def wait(self, seconds: float) -> None:
        end = self.now() + seconds
        while self.now() < end:
            self.vehicle.turn()

    def send(self, *sends: Send) -> None:
        self.vehicle.tell(list(sends))

    def call(
        self,
        procedure: Procedure[Any],
        timeout_s: float | None = None,
        *,
        cancelled: Callable[[], bool] | None = None,
    ) -> Any:
        end = self.now() + (600.0 if timeout_s is None else timeout_s)
        self.send(*procedure.start(self.now()))
        while procedure.outcome is None:
            if self.now() >= end:
                raise NoAnswerError("not done")
            for event in self.vehicle.turn():
                self.send(*procedure.on_event(event, self.now()))
            self.send(*procedure.poll(self.now()))
            self.meanwhile(self.vehicle)
            if cancelled is not None:
                cancelled()
        if isinstance(procedure.outcome, Failed):
            raise procedure.outcome.error()
        return procedure.outcome.value


def noise(size: int, seed: int = 1) -> bytes:
    """Bytes that are nowhere alike."""
    return random.Random(seed).randbytes(size)


def dataflash(seconds: float, *, start_s: float = 1.0, seed: int = 1, rate_hz: int = 100) -> bytes:
    """A log of two formats and RATE with noise, its clock from `start_s`."""

    def fmt(kind: int, name: bytes, codes: bytes, labels: bytes, size: int) -> bytes:
        return b"\xa3\x95\x80" + struct.pack("<BB4s16s64s", kind, size, name, codes, labels)

    draw = random.Random(seed).random
    out = [fmt(128, b"FMT", b"BBnNZ", b"Type,Length,Name,Format,Columns", 89)]
    out.append(fmt(1, b"RATE", b"Qffff", b"TimeUS,R,ROut,P,POut", 27))
    for i in range(round(seconds * rate_hz)):
        t_us = round((start_s + i / rate_hz) * 1e6)
        out.append(b"\xa3\x95\x01" + struct.pack("<Q4f", t_us, *(draw() for _ in range(4))))
    return b"".join(out)
