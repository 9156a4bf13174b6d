"""Compare: where the model fails, in sentences first; then over time and over frequency."""

from __future__ import annotations

from collections.abc import Iterable

from textual.widget import Widget

from gcs.desk.state import Rung
from gcs.tui import desk_words
from gcs.tui.actions import Act
from gcs.tui.base import READ, TALL, VIEW, Split
from gcs.tui.draw_desk import run_strips
from gcs.tui.plot import Plot, Style, band_bars, response_plot, spectra_plot
from gcs.tui.state import State
from gcs.tui.widgets.bars import Bars
from gcs.tui.widgets.lines import Lines
from gcs.tui.widgets.traces import Traces
from gcs.tui.words import justified

AXES = {"p": "roll", "q": "pitch"}


class CompareScreen(Split):
    """The top rung of the ladder against its runs."""

    NAME = "Compare"
    VIEWS = ("findings", "time", "response", "spectra", "bands")
    ACTS = (
        Act("c,C", "app.work('compare')", "compare", "compare the top rung with its runs"),
        VIEW,
        Act("r,R", "run(1)", "run", "show the next run"),
        Act("x,X", "axis(1)", "axis", "show the next response or axis"),
        *READ,
    )

    def __init__(self, style: Style) -> None:
        super().__init__(style)
        self.part = 0
        self.axis = 0

    @property
    def keys(self) -> str:
        drawn = self.query("#drawn")
        return f"{super().keys}  {Traces.KEYS}" if drawn and drawn.first().display else super().keys

    def drawn(self) -> Iterable[Widget]:
        yield Traces(self.style, "plot")
        yield Bars(self.style, "bars")

    def begin(self) -> None:
        """The first view, run and axis."""
        super().begin()
        self.part, self.axis = 0, 0

    def action_run(self, step: int) -> None:
        """Another run."""
        self.part += step
        self.view = self.view or 1

    def action_axis(self, step: int) -> None:
        """Another response, or axis."""
        self.axis += step
        self.view = self.view or 2

    def show_body(self, state: State, width: int) -> None:
        desk = state.desk
        rung = desk.current
        ready = rung is not None and rung.comparison is not None
        self.lay_out(ready)
        self.query_one("#bars").display = self.plotted == "bands"
        self.query_one("#plot").display = self.plotted != "bands"
        key = (desk, self.part, self.axis, self.view, width, self.size.height, self.text_width)
        self.query_one("#title", Lines).show([self._title(state, width)])
        if not self.changed(*key):
            return
        self.put_text(desk_words.compare_lines(desk, self.text_width))
        if rung is None or rung.comparison is None:
            return
        found = rung.comparison
        if self.plotted == "bands":
            self.query_one("#bars", Bars).show(
                band_bars(found.bands, AXES[found.outputs[self.axis % len(found.outputs)]])
            )
            return
        plot = self._plot(rung)
        if plot is not None:
            self.put_plot(plot, f"{self.plotted} {self.part if self.plotted == 'time' else self.axis}")

    def _title(self, state: State, width: int) -> tuple[str, str]:
        desk = state.desk
        if desk.current is None:
            return desk_words.flight_line(state, width)
        title, style = desk_words.ladder_title(desk, width)
        views = " · ".join(f"[{name}]" if name == self._shown else name for name in self.VIEWS)
        return (justified(title, f"{views} ", width) if width >= 120 else title, style)

    @property
    def _shown(self) -> str:
        return self.plotted if self.roomy else self.VIEWS[self.view]

    def _plot(self, rung: Rung) -> Plot | None:
        found = rung.comparison
        assert found is not None
        match self.plotted:
            case "response" if found.responses:
                return response_plot(found, self.axis % len(found.responses))
            case "spectra":
                return spectra_plot(found, self.axis % len(found.outputs))
            case _:
                return run_strips(rung, self.part, both=self.size.height >= TALL)
