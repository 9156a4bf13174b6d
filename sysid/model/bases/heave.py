"""Heave alone: the vertical specific force and the collective, thrust behind a lag.

Thrust follows its command and the vehicle's sinking within `tau_T`, in which blades or motors and the inflow settle;
what acts on the vehicle beside its weight is what an accelerometer measures, and moves it.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from sysid.model.base import Base
from sysid.model.effect import Signals
from sysid.model.parameter import Parameter


def equations(s: Signals) -> Mapping[str, Any]:
    return {"w_dot": s.az, "az_dot": (s.Z_w * s.w + s.Z_col * s.delta_c - s.az) / s.tau_T}


BASE = Base(
    name="heave",
    title="Heave alone",
    states=("w", "az"),
    outputs=("az",),
    commands=("delta_c",),
    parameters=(
        Parameter("Z_w", "1/s", "heave damping"),
        Parameter("Z_col", "m/s^2", "vertical acceleration, positive down, per collective"),
        Parameter(
            "tau_T",
            "s",
            "time constant of the thrust",
            plausible=(0.0, 0.5),
            bounds=(1e-4, 2.0),
            typical=0.05,
            grid=(0.01, 0.03, 0.1),
        ),
    ),
    equations=equations,
    uncoupled=(-0.5, 0.0, 0.05),
    absorbs=("angular_damping",),
    watched=("Z_w", "Z_col", "tau_T"),
)
