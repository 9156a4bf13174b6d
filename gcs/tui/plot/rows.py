"""Characters, with what each is, to one row of the screen; words and values cut to their width."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray
from rich.cells import cell_len, set_cell_size

from gcs.tui.plot.draw import CharArray, Style
from gcs.tui.plot.model import Ink, Row

INKS: tuple[Ink, ...] = (
    "blank", "measured", "model", "both", "reference", "grid", "residual", "cursor", "mark", "text",
    "heat1", "heat2", "heat3", "heat4",
)  # fmt: skip
"""The first four are sums of: 1 the line, 2 the one over it."""

REFERENCE, GRID, RESIDUAL, CURSOR, MARK, TEXT, HEAT = range(4, 11)

CodeArray = NDArray[np.uint8]


def runs(chars: CharArray, codes: CodeArray) -> Row:
    text = "".join(chars.tolist())
    edges = [0, *(np.flatnonzero(codes[1:] != codes[:-1]) + 1).tolist(), len(text)]
    inks = codes[edges[:-1]].tolist() if text else []
    return tuple((text[a:b], INKS[ink]) for a, b, ink in zip(edges[:-1], edges[1:], inks, strict=True))


def fit(text: str, width: int) -> str:
    """Exactly `width` cells."""
    return set_cell_size(text, width) if width > 0 else ""


def figure(value: float, largest: float, signed: bool = True) -> str:
    """A value with as many decimals as a scale up to `largest` is worth."""
    if not math.isfinite(value):
        return "?"
    value += 0.0
    sign = "+" if signed else ""
    if not 1e-3 <= largest < 1e5:
        return f"{value:{sign}.1e}"
    decimals = 2 if 0.1 <= largest <= 10 else min(max(1 - math.floor(math.log10(largest) + 1e-9), 0), 4)
    return f"{value:{sign}.{decimals}f}"


def cut(text: str, width: int, style: Style) -> str:
    """Exactly `width` cells, with an ellipsis where something was cut."""
    if cell_len(text) <= width:
        return fit(text, width)
    return fit(text, max(width - 1, 0)) + ("~" if style == "ascii" else "…") * (width > 0)


def headed(title: str, width: int, style: Style) -> Row:
    """A title in exactly `width` cells, a blank at both sides."""
    said = cut(title, max(width - 2, 0), style).rstrip()
    return ((" ", "text"), (said, "title"), (" " * (width - 1 - cell_len(said)), "text"))
