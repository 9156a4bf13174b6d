"""Play between servo and swashplate."""

from __future__ import annotations

from collections.abc import Mapping

from sysid.data.airframe import Airframe
from sysid.data.record import FloatArray
from sysid.model.compiled import Compiled
from sysid.model.effect import Effect, Stage
from sysid.model.parameter import Parameter


def samples(commands: FloatArray, dt: float, parameters: Mapping[str, float]) -> FloatArray:
    """Commands (c, n) -> positions (c, n) that follow with play; begins in the middle of it."""
    return _push(commands, parameters["half_width"])


@Compiled
def _push(command: FloatArray, acting: FloatArray, half_width: float) -> None:
    at = command[0]
    for k in range(len(command)):
        at = min(max(at, command[k] - half_width), command[k] + half_width)
        acting[k] = at


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
