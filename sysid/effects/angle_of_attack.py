"""The short period: pitching builds up an angle of attack, and the wing turns the vehicle back."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import cache
from typing import Any

from sysid.data.airframe import Airframe
from sysid.model.effect import Effect, Signals, Stage, Surroundings
from sysid.model.parameter import Parameter


def equations(s: Signals) -> Mapping[str, Any]:
    return {"alpha_dot": s.q - s.Z_a * s.alpha, **_moment(s)}


def _moment(s: Signals) -> Mapping[str, Any]:
    return {"q_dot": s.M_alpha * s.alpha}


def adapt(around: Surroundings) -> Effect:
    """Where alpha is logged it is read: it needs no state, and Z_a has no part in the rates."""
    return _logged() if "alpha" in around.available else EFFECT


@cache
def _logged() -> Effect:
    parameters = tuple(one for one in EFFECT.parameters if one.name == "M_alpha")
    return replace(EFFECT, parameters=parameters, equations=_moment, states=(), channels=("alpha",))


EFFECT = Effect(
    id="angle_of_attack",
    title="angle of attack",
    group="forward",
    equation="alpha_dot = q - Z_a alpha, q_dot += M_alpha alpha; alpha is a state where it is not logged",
    source="short-period approximation; Etkin, Dynamics of Flight",
    signature="in forward flight pitch errs between 0.2 and 2 Hz, in step with the filtered integral of q",
    parameters=(
        Parameter(
            "Z_a",
            "1/s",
            "lift against the motion, per mass and speed",
            plausible=(0.3, 10.0),  # air density times speed times wing area per mass: 1 to 5
            bounds=(0.0, 100.0),
            typical=3.0,
            grid=(1.0, 3.0, 8.0),
        ),
        Parameter(
            "M_alpha",
            "1/s^2",
            "pitch acceleration per angle of attack",
            plausible=(-300.0, 30.0),  # stable within 3 Hz; a little unstable can be flown
            null=0.0,
            bounds=(-5000.0, 5000.0),
            typical=-20.0,
        ),
    ),
    airframes=(Airframe.HELICOPTER,),
    stage=Stage.DYNAMICS,
    equations=equations,
    states=("alpha",),
    adapt=adapt,
)
