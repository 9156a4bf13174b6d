"""One run as strips: the command of its axis with what was added to it, and both rates."""

from __future__ import annotations

import numpy as np

from gcs.desk.choices import COMMAND_OF
from gcs.desk.state import RunRow
from gcs.tui.plot import Panel, TimePlot, round_limit
from gcs.tui.runs_words import strip_title

COMMANDS = {"x": "δx", "y": "δy", "e": "δe"}


def run_strip(row: RunRow) -> TimePlot | None:
    """The samples that a fit would take; None where there are none. Time counts from the maneuver's start."""
    record = row.record
    if record is None or record.t.size < 2:
        return None
    t = record.t - row.start_s
    letter = COMMAND_OF.get(row.axis or "") or max(
        (one for one in COMMANDS if f"delta_{one}" in record.channels),
        key=lambda one: float(np.std(record.channels[f"delta_{one}"])),
    )
    largest = round_limit(max(float(np.nanmax(np.abs(record.channels[name]))) for name in ("p", "q")), 0.1)
    rates = [
        Panel(name=name, x=t, line=record.channels[name], unit="rad/s", fixed=(-largest, largest))
        for name in ("p", "q")
    ]
    command = Panel(
        name=COMMANDS[letter],
        x=t,
        line=record.channels[f"delta_{letter}"],
        over=record.channels.get(f"excitation_{letter}"),
        unit="of full",
        least=0.05,
    )
    return TimePlot(panels=(command, *rates), title=strip_title(row), words=("flown", "what was added", ""))
