"""What we say: framed, signed where there is a key, sent at once by either thread, and kept for the telemetry log."""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Iterable, Iterator

from gcs.link.encode import STOP_BLOCKS, BlockStatus, Encoder, Send
from gcs.link.signing import Signing
from gcs.link.transport import Transport

KEPT = 10_000


class Voice:
    """One station's, on one link."""

    def __init__(self, station: int, transport: Transport, signing: Signing | None = None) -> None:
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
