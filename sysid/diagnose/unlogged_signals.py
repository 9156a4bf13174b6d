"""Signals that could be logged besides, and how far each would set rivals apart on runs like those flown."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from sysid.data.preprocess import ComplexArray
from sysid.data.stacks import Stack
from sysid.diagnose.rivals import Rivals, left_unimitated
from sysid.model.acting import in_time
from sysid.model.effect import Stage
from sysid.model.structure import FloatArray, Model

NOISE_OF = {"servo": 0.01, "flapping": 0.02, "attitude": 0.01}
"""Of sensors that may be fitted: full command and rad, white at the log's rate."""
STEP = 1e-4


def told_by_signal(pair: Rivals, signal: str) -> float:
    """Standard errors that the signal adds when logged on runs like those flown."""
    truth, rival = pair.truth.model, pair.rival.model
    free = pair.rival.free
    apart, slopes = [], []
    for group in pair.truth.dataset.imposed:
        here, there = _signal(truth, signal, group), _signal(rival, signal, group)
        if here is None or there is None:
            return 0.0
        weight = group.scale / NOISE_OF[signal]
        apart.append(_real(weight * (here - there)))
        slopes.append(np.stack([_real(weight * _slope(rival, name, signal, group, there)) for name in free]))
    J = np.concatenate(slopes, axis=1)
    after = left_unimitated(pair.apart, pair.J, np.concatenate(apart), J, 1)
    return math.sqrt(max(after**2 - pair.flown**2, 0.0))


def _real(x: ComplexArray) -> FloatArray:
    return np.asarray(np.ascontiguousarray(x).reshape(-1).view(float))


def _slope(model: Model, name: str, signal: str, group: Stack, here: ComplexArray) -> ComplexArray:
    """Of a signal to one parameter."""
    structure = model.structure
    if signal == "servo" and all(name not in one.names for one in structure.composed if one.stage is Stage.COMMAND):
        return np.zeros_like(here)
    index = structure.names.index(name)
    step = STEP * max(abs(model[name]), 0.1 * abs(structure.parameters[index].typical))
    moved = model.values.copy()
    moved[index] += step
    there = _signal(Model(structure, moved), signal, group)
    assert there is not None
    return (there - here) / step


def _signal(model: Model, signal: str, group: Stack) -> ComplexArray | None:
    """A signal that is not logged, a row for each axis on a stack's bins; None where the model does not foretell it."""
    structure = model.structure
    U = _acting(model, group)
    if signal == "servo":
        return U[: len(structure.base_.commands)]
    if not structure.linear:
        return None
    outer = replace(structure, composed=tuple(one for one in structure.composed if one.stage is not Stage.COMMAND))
    A, B, _, _ = outer.matrices(np.array([model[name] for name in outer.names]))
    s = 2j * np.pi * group.frequency_hz
    X = np.linalg.solve(s[:, None, None] * np.eye(len(A)) - A, (B @ U).T[..., None])[..., 0].T
    at = {name: X[i] for i, name in enumerate(outer.states)}
    if signal == "attitude":
        rates = [at[name] / s for name in ("p", "q", "r") if name in at]
        return np.stack(rates) if rates else None
    return np.stack([at["a"], at["b"]]) if "a" in at else None


def _acting(model: Model, group: Stack) -> ComplexArray:
    """The structure's inputs behind all that lies between command and swashplate."""
    structure = model.structure
    named = structure.by_name(model.values)
    U = group.U[[group.inputs.index(name) for name in structure.inputs]].copy()
    commands = len(structure.commands)
    front = [one for one in structure.composed if one.samples is not None or one.per_command]
    if front:
        for one, part in zip(group.spectra, group.slices, strict=True):
            U[:commands, part] = one.changed(structure.commands, in_time(structure, front, one.segment, named))
    for effect in structure.composed:
        if effect.response is not None:
            s = 2j * np.pi * group.frequency_hz
            U[:commands] *= effect.response(s, {name: named[name] for name in effect.names})
    return U
