"""Multirotor: roll and pitch, each a rate behind motors of first order, apart from each other.

k / ((s - L_p) (tau_m s + 1)) from each command to its own rate; an integrator where the damping is held at zero
(`--fix L_p=0,M_q=0`). It is Cylinder Dynamics without the coupling of a spinning rotor, with `motor_lag` built in.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from sysid.data.airframe import Airframe
from sysid.model.base import Base
from sysid.model.effect import Signals
from sysid.model.parameter import Parameter


def equations(s: Signals) -> Mapping[str, Any]:
    return {
        "p_dot": s.L_p * s.p + s.L_lat * s.thrust_x,
        "q_dot": s.M_q * s.q + s.M_lon * s.thrust_y,
        "thrust_x_dot": (s.delta_x - s.thrust_x) / s.tau_m,
        "thrust_y_dot": (s.delta_y - s.thrust_y) / s.tau_m,
    }


TAU_M = Parameter(
    "tau_m",
    "s",
    "time constant of the motors with their propellers",
    plausible=(0.0, 0.15),  # as `motor_lag`
    bounds=(1e-4, 1.0),
    typical=0.05,
    grid=(0.015, 0.05, 0.15),
)
BASE = Base(
    name="multirotor",
    title="Axes behind Motors",
    rank=3,
    states=("p", "q", "thrust_x", "thrust_y"),
    parameters=(
        Parameter("L_p", "1/s", "roll damping"),
        Parameter("M_q", "1/s", "pitch damping"),
        Parameter("L_lat", "1/s^2", "roll acceleration per roll command"),
        Parameter("M_lon", "1/s^2", "pitch acceleration per pitch command"),
        TAU_M,
    ),
    equations=equations,
    uncoupled=(-5.0, -5.0, 0.0, 0.0, 0.05),
    contains=("motor_lag",),
    absorbs=("angular_damping",),
    airframes=(Airframe.MULTIROTOR,),
    alone=(("roll", "motor_lag"), ("pitch", "motor_lag"), ("multirotor_yaw",), ("heave",)),
    watched=("L_p", "M_q", "L_lat", "M_lon", "tau_m"),
)
