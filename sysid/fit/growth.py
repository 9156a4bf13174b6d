"""How fast a model's modes grow: what keeps the likelihood of an unstable model in a loop honest.

On Fourier bins an unstable model is no worse to evaluate than a stable one, but then it answers before it is asked: it
takes the controller's answers to the outputs for their cause. The likelihood knows better. What is new in a sample is a
function of the outputs, whose volume shrinks with every growing mode that the loop holds (Bode's integral of the
sensitivity, pi times the sum of the unstable poles): minus twice the log likelihood is larger by 2 T times that sum.
"""

from __future__ import annotations

import numpy as np

from sysid.fit.output_error import OutputError
from sysid.model.structure import FloatArray, Structure

GUSTY = 0.2
"""Of the outputs' power, left by a model: from here on it is taken for noise, which a controller answers. What a model
leaves of a motion that it explains is for the most part its own error, and of that the likelihood knows nothing."""
STEP = 1e-6
"""Of a parameter, or of one hundredth of its typical size where it is smaller."""


def answered(structure: Structure, error: OutputError) -> bool:
    """Whether so much is left that growing modes may be the loop's answers to it. Not of a bare base: where that grows
    it lacks something, which no likelihood mends."""
    return bool(structure.composed) and bool(np.mean(error.shares) > GUSTY)


def growth(structure: Structure, values: FloatArray) -> float:
    """The sum of the real parts of growing modes, 1/s; infinite where there is no response."""
    return float(_growth(structure, values[None])[0])


def growth_slopes(structure: Structure, values: FloatArray) -> FloatArray:
    """Its slopes to the parameters, (parameters,): of the sum, which is smooth where modes fall together."""
    typical = np.array([one.typical for one in structure.parameters])
    steps = STEP * np.maximum(np.abs(values), 0.01 * np.abs(np.where(np.isfinite(typical), typical, 1.0)) + 1e-12)
    above, below = (_growth(structure, values + sign * np.diag(steps)) for sign in (1.0, -1.0))
    known = np.isfinite(above) & np.isfinite(below)  # a time constant of zero has no response
    return np.asarray(
        np.where(known, np.subtract(above, below, where=known, out=np.zeros(len(steps))), 0) / (2 * steps)
    )


def _growth(structure: Structure, values: FloatArray) -> FloatArray:
    """Of a stack of values (m, parameters), (m,)."""
    with np.errstate(all="ignore"):
        A = structure.matrices(values).A
    known = np.all(np.isfinite(A), axis=(1, 2))
    poles = np.linalg.eigvals(np.where(known[:, None, None], A, 0.0))
    return np.asarray(np.where(known, np.sum(np.maximum(poles.real, 0.0), axis=-1), np.inf))
