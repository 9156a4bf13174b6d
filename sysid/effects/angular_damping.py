"""Damping of the body by the air, proportional to its rates."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from sysid.model.effect import Effect, Signals, Stage
from sysid.model.parameter import Parameter


def equations(s: Signals) -> Mapping[str, Any]:
    return {"p_dot": s.L_p * s.p, "q_dot": s.M_q * s.q}


EFFECT = Effect(
    id="angular_damping",
    title="damping of the body's rates",
    group="fuselage",
    equation="p_dot += L_p p, q_dot += M_q q",
    source="the paper, eq. 15",
    signature="the slow mode rings too long; the error is in phase with the axis' own rate",
    parameters=(
        Parameter(
            "L_p",
            "1/s",
            "roll acceleration per roll rate",
            plausible=(-50.0, 0.0),  # a body takes no energy from still air
            null=0.0,
            bounds=(-500.0, 500.0),
            typical=-2.0,
        ),
        Parameter(
            "M_q",
            "1/s",
            "pitch acceleration per pitch rate",
            plausible=(-50.0, 0.0),
            null=0.0,
            bounds=(-500.0, 500.0),
            typical=-2.0,
        ),
    ),
    stage=Stage.DYNAMICS,
    equations=equations,
    absorbed_by=("cd",),
)
