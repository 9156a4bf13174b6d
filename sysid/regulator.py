"""LQR gains, observer and prefilter for a TPP model, and the margins that say how late the loop may be.

The paper's section 5 with its slips corrected: observer poles (-50, -50, -51, -51), prefilter (C(-A+BK)^-1 B)^-1.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from sysid.errors import SysidError
from sysid.model import AnyArray, FloatArray, Model
from sysid.result import finite

FORMAT = "tippath.gains/1"
RATE_COST = 1.0
FLAPPING_COST = 0.001
INPUT_COST = 5.0
OBSERVER_POLES = (-50.0, -50.0, -51.0, -51.0)


class DesignError(SysidError):
    """No gains can be designed on this model; the message says why."""


@dataclass(frozen=True)
class Margins:
    """Of the loop broken at both commands together, observer included."""

    gain_db: float
    """How much the loop gain may rise before it oscillates."""
    phase_deg: float
    delay_s: float
    """Extra lateness, equal in both commands, at which the loop becomes unstable."""


@dataclass(frozen=True, eq=False)
class Gains:
    """u = -K x_hat + g y_ref, x_hat' = A x_hat + B u + L (y - C x_hat); states p, q, a, b."""

    model: Model
    K: FloatArray
    """(2, 4), full command per rad/s and per rad."""
    observer_gain: FloatArray
    """L, (4, 2)."""
    prefilter: FloatArray
    """g, (2, 2), full command per rad/s asked for."""
    poles: AnyArray
    observer_poles: AnyArray
    margins: Margins
    input_cost: float

    def to_json(self) -> dict[str, Any]:
        structure = self.model.structure
        return {
            "format": FORMAT,
            "K": self.K.tolist(),
            "observer_gain": self.observer_gain.tolist(),
            "prefilter": self.prefilter.tolist(),
            "poles": _poles(self.poles),
            "observer_poles": _poles(self.observer_poles),
            "margins": {
                "gain_db": finite(self.margins.gain_db),
                "phase_deg": finite(self.margins.phase_deg),
                "delay_ms": finite(1000 * self.margins.delay_s),
            },
            "weights": {"rates": RATE_COST, "flapping": FLAPPING_COST, "inputs": self.input_cost},
            "model": {
                "structure": structure.base,
                "parameters": {
                    name: float(value) for name, value in zip(structure.names, self.model.values, strict=True)
                },
            },
        }


def _poles(values: AnyArray) -> list[dict[str, float]]:
    ordered = sorted(values, key=lambda pole: (pole.real, pole.imag))
    return [{"real": float(value.real), "imag": float(value.imag)} for value in ordered]


def design(model: Model, input_cost: float = INPUT_COST, observer_poles: Sequence[float] = OBSERVER_POLES) -> Gains:
    """Gains for a TPP model with the paper's weights Q = diag(1, 1, 0.001, 0.001), R = input_cost I.

    Raises DesignError for a structure without flapping states, an uncontrollable or unstable model, a bad weight.
    """
    from control import lqr
    from scipy.signal import place_poles

    if model.structure.states != ("p", "q", "a", "b"):
        raise DesignError(
            f"gains are designed on a TPP model with states p, q, a, b; this is {model.structure.base} "
            f"with {', '.join(model.structure.states)}: fit with --model tpp"
        )
    if not (input_cost > 0 and math.isfinite(input_cost)):
        raise DesignError("the input cost must be a positive number (the paper's is 5)")
    if not model.stable:
        raise DesignError("the model is unstable: no gains are designed on it, see the fit's warnings")
    A, B, C, _ = (np.asarray(x, dtype=float) for x in model.matrices)
    try:
        K, _, poles = lqr(A, B, np.diag([RATE_COST, RATE_COST, FLAPPING_COST, FLAPPING_COST]), input_cost * np.eye(2))
        L = place_poles(A.T, C.T, np.array(observer_poles)).gain_matrix.T
        g = np.linalg.inv(C @ np.linalg.solve(-A + B @ K, B))
    except (ValueError, np.linalg.LinAlgError) as error:
        raise DesignError(f"no gains for this model: {error}") from error
    K = np.asarray(K)
    return Gains(
        model,
        K,
        np.asarray(L),
        np.asarray(g),
        np.asarray(poles),
        np.linalg.eigvals(A - L @ C),
        margins(A, B, C, K, np.asarray(L)),
        input_cost,
    )


def margins(A: AnyArray, B: AnyArray, C: AnyArray, K: FloatArray, L: FloatArray) -> Margins:
    """Margins of the loop broken at the commands, from the eigenvalues of its transfer matrix along the axis.

    The loop is on its edge where an eigenvalue meets -1: a common gain, phase or delay in both commands moves
    every eigenvalue alike.
    """
    w = np.geomspace(0.05, 2000.0, 20000)
    s = 1j * w[:, None, None]
    n = A.shape[0]
    plant = C @ np.linalg.solve(s * np.eye(n) - A, np.broadcast_to(B, (w.size, *B.shape)))
    inner = A - L @ C - B @ K
    controller = K @ np.linalg.solve(s * np.eye(n) - inner, np.broadcast_to(L, (w.size, *L.shape)))
    eigenvalues = _continuous(np.linalg.eigvals(controller @ plant))
    gain, phase, delay = math.inf, math.inf, math.inf
    for branch in eigenvalues.T:
        magnitude = np.abs(branch)
        lag = np.mod(np.angle(branch) - np.pi, 2 * np.pi)  # how much more lag until -1, 0..2 pi
        for i in np.flatnonzero(np.diff(np.sign(magnitude - 1)) != 0):
            lead = min(lag[i], 2 * np.pi - lag[i])
            phase = min(phase, float(np.degrees(lead)))
            delay = min(delay, float(lag[i] / w[i]))
        crossing = np.flatnonzero((np.diff(np.sign(branch.imag)) != 0) & (branch.real[:-1] < 0) & (magnitude[:-1] < 1))
        for i in crossing:
            gain = min(gain, float(-20 * np.log10(magnitude[i])))
    return Margins(gain, phase, delay)


def _continuous(eigenvalues: AnyArray) -> AnyArray:
    """Order the eigenvalues of neighbouring frequencies so that each column is one branch, (bins, 2)."""
    ordered = eigenvalues.copy()
    for i in range(1, ordered.shape[0]):
        straight = np.abs(ordered[i] - ordered[i - 1]).sum()
        swapped = np.abs(ordered[i, ::-1] - ordered[i - 1]).sum()
        if swapped < straight:
            ordered[i] = ordered[i, ::-1]
    return ordered
