"""The disc tilts with the incidence of the flow: a propeller's 1P moment."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import cache
from typing import Any

from sysid.data.airframe import Airframe
from sysid.model.effect import Effect, Signals, Stage, Surroundings
from sysid.model.parameter import Parameter


def equations(s: Signals) -> Mapping[str, Any]:
    return {"a_dot": s.A_alpha * s.alpha / s.tau_f, "b_dot": s.B_alpha * s.alpha / s.tau_f}


def adapt(around: Surroundings) -> Effect:
    return _logged() if "alpha" in around.available else EFFECT


@cache
def _logged() -> Effect:
    return replace(EFFECT, channels=("alpha",), needs=("flapping",))


EFFECT = Effect(
    id="disc_incidence",
    title="flapping by angle of attack",
    group="rotor",
    equation="a_dot += A_alpha alpha/tau_f, b_dot += B_alpha alpha/tau_f; alpha logged, else angle_of_attack's",
    source="the propeller's 1P moment in forward flight: a blade going up meets less flow than one going down",
    signature="in forward flight both rates err slowly after every pitch change, where alpha follows the pitch rate",
    parameters=(
        Parameter(
            "A_alpha",
            "-",
            "longitudinal flapping per angle of attack",
            plausible=(-1.0, 1.0),  # of the order of twice the advance ratio times blade angle and inflow
            null=0.0,
            bounds=(-20.0, 20.0),
            typical=0.3,
        ),
        Parameter(
            "B_alpha",
            "-",
            "lateral flapping per angle of attack",
            plausible=(-1.0, 1.0),
            null=0.0,
            bounds=(-20.0, 20.0),
            typical=0.3,
        ),
    ),
    airframes=(Airframe.HELICOPTER,),
    stage=Stage.DYNAMICS,
    equations=equations,
    needs=("flapping", "angle_of_attack"),
    adapt=adapt,
)
