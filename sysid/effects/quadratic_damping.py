"""Drag of the turning body, with the square of its rates."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from sysid.model.effect import Effect, Signals, Stage, magnitude
from sysid.model.parameter import Parameter


def equations(s: Signals) -> Mapping[str, Any]:
    return {"p_dot": s.L_pp * s.p * magnitude(s.p), "q_dot": s.M_qq * s.q * magnitude(s.q)}


EFFECT = Effect(
    id="quadratic_damping",
    title="drag of the turning body",
    group="fuselage",
    equation="p_dot += L_pp p|p|, q_dot += M_qq q|q|",
    source="drag of a flat plate turning about its edge",
    signature="damping grows with amplitude: a large chirp decays faster than the model, a small one slower",
    parameters=(
        Parameter(
            "L_pp",
            "-",
            "roll acceleration per square of the roll rate",
            plausible=(-10.0, 0.0),  # wings of 1.5 m on 0.6 kg m^2 give some -0.1, plates across the flow more
            null=0.0,
            bounds=(-500.0, 500.0),
            typical=-1.0,
        ),
        Parameter(
            "M_qq",
            "-",
            "pitch acceleration per square of the pitch rate",
            plausible=(-10.0, 0.0),
            null=0.0,
            bounds=(-500.0, 500.0),
            typical=-1.0,
        ),
    ),
    stage=Stage.DYNAMICS,
    equations=equations,
    linear=False,
)
