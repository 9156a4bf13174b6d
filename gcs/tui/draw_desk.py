"""From what lies on the desk to plots."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from gcs.analysis.ladder import errors_left
from gcs.analysis.overlays import in_band, loud, modelled_by
from gcs.desk.state import DeskState
from gcs.tui.plot import BarPlot, FrequencyPlot, Panel, TimePlot, fallen_plot, left_bars, round_limit, time_plot
from gcs.tui.plot.model import FloatArray

if TYPE_CHECKING:
    from sysid.compare.values import Comparison
    from sysid.fit.result import Fit

COMMANDS = (("delta_x", "δx"), ("delta_y", "δy"), ("delta_e", "δe"))
LEAST_RESIDUAL = 0.01


@dataclass(frozen=True, eq=False, slots=True)
class Other:
    """A model to be set beside that of the top rung."""

    name: str
    fit: Fit
    comparison: Comparison | None
    """Its own, where it was compared."""


def others(desk: DeskState) -> list[Other]:
    """The rungs below the top one, the nearest first; then the fit of the other base."""
    found = [Other(one.name, one.fit, one.comparison) for one in reversed(desk.ladder[:-1])]
    if desk.fitted is not None and desk.ladder:
        base = desk.ladder[0].fit.model.structure.base
        found += [
            Other(fit.model.structure.title, fit, None)
            for fit in (desk.fitted.found.tpp, desk.fitted.found.cd)
            if fit.model.structure.base != base
        ]
    return found


def modelled_of(desk: DeskState, other: Other, part: int) -> FloatArray | None:
    """What another model makes of a part of a run of the top rung's comparison, (k, n); None: not known."""
    top = desk.comparison
    assert top is not None
    trace = top.traces[part]
    if other.comparison is not None and len(other.comparison.traces) == len(top.traces):
        own = other.comparison.traces[part]
        if own.run == trace.run and own.t.size == trace.t.size:
            return own.modelled
    for rung in reversed(desk.ladder):
        if rung.comparison is not None and len(rung.comparison.traces) == len(top.traces):
            found = modelled_by(rung.comparison.traces[part], rung.fit.model, other.fit.model)
            if found is not None and found.shape == trace.measured.shape:
                return found
    return None


def residual_scales(desk: DeskState) -> list[float]:
    """Of each output the largest residual of any rung: all are drawn on that scale, so that a smaller one looks so."""
    top = desk.comparison
    if top is None or not top.traces:
        return []
    compared = [one.comparison for one in desk.ladder if one.comparison is not None]
    traces = [trace for one in compared for trace in one.traces]
    peaks = [
        max(float(np.max(np.abs(one.residual[k]), initial=0.0)) for one in traces) for k in range(len(top.outputs))
    ]
    return [round_limit(peak, LEAST_RESIDUAL) for peak in peaks]


@dataclass(frozen=True, slots=True, kw_only=True)
class Look:
    """What of the runs is looked at."""

    part: int = 0
    """Of the comparison's traces; any number, counted round."""
    beside: int = 0
    """How many other models were stepped through: 0 none, then each, then all residuals; counted round."""
    both: bool = True
    """Every command that moves; else the one that moves most."""
    output: int | None = None
    """The only output that is drawn,"""
    band_hz: tuple[float, float] | None = None
    """and the band in which its residual is drawn once more."""


def run_strips(desk: DeskState, look: Look) -> TimePlot | None:
    """u, p, q with the model over them and the residuals below; None where nothing was compared yet."""
    found = desk.comparison
    if found is None or not found.traces:
        return None
    part = look.part % len(found.traces)
    trace, scales = found.traces[part], residual_scales(desk)
    asked = others(desk) if look.beside else []
    known = [(one.name, modelled) for one in asked if (modelled := modelled_of(desk, one, part)) is not None]
    step = look.beside % (len(known) + 1 + (len(known) > 1))
    other = known[step - 1] if 1 <= step <= len(known) else None
    wanted = range(len(found.outputs)) if look.output is None else [look.output % len(found.outputs)]
    more: dict[int, list[Panel]] = {k: [] for k in wanted}
    shaded: tuple[tuple[float, float], ...] = ()
    for k in wanted:
        for name, modelled in known if step > len(known) else ():
            more[k].append(_residual(name, trace.t, trace.measured[k] - modelled[k], scales[k]))
        if look.band_hz is not None:
            inside = in_band(trace.t, trace.residual[k], look.band_hz)
            more[k].append(_residual("in band", trace.t, inside, scales[k]))
            shaded = loud(trace.t, inside)
    return time_plot(
        found,
        part,
        outputs=wanted,
        commands=commands_of(found, part, both=look.both),
        other=other,
        residual_least=scales,
        more=more,
        shaded=shaded,
    )


def _residual(name: str, t: FloatArray, values: FloatArray, least: float) -> Panel:
    return Panel(name=name, x=t, line=values, unit="rad/s", least=least, residual=True)


def worst_part(found: Comparison, k: int, band_hz: tuple[float, float]) -> int:
    """The part of a run with the most error of output k in a band."""
    errors = [float(np.sum(in_band(one.t, one.residual[k], band_hz) ** 2)) for one in found.traces]
    return int(np.argmax(errors)) if errors else 0


def commands_of(found: Comparison, part: int, *, both: bool) -> dict[str, FloatArray]:
    """Name -> the command on the trace's own time."""
    commands = found.traces[part].commands
    moving = {name: commands[key] for key, name in COMMANDS if key in commands and np.ptp(commands[key]) > 0}
    if not both and moving:
        most = max(moving, key=lambda name: float(np.std(moving[name])))
        return {most: moving[most]}
    return moving


def waterfall(desk: DeskState, most: int) -> BarPlot:
    """What each rung leaves of the lowest one's error, for each axis, in at most so many bars where that can be: the
    lowest and the highest rungs of each."""
    rungs = [(one.name, one.nrmse_percent, one.validation_nrmse_percent) for one in desk.ladder]
    wrong = [None if one.placebo is None else one.placebo[1] for one in desk.ladder]
    floor = desk.noise_floor_percent
    each = errors_left(rungs, wrong, floor)
    title = "error beyond noise" if floor is not None else "error (noise unknown)"
    shown = [(name, left) for (name, _, _), left in zip(rungs, each, strict=True)]
    top = max(most // max(len(each[0]), 1) - 1, 1)
    return left_bars(shown if len(shown) <= top + 1 else [shown[0], *shown[-top:]], f"{title}; NRMSE fitted/valid.")


def fallen(desk: DeskState) -> FrequencyPlot | None:
    """Residual spectra of the top rung over those of the one below; None where it was not compared yet."""
    top = desk.current
    if top is None or top.comparison is None:
        return None
    below = [one for one in desk.ladder[:-1] if one.comparison is not None]
    before = None
    if below and below[-1].comparison is not None:
        before = below[-1].name, below[-1].comparison.densities
    return fallen_plot(before, (top.name, top.comparison.densities), top.comparison.outputs, top.comparison.band_hz)
