"""A flight folder as a sweep leaves it, flown by the simulated vehicle as fast as it computes."""

from __future__ import annotations

from pathlib import Path

from flying import CHIRP, DOUBLET, PITCH, ROLL, fly_maneuver, log_of

from gcs.flight.folder import FlightFolder
from gcs.logs import ingest
from sitl.autopilot.vehicle import make_vehicle
from sitl.hidden import plant_one

SECRET = 2
"""The seed of a lag of 22 ms."""
CARD = (
    *((CHIRP, axis, size, 15.0) for axis, size in ((ROLL, 0.10), (ROLL, 0.10), (PITCH, 0.15), (PITCH, 0.15))),
    (CHIRP, ROLL, 0.05, 8.0),
    *((DOUBLET, axis, size, 5.0) for axis, size in ((ROLL, 0.10), (PITCH, 0.15))),
)
"""Kind, axis, amplitude, seconds: four chirps to fit; half the amplitude and doublets to validate."""


def fly_folder(
    folder: Path,
    hidden: str | None = "servo_lag",
    card: tuple[tuple[int, int, float, float], ...] = CARD,
    again: int | None = None,
    plant: str = "hover-ideal",
) -> FlightFolder:
    """Fly a card; `again` is the number of the run that whoever flew wants flown again."""
    folder.mkdir(parents=True, exist_ok=True)
    secret = None if hidden is None else plant_one(hidden, SECRET)
    vehicle = make_vehicle(plant, seed=5, directory=folder, hidden=secret)
    for maneuver in card:
        fly_maneuver(vehicle, *maneuver)
    log = log_of(vehicle, folder).rename(folder / "flight.BIN")
    flown = FlightFolder(folder)
    flown.write(
        {
            "vehicle": {"system": 1, "profile": "simulated", "version": "4.5.7"},
            "runs": [
                {
                    "label": f"run {number}",
                    "ending": "finished",
                    "reason": "",
                    "log_start_s": run.entered_s,
                    "verdict": {"keep": number != again, "reasons": [] if number != again else ["gust"]},
                }
                for number, run in enumerate(ingest([log]).runs, 1)
            ],
        }
    )
    return flown
