"""Principal axes of inertia that are not the body axes: a moment about one axis turns the other."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from sysid.data.airframe import Airframe
from sysid.model.effect import Effect, Signals, Stage
from sysid.model.parameter import Parameter


def equations(s: Signals) -> Mapping[str, Any]:
    c_q = s.c_p * s.M_a / s.L_b  # both hub moments come from one spring, so I_xx/I_yy = M_a/L_b
    shared = 1 - s.c_p * c_q
    return {"p_dot": (s.p_dot + s.c_p * s.q_dot) / shared, "q_dot": (s.q_dot + c_q * s.p_dot) / shared}


EFFECT = Effect(
    id="inertia_coupling",
    title="product of inertia",
    group="fuselage",
    equation="moments N_p, N_q (each per own inertia) become (N_p + c_p N_q)/(1 - c_p c_q), "
    "(N_q + c_q N_p)/(1 - c_p c_q), c_q = c_p M_a/L_b",
    source="rigid body with I_xy",
    signature="each axis errs in proportion to the other axis' angular acceleration, with the same sign on both",
    parameters=(
        Parameter(
            "c_p",
            "-",
            "product of inertia I_xy over I_xx",
            plausible=(-0.25, 0.25),  # a winged body turned by 15 degrees from its principal axes
            null=0.0,
            bounds=(-0.4, 0.4),  # c_p^2 M_a/L_b reaches 1, an impossible body, at 0.45 for the paper's vehicle
            typical=0.1,
        ),
    ),
    airframes=(Airframe.HELICOPTER,),
    stage=Stage.INERTIA,
    equations=equations,
    needs=("flapping",),
)
