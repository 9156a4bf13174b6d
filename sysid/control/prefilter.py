"""A dynamic prefilter: what is added to the commands while the rates are on their way to those asked for.

Each rate asked for has a model that follows it, w^2 / (s^2 + 2 zeta w s + w^2); z are the rates of these models less
those asked for, and the models' accelerations: (p_m - p_ref, q_m - q_ref, p_m', q_m'). The commands are then
u = -K x_hat + g y_ref + F z. In the long run z is nothing, and with F = 0 this is the paper's eq. 13.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from sysid.data.preprocess import ComplexArray
from sysid.model.structure import FloatArray


@dataclass(frozen=True, eq=False, kw_only=True)
class DynamicPrefilter:
    """Outside the loop: margins do not know of it."""

    frequency: FloatArray
    """(2,), of the models of p and q, rad/s."""
    damping: FloatArray
    """(2,)"""
    F: FloatArray
    """(commands, 4), full command per rad/s, and per rad/s^2."""

    def at(self, s: ComplexArray) -> ComplexArray:
        """(f, commands, 2): what is added to the commands, per rate asked for."""
        return np.asarray(self.F @ followed(self.frequency, self.damping, s))

    def to_json(self) -> dict[str, Any]:
        return {
            "frequency_rad_s": self.frequency.tolist(),
            "damping": self.damping.tolist(),
            "F": self.F.tolist(),
        }


def followed(frequency: FloatArray, damping: FloatArray, s: ComplexArray) -> ComplexArray:
    """(f, 4, 2): z per rate asked for."""
    each = model_answers(frequency, damping, s)
    z = np.zeros((s.size, 4, 2), dtype=complex)
    for axis in (0, 1):
        z[:, axis, axis], z[:, axis + 2, axis] = each[:, axis] - 1, s * each[:, axis]
    return z


def model_answers(frequency: FloatArray, damping: FloatArray, s: ComplexArray) -> ComplexArray:
    """(f, 2): rates of the models per rate asked for."""
    w = frequency
    return np.asarray(w**2 / (s[:, None] ** 2 + 2 * damping * w * s[:, None] + w**2), dtype=complex)
