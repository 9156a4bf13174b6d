"""Compare: where the model fails, as one picture of bands over axes; from a cell down to time, response and spectra."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

from textual.widget import Widget

from gcs.tui import desk_words
from gcs.tui.actions import Act
from gcs.tui.base import READ, TALL, VIEW, WIDE, Split
from gcs.tui.draw_desk import Look, run_strips, worst_part
from gcs.tui.plot import HeatPlot, Plot, Style, heat_plot, response_plot, spectra_plot
from gcs.tui.state import State
from gcs.tui.widgets.heat import Heat
from gcs.tui.widgets.lines import Lines
from gcs.tui.widgets.traces import Traces
from gcs.tui.words import justified

if TYPE_CHECKING:
    from gcs.desk.state import DeskState
    from sysid.compare.values import BandError, Comparison

MOST_SAID = 6
"""Rows of findings above the picture where there is not much room, and"""
MOST_SAID_TALL = 10
"""where there is."""

MOST_ROWS = 8
"""Of the picture for an axis."""


class CompareScreen(Split):
    """The top rung of the ladder against its runs."""

    NAME = "Compare"
    VIEWS = ("bands", "time", "response", "spectra", "tables")
    ACTS = (
        Act("enter", "closer", "closer", "look closer: time, response, spectra of this cell", "enter"),
        Act("c,C", "app.work('compare')", "compare", "compare the top rung with its runs"),
        VIEW,
        Act("x,X", "axis(1)", "axis", "show the next axis or response"),
        Act("r,R", "run(1)", "run", "show the next run"),
        Act("g,G", "beside(1)", "models", "set another model beside: the rung below, the other base, all"),
        Act("escape", "back", "", "the picture of bands again"),
        *READ,
    )

    def __init__(self, style: Style) -> None:
        super().__init__(style)
        self.part = 0
        self.beside = 0
        self.output = 0
        self.response = 0
        self._compared: Comparison | None = None
        self._plot: HeatPlot | None = None

    @property
    def keys(self) -> str:
        return f"{super().keys}  {Heat.KEYS if self.plotted == 'bands' else Traces.KEYS}"

    @property
    def plotted(self) -> str:
        return self.VIEWS[self.view]

    def drawn(self) -> Iterable[Widget]:
        yield Heat(self.style, "heat")
        yield Traces(self.style, "plot")

    def begin(self) -> None:
        """The first view, run and axis."""
        super().begin()
        self.part, self.axis = 0, 0

    def action_run(self, step: int) -> None:
        """Another run."""
        self._leave_bands()
        self.view = 1
        self.part += step

    def action_axis(self, step: int) -> None:
        """Another axis, or response."""
        match self.plotted:
            case "bands":
                self.query_one("#heat", Heat).action_next_row()
            case "response":
                self.response += step
            case _:
                self.output += step

    def action_beside(self, step: int) -> None:
        """Another model over the measurement."""
        self._leave_bands()
        self.view = 1
        self.beside += step

    def action_view(self) -> None:
        """The next view."""
        if not self._drawable:
            self.app.notice(self.NO_PLOT)  # type: ignore[attr-defined]
            return
        self._leave_bands()
        self.view = (self.view + 1) % len(self.VIEWS)

    def action_closer(self) -> None:
        """From a cell to the run in which most of it is; then to its response, its spectra, and back."""
        self.action_view() if self._drawable and self.plotted != "spectra" else self.action_back()

    def action_back(self) -> None:
        """The bands again; where they are shown, work under way is called off."""
        if self.view:
            self.view = 0
        else:
            self.app.action_cancel()  # type: ignore[attr-defined]

    def on_heat_moved(self) -> None:
        """The cursor stands on another cell."""
        self.app.run_look()  # type: ignore[attr-defined]

    def on_heat_chosen(self) -> None:
        """A cell was pressed twice."""
        self.action_closer()
        self.app.run_look()  # type: ignore[attr-defined]

    def _leave_bands(self) -> None:
        """What is looked at closer is the axis and the band of the cell under the cursor."""
        cell, found = self._cell(), self._compared
        if self.view or cell is None or found is None:
            return
        self.output = found.outputs.index(cell[0])
        self.part = worst_part(found, self.output, (cell[1].low_hz, cell[1].high_hz))
        command = max(cell[1].coherence, key=lambda name: cell[1].coherence[name], default="")
        pairs = [(one.mismatch.output, one.mismatch.command) for one in found.responses]
        self.response = pairs.index((cell[0], command)) if (cell[0], command) in pairs else 0

    def _cell(self) -> tuple[str, BandError] | None:
        """Output and band under the cursor."""
        found, plot = self._compared, self._plot
        if found is None or plot is None:
            return None
        row, k = self.query_one("#heat", Heat).at
        return plot.rows[row].output, [one for one in found.bands if one.axis == plot.rows[row].axis][k]

    def lay_out(self, drawable: bool) -> None:
        """Sentences and the picture; or a closer look; or tables."""
        self._drawable = drawable
        view = self.plotted if drawable else "tables"
        self.query_one("#tables").display = view in ("bands", "tables") or self.size.width >= WIDE
        self.query_one("#drawn").display = view != "tables"
        heat, plot = self.query_one("#heat", Heat), self.query_one("#plot", Traces)
        heat.display = view == "bands"
        plot.display = view != "bands" or self.size.height >= TALL
        wanted = {"tables": None, "bands": heat}.get(view, plot)
        if self.focused is not wanted:
            self.set_focus(wanted, scroll_visible=False)

    def show_body(self, state: State, width: int) -> None:
        desk = state.desk
        self._take(desk)
        self.lay_out(self._compared is not None)
        self.query_one("#title", Lines).show([self._title(state, width)])
        heat = self.query_one("#heat", Heat)
        seen = self.part, self.beside, self.output, self.response, self.view, heat.at
        if not self.changed(desk, *seen, width, self.size.height, self.text_width):
            return
        self._put_words(desk)
        found, cell = self._compared, self._cell()
        if found is None or cell is None:
            return
        plot = self._drawn(desk, found, cell[1])
        if plot is not None:
            self.put_plot(plot, f"{self.plotted} {self.part} {self.output} {self.response}")

    def _take(self, desk: DeskState) -> None:
        """A comparison that was not shown yet: its bands, with the cursor on the darkest."""
        if desk.comparison is self._compared:
            return
        self._compared = desk.comparison
        if self._compared is not None:
            self._plot = heat_plot(self._compared)
            heat = self.query_one("#heat", Heat)
            heat.styles.max_height = MOST_ROWS * len(self._plot.rows) + 3
            heat.show(self._plot)

    def _put_words(self, desk: DeskState) -> None:
        """Above the bands only what was found, as much of it as leaves them room."""
        tables = self.query_one("#tables")
        above = self.plotted == "bands" and self._drawable and self.size.width < WIDE
        lines = desk_words.compare_lines(desk, self.text_width, full=not above)
        if above:
            most = MOST_SAID_TALL if self.size.height >= TALL else MOST_SAID
            lines = lines if len(lines) <= most else [*lines[: most - 1], "   ... all of it: V"]
        tables.styles.height = len(lines) if above else "1fr"
        self.put_text(lines)

    def _title(self, state: State, width: int) -> tuple[str, str]:
        desk = state.desk
        if desk.current is None:
            return desk_words.flight_line(state, width)
        title, style = desk_words.ladder_title(desk, width)
        views = " · ".join(f"[{name}]" if name == self.plotted else name for name in self.VIEWS)
        return (justified(title, f"{views} ", width) if width >= 120 else title, style)

    def _drawn(self, desk: DeskState, found: Comparison, cell: BandError) -> Plot | None:
        """The closer look; below the bands the spectra of the cursor's axis."""
        band = (cell.low_hz, cell.high_hz)
        match self.plotted:
            case "time":
                look = Look(
                    part=self.part, beside=self.beside, output=self.output, band_hz=band, both=self.size.height >= TALL
                )
                return run_strips(desk, look)
            case "response" if found.responses:
                return response_plot(found, self.response % len(found.responses), (band,))
            case "spectra":
                return spectra_plot(found, self.output % len(found.outputs), (band,))
            case "bands":
                outputs = [one.output for one in self._plot.rows] if self._plot is not None else []
                row = self.query_one("#heat", Heat).at[0]
                return spectra_plot(found, found.outputs.index(outputs[row]), (band,))
        return None
