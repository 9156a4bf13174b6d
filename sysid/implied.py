"""What a fit implies about the vehicle, beside what was measured: an implausible figure is a clue.

Eq. 17: M_a = (k_beta + h T)/I_yy, L_b likewise with I_xx. The time constant and the cross terms of first-order flapping
give the Lock number, gamma = 16/(tau_f Omega), and (flap frequency ratio)^2 - 1 from A_b and B_a of opposite signs.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sysid.model import G, Model
from sysid.record import Record


@dataclass(frozen=True)
class Vehicle:
    """What was measured on the ground; None where it was not."""

    k_beta: float
    """Blade spring, N m/rad."""
    mass: float | None = None
    """kg"""
    arm: float | None = None
    """Rotor plane above the centre of mass, m."""
    I_xx: float | None = None
    I_yy: float | None = None
    """kg m^2"""


@dataclass(frozen=True)
class Implied:
    """One figure."""

    name: str
    unit: str
    value: float
    measured: float | None
    plausible: tuple[float, float]

    @property
    def implausible(self) -> bool:
        low, high = self.plausible
        far = self.measured is not None and not 0.5 <= self.value / self.measured <= 2.0
        return far or not low <= self.value <= high


def rotor_speed(records: Sequence[Record]) -> float | None:
    """Mean over the runs that log it, rad/s."""
    logged = [record.channels["omega"] for record in records if "omega" in record.channels]
    return float(np.mean(np.concatenate(logged))) if logged else None


def implied(model: Model, vehicle: Vehicle, omega: float | None) -> tuple[Implied, ...]:
    """Inertias from L_b and M_a; Lock number and flap frequency ratio from tau_f, A_b, B_a where Omega is known."""
    names = model.structure.names
    spring = vehicle.k_beta + (vehicle.arm or 0.0) * (vehicle.mass or 0.0) * G
    found = []
    for name, parameter, measured in (("I_xx", "L_b", vehicle.I_xx), ("I_yy", "M_a", vehicle.I_yy)):
        if parameter in names:
            found.append(Implied(name, "kg m^2", spring / model[parameter], measured, (1e-4, 1e3)))
    if omega is not None and "tau_f" in names:
        lock = 16 / (model["tau_f"] * omega)
        found.append(Implied("Lock number", "-", lock, None, (0.3, 15.0)))
        # first-order flapping: A_b = -B_a = -(8/gamma)(lambda^2 - 1); the two are averaged
        cross = 0.5 * (model["B_a"] - model["A_b"])
        found.append(Implied("flap frequency ratio", "-", math.sqrt(max(1 + cross * lock / 8, 0.0)), None, (1.0, 1.6)))
    return tuple(found)
