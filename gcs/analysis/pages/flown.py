"""Rates in time as figures: a run measured and modelled, and the answer that gains promise."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from gcs.analysis.pages.page import BLACK, BLUE, GREEN, ORANGE, literal
from gcs.analysis.pages.pictures import COLUMNS, PAGE_WIDTH, panels, thinned
from sysid.control.loop import Following
from sysid.data.dataset import prepared
from sysid.data.record import CHANNELS, RATES, Record
from sysid.fit.simulate import overlay
from sysid.model.structure import Model

FEWEST_COLUMNS = 250
ALL_COLUMNS = 6000
"""On one page, over all of its runs."""
STYLES: tuple[tuple[str, Any], ...] = ((BLUE, (0, (5, 1.2))), (ORANGE, (0, (2, 1))), (GREEN, (0, (1, 1))))
"""Colour and dashes of each model."""


def columns_for(runs: int) -> int:
    """How finely each of so many runs is drawn, for the page to stay small."""
    return max(FEWEST_COLUMNS, min(COLUMNS, ALL_COLUMNS // max(1, runs)))


def run_figure(
    record: Record, models: Sequence[tuple[str, Model]], band_hz: tuple[float, float], columns: int = COLUMNS
) -> Any:
    """One run: commands, then each output measured against each model, as the fit saw them (inside the band)."""
    inputs, outputs = models[0][1].structure.inputs, models[0][1].structure.outputs
    rows = 1 + len(outputs)
    figure, axes = panels(rows, 1, 1.4 + 1.5 * len(outputs), [0.7, *[1.0] * len(outputs)], width=PAGE_WIDTH)
    top, *others = axes[:, 0]
    start = record.t[0]
    for name, colour in zip(inputs, (BLACK, ORANGE, GREEN), strict=False):
        t, values = thinned(record.t - start, record.channels[name], columns)
        top.plot(t, values, color=colour, linewidth=0.6, label=name)
    top.set_ylabel("command, of full", fontsize=9)
    for one in prepared([record], band_hz).viewed(inputs, outputs).spectra:
        for number, ((label, model), (colour, dashes)) in enumerate(zip(models, STYLES, strict=False)):
            t, measured, modelled = overlay(model, one)
            for k, axis in enumerate(others):
                if number == 0:
                    axis.plot(*thinned(t - start, measured[:, k], columns), color=BLACK, lw=1.0, label="measured")
                line = thinned(t - start, modelled[:, k], columns)
                axis.plot(*line, color=colour, lw=1.0, linestyle=dashes, label=literal(label))
    for axis, output in zip(others, outputs, strict=True):
        axis.set_ylabel(f"{output}, {CHANNELS[output]}", fontsize=9)
    for axis in axes[:, 0]:
        axis.set_xlim(0.0, float(record.t[-1] - start))
        handles, labels = axis.get_legend_handles_labels()
        own = dict(zip(labels, handles, strict=True))  # a run in pieces says each once
        axis.legend(own.values(), own.keys(), loc="upper left", fontsize=8, ncols=4, framealpha=0.85)
        axis.tick_params(labelbottom=axis is axes[-1, 0])
    axes[-1, 0].set_xlabel("time in the run, s", fontsize=9)
    return figure


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
