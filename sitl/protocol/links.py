"""Bytes in and out: UDP both ways round, TCP, and a serial line (a pseudo terminal).

Everything is non-blocking and asked once a sample, in the vehicle's own thread. A thread of its own would buy
nothing, since Python runs one at a time, and cost locks and repeatability; an empty poll is two microseconds.

Words are pymavlink's, read from the vehicle's side: `udpout` sends to the ground's address from the start,
`udpin` waits for the ground's first packet, `tcpin` accepts connections; `pty` is this vehicle's own.
"""

from __future__ import annotations

import contextlib
import os
import socket
from typing import Protocol

_PACKET = 2048
_PACKETS_A_TURN = 64
_SOCKET_BUFFER = 1 << 20
_OUT_LIMIT = 1 << 20  # bytes that a stalled reader may leave unsent before messages are dropped
_OUT_ROOM = 1 << 16  # above this, blocks wait where they are
_SERIAL_ROOM = 1 << 12


Address = tuple[str, int] | int | str
"""Of a peer: host and port on UDP, a number on TCP, a name on a serial line."""


class LinkError(Exception):
    """The link's word makes no sense, or its address cannot be had; the message says what to do."""


class Link(Protocol):
    """One way to the ground. An address stands for one peer on it."""

    name: str
    """As pymavlink would be told, with the port really used."""
    ground_link: str
    """What the ground station has to be told."""
    known: tuple[Address, ...]
    """Peers that are spoken to before they were heard."""

    def receive(self) -> list[tuple[Address, bytes]]:
        """What came since the last time. Empty bytes announce a peer that has connected and said nothing yet."""

    def gone(self) -> list[Address]:
        """Peers that have hung up since the last time."""

    def room(self, address: Address) -> bool:
        """Whether bulk data for this peer would go out soon."""

    def send(self, address: Address, data: bytes) -> None:
        """One whole message; it is lost where the peer cannot take it."""

    def send_beside(self, address: Address, data: bytes) -> None:
        """The same from another address than this link's, for faults; nothing where nobody else reaches a peer."""

    def close(self) -> None: ...


class UdpLink:
    """Datagrams."""

    def __init__(self, name: str, ground_link: str, sock: socket.socket, known: tuple[Address, ...] = ()) -> None:
        self.name = name
        self.ground_link = ground_link
        self.known = known
        self._socket = sock
        self._beside: socket.socket | None = None
        sock.setblocking(False)
        for option in (socket.SO_RCVBUF, socket.SO_SNDBUF):
            sock.setsockopt(socket.SOL_SOCKET, option, _SOCKET_BUFFER)

    def receive(self) -> list[tuple[Address, bytes]]:
        packets: list[tuple[Address, bytes]] = []
        for _ in range(_PACKETS_A_TURN):
            try:
                data, address = self._socket.recvfrom(_PACKET)
            except BlockingIOError:
                break
            except OSError:  # on some systems a peer that is not there shows up here
                continue
            packets.append((address, data))
        return packets

    def gone(self) -> list[Address]:
        return []

    def room(self, address: Address) -> bool:
        return True

    def send(self, address: Address, data: bytes) -> None:
        # Full buffer, nobody there, no route: on UDP all of it is a lost packet.
        with contextlib.suppress(OSError):
            if isinstance(address, tuple):
                self._socket.sendto(data, address)

    def send_beside(self, address: Address, data: bytes) -> None:
        with contextlib.suppress(OSError):
            if self._beside is None:
                self._beside = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
            if isinstance(address, tuple):
                self._beside.sendto(data, address)

    def close(self) -> None:
        self._socket.close()
        if self._beside is not None:
            self._beside.close()


