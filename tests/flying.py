"""The simulated vehicle flown as fast as it computes: one maneuver after the other, and the log it wrote."""

from __future__ import annotations

from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory

from made_once import made_once

from sitl.autopilot.modes import Mode, Reason
from sitl.autopilot.vehicle import Vehicle, make_vehicle
from sitl.hidden import plant_one

CHIRP, DOUBLET, QUIET = 0, 1, 2
ROLL, PITCH, ELEVATOR = 10, 11, 20
REST_STEPS = 500

Card = tuple[tuple[int, int, float, float], ...]
"""Maneuvers: kind, axis, amplitude, seconds."""
LAG = ("servo_lag", 2)
"""A hidden effect and the seed of its size: a lag of 22 ms, which a gyro could have as well."""
LAG_CARD: Card = (
    *((CHIRP, axis, size, 8.0) for axis, size in ((ROLL, 0.10), (ROLL, 0.10), (PITCH, 0.15), (PITCH, 0.15))),
    (CHIRP, ROLL, 0.05, 6.0),
    *((DOUBLET, axis, size, 5.0) for axis, size in ((ROLL, 0.10), (PITCH, 0.15))),
)
"""Four chirps to fit; half the amplitude and doublets to validate."""
TWO_CHIRPS: Card = ((CHIRP, ROLL, 0.1, 6.0), (CHIRP, PITCH, 0.15, 6.0))


def fly_maneuver(
    vehicle: Vehicle,
    kind: int,
    axis: int,
    magnitude: float,
    duration_s: float,
    rest_steps: int = REST_STEPS,
    pulse_s: float = 0.25,
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
        "SIDX_PULSE_S": pulse_s,
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


@cache
def flown(plant: str, card: Card, hidden: tuple[str, int] | None = None, seed: int = 5) -> bytes:
    """The log of a card; a flight that several tests ask for is flown once."""
    return made_once(_flown, plant, card, hidden, seed)


def _flown(plant: str, card: Card, hidden: tuple[str, int] | None, seed: int) -> bytes:
    with TemporaryDirectory() as folder:
        secret = None if hidden is None else plant_one(*hidden)
        vehicle = make_vehicle(plant, seed=seed, directory=Path(folder), hidden=secret)
        for maneuver in card:
            fly_maneuver(vehicle, *maneuver)
        return log_of(vehicle, Path(folder)).read_bytes()
