"""Runs in which nothing but feedback moved the commands: a fit to them shows minus the controller's inverse."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from sysid.data.dataset import Bins
from sysid.data.record import CYCLIC, RATES
from sysid.errors import FitError
from sysid.fit.rows import orthonormal, rows
from sysid.model.structure import FloatArray, Structure

ALONE = 0.95
"""Of every command's power, explained by feedback of rates and angles. Gusts in a loop without an excitation make 0.99
and more of it; with a chirp in it, fourfold gusts and a loop of double gain, half."""
LATE_S = (0.0, 0.005, 0.01, 0.02)
"""Of the controller, tried."""


def refuse_feedback_alone(structure: Structure, bins: Bins) -> None:
    """Raises FitError where rates and their integrals, fed back against the motion, are all that moved roll and pitch.

    A vehicle that follows its commands has the other sign: positive commands give positive rates.
    """
    if structure.outputs != RATES or not set(CYCLIC) <= set(structure.inputs):
        return
    if bins.instruments(CYCLIC) is not None:
        return
    shares, against = max((_fed_back(bins, late_s) for late_s in LATE_S), key=lambda found: float(np.min(found[0])))
    if np.min(shares) >= ALONE and np.all(against):
        said = ", ".join(f"{name} {100 * share:.0f} %" for name, share in zip(CYCLIC, shares, strict=True))
        raise FitError(
            f"the commands of these runs are feedback alone ({said} of their power follow from the rates as a "
            "controller makes them): a fit would show the controller, not the vehicle; fly a chirp and log what it adds"
        )


def _fed_back(bins: Bins, late_s: float) -> tuple[FloatArray, NDArray[np.bool_]]:
    """Of each command's power, (2,), what gains on both rates and both angles explain; and whether its own act against
    the motion, (2,)."""
    inner, cross, power = np.zeros((4, 4)), np.zeros((4, 2)), np.zeros(2)
    for group in bins.stacks:
        s = 2j * np.pi * group.frequency_hz
        moved = np.concatenate([group.Y, group.Y / s]) * np.exp(-s * late_s)
        commands = group.U[[group.inputs.index(name) for name in CYCLIC]]
        step = 1 / (group.z - 1)
        ends, both = np.stack([step, group.z * step**2]), np.concatenate([moved, commands])
        for part in group.slices:
            basis = orthonormal(ends[:, part])
            each = group.scale[part] * both[:, part]
            each = rows((each - (each @ basis.conj().T) @ basis)[:, None])
            inner += each[:4] @ each[:4].T
            cross += each[:4] @ each[4:].T
            power += np.sum(each[4:] ** 2, axis=1)
    size = np.sqrt(np.maximum(np.diag(inner), 1e-300))
    gains = np.linalg.lstsq(inner / np.outer(size, size), cross / size[:, None], rcond=1e-10)[0]
    shares: FloatArray = np.sum(gains * cross / size[:, None], axis=0) / np.maximum(power, 1e-300)
    own = np.array([gains[axis, axis] + gains[2 + axis, axis] for axis in range(2)])
    return shares, own < 0
