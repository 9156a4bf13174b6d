"""Controller: gains in the vehicle and proposed ones side by side, sliders between them; shadow, push, proof."""

from __future__ import annotations

from collections.abc import Iterable

from textual.containers import Container
from textual.widget import Widget

from gcs.desk.state import Weights
from gcs.tui import gains_words
from gcs.tui.actions import Act
from gcs.tui.base import TALL, VIEW, WIDE, Split
from gcs.tui.desk_words import broken
from gcs.tui.draw_gains import answers, flown
from gcs.tui.plot import Style
from gcs.tui.sliders import SLIDERS, slider_lines
from gcs.tui.state import State
from gcs.tui.widgets.lines import Lines

PLOT_AND_LINES = 22
"""Rows that are left to the plot, the lines at the top and those at the bottom."""
RESTS_S = 0.8
"""After so long without a key the whole judgement begins."""


class ControllerScreen(Split):
    """Margins, predicted answers, sliders; what the vehicle holds; what the gains did over flights."""

    NAME = "Controller"
    VIEWS = ("gains", "predicted answer", "flown")
    NO_PLOT = "no gains yet to predict with"
    ACTS = (
        Act("up", "choose_by(-1)", "", "the slider above", "up"),
        Act("down", "choose_by(1)", "", "the slider below", "down"),
        Act("d,D", "app.work('design')", "design", "keep the gains that the sliders make"),
        Act("s,S", "app.work('shadow')", "shadow", "the gains over the chosen runs, without authority"),
        Act("p,P", "app.push", "push (asks)", "push the gains to the vehicle"),
        Act("r,R", "app.revert", "revert (asks)", "go back to the gains before"),
        Act("f,F", "app.work('prove')", "flown", "this flight against what its gains promised"),
        VIEW,
        Act("x,X", "axis(1)", "axis", "the answer of the other axis, or the next run that was flown"),
        Act("left", "slide_here(-1)", "less", "less of the marked slider", "left"),
        Act("right", "slide_here(1)", "more", "more of the marked slider", "right"),
        Act("w,W", "app.weigh", "", "type an input cost"),
        Act("0", "usual", "", "the sliders where the paper has them"),
        Act("pagedown", "scroll(5)", "", "scroll down", "page down"),
        Act("pageup", "scroll(-5)", "", "scroll up", "page up"),
    )

    def __init__(self, style: Style) -> None:
        super().__init__(style)
        self.axis = 0
        self.at = 0
        self._weights = Weights()
        self._followed: tuple[object, ...] = ()
        self._proof: object = None

    def body(self) -> Iterable[Widget]:
        yield Lines(self.style, "title")
        yield Lines(self.style, "sliders")
        with Container(id="split"):
            yield self.scrolled()
            with Container(id="drawn"):
                yield from self.drawn()

    # Keys.

    def action_axis(self, step: int) -> None:
        """Roll or pitch; or another run."""
        self.axis += step
        self.view = max(self.view, 1)

    def action_choose_by(self, step: int) -> None:
        """Another slider."""
        self.action_choose((self.at + step) % len(SLIDERS))

    def action_choose(self, number: int) -> None:
        """The slider that was pressed."""
        self.at = number
        self.app.run_look()  # type: ignore[attr-defined]

    def action_slide_here(self, steps: int) -> None:
        """The marked slider."""
        self.action_slide(self.at, steps)

    def action_slide(self, number: int, steps: int) -> None:
        """One slider by some places."""
        self.at = number
        self._turn(SLIDERS[number].moved(self._weights, steps))

    def action_put(self, number: int, place: int) -> None:
        """A slider to where it was pressed."""
        self.at = number
        self._turn(SLIDERS[number].at(self._weights, place))

    def action_usual(self) -> None:
        """The paper's."""
        self._turn(Weights())

    def _turn(self, weights: Weights) -> None:
        self._weights = weights  # the next key counts from here, whenever the state follows
        self.app.turn_weights(weights, RESTS_S)  # type: ignore[attr-defined]

    # What is shown.

    def show_body(self, state: State, width: int) -> None:
        desk = state.desk
        self._weights = desk.weights
        self._follow(state)
        beside = gains_words.columns(state)
        if desk.proof is not None and desk.proof is not self._proof:
            self.view = 2  # it was asked for, and is shown
        self._proof = desk.proof
        drawable = desk.proof is not None or any(one.following is not None for one in beside)
        self.lay_out(drawable)
        self.set_focus(None)  # left and right move sliders, also where a plot stands
        title, sliders = self.query_one("#title", Lines), self.query_one("#sliders", Lines)
        title.show([gains_words.bank_title(state, width)])
        view = self.view if desk.proof is not None else min(self.view, 1)
        proven = desk.proof is not None and view == 2
        sliders.display = bool(desk.ladder) and not proven
        sliders.styles.height = len(SLIDERS)
        sliders.show(slider_lines(desk.weights, self.at, width, self.style))
        self._give_room(state, proven=proven)
        if not self.changed(desk, state.commands, self.axis, view, width, self.size.height, self.text_width):
            return
        self.put_text(gains_words.controller_lines(state, self.text_width, proof_first=proven))
        if desk.proof is not None and proven:
            self.put_plot(flown(desk.proof, self.axis), f"flown {self.axis}")
        elif (plot := answers(beside, self.axis)) is not None:
            self.put_plot(plot, str(self.axis % 2))

    def _give_room(self, state: State, *, proven: bool) -> None:
        """To all rows of a proof, as far as a plot is left below them."""
        rows = len(broken(gains_words.proof_said(state.desk), self.text_width))
        beside = self.size.width >= WIDE or self.size.height < TALL
        height = "1fr" if beside or not proven else min(rows + 1, self.size.height - PLOT_AND_LINES)
        self.query_one("#tables").styles.height = height

    def _follow(self, state: State) -> None:
        """Once for each model and each set in the vehicle: what the sliders make of it."""
        desk = state.desk
        crc = 0 if state.bank is None else state.bank.active
        if desk.current is None or desk.busy:
            return
        key = (desk.current.fit, desk.current.answer, crc)
        if key == self._followed:
            return
        again, self._followed = bool(self._followed), key
        wanted = crc if crc and (desk.present is None or desk.present.crc != crc) else 0
        if desk.trial is None or again or wanted:
            self.app.follow_weights(wanted)  # type: ignore[attr-defined]
