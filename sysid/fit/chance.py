"""Chances of chi squared, in logarithms, so that none is too small to tell.

SciPy has them too, and takes half a second to load, longer than most questions take to answer.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import lru_cache

import numpy as np

from sysid.model.structure import FloatArray

LARGE = 20.0
"""From here on a series in the inverse square tells the error function to eleven digits."""
HALVINGS = 80


def log_chance(chi_squared: float, degrees: int) -> float:
    """Logarithm of the chance that chi squared of so many degrees is larger, however small that is."""
    if not chi_squared > 0:
        return 0.0 if chi_squared <= 0 else math.nan
    return min(0.0, float(_log_chances(0.5 * chi_squared, degrees % 2, degrees // 2)[-1]))


def log_chance_of_normal(deviation: float) -> float:
    """Logarithm of the chance that a normal deviate is further from zero than this, to either side."""
    x = deviation / math.sqrt(2)
    if x < LARGE:
        return math.log(math.erfc(x))
    y = 0.5 / x**2
    return -(x**2) - math.log(x * math.sqrt(math.pi)) + math.log1p(-y * (1 - 3 * y * (1 - 5 * y * (1 - 7 * y))))


@lru_cache(maxsize=64)
def exceeded_by(chance: float, degrees: int) -> float:
    """The chi squared that noise exceeds with this chance."""
    return _root(lambda x: math.log(chance) - log_chance(x, degrees), degrees)


@lru_cache(maxsize=64)
def noncentrality(limit: float, degrees: int, missed: float) -> float:
    """How far from zero, squared and in standard errors, what is there must be so that chi squared stays below the
    limit with this chance only."""
    return _root(lambda x: _beyond(limit, degrees, x) - (1 - missed), max(limit, 1.0))


def _beyond(limit: float, degrees: int, noncentral: float) -> float:
    """The chance that such a chi squared exceeds the limit: those of central ones, weighed as Poisson has it."""
    half = 0.5 * noncentral
    j = np.arange(int(half + 12 * math.sqrt(half) + 40))
    log_weights = j * math.log(half) - half - np.concatenate([[0.0], np.cumsum(np.log(j[1:]))])
    chances = _log_chances(0.5 * limit, degrees % 2, degrees // 2 + j.size - 1)[degrees // 2 :]
    return float(np.sum(np.exp(log_weights + chances)))


def _log_chances(x: float, odd: int, most: int) -> FloatArray:
    """Logarithms of the chances that chi squared exceeds 2 x, (most + 1,), of 2 j + odd degrees: two degrees more add
    one term, and all terms are positive."""
    first = math.log(math.erfc(math.sqrt(x))) if odd and x < LARGE**2 else -math.inf
    if odd and first == -math.inf:
        first = log_chance_of_normal(math.sqrt(2 * x))
    order = np.arange(most) + 0.5 * odd
    # x^order / Gamma(order + 1) exp(-x)
    log_gamma = math.lgamma(1 + 0.5 * odd) + np.concatenate([[0.0], np.cumsum(np.log(order[1:]))])[:most]
    terms = np.concatenate([[first], order * math.log(x) - x - log_gamma])
    return np.asarray(np.logaddexp.accumulate(terms))


def _root(rising: Callable[[float], float], begin: float) -> float:
    """Where a rising function of positive numbers passes zero."""
    low, high = 0.0, begin
    while rising(high) < 0:
        low, high = high, 2 * high
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        if middle in (low, high):
            break
        low, high = (middle, high) if rising(middle) < 0 else (low, middle)
    return 0.5 * (low + high)
