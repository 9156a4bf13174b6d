"""Ladder: the error falling, rung by rung, and what may be the next."""

from __future__ import annotations

from collections.abc import Iterable

from textual.containers import Horizontal
from textual.widget import Widget

from gcs.tui import desk_words
from gcs.tui.actions import Act
from gcs.tui.base import READ, TALL, Scrolled
from gcs.tui.draw_desk import run_strips
from gcs.tui.plot import Style
from gcs.tui.state import State
from gcs.tui.widgets.lines import Lines
from gcs.tui.widgets.traces import Traces

HINT = "escape, or the same key, shows the ladder again"


class LadderScreen(Scrolled):
    """Strips with the model over the measurement, rungs, next candidates; three texts in their place."""

    NAME = "Ladder"
    ACTS = (
        Act("d,D", "app.work('diagnose')", "ask", "ask what the top rung lacks"),
        Act("a,A", "app.add_winner", "add", "add the effect that is missing"),
        Act("u,U", "app.undo", "undo", "take the top rung back"),
        Act("c,C", "app.work('compare')", "compare", "compare the top rung with its runs"),
        Act("p,P", "panel('placebo')", "placebo", "what was added, its signs and its placebo"),
        Act("w,W", "panel('which')", "maneuver", "which maneuver would tell more"),
        Act("e,E", "panel('explain')", "explain", "why, in full"),
        Act("r,R", "run(1)", "run", "show the next run"),
        Act("i,I", "app.own_effect", "", "add an effect of your own, by its file"),
        Act("escape", "back", "", "the ladder again"),
        *READ,
    )

    def __init__(self, style: Style) -> None:
        super().__init__(style)
        self.part = 0
        self.panel = ""

    def body(self) -> Iterable[Widget]:
        yield Lines(self.style, "title")
        yield Traces(self.style, "plot")
        with Horizontal(id="lower"):
            yield Lines(self.style, "rungs")
            yield Lines(self.style, "candidates")
        yield self.scrolled()

    def begin(self) -> None:
        """The ladder, of the first run."""
        self.panel, self.part = "", 0

    def action_run(self, step: int) -> None:
        """Another run."""
        self.part += step
        self.query_one("#plot", Traces).action_reset()

    def action_panel(self, which: str) -> None:
        """A text in place of the ladder, and back."""
        self.panel = "" if self.panel == which else which
        self.query_one("#tables").scroll_to(y=0, animate=False)

    def action_back(self) -> None:
        """The ladder again; where it is shown, work under way is called off."""
        if self.panel:
            self.panel = ""
        else:
            self.app.action_cancel()  # type: ignore[attr-defined]

    def show_body(self, state: State, width: int) -> None:
        desk = state.desk
        rung = desk.current
        texts = bool(self.panel) and rung is not None
        self.query_one("#tables").display = texts
        self.query_one("#lower").display = not texts
        plot = self.query_one("#plot", Traces)
        plot.display = not texts
        rungs, others = self.query_one("#rungs", Lines), self.query_one("#candidates", Lines)
        lower = max(6, min(len(desk.ladder) + 5, 8 if self.size.height < TALL else 16))
        self.query_one("#lower").styles.height = lower
        key = (desk, self.part, self.panel, width, self.size.height, rungs.size, others.size, self.text_width)
        if not self.changed(*key):
            return
        self.query_one("#title", Lines).show([desk_words.ladder_title(desk, width)])
        rungs.show(desk_words.rung_lines(desk, rungs.size.width, self.style)[: rungs.size.height])
        others.show(desk_words.next_candidates(desk, others.size.width, others.size.height)[: others.size.height])
        if rung is None:
            return
        strips = run_strips(rung, self.part, both=self.size.height >= TALL)
        if strips is not None:
            plot.show(strips)
        if texts:
            lines = {
                "placebo": lambda: desk_words.sign_lines(rung, self.text_width),
                "which": lambda: desk_words.teller_lines(rung, desk, self.text_width),
                "explain": lambda: desk_words.explained_lines(rung, self.text_width),
            }[self.panel]()
            self.put_text([*lines, "", f" {HINT}"])
