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
BoolArray = NDArray[np.bool_]
IntArray = NDArray[np.uint8]
CharArray = NDArray[np.str_]
Style = Literal["braille", "block", "ascii"]
STYLES: tuple[Style, ...] = ("braille", "block", "ascii")
Kind = Literal["line", "over", "both", "reference"]

DOTS: dict[Style, tuple[int, int]] = {"braille": (4, 2), "block": (2, 1), "ascii": (2, 1)}
"""Dots in one character: rows, columns."""
_BRAILLE_BITS = np.array([[0x01, 0x08], [0x02, 0x10], [0x04, 0x20], [0x40, 0x80]], dtype=np.uint8)
_QUADRANTS = np.array(list(" ▘▝▀▖▌▞▛▗▚▐▜▄▙▟█"))
_QUARTERS = (0x03, 0x18, 0x44, 0xA0)
"""Braille's bits in each quarter of a character, in the order of the quadrants' own bits."""
_THIRDS = (0x09, 0x36, 0xC0)
"""Braille's bits at the top, in the middle and at the bottom of a character."""
GLYPHS: dict[Style, dict[Kind, CharArray]] = {
    "block": {
        "line": np.array(list(" ▀▄█")),
        "over": np.array(list(" ¯_▒")),
        "both": np.array(list(" ▘▖▌")),
        "reference": np.array(list(" ··:")),
    },
    "ascii": {
        "line": np.array(list(" '.|")),
        "over": np.array(list(" ^_!")),
        "both": np.array(list(" *o#")),
        "reference": np.array(list(" ~~=")),
    },
}
"""By which of the upper and the lower dot is there: none, upper, lower, both."""
ZERO: dict[Style, str] = {"braille": "·", "block": "·", "ascii": "-"}
EDGE: dict[Style, str] = {"braille": "┊", "block": "┊", "ascii": ":"}
"""Where a shaded part of the axis begins and ends."""
ZERO_EVERY = 6


def envelope(
    t: FloatArray, values: FloatArray, columns: int, span_s: float, end_s: float
) -> tuple[FloatArray, FloatArray]:
    """Least and largest sample in each of `columns` slices of the last `span_s` seconds before `end_s`.

    t increases. Returns two arrays of shape (columns,), NaN where a slice has no sample and none can be drawn between
    its neighbours: samples further apart than a gap (three usual spacings, and a slice) are not joined.
    """
    keep = np.isfinite(t) & np.isfinite(values)
    t, values = t[keep], values[keep]
    if columns < 1 or not t.size or not span_s > 0:
        return np.full(max(columns, 0), np.nan), np.full(max(columns, 0), np.nan)
    slice_s = span_s / columns
    joined = join(t, slice_s) if t.size > 1 else None
    return slices(t, values, math.floor(end_s / slice_s) - columns + 1, slice_s, columns, joined=joined)


def join(x: FloatArray, slice_x: float = 0.0) -> BoolArray:
    """(n - 1,): which neighbours are joined by a line: those that no gap lies between."""
    spacing = np.diff(x)
    return np.asarray(spacing <= max(3 * float(np.median(spacing)), 1.01 * slice_x))


def slices(
    u: FloatArray, values: FloatArray, first: int, slice_u: float, columns: int, joined: BoolArray | None
) -> tuple[FloatArray, FloatArray]:
    """Least and largest sample in the slices number `first` to `first + columns - 1` of width `slice_u`.

    u increases, all (n,) finite; joined: (n - 1,), None: nothing is. Slices between joined samples are filled.
    """
    low = np.full(columns, np.nan)
    high = np.full(columns, np.nan)
    begin = max(0, int(np.searchsorted(u, (first - 1) * slice_u)) - 1)
    end = int(np.searchsorted(u, (first + columns + 1) * slice_u)) + 1
    u, values = u[begin:end], values[begin:end]
    slot = np.floor(u / slice_u) - first
    inside = (slot >= 0) & (slot < columns)
    if inside.any():
        slots, samples = slot[inside].astype(np.int64), values[inside]
        starts = np.flatnonzero(np.diff(slots, prepend=-1) != 0)
        low[slots[starts]] = np.minimum.reduceat(samples, starts)
        high[slots[starts]] = np.maximum.reduceat(samples, starts)
    if joined is not None and u.size > 1:
        empty = np.flatnonzero(np.isnan(low))
        middle = (empty + first + 0.5) * slice_u
        after = np.searchsorted(u, middle)
        between = (after > 0) & (after < u.size)
        after = np.clip(after, 1, u.size - 1)
        between &= joined[begin:end][after - 1]
        level = np.interp(middle, u, values)[between]
        low[empty[between]] = level
        high[empty[between]] = level
    return low, high


