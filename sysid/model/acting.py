"""Commands as they act: behind delay, play, limits and dead bands, which move samples in time and no matrix holds.

`divided` tells what acts on samples from what follows; `in_time` and `behind` give what comes out of it."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from functools import lru_cache
from itertools import pairwise

import numpy as np

from sysid.data.preprocess import ComplexArray, Segment, Spectrum
from sysid.data.stacks import Stack
from sysid.model.effect import Effect, Signals
from sysid.model.structure import FloatArray, Structure, discretise

STEP = 1e-3
"""Of a parameter, for differences."""
LARGE_STEP, PARTS = 1e-2, 8
"""Of a parameter, to see whether it moves the commands steadily; and the parts that the step is taken in."""
STEADY = PARTS**0.25
"""How many times the root sum of squares of the parts' changes the whole one is at least, where it does: between the
root of PARTS, where each part changes the same, and 1, where no part changes what another does."""
IDLE = 1e-4
"""Of a command's largest size, that what acts on its samples moves at most and does nothing."""
KEPT = 48
"""Bins of acting commands, for each run: of the points of all grids, which are asked beside one effect after another,
and of the last values of a fit."""


@lru_cache(maxsize=256)
def divided(structure: Structure) -> tuple[tuple[Effect, ...], Structure]:
    """What must act on the commands' samples in time, in order, and the structure of all that follows.

    A servo's lag before play, a limit or a dead band acts in time too. A delay stays behind: it commutes with
    everything that does not depend on time.
    """
    last = max((i for i, one in enumerate(structure.composed) if one.samples is not None), default=-1)
    front = tuple(one for one in structure.composed[: last + 1] if one.samples is not None or one.per_command)
    return front, replace(structure, composed=tuple(one for one in structure.composed if one not in front))


def behind(structure: Structure, values: FloatArray, stack: Stack) -> Stack:
    """The stack with its inputs as they act behind everything that acts on samples; `divided` tells what follows."""
    front, _ = divided(structure)
    named = structure.by_name(values)
    U = stack.U[[stack.inputs.index(name) for name in structure.inputs]]
    return replace(stack, U=_behind(structure, front, stack, U, named), inputs=structure.inputs)


def jumping(structure: Structure, values: FloatArray, stack: Stack) -> list[str]:
    """Parameters with which the acting samples jump (dead band), so that there is no derivative to them.

    What moves steadily moves in each part of a step alike; of jumps each falls into one part, and some parts have none:
    squares add up.
    """
    front, _ = divided(structure)
    named = structure.by_name(values)
    at = tuple((name, named[name]) for effect in front for name in effect.names)
    return list(_jumping(structure, front, stack.spectra[0].segment, at))


@lru_cache(maxsize=64)
def _jumping(
    structure: Structure, front: tuple[Effect, ...], segment: Segment, at: tuple[tuple[str, float], ...]
) -> tuple[str, ...]:
    """Kept: a fit asks where it ended, and all that judges it again."""
    named, known = dict(at), Samples()

    def jumps(name: str) -> bool:
        steps = (1 + LARGE_STEP * np.arange(PARTS + 1) / PARTS).tolist()
        acting = [in_time(structure, front, segment, {**named, name: one * named[name]}, known) for one in steps]
        parts = math.sqrt(sum(float(np.sum((there - here) ** 2)) for here, there in pairwise(acting)))
        whole = float(np.linalg.norm(acting[-1] - acting[0]))
        return bool(0 < whole < STEADY * parts)

    return tuple(name for effect in front if effect.samples is not None for name in effect.names if jumps(name))


def idle(structure: Structure, values: FloatArray, segments: Sequence[Segment], names: Collection[str]) -> bool:
    """Whether one of these effects acts on samples of the commands and moves none of them: a limit never reached."""
    front, _ = divided(structure)
    named = structure.by_name(values)
    known: list[Samples] = [{} for _ in segments]

    def moves(place: int) -> bool:
        for segment, some in zip(segments, known, strict=True):
            after, before = (in_time(structure, front[:end], segment, named, some) for end in (place + 1, place))
            if np.max(np.abs(after - before), initial=0.0) > IDLE * np.max(np.abs(before), initial=0.0):
                return True
        return False

    return any(
        effect.samples is not None and (effect.path or effect.id) in names and not moves(place)
        for place, effect in enumerate(front)
    )


def linear_dynamics(structure: Structure) -> bool:
    """Whether everything behind the commands' samples is linear with constant coefficients."""
    return all(effect.linear or effect.samples is not None for effect in structure.composed)


