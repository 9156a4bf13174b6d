"""The swashplate leads or lags by an angle: roll and pitch cyclic are mixed before they reach the rotor.

Both bases have the four terms of the cyclic free, so they contain it: what a fit implies of the angle is a reading of
these terms, `sysid.fit.implied`. On a base whose cyclic is not free it is an effect.
"""

from __future__ import annotations

from collections.abc import Mapping
from math import pi
from typing import Any

import numpy as np

from sysid.data.airframe import Airframe
from sysid.model.effect import Effect, Signals, Stage
from sysid.model.parameter import Parameter


def equations(s: Signals) -> Mapping[str, Any]:
    cosine, sine = np.cos(s.psi), np.sin(s.psi)
    return {
        "delta_x": cosine * s.delta_x - sine * s.delta_y,
        "delta_y": sine * s.delta_x + cosine * s.delta_y,
    }


EFFECT = Effect(
    id="swashplate_phase",
    title="phase offset of the swashplate",
    group="actuators",
    equation="delta_x becomes delta_x cos(psi) - delta_y sin(psi), delta_y becomes delta_x sin(psi) + delta_y cos(psi)",
    source="linkage and pitch horns, set for a phase lag that is not the rotor's (ArduPilot's H_SW_PHANG)",
    signature="each axis answers the other's command, with opposite signs and at all frequencies alike",
    parameters=(
        Parameter(
            "psi",
            "rad",
            "angle by which the cyclic is turned before the rotor",
            plausible=(-0.53, 0.53),  # 30 degrees
            null=0.0,
            bounds=(-pi, pi),
            typical=0.15,
        ),
    ),
    airframes=(Airframe.HELICOPTER,),
    absorbed_by=("cd", "tpp"),
    stage=Stage.COMMAND,
    order=6,
    equations=equations,
)
