"""Signals as characters: what a plot shows (`model`, `found`), how it becomes rows of characters (`draw`, `paint`)."""

from gcs.tui.plot.bars import bars
from gcs.tui.plot.draw import STYLES, Style, bar, chart, dots_across, envelope, raster, round_limit
from gcs.tui.plot.found import (
    compared,
    densities_plot,
    fallen_plot,
    heat_plot,
    left_bars,
    named_band,
    response_names,
    response_plot,
    spectra_plot,
    strip,
    time_plot,
)
from gcs.tui.plot.heat import HeatPlot, cell_at, heat
from gcs.tui.plot.model import Bar, BarPlot, FrequencyPlot, Ink, Panel, Plot, Reading, Row, TimePlot, View
from gcs.tui.plot.paint import picture
from gcs.tui.plot.ready import Prepared, prepared, readings

__all__ = [
    "STYLES",
    "Bar",
    "BarPlot",
    "FrequencyPlot",
    "HeatPlot",
    "Ink",
    "Panel",
    "Plot",
    "Prepared",
    "Reading",
    "Row",
    "Style",
    "TimePlot",
    "View",
    "bar",
    "bars",
    "cell_at",
    "chart",
    "compared",
    "densities_plot",
    "dots_across",
    "envelope",
    "fallen_plot",
    "heat",
    "heat_plot",
    "left_bars",
    "named_band",
    "picture",
    "prepared",
    "raster",
    "readings",
    "response_names",
    "response_plot",
    "round_limit",
    "spectra_plot",
    "strip",
    "time_plot",
]
