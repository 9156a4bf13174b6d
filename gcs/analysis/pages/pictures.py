"""The drawings that `--plot` writes, as PNG, SVG, or a page with the text; and a comparison drawn.

1200 points wide, one message a panel. Colours are Okabe and Ito's, told apart by colour-blind eyes, and what a line is
never rests on its colour alone: what was measured is black, the model is dashed, noise is a grey area. Matplotlib's
figures are made without its global state, so that drawing works in any thread and without a display.
"""

from __future__ import annotations

import io
import itertools
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from gcs.analysis.pages.page import BLACK, BLUE, GREEN, ORANGE, literal, page
from gcs.analysis.pages.parts import Document, Listing, Part, Picture, Section
from gcs.errors import UsageError
from gcs.files import write_whole
from sysid.compare.values import BandError, Comparison, Densities, ResponseError, Trace
from sysid.data.record import CHANNELS, axis_of
from sysid.model.structure import FloatArray

SKY, YELLOW, PURPLE, GREY = "#56B4E9", "#E69F00", "#CC79A7", "#BBBBBB"
COMMAND_COLOURS = (BLUE, ORANGE, GREEN, PURPLE, YELLOW, SKY)
KINDS = (".png", ".svg", ".html")
DOTS_PER_INCH = 100
WIDTH = 12.0
PAGE_WIDTH = 9.0
"""Inches, in a page that is printed too: letters of 9 points are 7 on paper."""
BESIDE = {"facecolor": "white", "edgecolor": "none", "alpha": 0.8, "pad": 1.0}
"""Behind numbers that stand on lines."""
COLUMNS = 700
"""Of a line in time: two points of each are drawn, so that no peak is lost."""
LARGEST_DB, LARGEST_DEG = 20.0, 180.0
"""Beyond these a mismatch is drawn at the edge."""


def picture_kind(path: Path) -> str:
    """`png`, `svg` or `html`. Raises UsageError for any other ending."""
    if path.suffix.lower() not in KINDS:
        raise UsageError(f"--plot {path}: name a file that ends in .png, .svg or .html")
    return path.suffix.lower()[1:]


def write_picture(path: Path, figure: Any, title: str, text: str = "") -> None:
    """A figure into a file, whole or not at all; a page holds the text as well.

    Raises TippathError where the file cannot be written.
    """
    kind = picture_kind(path)
    if kind == "html":
        parts: tuple[Part, ...] = (*((Listing(text),) if text else ()), Picture(figure, ""))
        content = page(Document(title, "", (Section("", parts),))).encode()
    else:
        stream = io.BytesIO()
        figure.savefig(stream, format=kind, dpi=DOTS_PER_INCH)
        content = stream.getvalue()
    write_whole(content, path)


# ------------------------------------------------------------------------------------------------ comparison


def compare_picture(found: Comparison) -> Any:
    """A column for each axis: the worst run in time, measured and modelled responses and their mismatch, residual
    against frequency, error by band."""
    figure, axes = panels(8, len(found.outputs), 21.5, [1.25, 0.6, 1.0, 0.9, 0.9, 0.9, 1.1, 1.0])
    for k, output in enumerate(found.outputs):
        column = axes[:, k]
        _overlay(column[0], column[1], _worst(found, k), k, output)
        each = [one for one in found.responses if one.mismatch.output == output]
        _responses(column[2], column[3], each, found.band_hz)
        _mismatch(column[4], column[5], each, found.band_hz)
        _spectra(column[6], found.densities, k, found.band_hz)
        _bars(column[7], [one for one in found.bands if one.axis == axis_of(output)])
        nrmse = f"NRMSE fit {found.nrmse_percent[output]:.1f} %"
        if found.noise_floor_percent is not None:
            nrmse += f", with noise alone {found.noise_floor_percent[output]:.1f} %"
        column[0].set_title(f"{axis_of(output)}: {nrmse}", fontsize=12, loc="left", fontweight="bold")
    return figure


def overlay_figure(found: Comparison) -> Any:
    """The worst run of each axis in time, with the residual."""
    figure, axes = panels(2, len(found.outputs), 3.6, [1.25, 0.6], width=PAGE_WIDTH)
    for k, output in enumerate(found.outputs):
        _overlay(axes[0, k], axes[1, k], _worst(found, k), k, output, COLUMNS)
        axes[0, k].set_title(axis_of(output), fontsize=10, loc="left", fontweight="bold")
    return figure


def spectra_figure(found: Comparison) -> Any:
    """Where in frequency the residual lies, over the noise, and the error of each band."""
    figure, axes = panels(2, len(found.outputs), 5.6, width=PAGE_WIDTH)
    for k, output in enumerate(found.outputs):
        _spectra(axes[0, k], found.densities, k, found.band_hz)
        _bars(axes[1, k], [one for one in found.bands if one.axis == axis_of(output)])
        axes[0, k].set_title(axis_of(output), fontsize=10, loc="left", fontweight="bold")
    return figure


