"""A first-order lag of its own behind each cyclic command.

Roll and pitch are moved by servos of two makes or loads, or by linkages of two lengths. With both constants alike this
is `servo_lag`, on a multirotor `motor_lag`, and is that by name then; behind play it is `gyro_lag`.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from sysid.model.effect import Effect, Signals, Stage, Words
from sysid.model.parameter import Parameter

AT_ONCE = 1e-8
"""s, of an axis without any: one may lag where the other does not, and nothing divides by zero."""


def equations(s: Signals) -> Mapping[str, Any]:
    return {
        "lag_x_dot": (s.delta_x - s.lag_x) / (s.tau_x + AT_ONCE),
        "lag_y_dot": (s.delta_y - s.lag_y) / (s.tau_y + AT_ONCE),
        "delta_x": s.lag_x,
        "delta_y": s.lag_y,
    }


def _time(name: str, axis: str) -> Parameter:
    return Parameter(
        name,
        "s",
        f"time constant of what moves {axis}",
        plausible=(0.0, 0.15),  # as of servos, and of a multirotor's motors
        null=0.0,
        bounds=(0.0, 1.0),
        typical=0.03,
    )


EFFECT = Effect(
    id="lag_per_axis",
    title="first-order lag, of its own on each axis",
    group="actuators",
    equation="tau_x v_x' = delta_x - v_x, tau_y v_y' = delta_y - v_y",
    source="servos of two makes or loads; frames that are stiffer one way",
    signature="phase falls and gain with it from a few hertz on, on one axis sooner than on the other",
    parameters=(_time("tau_x", "roll"), _time("tau_y", "pitch")),
    on_multirotor=Words(
        title="first-order lag, of its own on each axis", source="motors and propellers that work against one axis more"
    ),
    stage=Stage.COMMAND,
    order=4,
    equations=equations,
    states=("lag_x", "lag_y"),
    contains=("servo_lag", "motor_lag", "gyro_lag"),
    null_tolerance=1e-6,
)