class TcpLink:
    """Connections, several at a time."""

    known: tuple[Address, ...] = ()

    def __init__(self, name: str, ground_link: str, sock: socket.socket) -> None:
        self.name = name
        self.ground_link = ground_link
        self._socket = sock
        sock.setblocking(False)
        self._peers: dict[int, socket.socket] = {}
        self._out: dict[int, bytearray] = {}
        self._count = 0
        self._gone: list[Address] = []

    def receive(self) -> list[tuple[Address, bytes]]:
        packets: list[tuple[Address, bytes]] = []
        with contextlib.suppress(OSError):
            peer, _ = self._socket.accept()
            peer.setblocking(False)
            peer.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            self._count += 1
            self._peers[self._count] = peer
            self._out[self._count] = bytearray()
            packets.append((self._count, b""))
        for number, peer in list(self._peers.items()):
            try:
                data = peer.recv(1 << 16)
            except BlockingIOError:
                self._push(number)
                continue
            except OSError:
                data = b""
            if data:
                packets.append((number, data))
                self._push(number)
            else:
                self._drop(number)
        return packets

    def gone(self) -> list[Address]:
        gone, self._gone = self._gone, []
        return gone

    def room(self, address: Address) -> bool:
        return not isinstance(address, int) or len(self._out.get(address, b"")) < _OUT_ROOM

    def send(self, address: Address, data: bytes) -> None:
        if not isinstance(address, int) or address not in self._peers:
            return
        if len(self._out[address]) + len(data) <= _OUT_LIMIT:
            self._out[address] += data
            self._push(address)

    def send_beside(self, address: Address, data: bytes) -> None:
        """Nobody else is on this line."""

    def close(self) -> None:
        for number in list(self._peers):
            self._drop(number)
        self._socket.close()

    def _push(self, number: int) -> None:
        out = self._out[number]
        if not out:
            return
        try:
            sent = self._peers[number].send(out)
        except BlockingIOError:
            return
        except OSError:
            self._drop(number)
            return
        del out[:sent]

    def _drop(self, number: int) -> None:
        peer = self._peers.pop(number, None)
        if peer is not None:
            peer.close()
            del self._out[number]
            self._gone.append(number)


class PtyLink:
    """A serial line: the ground opens the other end like a telemetry radio. Not on Windows."""

    def __init__(self) -> None:
        try:
            # not there on Windows
            import pty
            import tty
        except ImportError as error:
            raise LinkError("this system has no pseudo terminals; use udpout, udpin or tcpin") from error
        self._near, self._far = pty.openpty()
        tty.setraw(self._far)
        os.set_blocking(self._near, False)
        self.name = f"pty:{os.ttyname(self._far)}"
        self.ground_link = f"{os.ttyname(self._far)},921600"
        self.known: tuple[Address, ...] = ("serial",)
        self._out = bytearray()

    def receive(self) -> list[tuple[Address, bytes]]:
        self._push()
        try:
            data = os.read(self._near, 1 << 16)
        except OSError:
            return []
        return [("serial", data)] if data else []

    def gone(self) -> list[Address]:
        return []

    def room(self, address: Address) -> bool:
        return len(self._out) < _SERIAL_ROOM

    def send(self, address: Address, data: bytes) -> None:
        # With nobody at the far end the line fills and stays full: what comes then is lost, whole messages at a time.
        if len(self._out) + len(data) <= 4 * _SERIAL_ROOM:
            self._out += data
            self._push()

    def send_beside(self, address: Address, data: bytes) -> None:
        """Nobody else is on this line."""

    def close(self) -> None:
        os.close(self._near)
        os.close(self._far)

    def _push(self) -> None:
        if self._out:
            with contextlib.suppress(OSError):
                del self._out[: os.write(self._near, self._out)]


def open_link(word: str) -> Link:
    """`udpout:HOST:PORT`, `udpin:HOST:PORT`, `tcpin:HOST:PORT` or `pty`; port 0 takes a free one.

    Raises LinkError.
    """
    if word == "pty":
        return PtyLink()
    kind, _, place = word.partition(":")
    host, _, port_text = place.rpartition(":")
    if kind not in ("udpout", "udpin", "tcpin") or not host or not port_text.isascii() or not port_text.isdigit():
        raise LinkError(f"{word!r} is no link: use udpout:HOST:PORT, udpin:HOST:PORT, tcpin:HOST:PORT or pty")
    port = int(port_text)
    if port > 65535:
        raise LinkError(f"{word!r}: a port is at most 65535")
    try:
        return _open_socket(kind, host, port)
    except OSError as error:
        raise LinkError(f"{word}: {error.strerror or error}; take another port, or 0 for a free one") from error


def _open_socket(kind: str, host: str, port: int) -> Link:
    reached = "127.0.0.1" if host in ("0.0.0.0", "") else host
    if kind == "udpout":
        if port == 0:
            with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
                probe.bind((host, 0))
                port = probe.getsockname()[1]
        address = (socket.gethostbyname(host), port)
        sock = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        return UdpLink(f"udpout:{host}:{port}", f"udpin:{host}:{port}", sock, (address,))
    sock = socket.socket(socket.AF_INET, socket.SOCK_DGRAM if kind == "udpin" else socket.SOCK_STREAM)
    try:
        if kind == "tcpin" and os.name == "posix":
            sock.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        sock.bind((host, port))
        port = sock.getsockname()[1]
        if kind == "udpin":
            return UdpLink(f"udpin:{host}:{port}", f"udpout:{reached}:{port}", sock)
        sock.listen(4)
    except OSError:
        sock.close()
        raise
    return TcpLink(f"tcpin:{host}:{port}", f"tcp:{reached}:{port}", sock)
