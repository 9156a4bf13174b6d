"""Structures and models: equations without and with numbers, and what follows from their matrices.

A structure is a base and the physical effects composed onto it, in the order of physics. A model is a structure with
numbers. Commands are held between samples, so discretisation by the matrix exponential is exact at any rate.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from sysid.model.base import Base
from sysid.model.effect import Effect, Signals, Stage
from sysid.model.parameter import Parameter

FloatArray = NDArray[np.float64]
AnyArray = NDArray[Any]
G = 9.80665  # m/s^2
COMPLEX_STEP = 1e-30
SMALL_MOTION = 2.0**-300
"""Far below rounding, and exact to divide by: what is not proportional to the motion vanishes beside what is."""
DRIFT_RAD_S = 2 * math.pi * 0.5
"""Where the attitude has a part, slower roots are the hover's drift, which no rate shows and the pilot holds."""
NOTHING = 1e-20
"""Of a motion, what no sum shows."""
FLIGHT_CONDITION = {"omega": "Omega_0", "airspeed": "V_0"}
"""Channels that do not vary about zero, and the constants that they are at rest."""


class Matrices(NamedTuple):
    """x' = A x + B u, y = C x + D u. Shapes (n, n), (n, m), (k, n), (k, m); a leading stack is allowed."""

    A: AnyArray
    B: AnyArray
    C: AnyArray
    D: AnyArray


@dataclass(frozen=True)
class Mode:
    """One natural mode: a complex pair, or a real pole (damping ratio +1 or -1)."""

    frequency_hz: float
    damping_ratio: float
    pole: complex


