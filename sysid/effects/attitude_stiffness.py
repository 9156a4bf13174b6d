"""A moment back to level: a tether, a stand, the ground, an inner stabiliser that is not logged."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from sysid.model.effect import Effect, Signals, Stage
from sysid.model.parameter import Parameter


def equations(s: Signals) -> Mapping[str, Any]:
    return {"p_dot": s.L_phi * s.phi, "q_dot": s.M_theta * s.theta}


EFFECT = Effect(
    id="attitude_stiffness",
    title="moment back to level",
    group="fuselage",
    equation="p_dot += L_phi phi, q_dot += M_theta theta",
    source="tether, stand, ground contact, an unlogged inner stabiliser; not in free flight: no pendulum hangs there",
    signature="the measured rates are smaller than the model's below 1 Hz and return after a slow push",
    parameters=(
        Parameter(
            "L_phi",
            "1/s^2",
            "roll acceleration per roll angle",
            plausible=(0.0, 0.0),  # in free flight; on a stand or a tether the flag is for the user to overrule
            null=0.0,
            bounds=(-2000.0, 2000.0),
            typical=-10.0,
        ),
        Parameter(
            "M_theta",
            "1/s^2",
            "pitch acceleration per pitch angle",
            plausible=(0.0, 0.0),
            null=0.0,
            bounds=(-2000.0, 2000.0),
            typical=-10.0,
        ),
    ),
    stage=Stage.DYNAMICS,
    equations=equations,
    attitude=True,
)
