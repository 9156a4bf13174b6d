"""A parameter: a number with a unit, a meaning and limits that come from physics."""

from __future__ import annotations

import math
from dataclasses import KW_ONLY, dataclass

EVERYWHERE = (-math.inf, math.inf)
SURELY = 2.0
"""Standard errors beyond which what physics allows must lie."""


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

    @property
    def sizes(self) -> bool:
        """Whether it says how much there is of an effect. What is usually at its null only says of which kind it is: an
        exponent, of whatever has a size beside it."""
        return self.null is not None and self.null != self.typical

    @property
    def tied(self) -> bool:
        """Whether physics allows none of it in free flight: on a tether or a stand there may be."""
        return self.plausible == (self.null, self.null)

    def implausible(self, value: float, error: float = 0.0) -> bool:
        """Whether physics does not allow an estimate: all that it allows lies beyond SURELY of its standard errors.

        What the data do not determine, with an error that is not finite, is never that.
        """
        low, high = self.plausible
        if not math.isfinite(error):
            return False
        return not low - SURELY * error <= value <= high + SURELY * error
