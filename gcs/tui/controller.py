"""Controller: gains designed on the ladder's top rung, pushed as one verified set, and back again."""

from __future__ import annotations

from gcs.tui import desk_words
from gcs.tui.actions import Act
from gcs.tui.base import READ, VIEW, Split
from gcs.tui.draw_desk import predicted
from gcs.tui.plot import Style
from gcs.tui.state import State
from gcs.tui.widgets.lines import Lines


class ControllerScreen(Split):
    """Margins, the predicted answer to a doublet, K, observer, prefilter; what the vehicle holds."""

    NAME = "Controller"
    VIEWS = ("gains", "predicted answer")
    ACTS = (
        Act("d,D", "app.work('design')", "design", "design gains on the top rung"),
        Act("w,W", "app.weigh", "weight", "design with another input cost"),
        Act("p,P", "app.push", "push (asks)", "push the gains to the vehicle"),
        Act("r,R", "app.revert", "revert (asks)", "go back to the gains before"),
        VIEW,
        Act("x,X", "axis(1)", "axis", "the predicted answer of the other axis"),
        *READ,
    )

    def __init__(self, style: Style) -> None:
        super().__init__(style)
        self.axis = 0

    def action_axis(self, step: int) -> None:
        """Roll or pitch."""
        self.axis += step
        self.view = 1

    def show_body(self, state: State, width: int) -> None:
        made = state.desk.designed
        self.lay_out(made is not None)
        self.query_one("#title", Lines).show([desk_words.bank_title(state, width)])
        key = (state.desk, state.designed, state.commands, self.axis, width, self.size.height, self.text_width)
        if not self.changed(*key):
            return
        self.put_text(desk_words.controller_lines(state, self.text_width))
        if made is not None:
            self.put_plot(predicted(made, self.axis), str(self.axis % 2))
