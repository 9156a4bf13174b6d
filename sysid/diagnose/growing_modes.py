"""Growing modes in a loop: what they seem to foretell, and what that costs (`sysid.fit.growth`).

Feedback holds them, so that a model which has them answers before it is asked: with the controller's answer to the
outputs. By power that is a better model, and by likelihood it is not.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence

import numpy as np

from sysid.data.dataset import Bins, Dataset
from sysid.fit.estimate import Estimate
from sysid.fit.growth import answered, growth, growth_slopes, misled
from sysid.fit.innovations import Innovations
from sysid.fit.prediction_error import prediction_error
from sysid.fit.whitening import Whitening
from sysid.model.structure import FloatArray


def cost(one: Estimate, metric: Whitening, values: FloatArray | None = None) -> float:
    """By how much chi squared of what is new is too small behind them, of an estimate or at other values of its
    parameters; nothing where no feedback makes commands, or where no loop's answers are what grows (`answered`)."""
    if not (seconds := _answered_s(one, metric)):
        return 0.0
    return 2 * seconds * growth(one.model.structure, one.model.values if values is None else values)


def cost_slopes(one: Estimate, metric: Whitening, names: Sequence[str]) -> FloatArray:
    """Of half of it to these parameters, (names,)."""
    structure = one.model.structure
    if not (seconds := _answered_s(one, metric)):
        return np.zeros(len(names))
    return seconds * growth_slopes(structure, one.model.values)[[structure.names.index(name) for name in names]]


def _answered_s(one: Estimate, metric: Whitening) -> float:
    """For how long a loop may have made what the estimate says of growing modes."""
    return metric.seconds if isinstance(metric, Innovations) and answered(one.model.structure, one.error) else 0.0


def likeliest(found: Estimate, on: Dataset, bins: Bins, fixed: Collection[str]) -> Estimate:
    """The estimate; in a loop, where its growing modes cost surely more than nothing, the one that foretells best."""
    if not (on.in_a_loop and misled(found.model, found.error, bins)):
        return found
    return prediction_error(found, bins, fixed) or found
