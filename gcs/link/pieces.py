"""Pieces of a file that come in any order, twice or not at all, handed on in order.

Pure: offsets and bytes in, what is next in order out. What is missing below the highest byte that came is known as
stretches, for whoever asks for them again.
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Iterator

Stretch = tuple[int, int]
"""First byte, and the first one behind."""


class Pieces:
    """The bytes `start` up to `stop` of a file. What lies further ahead than `ahead` of those in order is not taken."""

    def __init__(self, start: int, stop: int, ahead: int = 1 << 24) -> None:
        self.at = start
        """All before it was handed on."""
        self.stop = stop
        self.highest = start
        """Behind the highest byte that came."""
        self.missing: list[Stretch] = []
        """Below `highest`, in order."""
        self._held: dict[int, bytes] = {}
        self._ahead = ahead

    @property
    def whole(self) -> bool:
        return self.at >= self.stop

    def gaps(self, join: int = 0) -> list[Stretch]:
        """What is missing, stretches with at most `join` bytes between them as one."""
        joined: list[Stretch] = []
        for start, stop in self.missing:
            if joined and start - joined[-1][1] <= join:
                joined[-1] = (joined[-1][0], stop)
            else:
                joined.append((start, stop))
        return joined

    def want(self, stop: int) -> None:
        """All up to `stop` is wanted as if later bytes had come."""
        if stop > self.highest:
            self.missing.append((self.highest, stop))
            self.highest = stop

    def add(self, offset: int, data: bytes) -> bytes:
        """Take a piece; what can be handed on with it, empty where something before it is missing or it is known."""
        stop = min(offset + len(data), self.stop)
        if stop <= self.at or offset >= self.stop or offset > self.at + self._ahead:
            return b""
        self.want(min(offset, self.stop))
        if stop > self.highest:
            self._held[max(offset, self.highest)] = data[max(offset, self.highest) - offset : stop - offset]
        for first, last in self._fill(offset, stop):
            self._held[first] = data[first - offset : last - offset]
        self.highest = max(self.highest, stop)
        return b"".join(self._next())

    def _fill(self, start: int, stop: int) -> list[Stretch]:
        """Take `start` to `stop` out of what is missing; the parts that were."""
        index = max(0, bisect_right(self.missing, (start, start)) - 1)
        filled: list[Stretch] = []
        while index < len(self.missing) and self.missing[index][0] < stop:
            first, last = self.missing[index]
            left, right = max(first, start), min(last, stop)
            if left >= right:
                index += 1
                continue
            filled.append((left, right))
            rest = [part for part in ((first, left), (right, last)) if part[0] < part[1]]
            self.missing[index : index + 1] = rest
            index += len(rest)
        return filled

    def _next(self) -> Iterator[bytes]:
        while (data := self._held.pop(self.at, None)) is not None:
            self.at += len(data)
            yield data
