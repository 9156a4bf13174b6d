"""The paper's Figure 5 of a flight, and beside it what was predicted: rates asked for, flown and predicted; steps."""

from __future__ import annotations

from typing import Any

import numpy as np

from gcs.analysis.pages.page import BLACK, BLUE, ORANGE
from gcs.analysis.pages.pictures import GREY, panels
from gcs.analysis.proof import FlownProof
from sysid.control.proof import FlownRun

RATES = ("p", "q")
TITLES = ("roll", "pitch")


def proof_picture(found: FlownProof) -> Any:
    """A column for each axis that was flown: its first run, then the steps of all."""
    runs = found.proof.runs
    axes_flown = sorted({run.axis for run in runs})
    figure, axes = panels(3, len(axes_flown), 9.0, [1.1, 1.1, 1.2])
    for column, axis in enumerate(axes_flown):
        of_axis = [run for run in runs if run.axis == axis]
        _in_time(axes[:2, column], of_axis[0])
        _steps(axes[2, column], of_axis)
    return figure


def _in_time(column: Any, run: FlownRun) -> None:
    t = run.t - run.t[0]
    for panel, rate in zip(column, (run.axis, 1 - run.axis), strict=True):
        panel.plot(t, run.asked[:, rate], color=GREY, linewidth=1.6, label="asked for")
        panel.plot(t, run.measured[:, rate], color=BLACK, linewidth=1.0, label="flown, up to 15 Hz")
        panel.plot(t, run.predicted[:, rate], color=BLUE, linewidth=1.3, linestyle="--", label="predicted")
        panel.set_ylabel(f"{RATES[rate]}, rad/s", fontsize=10)
    most = 1.3 * max(float(np.max(np.abs(x))) for x in (run.asked, run.measured, run.predicted))
    for panel in column:
        panel.set_ylim(-most, most)
    column[0].set_title(f"{TITLES[run.axis]}: {run.id}", fontsize=12, loc="left", fontweight="bold")
    column[0].legend(loc="upper right", ncols=3, fontsize=8, framealpha=0.85)
    column[1].set_xlabel("s", fontsize=10)


def _steps(panel: Any, runs: list[FlownRun]) -> None:
    for number, run in enumerate(runs):
        measured, predicted = run.steps
        first = number == 0
        panel.plot(1000 * measured.t, measured.own, color=BLACK, linewidth=0.9, label="flown" if first else None)
        panel.plot(
            1000 * measured.t, measured.other, color=ORANGE, linewidth=0.9, label="other axis" if first else None
        )
        if first:
            panel.plot(1000 * predicted.t, predicted.own, color=BLUE, linewidth=1.8, linestyle="--", label="predicted")
            panel.plot(1000 * predicted.t, predicted.other, color=BLUE, linewidth=1.4, linestyle=":", label="and other")
    panel.axhline(1.0, color=GREY, linewidth=1.0)
    panel.set_title(f"step of the {TITLES[runs[0].axis]} rate, {len(runs)} runs", fontsize=10, loc="left")
    panel.set_xlabel("ms", fontsize=10)
    panel.set_ylabel("per rate asked for", fontsize=10)
    panel.legend(loc="best", fontsize=9, framealpha=0.85)
