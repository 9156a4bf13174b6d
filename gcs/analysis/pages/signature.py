"""Signatures of effects drawn: what each does to the paper's vehicle, by frequency and in time."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from gcs.analysis.pages.page import BLACK, BLUE, ORANGE
from gcs.analysis.pages.pictures import logarithmic, panels, plain, sheet
from gcs.analysis.text.signature import held_words
from sysid.model.signature import FREQUENCY_HZ, Signature

COLUMNS = 5
CELL_HEIGHT = 2.1
DASHED = (0, (4, 1.5))


def signature_picture(found: Signature) -> Any:
    """One effect: how gain and phase change, where that can be said, and the answer to doublets with it and without."""
    linear = found.decibels is not None
    figure, axes = panels(4 if linear else 2, 1, 9.0 if linear else 5.0)
    rows = [axis[0] for axis in axes]
    rows[0].set_title(f"{found.effect.id}: {found.effect.title}", fontsize=12, loc="left", fontweight="bold")
    if linear:
        _change(rows[0], found.decibels, "change of gain, dB", 1.0)
        _change(rows[1], turned(found.degrees), "change of phase, deg", 10.0)
        rows[0].tick_params(labelbottom=False)
        rows[1].set_xlabel(f"frequency, Hz, of {found.output} from {found.command}", fontsize=10)
    _in_time(rows[-2], rows[-1], found)
    return figure


def signatures_picture(each: Sequence[Signature]) -> Any:
    """Many effects, small: gain and phase where they are linear, else the change in time."""
    rows = -(-len(each) // COLUMNS)
    height = CELL_HEIGHT * rows
    figure = sheet(height)
    figure.set_layout_engine(None)  # of so many axes it takes ten seconds
    figure.subplots_adjust(left=0.04, right=0.96, top=1 - 0.3 / height, bottom=0.65 / height, wspace=0.55, hspace=0.45)
    axes = figure.subplots(rows, COLUMNS, squeeze=False).ravel()
    for axis, found in zip(axes, each, strict=False):
        plain(axis)
        axis.set_title(found.effect.id, fontsize=9, fontweight="bold")
        axis.tick_params(labelsize=7)
        (_cell_in_time if found.decibels is None else _cell_by_frequency)(axis, found)
    for axis in axes[len(each) :]:
        axis.set_visible(False)
    figure.supxlabel(
        "blue: change of gain, dB, left; orange, dashed: of phase, deg, right, over Hz. "
        "Black: change of the rate in time, rad/s, over s",
        fontsize=9,
        y=0.12 / height,
    )
    return figure


def turned(degrees: Any) -> Any:
    """Without the lines across the turn from 180 to -180 degrees."""
    return np.where(np.abs(np.diff(degrees, append=degrees[-1])) > 180, np.nan, degrees)


def _change(axis: Any, values: Any, words: str, least: float) -> None:
    axis.plot(FREQUENCY_HZ, values, color=BLUE, linewidth=1.6)
    axis.axhline(0, color=BLACK, linewidth=0.6)
    _at_least(axis, values, least)
    logarithmic(axis, (float(FREQUENCY_HZ[0]), float(FREQUENCY_HZ[-1])))
    axis.set_ylabel(words, fontsize=10)


def _at_least(axis: Any, values: Any, least: float) -> None:
    """Nothing looks like much on a scale of its own."""
    low, high = float(np.nanmin(values)), float(np.nanmax(values))
    axis.set_ylim(min(1.08 * low, 0.08 * low, -least), max(1.08 * high, 0.08 * high, least))


def _in_time(above: Any, below: Any, found: Signature) -> None:
    above.plot(found.t, found.without, color=BLACK, linewidth=1.0, label="without it")
    above.plot(found.t, found.with_effect, color=ORANGE, linewidth=1.2, linestyle=DASHED, label="with it")
    above.set_ylabel(f"{found.output}, rad/s", fontsize=10)
    above.legend(loc="upper right", ncols=2, fontsize=9, frameon=False)
    above.tick_params(labelbottom=False)
    below.sharex(above)
    below.plot(found.t, found.with_effect - found.without, color=BLUE, linewidth=1.2)
    below.axhline(0, color=BLACK, linewidth=0.6)
    below.set_ylabel("change, rad/s", fontsize=10)
    below.set_xlabel(f"s; doublets of {found.command}, a large one and a small one{held_words(found)}", fontsize=10)
    above.set_xlim(float(found.t[0]), float(found.t[-1]))


def _cell_by_frequency(axis: Any, found: Signature) -> None:
    axis.plot(FREQUENCY_HZ, found.decibels, color=BLUE, linewidth=1.3)
    _at_least(axis, found.decibels, 1.0)
    other = axis.twinx()
    other.plot(FREQUENCY_HZ, turned(found.degrees), color=ORANGE, linewidth=1.3, linestyle=DASHED)
    _at_least(other, found.degrees, 10.0)
    other.tick_params(labelsize=7)
    other.spines["top"].set_visible(False)
    logarithmic(axis, (float(FREQUENCY_HZ[0]), float(FREQUENCY_HZ[-1])))
    axis.tick_params(labelsize=7)


def _cell_in_time(axis: Any, found: Signature) -> None:
    axis.plot(found.t, found.with_effect - found.without, color=BLACK, linewidth=1.1)
    axis.set_xlim(float(found.t[0]), float(found.t[-1]))
