"""The engine on real sockets and in threads of its own: what fake time cannot show."""

from __future__ import annotations

import contextlib
import socket
import threading
from collections.abc import Callable, Iterator
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from gcs.errors import LinkError
from gcs.flight.session import Session
from gcs.link.frames import Frame
from gcs.link.procedures import ReadParameter
from gcs.link.transport import open_transport

pytestmark = pytest.mark.realtime


class HeldWire:
    """A link on which one heartbeat of a vehicle waits, and which keeps what is sent."""

    name = "udpout:127.0.0.1:14550"
    strangers, counts = 0, (1, 0)
    receive_buffer: int | None = None
    problem: str | None = None
    newcomer: str | None = None

    def take_over(self) -> bool:
        return False

    def __init__(self) -> None:
        mav = mavlink.MAVLink(None, srcSystem=1, srcComponent=1)
        raw = mavlink.MAVLink_heartbeat_message(4, 3, 1, 0, 4, 3).pack(mav)
        self._frames = [Frame(raw, mav.decode(bytearray(raw)))]
        self.sent: list[Any] = []
        self._open = True

    def receive(self, timeout_s: float) -> list[Frame]:
        threading.Event().wait(timeout_s)
        frames, self._frames = self._frames, []
        return frames

    def send(self, data: bytes) -> None:
        assert self._open
        self.sent.append(mavlink.MAVLink(None).decode(bytearray(data)))

    def close(self) -> None:
        self._open = False


def test_heartbeats_come_from_a_thread_of_their_own(until: Callable[..., Any]) -> None:
    wire = HeldWire()

    def beats() -> int:
        return sum(m.get_type() == "HEARTBEAT" for m in list(wire.sent))

    with Session(wire) as session, session._lock:
        # The engine is held up, as by a slow disk.
        held = beats()
        until(lambda: beats() >= held + 2)


def test_closing_ends_both_threads() -> None:
    before = set(threading.enumerate())
    with Session(HeldWire()) as session:
        asked = set(threading.enumerate()) - before
        session.wait_for_vehicle(5.0)
        assert {thread.name for thread in asked} == {"tippath engine", "tippath heartbeat"}
    assert not any(thread.is_alive() for thread in asked)


def test_an_engine_that_breaks_says_so_and_ends_calls(monkeypatch: pytest.MonkeyPatch) -> None:
    with Session(HeldWire()) as session:
        session.wait_for_vehicle(5.0)
        monkeypatch.setattr(session, "_poll", lambda now: 1 / 0)
        with pytest.raises(Exception, match="the link is closed"):
            session.call(ReadParameter("A"), 5.0)
        assert "the engine stopped" in str(session.snapshot().link_problem)


@contextlib.contextmanager
def listening() -> Iterator[tuple[Session, tuple[str, int]]]:
    transport = open_transport("udpin:127.0.0.1:0")
    session = Session(transport)
    try:
        yield session, ("127.0.0.1", int(transport.name.rsplit(":", 1)[1]))
    finally:
        session.close()


def test_nothing_and_a_station_alone_are_no_vehicle(until: Callable[..., Any]) -> None:
    with pytest.raises(LinkError, match=r"no vehicle at udpin:127\.0\.0\.1:\d+: nothing heard"):
        Session.open("udpin:127.0.0.1:0", connect_timeout_s=0.1)
    with listening() as (session, ground), socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as station:
        mav = mavlink.MAVLink(None, srcSystem=255, srcComponent=190)
        station.sendto(mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3).pack(mav), ground)
        until(lambda: session._transport.strangers)
        with pytest.raises(LinkError, match="no autopilot's heartbeat among them"):
            session.wait_for_vehicle(0.05)


def test_a_vehicle_on_udpin_is_pinned(until: Callable[..., Any]) -> None:
    def beat(system: int) -> bytes:
        mav = mavlink.MAVLink(None, srcSystem=system, srcComponent=1)
        return bytes(mavlink.MAVLink_heartbeat_message(4, 3, 1, 0, 4, 3).pack(mav))

    with (
        listening() as (session, ground),
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as first,
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as second,
    ):
        first.sendto(beat(1), ground)
        until(lambda: session._snapshot is not None and session.snapshot().heartbeats == 1)
        for _ in range(4):
            second.sendto(beat(2), ground)
        until(lambda: session.snapshot().strangers == 4)
        first.sendto(beat(1), ground)
        until(lambda: session.snapshot().heartbeats == 2)
        assert (session.snapshot().system, session.snapshot().other_vehicles) == (1, 0)
        until(lambda: first.recv(4096))
        second.setblocking(False)
        with pytest.raises(BlockingIOError):
            second.recv(4096)
