"""Bytes to and from the vehicle: the only place that opens sockets and serial ports.

pymavlink's own connections answer every address they ever heard. Here a UDP link has one peer: the configured one, or
the first address that sends an autopilot's heartbeat. All others are counted and dropped. Sending never blocks:
a heartbeat must not wait behind a stalled stream.
"""

from __future__ import annotations

import contextlib
import math
import re
import select
import socket
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Protocol

import serial

from gcs.errors import LinkError, UsageError
from gcs.link.decode import decode
from gcs.link.events import Heartbeat
from gcs.link.frames import Frame, FrameFinder
from gcs.link.signing import Signing

RECEIVE_BUFFER = 4 * 1024 * 1024
"""The default UDP buffer holds 256 small packets, a quarter of a second of a fast log."""

MOST_CANDIDATES = 16
SILENT_S = 5.0
"""After so long without a frame of the vehicle's address another one that speaks as it does is noticed."""
NEWCOMER_S = 3.0
"""A newcomer that was not heard for so long has gone again."""
REOPEN_EVERY_S = 1.0
MOST_UNSENT = 256 * 1024

LINK_WORDS = "udpin:HOST:PORT, udpout:HOST:PORT, tcp:HOST:PORT, /dev/ttyUSB0,921600 or COM5,57600"


BITS_A_BYTE = 10
"""On a serial line: eight, a start and a stop."""
USB_PORTS = ("ttyACM", "usbmodem")


class LinkWordError(LinkError, UsageError):
    """A LINK that makes no sense, as against one on which nobody answers."""


@dataclass(frozen=True, slots=True)
class LinkWord:
    """A LINK as the user typed it, understood."""

    kind: str
    """`udpin`, `udpout`, `tcp` or `serial`."""
    host: str
    """Or the serial device."""
    port: int
    """Or the baud rate."""


def parse_link(word: str) -> LinkWord:
    """Understand a LINK. Raises LinkWordError, with the words there are, where it makes no sense."""
    network = re.fullmatch(r"(udpin|udpout|tcp):(\[[0-9A-Fa-f:.%\w]+\]|[^:\s\[\]]+):(\d{1,5})", word)
    if network:
        port = int(network[3])
        if port > 65535 or (port == 0 and network[1] != "udpin"):
            raise LinkWordError(f"{word}: {port} is no port; ports go from 1 to 65535")
        return LinkWord(network[1], network[2].strip("[]"), port)
    device = re.fullmatch(r"(/[^,\s]+|COM\d+),(\d+)", word)
    if device and 300 <= int(device[2]) <= 20_000_000:
        return LinkWord("serial", device[1], int(device[2]))
    if device:
        raise LinkWordError(f"{word}: {device[2]} is no baud rate; usual ones are 57600 and 921600")
    if re.fullmatch(r"/[^,\s]+|COM\d+", word):
        raise LinkWordError(f"{word}: say the baud rate as well, for example {word},57600")
    raise LinkWordError(f"{word!r} is no link; a link is {LINK_WORDS}")


def carries(link: str) -> float | None:
    """Bytes a second that a LINK carries at most, where its kind tells: a serial line, by its baud rate.

    A USB port takes no notice of the rate it is given. Raises LinkWordError.
    """
    word = parse_link(link)
    usb = any(part in word.host for part in USB_PORTS)
    return word.port / BITS_A_BYTE if word.kind == "serial" and not usb else None


class Transport(Protocol):
    """A link's bytes, as frames."""

    name: str
    strangers: int
    """Datagrams of addresses that are not the peer, dropped."""
    receive_buffer: int | None
    """What the system gave of `RECEIVE_BUFFER`, bytes; None where there is no such thing."""
    problem: str | None
    """What is wrong with the link at present, None while nothing is."""

    @property
    def counts(self) -> tuple[int, int]:
        """Valid frames, and bytes that were none."""
        ...

    @property
    def newcomer(self) -> str | None:
        """Another address that speaks as the vehicle does, while the vehicle's own is silent."""
        ...

    def receive(self, timeout_s: float) -> list[Frame]:
        """Frames that came; waits for at most `timeout_s`. Never raises for what a network or a cable does."""
        ...

    def send(self, data: bytes) -> None:
        """Send one frame at once, or drop it: never waits, never raises."""
        ...

    def take_over(self) -> bool:
        """Speak with the newcomer from now on, and no more with who was there; false where there is none."""
        ...

    def close(self) -> None: ...


