"""What goes wrong in the vehicle itself. Each is asked about once a sample, with the vehicle."""

from __future__ import annotations

import math
import random

from sitl.autopilot.vehicle import Vehicle
from sitl.faults.windows import Once, Window

BUFFER_FULL = "buffer full"


class LogStop:
    """The stream of log blocks ends when `at` begins; the log on board goes on.

    With a reason the vehicle says so, with None it says nothing. Unless it resumes, no START is heard afterwards.
    """

    def __init__(self, at: Window, *, reason: str | None = BUFFER_FULL, resumes: bool = False) -> None:
        self._once = Once(at)
        self._reason = reason
        self._resumes = resumes

    def __call__(self, vehicle: Vehicle) -> None:
        if self._once.comes(vehicle.elapsed_s):
            vehicle.recording.drop_stream(self._reason)
            vehicle.recording.offered = self._resumes


class SlowLog:
    """The vehicle sends no more than so many bytes of its log a second; what its buffer cannot hold ends the stream."""

    def __init__(self, bytes_per_s: float, window: Window) -> None:
        """Raises ValueError for a rate that is not positive."""
        if not bytes_per_s > 0:
            raise ValueError("the log's rate must be a positive number of bytes per second")
        self._bytes_per_s = bytes_per_s
        self._window = window

    def __call__(self, vehicle: Vehicle) -> None:
        if vehicle.recording.stream is not None:
            slow = self._window.covers(vehicle.elapsed_s)
            vehicle.recording.stream.bytes_per_s = self._bytes_per_s if slow else math.inf


class WrongWrites:
    """A share of the writes to parameters: another value is stored, or none; the answer tells what is there then."""

    def __init__(self, share: float, seed: int, window: Window, *, refused: bool = False) -> None:
        """Raises ValueError for a share outside 0..1."""
        if not 0 <= share <= 1:
            raise ValueError("the share of writes must lie between 0 and 1")
        self._share = share
        self._window = window
        self._refused = refused
        self._random = random.Random(f"writes {refused} {seed}")
        self._in_place = False

    def __call__(self, vehicle: Vehicle) -> None:
        if self._in_place:
            return
        self._in_place, before = True, vehicle.parameters.stored

        def stored(name: str, value: float) -> float | None:
            kept = before(name, value)
            if kept is None or not self._window.covers(vehicle.elapsed_s) or self._random.random() >= self._share:
                return kept
            return None if self._refused else kept * self._random.uniform(0.3, 3.0) + self._random.choice((0.0, 1.0))

        vehicle.parameters.stored = stored


class Restart:
    """A watchdog resets the vehicle when `at` begins: in the air it flies on, in its first mode, with a clock of its
    own."""

    def __init__(self, at: Window) -> None:
        self._once = Once(at)

    def __call__(self, vehicle: Vehicle) -> None:
        if self._once.comes(vehicle.elapsed_s):
            vehicle.restart(on_ground=vehicle.landed)


class ClockStep:
    """The vehicle's clock goes on by so many seconds at once when `at` begins."""

    def __init__(self, seconds: float, at: Window) -> None:
        """Raises ValueError for a step that does not go on."""
        if not 0 < seconds <= 1e6:
            raise ValueError("the clock can go on by up to 1e6 seconds; back it goes only with --reboot")
        self._seconds = seconds
        self._once = Once(at)

    def __call__(self, vehicle: Vehicle) -> None:
        if self._once.comes(vehicle.elapsed_s):
            vehicle.step_clock(self._seconds)


class DeadGyro:
    """The gyro gives no numbers in the window: its raw rates are NaN in the log, and the filtered ones stand still."""

    def __init__(self, window: Window) -> None:
        self._window = window

    def __call__(self, vehicle: Vehicle) -> None:
        vehicle.rate_sensor.broken = self._window.covers(vehicle.elapsed_s)
