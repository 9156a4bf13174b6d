"""The vehicle drifts off where it leans, and the air it then meets turns it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from sysid.data.airframe import Airframe
from sysid.model.effect import Effect, Signals, Stage
from sysid.model.parameter import Parameter


def equations(s: Signals) -> Mapping[str, Any]:
    return {
        "v_dot": s.g * (s.phi + s.b) + s.Y_v * s.v,
        "u_dot": -s.g * (s.theta + s.a) + s.X_u * s.u,
        "p_dot": s.L_v * s.v,
        "q_dot": s.M_u * s.u,
    }


EFFECT = Effect(
    id="speed_stability",
    title="moments of the hover's drift",
    group="fuselage",
    equation="v_dot = g (phi + b) + Y_v v, p_dot += L_v v; u_dot = -g (theta + a) + X_u u, q_dot += M_u u",
    source="Mettler 2003, the full hover model",
    signature="a slow swing below 0.5 Hz is missing, in step with twice-integrated rate",
    parameters=(
        Parameter(
            "Y_v",
            "1/s",
            "drag sideways",
            plausible=(-2.0, 0.0),  # drag slows; a wing broadside loses half its speed in a second
            bounds=(-50.0, 5.0),
            typical=-0.3,
            grid=(-0.3,),
        ),
        Parameter(
            "L_v",
            "rad/(m s)",
            "roll acceleration per sideways speed",
            plausible=(-20.0, 20.0),  # either sign: the wing's centre may lie above or below the hub
            null=0.0,
            bounds=(-500.0, 500.0),
            typical=-3.0,
            grid=(-3.0, 3.0),  # from the wrong sign, or from next to nothing, no step leads to the right one
        ),
        Parameter(
            "X_u",
            "1/s",
            "drag fore and aft",
            plausible=(-2.0, 0.0),
            bounds=(-50.0, 5.0),
            typical=-0.3,
            grid=(-0.3,),
        ),
        Parameter(
            "M_u",
            "rad/(m s)",
            "pitch acceleration per forward speed",
            plausible=(-20.0, 20.0),
            null=0.0,
            bounds=(-500.0, 500.0),
            typical=3.0,
            grid=(-3.0, 3.0),
        ),
    ),
    airframes=(Airframe.HELICOPTER,),
    stage=Stage.DYNAMICS,
    equations=equations,
    states=("u", "v"),
    attitude=True,
    needs=("flapping",),
)
