"""A servo brakes no harder than it can, so that it moves the slower the nearer it is.

It runs at the speed from which its limited acceleration can still stop it at the command, as position controllers do
that are to be fast without overshoot (the square-root law of time-optimal control). Behind a held command the root of
the distance falls at a constant rate, so that a sample's end and mean are exact.
"""

from __future__ import annotations

from collections.abc import Mapping
from math import inf

import numpy as np
from scipy.linalg.lapack import dtbtrs

from sysid.data.record import FloatArray
from sysid.model.effect import Effect, Stage, Words
from sysid.model.parameter import Parameter

STEPS = 100
"""Of Newton, at most; some eight are usual."""
SETTLED = 1e-7
"""Of full command, that a step changed; what is left is about the square of it."""


def samples(commands: FloatArray, dt: float, parameters: Mapping[str, float]) -> FloatArray:
    """Commands (c, n) -> mean servo positions (c, n) over each sample of dt seconds. Starts without lag."""
    acceleration = parameters["acceleration"]
    if acceleration == inf:
        return commands
    slower = np.sqrt(0.5 * acceleration)  # of the root of a distance, in a second
    found = commands.copy()
    for row, command in zip(found, commands, strict=True):
        before = _distances(np.diff(command, prepend=command[0]), slower * dt)
        root = np.sqrt(np.abs(before))
        left = np.maximum(root - slower * dt, 0.0)
        row -= np.sign(before) * (root**3 - left**3) / (3 * slower * dt)
    return found


def _distances(steps: FloatArray, slower: float) -> FloatArray:
    """From command to servo at the beginning of each sample (n,), behind commands that step so, (n,).

    What is left of one sample's distance and the next step make the next: solved for all samples at once, by Newton.
    """
    band = np.ones((2, steps.size))
    found = steps.copy()
    for _ in range(STEPS):
        root = np.sqrt(np.abs(found))
        left = np.maximum(root - slower, 0.0)
        slope = left / np.maximum(root, 1e-300)
        rest = np.sign(found) * left**2 - slope * found
        band[1] = -slope
        wanted = steps.copy()
        wanted[1:] += rest[:-1]
        moved, info = dtbtrs(band, wanted[:, None], uplo="L", diag="U")
        assert info == 0
        change = float(np.max(np.abs(moved[:, 0] - found)))
        found = moved[:, 0]
        if change < SETTLED:
            break
    return found


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
