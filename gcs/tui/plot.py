"""A signal as rows of characters, with no peak lost.

Every column of dots covers a fixed slice of time and is filled from the least to the largest sample in it, so a spike
of one sample is as tall on the screen as in the data. Slices lie on a fixed grid of time: the picture moves along as
time passes, and does not shimmer. Pure functions of arrays; nothing here knows a terminal.
"""

from __future__ import annotations

import math
from typing import Literal

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
Style = Literal["braille", "block", "ascii"]
STYLES: tuple[Style, ...] = ("braille", "block", "ascii")

_DOTS: dict[Style, tuple[int, int]] = {"braille": (4, 2), "block": (2, 1), "ascii": (2, 1)}
"""Dots in one character: rows, columns."""
_BRAILLE_BITS = np.array([[0x01, 0x08], [0x02, 0x10], [0x04, 0x20], [0x40, 0x80]])
_GLYPHS = {"block": np.array(list(" ▀▄█")), "ascii": np.array(list(" '.|"))}
_ZERO = {"braille": "·", "block": "·", "ascii": "-"}
_ZERO_EVERY = 6


def envelope(
    t: FloatArray, values: FloatArray, columns: int, span_s: float, end_s: float
) -> tuple[FloatArray, FloatArray]:
    """Least and largest sample in each of `columns` slices of the last `span_s` seconds before `end_s`.

    t increases. Returns two arrays of shape (columns,), NaN where a slice has no sample and none can be drawn between
    its neighbours: samples further apart than a gap (three usual spacings, and a slice) are not joined.
    """
    low = np.full(columns, np.nan)
    high = np.full(columns, np.nan)
    keep = np.isfinite(t) & np.isfinite(values)
    t, values = t[keep], values[keep]
    if columns < 1 or not t.size or not span_s > 0:
        return low, high
    slice_s = span_s / columns
    first = math.floor(end_s / slice_s) - columns + 1
    slot = np.floor(t / slice_s).astype(np.int64) - first
    inside = (slot >= 0) & (slot < columns)
    if inside.any():
        slots, samples = slot[inside], values[inside]
        starts = np.flatnonzero(np.diff(slots, prepend=-1) != 0)
        low[slots[starts]] = np.minimum.reduceat(samples, starts)
        high[slots[starts]] = np.maximum.reduceat(samples, starts)
    if t.size > 1:
        spacing = np.diff(t)
        gap_s = max(3 * float(np.median(spacing)), 1.01 * slice_s)
        empty = np.flatnonzero(np.isnan(low))
        middle = (empty + first + 0.5) * slice_s
        after = np.searchsorted(t, middle)
        between = (after > 0) & (after < t.size)
        after = np.clip(after, 1, t.size - 1)
        between &= spacing[after - 1] <= gap_s
        level = np.interp(middle, t, values)[between]
        low[empty[between]] = level
        high[empty[between]] = level
    return low, high


def chart(low: FloatArray, high: FloatArray, rows: int, columns: int, limit: float, style: Style) -> list[str]:
    """Draw an envelope of shape (columns * dots,) between -limit and +limit as `rows` lines of `columns` characters.

    What lies outside is drawn at the edge. Neighbouring columns are joined, so that a steep signal has no holes.
    """
    down, across = _DOTS[style]
    height = rows * down
    to_dot = (height - 1) / (2 * limit)
    top = np.clip(np.rint((limit - high) * to_dot), 0, height - 1)
    bottom = np.clip(np.rint((limit - low) * to_dot), 0, height - 1)
    # Joined: each column reaches to where the one before it ended.
    before_top, before_bottom = np.roll(top, 1), np.roll(bottom, 1)
    before_top[:1], before_bottom[:1] = np.nan, np.nan
    top = np.fmin(top, np.where(np.isnan(top), np.nan, before_bottom))
    bottom = np.fmax(bottom, np.where(np.isnan(bottom), np.nan, before_top))
    row = np.arange(height)[:, None]
    dots = (row >= top) & (row <= bottom)
    cells = dots.reshape(rows, down, columns, across).transpose(0, 2, 1, 3)
    if style == "braille":
        codes = (cells * _BRAILLE_BITS).sum(axis=(2, 3))
        lines = ["".join(" " if code == 0 else chr(0x2800 + code) for code in line) for line in codes]
    else:
        halves = cells[:, :, 0, 0] + 2 * cells[:, :, 1, 0]
        lines = ["".join(line) for line in _GLYPHS[style][halves]]
    zero = (rows - 1) // 2 if rows % 2 else rows // 2
    marked = list(lines[zero])
    for i in range(0, columns, _ZERO_EVERY):
        if marked[i] == " ":
            marked[i] = _ZERO[style]
    lines[zero] = "".join(marked)
    return lines


def dots_across(columns: int, style: Style) -> int:
    """How many slices of time `columns` characters show."""
    return columns * _DOTS[style][1]


def round_limit(largest: float, least: float) -> float:
    """The scale for a signal that reaches `largest`: the next of 1, 2, 5 times a power of ten, at least `least`."""
    if not math.isfinite(largest) or largest <= least:
        return least
    power = 10.0 ** math.floor(math.log10(largest))
    return next(step * power for step in (1.0, 2.0, 5.0, 10.0) if step * power >= largest * (1 - 1e-9))


def bar(share: float, width: int, style: Style) -> str:
    """A horizontal bar, full at 1; more than full is full."""
    filled = 0 if not share > 0 else min(width, max(1, round(share * width)))
    full, rest = ("#", ".") if style == "ascii" else ("▓", "░")
    return full * filled + rest * (width - filled)
