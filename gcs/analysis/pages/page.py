"""One HTML document without outside references, and figures as parts of it."""

from __future__ import annotations

import html
import io
from collections.abc import Sequence
from typing import Any

# Okabe and Ito: told apart by colour-blind eyes

BLACK, BLUE, ORANGE, GREEN = "#222222", "#0072B2", "#D55E00", "#009E73"

STYLE = """
body { font: 15px/1.5 system-ui, sans-serif; max-width: 62rem; margin: 2rem auto; padding: 0 1rem; color: #222; }
pre { background: #f6f6f4; padding: .8rem 1rem; overflow-x: auto; line-height: 1.35; white-space: pre-wrap; }
svg { max-width: 100%; height: auto; }
h2 { margin-top: 2.2rem; border-bottom: 1px solid #ddd; }
"""


def page(title: str, sections: Sequence[tuple[str, str, Sequence[str]]]) -> str:
    """Heading, preformatted text and SVG pictures for each section -> one HTML document without outside references."""
    parts = [
        "<!doctype html><html lang='en'><head><meta charset='utf-8'>",
        f"<title>{html.escape(title)}</title><style>{STYLE}</style></head><body><h1>{html.escape(title)}</h1>",
    ]
    for heading, text, pictures in sections:
        if heading:
            parts.append(f"<h2>{html.escape(heading)}</h2>")
        if text:
            parts.append(f"<pre>{html.escape(text)}</pre>")
        parts += pictures
    return "\n".join([*parts, "</body></html>", ""])


def svg(figure: Any) -> str:
    """A figure as an SVG element to stand in a page."""
    stream = io.StringIO()
    # a second to load: only where something is drawn
    from matplotlib import rc_context

    with rc_context({"svg.hashsalt": "tippath"}):  # the same figure gives the same page
        figure.savefig(stream, format="svg", metadata={"Date": None})
    text = stream.getvalue()
    return text[text.index("<svg") :]
