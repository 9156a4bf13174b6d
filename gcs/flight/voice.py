"""What we say: framed, signed where there is a key, sent at once by either thread, and kept for the telemetry log."""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Iterable, Iterator

from gcs.link.encode import (
    REQUEST_MESSAGE,
    STOP_BLOCKS,
    BlockStatus,
    Command,
    Encoder,
    FtpRequest,
    LogDataRequest,
    LogEnd,
    LogListRequest,
    ParamList,
    ParamRead,
    Ping,
    Send,
    StationHeartbeat,
)
from gcs.link.signing import Signing
from gcs.link.transport import Transport

KEPT = 10_000
QUESTIONS = (StationHeartbeat, Ping, ParamRead, ParamList, LogListRequest, LogDataRequest, LogEnd, FtpRequest)
"""What changes nothing on the vehicle; MAVFTP is only read with."""


def asks_only(send: Send) -> bool:
    """Whether it changes nothing: no parameter, mode, command or start of a log."""
    return isinstance(send, QUESTIONS) or (isinstance(send, Command) and send.command == REQUEST_MESSAGE)


class Voice:
    """One station's, on one link. With `dry` nothing leaves but questions."""

    def __init__(
        self, station: int, transport: Transport, signing: Signing | None = None, *, dry: bool = False
    ) -> None:
        self._dry = dry
        self._transport = transport
        self._encoder = Encoder(station, signing=signing)
        self._lock = threading.Lock()
        self._said: deque[bytes] = deque(maxlen=KEPT)

    def address(self, system: int, component: int) -> None:
        """To whom it speaks from now on."""
        self._encoder.target = (system, component)

    def say(self, sends: Iterable[Send]) -> None:
        """Raises ValueError for what MAVLink cannot carry."""
        for send in sends:
            if self._dry and not asks_only(send):
                continue
            with self._lock:
                raw = self._encoder.encode(send)
                self._transport.send(raw)
            if not isinstance(send, BlockStatus) or send.number >= STOP_BLOCKS:
                self._said.append(raw)

    def said(self) -> Iterator[bytes]:
        """The frames since the last time; receipts of blocks are left out. From one thread only."""
        while self._said:
            yield self._said.popleft()

    def forget(self) -> None:
        """What was said so far belongs to no log."""
        self._said.clear()