def open_transport(word: str, signing: Signing | None = None, system: int | None = None) -> Transport:
    """Open a link by its word; with `signing` only what is signed comes in, and of many addresses only that of the
    vehicle `system` is taken. Raises LinkError saying what is wrong and what to do."""
    link = parse_link(word)
    match link.kind:
        case "serial":
            return SerialTransport(word, link, signing)
        case "tcp":
            return TcpTransport(word, link, signing)
        case _:
            return UdpTransport(word, link, signing, system)


def _resolve(word: str, link: LinkWord, kind: socket.SocketKind) -> tuple[socket.AddressFamily, Any]:
    try:
        found = socket.getaddrinfo(link.host, link.port, type=kind)
    except (OSError, UnicodeError) as error:
        raise LinkError(
            f"{word}: no host is called {link.host} ({error}); check the name or use its address"
        ) from error
    family, _, _, _, address = found[0]
    return family, address


class UdpTransport:
    """One UDP socket with one peer."""

    def __init__(
        self,
        word: str,
        link: LinkWord,
        signing: Signing | None = None,
        system: int | None = None,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        family, address = _resolve(word, link, socket.SOCK_DGRAM)
        self.strangers = 0
        self.problem: str | None = None
        self._socket = socket.socket(family, socket.SOCK_DGRAM)
        self._socket.setblocking(False)
        with contextlib.suppress(OSError):
            self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, RECEIVE_BUFFER)
        # Linux reports twice what it gives, for its own bookkeeping.
        got = self._socket.getsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF)
        self.receive_buffer: int | None = got
        self._peer: Any = None
        self._signing = signing
        self._wanted = system
        self._clock = clock
        self._finder = FrameFinder(signing)
        self._earlier = (0, 0)
        """Frames and bad bytes of addresses that were the vehicle's before."""
        self._candidates: dict[Any, tuple[FrameFinder, int]] = {}
        """Address -> what it sent so far, and in how many datagrams."""
        self._system: int | None = None
        """Of the vehicle, once its address is known and it was heard."""
        self._heard_s = -math.inf
        self._newcomer: tuple[Any, float] | None = None
        """Address, and when it was heard last."""
        if link.kind == "udpout":
            self._peer = address
            self.name = word
            return
        try:
            self._socket.bind(address)
        except OSError as error:
            self._socket.close()
            raise LinkError(
                f"{word}: cannot listen there ({error.strerror or error}); is another ground station running? "
                "Close it, or use another port"
            ) from error
        self.name = f"udpin:{link.host}:{self._socket.getsockname()[1]}"

    @property
    def counts(self) -> tuple[int, int]:
        frames, bad_bytes = self._earlier
        return frames + self._finder.frames, bad_bytes + self._finder.bad_bytes

    def receive(self, timeout_s: float) -> list[Frame]:
        with contextlib.suppress(OSError, ValueError):
            select.select([self._socket], [], [], timeout_s)
        frames: list[Frame] = []
        for _ in range(256):
            try:
                data, address = self._socket.recvfrom(65535)
            except BlockingIOError:
                break
            except OSError as error:
                # Windows reports here that an earlier datagram met a closed port.
                if not isinstance(error, ConnectionError):
                    self.problem = f"{self.name}: {error.strerror or error}"
                    break
                continue
            frames += self._from(data, address)
        return frames

    def _from(self, data: bytes, address: Any) -> list[Frame]:
        now = self._clock()
        if address == self._peer:
            frames = self._finder.feed(data)
            if frames:
                self._heard_s, self._newcomer = now, None
                self._candidates.clear()
            self._note_system(frames)
            return frames
        self.strangers += 1
        if self._peer is not None and (self._system is None or now - self._heard_s < SILENT_S):
            return []
        # Not pinned yet, or silent: an autopilot's heartbeat, and nothing less, makes an address the vehicle's.
        if address not in self._candidates and len(self._candidates) >= MOST_CANDIDATES:
            return []
        finder, datagrams = self._candidates.get(address, (FrameFinder(self._signing), 0))
        self._candidates[address] = (finder, datagrams + 1)
        frames = finder.feed(data)
        wanted = self._wanted if self._peer is None else self._system
        if not any(_is_vehicle(frame.message, wanted) for frame in frames):
            return []
        if self._peer is not None:
            if self._newcomer is None or now - self._newcomer[1] > NEWCOMER_S or self._newcomer[0] == address:
                self._newcomer = (address, now)
            return []
        self._pin(address, now)
        self._note_system(frames)
        return frames

    def _pin(self, address: Any, now: float) -> None:
        finder, datagrams = self._candidates[address]
        if self._peer is not None:
            self._earlier = self.counts
        self.strangers -= datagrams
        self._peer, self._finder, self._heard_s, self._newcomer = address, finder, now, None
        self._candidates.clear()

    def _note_system(self, frames: list[Frame]) -> None:
        if self._system is None:
            ids = [frame.message.get_srcSystem() for frame in frames if _is_vehicle(frame.message, self._wanted)]
            self._system = ids[0] if ids else None

    @property
    def newcomer(self) -> str | None:
        """As `HOST:PORT`."""
        if self._newcomer is None or self._clock() - self._newcomer[1] > NEWCOMER_S:
            return None
        host, port = self._newcomer[0][:2]
        return f"{host}:{port}"

    def take_over(self) -> bool:
        if self.newcomer is None or self._newcomer is None:
            return False
        self._pin(self._newcomer[0], self._clock())
        return True

    def send(self, data: bytes) -> None:
        if self._peer is None:
            return
        try:
            self._socket.sendto(data, self._peer)
            self.problem = None
        except BlockingIOError:
            pass
        except OSError as error:
            self.problem = f"{self.name}: {error.strerror or error}"

    def close(self) -> None:
        self._socket.close()


