"""A plot made ready to be drawn; view, zoom and cursor on its axis, which is time or log10 of frequency."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gcs.tui.plot.draw import BoolArray, FloatArray, join
from gcs.tui.plot.model import FrequencyPlot, Panel, Plot, Reading, TimePlot, View

HUGE = 1e100
"""Values beyond are drawn as this."""


@dataclass(frozen=True, eq=False, slots=True)
class Axis:
    """Where samples lie; (n,) each, in order."""

    x: FloatArray
    """As given."""
    u: FloatArray
    """As drawn."""
    order: NDArray[np.int64] | None
    """Which of the samples given these are; None: all."""
    joined: BoolArray | None


@dataclass(frozen=True, eq=False, slots=True)
class Layer:
    """One signal without what is not finite; (n,) each, joined (n - 1,)."""

    u: FloatArray
    values: FloatArray
    joined: BoolArray | None


@dataclass(frozen=True, eq=False, slots=True)
class ReadyPanel:
    """A panel's layers on the axis as it is drawn."""

    panel: Panel
    u: FloatArray
    """(n,), NaN where the axis has no such place."""
    line: Layer
    over: Layer | None
    references: tuple[Layer, ...]


@dataclass(frozen=True, eq=False, slots=True, kw_only=True)
class Prepared:
    """A plot made ready to be drawn at any size and in any view."""

    plot: Plot
    panels: tuple[ReadyPanel, ...]
    whole: View
    """All there is."""
    first: View
    """What is shown before any zoom: everything, or the last seconds."""
    places: FloatArray
    """(n,), where the cursor can stand."""
    least_span: float


def prepared(plot: Plot) -> Prepared:
    """Sort out what can be drawn."""
    axes: dict[int, Axis] = {}
    panels = []
    for panel in plot.panels:
        if id(panel.x) not in axes:
            axes[id(panel.x)] = _axis(panel.x, plot.logarithmic)
        panels.append(_ready(panel, axes[id(panel.x)]))
    known = [one.u for one in panels if one.u.size]
    low = min((float(u[0]) for u in known), default=0.0)
    high = max((float(u[-1]) for u in known), default=0.0)
    if isinstance(plot, FrequencyPlot):
        if plot.low_hz is not None and plot.low_hz > 0:
            low = math.log10(plot.low_hz)
        if plot.high_hz is not None and plot.high_hz > 0:
            high = math.log10(plot.high_hz)
    if not high > low:
        low, high = low - 0.5, low + 0.5
    whole = first = View(low, high)
    if isinstance(plot, TimePlot) and plot.span_s is not None and plot.span_s > 0:
        first = View(high - plot.span_s, high)
        whole = View(min(low, first.low), high)
    places = max(known, key=lambda u: u.size, default=np.empty(0))
    places = places[(places >= whole.low) & (places <= whole.high)]
    steps = np.diff(places)
    steps = steps[steps > 0]
    least = 4 * float(steps.min()) if steps.size else 0.0
    least = max(least, 1e-12 * max(abs(low), abs(high), 1.0))
    return Prepared(
        plot=plot, panels=tuple(panels), whole=whole, first=first, places=places, least_span=min(least, whole.span)
    )


def _axis(x: FloatArray, logarithmic: bool) -> Axis:
    x = np.asarray(x, dtype=np.float64)
    keep = np.isfinite(x) & (np.abs(x) < HUGE)
    if logarithmic:
        keep &= x > 0
    order = None
    if not keep.all():
        order = np.flatnonzero(keep)
        x = x[order]
    if x.size > 1 and np.any(np.diff(x) < 0):
        turn = np.argsort(x, kind="stable")
        order = turn if order is None else order[turn]
        x = x[turn]
    u = np.log10(x) if logarithmic else x
    return Axis(x, u, order, _joined(x, u))


def _joined(x: FloatArray, u: FloatArray) -> BoolArray | None:
    """Frequencies may be spaced evenly or by octaves."""
    if x.size < 2:
        return None
    return join(x) if u is x else join(x) | join(u)


