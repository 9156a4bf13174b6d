"""Whether values together are what physics allows, where each may be so by its own standard error."""

from __future__ import annotations

from collections.abc import Collection

import numpy as np

from sysid.diagnose.evidence import Candidate
from sysid.diagnose.score import log_chance

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
