"""What an effect does to a vehicle: its signature, worked out from the entry itself at its typical size.

The vehicle is the paper's, or another model of the tip-path plane; what the effect needs stands in both, with it and
without. Where the effect is linear, how the frequency response of the cyclic changes; of every effect the answer to
doublets, a large one that is quick and a small one that is slow, for what depends on amplitude.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from sysid.data.record import CYCLIC
from sysid.model.acting import divided, linear_dynamics, sampled
from sysid.model.compose import compose
from sysid.model.effect import Effect, find
from sysid.model.paper import TABLE_4, TPP, reduce_to_cd
from sysid.model.response import transfer
from sysid.model.structure import FLIGHT_CONDITION, AnyArray, FloatArray, Model, Structure, discretise, recursion

NEARLY = 0.6
"""Of what its own command shows of an axis, another's counts so much."""
DT = 0.004
LARGE, SMALL = 0.3, 0.05
"""Amplitudes of the doublets, of full command."""
LARGE_S, SMALL_S, SMALL_BEGINS_S, SECONDS = (0.5, 1.5), 1.6, 3.2, 5.6
RISE_S = 0.06
FREQUENCY_HZ = np.geomspace(0.3, 15.0, 240)
MEAN = {"omega": 172.8, "airspeed": 18.0}
"""rad/s, m/s: the means that such channels stand beside."""
CHANNEL_AT = {"omega": 1.06 * MEAN["omega"], "airspeed": 1.15 * MEAN["airspeed"], "r": 0.6}
"""What channels show all the time, in their units: away from their means."""
COMMAND_AT = 0.3
"""And commands that an effect reads and does not answer to by itself."""


@dataclass(frozen=True, kw_only=True, eq=False, slots=True)
class Signature:
    """An effect at its typical size, beside the reference without it."""

    effect: Effect
    beside: tuple[str, ...]
    """Effects that it needs: both models have them."""
    held: dict[str, float]
    """Channels and commands that it only reads -> what they are all the time, in their units."""
    output: str
    """The rate that shows it best,"""
    command: str
    """and the command that brings it out."""
    decibels: FloatArray | None
    """Gain with the effect over gain without it, at FREQUENCY_HZ, the same shape; None where it is not linear, or the
    command is its own."""
    degrees: FloatArray | None
    """Phase with it less phase without it, -180 to 180, the same shape."""
    t: FloatArray
    """(n,), s"""
    commanded: FloatArray
    """(n,), of full command"""
    without: FloatArray
    """(n,), rad/s"""
    with_effect: FloatArray
    """(n,), rad/s"""


def paper_vehicle() -> Model:
    """The paper's, of Table 4."""
    return Model(TPP, np.array(TABLE_4["tpp"]))


def signature_of(effect: Effect, reference: Model | None = None) -> Signature:
    """On the paper's vehicle where no other is given. Raises EffectError where the effect cannot stand on it."""
    reference = reference or paper_vehicle()
    needed = _needed(effect, reference)
    plain, full = _pair(effect, needed, reference)
    steered = _steered(effect, full.structure)
    others = [name for name in full.structure.inputs if name not in (*CYCLIC, *steered)]
    held = {name: CHANNEL_AT.get(name, COMMAND_AT) for name in others}
    t, wave = doublets()
    with np.errstate(all="ignore"):  # a user's own may do as it likes
        without, with_effect = (answer(model, steered, wave, held) for model in (plain, full))
    k, j = _clearest(without, with_effect)
    decibels, degrees = _change(plain, full, steered[j], k)
    return Signature(
        effect=effect,
        beside=tuple(one.id for one in needed),
        held=held,
        output=full.structure.outputs[k],
        command=steered[j],
        decibels=decibels,
        degrees=degrees,
        t=t,
        commanded=wave,
        without=without[k, j],
        with_effect=with_effect[k, j],
    )


def _steered(effect: Effect, structure: Structure) -> list[str]:
    """Commands that bring it out: its own, where it answers to them and does not only read them."""
    own = [name for name in structure.commands if name not in CYCLIC]
    return own if own and effect.linear else list(CYCLIC)


def _clearest(without: FloatArray, with_effect: FloatArray) -> tuple[int, int]:
    """Output and command, of arrays (outputs, commands, n), that show the change best; an axis' own command if nearly
    as well."""
    change = np.linalg.norm(with_effect - without, axis=-1)
    size = np.linalg.norm(without, axis=-1).max(axis=1, keepdims=True)
    clear = change / np.maximum(size, 1e-9 * np.max(change))
    if clear.shape[0] == clear.shape[1]:
        clear = np.where(np.eye(len(clear), dtype=bool), clear, NEARLY * clear)
    k, j = np.unravel_index(int(np.argmax(clear)), clear.shape)
    return int(k), int(j)


def _needed(effect: Effect, reference: Model) -> list[Effect]:
    """What must be there for it, and for that, and so on: the first of alternatives."""
    found: list[Effect] = []
    for need in effect.needs:
        names = need.split("|")
        if not any(name in reference.structure.base_.contains for name in names):
            other = find(names[0])
            found += [*_needed(other, reference), other]
    return found


