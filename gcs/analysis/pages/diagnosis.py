"""A diagnosis drawn: what each candidate explains, and the residual before and with the best."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from gcs.analysis.candidates import ranked, shows
from gcs.analysis.diagnosis import FitDiagnosis
from gcs.analysis.ladder import short_names
from gcs.analysis.pages.page import BLACK, BLUE, ORANGE, literal
from gcs.analysis.pages.pictures import BESIDE, SKY, WIDTH, logarithmic, noise_area, plain, sheet
from sysid.compare.compare import compare
from sysid.compare.values import Densities
from sysid.data.record import RATES, axis_of
from sysid.diagnose.candidates import Ranked
from sysid.diagnose.shares import least

DRAWN = 12
"""Candidates in the picture."""
Share = tuple[str, float | None, str]
"""A candidate's label, what it explains (0..1; None where it is not testable), and a note."""

NOTE_AFTER = 46.0, 82.0
"""Points right of a bar where a candidate's note begins: behind its percentage, or behind "not testable"."""


def drawn(found: FitDiagnosis) -> Any:
    """The picture of a diagnosis: what each candidate explains, and the residual before and with the best."""
    last = found.last
    shares = [_share(one) for one in ranked(last)[:DRAWN] if shows(one, last)]
    winner = last.winner
    best = None if winner is None or winner.fit is None else compare(winner.fit.model, found.runs, found.fit.band_hz)
    label = " + ".join(short_names(last.chain))
    answer = f": {label}" if last.verdict == "missing" else f": {label} stands in" if last.stands_in else ""
    head = f"{last.verdict}{answer}, confidence {last.confidence:.2f}"
    return diagnosis_picture(
        shares,
        found.comparison.densities,
        None if best is None or last.verdict == "complete" else best.densities,
        f"with {label}",
        outputs=last.parent.model.structure.outputs,
        title=f"{head}{'; candidates, the answer first' if shares else ''}",
        needed=least(last.division),
    )


def _share(judged: Ranked) -> Share:
    note = "implausible: " + ", ".join(judged.implausible) if judged.implausible else ""
    return " + ".join(short_names(judged.effects)), judged.explained_share, note


def diagnosis_picture(
    candidates: Sequence[Share],
    parent: Densities,
    best: Densities | None = None,
    best_label: str = "best candidate",
    outputs: Sequence[str] = RATES,
    title: str = "",
    width: float = WIDTH,
    needed: float | None = None,
) -> Any:
    """Bars of what each candidate explains of what can be explained, and the residuals against the noise.

    candidates: best first; the first bar is dark, those with a note are empty. parent, best: spectra of the residual
    before and with the best candidate. title: the answer. needed: share from which on one is named, if that is known.
    """
    tall = 0.36 * max(1, len(candidates)) + 1.0
    figure = sheet(tall + (4.4 if width == WIDTH else 3.0), width)
    grid = figure.add_gridspec(2, len(outputs), height_ratios=[tall, 4.0])
    axis = figure.add_subplot(grid[0, :])
    plain(axis)
    _draw_shares(axis, candidates, needed)
    axis.set_title(literal(title), fontsize=12, loc="left", fontweight="bold")
    for k, output in enumerate(outputs):
        panel = figure.add_subplot(grid[1, k])
        plain(panel)
        _draw_residual(panel, parent, best, best_label, k)
        panel.set_title(f"{axis_of(output)}: residual", fontsize=11, loc="left", fontweight="bold")
    return figure


def _draw_shares(axis: Any, candidates: Sequence[Share], needed: float | None) -> None:
    """A bar for each candidate, with its percentage and its note, and the share that is needed."""
    shares = [0.0 if share is None else float(np.clip(share, 0, 1)) for _, share, _ in candidates]
    place = np.arange(len(candidates))
    colours = [BLUE if number == 0 else SKY for number in range(len(candidates))]
    filled = ["white" if note else colour for colour, (_, _, note) in zip(colours, candidates, strict=True)]
    axis.barh(place, [100 * share for share in shares], color=filled, height=0.7, edgecolor=colours)
    for y, (share, (_, testable, note)) in enumerate(zip(shares, candidates, strict=True)):
        said = "not testable" if testable is None else f"{100 * share:.0f} %"
        axis.text(100 * share + 0.8, y, said, va="center", fontsize=9, bbox=BESIDE)
        after = NOTE_AFTER[testable is None]
        axis.annotate(
            literal(note),
            (100 * share, y),
            (after, 0),
            textcoords="offset points",
            va="center",
            fontsize=9,
            bbox=BESIDE,
        )
    if candidates and needed is not None:
        axis.axvline(100 * needed, color=BLACK, linewidth=0.8, linestyle=":")
        axis.text(100 * needed, -0.62, "needed to be named", ha="center", va="bottom", fontsize=8, bbox=BESIDE)
    if not candidates:
        axis.text(50, -0.1, "nothing was refitted: there is nothing to explain", ha="center", fontsize=10)
    axis.set_yticks(place, [literal(label) for label, _, _ in candidates])
    axis.set_ylim(max(1, len(candidates)) - 0.4, -1.1)
    axis.set_xlim(0, 150 if any(note for _, _, note in candidates) else 108)
    axis.set_xticks([0, 20, 40, 60, 80, 100])
    axis.set_xlabel("avoidable error that it removes, %", fontsize=10, loc="left")


def _draw_residual(panel: Any, parent: Densities, best: Densities | None, best_label: str, k: int) -> None:
    """The residual of one output now and with the best, against the noise."""
    noise = np.maximum((best or parent).noise[:, k], 1e-12)
    panel.plot(parent.frequency_hz, parent.residual[:, k], color=ORANGE, linewidth=1.6, label="now")
    if best is not None:
        panel.plot(
            best.frequency_hz, best.residual[:, k], color=BLUE, linewidth=1.8, linestyle="--", label=literal(best_label)
        )
    noise_area(panel, (best or parent).frequency_hz, noise)
    panel.set_yscale("log")
    top = float(max(np.max(parent.residual[:, k]), np.max(noise)))
    panel.set_ylim(0.3 * float(np.min(noise)), 3 * top)
    logarithmic(panel, (0.0, float(parent.frequency_hz[-1])))
    panel.set_ylabel("(rad/s)/√Hz", fontsize=10)
    panel.set_xlabel("frequency, Hz", fontsize=10)
    wide = panel.get_figure().get_figwidth() == WIDTH
    panel.legend(loc="upper right", ncols=3 if wide else 1, fontsize=9 if wide else 8, framealpha=0.85)