def acting_commands(
    structure: Structure,
    front: Sequence[Effect],
    values: FloatArray,
    stack: Stack,
    logged: ComplexArray,
    moving: Collection[str],
) -> tuple[ComplexArray, dict[str, ComplexArray]]:
    """Inputs as they act behind `front` and every delay, and their derivatives to those effects' parameters that are
    `moving`."""
    late = [one for one in structure.composed if one.response is not None]
    if not front and not late:
        return logged, {}
    named = structure.by_name(values)
    commands = len(structure.commands)
    s = 2j * np.pi * stack.frequency_hz
    known: list[Samples] = [{} for _ in stack.spectra]
    in_front = {name for effect in front for name in effect.names}
    here = _behind(structure, front, stack, logged, named, known) if front else logged

    def acting(at: Mapping[str, float], name: str = "") -> ComplexArray:
        found = _behind(structure, front, stack, logged, at, known) if name in in_front else here.copy()
        for effect in late:
            assert effect.response is not None
            found[:commands] *= effect.response(s, {name: at[name] for name in effect.names})
        return found

    changes: dict[str, ComplexArray] = {}
    for name in (name for one in (*front, *late) for name in one.names if name in moving):
        above, below = either_side(structure, named, name)
        either = [acting({**named, name: value}, name) for value in (above, below)]
        changes[name] = (either[0] - either[1]) / (above - below)
    return acting(named), changes


Samples = dict[tuple[float, ...], FloatArray]
"""Of one segment: the parameters of all that acts first -> the commands behind it, (commands, n)."""


def _behind(
    structure: Structure,
    front: Sequence[Effect],
    stack: Stack,
    logged: ComplexArray,
    named: Mapping[str, float],
    known: Sequence[Samples] | None = None,
) -> ComplexArray:
    """Inputs (m, bins) as they act behind `front`; `known`, for each segment, keeps what other values share."""
    found, commands = logged.copy(), len(structure.commands)
    kept = [None] * len(stack.spectra) if known is None else known
    for one, part, some in zip(stack.spectra, stack.slices, kept, strict=True):
        found[:commands, part] = _acting_bins(structure, front, one, named, some)
    return found


def _acting_bins(
    structure: Structure,
    front: Sequence[Effect],
    one: Spectrum,
    named: Mapping[str, float],
    known: Samples | None,
) -> ComplexArray:
    """Commands of one run as they act behind `front`, (commands, bins); kept, for what follows moves far more often."""
    at = (tuple(front), structure.commands, tuple(named[name] for effect in front for name in effect.names))
    if at not in one.acting:
        if len(one.acting) >= KEPT:
            one.acting.pop(next(iter(one.acting)))
        acting = in_time(structure, front, one.segment, named, known)
        one.acting[at] = one.changed(structure.commands, acting)
    return one.acting[at]


def either_side(structure: Structure, named: Mapping[str, float], name: str) -> tuple[float, float]:
    """A little more and a little less of a parameter, inside its bounds: a lag of zero divides by zero."""
    parameter = structure.parameters[structure.names.index(name)]
    step = STEP * max(abs(named[name]), 1e-2 * abs(parameter.typical))
    here, (low, high) = named[name], parameter.bounds
    return min(here + step, 0.5 * (here + high)), max(here - step, 0.5 * (here + low))


def in_time(
    structure: Structure,
    front: Sequence[Effect],
    segment: Segment,
    named: Mapping[str, float],
    known: Samples | None = None,
) -> FloatArray:
    """Commands of a segment, `Segment.as_held`, as they act behind `front`, absolute.

    `known` is read and filled: where one parameter moves, what acts before it does not change.
    """
    acting = segment.as_held(structure.commands)
    known = {} if known is None else known
    said: tuple[float, ...] = ()
    for place, effect in enumerate(front):
        parameters = {name: named[name] for name in effect.names}
        said = (*said, place, *parameters.values())
        if said not in known:
            known[said] = (
                _filtered(effect, acting, segment.loop_dt, parameters)
                if effect.samples is None
                else sampled(structure, effect, acting, segment.loop_dt, parameters)
            )
        acting = known[said]
    return acting


def sampled(
    structure: Structure, effect: Effect, commands: FloatArray, dt: float, parameters: Mapping[str, float]
) -> FloatArray:
    """Commands (c, n) behind an effect that acts on samples."""
    assert effect.samples is not None
    given = structure.given_to(effect)
    acting = effect.samples(commands[:given].copy(), dt, parameters)
    return np.concatenate([acting, commands[given:]]) if given < len(commands) else acting


def _filtered(effect: Effect, commands: FloatArray, dt: float, parameters: Mapping[str, float]) -> FloatArray:
    """A servo's linear answer to held commands (c, n), steady before the first sample; the mean over each sample."""
    # heavier than NumPy itself to load: only where it is needed
    from scipy.signal import lfilter

    assert effect.equations is not None
    unit = np.eye(len(effect.states) + 1)
    signals = {**parameters, "delta": unit[-1], **{state: unit[i] for i, state in enumerate(effect.states)}}
    said = effect.equations(Signals(signals))
    rows = np.stack([said[f"{state}_dot"] for state in effect.states])
    A, B = discretise(rows[:, :-1], rows[:, -1:], dt)
    C, one = np.asarray(said["delta"])[:-1], np.eye(len(A))
    above, below, adjoint = [], [1.0], one  # of the transfer function, by Faddeev and LeVerrier
    for k in range(len(A)):
        above.append((C @ adjoint @ B).item())
        adjoint = A @ adjoint
        below.append(-float(np.trace(adjoint)) / (k + 1))
        adjoint = adjoint + below[-1] * one
    first = commands[:, :1]
    return np.asarray(lfilter(np.convolve(above, [0.5, 0.5]), below, commands - first) + first)