def panels(
    rows: int, columns: int, height: float, ratios: Sequence[float] | None = None, *, width: float = WIDTH
) -> tuple[Any, Any]:
    figure = sheet(height, width)
    axes = figure.subplots(rows, columns, squeeze=False, gridspec_kw={"height_ratios": ratios} if ratios else None)
    for axis in axes.flat:
        plain(axis)
    return figure, axes


def sheet(height: float, width: float = WIDTH) -> Any:
    # a second to load: only where something is drawn
    from matplotlib.figure import Figure
    from matplotlib.layout_engine import ConstrainedLayoutEngine

    layout = ConstrainedLayoutEngine(h_pad=0.08, w_pad=0.08)
    return Figure(figsize=(width, height), layout=layout, facecolor="white")


def thinned(t: FloatArray, values: FloatArray, columns: float = COLUMNS) -> tuple[FloatArray, FloatArray]:
    """The least and the largest value of each of so many columns, in their order: (n,) and (n,), or fewer of each."""
    if t.size <= 2 * columns:
        return t, values
    edges = np.linspace(0, t.size, int(columns) + 1).astype(int)
    picked = []
    for low, high in itertools.pairwise(edges):
        part = values[low:high]
        picked += sorted({low + int(np.argmin(part)), low + int(np.argmax(part))})
    at = np.array([0, *picked, t.size - 1])
    return t[at], values[at]


def plain(axis: Any) -> None:
    axis.grid(True, linewidth=0.4, color="#dddddd")
    axis.set_axisbelow(True)
    axis.tick_params(labelsize=9)
    for side in ("top", "right"):
        axis.spines[side].set_visible(False)


def _worst(found: Comparison, k: int) -> Trace:
    """The part of a run with the most error on an axis."""
    return max(found.traces, key=lambda one: float(np.sum(one.residual[k] ** 2)))


def _overlay(above: Any, below: Any, trace: Trace, k: int, output: str, columns: float = math.inf) -> None:
    t = trace.t - trace.t[0]
    above.plot(*thinned(t, trace.measured[k], columns), color=BLACK, linewidth=0.9, label="measured")
    above.plot(
        *thinned(t, trace.modelled[k], columns), color=ORANGE, linewidth=0.8, linestyle=(0, (4, 1.5)), label="model"
    )
    above.set_ylabel(f"{output}, {CHANNELS[output]}", fontsize=10)
    above.legend(loc="upper left", ncols=2, fontsize=9, frameon=False, borderaxespad=0.0)
    above.tick_params(labelbottom=False)
    below.sharex(above)
    below.plot(*thinned(t, trace.residual[k], columns), color=BLUE, linewidth=0.7)
    limit = float(np.max(np.abs(trace.measured[k]))) or 1.0
    above.set_ylim(-1.1 * limit, 1.35 * limit)
    room = max(0.6 * limit, 1.1 * float(np.max(np.abs(trace.residual[k]))))
    below.set_ylim(-room, room)
    below.set_ylabel("residual", fontsize=10)
    below.set_xlabel(literal(f"time in {trace.run}, s"), fontsize=10)
    above.set_xlim(float(t[0]), float(t[-1]))


def _responses(gain: Any, phase: Any, each: Sequence[ResponseError], band_hz: tuple[float, float]) -> None:
    """Measured responses with what noise allows about them, as areas, and the model's, dashed."""
    for one, colour in zip(each, COMMAND_COLOURS, strict=False):
        known = np.isfinite(one.decibels) & np.isfinite(one.allowed_db)
        if not np.any(known):
            continue
        with np.errstate(divide="ignore", invalid="ignore"):
            decibels = np.where(known, 20 * np.log10(np.abs(one.measured)), np.nan)
        degrees = np.full(known.shape, np.nan)
        degrees[known] = np.degrees(np.unwrap(np.angle(one.measured[known])))
        for axis, measured, allowed, off in (
            (gain, decibels, one.allowed_db, one.decibels),
            (phase, degrees, one.allowed_deg, one.degrees),
        ):
            axis.fill_between(one.frequency_hz, measured - allowed, measured + allowed, color=colour, alpha=0.3, lw=0)
            axis.plot(one.frequency_hz, measured, color=colour, linewidth=1.2, label=one.mismatch.command)
            axis.plot(one.frequency_hz, measured + off, color=colour, linewidth=1.4, linestyle=(0, (4, 1.5)))
    for axis, words in ((gain, "measured and model, dB"), (phase, "degrees")):
        logarithmic(axis, band_hz)
        axis.set_ylabel(words, fontsize=10)
    if gain.get_legend_handles_labels()[0]:
        title = "measured, area: what noise allows; dashed: model"
        gain.legend(loc="best", ncols=2, fontsize=9, title=title, title_fontsize=9, framealpha=0.85)
    gain.tick_params(labelbottom=False)


