"""Cylinder Dynamics (the paper's eq. 8-9): rates alone, the rotor as a cylinder that spins.

Of first order: its coefficients are its parameters.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from sysid.data.preprocess import ComplexArray
from sysid.data.record import FloatArray
from sysid.model.base import Base
from sysid.model.effect import Signals
from sysid.model.form import Entries, Form
from sysid.model.parameter import Parameter


def equations(s: Signals) -> Mapping[str, Any]:
    return {
        "p_dot": s.L_p * s.p + s.L_q * s.q + s.L_lat * s.delta_x + s.L_lon * s.delta_y,
        "q_dot": s.M_p * s.p + s.M_q * s.q + s.M_lat * s.delta_x + s.M_lon * s.delta_y,
    }


def denominator(s: ComplexArray, c: FloatArray) -> Entries:
    return s - c[0], -c[1] + 0 * s, -c[2] + 0 * s, s - c[3]


BASE = Base(
    name="cd",
    title="Cylinder Dynamics",
    rank=1,
    states=("p", "q"),
    parameters=(
        Parameter("L_p", "1/s", "roll damping"),
        Parameter("L_q", "1/s", "roll acceleration per pitch rate"),
        Parameter("M_p", "1/s", "pitch acceleration per roll rate"),
        Parameter("M_q", "1/s", "pitch damping"),
        Parameter("L_lat", "1/s^2", "roll acceleration per roll cyclic"),
        Parameter("L_lon", "1/s^2", "roll acceleration per pitch cyclic"),
        Parameter("M_lat", "1/s^2", "pitch acceleration per roll cyclic"),
        Parameter("M_lon", "1/s^2", "pitch acceleration per pitch cyclic"),
    ),
    equations=equations,
    uncoupled=(-5.0, 0, 0, -5.0, 0, 0, 0, 0),
    alone=(("roll",), ("pitch",), ("yaw",), ("heave",)),
    watched=("L_p", "M_q", "L_lat", "M_lon"),
    form=Form(
        order=1,
        coefficients=8,
        places=tuple(((equation, row, 1),) for rows in ((0, 1), (2, 3)) for equation in (0, 1) for row in rows),
        denominator=denominator,
        to_parameters=lambda c: c,
        of_parameters=lambda values: values,
        second=lambda c: c[:4].reshape(2, 2),
    ),
)
