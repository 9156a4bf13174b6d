"""Yaw alone: its rate and its own command, of first order.

A multirotor's, whose motors turn the body while they change speed, is `multirotor_yaw`.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from sysid.model.base import Base
from sysid.model.effect import Signals
from sysid.model.parameter import Parameter


def equations(s: Signals) -> Mapping[str, Any]:
    return {"r_dot": s.N_r * s.r + s.N_ped * s.delta_r}


BASE = Base(
    name="yaw",
    title="Yaw alone",
    states=("r",),
    outputs=("r",),
    commands=("delta_r",),
    parameters=(
        Parameter("N_r", "1/s", "yaw damping"),
        Parameter("N_ped", "1/s^2", "yaw acceleration per yaw command"),
    ),
    equations=equations,
    uncoupled=(-5.0, 0.0),
    absorbs=("angular_damping",),
    watched=("N_r", "N_ped"),
)
