"""What a fit implies about the vehicle, beside what was measured: an implausible figure is a clue.

Eq. 17: M_a = (k_beta + h T)/I_yy, L_b the same with I_xx; in hover the thrust T is the weight. First-order flapping
(the rotor rows in Omega-free symbols) has tau_f = 16/(gamma Omega) and B_a = -A_b = 8 (nu^2 - 1)/gamma, which give the
Lock number gamma and the flap frequency ratio nu; A_b and B_a are two measurements of one figure and are averaged.
With the paper's k_beta = 88 N m/rad, h = 0.15 m, 4.5 kg and 1650 RPM, Table 4 implies I_xx 0.641 and I_yy 0.133 kg m^2,
gamma 1.02 and nu^2 - 1 = 0.18.

Ignored: thrust other than the weight (forward flight carries part of it on the wing, which changes h T, 7 % of the
sum), the blades' own hinge offset, and whatever else makes a moment in proportion to flapping.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from sysid.data.record import Record
from sysid.fit.result import Fit, finite
from sysid.model.structure import FloatArray, G

RELATIVE_STEP = 1e-6
FAR = 1.4
"""A figure that differs from the measured one by more than this factor is a clue: a swing test and a spring balance
are good to a tenth, and a servo lag of 30 ms that the structure lacks makes I_yy 1.6 times too large."""


@dataclass(frozen=True, kw_only=True)
class Vehicle:
    """What was measured on the ground; None where it was not."""

    k_beta: float
    """Spring of the rotor against tilt, N m/rad."""
    mass: float | None = None
    """kg"""
    arm: float | None = None
    """Rotor plane above the centre of mass, m."""
    I_xx: float | None = None
    I_yy: float | None = None
    """About the body's roll and pitch axes, kg m^2."""
    omega: float | None = None
    """Usual rotor speed, rad/s, for runs that do not log it."""


@dataclass(frozen=True, kw_only=True)
class Implied:
    """One figure."""

    name: str
    unit: str
    value: float
    standard_error: float | None
    """From the fit alone; None where the parameters it stands on were held or ended on a bound."""
    measured: float | None
    plausible: tuple[float, float]

    @property
    def implausible(self) -> bool:
        low, high = self.plausible
        far = self.measured is not None and not 1 / FAR <= self.value / self.measured <= FAR
        return far or not low <= self.value <= high

    def to_json(self) -> dict[str, Any]:
        return {
            "name": self.name,
            "unit": self.unit,
            "value": finite(self.value),
            "standard_error": None if self.standard_error is None else finite(self.standard_error),
            "measured": self.measured,
            "implausible": self.implausible,
        }


def rotor_speed(records: Sequence[Record]) -> float | None:
    """Mean over the runs that log it, rad/s; negative for a rotor that turns the other way."""
    logged = [record.channels["omega"] for record in records if "omega" in record.channels]
    return float(np.mean(np.concatenate(logged))) if logged else None


def implied(fit: Fit, vehicle: Vehicle, omega: float | None) -> tuple[Implied, ...]:
    """Inertias from L_b and M_a; Lock number and flap frequency ratio from the rotor's parameters; the angle by which
    the cyclic is turned from its own.

    `omega` is the logged rotor speed, else the vehicle's own is taken; without either there are only inertias.
    """
    names = fit.model.structure.names
    spring = vehicle.k_beta + (vehicle.arm or 0.0) * (vehicle.mass or 0.0) * G

    def inertia(parameter: str) -> Callable[[dict[str, float]], float]:
        return lambda p: _over(spring, p[parameter])

    found = [
        _figure(fit, name, "kg m^2", of=inertia(parameter), measured=measured, plausible=(1e-4, 1e3))
        for name, parameter, measured in (("I_xx", "L_b", vehicle.I_xx), ("I_yy", "M_a", vehicle.I_yy))
        if parameter in names
    ]
    if "lock_number" in names:
        found.append(
            _figure(fit, "Lock number", "-", of=lambda p: p["lock_number"], measured=None, plausible=LOCK_NUMBERS)
        )
        found.append(
            _figure(
                fit,
                "flap frequency ratio",
                "-",
                of=lambda p: p["flap_frequency_ratio"],
                measured=None,
                plausible=RATIOS,
            )
        )
    speed = vehicle.omega if omega is None or omega == 0 else omega
    if speed is not None and {"tau_f", "A_b", "B_a"} <= set(names):

        def lock(p: dict[str, float]) -> float:
            return _over(16.0, p["tau_f"] * abs(speed))

        def ratio(p: dict[str, float]) -> float:
            coupling = math.copysign(1.0, speed) * 0.5 * (p["B_a"] - p["A_b"])
            return math.sqrt(max(1 + coupling * lock(p) / 8, 0.0))

        found.append(_figure(fit, "Lock number", "-", of=lock, measured=None, plausible=LOCK_NUMBERS))
        found.append(_figure(fit, "flap frequency ratio", "-", of=ratio, measured=None, plausible=RATIOS))
    return (*found, *_swashplate(fit))


def _swashplate(fit: Fit) -> list[Implied]:
    """By how much the cyclic is turned, from each row of its four terms: a phase offset of the swashplate turns both
    alike (`swashplate_phase`), hinges and springs of the rotor do not."""
    rows = (("roll", lambda p: (-p["B_lon"], p["B_lat"])), ("pitch", lambda p: (p["A_lat"], p["A_lon"])))
    if not {"A_lat", "A_lon", "B_lat", "B_lon"} <= set(fit.model.structure.names):
        return []

    def turned(row: Callable[[dict[str, float]], tuple[float, float]]) -> Callable[[dict[str, float]], float]:
        return lambda p: math.degrees(math.atan2(*row(p)))

    return [
        _figure(fit, f"cyclic turned, {axis}", "deg", of=turned(row), measured=None, plausible=(-180.0, 180.0))
        for axis, row in rows
    ]


LOCK_NUMBERS = (0.3, 15.0)
"""From heavy-tipped model blades to light full-size ones."""
RATIOS = (1.0, 1.6)
"""From a free central hinge to a stiff propeller blade on a rigid hub."""


def _over(x: float, y: float) -> float:
    return x / y if y else math.inf


def _figure(
    fit: Fit,
    name: str,
    unit: str,
    of: Callable[[dict[str, float]], float],
    measured: float | None,
    plausible: tuple[float, float],
) -> Implied:
    """A function of the parameters, its standard error to first order."""
    values = fit.model.values
    value = of(fit.model.by_name)
    slope: FloatArray = np.zeros(values.size)
    for index in range(values.size):
        step = RELATIVE_STEP * max(abs(float(values[index])), 1e-6)
        moved = values.copy()
        moved[index] += step
        slope[index] = (of(fit.model.structure.by_name(moved)) - value) / step
    variance = float(slope @ fit.covariance @ slope) if np.all(np.isfinite(slope)) else math.nan
    error = math.sqrt(variance) if variance > 0 else None
    return Implied(name=name, unit=unit, value=value, standard_error=error, measured=measured, plausible=plausible)
