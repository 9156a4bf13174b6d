"""A parameter: a number with a unit, a meaning and limits that come from physics."""

from __future__ import annotations

import math
from dataclasses import KW_ONLY, dataclass

EVERYWHERE = (-math.inf, math.inf)


@dataclass(frozen=True)
class Parameter:
    """One unknown of a structure."""

    name: str
    """As the paper writes it, in ASCII: `tau_f`, `L_b`."""
    unit: str
    meaning: str
    plausible: tuple[float, float] = EVERYWHERE
    """Values that physics allows; outside, the estimate is flagged, never changed."""
    null: float | None = None
    """Where an effect leaves the base unchanged; infinite for a rate or a limit; None where there is none."""
    _: KW_ONLY
    bounds: tuple[float, float] = EVERYWHERE
    """Hard limits for the optimiser: beyond them the equation means nothing."""
    typical: float = 1.0
    """A size met in practice: where a search begins and what a test plants."""
    grid: tuple[float, ...] = ()
    """Values to begin from one by one, where the cost may have several valleys or the null tells nothing."""

    def implausible(self, value: float) -> bool:
        low, high = self.plausible
        return not low <= value <= high
