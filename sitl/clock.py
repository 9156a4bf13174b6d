"""Where vehicle time comes from: the wall, faster than the wall, or nowhere at all.

The vehicle itself never reads a clock: it advances by 2 ms a step. A clock only says how many steps are due, so the
same loop flies in real time for a ground station, accelerated for a long log, and at once in a test.
"""

from __future__ import annotations

import math
import time
from typing import Protocol


class Clock(Protocol):
    """Vehicle seconds, from any origin, never backwards."""

    def now(self) -> float: ...

    def wait_until(self, moment_s: float) -> None:
        """Returns when `now()` has reached the moment, or at once where it is past."""


class WallClock:
    """The wall's time, `speed` times as fast. Raises ValueError for a speed that is not positive and finite."""

    def __init__(self, speed: float = 1.0) -> None:
        if not (speed > 0 and math.isfinite(speed)):
            raise ValueError("the speed must be a positive number")
        self._speed = speed

    def now(self) -> float:
        return time.monotonic() * self._speed

    def wait_until(self, moment_s: float) -> None:
        left_s = (moment_s - self.now()) / self._speed
        if left_s > 0:
            time.sleep(left_s)


class FreeClock:
    """No time but the one that is waited for: as fast as the machine computes, and exact in tests."""

    def __init__(self) -> None:
        self._now_s = 0.0

    def now(self) -> float:
        return self._now_s

    def wait_until(self, moment_s: float) -> None:
        self._now_s = max(self._now_s, moment_s)
