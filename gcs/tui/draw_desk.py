"""From what lies on the desk to plots."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from gcs.desk.state import Rung
from gcs.tui.plot import TimePlot, time_plot
from gcs.tui.plot.model import FloatArray

if TYPE_CHECKING:
    from sysid.compare.values import Comparison

COMMANDS = (("delta_x", "δx"), ("delta_y", "δy"), ("delta_e", "δe"))


def run_strips(rung: Rung, part: int, *, both: bool) -> TimePlot | None:
    """u, p, q with the model over them and the residuals below; None where nothing was compared yet.

    both: draw every command that moves; else the one that moves most.
    """
    found = rung.comparison
    if found is None or not found.traces:
        return None
    part %= len(found.traces)
    return time_plot(found, part, commands=commands_of(found, part, both=both))


def commands_of(found: Comparison, part: int, *, both: bool) -> dict[str, FloatArray]:
    """Name -> the command on the trace's own time."""
    commands = found.traces[part].commands
    moving = {name: commands[key] for key, name in COMMANDS if key in commands and np.ptp(commands[key]) > 0}
    if not both and moving:
        most = max(moving, key=lambda name: float(np.std(moving[name])))
        return {most: moving[most]}
    return moving
