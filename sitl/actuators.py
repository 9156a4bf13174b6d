"""What lies between a command and the swashplate: limits, delay, second-order servos, play.

Sizes live with the plant that uses them. Everything advances by one sample; nothing here knows the flight.
"""

from __future__ import annotations

import math
from collections import deque


def clip(x: float) -> float:
    return -1.0 if x < -1.0 else min(x, 1.0)


class Delay:
    """A pure delay of a whole number of samples."""

    def __init__(self, samples: int) -> None:
        self._line = deque([0.0] * samples) if samples > 0 else None

    def step(self, x: float) -> float:
        if self._line is None:
            return x
        self._line.append(x)
        return self._line.popleft()


class SecondOrderServo:
    """v'' + 2 zeta w v' + w^2 v = w^2 u with u held over the sample; advanced exactly. zeta < 1."""

    def __init__(self, frequency_hz: float, zeta: float, dt: float) -> None:
        w = 2 * math.pi * frequency_hz
        damped = w * math.sqrt(1 - zeta * zeta)
        decay = math.exp(-zeta * w * dt)
        c, s = math.cos(damped * dt), math.sin(damped * dt)
        self._vv = decay * (c + zeta * w / damped * s)
        self._vr = decay * s / damped
        self._rv = -decay * w * w / damped * s
        self._rr = decay * (c - zeta * w / damped * s)
        self.position = 0.0
        self.rate = 0.0

    def step(self, command: float) -> float:
        """Position at the end of the sample."""
        error, rate = self.position - command, self.rate
        self.position = command + self._vv * error + self._vr * rate
        self.rate = self._rv * error + self._rr * rate
        return self.position


class Backlash:
    """Play: the output follows once the input has taken up the slack of half_width to either side."""

    def __init__(self, half_width: float) -> None:
        self._half_width = half_width
        self.position = 0.0

    def step(self, x: float) -> float:
        if x > self.position + self._half_width:
            self.position = x - self._half_width
        elif x < self.position - self._half_width:
            self.position = x + self._half_width
        return self.position
