"""Aerodynamic parameters follow the airspeed as it wanders."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import cache
from typing import Any

from sysid.data.airframe import Airframe
from sysid.model.effect import Effect, Signals, Stage, Surroundings
from sysid.model.parameter import Parameter

POWERS = {
    "angular_damping": {"L_p": 1, "M_q": 1},
    "angle_of_attack": {"Z_a": 1, "M_alpha": 2},
    "sideslip": {"Y_b": 1, "L_beta": 2},
    "elevator": {"M_elev": 2},
}
"""By the effect that has them: CD's own L_p and M_q are the rotor's and do not follow the airspeed."""


def adapt(around: Surroundings) -> Effect:
    there = tuple(one for one in POWERS if one in around.effects)
    return _of(there) if there else EFFECT


@cache
def _of(there: tuple[str, ...]) -> Effect:
    powers = {name: power for one in there for name, power in POWERS[one].items()}

    def equations(s: Signals) -> Mapping[str, Any]:
        ratio = (s.airspeed / s.V_0) ** s.m
        return {name: getattr(s, name) * ratio**power for name, power in powers.items() if s.has(name)}

    return replace(EFFECT, equations=equations)


EFFECT = Effect(
    id="airspeed_scaling",
    title="aerodynamics change with airspeed",
    group="forward",
    equation="L_p, M_q, Z_a, Y_b times (V/V_0)^m; M_elev, M_alpha, L_beta times (V/V_0)^2m; V_0 = mean over the fitted "
    "runs, stored",
    source="dynamic pressure",
    signature="the error comes and goes with the airspeed: too little elevator when fast, too much when slow",
    parameters=(
        Parameter(
            "m",
            "-",
            "exponent of the airspeed; theory 1",
            plausible=(0.0, 1.5),  # theory 1; a slipstream over the surfaces makes it less
            null=0.0,
            bounds=(-10.0, 10.0),
            typical=1.0,
        ),
    ),
    airframes=(Airframe.HELICOPTER,),
    stage=Stage.SCHEDULE,
    order=1,
    equations=None,  # made by adapt
    channels=("airspeed",),
    needs=("|".join(POWERS),),
    linear=False,
    adapt=adapt,
)
