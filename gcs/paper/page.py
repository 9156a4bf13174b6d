"""`paper.json` as one page: tables with ours beside the printed numbers, figures, and where each difference comes from.

Without outside references, light or dark as the reader's screen is, and to be printed.
"""

from __future__ import annotations

import itertools
from typing import Any

from gcs.analysis.pages.page import BLACK, BLUE, GREEN, ORANGE, literal, rendered, svg
from gcs.analysis.pages.pictures import PAGE_WIDTH, PURPLE, panels
from gcs.analysis.quantities import decimals
from gcs.paper.values import PaperDocument, PaperFigure, PaperTable, Row

STYLES: tuple[tuple[str, Any], ...] = (
    (BLACK, "-"),
    (BLUE, (0, (5, 1.2))),
    (ORANGE, (0, (2, 1))),
    (GREEN, (0, (1, 1))),
    (PURPLE, (0, (3, 1, 1, 1))),
)
"""Colour and dashes of each line of a panel, in order."""
NOTHING = "–"
MOST_DIGITS = 6
"""An error so small is none that a reader asks for: what was fitted had no noise."""


def paper_page(document: PaperDocument) -> str:
    """The page as HTML. All words are escaped; figures are Matplotlib's, which escapes its own."""
    from markupsafe import Markup  # comes with the templates: only where a page is made

    def drawn(figure: PaperFigure) -> Markup:
        return Markup(svg(figure_of(figure)))

    return rendered("page.html.jinja", room="gcs.paper", document=document, head=head, cells=cells, drawn=drawn)


def head(table: PaperTable) -> list[str]:
    """The columns' names."""
    values = [table.printed, table.ours] if table.shows_values else []
    percent = ["difference, %"] if table.shows_percent else []
    return ["", *values, *percent, *table.columns]


def cells(table: PaperTable, row: Row) -> list[str]:
    """A row's texts, as many as `head`."""
    ours = number(row.ours, row.digits)
    digits = decimals(row.error) if row.error else MOST_DIGITS
    if row.error is not None and digits < MOST_DIGITS:
        ours = f"{number(row.ours, digits)} ± {row.error:.{digits}f}"
    percent = [NOTHING if row.percent is None else f"{row.percent:+.1f}"] if table.shows_percent else []
    others = [number(row.beside.get(name), 1 if "off in SE" in name else row.digits) for name in table.columns]
    values = [number(row.printed, row.digits), ours] if table.shows_values else []
    return [row.name, *values, *percent, *others]


def number(value: float | None, digits: int) -> str:
    """`1.634`; a dash where there is none."""
    return NOTHING if value is None else f"{value:.{digits}f}"


def figure_of(figure: PaperFigure) -> Any:
    """Panels one below the other, one axis of x below all."""
    drawn, axes = panels(len(figure.panels), 1, 0.6 + 1.9 * len(figure.panels), width=PAGE_WIDTH)
    for axis, panel in zip(axes[:, 0], figure.panels, strict=True):
        for line, (colour, dashes) in zip(panel.lines, itertools.cycle(STYLES), strict=False):
            axis.plot(line.x, line.y, color=colour, linestyle=dashes, linewidth=0.9, label=literal(line.label))
        axis.set_ylabel(panel.y, fontsize=8)
        axis.tick_params(labelbottom=axis is axes[-1, 0], labelsize=8)
        axis.legend(loc="upper left", fontsize=8, ncols=5, framealpha=0.85)
        low, high = axis.get_ylim()
        axis.set_ylim(low, high + 0.25 * (high - low))  # room for the legend
        axis.margins(x=0)
    axes[-1, 0].set_xlabel(figure.x, fontsize=8)
    return drawn
