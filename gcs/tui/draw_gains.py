"""What gains promise and what they flew, as plots: answers side by side, the paper's Figure 5 of a proof."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from gcs.tui.gains_words import Column
from gcs.tui.plot import Panel, TimePlot

if TYPE_CHECKING:
    from gcs.analysis.proof import FlownProof
    from sysid.control.loop import Following
    from sysid.control.proof import FlownRun


def answers(beside: Sequence[Column], axis: int) -> TimePlot | None:
    """The predicted answers to a doublet on roll (0) or pitch (1), of the last two sets of gains; None without any."""
    known = [(one.head, one.following) for one in beside if one.following is not None][-2:]
    if not known:
        return None
    name, new = known[-1]
    old = known[0][1] if len(known) > 1 else None
    one = (new.roll, new.pitch)[axis % 2]
    panels = [
        _panel(new, old, axis, rate, asked=one.asked if rate == ("p", "q")[axis % 2] else None) for rate in ("p", "q")
    ]
    panels += [_panel(new, old, axis, command, asked=None) for command in ("delta_x", "delta_y")]
    words = (name, "asked for", "") if old is None else (name, known[0][0], "asked for, either way")
    return TimePlot(panels=tuple(panels), title=f"{one.axis} doublet, predicted", words=words)


LABELS = {"p": "p", "q": "q", "delta_x": "δx", "delta_y": "δy"}


def _panel(new: Following, old: Following | None, axis: int, what: str, asked: np.ndarray | None) -> Panel:
    first = getattr((new.roll, new.pitch)[axis % 2], what)
    before = asked if old is None else getattr((old.roll, old.pitch)[axis % 2], what)
    rate = what in ("p", "q")
    return Panel(
        name=LABELS[what],
        x=new.t,
        line=first,
        over=before,
        reference=None if asked is None or old is None else np.abs(asked),
        unit="rad/s" if rate else "of full",
        least=0.1 if rate else 0.05,
        weight=2.0 if rate else 1.0,
    )


def flown(found: FlownProof, part: int) -> TimePlot:
    """One run of a proof: rates flown, predicted over them, what was asked as a strip of its own."""
    run: FlownRun = found.proof.runs[part % len(found.proof.runs)]
    t = run.t - run.t[0]
    largest = max(float(np.max(np.abs(one))) for one in (run.asked, run.measured, run.predicted))
    largest = math.ceil(10 * largest) / 10
    panels = [Panel(name="asked", x=t, line=run.asked[:, run.axis], unit="rad/s", fixed=(-largest, largest))]
    panels += [
        Panel(
            name="pq"[rate],
            x=t,
            line=run.measured[:, rate],
            over=run.predicted[:, rate],
            unit="rad/s",
            fixed=(-largest, largest),
            weight=2.0,
        )
        for rate in (run.axis, 1 - run.axis)
    ]
    title = f"{run.id}: {'roll' if run.axis == 0 else 'pitch'}, NRMSE {run.nrmse_percent[0]:.0f} %"
    return TimePlot(panels=tuple(panels), title=title, words=("flown", "predicted", ""))
