"""A self-contained page about a flight: tables, checks, and measured against modelled rates for every run."""

from __future__ import annotations

import html
import io
from collections.abc import Sequence
from typing import Any

from sysid.model import Model
from sysid.preprocess import segments, spectrum
from sysid.record import Record
from sysid.simulate import overlay

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


def run_picture(record: Record, models: Sequence[tuple[str, Model]], band_hz: tuple[float, float]) -> str:
    """SVG of one run: commands, then p and q measured against each model, as the fit saw them (inside the band)."""
    figure, axes = _figure(3, (10, 6.2))
    top = axes[0]
    inputs = models[0][1].structure.inputs
    for name, colour in zip(inputs, (BLACK, ORANGE, GREEN), strict=False):
        top.plot(record.t - record.t[0], record.channels[name], color=colour, linewidth=0.6, label=name)
    top.set_ylabel("command")
    top.legend(loc="upper left", fontsize=8, ncols=3)
    for index, output in enumerate(("p", "q")):
        axis = axes[1 + index]
        for part in segments(record, (*inputs, "p", "q"), band_hz[1])[0]:
            one = spectrum(part, inputs, ("p", "q"), band_hz)
            for number, ((label, model), colour) in enumerate(zip(models, (BLUE, ORANGE, GREEN), strict=False)):
                t, measured, modelled = overlay(model, one)
                t = t - record.t[0]
                if number == 0:
                    axis.plot(t, measured[:, index], color=BLACK, linewidth=1.0, label="measured")
                axis.plot(
                    t, modelled[:, index], color=colour, linewidth=0.9, linestyle="--" if number else "-", label=label
                )
        axis.set_ylabel(f"{output}, rad/s")
        axis.legend(loc="upper left", fontsize=8, ncols=4)
    axes[-1].set_xlabel("time in the record, s")
    axes[0].set_title(f"{record.id}   {record.axis or ''} {record.maneuver}", fontsize=10, loc="left")
    return svg(figure)


def _figure(rows: int, size: tuple[float, float]) -> tuple[Any, Any]:
    from matplotlib.figure import Figure

    figure = Figure(figsize=size, layout="constrained")
    axes = figure.subplots(rows, 1, sharex=True)
    for axis in axes:
        axis.grid(True, linewidth=0.3)
        axis.tick_params(labelsize=8)
    return figure, axes


def svg(figure: Any) -> str:
    """A figure as an SVG element to stand in a page."""
    stream = io.StringIO()
    figure.savefig(stream, format="svg")
    text = stream.getvalue()
    return text[text.index("<svg") :]
