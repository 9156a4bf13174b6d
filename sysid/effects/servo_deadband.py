"""A servo does not move for a small change of its command."""

from __future__ import annotations

from collections.abc import Mapping

from sysid.data.airframe import Airframe
from sysid.data.record import FloatArray
from sysid.model.compiled import Compiled
from sysid.model.effect import Effect, Stage
from sysid.model.parameter import Parameter


def samples(commands: FloatArray, dt: float, parameters: Mapping[str, float]) -> FloatArray:
    """Commands (c, n) -> positions (c, n); the first command is taken."""
    return _hold(commands, parameters["width"])


@Compiled
def _hold(command: FloatArray, acting: FloatArray, width: float) -> None:
    held = command[0]
    for k in range(len(command)):
        if not -width <= command[k] - held <= width:
            held = command[k]
        acting[k] = held


EFFECT = Effect(
    id="servo_deadband",
    title="dead band of the servos",
    group="actuators",
    equation="v holds while |delta - v| <= width, else goes to delta, on every command channel",
    source="digital servos ignore changes of their pulse below some microseconds",
    signature="small commands are answered in steps or not at all; the error's share falls as amplitude grows",
    parameters=(
        Parameter(
            "width",
            "-",
            "smallest change that moves a servo",
            plausible=(0.0, 0.05),  # 1 to 8 us of 500 us, and worn ones
            null=0.0,
            bounds=(0.0, 1.0),
            typical=0.01,
            grid=(0.002, 0.005, 0.01, 0.02, 0.05),
        ),
    ),
    airframes=(Airframe.HELICOPTER,),
    stage=Stage.COMMAND,
    order=3,
    linear=False,
    samples=samples,
    rests_within="width",
)