@dataclass(frozen=True, kw_only=True)
class Structure:
    """Equations without numbers: a base with effects. Made by `sysid.model.compose.compose`."""

    base_: Base
    composed: tuple[Effect, ...] = ()
    """In the order in which they act."""
    outputs: tuple[str, ...]
    """States of the base that are measured: what is predicted, fitted and judged, in this order."""
    commands: tuple[str, ...]
    channels: tuple[str, ...] = ()
    """Logged signals other than commands that the equations read."""
    attitude_states: tuple[str, ...] = ()
    """phi, theta where an effect reads them and they are not logged."""
    constants: tuple[tuple[str, float], ...] = ()
    """Omega_0, V_0: means over the fitted runs."""

    states: tuple[str, ...] = field(init=False)
    parameters: tuple[Parameter, ...] = field(init=False)

    def __post_init__(self) -> None:
        states = [*self.base_.states, *self.attitude_states]
        dropped = {name for effect in self.composed for name in effect.replaces}
        parameters = [one for one in self.base_.parameters if one.name not in dropped]
        for effect in self.composed:
            if effect.per_command:
                states += [f"{state}_{command}" for command in self.commands for state in effect.states]
            else:
                states += effect.states
            parameters += effect.parameters
        object.__setattr__(self, "states", tuple(states))
        object.__setattr__(self, "parameters", tuple(parameters))

    def __hash__(self) -> int:
        return self._hash

    @cached_property
    def _hash(self) -> int:
        """Of what all else follows from; asked for at every look into what is known of a structure."""
        return hash((self.base_, self.composed, self.outputs, self.commands, self.channels, self.constants))

    @property
    def base(self) -> str:
        """The name of the base, or the path of a user's."""
        return self.base_.word

    @property
    def title(self) -> str:
        """`TPP + servo_lag`; users' files without their folder."""
        return " + ".join((self.base_.label, *(Path(one).name for one in self.effects)))

    @property
    def files(self) -> tuple[str, ...]:
        """Paths of a user's own base and effects, which are code."""
        paths = (self.base_.path, *(one.path for one in self.composed))
        return tuple(path for path in paths if path is not None)

    def given_to(self, effect: Effect) -> int:
        """How many of the commands, from the first on, an effect that acts on samples is given."""
        return len((self.base_ if effect.spares_others else self).commands)

    @property
    def bare(self) -> Structure:
        """The base alone, with the same outputs."""
        return Structure(base_=self.base_, outputs=self.outputs, commands=self.base_.commands)

    @cached_property
    def effects(self) -> tuple[str, ...]:
        """Catalogue ids, or the paths of users' effects."""
        return tuple(effect.path or effect.id for effect in self.composed)

    @cached_property
    def inputs(self) -> tuple[str, ...]:
        """What drives the equations: commands, then channels."""
        return (*self.commands, *self.channels)

    @cached_property
    def names(self) -> tuple[str, ...]:
        return tuple(parameter.name for parameter in self.parameters)

    @cached_property
    def bounds(self) -> tuple[FloatArray, FloatArray]:
        """Hard limits of the parameters: the lowest, the highest."""
        low, high = np.array([parameter.bounds for parameter in self.parameters], dtype=float).reshape(-1, 2).T
        return low, high

    @property
    def outside_matrices(self) -> tuple[str, ...]:
        """Effects on the commands that matrices leave out, and with them poles and modes: delay, play, limits."""
        return tuple(one.path or one.id for one in self.composed if one.response is not None or one.samples is not None)

    @cached_property
    def linear(self) -> bool:
        """Constant coefficients throughout: the response is exact in matrices."""
        return all(effect.linear for effect in self.composed)

    @property
    def mean_channels(self) -> dict[str, FloatArray]:
        """Channels of the flight condition, as they are at rest, by name."""
        known = dict(self.constants)
        return {name: np.array(known[mean]) for name, mean in FLIGHT_CONDITION.items() if name in self.channels}

    def vector(self, values: Mapping[str, float]) -> FloatArray:
        """Values by name -> values in order, shape (parameters,). Raises KeyError for a missing name."""
        return np.array([values[name] for name in self.names], dtype=float)

    def named(self, values: AnyArray) -> dict[str, Any]:
        """Values (..., parameters) -> by name, each (...)."""
        return {name: values[..., i] for i, name in enumerate(self.names)}

    def by_name(self, values: FloatArray) -> dict[str, float]:
        """Values (parameters,) by name."""
        return dict(zip(self.names, map(float, values), strict=True))

    def matrices(self, values: AnyArray) -> Matrices:
        """Parameter values (..., parameters), real or complex -> matrices (..., rows, columns).

        Effects outside the matrices (delay, play, limits) are left out. Nonlinear terms are those of small motions
        at rest, in the mean flight condition.
        """
        values = np.asarray(values)
        n, m = len(self.states), len(self.inputs)
        unit = SMALL_MOTION * np.eye(n + m)
        signals = {name: unit[i] for i, name in enumerate((*self.states, *self.inputs))} | self.mean_channels
        parameters = {name: value[..., None] for name, value in self.named(values).items()}
        rates, outputs = self.evaluate(parameters, signals)
        kind = np.result_type(values, float)
        rows = np.empty((*values.shape[:-1], n, n + m), dtype=kind)
        out = np.empty((*values.shape[:-1], len(self.outputs), n + m), dtype=kind)
        for i, state in enumerate(self.states):
            rows[..., i, :] = rates[f"{state}_dot"]
        for i, name in enumerate(self.outputs):
            out[..., i, :] = outputs[name]
        rows, out = rows / SMALL_MOTION, out / SMALL_MOTION
        return Matrices(rows[..., :n], rows[..., n:], out[..., :n], out[..., n:])

    def evaluate(
        self, parameters: Mapping[str, Any], signals: Mapping[str, Any]
    ) -> tuple[dict[str, Any], dict[str, Any]]:
        """Rates by `<state>_dot` and outputs by name, all effects applied in order.

        Parameters and signals are whatever broadcasts: scalars, unit vectors, time histories.
        """
        known = {"g": G, **dict(self.constants), **parameters, **signals}
        evaluation = _Evaluation(known, frozenset(f"{state}_dot" for state in self.states))
        before = [effect for effect in self.composed if effect.stage < Stage.DYNAMICS]
        for effect in before:
            self._apply(effect, evaluation)
        evaluation.take(self.base_.equations(evaluation.signals))
        for slot, equations in self.base_.slots:
            if all(effect.slot != slot for effect in self.composed):
                evaluation.take(equations(evaluation.signals))
        for effect in self.composed[len(before) :]:
            self._apply(effect, evaluation)
        rates = evaluation.rates
        for axis, rate in (("phi", "p"), ("theta", "q")):
            if axis in self.attitude_states:
                rates[f"{axis}_dot"] = known[rate]
        for state in self.states:
            if f"{state}_dot" not in rates:
                rates[f"{state}_dot"] = 0.0 * known[state]
        return rates, {name: known.get(f"{name}_m", known[name]) for name in self.outputs}

    def _apply(self, effect: Effect, evaluation: _Evaluation) -> None:
        if effect.equations is None:
            return
        if effect.per_command:
            for command in self.commands:
                evaluation.take_per_command(effect, command)
            return
        if effect.stage is Stage.MEASUREMENT:
            for name in self.base_.states:
                evaluation.known.setdefault(f"{name}_m", evaluation.known[name])
        evaluation.take(effect.equations(evaluation.signals), effect.stage is Stage.INERTIA)


