"""A sensor turned about the body's z axis."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from sysid.model.effect import Effect, Signals, Stage
from sysid.model.parameter import Parameter


def equations(s: Signals) -> Mapping[str, Any]:
    return {"p_m": s.p_m + s.e * s.q_m, "q_m": s.q_m - s.e * s.p_m}


EFFECT = Effect(
    id="gyro_misalignment",
    title="gyro turned in its mounting",
    group="sensors",
    equation="p_m = p + e q, q_m = q - e p",
    source="mounting",
    signature="each rate errs in proportion to the other at every frequency, with opposite signs",
    parameters=(
        Parameter(
            "e",
            "rad",
            "angle of the mounting about z",
            plausible=(-0.25, 0.25),  # 14 degrees are seen by eye
            null=0.0,
            bounds=(-1.0, 1.0),
            typical=0.1,
        ),
    ),
    stage=Stage.MEASUREMENT,
    equations=equations,
    absorbed_by=("cd",),
)
