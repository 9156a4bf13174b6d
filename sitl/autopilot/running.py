"""The vehicle stepped as a clock goes."""

from __future__ import annotations

from collections.abc import Callable

from sitl.autopilot.vehicle import Vehicle
from sitl.clock import Clock

LATE_STEPS = 25
"""So many overdue steps before the link gets its turn."""
STANDSTILL_S = 2.0
"""Overdue by more (a suspended machine), the vehicle's time stands still instead: no sample is ever skipped."""


def run(vehicle: Vehicle, clock: Clock, between: Callable[[], None], ended: Callable[[], bool]) -> None:
    """Step the vehicle as the clock goes until `ended`; `between` steps it calls for the link and the pilot."""
    offset_s = vehicle.time_s - clock.now()
    while not ended():
        late_s = clock.now() + offset_s - vehicle.time_s
        if late_s > STANDSTILL_S:
            offset_s -= late_s
            late_s = 0.0
        for _ in range(min(LATE_STEPS, int(late_s / vehicle.dt + 1e-6))):
            vehicle.step()
        between()
        clock.wait_until(vehicle.time_s + vehicle.dt - offset_s)
