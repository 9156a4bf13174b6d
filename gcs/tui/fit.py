"""Fit: the flight's chosen runs, fitted: what decides first, of the model whose curves stand beside it."""

from __future__ import annotations

from gcs.tui import desk_words, fit_words
from gcs.tui.actions import Act
from gcs.tui.base import READ, TALL, VIEW, Split
from gcs.tui.draw_desk import Look, run_strips
from gcs.tui.plot import Style
from gcs.tui.state import State
from gcs.tui.widgets.lines import Lines
from gcs.tui.widgets.traces import Traces


class FitScreen(Split):
    """The top rung's figures, then TPP, CD and the CD that the TPP reduces to; strips of a run with models over it."""

    NAME = "Fit"
    VIEWS = ("tables", "strips")
    NO_PLOT = "the strips are those of the comparison: 5, then C"
    ACTS = (
        Act("f,F", "app.work('fit')", "fit", "fit the chosen runs"),
        Act("m,M", "app.choose_base", "model", "choose the base model"),
        VIEW,
        Act("r,R", "run(1)", "run", "show the next run"),
        Act("g,G", "beside(1)", "models", "set another model beside: the rung below, the other base, all"),
        Act("o,O", "app.open_flight", "", "open another flight"),
        *READ,
    )

    def __init__(self, style: Style) -> None:
        super().__init__(style)
        self.part = 0
        self.beside = 0

    @property
    def keys(self) -> str:
        drawn = self.query("#drawn")
        return f"{super().keys}  {Traces.KEYS}" if drawn and drawn.first().display else super().keys

    def begin(self) -> None:
        """The first view and run."""
        super().begin()
        self.part = 0

    def action_run(self, step: int) -> None:
        """Another run."""
        self.part += step

    def action_beside(self, step: int) -> None:
        """Another model over the measurement."""
        self.beside += step
        self.view = 1

    def show_body(self, state: State, width: int) -> None:
        rung = state.desk.current
        self.lay_out(rung is not None and rung.comparison is not None)
        title = self.query_one("#title", Lines)
        title.show([desk_words.fit_title(state, width)])
        height = self.size.height
        if not self.changed(state.desk, self.part, self.beside, width, height, self.text_width):
            return
        self.put_text(fit_words.fit_lines(state, self.text_width))
        plot = run_strips(state.desk, Look(part=self.part, beside=self.beside, both=height >= TALL))
        if plot is not None:
            self.put_plot(plot, f"{self.part}")
