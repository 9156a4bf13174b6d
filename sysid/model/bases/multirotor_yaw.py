"""Yaw of a multirotor: drag of its rotors, and their reaction while they change speed, behind motors of first order.

N_ped (T_r s + 1) / ((s - N_r) (tau_m s + 1)): a rotor's moment on the body is its drag and I_r dOmega/dt, so that for
small steps the lead T_r is I_r over the slope of the drag with speed; it may well be longer than the lag.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from sysid.data.airframe import Airframe
from sysid.model.base import Base
from sysid.model.bases.multirotor import TAU_M
from sysid.model.effect import Signals
from sysid.model.parameter import Parameter


def equations(s: Signals) -> Mapping[str, Any]:
    speeding_up = (s.delta_r - s.drag) / s.tau_m
    return {"r_dot": s.N_r * s.r + s.N_ped * (s.drag + s.T_r * speeding_up), "drag_dot": speeding_up}


BASE = Base(
    name="multirotor_yaw",
    title="Yaw behind Motors",
    states=("r", "drag"),
    outputs=("r",),
    commands=("delta_r",),
    parameters=(
        Parameter("N_r", "1/s", "yaw damping"),
        Parameter("N_ped", "1/s^2", "yaw acceleration per yaw command, once the motors have settled"),
        Parameter(
            "T_r",
            "s",
            "lead of the rotors' reaction",
            plausible=(0.0, 2.0),
            bounds=(-20.0, 20.0),
            typical=0.1,
            grid=(0.1, 0.4),  # shorter than the damping's time, and longer: two valleys
        ),
        TAU_M,
    ),
    equations=equations,
    uncoupled=(-5.0, 0.0, 0.0, 0.05),
    contains=("motor_lag",),
    absorbs=("angular_damping",),
    airframes=(Airframe.MULTIROTOR,),
    watched=("N_r", "N_ped", "T_r", "tau_m"),
)
