"""What lies between a command and the swashplate: limits, delay, frames, servos, play, and the swashplate itself.

Sizes live with the plant that uses them. Everything advances by one sample; nothing here knows the flight.

Two kinds of element. A *mover* has a position that changes within the sample; its `step` returns the position at the
sample's end, and what acts is the mean of both ends. A *holder* says at once what acts during the sample. A *stage* is
what a plant takes: it turns roll and pitch cyclic, elevator and collective into acting roll, pitch and elevator.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Sequence
from typing import Protocol


def clip(x: float) -> float:
    # asked nine times a step, of which min() would take a tenth
    return -1.0 if x < -1.0 else 1.0 if x > 1.0 else x


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


class Element(Protocol):
    """One command channel: held command -> position at the sample's end (mover), or what acts in it (holder)."""

    def step(self, x: float) -> float: ...


class Stage(Protocol):
    """All command channels: delta_x, delta_y, delta_e, delta_c -> acting delta_x, delta_y, delta_e."""

    def step(self, x: float, y: float, e: float, c: float) -> tuple[float, float, float]: ...


class Each:
    """The same element on roll, pitch and elevator; `moves` says that it is a mover."""

    def __init__(self, make: Callable[[], Element], *, moves: bool) -> None:
        self._x, self._y, self._e = ((Mean(make()) if moves else make()) for _ in range(3))

    def step(self, x: float, y: float, e: float, c: float) -> tuple[float, float, float]:
        return self._x.step(x), self._y.step(y), self._e.step(e)


class Mean:
    """A mover as a holder: the mean of the positions at both ends of the sample."""

    def __init__(self, mover: Element) -> None:
        self._mover = mover
        self._before = 0.0

    def step(self, x: float) -> float:
        before, self._before = self._before, self._mover.step(x)
        return 0.5 * (before + self._before)


class Lag:
    """A mover: tau v' = u - v, advanced exactly; where `rate` is given, never faster than that."""

    def __init__(self, tau: float, dt: float, rate: float = math.inf) -> None:
        self._left = math.exp(-dt / tau) if tau > 0 else 0.0
        self._farthest = rate * dt
        self.position = 0.0

    def step(self, x: float) -> float:
        way = (x - self.position) * (1 - self._left)
        self.position += max(-self._farthest, min(self._farthest, way))
        return self.position


class LazyLag:
    """A mover: a lag whose time constant grows from `tau` to `tau_small` as what is left to go falls below `scale`.

    A servo's motor needs some current before it turns at all: it creeps up to where it should be.
    """

    def __init__(self, tau: float, tau_small: float, scale: float, dt: float) -> None:
        self._tau, self._more, self._scale, self._dt = tau, tau_small - tau, scale, dt
        self.position = 0.0

    def step(self, x: float) -> float:
        error = x - self.position
        tau = self._tau + self._more / (1 + (error / self._scale) ** 2)
        self.position += error * (1 - math.exp(-self._dt / tau))
        return self.position


class Late:
    """A holder: a pure delay of any length; the mean over the sample of what has arrived."""

    def __init__(self, delay_s: float, dt: float) -> None:
        whole = int(delay_s / dt)
        self._share = delay_s / dt - whole
        self._line = deque([0.0] * (whole + 2), maxlen=whole + 2)

    def step(self, x: float) -> float:
        self._line.append(x)
        return self._share * self._line[0] + (1 - self._share) * self._line[1]


class Frame:
    """A holder: the command reaches the servo in pulses `period_s` apart, read at the pulse and held until the next.

    On average half a period late. `first_s` is when the first pulse comes.
    """

    def __init__(self, period_s: float, dt: float, first_s: float = 0.0) -> None:
        self._period, self._dt = period_s, dt
        self._until = first_s
        self._held = 0.0

    def step(self, x: float) -> float:
        if self._until >= self._dt:
            self._until -= self._dt
            return self._held
        share = self._until / self._dt
        acting = share * self._held + (1 - share) * x
        self._held = x
        self._until += self._period - self._dt
        return acting


class DeadBand:
    """A holder: the servo stays while the change asked for is at most `width`, else it goes all the way."""

    def __init__(self, width: float) -> None:
        self._width = width
        self.position = 0.0

    def step(self, x: float) -> float:
        if abs(x - self.position) > self._width:
            self.position = x
        return self.position


class Ring:
    """The cyclic tilt ends on a ring, the elevator at two stops; `give` is what still gets through beyond."""

    def __init__(self, limit: float, give: float = 0.0) -> None:
        self._limit, self._give = limit, give

    def _reached(self, size: float) -> float:
        return min(size, self._limit) + self._give * max(0.0, size - self._limit)

    def step(self, x: float, y: float, e: float, c: float) -> tuple[float, float, float]:
        tilt = math.hypot(x, y)
        inside = self._reached(tilt) / tilt if tilt > self._limit else 1.0
        return inside * x, inside * y, math.copysign(self._reached(abs(e)), e)


class Uneven:
    """Control horns that are not at right angles: a push acts by `more` stronger than a pull."""

    def __init__(self, more: float) -> None:
        self._up, self._down = 1 + more, 1 - more

    def step(self, x: float, y: float, e: float, c: float) -> tuple[float, float, float]:
        up, down = self._up, self._down
        return x * (up if x > 0 else down), y * (up if y > 0 else down), e * (up if e > 0 else down)


class Fading:
    """Everything acts weaker by `share` after `after_s` seconds in the air, in proportion before and beyond."""

    def __init__(self, share: float, after_s: float, dt: float) -> None:
        self._gain = 1.0
        self._step = share * dt / after_s

    def step(self, x: float, y: float, e: float, c: float) -> tuple[float, float, float]:
        gain = self._gain
        self._gain = max(0.2, gain - self._step)
        return gain * x, gain * y, gain * e


class Chain:
    """Elements one behind the other; movers come wrapped in `Mean`."""

    def __init__(self, *elements: Element) -> None:
        self._elements = elements

    def step(self, x: float) -> float:
        for element in self._elements:
            x = element.step(x)
        return x


AZIMUTHS = (math.radians(60), math.radians(180), math.radians(300))


class ThreeServos:
    """A swashplate on three servos 120 degrees apart, and one more for the elevator.

    The mixer gives each servo its height, each servo answers in its own way, and the plate's tilt is what three points
    make of a plane. Ideal servos give back what was asked for. In units of full cyclic; the collective moves all three.
    """

    def __init__(self, servos: Sequence[Element], elevator: Element) -> None:
        self._servos = tuple(servos)
        self._elevator = elevator
        self._mix = tuple((math.sin(azimuth), math.cos(azimuth)) for azimuth in AZIMUTHS)

    def step(self, x: float, y: float, e: float, c: float) -> tuple[float, float, float]:
        tilt_x = tilt_y = 0.0
        for servo, (sine, cosine) in zip(self._servos, self._mix, strict=True):
            height = servo.step(x * sine + y * cosine + c)
            tilt_x += height * sine
            tilt_y += height * cosine
        return tilt_x / 1.5, tilt_y / 1.5, self._elevator.step(e)
