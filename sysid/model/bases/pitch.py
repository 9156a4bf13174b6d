"""Pitch alone: one rate and its own command, of first order, where nothing else was excited or measured."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from sysid.model.base import Base
from sysid.model.effect import Signals
from sysid.model.parameter import Parameter


def equations(s: Signals) -> Mapping[str, Any]:
    return {"q_dot": s.M_q * s.q + s.M_lon * s.delta_y}


BASE = Base(
    name="pitch",
    title="Pitch alone",
    states=("q",),
    outputs=("q",),
    commands=("delta_y",),
    parameters=(
        Parameter("M_q", "1/s", "pitch damping"),
        Parameter("M_lon", "1/s^2", "pitch acceleration per pitch command"),
    ),
    equations=equations,
    uncoupled=(-5.0, 0.0),
    absorbs=("angular_damping",),
    watched=("M_q", "M_lon"),
)
