"""What a plot shows, as values: panels over one axis of time or of frequency, and horizontal bars."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import ClassVar, Literal, Self

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
Ink = Literal[
    "blank",
    "text",
    "title",
    "grid",
    "measured",
    "model",
    "both",
    "residual",
    "reference",
    "cursor",
    "mark",
    "full",
    "rest",
    "heat1",
    "heat2",
    "heat3",
    "heat4",
]
"""What a run of characters is; the caller gives each a style (`plot--measured` and so on)."""
Row = tuple[tuple[str, Ink], ...]
"""One line of the screen as runs of characters."""


@dataclass(frozen=True, eq=False, slots=True, kw_only=True)
class Panel:
    """One strip. All arrays have shape (n,); x increases (s or Hz); what is not finite is not drawn."""

    name: str
    """At the left, four or five characters: `p`, `δx`, `res p`."""
    x: FloatArray
    line: FloatArray
    """The first signal: measured, or a residual, or a mismatch."""
    over: FloatArray | None = None
    """Drawn over `line` in the same cells, with signs of its own where it is apart: the model."""
    reference: FloatArray | None = None
    """Drawn dashed, before both: the noise, or what noise allows, or another model."""
    mirrored: bool = True
    """`reference` stands on both sides of zero where the panel is `centred`."""
    unit: str = ""
    least: float = 0.1
    """The smallest scale: noise must look like noise."""
    most: float | None = None
    """The largest: what lies beyond is drawn at the edge."""
    fixed: tuple[float, float] | None = None
    """The scale, bottom and top, where it does not follow what is shown."""
    centred: bool = True
    """Zero in the middle; otherwise from the least to the largest value."""
    logarithmic: bool = False
    """Powers of ten; values <= 0 are not drawn."""
    wraps: bool = False
    """An angle in degrees: not joined over the turn from 180 to -180."""
    weight: float = 1.0
    """Of its height."""
    residual: bool = False
    """`line` is a difference, and has the residual's style."""
    absent: str = "no samples"
    """Said where there is nothing to draw."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Plot:
    """Panels above each other over one axis. `words` name line, over and reference in the legend; empty: no legend."""

    panels: tuple[Panel, ...]
    title: str = ""
    words: tuple[str, str, str] = ("", "", "")
    shaded: tuple[tuple[float, float], ...] = ()
    """Parts of the axis, s or Hz, that are looked at: between dotted lines, on another ground."""
    unit: ClassVar[str] = "s"
    logarithmic: ClassVar[bool] = False

    def worded(self, change: Callable[[str], str]) -> Self:
        """With every text changed: made harmless, or ASCII."""
        panels = tuple(
            replace(one, name=change(one.name), unit=change(one.unit), absent=change(one.absent)) for one in self.panels
        )
        first, second, third = map(change, self.words)
        return replace(self, panels=panels, title=change(self.title), words=(first, second, third))


@dataclass(frozen=True, eq=False, kw_only=True)
class TimePlot(Plot):
    """Strips over time."""

    origin_s: float = 0.0
    """What the axis calls zero."""
    span_s: float | None = None
    """Live: the last so many seconds before the newest sample, moving along; None: everything."""
    stale: str = ""
    """Live, and nothing newer comes: the word that stands in place of the newest values (`no link`)."""


@dataclass(frozen=True, eq=False, kw_only=True)
class FrequencyPlot(Plot):
    """Responses or spectra over log frequency."""

    low_hz: float | None = None
    """Where the axis begins; None: at the lowest frequency above zero."""
    high_hz: float | None = None
    marked: tuple[tuple[float, float], ...] = ()
    """Bands in Hz that are marked above the axis: where the difference lies above what noise allows."""
    marked_is: str = "beyond"
    """The word at the marks."""
    unit: ClassVar[str] = "Hz"
    logarithmic: ClassVar[bool] = True


@dataclass(frozen=True, slots=True, kw_only=True)
class Bar:
    """One horizontal bar."""

    label: str
    parts: tuple[float, ...] = ()
    """Lengths, one behind the other, up to three; none: nothing to draw, only `text` (not testable)."""
    text: str = ""
    """Behind it."""
    least: float | None = None
    """Error bounds around the end of the bar."""
    most: float | None = None
    beside: float | None = None
    """A second value, marked on the bar: on the validation runs."""
    chosen: bool = False


@dataclass(frozen=True, slots=True, kw_only=True)
class BarPlot:
    """Bars below each other. A bar of length `full` reaches the right edge of its column."""

    bars: tuple[Bar, ...]
    title: str = ""
    full: float = 1.0
    lines: tuple[tuple[float, str], ...] = ()
    """Values marked through all bars, with a word: (0.8, "needed to be named")."""
    words: tuple[str, ...] = ()
    """What the parts are, for the legend."""
    beside: str = ""
    """What `Bar.beside` is, for the legend."""

    def worded(self, change: Callable[[str], str]) -> BarPlot:
        """With every text changed: made harmless, or ASCII."""
        bars = tuple(replace(one, label=change(one.label), text=change(one.text)) for one in self.bars)
        return replace(
            self,
            bars=bars,
            title=change(self.title),
            lines=tuple((value, change(word)) for value, word in self.lines),
            words=tuple(map(change, self.words)),
            beside=change(self.beside),
        )


@dataclass(frozen=True, slots=True)
class View:
    """What part of the axis is shown: s, or log10 of Hz."""

    low: float
    high: float

    @property
    def span(self) -> float:
        return self.high - self.low


@dataclass(frozen=True, slots=True)
class Reading:
    """A panel's values at the cursor; NaN where there is none."""

    name: str
    unit: str
    line: float
    over: float | None = None
    reference: float | None = None
