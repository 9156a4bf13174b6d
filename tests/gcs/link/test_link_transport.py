"""Links by their words: what is understood, what is refused and how; one peer only."""

from __future__ import annotations

import os
import socket
import sys
import threading
from collections.abc import Callable
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from gcs.errors import LinkError, UsageError
from gcs.link.signing import Signing
from gcs.link.transport import LinkWord, UdpTransport, open_transport, parse_link

BEAT = mavlink.MAVLink_heartbeat_message(4, 3, 0, 0, 4, 3)
STATION = mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3)


def frame(message: Any, system: int = 1) -> bytes:
    return bytes(message.pack(mavlink.MAVLink(None, srcSystem=system, srcComponent=1)))


@pytest.mark.parametrize(
    ("word", "link"),
    [
        ("udpin:127.0.0.1:14550", LinkWord("udpin", "127.0.0.1", 14550)),
        ("udpout:drone.local:14550", LinkWord("udpout", "drone.local", 14550)),
        ("tcp:[::1]:5760", LinkWord("tcp", "::1", 5760)),
        ("/dev/ttyUSB0,921600", LinkWord("serial", "/dev/ttyUSB0", 921600)),
        ("COM5,57600", LinkWord("serial", "COM5", 57600)),
    ],
)
def test_link_words(word: str, link: LinkWord) -> None:
    assert parse_link(word) == link


@pytest.mark.parametrize(
    ("word", "said"),
    [
        ("", "is no link"),
        ("14550", "udpin:HOST:PORT"),
        ("udp:127.0.0.1:14550", "is no link"),
        ("udpin:127.0.0.1", "is no link"),
        ("tcp:127.0.0.1:99999", "no port"),
        ("tcp:127.0.0.1:0", "no port"),
        ("/dev/ttyUSB0", "baud rate"),
        ("COM5", "baud rate"),
        ("/dev/ttyUSB0,7", "no baud rate"),
        ("udpin:127.0.0.1:port", "is no link"),
        ("\x1b[31m", "is no link"),
    ],
)
def test_nonsense_is_refused_with_what_to_write(word: str, said: str) -> None:
    with pytest.raises(LinkError, match=said) as caught:
        parse_link(word)
    assert "\x1b" not in str(caught.value)
    assert isinstance(caught.value, UsageError)  # exit status 2


def test_a_port_in_use_is_named() -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as taken:
        taken.bind(("127.0.0.1", 0))
        with pytest.raises(LinkError, match="another ground station"):
            open_transport(f"udpin:127.0.0.1:{taken.getsockname()[1]}")


def test_refused_tcp_and_absent_devices_and_hosts_are_named() -> None:
    with socket.socket() as closed:
        closed.bind(("127.0.0.1", 0))
        port = closed.getsockname()[1]
    with pytest.raises(LinkError, match="nobody answers there"):
        open_transport(f"tcp:127.0.0.1:{port}")
    with pytest.raises(LinkError, match="no such device"):
        open_transport("/dev/ttyNOBODY9,57600")
    with pytest.raises(LinkError, match="no host is called"):
        open_transport("udpout:no.such.host.invalid:14550")


class Moved:
    """A vehicle whose radio comes back from another port, and a stranger; time is the test's."""

    def __init__(self, signing: Signing | None = None, system: int | None = None) -> None:
        self.now = 0.0
        link = parse_link("udpin:127.0.0.1:0")
        self.transport = UdpTransport("udpin:127.0.0.1:0", link, signing, system, clock=lambda: self.now)
        self.ground = ("127.0.0.1", int(self.transport.name.rsplit(":", 1)[1]))
        self.sockets = [socket.socket(socket.AF_INET, socket.SOCK_DGRAM) for _ in range(3)]
        for one in self.sockets:
            one.settimeout(30.0)

    def says(self, who: int, data: bytes) -> list[Any]:
        self.sockets[who].sendto(data, self.ground)
        return self.transport.receive(5.0)

    def address(self, who: int) -> str:
        return f"127.0.0.1:{self.sockets[who].getsockname()[1]}"

    def __enter__(self) -> Moved:
        return self

    def __exit__(self, *_: object) -> None:
        self.transport.close()
        for one in self.sockets:
            one.close()


def test_another_address_in_the_vehicles_name_is_shown_after_a_silence_and_taken_on_a_word() -> None:
    with Moved() as link:
        assert len(link.says(0, frame(BEAT))) == 1
        link.now = 4.9
        assert link.says(1, frame(BEAT)) == []
        assert link.transport.newcomer is None, "the vehicle spoke 4.9 s ago"
        link.now = 5.1
        assert link.says(2, frame(BEAT, 9)) == []
        assert link.transport.newcomer is None, "another system is another vehicle"
        assert link.says(2, frame(STATION)) == []
        assert link.says(1, frame(BEAT)) == []
        assert link.transport.newcomer == link.address(1)
        link.transport.send(b"to whom it belongs")
        assert link.sockets[0].recv(100) == b"to whom it belongs", "nobody was asked yet"
        assert link.transport.take_over()
        assert link.transport.newcomer is None
        link.transport.send(b"to whom it belongs")
        assert link.sockets[1].recv(100) == b"to whom it belongs"
        frames = link.transport.counts[0]
        assert len(link.says(1, frame(BEAT))) == 1
        assert link.transport.counts[0] == frames + 1, "what was heard before is not forgotten"
        assert link.says(0, frame(BEAT)) == [], "who was there is a stranger now"
        assert not link.transport.take_over()


