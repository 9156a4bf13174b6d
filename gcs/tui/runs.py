"""Runs: what was flown, whether it is healthy and alike, and what each run, or what part of it, is used for."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

from textual.containers import Container
from textual.widget import Widget

from gcs.desk.state import Choice, DeskState, RunRow
from gcs.tui import desk_words, runs_words
from gcs.tui.actions import Act
from gcs.tui.base import TALL, Split
from gcs.tui.plot import Style
from gcs.tui.state import State
from gcs.tui.widgets.lines import Lines
from gcs.tui.widgets.traces import Traces

if TYPE_CHECKING:
    from gcs.analysis.alike import Alike


class RunsScreen(Split):
    """The runs of the flight that is open; the one under the mark as strips."""

    NAME = "Runs"
    NO_PLOT = "no samples of this run"
    ACTS = (
        Act("up", "move(-1)", "", "mark the run above", "up"),
        Act("down", "move(1)", "", "mark the run below", "down"),
        Act("f,F", "choose('FIT')", "fit", "use the marked run to fit"),
        Act("v,V", "choose('VALIDATE')", "validate", "use the marked run to validate"),
        Act("x,X", "choose('OUT')", "out", "leave the marked run out"),
        Act("a,A", "only_alike", "", "leave out runs that are not like the others"),
        Act("s,S", "split", "split", "of each axis every second run validates; once more, the others"),
        Act("h,H", "halve", "half", "the marked run's first half is fitted, the second validates"),
        Act("c,C", "cut_begin", "from", "the marked run begins at the cursor (left, right, click)"),
        Act("e,E", "cut_end", "to", "the marked run ends at the cursor"),
        Act("w,W", "whole", "all", "the marked run as it was flown, not a part of it"),
        Act("enter", "alone", "", "fit the marked run's axis to it alone", "enter"),
        Act("i,I", "app.fetch_log", "log", "fetch the flight's log off the vehicle"),
        Act("o,O", "app.open_flight", "open", "open another flight folder or log"),
        Act("m,M", "app.rename", "", "name the flight"),
        Act("d,D", "app.keep_in", "", "keep results in another folder"),
        Act("pagedown", "scroll(5)", "", "scroll the reasons down", "page down"),
        Act("pageup", "scroll(-5)", "", "scroll the reasons up", "page up"),
    )

    def __init__(self, style: Style) -> None:
        super().__init__(style)
        self.at = 0
        self._rows: tuple[RunRow, ...] = ()
        self._like: Alike | None = None
        self._like_of: tuple[object, ...] = ()

    @property
    def roomy(self) -> bool:
        """Strips and reasons are both short enough for any screen."""
        return True

    def body(self) -> Iterable[Widget]:
        yield Lines(self.style, "title")
        yield Lines(self.style, "head")
        yield Lines(self.style, "rows")
        yield Lines(self.style, "unlike")
        with Container(id="split"):
            yield self.scrolled()
            with Container(id="drawn"):
                yield from self.drawn()

    @property
    def marked(self) -> str:
        """What a command calls the run under the mark; empty where there is none."""
        return self._rows[self.at].word if 0 <= self.at < len(self._rows) else ""

    def action_move(self, lines: int) -> None:
        """The mark."""
        self.at += lines
        self.app.run_look()  # type: ignore[attr-defined]

    def action_mark(self, number: int) -> None:
        """The run that was pressed."""
        self.at = number
        self.app.run_look()  # type: ignore[attr-defined]

    def action_choose(self, choice: str) -> None:
        """Use the marked run so."""
        self.app.use_run(self.at, Choice[choice])  # type: ignore[attr-defined]

    def action_only_alike(self) -> None:
        """Leave out what is not like the others."""
        self.app.use_alike()  # type: ignore[attr-defined]

    def action_split(self) -> None:
        """Every second run validates."""
        self.app.split_runs()  # type: ignore[attr-defined]

    def action_halve(self) -> None:
        """Half and half."""
        self.app.halve_run(self.marked)  # type: ignore[attr-defined]

    def action_cut_begin(self) -> None:
        """From the cursor on."""
        self._cut(begin=True)

    def action_cut_end(self) -> None:
        """To the cursor."""
        self._cut(begin=False)

    def _cut(self, *, begin: bool) -> None:
        cursor = self.query_one("#plot", Traces).cursor
        if cursor is None:
            self.app.notice("left, right or a click put the cursor on the strip first")  # type: ignore[attr-defined]
            return
        ends = (cursor, None) if begin else (None, cursor)
        self.app.cut_run(self.marked, *ends)  # type: ignore[attr-defined]

    def action_whole(self) -> None:
        """All of it."""
        self.app.whole_run(self.marked)  # type: ignore[attr-defined]

    def action_alone(self) -> None:
        """One axis of one run."""
        self.app.fit_alone(self.marked)  # type: ignore[attr-defined]

    def likeness(self, desk: DeskState) -> Alike:
        """Of the chosen runs, looked at again where they are others."""
        from gcs.analysis.alike import alike  # numpy over all samples

        rows = runs_words.chosen(desk.runs)
        key = tuple((row.id, id(row.record)) for row in rows)
        if self._like is None or key != self._like_of:
            self._like, self._like_of = alike([record for row in rows if (record := row.named_record) is not None]), key
        return self._like

    def show_body(self, state: State, width: int) -> None:
        desk = state.desk
        self._rows = desk.runs
        self.at = max(0, min(self.at, len(desk.runs) - 1))
        like = self.likeness(desk)
        short = self.size.height < TALL
        rows, unlike = self.query_one("#rows", Lines), self.query_one("#unlike", Lines)
        rows.styles.height = min(max(1, len(desk.runs)), 4 if short else self.size.height - 22)
        said = [*runs_words.airframe_lines(desk, width), *runs_words.unlike_lines(like, width, 2 if short else 5)]
        unlike.display = bool(said)
        unlike.styles.height = len(said)
        row = desk.runs[self.at] if desk.runs else None
        self.lay_out(row is not None and row.record is not None)
        if not self.changed(desk, self.at, width, rows.size.height, self.text_width):
            return
        self.query_one("#title", Lines).show([desk_words.flight_line(state, width)])
        self.query_one("#head", Lines).show([runs_words.run_head(width, like)])
        rows.show(runs_words.run_rows(desk, self.at, width, max(1, rows.size.height), like))
        unlike.show(said)
        self.put_text(runs_words.run_details(desk, self.at, self.text_width))
        self._draw(row)

    def _draw(self, row: RunRow | None) -> None:
        # imported here: the desk's choices read logs
        from gcs.tui.draw_run import run_strip

        plot = None if row is None else run_strip(row)
        if row is not None and plot is not None:
            self.put_plot(plot, row.word)
