"""When a fault is there, and in which direction."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum


def _boot() -> float:
    return 0.0


class Way(Enum):
    """Up is from the ground to the vehicle."""

    UP = "up"
    DOWN = "down"
    BOTH = "both"

    def includes(self, way: Way) -> bool:
        return self is way or Way.BOTH in (self, way)


@dataclass(frozen=True, slots=True)
class Window:
    """From `start_s` until before `stop_s`, counted from `zero_s()`."""

    start_s: float = -math.inf
    stop_s: float = math.inf
    zero_s: Callable[[], float] = _boot
    """When the count begins, on the same clock, for example when the first sweep did; infinite as long as it has
    not begun."""

    def covers(self, now_s: float) -> bool:
        return self.start_s <= now_s - self.zero_s() < self.stop_s


ALWAYS = Window()


@dataclass(frozen=True, slots=True)
class Outage(Window):
    """Nothing passes: one way, or either way."""

    way: Way = Way.BOTH


class Once:
    """A single moment: the first time that the window is looked at and covers."""

    def __init__(self, window: Window) -> None:
        self._window = window
        self._over = False

    def comes(self, now_s: float) -> bool:
        """True once."""
        if self._over or not self._window.covers(now_s):
            return False
        self._over = True
        return True
