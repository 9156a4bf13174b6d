"""Whether values are what physics allows, where standard errors of each do not tell: together, or by their sign."""

from __future__ import annotations

from collections.abc import Collection

import numpy as np

from sysid.diagnose.evidence import Candidate
from sysid.diagnose.score import log_chance
from sysid.model.effect import Effect
from sysid.model.parameter import Parameter

DETERMINED = 1e-10
"""Of a correlation's axes, the least."""
EXACT = 1e-6
"""Standard errors that count as none."""
TOGETHER = 3.0
"""Standard deviations of one parameter, as seldom as which plausible values of all may be off."""


def out_of_reach(one: Candidate, names: Collection[str]) -> bool:
    """Whether no plausible values of these parameters are near enough to their estimates."""
    # heavier than NumPy itself to load: only where it is needed
    from scipy.optimize import lsq_linear

    parameters = [each for each in one.model.structure.parameters if each.name in names and each.name in one.free]
    places = [one.model.structure.names.index(each.name) for each in parameters]
    covariance, values = one.estimate.covariance[np.ix_(places, places)], one.model.values[places]
    error = np.sqrt(np.maximum(np.diag(covariance), 0))
    if len(places) < 2 or not (np.all(np.isfinite(covariance)) and np.all(error > 0)):
        return False
    inner, axes = np.linalg.eigh(covariance / np.outer(error, error))
    white = (axes / np.sqrt(np.maximum(inner, DETERMINED))).T / error
    low, high = np.array([each.plausible for each in parameters]).T
    wide = np.maximum(high, low + EXACT * error)  # one value alone may be plausible
    apart = 2 * lsq_linear(white, white @ values, (low, wide), "bvls").cost
    return log_chance(apart, len(places)) < log_chance(TOGETHER**2, 1)


def of_the_wrong_sign(effect: Effect, one: Candidate) -> frozenset[str]:
    """Its sizes, where physics allows one sign of them alone and each was found with the other: whatever their errors,
    the nearest that it allows is no effect at all, which explains nothing."""
    sizes = [each for each in effect.parameters if each.sizes and each.name not in one.held]
    found = sizes and all(each.null in each.plausible and each.plausible[0] < each.plausible[1] for each in sizes)
    wrong = found and all(_beyond_none(each, one) for each in sizes)
    return frozenset(each.name for each in sizes) if wrong else frozenset()


def _beyond_none(size: Parameter, one: Candidate) -> bool:
    """Whether it was found on the side of none on which physics allows nothing."""
    low, high = size.plausible
    value = one.model[size.name]
    return value < low if size.null == low else value > high
