"""A box of rows of characters, redrawn only where they changed."""

from __future__ import annotations

from functools import lru_cache

from rich.segment import Segment
from rich.style import Style as RichStyle
from textual.geometry import Region
from textual.strip import Strip
from textual.widget import Widget

from gcs.link.decode import sanitise
from gcs.tui.plot import Ink, Row, Style
from gcs.tui.words import plain

_SIGNS = str.maketrans({"√": "rt", "Δ": "d"})
"""What `plain` does not know."""


@lru_cache(maxsize=512)
def _harmless(text: str, style: Style) -> str:
    text = sanitise(text)
    return plain(text.translate(_SIGNS), style) if style == "ascii" else text


class Canvas(Widget):
    """Shows rows that are as wide as it is. What is drawn how is told by component classes; see DEFAULT_CSS.

    No sign is told by colour alone: model and both are bold besides, the cursor is reversed.
    """

    COMPONENT_CLASSES = {
        "plot--measured", "plot--model", "plot--both", "plot--residual", "plot--reference", "plot--grid", "plot--text",
        "plot--title", "plot--cursor", "plot--mark", "plot--full", "plot--rest", "plot--heat1", "plot--heat2",
        "plot--heat3", "plot--heat4", "plot--shaded",
    }  # fmt: skip
    DEFAULT_CSS = """
    Canvas { width: 1fr; height: 1fr; }
    Canvas > .plot--measured { color: $foreground; }
    Canvas > .plot--model { color: $text-warning; text-style: bold; }
    Canvas > .plot--both { color: $text-primary; text-style: bold; }
    Canvas > .plot--residual { color: $text-success; }
    Canvas > .plot--reference { color: $text-muted; }
    Canvas > .plot--grid { color: $text-muted; }
    Canvas > .plot--text { color: $foreground; }
    Canvas > .plot--title { color: $foreground; text-style: bold; }
    Canvas:focus > .plot--title { text-style: bold underline; }
    Canvas > .plot--cursor { text-style: reverse; }
    Canvas > .plot--mark { color: $text-warning; text-style: bold; }
    Canvas > .plot--full { color: $text-primary; }
    Canvas > .plot--rest { color: $text-accent; }
    Canvas > .plot--heat1 { color: $text-muted; }
    Canvas > .plot--heat2 { color: $text-accent; }
    Canvas > .plot--heat3 { color: $text-warning; }
    Canvas > .plot--heat4 { color: $text-error; }
    Canvas > .plot--shaded { background: $primary 25%; }
    """

    def __init__(self, style: Style, id: str) -> None:
        super().__init__(id=id)
        self._style: Style = style
        self._rows: tuple[Row, ...] = ()
        self._strips: list[Strip | None] = []
        self._inks: dict[Ink, RichStyle] = {}
        self._shaded: tuple[Region, ...] = ()

    @property
    def shown(self) -> str:
        """What stands there, as plain text."""
        return "\n".join("".join(text for text, _ in row) for row in self._rows)

    def said(self, text: str) -> str:
        """A text made harmless; in `ascii` only ASCII."""
        return _harmless(text, self._style)

    def put(self, rows: tuple[Row, ...], shaded: tuple[Region, ...] = ()) -> None:
        """Show these rows, as many as the box is high; `shaded`: parts of it on another ground."""
        before, self._rows = self._rows, rows
        elsewhere, self._shaded = shaded != self._shaded, shaded
        if len(before) != len(rows) or elsewhere:
            self._strips = [None] * len(rows)
            self.refresh()
            return
        changed = [y for y, (old, new) in enumerate(zip(before, rows, strict=True)) if old != new]
        if not changed:
            return
        for y in changed:
            self._strips[y] = None
        width = self.size.width
        if len(changed) > len(rows) // 2:
            self.refresh()
        else:
            self.refresh(*(Region(0, y, width, 1) for y in changed))

    def redraw(self) -> None:
        """Make the rows anew: the box has another size."""

    def on_resize(self) -> None:
        self.redraw()

    def notify_style_update(self) -> None:
        self._inks = {}
        self._strips = [None] * len(self._rows)
        super().notify_style_update()

    def render_line(self, y: int) -> Strip:
        if not 0 <= y < len(self._rows):
            return Strip.blank(self.size.width, self.rich_style)
        strip = self._strips[y]
        if strip is None:
            row = self._rows[y]
            strip = Strip([Segment(text, self._ink(ink)) for text, ink in row if text], self.size.width)
            if strip.cell_length != sum(segment.cell_length for segment in strip):
                strip = Strip(list(strip)).adjust_cell_length(self.size.width, self.rich_style)
            for part in self._shaded:
                strip = self._on_ground(strip, part) if part.y <= y < part.bottom else strip
            self._strips[y] = strip
        return strip

    def _on_ground(self, strip: Strip, part: Region) -> Strip:
        """A strip with some columns on the ground of what is looked at; the signs stay as they are."""
        ground = RichStyle(bgcolor=self.get_component_rich_style("plot--shaded").bgcolor)
        inside = strip.crop(part.x, part.right)
        within = [Segment(text, ground if style is None else style + ground) for text, style, _ in inside]
        return Strip([*strip.crop(0, part.x), *within, *strip.crop(part.right)], strip.cell_length)

    def _ink(self, ink: Ink) -> RichStyle:
        found = self._inks.get(ink)
        if found is None:
            found = self.get_component_rich_style("plot--text" if ink == "blank" else f"plot--{ink}")
            self._inks[ink] = found
        return found
