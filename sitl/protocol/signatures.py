"""Signed messages, by pymavlink's own codec: with a key the vehicle signs all it says and obeys nothing else.

That codec notes the time of a frame before it has looked at the signature; as on a real autopilot, a refused frame
leaves no trace here. RADIO_STATUS, which radios without a key put in, is let through.
"""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

EPOCH_S = 1420070400
"""1 January 2015, seconds since 1970."""
UNITS_PER_S = 100_000
KEY_BYTES = 32


class Signatures:
    """One key for all links of a vehicle. `wall_clock` gives seconds since 1970."""

    def __init__(self, key: bytes, wall_clock: Callable[[], float] = time.time) -> None:
        self.refused: Counter[str] = Counter()
        """Frames with a right checksum that were not obeyed, by the reason."""
        self._wall_clock = wall_clock
        self._codec = mavlink.MAVLink(None)
        self._signing: Any = self._codec.signing
        self._signing.secret_key = key
        self._signing.sign_outgoing = True
        self.advance()

    def advance(self) -> None:
        """Time passes: no signature is older than the clock, nor as old as one before it."""
        now = int((self._wall_clock() - EPOCH_S) * UNITS_PER_S)
        self._signing.timestamp = max(self._signing.timestamp, now)

    def equip(self, codec: Any) -> None:
        """A codec that signs from now on, in step with all others of the vehicle."""
        codec.signing = self._signing

    def accept(self, message: Any) -> bool:
        """Whether a message with a right checksum is obeyed; counted if not."""
        frame = bytearray(message.get_msgbuf())
        if frame[0] != 0xFD or not frame[2] & mavlink.MAVLINK_IFLAG_SIGNED:
            if message.get_msgId() == mavlink.MAVLINK_MSG_ID_RADIO_STATUS:
                return True
            self.refused["MAVLink 1" if frame[0] != 0xFD else "unsigned"] += 1
            return False
        times = self._signing.stream_timestamps
        voice, sender = (frame[-13], frame[5], frame[6]), (frame[5], frame[6])
        known, latest = times.get(voice), self._signing.timestamp
        if self._codec.check_signature(frame, *sender):
            return True
        times[voice] = -1  # any time will do: is it the signature?
        reason = "wrongly signed"
        if self._codec.check_signature(frame, *sender):
            reason = "too old" if known is None else "replayed"
        self._signing.timestamp = latest
        if known is None:
            del times[voice]
        else:
            times[voice] = known
        self.refused[reason] += 1
        return False

    def told(self) -> str:
        """The counts in a line."""
        return ", ".join(f"{count} {reason}" for reason, count in self.refused.most_common()) or "nothing was refused"


def read_key(path: Path) -> bytes:
    """64 hexadecimal digits. Raises ValueError, OSError."""
    key = bytes.fromhex(path.read_text(encoding="ascii").strip())
    if len(key) != KEY_BYTES:
        raise ValueError("64 hexadecimal digits are wanted")
    return key
