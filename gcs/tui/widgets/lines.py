"""Lines of text that are never markup, obey nobody and never wrap, redrawn only where they changed."""

from __future__ import annotations

from collections.abc import Sequence

from textual.content import Content, Span
from textual.style import Style
from textual.widgets import Static

from gcs.logs.words import harmless
from gcs.tui.plot import Style as PlotStyle
from gcs.tui.words import plain

Line = Content | str | tuple[str, str | Style]
"""Text, text with a style, or content."""


class Lines(Static):
    """A fixed box of text. `style` is the plot style: in `ascii` nothing but ASCII is shown."""

    def __init__(self, style: PlotStyle, id: str) -> None:
        super().__init__("", markup=False, id=id)
        self._style: PlotStyle = style
        self.shown = ""
        """What stands there, as plain text."""
        self._spans: tuple[Span, ...] = ()

    def show(self, lines: Sequence[Line]) -> None:
        """Show these lines."""
        content = Content("\n").join(self._content(line) for line in lines)
        spans = tuple(content.spans)
        if content.plain != self.shown or spans != self._spans:
            self.shown, self._spans = content.plain, spans
            self.update(content, layout=False)

    def _content(self, line: Line) -> Content:
        if isinstance(line, Content):
            text = self._said(line.plain)
            return line if text == line.plain else Content(text, spans=list(line.spans))
        text, style = (line, "") if isinstance(line, str) else line
        return Content.styled(self._said(text), style) if style else Content(self._said(text))

    def _said(self, text: str) -> str:
        """A text made harmless; in `ascii` only ASCII."""
        return plain(harmless(text), self._style)