def _ready(panel: Panel, axis: Axis) -> ReadyPanel:
    def layer(values: FloatArray) -> Layer:
        values = np.asarray(values, dtype=np.float64)
        if axis.order is not None:
            values = values[axis.order]
        if panel.logarithmic:
            values = np.log10(np.where(values > 0, values, np.nan))
        keep = np.isfinite(values)
        u, joined = axis.u, axis.joined
        if not keep.all():
            u, values = u[keep], values[keep]
            joined = _joined(axis.x[keep], u) if axis.u is not axis.x else _joined(u, u)
        values = np.clip(values, -HUGE, HUGE)
        if panel.wraps and joined is not None:
            joined = joined & (np.abs(np.diff(values)) <= 180.0)
        return Layer(u, values, joined)

    references: tuple[Layer, ...] = ()
    if panel.reference is not None:
        mirrored = panel.centred and panel.mirrored
        references = (layer(panel.reference), *([layer(-panel.reference)] if mirrored else []))
    over = None if panel.over is None else layer(panel.over)
    return ReadyPanel(panel, axis.u, layer(panel.line), over, references)


# ------------------------------------------------------------------------------------------------ view and cursor


def clamped(ready: Prepared, view: View) -> View:
    """Neither wider nor further than what there is, nor narrower than a few samples."""
    span = min(max(view.span, ready.least_span), ready.whole.span)
    low = min(max(view.low, ready.whole.low), ready.whole.high - span)
    return View(low, low + span)


def zoomed(ready: Prepared, view: View, factor: float, about: float | None = None) -> View:
    """`factor` times as much of the axis, the place `about` (None: the middle) staying where it is."""
    about = (view.low + view.high) / 2 if about is None else min(max(about, view.low), view.high)
    span = min(max(view.span * factor, ready.least_span), ready.whole.span)
    low = about - (about - view.low) / view.span * span
    return clamped(ready, View(low, low + span))


def holding(ready: Prepared, view: View, place: float) -> View:
    """The view moved no further than it must to show a place."""
    if place < view.low:
        return clamped(ready, View(place, place + view.span))
    if place > view.high:
        return clamped(ready, View(place - view.span, place))
    return view


def moved(ready: Prepared, view: View, cursor: float | None, distance: float) -> float | None:
    """The cursor moved by `distance` on the axis, to the nearest sample there but at least by one; None: no samples."""
    places = ready.places
    if not places.size:
        return None
    if cursor is None:
        return float(places[nearest(places, (view.low + view.high) / 2)])
    now = nearest(places, cursor)
    wanted = nearest(places, cursor + distance)
    if wanted == now and distance:
        wanted = min(max(now + (1 if distance > 0 else -1), 0), places.size - 1)
    return float(places[wanted])


def nearest(places: FloatArray, place: float) -> int:
    after = int(np.searchsorted(places, place))
    if after == 0 or (after < places.size and places[after] - place < place - places[after - 1]):
        return after
    return after - 1


def readings(ready: Prepared, cursor: float | None) -> tuple[Reading, ...]:
    """Each panel's values at the sample nearest to the cursor (on the axis as drawn); empty without a cursor."""
    if cursor is None:
        return ()
    return tuple(reading(one, cursor) for one in ready.panels)


def reading(one: ReadyPanel, cursor: float) -> Reading:
    def at(layer: Layer | None) -> float:
        if layer is None or not layer.u.size:
            return math.nan
        i = nearest(layer.u, cursor)
        apart = abs(float(layer.u[i]) - cursor)
        if apart > 0:
            # between two samples that a line joins; before the first and behind the last there is nothing
            j = i if layer.u[i] < cursor else i - 1
            if layer.joined is None or not 0 <= j < layer.joined.size or not layer.joined[j]:
                return math.nan
        value = float(layer.values[i])
        return 10.0**value if one.panel.logarithmic and value < 300 else value

    reference = at(one.references[0]) if one.references else None
    return Reading(one.panel.name, one.panel.unit, at(one.line), None if one.over is None else at(one.over), reference)
