"""What goes wrong in the vehicle itself. Each is asked about once a sample, with the vehicle."""

from __future__ import annotations

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
        if self._once.comes(vehicle.time_s):
            vehicle.recording.drop_stream(self._reason)
            vehicle.recording.offered = self._resumes
