"""Yaw carries the body's rates, and the disc's tilt as the body sees it, from one axis to the other.

The tilt terms have no parameter: at k_p = k_q = 0 they remain, so the base is unchanged there only where r is zero.
A disc that stands still in space, seen from a body that yaws nose right, turns the other way: the tilt (b, a) about
the body's x and y is a vector, and changes by minus r times it.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from sysid.model.effect import Effect, Signals, Stage
from sysid.model.parameter import Parameter


def equations(s: Signals) -> Mapping[str, Any]:
    turned = {"p_dot": s.k_p * s.q * s.r, "q_dot": s.k_q * s.p * s.r}
    if s.has("b"):  # CD has no disc
        turned |= {"a_dot": -s.r * s.b, "b_dot": s.r * s.a}
    return turned


EFFECT = Effect(
    id="yaw_coupling",
    title="coupling by yaw",
    group="fuselage",
    equation="p_dot += k_p q r, q_dot += k_q p r; a_dot -= r b, b_dot += r a",
    source="Euler's equations in turning axes",
    signature="the error comes in bursts while the vehicle yaws, in step with the other axis' rate",
    parameters=(
        Parameter(
            "k_p",
            "-",
            "(I_yy - I_zz)/I_xx",
            plausible=(-1.0, 1.0),  # any rigid body; a planar one -1
            null=0.0,
            bounds=(-50.0, 50.0),
            typical=-1.0,
        ),
        Parameter(
            "k_q",
            "-",
            "(I_zz - I_xx)/I_yy",
            plausible=(-1.0, 1.0),  # any rigid body; a planar one +1
            null=0.0,
            bounds=(-50.0, 50.0),
            typical=1.0,
        ),
    ),
    stage=Stage.DYNAMICS,
    equations=equations,
    channels=("r",),
    linear=False,
    acts_at_null=True,  # the tilt terms
)