class _Evaluation:
    """Signals and rates while the equations are gone through in order."""

    def __init__(self, known: dict[str, Any], possible: Collection[str]) -> None:
        self.known, self.possible = known, possible
        self.rates: dict[str, Any] = {}

    @property
    def signals(self) -> Signals:
        return Signals(self.known)

    def take(self, changes: Mapping[str, Any], redefine_rates: bool = False) -> None:
        """Rates add up, or are redefined; signals are redefined."""
        known, rates = self.known, self.rates
        for key, value in changes.items():
            if key in self.possible:
                adds = key in rates and not redefine_rates
                rates[key] = known[key] = rates[key] + value if adds else value
            elif key.endswith("_dot"):
                raise ValueError(f"{key}: there is no state {key.removesuffix('_dot')}")
            else:
                known[key] = value

    def take_per_command(self, effect: Effect, command: str) -> None:
        """The equations of one servo, which speak of `delta` and of states without the command's name."""
        assert effect.equations is not None
        local = {**self.known, "delta": self.known[command]}
        local.update({state: self.known[f"{state}_{command}"] for state in effect.states})
        for key, value in effect.equations(Signals(local)).items():
            if key == "delta":
                self.known[command] = value
            else:
                self.take({f"{key.removesuffix('_dot')}_{command}_dot": value})


@dataclass(frozen=True, eq=False)
class Model:
    """A structure with numbers."""

    structure: Structure
    values: FloatArray
    """Shape (parameters,), in the structure's order and units."""

    def __getitem__(self, name: str) -> float:
        return float(self.values[self.structure.names.index(name)])

    @property
    def by_name(self) -> dict[str, float]:
        return self.structure.by_name(self.values)

    @cached_property
    def matrices(self) -> Matrices:
        return self.structure.matrices(self.values)

    @property
    def input_delay_s(self) -> tuple[float, ...]:
        """How late each column of B acts, s: delays of the commands, which no matrix holds."""
        s, late = np.array([1j, 2j]), 0.0
        for effect in self.structure.composed:
            if effect.response is None:
                continue
            factors = np.asarray(effect.response(s, {name: self[name] for name in effect.names}))
            delay = -float(np.angle(np.ravel(factors)[0]))
            if np.allclose(factors, np.exp(-s * delay), rtol=0, atol=1e-9):  # else it is more than a delay
                late += delay
        return tuple(late if name in self.structure.commands else 0.0 for name in self.structure.inputs)

    @property
    def modes(self) -> tuple[Mode, ...]:
        """Of the vehicle alone, from its commands on; what `outside_matrices` does to these moves none."""
        return modes(self.matrices.A)

    @property
    def own_modes(self) -> tuple[Mode, ...]:
        """Those of the base's own states, by their participation: what an effect brings along, as a servo's pair, is
        no natural mode of the airframe. All of a base without effects."""
        A = self.matrices.A
        own = len(self.structure.base_.states) + len(self.structure.attitude_states)
        if own == len(A):
            return self.modes
        poles, right = np.linalg.eig(A)
        # a pole that stands there twice, as of two like lags behind each other, has one vector
        part = np.abs(np.linalg.pinv(right) * right.T)  # (modes, states)
        mine = part[:, :own].sum(axis=1) >= 0.5 * part.sum(axis=1)
        return tuple(mode for mode in self.modes if mine[int(np.argmin(np.abs(poles - mode.pole)))])

    @cached_property
    def stable(self) -> bool:
        """Of the vehicle alone, from its commands: a delay of these, which no matrix holds, moves no pole.

        With attitude states their integrals, and the drift below `DRIFT_RAD_S`, do not count.
        """
        poles = np.linalg.eigvals(self.matrices.A)
        drift = DRIFT_RAD_S if self.structure.attitude_states else 0.0
        return not np.any((poles.real >= -1e-9) & (np.abs(poles) >= drift))


