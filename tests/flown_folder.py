"""A flight folder as a sweep leaves it, flown by the simulated vehicle as fast as it computes."""

from __future__ import annotations

from pathlib import Path

from flying import Card, flown

from gcs.flight.folder import FlightFolder
from gcs.logs import ingest


def fly_folder(
    folder: Path,
    hidden: tuple[str, int] | None,
    card: Card,
    again: int | None = None,
    plant: str = "hover-ideal",
) -> FlightFolder:
    """Fly a card; `again` is the number of the run that whoever flew wants flown again."""
    folder.mkdir(parents=True, exist_ok=True)
    log = folder / "flight.BIN"
    log.write_bytes(flown(plant, card, hidden))
    folder_of_flight = FlightFolder(folder)
    folder_of_flight.write(
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
    return folder_of_flight
