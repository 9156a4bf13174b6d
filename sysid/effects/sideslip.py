"""The weathercock: in hover axes roll is forward flight's yaw, and it builds up a sideslip."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import cache
from typing import Any

from sysid.data.airframe import Airframe
from sysid.model.effect import Effect, Signals, Stage, Surroundings
from sysid.model.parameter import Parameter


def equations(s: Signals) -> Mapping[str, Any]:
    return {"beta_dot": s.p - s.Y_b * s.beta, **_moment(s)}


def _moment(s: Signals) -> Mapping[str, Any]:
    return {"p_dot": s.L_beta * s.beta}


def adapt(around: Surroundings) -> Effect:
    """Where beta is logged it is read: it needs no state, and Y_b has no part in the rates."""
    return _logged() if "beta" in around.available else EFFECT


@cache
def _logged() -> Effect:
    parameters = tuple(one for one in EFFECT.parameters if one.name == "L_beta")
    return replace(EFFECT, parameters=parameters, equations=_moment, states=(), channels=("beta",))


EFFECT = Effect(
    id="sideslip",
    title="sideslip",
    group="forward",
    equation="beta_dot = p - Y_b beta, p_dot += L_beta beta (hover p is forward flight's yaw); beta is a state where "
    "it is not logged",
    source="directional stability by the fin; Etkin, Dynamics of Flight",
    signature="in forward flight roll errs between 0.2 and 2 Hz, in step with the filtered integral of p",
    parameters=(
        Parameter(
            "Y_b",
            "1/s",
            "side force against the motion, per mass and speed",
            plausible=(0.03, 5.0),  # as Z_a, with fin and body in place of the wing
            bounds=(0.0, 100.0),
            typical=1.0,
            grid=(0.3, 1.0, 4.0),
        ),
        Parameter(
            "L_beta",
            "1/s^2",
            "roll acceleration per sideslip",
            plausible=(-300.0, 30.0),  # stable within 3 Hz; a little unstable can be flown
            null=0.0,
            bounds=(-5000.0, 5000.0),
            typical=-20.0,
        ),
    ),
    airframes=(Airframe.HELICOPTER,),
    stage=Stage.DYNAMICS,
    equations=equations,
    states=("beta",),
    adapt=adapt,
)
