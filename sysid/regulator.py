"""LQR gains, observer and prefilter for a TPP model, and the margins that say how late the loop may be.

The paper's section 5 with its slips corrected: observer poles (-50, -50, -51, -51), prefilter (C(-A+BK)^-1 B)^-1.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from sysid.errors import SysidError
from sysid.model import AnyArray, FloatArray, Model
from sysid.response import transfer
from sysid.result import finite
from sysid.structures import TPP

FORMAT = "tippath.gains/1"
RATE_COST = 1.0
FLAPPING_COST = 0.001
INPUT_COST = 5.0
OBSERVER_POLES = (-50.0, -50.0, -51.0, -51.0)


LOOP_RAD_S = np.geomspace(0.05, 2000.0, 4000)


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

    @property
    def delay_ms(self) -> float:
        return 1000 * self.delay_s


NO_MARGINS = Margins(0.0, 0.0, 0.0)


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
    effects: tuple[str, ...] = ()
    """Of the model that the margins are those of."""

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
                "delay_ms": finite(self.margins.delay_ms),
            },
            "margins_with": list(self.effects),
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

    The controller on board has the four states p, q, a, b. Where a model has more (servos, inflow), the gains are those
    of its tip-path plane, and the margins are those of the whole. Raises DesignError for a structure without flapping
    states of its own, an uncontrollable or unstable model, a bad weight.
    """
    from control import lqr
    from scipy.signal import place_poles

    whole, model = model, _flown_by(model)
    if not (input_cost > 0 and math.isfinite(input_cost)):
        raise DesignError("the input cost must be a positive number (the paper's is 5)")
    if not (model.stable and whole.stable):
        raise DesignError("the model is unstable: no gains are designed on it, see the fit's warnings")
    A, B, C, _ = (np.asarray(x, dtype=float) for x in model.matrices)
    B = B[:, :2]
    try:
        K, _, poles = lqr(A, B, np.diag([RATE_COST, RATE_COST, FLAPPING_COST, FLAPPING_COST]), input_cost * np.eye(2))
        L = place_poles(A.T, C.T, np.array(observer_poles)).gain_matrix.T
        g = np.linalg.inv(C @ np.linalg.solve(-A + B @ K, B))
    except (ValueError, np.linalg.LinAlgError) as error:
        raise DesignError(f"no gains for this model: {error}") from error
    found = Gains(
        model,
        np.asarray(K),
        np.asarray(L),
        np.asarray(g),
        np.asarray(poles),
        np.linalg.eigvals(A - L @ C),
        NO_MARGINS,
        input_cost,
        whole.structure.effects,
    )
    return replace(found, margins=loop_margins(found, whole))


def _flown_by(model: Model) -> Model:
    """The part of a model that the controller on board knows: states p, q, a, b."""
    structure = model.structure
    if structure.states == TPP.states:
        return model
    if structure.base != TPP.base or not set(TPP.names) <= set(structure.names):
        raise DesignError(
            f"gains are designed on a TPP model with states p, q, a, b; this is {structure.base} "
            f"with {', '.join(structure.states)}: fit with --model tpp"
        )
    return Model(TPP, TPP.vector({name: model[name] for name in TPP.names}))


def loop_margins(gains: Gains, vehicle: Model) -> Margins:
    """Margins of a vehicle, whatever its states, under gains designed on another model.

    From the eigenvalues of the loop's transfer matrix, broken at the commands, along the axis: it is on its edge where
    one meets -1, and a common gain, phase or delay in both commands moves every eigenvalue alike. A vehicle that the
    gains do not hold has no margin left.
    """
    if not _holds(gains, vehicle):
        return NO_MARGINS
    w = LOOP_RAD_S
    A, B, C, _ = gains.model.matrices
    B = B[:, :2]
    K, L = gains.K, gains.observer_gain
    inner = A - L @ C - B @ K
    controller = K @ np.linalg.solve(1j * w[:, None, None] * np.eye(len(A)) - inner, L[None].astype(complex))
    plant = transfer(vehicle.structure, vehicle.values, w / (2 * np.pi))[:, :2].transpose(2, 0, 1)
    gain, phase, delay = math.inf, math.inf, math.inf
    for branch in _branches(controller @ plant).T:
        size, turn = np.log(np.abs(branch)), np.mod(np.angle(branch) - np.pi, 2 * np.pi)
        for i in np.flatnonzero(size[:-1] * size[1:] < 0):
            part = size[i] / (size[i] - size[i + 1])
            angle = turn[i] + part * ((turn[i + 1] - turn[i] + np.pi) % (2 * np.pi) - np.pi)
            phase = min(phase, float(np.degrees(min(angle, 2 * np.pi - angle))))
            delay = min(delay, float(angle / (w[i] + part * (w[i + 1] - w[i]))))
        crossing = (np.diff(np.sign(branch.imag)) != 0) & (branch.real[:-1] < 0) & (size[:-1] < 0)
        gain = min([gain, *(-20 / math.log(10) * size[:-1][crossing])])
    return Margins(float(gain), phase, delay)


def _holds(gains: Gains, vehicle: Model) -> bool:
    """Whether vehicle and controller together are stable; a delay, which no matrix holds, is left out."""
    A, B, C, _ = vehicle.matrices
    model = gains.model.matrices
    inner = model.A - gains.observer_gain @ model.C - model.B[:, :2] @ gains.K
    together = np.block([[A, -B[:, :2] @ gains.K], [gains.observer_gain @ C, inner]])
    return int(np.sum(np.linalg.eigvals(together).real > 1e-9)) <= len(vehicle.structure.attitude_states)


def _branches(loop: AnyArray) -> AnyArray:
    """Eigenvalues of (f, 2, 2) as (f, 2), each column one branch: neighbours change places as often as they did."""
    half = 0.5 * (loop[:, 0, 0] + loop[:, 1, 1])
    apart = np.sqrt(half**2 - loop[:, 0, 0] * loop[:, 1, 1] + loop[:, 0, 1] * loop[:, 1, 0])
    found = np.stack([half + apart, half - apart], axis=1)
    straight = np.abs(np.diff(found, axis=0)).sum(axis=1)
    crossed = np.abs(found[1:, ::-1] - found[:-1]).sum(axis=1)
    odd = np.concatenate([[False], np.cumsum(crossed < straight) % 2 == 1])
    return np.where(odd[:, None], found[:, ::-1], found)