def _mismatch(above: Any, below: Any, each: Sequence[ResponseError], band_hz: tuple[float, float]) -> None:
    """Model less measured in dB and degrees; the areas are what noise allows."""
    for one, colour, style in zip(each, COMMAND_COLOURS, ("-", "--", "-.", ":", "-", "--"), strict=False):
        name = one.mismatch.command
        for axis, values, allowed, largest in (
            (above, one.decibels, one.allowed_db, LARGEST_DB),
            (below, one.degrees, one.allowed_deg, LARGEST_DEG),
        ):
            known = np.isfinite(values) & np.isfinite(allowed)
            if not np.any(known):
                continue
            shown = np.where(known, np.clip(values, -largest, largest), np.nan)
            # no line across the turn from 180 to -180 degrees
            shown[1:][np.abs(np.diff(shown)) > LARGEST_DEG] = np.nan
            room = np.where(known, np.minimum(allowed, largest), np.nan)
            axis.fill_between(one.frequency_hz, -room, room, color=colour, alpha=0.15, linewidth=0)
            axis.plot(one.frequency_hz, shown, color=colour, linestyle=style, linewidth=1.6, label=name)
    for axis, words in ((above, "model less measured, dB"), (below, "degrees")):
        axis.axhline(0, color=BLACK, linewidth=0.6)
        logarithmic(axis, band_hz)
        axis.set_ylabel(words, fontsize=10)
        if not axis.get_legend_handles_labels()[0]:
            axis.text(
                0.5, 0.5, "the runs do not separate the commands", transform=axis.transAxes, ha="center", fontsize=10
            )
    if above.get_legend_handles_labels()[0]:
        above.legend(
            loc="best", ncols=2, fontsize=9, title="area: what noise allows", title_fontsize=9, framealpha=0.85
        )
    above.tick_params(labelbottom=False)


def _spectra(axis: Any, found: Densities, k: int, band_hz: tuple[float, float]) -> None:
    noise = np.maximum(found.noise[:, k], 1e-12)
    axis.plot(found.frequency_hz, found.measured[:, k], color=BLACK, linewidth=1.2, label="measured")
    axis.plot(found.frequency_hz, found.residual[:, k], color=BLUE, linewidth=1.8, label="residual")
    noise_area(axis, found.frequency_hz, noise)
    low = max(0.3 * float(np.min(noise)), 1e-3 * float(np.max(found.measured[:, k])))
    axis.set_yscale("log")
    axis.set_ylim(max(low, 1e-9), 2 * float(max(np.max(found.measured[:, k]), np.max(noise), 1e-6)))
    logarithmic(axis, band_hz)
    axis.set_ylabel("(rad/s)/√Hz", fontsize=10)
    axis.set_xlabel("frequency, Hz", fontsize=10)
    axis.legend(loc="best", ncols=3, fontsize=9, framealpha=0.85)


def noise_area(axis: Any, frequency_hz: FloatArray, noise: FloatArray) -> None:
    axis.fill_between(frequency_hz, 1e-12, noise, color=GREY, alpha=0.6, linewidth=0, label="noise")


def logarithmic(axis: Any, band_hz: tuple[float, float]) -> None:
    """The band on a logarithmic scale, labelled with plain numbers."""
    low, high = max(band_hz[0], 0.25), band_hz[1]
    axis.set_xscale("log")
    axis.set_xlim(min(low, 0.5 * high), high)
    ticks = [f for f in (0.1, 0.2, 0.5, 1, 2, 5, 10, 20, 50) if min(low, 0.5 * high) <= f <= high]
    axis.set_xticks(ticks, [f"{f:g}" for f in ticks])
    axis.set_xticks([], minor=True)


def _bars(axis: Any, bands: Sequence[BandError]) -> None:
    """Error by band, divided into what follows the commands, other error, and noise."""
    place = np.arange(len(bands))
    whole = np.array([100 * one.error_share for one in bands])
    noise = whole * np.array([one.noise_share or 0.0 for one in bands])
    linear = np.minimum(whole * np.array([one.coherence_together for one in bands]), whole - noise)
    other = whole - noise - linear
    axis.bar(place, linear, color=BLUE, width=0.75, label="follows the commands")
    axis.bar(place, other, bottom=linear, color=SKY, width=0.75, label="other error")
    axis.bar(place, noise, bottom=linear + other, color=GREY, width=0.75, label="noise")
    for x, y in zip(place, whole, strict=True):
        axis.text(x, y + 0.02 * float(np.max(whole)), f"{y:.0f}", ha="center", va="bottom", fontsize=9)
    axis.set_xticks(place, [f"{one.low_hz:.2g}-{one.high_hz:.2g}" for one in bands])
    wide = axis.get_figure().get_figwidth() == WIDTH
    axis.set_ylim(0, (1.3 if wide else 1.6) * float(np.max(whole)))  # room for the legend above the bars
    axis.grid(False, axis="x")
    axis.set_ylabel("% of the error", fontsize=10)
    axis.set_xlabel("band, Hz", fontsize=10)
    axis.tick_params(axis="x", labelsize=9 if wide else 7)
    axis.legend(loc="upper right", ncols=3 if wide else 1, fontsize=9 if wide else 8, frameon=False)
