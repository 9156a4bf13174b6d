"""A servo moves no faster than it can.

Each sample's command is held, so a servo that is behind moves in a ramp through it. The acting command is the mean of
that ramp over the sample, which a held command of the same size equals to first order.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import inf

import numpy as np

from sysid.data.record import FloatArray
from sysid.model.effect import Effect, Stage, Words
from sysid.model.parameter import Parameter


def samples(commands: FloatArray, dt: float, parameters: Mapping[str, float]) -> FloatArray:
    """Commands (c, n) -> mean servo positions (c, n) over each sample of dt seconds. Starts without lag."""
    step = parameters["rate"] * dt
    position = commands.copy()  # at the end of each sample
    too_fast = np.abs(np.diff(position, axis=1)) > step
    for row, some in zip(position, too_fast, strict=True):
        _follow(memoryview(row), (np.flatnonzero(some) + 1).tolist(), step)
    moved = np.diff(position, axis=1, prepend=position[:, :1])
    return np.asarray(position - 0.5 / step * moved * np.abs(moved))


def _follow(command: memoryview[float], left_behind: Sequence[int], step: float) -> None:
    """Put positions at the end of each sample in the commands' place; `left_behind`: samples that change by more."""
    caught_up = 0
    for first in left_behind:
        if first <= caught_up:
            continue
        at = command[first - 1]
        for caught_up in range(first, len(command)):
            gap = command[caught_up] - at
            if gap > step:
                at += step
            elif gap < -step:
                at -= step
            else:
                break
            command[caught_up] = at


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
