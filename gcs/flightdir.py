"""The folder of a flight: what it is called, what lies in it, and the file that says what was flown.

    flight-0007/
      flight.BIN     the vehicle's own log, byte for byte
      flight.tlog    the telemetry, both directions
      card.toml      the card as it was flown
      flight.json    the vehicle, the runs with their verdicts, how the samples came and how many are missing

A folder that holds something is never written into. `flight.json` is replaced whole after every run, so that a
flight that ends badly is told as far as it went.
"""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from gcs.errors import TippathError, UsageError

FORMAT = "tippath.flight/1"
_NUMBERED = re.compile(r"flight-(\d{4,})")


@dataclass(frozen=True, slots=True)
class FlightFolder:
    """One flight on disk."""

    path: Path

    @property
    def log(self) -> Path:
        return self.path / "flight.BIN"

    @property
    def tlog(self) -> Path:
        return self.path / "flight.tlog"

    @property
    def card(self) -> Path:
        return self.path / "card.toml"

    @property
    def about(self) -> Path:
        return self.path / "flight.json"

    def write(self, about: Mapping[str, Any]) -> None:
        """Write flight.json, whole or not at all. Raises TippathError where the disk does not take it."""
        part = self.about.with_name("flight.json.part")
        try:
            text = json.dumps({"format": FORMAT, **about}, indent=1, allow_nan=False, ensure_ascii=False)
            part.write_text(text + "\n", "utf-8")
            part.replace(self.about)
        except OSError as error:
            part.unlink(missing_ok=True)
            raise TippathError(f"{self.about} cannot be written ({error.strerror or error})") from error

    def write_card(self, text: str) -> None:
        """Keep the card beside the log. Raises TippathError where the disk does not take it."""
        made = False
        try:
            with self.card.open("x", encoding="utf-8") as stream:
                made = True
                stream.write(text)
        except OSError as error:
            if made:
                self.card.unlink(missing_ok=True)
            raise TippathError(f"{self.card} cannot be written ({error.strerror or error})") from error

    def read(self) -> dict[str, Any]:
        """What flight.json says. Raises TippathError where there is none, or it is none."""
        try:
            about = json.loads(self.about.read_text("utf-8"))
        except FileNotFoundError:
            raise TippathError(f"{self.path} is no flight folder: there is no flight.json in it") from None
        except (OSError, ValueError) as error:
            raise TippathError(f"{self.about} cannot be read ({error})") from error
        if not isinstance(about, dict) or about.get("format") != FORMAT:
            raise TippathError(f"{self.about} is not a {FORMAT} file")
        return about

    def runs(self) -> list[dict[str, Any]]:
        """The runs of flight.json, in the order flown. Raises as `read`."""
        runs = self.read().get("runs", [])
        return [run for run in runs if isinstance(run, dict)] if isinstance(runs, list) else []


def create(given: Path | None, parent: Path | None = None) -> FlightFolder:
    """Make the folder of the next flight: `given`, or `flight-NNNN` with the next free number in `parent`.

    Raises UsageError where `given` holds something already, TippathError where no folder can be made.
    """
    if given is not None:
        return FlightFolder(_fresh(given))
    parent = Path() if parent is None else parent
    try:
        numbers = [int(m[1]) for entry in parent.iterdir() if (m := _NUMBERED.fullmatch(entry.name))]
        number = max(numbers, default=0) + 1
        while True:
            path = parent / f"flight-{number:04d}"
            try:
                path.mkdir()
                return FlightFolder(path)
            except FileExistsError:
                number += 1  # somebody else was faster
    except OSError as error:
        raise TippathError(
            f"no folder for the flight can be made in {parent.resolve()} ({error.strerror or error}); "
            "choose another with -o DIR"
        ) from error


def _fresh(path: Path) -> Path:
    """Make `path`, or take it where it is empty."""
    try:
        path.mkdir(parents=True, exist_ok=True)
        occupied = next(path.iterdir(), None)
    except FileExistsError:
        raise UsageError(f"{path} is a file; choose a folder with -o DIR") from None
    except OSError as error:
        raise TippathError(f"{path} cannot be made ({error.strerror or error}); choose another with -o DIR") from error
    if occupied is not None:
        raise UsageError(
            f"{path} holds something already ({occupied.name}); flights are never overwritten: choose another -o DIR"
        )
    return path