def test_a_vehicle_that_speaks_again_and_a_newcomer_that_left_are_no_question_any_more() -> None:
    with Moved() as link:
        link.says(0, frame(BEAT))
        link.now = 6.0
        link.says(1, frame(BEAT))
        assert link.transport.newcomer == link.address(1)
        link.says(0, frame(BEAT))
        assert link.transport.newcomer is None
        link.now = 12.0
        link.says(1, frame(BEAT))
        link.says(2, frame(BEAT))
        assert link.transport.newcomer == link.address(1), "who was shown stays the one that is taken"
        link.now = 15.5
        assert link.transport.newcomer is None
        assert not link.transport.take_over()


def test_of_two_vehicles_the_wanted_one_is_taken() -> None:
    with Moved(system=9) as link:
        assert link.says(0, frame(BEAT)) == []
        assert len(link.says(1, frame(BEAT, 9))) == 1


def test_the_first_autopilot_is_the_peer_and_others_are_counted() -> None:
    transport = open_transport("udpin:127.0.0.1:0")
    ground = ("127.0.0.1", int(transport.name.rsplit(":", 1)[1]))
    assert transport.receive_buffer is not None
    assert transport.receive_buffer > 0
    sockets = [socket.socket(socket.AF_INET, socket.SOCK_DGRAM) for _ in range(3)]
    noise, vehicle, late = sockets
    try:
        for one in sockets:
            one.settimeout(60.0)
        noise.sendto(b"hello?", ground)
        noise.sendto(frame(STATION, 255), ground)
        assert transport.receive(1.0) + transport.receive(0.05) == []
        transport.send(b"nobody to send to yet")
        vehicle.sendto(frame(mavlink.MAVLink_attitude_message(0, 0, 0, 0, 0, 0, 0)), ground)
        assert transport.receive(1.0) == []
        vehicle.sendto(frame(BEAT), ground)
        assert len(transport.receive(1.0)) == 1
        late.sendto(frame(BEAT, 9), ground)
        noise.sendto(frame(BEAT, 1), ground)
        assert transport.receive(1.0) + transport.receive(0.05) == []
        assert transport.strangers == 4
        transport.send(b"for the vehicle")
        assert vehicle.recv(100) == b"for the vehicle"
        late.setblocking(False)
        with pytest.raises(BlockingIOError):
            late.recv(100)
    finally:
        transport.close()
        for one in sockets:
            one.close()


def test_udpout_hears_only_the_address_it_was_given(until: Callable[..., Any]) -> None:
    with (
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as vehicle,
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other,
    ):
        vehicle.bind(("127.0.0.1", 0))
        vehicle.settimeout(60.0)
        transport = open_transport(f"udpout:127.0.0.1:{vehicle.getsockname()[1]}")
        try:
            transport.send(b"here we are")
            _, ground = vehicle.recvfrom(100)
            other.sendto(frame(BEAT), ground)
            vehicle.sendto(frame(BEAT, 3), ground)
            frames = until(lambda: transport.receive(0.1))
            assert [f.message.get_srcSystem() for f in frames] == [3]
            until(lambda: transport.receive(0.01) == [] and transport.strangers == 1)
        finally:
            transport.close()


def test_tcp_reads_writes_and_comes_back(until: Callable[..., Any], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("gcs.link.transport.REOPEN_EVERY_S", 0.05)
    with socket.create_server(("127.0.0.1", 0)) as server:
        server.settimeout(60.0)
        transport = open_transport(f"tcp:127.0.0.1:{server.getsockname()[1]}")
        try:
            first, _ = server.accept()
            data = frame(BEAT)
            first.sendall(data[:7])
            assert transport.receive(0.1) == []
            first.sendall(data[7:])
            assert len(transport.receive(1.0)) == 1
            transport.send(b"hello")
            assert first.recv(5) == b"hello"
            first.close()
            until(lambda: transport.receive(0.01) == [] and transport.problem is not None)
            assert "trying again" in str(transport.problem)
            transport.send(b"into the void")
            until(lambda: transport.receive(0.01) == [] and transport.problem is None)
            second, _ = server.accept()
            second.sendall(data)
            assert until(lambda: transport.receive(0.1))
            second.close()
        finally:
            transport.close()


def test_a_peer_that_does_not_read_never_blocks_sending() -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:
        transport = open_transport(f"tcp:127.0.0.1:{server.getsockname()[1]}")
        stalled, _ = server.accept()
        try:
            sent = threading.Event()

            def send() -> None:
                for _ in range(3000):
                    transport.send(bytes(4096))
                sent.set()

            threading.Thread(target=send, daemon=True).start()
            assert sent.wait(60.0)
        finally:
            transport.close()
            stalled.close()


@pytest.mark.skipif(sys.platform == "win32", reason="pseudo terminals are a Unix thing")
def test_serial_over_a_pseudo_terminal(until: Callable[..., Any]) -> None:
    import tty

    ours, theirs = os.openpty()
    tty.setraw(theirs)
    transport = open_transport(f"{os.ttyname(theirs)},57600")
    try:
        os.write(ours, b"\x00noise" + frame(BEAT))
        assert len(until(lambda: transport.receive(0.1))) == 1
        transport.send(b"to the radio")
        assert os.read(ours, 100) == b"to the radio"
        with pytest.raises(LinkError, match="another program has it"):
            open_transport(f"{os.ttyname(theirs)},57600")
    finally:
        transport.close()
        os.close(ours)
        os.close(theirs)
