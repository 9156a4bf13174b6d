"""What a vehicle does in time under a discrete controller, loop by loop: play, limits and dead bands included.

What is linear is exact (`sampled_plant`). What acts on the commands' samples is stepped with them, as
`sysid.model.acting` does over a whole run.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from sysid.control.prefilter import DynamicPrefilter
from sysid.control.sampled import NotSampledError, sampled_plant
from sysid.data.record import FloatArray
from sysid.model.acting import divided
from sysid.model.effect import Effect, Signals
from sysid.model.structure import Model, discretise, recursion
from sysid.rate_loop.linear import Discrete

PROBED = 400
"""Loops."""
Act = Callable[[FloatArray], FloatArray]
"""Commands (2,) of one loop to what becomes of them in it; it remembers what it has to."""


class InLoops(NamedTuple):
    """A vehicle as loops of one length see it."""

    plant: Discrete
    """Behind all that acts on samples."""
    front: tuple[Effect, ...]
    """What acts on samples, in order."""
    parameters: dict[str, float]


def in_loops(vehicle: Model, dt: float, gyro_corner_hz: float = 0.0) -> InLoops:
    """Raises NotSampledError as `sampled_plant` does, and for what remembers more than where it was a loop before."""
    front, after = divided(vehicle.structure)
    named = dict(vehicle.by_name)
    for one in front:
        if one.samples is not None and not _goes_by_loops(one, named, dt):
            raise NotSampledError(
                f"{vehicle.structure.title} has {one.title}, which cannot be computed loop by loop yet; predict with a "
                "fit that has a lag or a delay instead"
            )
    behind = Model(after, after.vector({name: named[name] for name in after.names}))
    return InLoops(sampled_plant(behind, dt, gyro_corner_hz).system, front, named)


def lqr_law(
    model: Model,
    K: FloatArray,
    observer_gain: FloatArray,
    prefilter: FloatArray,
    dt: float,
    dynamic: DynamicPrefilter | None = None,
) -> Discrete:
    """The LQR with its observer as a loop of dt seconds answers: targets, then rates, to commands.

    Observer and followed models are advanced exactly between loops, rates, targets and commands held.
    """
    of_state, of_command, of_rates = observer_in_loops(model, observer_gain, dt)
    n = len(of_state)
    ahead = np.zeros((4, 6)) if dynamic is None else followed_in_loops(dynamic, dt)
    F = np.zeros((2, 4)) if dynamic is None else dynamic.F
    # commands: -K x + F (rates, accelerations of the models) + (g - F of rates) asked
    of_asked = prefilter - F[:, :2]
    return Discrete(
        np.block([[of_state - of_command @ K, of_command @ F], [np.zeros((4, n)), ahead[:, :4]]]),
        np.block([[of_command @ of_asked, of_rates], [ahead[:, 4:], np.zeros((4, 2))]]),
        np.hstack([-K, F]),
        np.hstack([of_asked, np.zeros((2, 2))]),
        dt,
    )


def observer_in_loops(model: Model, observer_gain: FloatArray, dt: float) -> tuple[FloatArray, FloatArray, FloatArray]:
    """The observer's states after a loop: per states (n, n), per command and per rate (n, 2), both held."""
    # heavier than NumPy itself to load: only where it is needed
    from scipy.linalg import expm

    A, B, C, _ = (np.asarray(one, dtype=float) for one in model.matrices)
    n = len(A)
    block = np.zeros((n + 4, n + 4))
    block[:n] = np.hstack([A - observer_gain @ C, B[:, :2], observer_gain])
    power = expm(block * dt)[:n]
    return power[:, :n], power[:, n : n + 2], power[:, n + 2 :]


