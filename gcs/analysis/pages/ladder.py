"""The ladder drawn: the error that is left, rung by rung."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from gcs.analysis.ladder import Nrmse, RungNumbers
from gcs.analysis.pages.page import BLACK, BLUE, ORANGE, literal
from gcs.analysis.pages.pictures import BESIDE, GREY, WIDTH, panels
from sysid.data.record import FloatArray, axis_of

LOW = 0.15
"""Of the largest error: less is drawn at the foot of the figure."""


def ladder_picture(
    rungs: Sequence[RungNumbers],
    floor: Nrmse | None,
    placebo: RungNumbers | None = None,
    *,
    width: float = WIDTH,
) -> Any:
    """Error that is left, 100 less the NRMSE fit in percent, rung by rung: fitted, validation, and noise's part.

    The numbers are the NRMSE fit of the fitted runs. placebo: the best wrong effect in place of the last rung's.
    """
    outputs = tuple(rungs[0][1])
    figure, axes = panels(1, len(outputs), 5.0 if width == WIDTH else 3.8, width=width)
    place = np.arange(len(rungs), dtype=float)
    for k, output in enumerate(outputs):
        axis = axes[0, k]
        fitted = np.array([100 - values[output] for _, values, _ in rungs])
        judged = np.array([np.nan if values is None else 100 - values[output] for _, _, values in rungs])
        axis.plot(place, fitted, color=BLUE, marker="o", markersize=7, linewidth=2, label="fitted runs")
        if np.any(np.isfinite(judged)):
            axis.plot(
                place, judged, color=ORANGE, marker="s", markersize=6, linewidth=1.6, linestyle="--", label="validation"
            )
        top = float(np.nanmax(np.concatenate([fitted, judged])))
        if placebo is not None:
            wrong = 100 - placebo[1][output]
            axis.plot(
                [place[-1] + 0.12],
                [wrong],
                linestyle="none",
                marker="^",
                markersize=8,
                markerfacecolor="white",
                markeredgecolor=BLACK,
                label=literal(f"placebo: {placebo[0]}"),
            )
            top = max(top, wrong)
        if floor is not None:
            level = 100 - floor[output]
            axis.axhspan(0, level, color=GREY, alpha=0.6, linewidth=0, label="noise")
            top = max(top, level)
        _write_numbers(axis, fitted, top)
        axis.set_ylim(0, 1.25 * top)
        axis.set_xlim(-0.5, len(rungs) - 0.5)
        axis.grid(False, axis="x")
        names = [literal(label).replace(" + ", "\n+ ") for label, _, _ in rungs]
        turned = len(rungs) > 4
        axis.set_xticks(place, names, rotation=25 if turned else 0, ha="right" if turned else "center")
        told = ": the error left; numbers: NRMSE fit" if width == WIDTH else ""
        axis.set_title(f"{axis_of(output)}{told}", fontsize=11, loc="left", fontweight="bold")
        axis.set_ylabel("100 less NRMSE fit, %", fontsize=10)
        axis.legend(loc="upper right", fontsize=9, frameon=False)
    return figure


def _write_numbers(axis: Any, left: FloatArray, top: float) -> None:
    """The NRMSE fit at each rung's error that is left, (n,); below it, unless the rungs' names stand there."""
    style = {"textcoords": "offset points", "ha": "center", "fontsize": 9, "bbox": BESIDE}
    for x, y in enumerate(left):
        axis.annotate(f"{100 - y:.1f} %", (x, y), (0, 10 if y < LOW * top else -19), **style)
