"""A servo brakes no harder than it can, so that it moves the slower the nearer it is.

It runs at the speed from which its limited acceleration can still stop it at the command, as position controllers do
that are to be fast without overshoot (the square-root law of time-optimal control). Behind a held command the root of
the distance falls at a constant rate, so that a sample's end and mean are exact.
"""

from __future__ import annotations

from collections.abc import Mapping
from math import copysign, inf, sqrt

from sysid.data.record import FloatArray
from sysid.model.compiled import Compiled
from sysid.model.effect import Effect, Stage, Words
from sysid.model.parameter import Parameter


def samples(commands: FloatArray, dt: float, parameters: Mapping[str, float]) -> FloatArray:
    """Commands (c, n) -> mean servo positions (c, n) over each sample of dt seconds. Starts without lag."""
    acceleration = parameters["acceleration"]
    if acceleration == inf:
        return commands
    return _approach(commands, sqrt(0.5 * acceleration) * dt)


@Compiled
def _approach(command: FloatArray, acting: FloatArray, slower: float) -> None:
    """`slower`: the root of the distance falls by it in a sample."""
    rest, before = 0.0, command[0]
    for k in range(len(command)):
        distance = rest + command[k] - before
        root = sqrt(abs(distance))
        left = max(root - slower, 0.0)
        rest = copysign(left * left, distance)
        acting[k] = command[k] - copysign((root**3 - left**3) / (3 * slower), distance)
        before = command[k]


EFFECT = Effect(
    id="servo_acceleration_limit",
    title="limited acceleration of the servos",
    group="actuators",
    equation="v' = sign(delta - v) sqrt(2 acceleration |delta - v|) on every command channel",
    source="servos and motor controllers that approach a set-point only as fast as they can brake; 60 degrees in 0.1 "
    "to 0.3 s",
    signature="late as behind a lag, by more of a large command than of a small one: by the root of its size",
    parameters=(
        Parameter(
            "acceleration",
            "1/s^2",
            "change of speed at most, full command 1",
            plausible=(10.0, inf),  # full command in 0.45 s
            null=inf,
            bounds=(0.1, inf),
            typical=200.0,
            grid=(10.0, 30.0, 100.0, 300.0, 1000.0),
        ),
    ),
    on_multirotor=Words(
        title="limited acceleration of the motors",
        source="motor controllers that change speed no faster than their torque allows",
    ),
    stage=Stage.COMMAND,
    order=4,
    linear=False,
    samples=samples,
)
