"""A radio without air: a link in memory on which tests speak real MAVLink to the vehicle's server, in fake time."""

from __future__ import annotations

import struct
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from pymavlink import DFReader
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sitl.autopilot.vehicle import Vehicle, make_vehicle
from sitl.faults import Faults, FaultyLink
from sitl.protocol.server import Server

GROUND = ("127.0.0.1", 40000)

# The paper's LQR for Table 4's vehicle with observer poles near -50 and -51, in the order of a bank.
PAPER_BANK = (
    *(0.2294, -0.2473, -4.610, 3.002, 0.1228, 0.1806, 4.696, -0.364),
    *(90.011, 3.2911, -71.0888, 90.011, -7.8746, 0.86, 7.9931, 1.7626),
    *(0.4204, -0.2150, 0.3048, 0.5188),
    *(147.548, 713.378, 0.091, -1.338, 1.448, -0.282, 0.296, 0.524, -0.050),
)


def as_float32(value: float) -> float:
    return float(struct.unpack("<f", struct.pack("<f", value))[0])


class MemoryLink:
    """What the vehicle sends lands in a list; what a test puts in is received."""

    name = "memory"
    ground_link = "memory"

    def __init__(self, *known: tuple[str, int]) -> None:
        self.known = known
        self.to_vehicle: list[tuple[Any, bytes]] = []
        self.from_vehicle: list[tuple[Any, bytes]] = []
        self.from_beside: list[tuple[Any, bytes]] = []
        self.hung_up: list[Any] = []

    def receive(self) -> list[tuple[Any, bytes]]:
        taken, self.to_vehicle = self.to_vehicle, []
        return taken

    def gone(self) -> list[Any]:
        taken, self.hung_up = self.hung_up, []
        return taken

    def room(self, address: Any) -> bool:
        return True

    def send_beside(self, address: Any, data: bytes) -> None:
        self.from_beside.append((address, data))

    def send(self, address: Any, data: bytes) -> None:
        self.from_vehicle.append((address, data))

    def close(self) -> None:
        pass


class Radio:
    """A ground station in a test."""

    def __init__(
        self, vehicle: Vehicle, *, address: Any = GROUND, system: int = 255, faults: Faults | None = None
    ) -> None:
        self.vehicle = vehicle
        self.link = MemoryLink()
        faults = Faults() if faults is None else faults
        self.server = Server(vehicle, FaultyLink(self.link, faults, lambda: vehicle.time_s), faults.on_board)
        self.address = address
        self.mav = mavlink.MAVLink(None, system, 190)
        self.heard: list[Any] = []

    def send(self, *messages: Any, address: Any = None) -> None:
        for message in messages:
            data = bytes(message.pack(self.mav))
            self.mav.seq = (self.mav.seq + 1) % 256
            self.link.to_vehicle.append((address or self.address, data))

    def fly(self, seconds: float) -> None:
        for _ in range(round(seconds / self.vehicle.dt)):
            self.vehicle.step()
            self.server.poll()

    def take(self, kind: str | None = None, address: Any = None) -> list[Any]:
        """Messages that reached this address since the last time, of one kind or all."""
        decoder = mavlink.MAVLink(None)
        wanted, others = address or self.address, []
        for to, data in self.link.from_vehicle:
            if to == wanted:
                self.heard.append(decoder.decode(bytearray(data)))
            else:
                others.append((to, data))
        self.link.from_vehicle = others
        taken = [m for m in self.heard if kind is None or m.get_type() == kind]
        self.heard = [] if kind is None else [m for m in self.heard if m.get_type() != kind]
        return taken

    def ask(self, *messages: Any, kind: str | None = None) -> list[Any]:
        """Send, poll once, and take the answers."""
        self.take()
        self.heard.clear()
        self.send(*messages)
        self.server.poll()
        return self.take(kind)

    def command(self, number: int, *arguments: float) -> Any:
        """The acknowledgement of one command."""
        filled = (*arguments, *(0.0,) * (7 - len(arguments)))
        (ack,) = self.ask(mavlink.MAVLink_command_long_message(1, 1, number, 0, *filled), kind="COMMAND_ACK")
        assert (ack.command, ack.target_system, ack.target_component) == (number, 255, 190)
        return ack.result

    def set(self, name: str, value: float) -> float | None:
        """Write a parameter; the echoed value, or None where nothing came."""
        message = mavlink.MAVLink_param_set_message(1, 1, name.encode(), value, 9)
        echoes = self.ask(message, kind="PARAM_VALUE")
        if not echoes:
            return None
        (echo,) = echoes
        assert echo.param_id == name
        return float(echo.param_value)

    def get(self, name: str) -> float | None:
        message = mavlink.MAVLink_param_request_read_message(1, 1, name.encode(), -1)
        answers = self.ask(message, kind="PARAM_VALUE")
        return float(answers[0].param_value) if answers else None

    def heartbeat(self) -> Any:
        return mavlink.MAVLink_heartbeat_message(mavlink.MAV_TYPE_GCS, mavlink.MAV_AUTOPILOT_INVALID, 0, 0, 0, 3)


@pytest.fixture
def radio() -> Callable[..., Radio]:
    """Makes a radio for a vehicle."""
    return Radio


@pytest.fixture
def hovering() -> Vehicle:
    return make_vehicle("hover-ideal", 1)


@pytest.fixture
def paper_bank() -> tuple[float, ...]:
    """29 values that fly, each a float32."""
    return tuple(as_float32(value) for value in PAPER_BANK)


@pytest.fixture
def read_log() -> Callable[[Path], list[Any]]:
    """All messages of a log as pymavlink reads them."""

    def read(path: Path) -> list[Any]:
        log = DFReader.DFReader_binary(str(path))
        try:
            messages = []
            while (message := log.recv_msg()) is not None:
                messages.append(message)
            return messages
        finally:
            log.close()

    return read


@pytest.fixture
def fly() -> Callable[[Vehicle, float], list[str]]:
    """Advance a vehicle by seconds; what it said meanwhile."""

    def advance(vehicle: Vehicle, seconds: float) -> list[str]:
        for _ in range(round(seconds / vehicle.dt)):
            vehicle.step()
        said = [text for _, text in vehicle.texts]
        vehicle.texts.clear()
        return said

    return advance


@pytest.fixture
def memory_link() -> Callable[..., MemoryLink]:
    """Makes a link in memory that speaks to these from the start."""
    return MemoryLink
