"""Cells of a CSV to numbers, many at once; an empty cell is nan."""

from __future__ import annotations

import io
import math
import re
from collections.abc import Sequence

import numpy as np

from gcs.logs.formats.csv_layout import Layout
from gcs.logs.formats.tables import FloatArray


def load(stream: io.StringIO, layout: Layout, places: Sequence[int]) -> FloatArray:
    """Some columns of rows without empty cells, shape (rows, columns). Raises ValueError for what is no number."""
    delimiter = None if layout.separator == " " else layout.separator
    return np.loadtxt(stream, delimiter=delimiter, usecols=places, ndmin=2, comments=None, quotechar='"')


def _has_empty(text: str, layout: Layout) -> bool:
    """Whether empty cells occur, which numpy refuses."""
    mark = layout.separator
    if mark == " ":
        return False
    return (
        mark * 2 in text or f"\n{mark}" in text or text.startswith(mark) or _blank_cell(mark).search(text) is not None
    )


def _blank_cell(mark: str) -> re.Pattern[str]:
    return re.compile(rf"{re.escape(mark)} *(?:{re.escape(mark)}|\n|$)")


def filled(lines: Sequence[str], layout: Layout) -> io.StringIO:
    """Rows with nan in their empty cells."""
    text = "\n".join(lines)
    if _has_empty(text, layout):
        mark = re.escape(layout.separator)
        text = re.sub(rf"(?m)(^|(?<={mark}))[ ]*(?={mark}|$)", "nan", text)
    return io.StringIO(text)


def value_of(cell: str) -> float | None:
    """nan for an empty cell, None for what is no number."""
    text = cell.strip()
    if not text:
        return math.nan
    if "_" in text or not text.isascii():
        return None
    try:
        return float(text)
    except ValueError:
        return None
