"""One HTML document without outside references, and figures as parts of it.

The template escapes whatever it is given, so that names and notes are harmless whatever they hold; only the figures,
which Matplotlib escapes itself, go in as they are. The page allows nobody to load or run anything: its first words say
so to the browser.
"""

from __future__ import annotations

import io
import re
import warnings
from typing import Any

from gcs.analysis.pages.parts import Document, Picture, numbered

# Okabe and Ito: told apart by colour-blind eyes

BLACK, BLUE, ORANGE, GREEN = "#222222", "#0072B2", "#D55E00", "#009E73"

FONTS = re.compile(r"(?<=style=\")([^\"]*?)'DejaVu Sans'[^\"]*?sans-serif")
PLACES = re.compile(r' (?:d|x|y)="[^"]*"')
FINE = re.compile(r"(\.\d)\d+")
METADATA = re.compile(r"<metadata>.*?</metadata>", re.DOTALL)
IDS = re.compile(r' id="[A-Za-z0-9.]+_[0-9]+"')
"""That nothing refers to, and every figure has."""
BETWEEN = re.compile(r">\s+<")
PATH = re.compile(r' d="([^"]*)"')
STEP = re.compile(r"([ML])\s*(-?[\d.]+(?:e-?\d+)?)\s+(-?[\d.]+(?:e-?\d+)?)\s*")


def page(document: Document) -> str:
    """A document as HTML."""
    from markupsafe import Markup

    parts = numbered([section.parts for section in document.sections])
    sections = [
        (number, section, [(count, type(part).__name__, part) for count, part in each])
        for number, (section, each) in enumerate(zip(document.sections, parts, strict=True), 1)
    ]
    contents = [(number, section.heading) for number, section, _ in sections if section.heading]

    def drawn(picture: Picture) -> Markup:
        return Markup(svg(picture.figure))  # Matplotlib's own, in which it escapes texts

    return rendered("page.html.jinja", document=document, sections=sections, contents=contents, svg=drawn)


def rendered(template: str, *, room: str = "gcs.analysis.pages", **values: Any) -> str:
    """A template of this folder, or of another room's, with these values, each of them escaped."""
    # a twentieth of a second to load: only where a page is made
    from jinja2 import Environment, PackageLoader, StrictUndefined

    environment = Environment(
        loader=PackageLoader(room, ""), autoescape=True, undefined=StrictUndefined, trim_blocks=True
    )
    return f"{environment.get_template(template).render(**values)}\n"


def svg(figure: Any, *, outlined: bool = False) -> str:
    """A figure as an SVG element to stand in a page. `outlined`: letters as their outlines, for who has no fonts."""
    stream = io.StringIO()
    # a second to load: only where something is drawn
    from matplotlib import rc_context

    settings = {"svg.hashsalt": "tippath", "svg.fonttype": "path" if outlined else "none"}
    if outlined:
        _clip_each_area(figure)
    with rc_context(settings), warnings.catch_warnings():  # the same figure gives the same page
        warnings.filterwarnings("ignore", message="Glyph .* missing")  # in a name, say; a box stands for it
        figure.savefig(stream, format="svg", metadata={"Date": None})
        figure.set_layout_engine("none")  # it is laid out: to do it again takes as long as to draw it
    text = stream.getvalue()
    text = text[text.index("<svg") :]
    text = BETWEEN.sub("><", IDS.sub("", METADATA.sub("", text)))
    text = PLACES.sub(lambda found: FINE.sub(r"\1", found.group(0)), PATH.sub(_short, text))
    return FONTS.sub(r"\1sans-serif", text)


def _clip_each_area(figure: Any) -> None:
    """Each area as a path with its own clip: fpdf2 clips paths, and nothing within a clipped group.

    As such a group Matplotlib writes a single area that is smaller than the figure, unless its links are several.
    """
    from matplotlib.collections import PolyCollection

    for area in figure.findobj(PolyCollection):
        area.set_urls([None, None])


def _short(found: re.Match[str]) -> str:
    """The path of a line in steps of a tenth of a point, each from the one before; any other as it is.

    Rounded are places, not steps, so that errors do not add up.
    """
    path = found.group(1)
    steps = STEP.findall(path)
    if len(steps) < 8 or STEP.sub("", path).strip():
        return found.group(0)
    written, x, y = [], 0, 0
    for command, right, down in steps:
        to_x, to_y = round(10 * float(right)), round(10 * float(down))
        if command == "M":
            written.append(f"M{_tenths(to_x)} {_tenths(to_y)}")
        elif (to_x, to_y) != (x, y):
            written.append(f"l{_tenths(to_x - x)} {_tenths(to_y - y)}")
        x, y = to_x, to_y
    return f' d="{re.sub(" -", "-", "".join(written))}"'


def _tenths(value: int) -> str:
    """`-.3`, `12`."""
    whole = f"{value / 10:g}"
    return whole.replace("0.", ".", 1) if whole.startswith(("0.", "-0.")) else whole


def literal(text: str) -> str:
    """Words of others in a figure: no formulas."""
    return text.replace("$", r"\$")
