"""A first-order lag in every servo."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from sysid.data.airframe import Airframe
from sysid.model.effect import Effect, Signals, Stage
from sysid.model.parameter import Parameter


def equations(s: Signals) -> Mapping[str, Any]:
    return {"v_dot": (s.delta - s.v) / s.tau_s, "delta": s.v}


EFFECT = Effect(
    id="servo_lag",
    title="first-order lag of the servos",
    group="actuators",
    equation="tau_s v' = delta - v on every command channel, one tau_s",
    source="hobby servos answer a small step in 20 to 50 ms",
    signature="phase falls and gain with it, alike on both axes, from a few hertz on",
    parameters=(
        Parameter(
            "tau_s",
            "s",
            "time constant of the servos",
            plausible=(0.0, 0.08),
            null=0.0,
            bounds=(0.0, 1.0),
            typical=0.03,
        ),
    ),
    airframes=(Airframe.HELICOPTER,),  # a multirotor's motors have `motor_lag`
    same_as=("gyro_lag",),
    stage=Stage.COMMAND,
    order=4,
    equations=equations,
    states=("v",),
    per_command=True,
    null_tolerance=1e-8,
)
