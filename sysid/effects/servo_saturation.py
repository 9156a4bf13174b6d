"""Commands end at a limit, on the ring that a swashplate allows.

A swashplate limits its tilt, whatever its direction: roll and pitch cyclic together are scaled back to the ring, every
other command of the base is cut by itself. With one axis at a time the ring and a limit on each axis are the same.
Where the tilt ends says nothing of collective or yaw, which have a travel of their own and hover far from its middle:
beside an effect that reads them they act as they are.
"""

from __future__ import annotations

from collections.abc import Mapping
from math import inf

import numpy as np

from sysid.data.record import FloatArray
from sysid.model.effect import Effect, Stage, Words
from sysid.model.parameter import Parameter


def samples(commands: FloatArray, dt: float, parameters: Mapping[str, float]) -> FloatArray:
    """Absolute commands (c, n), delta_x and delta_y first, as far as the base has them -> limited ones (c, n)."""
    limit = parameters["limit"]
    acting = np.clip(commands, -limit, limit)
    tilt = np.linalg.norm(commands[:2], axis=0)
    acting[:2] = commands[:2] * (limit / np.maximum(tilt, limit) if limit < inf else 1.0)
    return acting


EFFECT = Effect(
    id="servo_saturation",
    title="limit of the commands",
    group="actuators",
    equation="|delta| <= limit, on the absolute command, as the cyclic ring sqrt(delta_x^2 + delta_y^2); other "
    "commands of the base each by itself",
    source="the swashplate's travel, or a limit that the autopilot applies after logging",
    signature="the tops of large commands have no effect; trim to one side makes it one-sided",
    parameters=(
        Parameter(
            "limit",
            "-",
            "largest command that acts",
            plausible=(0.05, inf),  # less could not be flown
            null=inf,
            bounds=(0.005, inf),
            typical=0.2,
            grid=(0.05, 0.1, 0.15, 0.2, 0.3, 0.5),
        ),
    ),
    on_multirotor=Words(
        title="limit of the commands",
        source="what the motors can give, or a limit that the autopilot applies after logging",
    ),
    stage=Stage.COMMAND,
    order=1,
    linear=False,
    samples=samples,
    spares_others=True,
)
