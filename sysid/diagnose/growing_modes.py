"""Growing modes in a loop: what they seem to foretell, and what that costs (`sysid.fit.growth`).

Feedback holds them, so that a model which has them answers before it is asked: with the controller's answer to the
outputs. By power that is a better model, and by likelihood it is not.
"""

from __future__ import annotations

from collections.abc import Collection

import numpy as np

from sysid.data.dataset import Bins, Dataset
from sysid.fit.estimate import Estimate
from sysid.fit.growth import growth, growth_slopes
from sysid.fit.innovations import Innovations
from sysid.fit.prediction_error import prediction_error
from sysid.fit.whitening import Whitening
from sysid.model.structure import FloatArray, Model

SURELY = 10.0
"""Chi squared that growing modes cost, from which on a fit in a loop is looked at again."""


def cost(model: Model, metric: Whitening) -> float:
    """By how much chi squared of what is new is too small behind them; nothing where no feedback makes commands."""
    return 2 * metric.seconds * growth(model.structure, model.values) if isinstance(metric, Innovations) else 0.0


def cost_slopes(model: Model, metric: Whitening) -> FloatArray:
    """Of half of it to the parameters, (parameters,)."""
    if not isinstance(metric, Innovations):
        return np.zeros(model.values.size)
    return metric.seconds * growth_slopes(model.structure, model.values)


def likeliest(found: Estimate, on: Dataset, bins: Bins, fixed: Collection[str]) -> Estimate:
    """The estimate; in a loop, where its growing modes cost surely more than nothing, the one that foretells best."""
    structure, seconds = found.model.structure, sum(one.samples * one.dt for one in bins.spectra)
    if not (on.in_a_loop and structure.linear):
        return found
    costly = 2 * seconds * growth(structure, found.model.values) > SURELY
    return (prediction_error(found, bins, fixed) if costly else None) or found
