"""How fast a model's modes grow: what keeps the likelihood of an unstable model in a loop honest.

On Fourier bins an unstable model is no worse to evaluate than a stable one, but then it answers before it is asked: it
takes the controller's answers to the outputs for their cause. The likelihood knows better. What is new in a sample is a
function of the outputs, whose volume shrinks with every growing mode that the loop holds (Bode's integral of the
sensitivity, pi times the sum of the unstable poles): minus twice the log likelihood is larger by 2 T times that sum.
"""

from __future__ import annotations

import numpy as np

from sysid.data.dataset import Bins
from sysid.fit.output_error import OutputError
from sysid.model.structure import FloatArray, Model, Structure

OWN_ERROR = 0.67
"""Correlation of what is left with the motion (`OutputError.with_motion`), from which on it is for the most part the
model's own error, and of that the likelihood knows nothing. Of 70 strange vehicles it was 0.56 at most, of four that
their loops misled 0.54; of a Crazyflie indoors, fitted with its motors' lag, 0.78 to 0.85."""
SURELY = 10.0
"""Chi squared that growing modes cost, from which on they are more than rounding, or chance."""
STEP = 1e-6
"""Of a parameter, or of one hundredth of its typical size where it is smaller."""


def answered(structure: Structure, error: OutputError) -> bool:
    """Whether growing modes may be the loop's answers to what is left. Not of a bare base: where that grows it lacks
    something, which no likelihood mends. Nor where motion is not linear, of which Bode's integral does not hold."""
    return bool(structure.composed) and structure.linear and error.with_motion < OWN_ERROR


def misled(model: Model, error: OutputError, bins: Bins) -> bool:
    """Whether the loop may have made the growing modes of a fit to these bins, and their cost is surely more than
    nothing."""
    if not answered(model.structure, error):
        return False
    seconds = sum(one.samples * one.dt for one in bins.spectra)
    return 2 * seconds * growth(model.structure, model.values) > SURELY


def growth(structure: Structure, values: FloatArray) -> float:
    """The sum of the real parts of growing modes, 1/s, the drift of a hover among them; infinite where there is no
    response."""
    return float(_growth(structure, values[None])[0])


def growth_slopes(structure: Structure, values: FloatArray) -> FloatArray:
    """Its slopes to the parameters, (parameters,), within their bounds: of the sum, which is smooth where modes fall
    together, but not where one begins to grow."""
    typical = np.array([one.typical for one in structure.parameters])
    steps = STEP * np.maximum(np.abs(values), 0.01 * np.abs(np.where(np.isfinite(typical), typical, 1.0)) + 1e-12)
    low, high = structure.bounds
    most, least = np.minimum(values + steps, high) - values, np.maximum(values - steps, low) - values
    above, below = (_growth(structure, values + np.diag(one)) for one in (most, least))
    known = np.isfinite(above) & np.isfinite(below) & (most > least)  # a time constant of zero has no response
    with np.errstate(all="ignore"):
        return np.asarray(np.where(known, (above - below) / (most - least), 0.0))


def _growth(structure: Structure, values: FloatArray) -> FloatArray:
    """Of a stack of values (m, parameters), (m,)."""
    with np.errstate(all="ignore"):
        A = structure.matrices(values).A
    known = np.all(np.isfinite(A), axis=(1, 2))
    poles = np.linalg.eigvals(np.where(known[:, None, None], A, 0.0))
    return np.asarray(np.where(known, np.sum(np.maximum(poles.real, 0.0), axis=-1), np.inf))
