"""Play between servo and swashplate."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from sysid.effect import Effect, Stage
from sysid.parameter import Parameter
from sysid.record import FloatArray


def samples(commands: FloatArray, dt: float, parameters: Mapping[str, float]) -> FloatArray:
    """Commands (c, n) -> positions (c, n) that follow with play; begins in the middle of it."""
    half_width = parameters["half_width"]
    acting = np.empty_like(commands)
    for row, command in enumerate(commands.tolist()):
        position = command[0]
        positions = []
        for target in command:
            if target - half_width > position:
                position = target - half_width
            elif target + half_width < position:
                position = target + half_width
            positions.append(position)
        acting[row] = positions
    return acting


EFFECT = Effect(
    id="servo_backlash",
    title="play in the linkages",
    group="actuators",
    equation="v follows delta with play of half_width, on every command channel",
    source="gears, horns and ball links of small servos",
    signature="every reversal is answered late by the same amount of command: gain and phase fall as amplitude does",
    parameters=(
        Parameter(
            "half_width",
            "-",
            "half of the play",
            plausible=(0.0, 0.05),  # 0.5 to 2 degrees of 30
            null=0.0,
            bounds=(0.0, 1.0),
            typical=0.01,
            grid=(0.002, 0.005, 0.01, 0.02, 0.05),
        ),
    ),
    stage=Stage.COMMAND,
    order=5,
    linear=False,
    samples=samples,
)
