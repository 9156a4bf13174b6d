"""Frames in bytes: MAVLink of both versions, found in a stream that may be damaged.

They are found here rather than by pymavlink's byte parser, which after a corrupted length skips the good frames that
follow; each candidate's checksum and fields are then judged by pymavlink's decoder.
"""

from __future__ import annotations

from typing import Any, NamedTuple

from pymavlink.dialects.v20 import ardupilotmega as dialect

from gcs.link.signing import SIGNATURE, SIGNED, Signing, is_signed


class Frame(NamedTuple):
    """One valid MAVLink frame."""

    raw: bytes
    message: Any
    """pymavlink's message; `decode.decode` makes an event of it."""

    @property
    def signed(self) -> bool:
        """Whether it carries a signature, right or not."""
        return is_signed(self.raw)


class FrameFinder:
    """Finds whole MAVLink frames, versions 1 and 2, in a stream of bytes that may be damaged."""

    def __init__(self, signing: Signing | None = None) -> None:
        """With `signing` only frames that it believes are given."""
        self._buffer = bytearray()
        self._mav: Any = dialect.MAVLink(None)
        self._signing = signing
        self.frames = 0
        self.bad_bytes = 0

    def feed(self, data: bytes) -> list[Frame]:
        """Add bytes; give the frames that are whole now, in order."""
        buffer = self._buffer
        buffer += data
        frames: list[Frame] = []
        at = 0
        while len(buffer) - at >= 3:
            if buffer[at] not in (0xFD, 0xFE):
                at += 1
                self.bad_bytes += 1
                continue
            length = _frame_length(buffer, at)
            if len(buffer) - at < length:
                break
            message = self._judge(buffer, at, length)
            if message is None:
                at += 1
                self.bad_bytes += 1
                continue
            raw = bytes(buffer[at : at + length])
            if message.get_msgId() >= 0 and (self._signing is None or self._signing.believes(raw, message.get_msgId())):
                frames.append(Frame(raw, message))
                self.frames += 1
            at += length
        del buffer[:at]
        return frames

    def _judge(self, buffer: bytearray, at: int, length: int) -> Any:
        message = self._decoded(buffer, at, length)
        if isinstance(message, dialect.MAVLink_unknown):
            # Its checksum cannot be known, so it counts as a frame only where another one, or nothing, follows, and
            # none that is known begins inside it: that would be what is left of a damaged one.
            end = at + length
            follows = end == len(buffer) or buffer[end] in (0xFD, 0xFE)
            return message if follows and not self._begins_another(buffer, at + 1, end) else None
        return message

    def _decoded(self, buffer: bytearray, at: int, length: int) -> Any:
        if buffer[at] == 0xFD and buffer[at + 2] & ~SIGNED:
            return None  # flags that nobody may ignore
        try:
            return self._mav.decode(buffer[at : at + length])
        except dialect.MAVError:
            return None

    def _begins_another(self, buffer: bytearray, start: int, end: int) -> bool:
        for at in range(start, min(end, len(buffer) - 2)):
            if buffer[at] in (0xFD, 0xFE):
                message = self._decoded(buffer, at, _frame_length(buffer, at))
                if message is not None and not isinstance(message, dialect.MAVLink_unknown):
                    return True
        return False


def _frame_length(buffer: bytearray, at: int) -> int:
    if buffer[at] == 0xFE:
        return 8 + buffer[at + 1]
    return 12 + buffer[at + 1] + (SIGNATURE if buffer[at + 2] & SIGNED else 0)
