"""Shares with their intervals, and whether what is said of sureness is so."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

Z95 = 1.959964
LEAST_IN_A_BIN = 200
BINS_OF_FEW = 5
NEAR_ENOUGH = 0.05


def wilson(count: int, of: int, z: float = Z95) -> tuple[float, float]:
    """The interval of a share in which the truth lies with that many deviations (Wilson 1927). Raises ValueError for
    counts outside 0 to `of`, or none."""
    if not 0 <= count <= of or of == 0:
        raise ValueError(f"{count} of {of} is no share")
    share, more = count / of, z * z / of
    middle = (share + more / 2) / (1 + more)
    half = z / (1 + more) * math.sqrt(share * (1 - share) / of + more / (4 * of))
    return max(0.0, middle - half), min(1.0, middle + half)


def share_of(count: int, of: int) -> str:
    """`7 of 9 (77.8 %, 45.3 to 93.7)`: the second pair is the 95 % interval."""
    if of == 0:
        return "no flight"
    low, high = wilson(count, of)
    return f"{count} of {of} ({100 * count / of:.1f} %, {100 * low:.1f} to {100 * high:.1f})"


@dataclass(frozen=True, slots=True)
class Bin:
    """Answers of nearly the same confidence."""

    confidence: float
    """Their mean."""
    right: int
    answers: int

    @property
    def kept(self) -> bool:
        """Whether the confidence is inside the 95 % band of what was right, or near enough."""
        low, high = wilson(self.right, self.answers)
        return low <= self.confidence <= high or abs(self.right / self.answers - self.confidence) <= NEAR_ENOUGH


def reliability(answers: Sequence[tuple[float, bool]], least: int = LEAST_IN_A_BIN) -> list[Bin]:
    """(confidence, whether right) in bins of equal counts, of at least so many; of fewer answers BINS_OF_FEW."""
    bins = len(answers) // least or min(BINS_OF_FEW, len(answers))
    ordered, found = sorted(answers), []
    for i in range(bins):
        some = ordered[i * len(ordered) // bins : (i + 1) * len(ordered) // bins]
        mean = sum(confidence for confidence, _ in some) / len(some)
        found.append(Bin(mean, sum(right for _, right in some), len(some)))
    return found


def threshold_at(rate: float, clean: Sequence[float]) -> float:
    """The statistic that so large a share of clean flights lies at or above; more than all of them where there are too
    few to say."""
    ordered = sorted(clean, reverse=True)
    allowed = math.floor(rate * len(ordered))
    return ordered[allowed] if allowed < len(ordered) else -math.inf


def area_under(hits: Sequence[float], clean: Sequence[float]) -> float:
    """Of the receiver's curve: how likely a flight with the effect shows more than a clean one."""
    if not hits or not clean:
        return math.nan
    wins = sum((hit > other) + 0.5 * (hit == other) for hit in hits for other in clean)
    return wins / (len(hits) * len(clean))
