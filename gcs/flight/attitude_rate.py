"""How often attitudes are asked for where they alone tell how a flight goes: as often as the link carries them.

A link whose rate is known, a serial line, is asked for no more than a share of it. Any other begins low and is raised
while all that was asked for comes in time; a step that was too much is not tried again. It is raised only in the mode
that the pilot chose, and lowered at any time.
"""

from __future__ import annotations

from gcs.link.clock import LOST_AFTER_S

RATES_HZ = (10.0, 20.0, 25.0, 50.0)
BEGIN_HZ = 20.0
"""Where nothing is known of the link."""
MESSAGE_BYTES = 40.0
"""Of an ATTITUDE."""
SHARE = 0.2
"""Of a link's rate: beside it comes what the vehicle sends by itself, some 2 kB/s of an ArduPilot's."""
LOOK_S = 1.0
LATE_S, IN_TIME_S = 0.25, 0.15
"""Lag from which the rate is lowered, and up to which it is raised."""
LOW, ALL = 0.75, 0.85
"""Of what was asked for."""
LOW_FOR_S = 4.0
"""Less than `LOW` came, although it was asked for again meanwhile."""


class AttitudeRate:
    """Times are the session's clock, s. `carries` is in bytes a second, None where that is not known."""

    def __init__(self, carries: float | None, now: float) -> None:
        fitting = [hz for hz in RATES_HZ if carries is None or MESSAGE_BYTES * hz <= SHARE * carries]
        self._most = max(0, len(fitting) - 1)
        """Index of the highest rate that may be asked for."""
        self._at = self._most if carries is not None else RATES_HZ.index(BEGIN_HZ)
        self._looked, self._count = now, 0
        self._low_s = 0.0

    @property
    def interval_s(self) -> float:
        """Asked for now."""
        return 1 / RATES_HZ[self._at]

    def look(self, now: float, count: int, lag_s: float | None, *, may_raise: bool) -> bool:
        """Whether another rate is to be asked for from now on. `count` attitudes came so far."""
        over_s = now - self._looked
        if over_s < LOOK_S:
            return False
        share = (count - self._count) * self.interval_s / over_s
        self._looked, self._count = now, count
        self._low_s = self._low_s + over_s if share < LOW else 0.0
        if over_s > LOST_AFTER_S or count == 0:
            return False
        if self._at > 0 and ((lag_s or 0.0) > LATE_S or self._low_s >= LOW_FOR_S):
            return self._go(self._at - 1, most=self._at - 1)
        if may_raise and self._at < self._most and share >= ALL and lag_s is not None and lag_s <= IN_TIME_S:
            return self._go(self._at + 1, most=self._most)
        return False

    def _go(self, at: int, *, most: int) -> bool:
        self._at, self._most, self._low_s = at, most, 0.0
        return True
