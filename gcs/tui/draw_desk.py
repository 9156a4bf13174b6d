"""From what lies on the desk to plots."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from gcs.desk.state import Designed, Rung
from gcs.tui.plot import Panel, TimePlot, time_plot
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


def predicted(designed: Designed, axis: int) -> TimePlot:
    """The closed loop's answer to a rate doublet on roll (0) or pitch (1)."""
    found = designed.following
    one = (found.roll, found.pitch)[axis % 2]
    asked = {"p": one.asked if one.axis == "roll" else None, "q": one.asked if one.axis != "roll" else None}
    t = found.t
    panels = (
        Panel(name="p", x=t, line=one.p, over=asked["p"], unit="rad/s", weight=2.0),
        Panel(name="q", x=t, line=one.q, over=asked["q"], unit="rad/s", weight=2.0),
        Panel(name="δx", x=t, line=one.delta_x),
        Panel(name="δy", x=t, line=one.delta_y),
    )
    return TimePlot(panels=panels, title=f"{one.axis} doublet, predicted", words=("answer", "asked for", ""))
