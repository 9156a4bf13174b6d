"""Play between servo and swashplate."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from sysid.data.airframe import Airframe
from sysid.data.record import FloatArray
from sysid.model.effect import Effect, Stage
from sysid.model.parameter import Parameter


def samples(commands: FloatArray, dt: float, parameters: Mapping[str, float]) -> FloatArray:
    """Commands (c, n) -> positions (c, n) that follow with play; begins in the middle of it.

    Every sample clips the position before it, and one clip after another is a clip again. So the clips of 2, 4, 8, ...
    samples come from those of half as many, all at once; the first sample holds whatever was before it.
    """
    low, high = commands - parameters["half_width"], commands + parameters["half_width"]
    low[:, 0] = high[:, 0] = commands[:, 0]
    reach = 1
    while reach < commands.shape[1]:
        lowest, highest = low[:, reach:], high[:, reach:]
        low[:, reach:], high[:, reach:] = (
            np.minimum(np.maximum(before, lowest), highest) for before in (low[:, :-reach], high[:, :-reach])
        )
        reach *= 2
    return low


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
    airframes=(Airframe.HELICOPTER,),
    stage=Stage.COMMAND,
    order=5,
    linear=False,
    samples=samples,
    rests_within="half_width",
)
