"""Servos that have inertia: a second-order lag in every one."""

from __future__ import annotations

from collections.abc import Mapping
from math import inf, pi
from typing import Any

from sysid.model.effect import Effect, Signals, Stage, Words
from sysid.model.parameter import Parameter


def equations(s: Signals) -> Mapping[str, Any]:
    w = 2 * pi * s.frequency
    return {"v_dot": s.v_rate, "v_rate_dot": w**2 * (s.delta - s.v) - 2 * s.zeta * w * s.v_rate, "delta": s.v}


EFFECT = Effect(
    id="servo_second_order",
    title="second-order lag of the servos",
    group="actuators",
    equation="v'' + 2 zeta w v' + w^2 v = w^2 delta on every command channel, w = 2 pi frequency",
    source="a position loop round a motor; small servos reach 5 to 15 Hz",
    signature="phase falls as with a delay at first, then gain with it, alike on both axes",
    parameters=(
        Parameter(
            "frequency",
            "Hz",
            "natural frequency of the servos",
            plausible=(3.0, inf),  # slower ones cannot fly; a fast one is no servo lag at all
            null=inf,
            bounds=(0.3, 1e4),
            typical=8.0,
            grid=(5.0, 10.0, 20.0),
        ),
        Parameter(
            "zeta",
            "-",
            "damping ratio of the servos",
            plausible=(0.3, 1.0),  # below, it rings
            bounds=(0.05, 1.0),  # beyond, it would be two lags: `servo_lag` and less
            typical=0.7,
            grid=(0.7,),
        ),
    ),
    on_multirotor=Words(
        title="second-order lag of the motors",
        source="a speed loop round a motor",
    ),
    same_as=("gyro_filter",),
    made_of=(("transport_delay", "dynamic_inflow"),),
    stage=Stage.COMMAND,
    order=4,
    equations=equations,
    states=("v", "v_rate"),
    per_command=True,
    null_tolerance=1e-6,
)