def _pair(effect: Effect, needed: list[Effect], reference: Model) -> tuple[Model, Model]:
    """The reference without and with the effect. Of what the base contains, the smaller base is what is without it."""
    base = reference.structure.base_
    if effect.id in base.contains:
        return reduce_to_cd(reference), reference
    channels = [name.split("|")[0] for one in (*needed, effect) for name in one.channels]
    constants = {mean: MEAN[name] for name, mean in FLIGHT_CONDITION.items()}
    known = reference.structure.by_name(reference.values)

    def in_numbers(effects: list[Effect]) -> Model:
        structure = compose(base, effects, channels, constants)
        values = {**{one.name: one.typical for one in structure.parameters}, **known}
        return Model(structure, structure.vector(values))

    return in_numbers(needed), in_numbers([*needed, replace(effect, absorbed_by=())])


def _change(plain: Model, full: Model, command: str, k: int) -> tuple[FloatArray | None, FloatArray | None]:
    if not full.structure.linear or command not in plain.structure.commands:
        return None, None
    H = [
        transfer(one.structure, one.values, FREQUENCY_HZ)[k, one.structure.inputs.index(command)]
        for one in (plain, full)
    ]
    ratio = H[1] / H[0]
    decibels: FloatArray = np.asarray(20 * np.log10(np.abs(ratio)), dtype=np.float64)
    return decibels, np.asarray(np.degrees(np.angle(ratio)), dtype=np.float64)


# ------------------------------------------------------------------------------------------------ in time


def doublets() -> tuple[FloatArray, FloatArray]:
    """Time in s and samples (n,): a large doublet with steep flanks, and a small smooth one."""
    t: FloatArray = np.arange(round(SECONDS / DT), dtype=np.float64) * DT
    begin, end = LARGE_S
    middle = 0.5 * (begin + end)
    corners = [0.0, begin, begin + RISE_S, middle - RISE_S, middle + RISE_S, end - RISE_S, end, SECONDS]
    large = LARGE * np.interp(t, corners, [0, 0, 1, 1, -1, -1, 0, 0])
    inside = (t >= SMALL_BEGINS_S) & (t < SMALL_BEGINS_S + SMALL_S)
    small = SMALL * np.where(inside, np.sin(2 * np.pi * (t - SMALL_BEGINS_S) / SMALL_S), 0.0)
    return t, np.asarray(large + small, dtype=np.float64)


def answer(model: Model, steered: list[str], wave: FloatArray, held: dict[str, float]) -> FloatArray:
    """(outputs, steered, n) rad/s: the rates from rest, where one after the other of these commands is the wave."""
    structure = model.structure
    inputs = np.zeros((len(structure.inputs), len(steered), wave.size))
    for i, name in enumerate(structure.inputs):
        if name in held:
            inputs[i] = held[name]
        if name in steered:
            inputs[i, steered.index(name)] = wave
    inputs = _acting(model, inputs)
    _, rest = divided(structure)
    values = np.array([model.values[structure.names.index(name)] for name in rest.names])
    return (_linear if linear_dynamics(structure) else _stepped)(rest, values, inputs)


def _acting(model: Model, inputs: FloatArray) -> FloatArray:
    """Commands behind play, limits and delays; `inputs` (m, runs, n)."""
    structure, commands = model.structure, len(model.structure.commands)
    named, found = structure.by_name(model.values), inputs.copy()
    for effect in structure.composed:
        own = {name: named[name] for name in effect.names}
        if effect.samples is not None:
            for run in range(inputs.shape[1]):
                found[:commands, run] = sampled(structure, effect, found[:commands, run], DT, own)
        if effect.response is not None:
            n = inputs.shape[-1]
            s = 2j * np.pi * np.fft.rfftfreq(2 * n, DT)
            late = np.fft.rfft(found[:commands], 2 * n) * effect.response(s, own)
            found[:commands] = np.fft.irfft(late, 2 * n)[..., :n]
    return found


def _linear(structure: Structure, values: FloatArray, inputs: FloatArray) -> FloatArray:
    A, B, C, D = structure.matrices(values)
    F, G = discretise(A, B, DT)
    driving = np.einsum("ij,jrn->rin", G, inputs[..., :-1])
    x = recursion(F, np.concatenate([np.zeros((*driving.shape[:-1], 1)), driving], axis=-1))
    return np.asarray(np.einsum("ki,rin->krn", C, x) + np.einsum("kj,jrn->krn", D, inputs))


def _stepped(structure: Structure, values: FloatArray, inputs: FloatArray) -> FloatArray:
    """By the middle of each sample, over which inputs are held."""
    named = structure.by_name(values)

    def at(x: AnyArray, u: AnyArray) -> tuple[AnyArray, AnyArray]:
        signals = dict(zip((*structure.states, *structure.inputs), (*x, *u), strict=True))
        rates, outputs = structure.evaluate(named, signals)
        runs = np.zeros(x.shape[1])
        return (
            np.array([rates[f"{state}_dot"] + runs for state in structure.states]),
            np.array([outputs[name] + runs for name in structure.outputs]),
        )

    found = np.empty((len(structure.outputs), *inputs.shape[1:]))
    x = np.zeros((len(structure.states), inputs.shape[1]))
    for k in range(inputs.shape[-1]):
        u = inputs[..., k]
        rate, found[..., k] = at(x, u)
        x = x + DT * at(x + 0.5 * DT * rate, u)[0]
    return found
