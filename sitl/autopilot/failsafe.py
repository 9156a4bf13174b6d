"""ArduPilot's ground station failsafe: what the vehicle does when it no longer hears the one that holds it."""

from __future__ import annotations

from collections.abc import Callable

from sitl.autopilot.modes import Severity
from sitl.autopilot.parameters import Parameters

_CONTINUE_PILOT_CONTROL = 16  # FS_OPTIONS


class GroundFailsafe:
    """It needs a station to have been there: only the one in SYSID_MYGCS holds it."""

    def __init__(
        self, parameters: Parameters, *, time_us: Callable[[], int], say: Callable[[Severity, str], None]
    ) -> None:
        self._parameters = parameters
        self._time_us = time_us
        self._say = say
        self._heard_us: int | None = None
        self._lost = False

    def hear(self, system_id: int) -> None:
        """A ground station's heartbeat."""
        if system_id != self._parameters["SYSID_MYGCS"]:
            return
        self._heard_us = self._time_us()
        if self._lost:
            self._lost = False
            self._say(Severity.WARNING, "GCS Failsafe Cleared")

    @property
    def lost(self) -> bool:
        """Whether the failsafe stands."""
        return self._lost

    def fires(self) -> bool:
        """Whether the station was lost just now, and the vehicle is to return."""
        if self._heard_us is None or self._lost or self._parameters["FS_GCS_ENABLE"] == 0:
            return False
        if self._time_us() - self._heard_us <= self._parameters["FS_GCS_TIMEOUT"] * 1e6:
            return False
        self._lost = True
        if int(self._parameters["FS_OPTIONS"]) & _CONTINUE_PILOT_CONTROL:
            self._say(Severity.WARNING, "GCS Failsafe: Continuing Pilot Control")
            return False
        self._say(Severity.WARNING, "GCS Failsafe")
        return True
