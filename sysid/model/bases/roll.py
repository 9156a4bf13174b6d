"""Roll alone: one rate and its own command, of first order, where nothing else was excited or measured."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from sysid.model.base import Base
from sysid.model.effect import Signals
from sysid.model.parameter import Parameter


def equations(s: Signals) -> Mapping[str, Any]:
    return {"p_dot": s.L_p * s.p + s.L_lat * s.delta_x}


BASE = Base(
    name="roll",
    title="Roll alone",
    states=("p",),
    outputs=("p",),
    commands=("delta_x",),
    parameters=(
        Parameter("L_p", "1/s", "roll damping"),
        Parameter("L_lat", "1/s^2", "roll acceleration per roll command"),
    ),
    equations=equations,
    uncoupled=(-5.0, 0.0),
    absorbs=("angular_damping",),
    watched=("L_p", "L_lat"),
)
