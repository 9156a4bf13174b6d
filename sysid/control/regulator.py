"""LQR gains, observer and prefilter for a TPP model, of which none are given that do not hold the whole model.

In forward flight the elevator is a third command (eq. 15 and 16): `elevator` takes it. A steady rate has then more than
one set of commands; the prefilter takes the smallest.

The paper's section 5 with its slips corrected: observer poles (-50, -50, -51, -51), prefilter (C(-A+BK)^-1 B)^-1.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import PurePath
from typing import Any

import numpy as np

from sysid.control.prefilter import DynamicPrefilter
from sysid.control.stability import COMMANDS, ClosedLoop, Margins, closed_loop, commands_of
from sysid.data.record import RATES
from sysid.errors import SysidError
from sysid.fit.result import finite
from sysid.model.compose import compose
from sysid.model.paper import TPP
from sysid.model.structure import AnyArray, FloatArray, Model, Structure

FORMAT = "tippath.gains/1"
RATE_COST = 1.0
FLAPPING_COST = 0.001
INPUT_COST = 5.0
OBSERVER_POLES = (-50.0, -50.0, -51.0, -51.0)
COSTS = tuple(
    size * times for size in (1.0, 10.0, 100.0, 1e3, 1e4) for times in (1.0, 1.5, 2.0, 3.0, 4.0, 5.0, 6.0, 8.0)
)
"""Input costs that are offered where the one asked for does not hold."""
UNCONTROLLED = 1e-6
"""Of the larger: what the commands do to the other axis is then nothing."""
FORWARD = ("angular_damping", "elevator")
"""Effects that the controller on board has in its own model where it has the elevator."""


class DesignError(SysidError):
    """No gains can be designed on this model; the message says why."""


class NotHeldError(DesignError):
    """The gains do not hold the model; the message says which would."""

    def __init__(self, words: str, instead: Gains | None) -> None:
        super().__init__(words)
        self.instead = instead
        """Gains that do, where there are any."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Gains:
    """u = -K x_hat + g y_ref, x_hat' = A x_hat + B u + L (y - C x_hat); states p, q, a, b."""

    model: Model
    K: FloatArray
    """(commands, 4), full command per rad/s and per rad."""
    observer_gain: FloatArray
    """L, (4, 2)."""
    prefilter: FloatArray
    """g, (commands, 2), full command per rad/s asked for."""
    poles: AnyArray
    observer_poles: AnyArray
    input_cost: float
    flapping_cost: float = FLAPPING_COST
    """Of a and b, where a rate's is 1."""
    loop: ClosedLoop
    """With the whole model that they were designed for."""
    dynamic: DynamicPrefilter | None = None
    """What is added to the commands while the rates are on their way; None for eq. 13's."""

    @property
    def commands(self) -> tuple[str, ...]:
        """delta_x, delta_y; with the elevator delta_e."""
        return commands_of(self)

    @property
    def margins(self) -> Margins:
        """Raises DesignError where there are none: the gains do not hold the model."""
        if self.loop.margins is None:
            raise DesignError("the gains do not hold this model: the loop has no margins")
        return self.loop.margins

    def to_json(self) -> dict[str, Any]:
        """The `tippath.gains/1` document. Raises DesignError for gains that do not hold their model."""
        structure, margins = self.model.structure, self.margins
        return {
            "format": FORMAT,
            "K": self.K[:2].tolist(),
            "observer_gain": self.observer_gain.tolist(),
            "prefilter": self.prefilter[:2].tolist(),
            "elevator": None
            if len(self.K) == 2
            else {"K": self.K[2].tolist(), "prefilter": self.prefilter[2].tolist()},
            "dynamic_prefilter": None if self.dynamic is None else self.dynamic.to_json(),
            "poles": _poles(self.poles),
            "observer_poles": _poles(self.observer_poles),
            "margins": {
                "gain_db": finite(margins.gain_db),
                "phase_deg": finite(margins.phase_deg),
                "delay_ms": finite(margins.delay_ms),
            },
            "margins_with": list(self.loop.effects),
            "margins_without": list(self.loop.left_out),
            "drifts": self.loop.drifts,
            "weights": {"rates": RATE_COST, "flapping": self.flapping_cost, "inputs": self.input_cost},
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


def design(
    model: Model,
    input_cost: float = INPUT_COST,
    observer_poles: Sequence[float] = OBSERVER_POLES,
    *,
    elevator: bool = False,
    flapping_cost: float = FLAPPING_COST,
) -> Gains:
    """Gains for a TPP model with the weights Q = diag(1, 1, flapping_cost, flapping_cost), R = input_cost I, that hold
    it; left out they are the paper's.

    The controller on board has the four states p, q, a, b. Where a model has more (servos, inflow), or a delay, the
    gains are those of its tip-path plane, and loop and margins are those of the whole. With `elevator` they are those
    of the tip-path plane with damping and elevator, and of three commands. Raises DesignError for a structure without
    flapping states of its own, an uncontrollable or unstable model, a bad weight; NotHeldError where the loop would be
    unstable.
    """

    def at(cost: float) -> Gains:
        return lqr(model, cost, observer_poles, elevator=elevator, flapping_cost=flapping_cost)

    gains = at(input_cost)
    if gains.loop.stable:
        return gains
    instead = _that_hold(input_cost, at)
    raise NotHeldError(_refusal(model, gains, instead), instead)


def lqr(
    model: Model,
    input_cost: float = INPUT_COST,
    observer_poles: Sequence[float] = OBSERVER_POLES,
    *,
    elevator: bool = False,
    flapping_cost: float = FLAPPING_COST,
) -> Gains:
    """The same gains whether they hold the whole model or not: `loop` tells. Raises DesignError as `design` does."""
    # heavier than NumPy itself to load: only where it is needed
    from scipy.linalg import solve_continuous_are

    whole, model = model, _flown_by(model, elevator)
    if not (input_cost > 0 and math.isfinite(input_cost)):
        raise DesignError("the input cost must be a positive number (the paper's is 5)")
    if not (flapping_cost >= 0 and math.isfinite(flapping_cost)):
        raise DesignError("the flapping cost must be a number, not negative (the paper's is 0.001)")
    if not (np.all(np.isfinite(model.values)) and np.all(np.isfinite(whole.values))):
        raise DesignError("the model has values that are no numbers: fit again")
    if not (model.stable and whole.stable):
        raise DesignError("the model is unstable: no gains are designed on it, see the fit's warnings")
    A, B, C, _ = (np.asarray(x, dtype=float) for x in model.matrices)
    B = B[:, : 3 if elevator else 2]
    _refuse_uncontrolled(A, B, C)
    Q, R = np.diag([RATE_COST, RATE_COST, flapping_cost, flapping_cost]), input_cost * np.eye(B.shape[1])
    try:
        K = np.linalg.solve(R, B.T @ solve_continuous_are(A, B, Q, R))
        L = observer_gain(A, C, observer_poles)
        g = steady_prefilter(A, B, C, K)
    except (ValueError, np.linalg.LinAlgError) as error:
        raise DesignError(f"no gains for this model: {error}") from error
    gains = Gains(
        model=model,
        K=np.asarray(K),
        observer_gain=np.asarray(L),
        prefilter=np.asarray(g),
        poles=np.linalg.eigvals(A - B @ K),
        observer_poles=np.linalg.eigvals(A - L @ C),
        input_cost=input_cost,
        flapping_cost=flapping_cost,
        loop=ClosedLoop(None),
    )
    return replace(gains, loop=closed_loop(gains, whole))


def _refuse_uncontrolled(A: FloatArray, B: FloatArray, C: FloatArray) -> None:
    """Raises DesignError where no commands hold both rates: then there are none to be asked for."""
    steady = C @ np.linalg.solve(-A, B) if np.linalg.matrix_rank(A) == len(A) else C @ A @ B
    size = np.linalg.svd(steady, compute_uv=False)
    if not size[-1] > UNCONTROLLED * size[0]:
        raise DesignError(
            "the model's commands turn one axis alone, or none: gains for two rates need both; fit sweeps of both axes"
        )


def steady_prefilter(A: FloatArray, B: FloatArray, C: FloatArray, K: FloatArray) -> FloatArray:
    """Eq. 14 with its B, (C (-A + B K)^-1 B)^-1: in the long run rates are those asked for.

    Of more commands than rates the smallest. Raises LinAlgError where no commands hold some rates.
    """
    steady = C @ np.linalg.solve(-A + B @ K, B)
    if steady.shape[0] == steady.shape[1]:
        return np.asarray(np.linalg.inv(steady))
    return np.asarray(np.linalg.solve(steady @ steady.T, steady).T)


def cyclic_powers(model: Model) -> FloatArray:
    """(2, 2): rate of the angular accelerations p', q' per cyclic command, by way of the tip-path plane."""
    A, B, C, _ = (np.asarray(x, dtype=float) for x in model.matrices)
    return np.asarray(C @ A @ B[:, :2])


def observer_gain(A: FloatArray, C: FloatArray, poles: Sequence[float]) -> FloatArray:
    """L (n, k), with which A - L C has these poles.

    Where each is wanted once for every output, as the paper's are, there is one such L: that whose left eigenvectors to
    a pole are all that there can be, C (A - pole)^-1. Else the most robust.
    """
    n, k = len(A), len(C)
    distinct = sorted(set(poles))
    if len(poles) == n and all(poles.count(pole) == k for pole in distinct):
        left = np.vstack([np.linalg.solve((A - pole * np.eye(n)).T, C.T).T for pole in distinct])
        return np.asarray(np.linalg.solve(left, np.tile(np.eye(k), (len(distinct), 1))))
    # takes longer to load than a diagnosis to compute: only where it is needed
    from scipy.signal import place_poles

    return np.asarray(place_poles(A.T, C.T, np.array(poles)).gain_matrix.T)


def designs_on(structure: Structure) -> bool:
    """Whether gains are designed on models of this structure: the controller on board has the TPP's states."""
    return structure.base == TPP.base


def _flown_by(model: Model, elevator: bool = False) -> Model:
    """The part of a model that the controller on board knows: states p, q, a, b."""
    structure = model.structure
    if elevator and "elevator" not in structure.effects:
        raise DesignError("the model has no elevator: fit forward flight --with angular_damping,elevator")
    if not set(RATES) <= set(structure.outputs):
        raise DesignError(
            f"gains hold both p and q, and this fit has {', '.join(structure.outputs)} alone: fit sweeps of both axes"
        )
    if (structure.states, structure.names, structure.outputs) == (TPP.states, TPP.names, TPP.outputs):
        return model
    if not designs_on(structure) or not set(TPP.names) <= set(structure.names):
        raise DesignError(
            f"gains are designed on a TPP model with states p, q, a, b; this is {structure.base} "
            f"with {', '.join(structure.states)}: fit with --model tpp"
        )
    if not elevator:
        return Model(TPP, TPP.vector({name: model[name] for name in TPP.names}))
    own = compose(TPP.base, [name for name in FORWARD if name in structure.effects], COMMANDS)
    return Model(own, own.vector({name: model[name] for name in own.names}))


# ------------------------------------------------------------------------------------------------ what would hold


def _that_hold(asked: float, at: Callable[[float], Gains]) -> Gains | None:
    """Of the costs offered the first, upwards and then downwards from the one asked for, that leaves sensible margins.

    Where none does, the first that holds at all.
    """
    some: Gains | None = None
    for cost in (*(c for c in COSTS if c > asked), *(c for c in reversed(COSTS) if c < asked)):
        gains = at(cost)
        if gains.loop.margins is not None:
            if gains.loop.margins.sensible:
                return gains
            some = some or gains
    return some


def require_held(gains: Gains, model: Model) -> None:
    """Raises NotHeldError where gains do not hold the model that they were designed for."""
    if not gains.loop.stable:
        raise NotHeldError(f"{not_held(gains, model)}; nothing is designed", None)


def _refusal(model: Model, gains: Gains, instead: Gains | None) -> str:
    refused = f"{not_held(gains, model)}; nothing is designed"
    if instead is None:
        return f"{refused}. No input cost from {COSTS[0]:g} to {COSTS[-1]:g} holds it"
    thin = "" if instead.margins.sensible else "; that is thin, and no other does better"
    return f"{refused}. --input-cost {instead.input_cost:g} holds it: {instead.margins.words}{thin}"


def not_held(gains: Gains, model: Model) -> str:
    """That the gains do not hold the model that they were designed for, in words."""
    named = ", ".join(PurePath(one).name for one in gains.loop.effects)
    late = f" ({1000 * model['T_d']:.0f} ms)" if "T_d" in model.structure.names else ""
    inside = f" with {named}{late} in the loop" if named else ""
    return f"the gains of input cost {gains.input_cost:g} do not hold this model{inside}: it would be unstable"
