"""Bode figures: what was measured with its bounds, and models beside it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from gcs.analysis.pages.flown import STYLES
from gcs.analysis.pages.page import BLACK, literal
from gcs.analysis.pages.pictures import GREY, PAGE_WIDTH, logarithmic, panels
from sysid.compare.metrics import Mismatches
from sysid.data.record import CHANNELS
from sysid.response.values import LEAST_COHERENCE

MOST_DEG = 180.0
"""Between points; more is a turn, and no line."""


def bode_figure(command: str, models: Sequence[tuple[str, Mismatches]], band_hz: tuple[float, float]) -> Any:
    """Gain, phase and coherence of every output on one command: a column for each output.

    models: label and responses of each, all beside the same runs; the first one's measured responses are drawn.
    """
    measured = models[0][1].measured
    figure, axes = panels(3, len(measured.outputs), 6.2, [1.2, 1.0, 0.6], width=PAGE_WIDTH)
    m = measured.commands.index(command)
    for k, output in enumerate(measured.outputs):
        gain, phase, coherence = axes[:, k]
        inside, f = measured.valid(output, command), measured.frequency_hz
        for axis, values, bound in (
            (gain, measured.decibels[k, m], measured.bound_db[k, m]),
            (phase, measured.degrees[k, m], measured.bound_deg[k, m]),
        ):
            shown = np.where(inside, values, np.nan)
            axis.fill_between(f, shown - bound, shown + bound, color=GREY, alpha=0.7, linewidth=0, label="95 % bounds")
            axis.plot(f, shown, color=BLACK, linewidth=1.2, label="measured")
        for (label, found), (colour, dashes) in zip(models, STYLES, strict=False):
            one = next(each for each in found.each if (each.output, each.command) == (output, command))
            at = np.searchsorted(f, one.frequency_hz)
            style = {"color": colour, "linestyle": dashes, "linewidth": 1.4}
            gain.plot(one.frequency_hz, measured.decibels[k, m, at] + one.decibels, label=literal(label), **style)
            degrees = measured.degrees[k, m, at] + one.degrees
            degrees[1:][np.abs(np.diff(degrees)) > MOST_DEG] = np.nan
            phase.plot(one.frequency_hz, degrees, **style)
        coherence.plot(f, measured.partial_coherence[k, m], color=BLACK, linewidth=1.1)
        coherence.axhline(LEAST_COHERENCE, color=BLACK, linewidth=0.8, linestyle=":")
        _labelled(axes[:, k], output, command, band_hz, bool(np.any(inside)))
    return figure


def _labelled(column: Any, output: str, command: str, band_hz: tuple[float, float], any_band: bool) -> None:
    gain, phase, coherence = column
    gain.set_title(f"{output} per {command}", fontsize=10, loc="left", fontweight="bold")
    gain.set_ylabel(f"gain, dB of {CHANNELS[output]}", fontsize=9)
    phase.set_ylabel("phase, °", fontsize=9)
    coherence.set_ylabel("coherence", fontsize=9)
    coherence.set_ylim(0, 1.02)
    coherence.set_xlabel("frequency, Hz", fontsize=9)
    for axis in column:
        logarithmic(axis, band_hz)
        axis.tick_params(labelbottom=axis is coherence)
    if any_band:
        gain.legend(loc="best", fontsize=8, framealpha=0.85)
        return
    where = {"transform": gain.transAxes, "ha": "center", "fontsize": 9}
    gain.text(0.5, 0.5, "these runs do not measure it", **where)
