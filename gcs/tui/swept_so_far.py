"""How far a sweep has come along its frequencies, and how well the rate followed it there, while it is still flown.

A glance and no verdict: the verdict after the run looks at all of it (`gcs.flight.verdict`).
"""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from gcs.flight.live import LiveWindow
from gcs.tui.plot import Style
from gcs.tui.state import Swept
from sysid.data.coherence import coherence

FloatArray = NDArray[np.float64]
SEGMENT_S = 2.0
"""Long enough for two periods at 1 Hz, short enough that a sweep of 15 s has some."""
LEAST_SEGMENTS = 3
HEIGHTS = "▁▂▃▄▅▆▇█"
CELLS = 20
"""Of the sweep's frequencies, on a logarithmic axis."""
FIELDS = {"roll": ("excitation_x", "p"), "pitch": ("excitation_y", "q")}


def coherence_so_far(window: LiveWindow, swept: Swept) -> tuple[float | None, ...]:
    """Squared coherence of the swept axis' rate with its excitation, 0 to 1, in `CELLS` cells from the lowest to the
    highest frequency; None where the sweep has not been yet, or where the log tells no excitation."""
    nothing: tuple[float | None, ...] = (None,) * CELLS
    if swept.axis not in FIELDS or window.t.size < 4:
        return nothing
    u, y = (np.asarray(getattr(window, name)) for name in FIELDS[swept.axis])
    known = np.isfinite(u) & np.isfinite(y)
    t, u, y = window.t[known], u[known], y[known]
    if t.size < 4:
        return nothing
    step = float(np.median(np.diff(t)))
    n = round(SEGMENT_S / step) if step > 0 else 0
    if n < 8 or t.size < (LEAST_SEGMENTS + 1) * n // 2:
        return nothing
    values, f = coherence(u, y, n), np.fft.rfftfreq(n, step)
    edges = np.geomspace(swept.low_hz, swept.high_hz, CELLS + 1)
    found = []
    for low, high in pairwise(edges):
        within = (f >= low) & (f < high)
        nearest = int(np.argmin(np.abs(f - math.sqrt(low * high))))  # where a cell is narrower than a bin
        found.append(float(values[within].mean() if within.any() else values[nearest]))
    return tuple(value if edges[i] < swept.at_hz else None for i, value in enumerate(found))


def coherence_bar(values: tuple[float | None, ...], style: Style) -> str:
    """A cell for each: as high as the coherence, a dot where the sweep has not been yet."""
    heights = "123456789" if style == "ascii" else HEIGHTS
    return "".join(
        ("." if style == "ascii" else "·")
        if value is None
        else heights[min(len(heights) - 1, max(0, int(value * len(heights))))]
        for value in values
    )