def _is_vehicle(message: Any, system: int | None) -> bool:
    """Whether it is an autopilot's heartbeat, of `system` where one is wanted."""
    event = decode(message)
    return isinstance(event, Heartbeat) and event.from_autopilot and system in (None, event.system)


class _ByteStream:
    """What TCP and serial share: a stream that may break, is opened again, and must not be waited for."""

    strangers = 0
    receive_buffer: int | None = None
    newcomer: str | None = None

    def __init__(self, word: str, signing: Signing | None) -> None:
        self.name = word
        self.problem: str | None = None
        self._finder = FrameFinder(signing)
        self._unsent = bytearray()
        self._next_try = 0.0
        self._closed = False

    @property
    def counts(self) -> tuple[int, int]:
        return self._finder.frames, self._finder.bad_bytes

    def receive(self, timeout_s: float) -> list[Frame]:
        if not self._is_open():
            self._try_again(timeout_s)
            return []
        try:
            data = self._read(timeout_s)
        except (OSError, serial.SerialException, TypeError, ValueError) as error:
            # pyserial raises TypeError where another thread closed the port.
            self._broken(error)
            return []
        return self._finder.feed(data)

    def _try_again(self, timeout_s: float) -> None:
        if self._closed or time.monotonic() < self._next_try:
            time.sleep(timeout_s)
            return
        self._next_try = time.monotonic() + REOPEN_EVERY_S
        with contextlib.suppress(LinkError):
            self._open()
            self.problem = None

    def _broken(self, error: Exception | str) -> None:
        text = getattr(error, "strerror", None) or str(error)
        self.problem = f"{self.name}: {text}; trying again"
        self._next_try = time.monotonic() + REOPEN_EVERY_S
        self._unsent.clear()
        self._shut()

    def send(self, data: bytes) -> None:
        if not self._is_open():
            return
        if len(self._unsent) + len(data) > MOST_UNSENT:
            return  # whole frames are dropped, never half of one
        self._unsent += data
        try:
            sent = self._write(bytes(self._unsent))
        except (BlockingIOError, serial.SerialTimeoutException):
            return
        except (OSError, serial.SerialException, TypeError, ValueError) as error:
            self._broken(error)
            return
        del self._unsent[:sent]

    def take_over(self) -> bool:
        """One line, one vehicle."""
        return False

    def close(self) -> None:
        self._closed = True
        self._shut()

    def _is_open(self) -> bool:
        raise NotImplementedError

    def _open(self) -> None:
        raise NotImplementedError

    def _shut(self) -> None:
        raise NotImplementedError

    def _read(self, timeout_s: float) -> bytes:
        raise NotImplementedError

    def _write(self, data: bytes) -> int:
        raise NotImplementedError


