"""Gains over input cost, drawn: what a cheaper input buys, and what it costs."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from gcs.analysis.pages.page import BLACK, BLUE, ORANGE
from gcs.analysis.pages.pictures import GREY, panels
from sysid.control.judgement import Limits
from sysid.control.over_costs import AtCost
from sysid.control.stability import Margins
from sysid.model.structure import FloatArray

MOST_DB, MOST_DEG, MOST_MS = 40.0, 180.0, 150.0
"""Where a margin that is larger, or any, is drawn."""


def costs_picture(costs: Sequence[AtCost], asked: float, limits: Limits) -> Any:
    """Four panels over the input cost: K, gain margin, phase and delay margin, the answer to a doublet.

    Margins are the least on any model, the answer is the fit's; a cost that is not held on every model has no margins.
    """
    figure, axes = panels(2, 2, 8.0)
    (gains, gain_db), (phase, answer) = axes
    R = np.array([one.gains.input_cost for one in costs])

    def values(of: Callable[[AtCost], float | None], most: float = math.inf) -> FloatArray:
        each = (of(one) for one in costs)
        return np.array([math.nan if value is None else min(value, most) for value in each])

    _line(gains, R, values(lambda one: one.rate_gain), BLUE, "o", "rates, full command per rad/s")
    _line(gains, R, values(lambda one: one.flapping_gain), ORANGE, "s", "flapping, per rad")
    gains.set_yscale("log")
    _titled(gains, "largest of K")
    margin = "least on any model"
    _line(gain_db, R, values(lambda one: _of(one.least, "gain_db"), MOST_DB), BLUE, "o", margin)
    _limit(gain_db, limits.gain_db, f"asked {limits.gain_db:g} dB")
    _titled(gain_db, "gain margin, dB")
    _line(phase, R, values(lambda one: _of(one.least, "phase_deg"), MOST_DEG), BLUE, "o", "phase, °")
    _line(phase, R, values(lambda one: _of(one.least, "delay_ms"), MOST_MS), ORANGE, "s", "delay, ms")
    _limit(phase, limits.phase_deg, f"asked {limits.phase_deg:g}°")
    _limit(phase, limits.delay_ms, f"asked {limits.delay_ms:g} ms", ":")
    _titled(phase, f"phase and delay margin (at the top: {MOST_DEG:g}° or {MOST_MS:g} ms and more)")
    percent = [
        values(lambda one: one.judgement.models[0].overshoot),
        values(lambda one: one.judgement.models[0].coupling),
    ]
    for what, marker, colour, line in zip(("overshoot", "other axis"), "os", (BLUE, ORANGE), percent, strict=True):
        _line(answer, R, 100 * line, colour, marker, what)
    _limit(answer, 100 * limits.coupling, f"allowed {100 * limits.coupling:g} %")
    _titled(answer, "answer to a doublet of the rate command, on the fit, %")
    for axis in axes.flat:
        axis.set_xscale("log")
        axis.axvline(asked, color=GREY, linewidth=6, alpha=0.5, zorder=0)
        axis.set_xticks(R, [f"{value:g}" for value in R], minor=False)
        axis.minorticks_off()
        if axis is not gains:
            axis.set_ylim(bottom=0)
        axis.legend(fontsize=9)
    for axis in axes[1]:
        axis.set_xlabel("input cost (the bar: the one designed with)")
    return figure


def _of(margins: Margins | None, name: str) -> float | None:
    return None if margins is None else float(getattr(margins, name))


def _line(axis: Any, x: FloatArray, y: FloatArray, colour: str, marker: str, label: str) -> None:
    dashes = "-" if marker == "o" else "--"
    axis.plot(x, y, color=colour, marker=marker, markersize=6, linewidth=1.8, linestyle=dashes, label=label)


def _limit(axis: Any, value: float, label: str, dashes: str = "-.") -> None:
    axis.axhline(value, color=BLACK, linewidth=1.0, linestyle=dashes, label=label)


def _titled(axis: Any, title: str) -> None:
    axis.set_title(title, fontsize=11, loc="left", fontweight="bold")