def raster(
    low: FloatArray,
    high: FloatArray,
    rows: int,
    columns: int,
    bottom: float,
    top: float,
    style: Style,
    *,
    wraps: bool = False,
) -> BoolArray:
    """An envelope of shape (columns * dots,) as dots, (rows * dots down, columns * dots across), top row first.

    What lies outside is drawn at the edge. Neighbouring columns are joined, so that a steep signal has no holes;
    wraps: not where they are more than half the height apart; a column in which a turn lies has its ends only.
    """
    down = DOTS[style][0]
    height = rows * down
    to_dot = (height - 1) / (top - bottom)
    upper = np.clip(np.rint((top - high) * to_dot), 0, height - 1)
    lower = np.clip(np.rint((top - low) * to_dot), 0, height - 1)
    # Joined: each column reaches to where the one before it ended.
    before_upper, before_lower = np.roll(upper, 1), np.roll(lower, 1)
    before_upper[:1], before_lower[:1] = np.nan, np.nan
    turns = np.zeros(upper.size, dtype=np.bool_)
    if wraps:
        turns = high - low > (top - bottom) / 2
        apart = np.abs(high + low - np.roll(high + low, 1)) > top - bottom
        before_upper[turns | np.roll(turns, 1) | apart] = np.nan
        before_lower[np.isnan(before_upper)] = np.nan
    row = np.arange(height)[:, None]
    ends = (row == upper) | (row == lower)
    upper = np.fmin(upper, np.where(np.isnan(upper), np.nan, before_lower))
    lower = np.fmax(lower, np.where(np.isnan(lower), np.nan, before_upper))
    return np.asarray(np.where(turns, ends, (row >= upper) & (row <= lower)))


def cells(dots: BoolArray, style: Style) -> IntArray:
    """Dots as a number for each character, (rows, columns); 0 where there is none. Glyphs are in its order."""
    down, across = DOTS[style]
    parts = dots.reshape(dots.shape[0] // down, down, dots.shape[1] // across, across).astype(np.uint8)
    if style == "braille":
        return np.asarray(np.einsum("rdca,da->rc", parts, _BRAILLE_BITS))
    return np.asarray(parts[:, 0, :, 0] + 2 * parts[:, 1, :, 0])


def glyphs(numbers: IntArray, style: Style, kind: Kind = "line") -> CharArray:
    """Those numbers as characters, (rows, columns) of str."""
    if style == "braille" and kind == "over":
        parts = [((numbers & bits) > 0) * np.uint8(1 << i) for i, bits in enumerate(_QUARTERS)]
        return np.asarray(_QUADRANTS[np.bitwise_or.reduce(parts)])
    if style == "braille" and kind == "reference":
        top, middle, bottom = ((numbers & bits) > 0 for bits in _THIRDS)
        return np.asarray(np.select([middle, top, bottom], ["─", "▔", "▁"], " "))
    if style == "braille":
        codes = numbers.astype(np.uint32)
        return np.asarray(np.where(codes == 0, 32, codes + 0x2800).astype(np.uint32).view("<U1"))
    return np.asarray(GLYPHS[style][kind][numbers])


def chart(low: FloatArray, high: FloatArray, rows: int, columns: int, limit: float, style: Style) -> list[str]:
    """Draw an envelope of shape (columns * dots,) between -limit and +limit as `rows` lines of `columns` characters."""
    drawn = glyphs(cells(raster(low, high, rows, columns, -limit, top=limit, style=style), style), style)
    zero = zero_row(rows)
    every = np.arange(0, columns, ZERO_EVERY)
    drawn[zero, every[drawn[zero, every] == " "]] = ZERO[style]
    return ["".join(line) for line in drawn]


def zero_row(rows: int) -> int:
    """Where the zero of a centred panel stands."""
    return rows // 2


def dots_across(columns: int, style: Style) -> int:
    """How many slices of time `columns` characters show."""
    return columns * DOTS[style][1]


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
