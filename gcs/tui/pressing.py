"""Words that can be pressed: a click, or a finger on a tablet, does what their key does.

The action is one of Textual's, `app.abort` or `screen.mark(3)`; it is looked up where the word stands, behind no
other screen.
"""

from __future__ import annotations

from collections.abc import Iterable

from textual.content import Content, Span
from textual.style import Style

from gcs.tui.actions import Act


def pressed(text: str, action: str, style: str = "") -> tuple[str, Style]:
    """A text that does this when it is pressed."""
    return text, Style.parse(style) + _doing(action)


def pressing_keys(text: str, acts: Iterable[Act], style: str = "") -> Content:
    """A line of keys, `R ready  S start`: each with its word presses the key."""
    spans = [Span(0, len(text), style)] if style else []
    for act in acts:
        words = f"{act.key} {act.word}"
        at = text.find(words) if act.word else -1
        if at >= 0:
            spans.append(Span(at, at + len(words), _doing(here(act.action))))
    return Content(text, spans=spans)


def here(action: str) -> str:
    """An action as it is called from a word: a screen's own is the screen's."""
    return action if action.startswith("app.") else f"screen.{action}"


def _doing(action: str) -> Style:
    return Style.from_meta({"@click": action})
