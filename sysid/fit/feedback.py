"""Runs in which nothing but feedback moved the commands: a fit to them shows minus the controller's inverse."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from sysid.data.dataset import Bins
from sysid.errors import FitError
from sysid.fit.rows import orthonormal, rows
from sysid.model.structure import FloatArray, Structure

ALONE = 0.95
"""Of every command's power, explained by feedback of rates and angles. Gusts in a loop without an excitation make 0.99
and more of it; with a chirp in it, fourfold gusts and a loop of double gain, half."""
LATE_S = (0.0, 0.005, 0.01, 0.02)
"""Of the controller, tried."""
RATES_OF_TURN = frozenset({"p", "q", "r"})
"""Outputs that a controller feeds back as such, and integrated."""


def refuse_feedback_alone(structure: Structure, bins: Bins) -> None:
    """Raises FitError where rates and their integrals, fed back against the motion, are all that moved the commands.

    Asked of the axes that turn, each with a command of its own. A vehicle that follows its commands has the other sign:
    positive commands give positive rates.
    """
    commands, outputs = structure.base_.commands, structure.outputs
    if not RATES_OF_TURN.issuperset(outputs) or len(outputs) != len(commands):
        return
    if bins.instruments(commands) is not None:
        return
    found = (_fed_back(bins, commands, late_s) for late_s in LATE_S)
    shares, against = max(found, key=lambda one: float(np.min(one[0])))
    if np.min(shares) >= ALONE and np.all(against):
        said = ", ".join(f"{name} {100 * share:.0f} %" for name, share in zip(commands, shares, strict=True))
        raise FitError(
            f"the commands of these runs are feedback alone ({said} of their power follow from the rates as a "
            "controller makes them): a fit would show the controller, not the vehicle; fly a chirp and log what it adds"
        )


def _fed_back(bins: Bins, commands: Sequence[str], late_s: float) -> tuple[FloatArray, NDArray[np.bool_]]:
    """Of each command's power, (m,), what gains on all m rates and their angles explain; and whether its own act
    against the motion, (m,)."""
    m = len(commands)
    inner, cross, power = np.zeros((2 * m, 2 * m)), np.zeros((2 * m, m)), np.zeros(m)
    for group in bins.stacks:
        s = 2j * np.pi * group.frequency_hz
        moved = np.concatenate([group.Y, group.Y / s]) * np.exp(-s * late_s)
        wanted = group.U[[group.inputs.index(name) for name in commands]]
        step = 1 / (group.z - 1)
        ends, both = np.stack([step, group.z * step**2]), np.concatenate([moved, wanted])
        for part in group.slices:
            basis = orthonormal(ends[:, part])
            each = group.scale[part] * both[:, part]
            each = rows((each - (each @ basis.conj().T) @ basis)[:, None])
            inner += each[: 2 * m] @ each[: 2 * m].T
            cross += each[: 2 * m] @ each[2 * m :].T
            power += np.sum(each[2 * m :] ** 2, axis=1)
    size = np.sqrt(np.maximum(np.diag(inner), 1e-300))
    gains = np.linalg.lstsq(inner / np.outer(size, size), cross / size[:, None], rcond=1e-10)[0]
    shares: FloatArray = np.sum(gains * cross / size[:, None], axis=0) / np.maximum(power, 1e-300)
    own = np.array([gains[axis, axis] + gains[m + axis, axis] for axis in range(m)])
    return shares, own < 0
