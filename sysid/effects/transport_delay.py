"""A pure delay between the logged command and the swashplate."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from sysid.model.effect import Effect, Stage, Words
from sysid.model.parameter import Parameter


def response(s: Any, parameters: Mapping[str, Any]) -> Any:
    """exp(-s T_d), of the shape of s."""
    return np.exp(-s * parameters["T_d"])


EFFECT = Effect(
    id="transport_delay",
    title="delay of the commands",
    group="actuators",
    equation="v(t) = delta(t - T_d) on every command channel",
    source="frames of the servo bus and of the control loop",
    signature="phase falls in proportion to frequency and gain stays, alike on both axes",
    parameters=(
        Parameter(
            "T_d",
            "s",
            "delay of the commands",
            plausible=(0.0, 0.06),  # three frames of 20 ms at worst
            null=0.0,
            bounds=(0.0, 0.5),
            typical=0.02,
            grid=(0.005, 0.02, 0.05, 0.1),
        ),
    ),
    on_multirotor=Words(
        title="delay of the commands",
        source="frames of the link to the motor controllers and of the control loop",
    ),
    stage=Stage.COMMAND,
    order=2,
    response=response,
)
