"""A filter on the gyro: the logged rates are late."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from sysid.model.effect import Effect, Signals, Stage
from sysid.model.parameter import Parameter


def equations(s: Signals) -> Mapping[str, Any]:
    return {
        "y_p_dot": (s.p_m - s.y_p) / s.tau_g,
        "y_q_dot": (s.q_m - s.y_q) / s.tau_g,
        "p_m": s.y_p,
        "q_m": s.y_q,
    }


EFFECT = Effect(
    id="gyro_lag",
    title="first-order lag of the gyros",
    group="sensors",
    equation="tau_g y' = p - y on both rates",
    source="anti-vibration filter of the sensor or of the autopilot, logged behind it",
    signature="phase falls and gain with it, alike on both axes and for every input, from a few hertz on",
    parameters=(
        Parameter(
            "tau_g",
            "s",
            "time constant of the gyro filter",
            plausible=(0.0, 0.03),  # 5 Hz is the lowest filter that can be flown behind
            null=0.0,
            bounds=(0.0, 1.0),
            typical=0.008,
        ),
    ),
    same_as=("servo_lag", "motor_lag"),
    stage=Stage.MEASUREMENT,
    order=1,
    equations=equations,
    states=("y_p", "y_q"),
    null_tolerance=1e-8,
)
