"""How long the vehicle has been in the air, as far as it was watched."""

from __future__ import annotations

from dataclasses import dataclass

from gcs.vehicle.autopilots import IN_THE_AIR
from gcs.vehicle.snapshot import VehicleSnapshot


@dataclass(frozen=True, slots=True)
class AirTime:
    """Of the flight that goes on, or of the last one."""

    since_s: float | None = None
    """When it took off, or was first seen in the air, on the clock of whoever watches; None before."""
    until_s: float | None = None
    """When it was on the ground again; None in the air."""
    known: bool = True
    """Its take-off was seen; else it may have flown for long."""
    watched: bool = False
    """It was seen before."""

    def seen(self, vehicle: VehicleSnapshot, now_s: float) -> AirTime:
        """After another look. A vehicle whose link is lost is where it was."""
        if vehicle.lost:
            return self
        flies = vehicle.armed and vehicle.status == IN_THE_AIR
        aloft = self.since_s is not None and self.until_s is None
        if flies and not aloft:
            return AirTime(now_s, None, self.watched, True)
        if not flies and aloft:
            return AirTime(self.since_s, now_s, self.known, True)
        return self if self.watched else AirTime(self.since_s, self.until_s, self.known, True)

    def seconds(self, now_s: float) -> float | None:
        """In the air; None where it was never seen there."""
        if self.since_s is None:
            return None
        return (now_s if self.until_s is None else self.until_s) - self.since_s
