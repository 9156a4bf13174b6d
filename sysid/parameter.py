"""A parameter: a number with a unit, a meaning and limits that come from physics."""

from __future__ import annotations

import math
from dataclasses import dataclass


@dataclass(frozen=True)
class Parameter:
    """One unknown of a structure."""

    name: str
    """As the paper writes it, in ASCII: `tau_f`, `L_b`."""
    unit: str
    meaning: str
    plausible: tuple[float, float] = (-math.inf, math.inf)
    """Values that physics allows; outside, the estimate is flagged, never changed."""

    def implausible(self, value: float) -> bool:
        low, high = self.plausible
        return not low <= value <= high