def followed_in_loops(dynamic: DynamicPrefilter, dt: float) -> FloatArray:
    """(4, 6): rates, then accelerations of both models after a loop, of these and of what is asked."""
    # heavier than NumPy itself to load: only where it is needed
    from scipy.linalg import expm

    w, zeta = np.diag(dynamic.frequency), np.diag(dynamic.damping)
    block = np.zeros((6, 6))
    block[:2, 2:4] = np.eye(2)
    block[2:4, :2], block[2:4, 2:4], block[2:4, 4:] = -w @ w, -2 * zeta @ w, w @ w
    return np.asarray(expm(block * dt)[:4])


def predicted_rates(law: Discrete, vehicle: InLoops, asked: FloatArray) -> FloatArray:
    """(n, 2), rad/s: a vehicle at rest under a law, for targets (n, 2) that each loop answers at once."""
    return _stepped(law, vehicle, asked) if vehicle.front else _linear(law, vehicle.plant, asked)


def _linear(law: Discrete, plant: Discrete, asked: FloatArray) -> FloatArray:
    """All loops at once."""
    A = np.block(
        [
            [law.A, law.B[:, 2:] @ plant.C],
            [plant.B @ law.C, plant.A + plant.B @ law.D[:, 2:] @ plant.C],
        ]
    )
    driving = np.zeros((len(A), len(asked)))
    driving[:, 1:] = np.vstack([law.B[:, :2], plant.B @ law.D[:, :2]]) @ asked[:-1].T
    return np.asarray((plant.C @ recursion(A, driving)[len(law.A) :]).T)


def _stepped(law: Discrete, vehicle: InLoops, asked: FloatArray) -> FloatArray:
    """One loop after the other."""
    plant = vehicle.plant
    acts = [_sampled(one, vehicle.parameters, law.dt) for one in vehicle.front]
    of_law, of_plant, rates = np.zeros(len(law.A)), np.zeros(len(plant.A)), np.empty((len(asked), 2))
    for k, target in enumerate(asked):
        rates[k] = plant.C @ of_plant
        seen = np.concatenate([target, rates[k]])
        command = law.C @ of_law + law.D @ seen
        of_law = law.A @ of_law + law.B @ seen
        for act in acts:
            command = act(command)
        of_plant = plant.A @ of_plant + plant.B @ command
    return rates


def _sampled(effect: Effect, parameters: dict[str, float], dt: float) -> Act:
    own = {name: parameters[name] for name in effect.names}
    if effect.samples is None:
        return _lagging(effect, own, dt)
    act, before = effect.samples, np.zeros(2)

    def step(command: FloatArray) -> FloatArray:
        nonlocal before
        # the first of two samples is where it was
        before = act(np.column_stack([before, command]), dt, own)[:, 1]
        return before

    return step


def _goes_by_loops(effect: Effect, parameters: dict[str, float], dt: float) -> bool:
    """Whether steps of one loop come to the same as a whole run, on slow and fast commands of up to half of full."""
    assert effect.samples is not None
    k = np.arange(PROBED)
    probe = 0.5 * np.sin(2 * np.pi * np.vstack([(k / PROBED) ** 2 * 20, k / 40]))
    act = _sampled(effect, parameters, dt)
    found = np.array([act(command) for command in probe.T]).T
    whole = effect.samples(probe.copy(), dt, {name: parameters[name] for name in effect.names})
    return bool(np.allclose(found, whole, atol=1e-9))


def _lagging(effect: Effect, parameters: dict[str, float], dt: float) -> Act:
    """A servo's linear answer to held commands; the mean over each loop."""
    assert effect.equations is not None
    unit = np.eye(len(effect.states) + 1)
    signals = {**parameters, "delta": unit[-1], **{state: unit[i] for i, state in enumerate(effect.states)}}
    said = effect.equations(Signals(signals))
    rows = np.stack([said[f"{state}_dot"] for state in effect.states])
    A, B = discretise(rows[:, :-1], rows[:, -1:], dt)
    C = np.asarray(said["delta"])[:-1]
    state = np.zeros((len(A), 2))

    def step(command: FloatArray) -> FloatArray:
        nonlocal state
        before, state = state, A @ state + B @ command[None, :]
        return np.asarray(0.5 * C @ (before + state))

    return step
