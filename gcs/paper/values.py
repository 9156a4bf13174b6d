"""What is regenerated of the paper, as values: chapters of tables and figures, ours beside the printed. It is
`paper.json`, and what is kept of each chapter between two tries; `gcs.paper.page` sets it as a page.
"""

from __future__ import annotations

from typing import Literal

from gcs import documents


class Row(documents.Open, frozen=True, kw_only=True):
    """One number of the paper."""

    name: str
    printed: float | None = None
    ours: float | None = None
    error: float | None = None
    """Standard error of ours."""
    beside: dict[str, float | None] = {}
    """Further columns of its table."""
    digits: int = 3

    @property
    def percent(self) -> float | None:
        """By how much ours differs from the printed, of that."""
        if self.printed is None or self.ours is None or self.printed == 0:
            return None
        return 100 * (self.ours / self.printed - 1)


class PaperTable(documents.Open, frozen=True, kw_only=True):
    """A table of the paper, or one that it should have had."""

    label: str
    """`Table 2`."""
    caption: str
    rows: tuple[Row, ...]
    columns: tuple[str, ...] = ()
    """Of `Row.beside`, in order."""
    shows_percent: bool = True
    shows_values: bool = True
    """Whether printed and ours have columns; else those of `columns` alone."""
    printed: str = "printed"
    ours: str = "ours"
    """Heads of these columns."""
    why: tuple[str, ...] = ()
    """Each difference, and where it comes from."""


class Line(documents.Open, frozen=True, kw_only=True):
    """`x` and `y` have one length; the panel's axes say the units."""

    label: str
    x: tuple[float, ...]
    y: tuple[float, ...]


class Panel(documents.Open, frozen=True, kw_only=True):
    """Lines over one axis."""

    y: str
    """Its label, with the unit."""
    lines: tuple[Line, ...]


class PaperFigure(documents.Open, frozen=True, kw_only=True):
    """A figure of the paper: panels one below the other over one axis."""

    label: str
    caption: str
    panels: tuple[Panel, ...]
    x: str = "time in the run, s"


class Chapter(documents.Open, frozen=True, kw_only=True):
    """One part of the paper."""

    heading: str
    inputs: str
    """What it was worked out from: another means that it has to be worked out again."""
    said: tuple[str, ...] = ()
    listing: str = ""
    """Text in columns, whose spaces count."""
    tables: tuple[PaperTable, ...] = ()
    figures: tuple[PaperFigure, ...] = ()


class FlightTold(documents.Open, frozen=True, kw_only=True):
    """A flight that a chapter stands on."""

    name: str
    what: str
    folder: str
    sha256: str
    """Of its log."""


class PaperDocument(documents.Open, frozen=True, kw_only=True):
    """The whole."""

    format: Literal["tippath.paper/1"]
    quick: bool
    """Flown with shorter chirps than the paper's, for a look."""
    flights: tuple[FlightTold, ...]
    chapters: tuple[Chapter, ...]
