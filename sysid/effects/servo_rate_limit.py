"""A servo moves no faster than it can.

Each sample's command is held, so a servo that is behind moves in a ramp through it. The acting command is the mean of
that ramp over the sample, which a held command of the same size equals to first order.
"""

from __future__ import annotations

from collections.abc import Mapping
from math import inf

from sysid.data.record import FloatArray
from sysid.model.compiled import Compiled
from sysid.model.effect import Effect, Stage, Words
from sysid.model.parameter import Parameter


def samples(commands: FloatArray, dt: float, parameters: Mapping[str, float]) -> FloatArray:
    """Commands (c, n) -> mean servo positions (c, n) over each sample of dt seconds. Starts without lag."""
    return _follow(commands, parameters["rate"] * dt)


@Compiled
def _follow(command: FloatArray, acting: FloatArray, step: float) -> None:
    at = command[0]
    for k in range(len(command)):
        before = at
        at = min(max(command[k], before - step), before + step)
        acting[k] = at - 0.5 / step * (at - before) * abs(at - before)


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
    on_multirotor=Words(
        title="rate limit of the motors",
        source="a motor controller's limit of acceleration, or a slew limit that the autopilot applies after logging",
    ),
    stage=Stage.COMMAND,
    order=4,
    linear=False,
    samples=samples,
)
