"""The vehicle's half of the log block stream: cut, send, wait for the receipt, send again.

Pure: it takes bytes, receipts and the time, and says which blocks to send. A block is forgotten only when the ground
has acknowledged it. Times as on ArduPilot: unanswered blocks go again after 100 ms, refused ones at once, at most
five repetitions a turn so that an outage is not followed by a flood; 10 s without a receipt end the stream.
"""

from __future__ import annotations

import math
from collections import deque

from sitl.autopilot.logger import BLOCK_BYTES

RESEND_S = 0.1
SILENCE_S = 10.0
_REPEATS_A_TURN = 5
_NEW_A_TURN = 50


class BlockStream:
    """One stream. Also a sink of the log, so it carries the file's own bytes."""

    def __init__(self, buffer_bytes: int, now_s: float) -> None:
        self._room = max(1, buffer_bytes // BLOCK_BYTES)
        self._rest = bytearray()
        self._next = 0
        self._fresh: deque[int] = deque()
        self._refused: deque[int] = deque()
        self._data: dict[int, bytes] = {}
        self._sent_s: dict[int, float] = {}  # in order of sending: the oldest is first
        self._ended = False
        self._overflown = False
        self._receipt_s = now_s
        self.bytes_per_s = math.inf
        """What the vehicle manages to send; less than it writes, and its buffer fills."""
        self._may_send = 0.0
        self._asked_s = now_s

    def write(self, data: bytes) -> None:
        rest = self._rest
        rest += data
        while len(rest) >= BLOCK_BYTES:
            if len(self._data) >= self._room:
                self._overflown = True
                return
            self._data[self._next] = bytes(rest[:BLOCK_BYTES])
            self._fresh.append(self._next)
            self._next += 1
            del rest[:BLOCK_BYTES]

    def close(self) -> None:
        """Nothing more will come; what is under way still gets there."""
        self._ended = True

    def abandon(self) -> None:
        """Nothing more is sent, not even what is under way."""
        self._ended = True
        for waiting in (self._rest, self._fresh, self._refused, self._data, self._sent_s):
            waiting.clear()

    @property
    def open_blocks(self) -> int:
        """Not yet acknowledged."""
        return len(self._data)

    @property
    def delivered(self) -> bool:
        return self._ended and not self._data

    def failure(self, now_s: float) -> str | None:
        """Why the stream cannot go on, or None."""
        if self._overflown:
            return "buffer full"
        if now_s - self._receipt_s > SILENCE_S:
            return "no acknowledgement for 10 s"
        return None

    def acknowledged(self, seqno: int, now_s: float) -> None:
        self._receipt_s = now_s
        if seqno in self._sent_s:
            del self._sent_s[seqno]
            del self._data[seqno]

    def refused(self, seqno: int, now_s: float) -> None:
        """The ground misses this block. Blocks that it has acknowledged, or that never were, are not repeated."""
        self._receipt_s = now_s
        if seqno in self._sent_s and seqno not in self._refused:
            self._refused.append(seqno)

    def due(self, now_s: float) -> list[tuple[int, bytes]]:
        """What to send now, as (block number, 200 bytes)."""
        if math.isfinite(self.bytes_per_s):
            self._may_send = min(10.0, self._may_send + (now_s - self._asked_s) * self.bytes_per_s / BLOCK_BYTES)
            self._asked_s = now_s
            if self._may_send < 1:
                return []
        out = self._due(now_s)
        self._may_send -= len(out)
        return [(seqno, self._data[seqno]) for seqno in out]

    def _due(self, now_s: float) -> list[int]:
        out: list[int] = []
        while self._refused and len(out) < _NEW_A_TURN:
            seqno = self._refused.popleft()
            if seqno in self._sent_s:
                out.append(seqno)
                self._sent(seqno, now_s)
        for seqno in [s for s, _ in zip(self._sent_s, range(_REPEATS_A_TURN), strict=False)]:
            if now_s - self._sent_s[seqno] < RESEND_S:
                break
            out.append(seqno)
            self._sent(seqno, now_s)
        while self._fresh and len(out) < _NEW_A_TURN:
            seqno = self._fresh.popleft()
            out.append(seqno)
            self._sent(seqno, now_s)
        return out

    def _sent(self, seqno: int, now_s: float) -> None:
        self._sent_s.pop(seqno, None)
        self._sent_s[seqno] = now_s
