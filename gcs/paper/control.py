"""Section 5: Figure 5, the rates that the LQR follows."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from gcs.analysis.following import Following, following
from gcs.errors import TippathError
from gcs.logs import resolve_runs
from gcs.logs.formats import dataflash
from gcs.logs.formats.dataflash_table import DataFlashTables
from gcs.paper.rows import panel
from gcs.paper.values import PaperFigure, PaperTable, Row
from sysid.control.regulator import Gains
from sysid.data.record import FloatArray

LETTERS = {"p": "R", "q": "P"}
"""Of the log's RATE message."""
AXES = {"roll": "p", "pitch": "q"}

Traces = dict[str, FloatArray]
"""`t`, `pulse`, and of p and q what was asked for and what came: (n,), rad/s."""


def read_rates(log: Path) -> list[tuple[str, Traces]]:
    """Of each maneuver its axis, and the rates asked for and measured. Raises TippathError without them."""
    tables = DataFlashTables(dataflash.read(log).boots[-1], str(log))
    found = []
    for record in resolve_runs([str(log)]):
        start, stop = float(record.t[0]), float(record.t[-1])
        names = {f"{rate}{word}": f"RATE.{letter}{word}" for rate, letter in LETTERS.items() for word in ("Des", "")}
        if record.axis not in AXES or not all(tables.has(name) for name in (*names.values(), "SIDD.Targ")):
            raise TippathError(f"{record.id}: no samples of the commanded rate in {log}")
        series = {key: tables.series(name).part(start, stop) for key, name in names.items()}
        target, t = tables.series("SIDD.Targ").part(start, stop), series["p"].t
        traces = {key: np.radians(np.interp(t, one.t, one.values)) for key, one in series.items()}  # logged in deg/s
        found.append((record.axis, {**traces, "t": t, "pulse": np.interp(t, target.t, target.values)}))
    return found


def followed(runs: Sequence[tuple[str, Traces]]) -> list[Following]:
    """How each maneuver's own rate followed."""
    return [following(axis, one["t"], one[f"{AXES[axis]}Des"], one[AXES[axis]], one["pulse"]) for axis, one in runs]


def peak(measured: FloatArray, commanded: FloatArray) -> float:
    """The largest rate over the largest that was asked for."""
    return float(np.max(np.abs(measured)) / np.max(np.abs(commanded)))


def following_figure(runs: Sequence[tuple[str, Traces]]) -> PaperFigure:
    """Figure 5."""
    lines: dict[str, list[tuple[str, FloatArray, FloatArray]]] = {"p": [], "q": []}
    at = 0.0
    for _, one in runs:
        t = one["t"] - one["t"][0] + at
        for rate, drawn in lines.items():
            drawn += [("commanded", t, one[f"{rate}Des"]), ("measured", t, one[rate])]
        at = float(t[-1])
    return PaperFigure(
        label="Figure 5",
        caption="The LQR on our fit, input cost 5: doublets of the commanded rate, roll first, then pitch.",
        panels=tuple(panel(f"{rate}, rad/s", drawn) for rate, drawn in lines.items()),
    )


def following_table(runs: Sequence[tuple[str, Traces]], gains: Gains) -> PaperTable:
    """How the rates followed, and how much the other axis took: the paper says it in words alone."""
    rows = []
    for (axis, one), found in zip(runs, followed(runs), strict=True):
        own, other = AXES[axis], "q" if axis == "roll" else "p"
        share = float(np.std(one[other] - one[f"{other}Des"]) / np.std(one[own]))
        beside: dict[str, float | None] = {
            "correlation": found.correlation,
            "lag, ms": 1000 * found.lag_s,
            "steady, %": 100 * found.steady_share,
            "peak, %": 100 * peak(one[own], one[f"{own}Des"]),
            "other axis, %": 100 * share,
        }
        rows.append(Row(name=f"{axis} rate", beside=beside, digits=2))
    peaks = ", ".join(f"{axis} {100 * peak(one[AXES[axis]], one[f'{AXES[axis]}Des']):.0f} %" for axis, one in runs)
    why = (
        "The paper says in words: roll is delayed, but follows; pitch shows coupling with roll, and is larger than "
        "what "
        f"was commanded. Here the sticks are doublets of the autopilot, so that it can be measured: peaks of {peaks} "
        "of "
        "the largest command, steady less; other axis: how far the other rate moved from its command, over the motion "
        "of this one.",
        f"Delay margin of this loop on its model: {gains.margins.delay_ms:.0f} ms; what lags and is in no model of "
        "section "
        "5 comes out of that.",
        "How much of the steady shortfall is the servos' play and how much the fit's was not worked out.",
    )
    return PaperTable(
        label="Section 5, following",
        caption="How the measured rate followed the commanded one (best lag), with the LQR in control.",
        rows=tuple(rows),
        columns=("correlation", "lag, ms", "steady, %", "peak, %", "other axis, %"),
        shows_percent=False,
        shows_values=False,
        why=why,
    )