def modes(A: AnyArray) -> tuple[Mode, ...]:
    """Natural modes of x' = A x, ascending in frequency, one entry for each complex pair."""
    found = []
    for pole in np.linalg.eigvals(A):
        if pole.imag < -1e-9 * max(1.0, abs(pole)):
            continue
        magnitude = abs(pole)
        ratio = -pole.real / magnitude if magnitude > 0 else 0.0
        found.append(Mode(float(magnitude / (2 * np.pi)), float(ratio), complex(pole)))
    return tuple(sorted(found, key=lambda mode: (mode.frequency_hz, mode.damping_ratio)))


def discretise(A: AnyArray, B: AnyArray, dt: float) -> tuple[AnyArray, AnyArray]:
    """Exact zero-order-hold equivalent over one sample of dt seconds.

    A (..., n, n) and B (..., n, m), real or complex, stacks allowed; returns arrays of the same shapes.
    Scaling and squaring of a Taylor series: SciPy's expm takes 0.2 ms a matrix, and these are small.
    """
    n, m = B.shape[-2:]
    block = np.zeros((*A.shape[:-2], n + m, n + m), dtype=np.result_type(A, B))
    block[..., :n, :n] = A * dt
    block[..., :n, n:] = B * dt
    norm = float(np.max(np.sum(np.abs(block), axis=-1))) if block.size else 0.0
    if not math.isfinite(norm):
        raise np.linalg.LinAlgError("the matrix to be exponentiated is not finite")
    squarings = max(0, int(np.ceil(np.log2(norm / 0.25)))) if norm > 0 else 0
    block = block / 2.0**squarings
    identity = np.eye(n + m)
    power = identity + block / 11
    for k in range(10, 0, -1):
        power = identity + block @ power / k
    for _ in range(squarings):
        power = power @ power
    return power[..., :n, :n], power[..., :n, n:]


def recursion(A: FloatArray, driving: FloatArray) -> FloatArray:
    """x_k = A x_(k-1) + d_k from rest, of d (..., n, samples); the same shape.

    The sum over 2, 4, 8, ... samples comes from those over half as many, all at once, until A to that power is nothing.
    """
    x, power, reach = driving, A, 1
    while reach < x.shape[-1] and np.max(np.abs(power)) > NOTHING:
        x = np.concatenate([x[..., :reach], x[..., reach:] + power @ x[..., :-reach]], axis=-1)
        power, reach = power @ power, 2 * reach
    return x


def stepped(values: FloatArray) -> AnyArray:
    """A stack (parameters, parameters) of complex steps, one parameter each, for exact derivatives."""
    stack = np.repeat(values.astype(complex)[None, :], values.size, axis=0)
    stack[np.diag_indices(values.size)] += 1j * COMPLEX_STEP
    return stack
