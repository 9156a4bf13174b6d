"""A servo moves no faster than it can.

Each sample's command is held, so a servo that is behind moves in a ramp through it. The acting command is the mean of
that ramp over the sample, which a held command of the same size equals to first order.
"""

from __future__ import annotations

from collections.abc import Mapping
from math import inf

import numpy as np

from sysid.effect import Effect, Stage
from sysid.parameter import Parameter
from sysid.record import FloatArray


def samples(commands: FloatArray, dt: float, parameters: Mapping[str, float]) -> FloatArray:
    """Commands (c, n) -> mean servo positions (c, n) over each sample of dt seconds. Starts without lag."""
    rate = parameters["rate"]
    step = rate * dt
    acting = np.empty_like(commands)
    for row, command in enumerate(commands.tolist()):
        position = command[0]
        means = []
        for target in command:
            gap = target - position
            if gap > step:
                means.append(position + 0.5 * step)
                position += step
            elif gap < -step:
                means.append(position - 0.5 * step)
                position -= step
            else:
                means.append(target - 0.5 * gap * abs(gap) / step if gap else target)
                position = target
        acting[row] = means
    return acting


EFFECT = Effect(
    id="servo_rate_limit",
    title="rate limit of the servos",
    group="actuators",
    equation="|v'| <= rate on every command channel",
    source="a servo's data sheet: 60 degrees in 0.05 to 0.2 s",
    signature="the answer to fast and large commands becomes a smaller, later triangle; small ones are followed",
    parameters=(
        Parameter(
            "rate",
            "1/s",
            "fastest change of a command, full command 1",
            plausible=(0.5, inf),  # full command in 2 s cannot be flown
            null=inf,
            bounds=(0.02, inf),
            typical=3.0,
            grid=(1.0, 2.0, 4.0, 8.0, 16.0),
        ),
    ),
    stage=Stage.COMMAND,
    order=4,
    linear=False,
    samples=samples,
)
