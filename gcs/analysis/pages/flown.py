"""Rates in time as figures: a run measured and modelled, and the answer that gains promise."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from gcs.analysis.pages.page import BLACK, BLUE, GREEN, ORANGE, literal
from gcs.analysis.pages.pictures import COLUMNS, PAGE_WIDTH, panels, thinned
from sysid.control.loop import Following
from sysid.data.dataset import prepared
from sysid.data.record import CHANNELS, RATES, Record
from sysid.fit.simulate import overlay
from sysid.model.structure import Model

FEWEST_COLUMNS = 250
ALL_COLUMNS = 4000
"""On one page, over all of its runs."""
RESIDUAL = 0.4
"""Height of a panel of what is left, of that of the rate above it."""
STYLES: tuple[tuple[str, Any], ...] = ((BLUE, (0, (5, 1.2))), (ORANGE, (0, (2, 1))), (GREEN, (0, (1, 1))))
"""Colour and dashes of each model."""


def columns_for(runs: int) -> int:
    """How finely each of so many runs is drawn, for the page to stay small."""
    return max(FEWEST_COLUMNS, min(COLUMNS, ALL_COLUMNS // max(1, runs)))


def run_figure(
    record: Record, models: Sequence[tuple[str, Model]], band_hz: tuple[float, float], columns: int = COLUMNS
) -> Any:
    """One run: commands, then each output measured against each model, as the fit saw them (inside the band), and what
    the first model leaves of it, on the same scale."""
    inputs, outputs = models[0][1].structure.inputs, models[0][1].structure.outputs
    each = len(outputs)
    ratios = [0.7, *[1.0, RESIDUAL] * each]
    figure, axes = panels(1 + 2 * each, 1, 1.2 + 1.9 * each, ratios, width=PAGE_WIDTH)
    top, rates, residuals = axes[0, 0], axes[1::2, 0], axes[2::2, 0]
    start = record.t[0]
    for name, colour in zip(inputs, (BLACK, ORANGE, GREEN), strict=False):
        top.plot(*thinned(record.t - start, record.channels[name], columns), color=colour, lw=0.6, label=name)
    top.set_ylabel("command", fontsize=8)
    largest = np.full(each, 1e-9)
    for one in prepared([record], band_hz).viewed(inputs, outputs).spectra:
        for number, ((label, model), (colour, dashes)) in enumerate(zip(models, STYLES, strict=False)):
            t, measured, modelled = overlay(model, one)
            largest = np.maximum(largest, np.max(np.abs(measured), axis=0))
            for k in range(each):
                if number == 0:
                    rates[k].plot(*thinned(t - start, measured[:, k], columns), color=BLACK, lw=0.9, label="measured")
                    left = thinned(t - start, measured[:, k] - modelled[:, k], columns)
                    residuals[k].plot(*left, color=colour, lw=0.7)
                line = thinned(t - start, modelled[:, k], columns)
                rates[k].plot(*line, color=colour, lw=0.9, linestyle=dashes, label=literal(label))
    for k, output in enumerate(outputs):
        rates[k].set_ylabel(f"{output}, {CHANNELS[output]}", fontsize=8)
        rates[k].set_ylim(-1.1 * largest[k], 1.7 * largest[k])
        residuals[k].set_ylabel("left", fontsize=8)
        room = 0.5 * 2.8 * RESIDUAL * largest[k]
        residuals[k].set_ylim(-room, room)
    _finish(axes[:, 0], (top, *rates), float(record.t[-1] - start))
    return figure


def _finish(column: Any, named: Sequence[Any], length_s: float) -> None:
    """One axis of time below all, and a legend where lines have names."""
    for axis in column:
        axis.set_xlim(0.0, length_s)
        axis.tick_params(labelbottom=axis is column[-1], labelsize=8)
    for axis in named:
        handles, labels = axis.get_legend_handles_labels()
        own = dict(zip(labels, handles, strict=True))  # a run in pieces says each once
        axis.legend(own.values(), own.keys(), loc="upper left", fontsize=8, ncols=4, framealpha=0.85)
    column[-1].set_xlabel("time in the run, s", fontsize=8)


def following_figure(found: Following) -> Any:
    """The rates asked for and predicted, on each axis."""
    figure, axes = panels(2, 1, 4.4, width=PAGE_WIDTH)
    for axis, one in zip(axes[:, 0], (found.roll, found.pitch), strict=True):
        own, other = RATES if one.axis == "roll" else RATES[::-1]
        axis.plot(found.t, one.asked, color=BLACK, linewidth=1.0, label=f"{own} asked for")
        axis.plot(found.t, one.own, color=BLUE, linewidth=1.3, linestyle=(0, (5, 1.2)), label=f"{own} predicted")
        axis.plot(found.t, one.other, color=ORANGE, linewidth=1.0, linestyle=(0, (2, 1)), label=f"{other} predicted")
        axis.set_ylabel("rad/s", fontsize=9)
        axis.legend(loc="upper right", fontsize=8, framealpha=0.85)
    axes[-1, 0].set_xlabel("time, s", fontsize=9)
    return figure
