"""Drag of the turning body, with the square of its rates or another power of them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from sysid.model.effect import Effect, Signals, Stage
from sysid.model.parameter import Parameter

SQUARE = 2.0


STILL = 1e-300
"""Square of a rate that is none beside any: powers of zero have no derivative to their exponent."""


def equations(s: Signals) -> Mapping[str, Any]:
    half = 0.5 * (s.exponent - 1)
    return {
        "p_dot": s.L_pp * s.p * (s.p * s.p + STILL) ** half,
        "q_dot": s.M_qq * s.q * (s.q * s.q + STILL) ** half,
    }


EFFECT = Effect(
    id="quadratic_damping",
    title="drag of the turning body",
    group="fuselage",
    equation="p_dot += L_pp p|p|^(exponent-1), q_dot += M_qq q|q|^(exponent-1)",
    source="drag of a flat plate turning about its edge",
    signature="damping grows with amplitude: a large chirp decays faster than the model, a small one slower",
    parameters=(
        Parameter(
            "L_pp",
            "-",
            "roll acceleration per power of the roll rate",
            plausible=(-10.0, 0.0),  # wings of 1.5 m on 0.6 kg m^2 give some -0.1, plates across the flow more
            null=0.0,
            bounds=(-500.0, 500.0),
            typical=-1.0,
        ),
        Parameter(
            "M_qq",
            "-",
            "pitch acceleration per power of the pitch rate",
            plausible=(-10.0, 0.0),
            null=0.0,
            bounds=(-500.0, 500.0),
            typical=-1.0,
        ),
        Parameter(
            "exponent",
            "-",
            "power of the rates that the drag grows with",
            plausible=(1.0, 3.0),  # in slow air 1, of plates and blades 2; dampers and stalling blades up to 3
            null=SQUARE,  # drag as it is usually written; alone it moves nothing
            bounds=(1.0, 5.0),
            typical=SQUARE,
        ),
    ),
    stage=Stage.DYNAMICS,
    equations=equations,
    linear=False,
)
