"""The elevator in forward flight."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from sysid.data.airframe import Airframe
from sysid.model.effect import Effect, Signals, Stage
from sysid.model.parameter import Parameter


def equations(s: Signals) -> Mapping[str, Any]:
    return {"q_dot": s.M_elev * s.delta_e}


EFFECT = Effect(
    id="elevator",
    title="elevator",
    group="forward",
    equation="q_dot += M_elev delta_e",
    source="the paper, eq. 16",
    signature="an elevator chirp moves the vehicle and not the model; in cyclic chirps pitch errs with delta_e",
    parameters=(
        Parameter(
            "M_elev",
            "1/s^2",
            "pitch acceleration per elevator",
            plausible=(-500.0, 500.0),  # the sign is the log's; the paper's vehicle has 38 at 18 m/s
            null=0.0,
            bounds=(-1e4, 1e4),
            typical=40.0,
        ),
    ),
    airframes=(Airframe.HELICOPTER,),
    stage=Stage.DYNAMICS,
    equations=equations,
    channels=("delta_e",),
)
