"""A first-order lag in every motor of a multirotor."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from sysid.data.airframe import Airframe
from sysid.model.effect import Effect, Signals, Stage
from sysid.model.parameter import Parameter


def equations(s: Signals) -> Mapping[str, Any]:
    return {"v_dot": (s.delta - s.v) / s.tau_m, "delta": s.v}


EFFECT = Effect(
    id="motor_lag",
    title="first-order lag of the motors",
    group="actuators",
    equation="tau_m v' = delta - v on every command channel, one tau_m",
    source="brushless motors with their propellers answer a small step in 10 to 150 ms",
    signature="phase falls and gain with it, alike on both axes, from a few hertz on",
    parameters=(
        Parameter(
            "tau_m",
            "s",
            "time constant of the motors with their propellers",
            plausible=(0.0, 0.15),  # 20 ms of racing quadrotors, 70 of a nano one, 100 and more of large propellers
            null=0.0,
            bounds=(0.0, 1.0),
            typical=0.05,
        ),
    ),
    airframes=(Airframe.MULTIROTOR,),  # a helicopter's servos have `servo_lag`
    same_as=("gyro_lag",),
    stage=Stage.COMMAND,
    order=4,
    equations=equations,
    states=("v",),
    per_command=True,
    null_tolerance=1e-8,
)