class TcpTransport(_ByteStream):
    """A TCP connection, opened again when it breaks."""

    CONNECT_S = 3.0
    RECONNECT_S = 0.5

    def __init__(self, word: str, link: LinkWord, signing: Signing | None = None) -> None:
        super().__init__(word, signing)
        self._link = link
        self._socket: socket.socket | None = None
        self._wait_s = self.CONNECT_S
        self._open()
        self._wait_s = self.RECONNECT_S

    def _open(self) -> None:
        _, address = _resolve(self.name, self._link, socket.SOCK_STREAM)
        try:
            connected = socket.create_connection(address[:2], timeout=self._wait_s)
        except OSError as error:
            raise LinkError(
                f"{self.name}: nobody answers there ({error.strerror or error}); "
                "check the address, and that the vehicle or its radio is on"
            ) from error
        connected.setblocking(False)
        connected.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        with contextlib.suppress(OSError):
            connected.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, RECEIVE_BUFFER)
        self.receive_buffer = connected.getsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF)
        self._socket = connected

    def _is_open(self) -> bool:
        return self._socket is not None

    def _shut(self) -> None:
        if self._socket is not None:
            self._socket.close()
            self._socket = None

    def _read(self, timeout_s: float) -> bytes:
        connected = self._socket
        if connected is None:  # the heartbeat's thread found it broken
            return b""
        readable, _, _ = select.select([connected], [], [], timeout_s)
        if not readable:
            return b""
        data = connected.recv(262144)
        if not data:
            raise ConnectionResetError(None, "the other side closed the connection")
        return data

    def _write(self, data: bytes) -> int:
        connected = self._socket
        return 0 if connected is None else connected.send(data)


class SerialTransport(_ByteStream):
    """A serial port, opened again when it was unplugged."""

    def __init__(self, word: str, link: LinkWord, signing: Signing | None = None) -> None:
        super().__init__(word, signing)
        self._link = link
        self._port: Any = None
        self._open()

    def _open(self) -> None:
        try:
            self._port = serial.Serial(self._link.host, self._link.port, timeout=0.01, write_timeout=0, exclusive=True)
        except (OSError, ValueError) as error:  # SerialException is an OSError
            raise LinkError(
                f"{self.name}: cannot open {self._link.host} ({_serial_reason(error)}); is it plugged in, and no other "
                "program on it?"
            ) from error

    def _is_open(self) -> bool:
        return self._port is not None

    def _shut(self) -> None:
        if self._port is not None:
            with contextlib.suppress(OSError):
                self._port.close()
            self._port = None

    def _read(self, timeout_s: float) -> bytes:
        port = self._port
        if port is None:
            return b""
        port.timeout = timeout_s
        first = port.read(1)
        waiting = port.in_waiting
        return bytes(first + port.read(waiting) if waiting else first)

    def _write(self, data: bytes) -> int:
        port = self._port
        return 0 if port is None else int(port.write(data) or 0)


def _serial_reason(error: Exception) -> str:
    match getattr(error, "errno", None):
        case 2:
            return "there is no such device"
        case 13:
            return "permission denied: on Linux, add yourself to the group dialout"
        case 11 | 16:
            return "another program has it"
        case _:
            return str(error)
