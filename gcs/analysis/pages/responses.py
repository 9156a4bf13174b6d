"""Measured responses drawn: gain, phase and coherence, a column for each output, bounds as areas."""

from __future__ import annotations

from typing import Any

import numpy as np

from gcs.analysis.pages.page import BLACK
from gcs.analysis.pages.pictures import COMMAND_COLOURS, logarithmic, panels
from sysid.data.record import CHANNELS, axis_of
from sysid.response.flown import FlownResponses
from sysid.response.values import LEAST_COHERENCE, PROBABILITY

STYLES = ("-", "--", "-.", ":", "-", "--")
STEEPEST_DEG = 180.0
"""Between points; more is a turn, and no line."""


def responses_picture(found: FlownResponses) -> Any:
    """Three rows, a column for each output."""
    measured = found.responses
    figure, axes = panels(3, len(measured.outputs), 10.0, [1.2, 1.0, 0.7])
    for k, output in enumerate(measured.outputs):
        for m in range(len(measured.commands)):
            _pair(axes[:, k], found, k, m)
        _finish(axes[:, k], found, output)
    return figure


def _pair(column: Any, found: FlownResponses, k: int, m: int) -> None:
    """One response where it can be trusted, and faintly where it was measured at all."""
    measured = found.responses
    output, command = measured.outputs[k], measured.commands[m]
    colour, style = COMMAND_COLOURS[m % len(COMMAND_COLOURS)], STYLES[m % len(STYLES)]
    frequency, inside = measured.frequency_hz, measured.valid(output, command)
    label = command if np.any(inside) else f"{command}: no band"
    for axis, values, bound in (
        (column[0], measured.decibels[k, m], measured.bound_db[k, m]),
        (column[1], measured.degrees[k, m], measured.bound_deg[k, m]),
    ):
        values = np.where(inside, values, np.nan)
        axis.fill_between(frequency, values - bound, values + bound, color=colour, alpha=0.25, linewidth=0)
        axis.plot(frequency, values, color=colour, linestyle=style, linewidth=1.6, label=label)
    column[2].plot(frequency, measured.partial_coherence[k, m], color=colour, linestyle=style, linewidth=1.4)


def _finish(column: Any, found: FlownResponses, output: str) -> None:
    gain, phase, coherence = column
    gain.set_title(f"{axis_of(output)}: {output} per full command", fontsize=12, loc="left", fontweight="bold")
    gain.set_ylabel(f"dB of {CHANNELS[output]}", fontsize=10)
    title = f"area: {100 * PROBABILITY:.0f} % bounds"
    gain.legend(loc="best", fontsize=9, title=title, title_fontsize=9, framealpha=0.85)
    phase.set_ylabel("degrees", fontsize=10)
    coherence.axhline(LEAST_COHERENCE, color=BLACK, linewidth=0.8, linestyle=":")
    coherence.set_ylim(0, 1.02)
    coherence.set_ylabel("partial coherence", fontsize=10)
    coherence.set_xlabel("frequency, Hz", fontsize=10)
    frequency = found.responses.frequency_hz
    for axis in column:
        logarithmic(axis, (0.99 * float(frequency[0]), 1.01 * float(frequency[-1])))
    for axis in (gain, phase):
        axis.tick_params(labelbottom=False)
