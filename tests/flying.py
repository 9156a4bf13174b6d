"""The simulated vehicle flown as fast as it computes: one maneuver after the other, and the log it wrote."""

from __future__ import annotations

from pathlib import Path

from sitl.autopilot.modes import Mode, Reason
from sitl.autopilot.vehicle import Vehicle

CHIRP, DOUBLET, QUIET = 0, 1, 2
ROLL, PITCH, ELEVATOR = 10, 11, 20
REST_STEPS = 500


def fly_maneuver(
    vehicle: Vehicle, kind: int, axis: int, magnitude: float, duration_s: float, rest_steps: int = REST_STEPS
) -> None:
    """Table 1's law from 0.5 to 10 Hz, then `rest_steps` of 2 ms of hover."""
    for name, value in {
        "SID_AXIS": axis,
        "SID_MAGNITUDE": magnitude,
        "SID_F_START_HZ": 0.5,
        "SID_F_STOP_HZ": 10.0,
        "SID_T_FADE_IN": 0.0,
        "SID_T_REC": duration_s,
        "SID_T_FADE_OUT": 0.0,
        "SIDX_KIND": kind,
        "SIDX_LAW": 1,
        "SIDX_PULSE_S": 0.25,
    }.items():
        assert vehicle.write_parameter(name, value) is not None
    assert vehicle.set_mode(Mode.SYSTEMID, Reason.GROUND)
    while vehicle.sweeping:
        vehicle.step()
    assert vehicle.set_mode(Mode.STABILIZE, Reason.GROUND)
    for _ in range(rest_steps):
        vehicle.step()


def log_of(vehicle: Vehicle, folder: Path) -> Path:
    """The vehicle switched off, and the only log it left in `folder`."""
    vehicle.close()
    (log,) = folder.glob("*.BIN")
    return log
