"""Angular momentum of motor and hub, which tilt with the body and not with the disc."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from sysid.model.effect import Effect, Signals, Stage
from sysid.model.parameter import Parameter


def equations(s: Signals) -> Mapping[str, Any]:
    return {"p_dot": -s.h_p * s.q, "q_dot": s.h_q * s.p}


EFFECT = Effect(
    id="hub_gyroscopics",
    title="gyroscopic moments of motor and hub",
    group="rotor",
    equation="p_dot -= h_p q, q_dot += h_q p",
    source="rigid body with a spinning part; the paper's section 2 for the whole rotor",
    signature="each axis errs in phase with the other axis' rate, with opposite signs, most at low frequency",
    parameters=(
        Parameter(
            "h_p",
            "1/s",
            "angular momentum of motor and hub over I_xx",
            plausible=(-3.0, 3.0),  # beyond, it would be the whole rotor's
            null=0.0,
            bounds=(-100.0, 100.0),
            typical=0.5,
        ),
        Parameter(
            "h_q",
            "1/s",
            "angular momentum of motor and hub over I_yy",
            plausible=(-12.0, 12.0),  # a winged body has several times the inertia about roll
            null=0.0,
            bounds=(-400.0, 400.0),
            typical=2.4,
        ),
    ),
    stage=Stage.DYNAMICS,
    equations=equations,
    absorbed_by=("cd",),
)
