"""Tip-Path Plane (the paper's eq. 5-7): rates, and the tilt a, b of the rotor disc.

Symbols are Table 4's, free of Omega: tau_f = tau_fn/Omega, A_b = A_bn/Omega^2, B_a = B_an/Omega^2. Forward flight
(eq. 15-16) is this base with `angular_damping` and `elevator`.

Eliminating the flapping leaves two second-order equations; their nine coefficients map one to one to the parameters:
  p'' = -L_b p - p'/tau_f + c_p q' + L_b/tau_f (B_lat delta_x + B_lon delta_y),   c_p = B_a L_b/(M_a tau_f)
  q'' = -M_a q - q'/tau_f + c_q p' + M_a/tau_f (A_lat delta_x + A_lon delta_y),   c_q = A_b M_a/(L_b tau_f)
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from sysid.data.airframe import Airframe
from sysid.data.preprocess import ComplexArray
from sysid.data.record import FloatArray
from sysid.model.base import Base
from sysid.model.effect import Signals
from sysid.model.form import P_DOT, Q_DOT, AnyArray, Entries, Form, P, Q
from sysid.model.parameter import Parameter


def equations(s: Signals) -> Mapping[str, Any]:
    theta_s = s.A_lat * s.delta_x + s.A_lon * s.delta_y
    theta_c = s.B_lat * s.delta_x + s.B_lon * s.delta_y
    return {"theta_s": theta_s, "theta_c": theta_c, "p_dot": s.L_b * s.b, "q_dot": s.M_a * s.a}


def rotor(s: Signals) -> Mapping[str, Any]:
    return {
        "a_dot": -s.q + (-s.a + s.A_b * s.b + s.theta_s) / s.tau_f,
        "b_dot": -s.p + (-s.b + s.B_a * s.a + s.theta_c) / s.tau_f,
    }


def denominator(s: ComplexArray, c: FloatArray) -> Entries:
    common = s * s + c[2] * s
    return common + c[0], -c[3] * s, -c[4] * s, common + c[1]


def to_parameters(c: FloatArray) -> FloatArray:
    L_b, M_a, rate, c_p, c_q, p_x, p_y, q_x, q_y = c
    roll, pitch = 1 / (rate * L_b), 1 / (rate * M_a)
    return np.array(
        [
            L_b,
            M_a,
            1 / rate,
            c_q * L_b * pitch,
            c_p * M_a * roll,
            q_x * pitch,
            q_y * pitch,
            p_x * roll,
            p_y * roll,
        ]
    )


def of_parameters(values: AnyArray) -> AnyArray:
    L_b, M_a, tau_f, A_b, B_a, A_lat, A_lon, B_lat, B_lon = np.moveaxis(values, -1, 0)
    roll, pitch = L_b / tau_f, M_a / tau_f
    return np.stack(
        [
            L_b,
            M_a,
            1 / tau_f,
            B_a * roll / M_a,
            A_b * pitch / L_b,
            roll * B_lat,
            roll * B_lon,
            pitch * A_lat,
            pitch * A_lon,
        ],
        axis=-1,
    )


BASE = Base(
    name="tpp",
    title="Tip-Path Plane",
    rank=2,
    contains=("flapping",),
    airframes=(Airframe.HELICOPTER,),
    reduces_to="cd",
    states=("p", "q", "a", "b"),
    parameters=(
        Parameter("L_b", "1/s^2", "roll acceleration per lateral flapping", (10.0, 1e4), typical=150.0),
        Parameter("M_a", "1/s^2", "pitch acceleration per longitudinal flapping", (10.0, 1e4), typical=700.0),
        Parameter("tau_f", "s", "time constant of the tip-path plane", (0.005, 0.5), typical=0.09),
        Parameter("A_b", "-", "longitudinal flapping from lateral", (-5.0, 5.0), typical=-1.3),
        Parameter("B_a", "-", "lateral flapping from longitudinal", (-5.0, 5.0), typical=1.4),
        Parameter("A_lat", "rad", "longitudinal flapping per roll cyclic", (-5.0, 5.0), typical=-0.3),
        Parameter("A_lon", "rad", "longitudinal flapping per pitch cyclic", (0.0, 5.0), typical=0.3),
        Parameter("B_lat", "rad", "lateral flapping per roll cyclic", (0.0, 5.0), typical=0.5),
        Parameter("B_lon", "rad", "lateral flapping per pitch cyclic", (-5.0, 5.0), typical=-0.05),
    ),
    equations=equations,
    slots=(("rotor", rotor),),
    uncoupled=(150.0, 150.0, 0.1, 0, 0, 0, 0.1, 0.1, 0),
    watched=("L_b", "M_a", "tau_f"),
    form=Form(
        order=2,
        coefficients=9,
        places=(
            ((0, P, -1),),
            ((1, Q, -1),),
            ((0, P_DOT, -1), (1, Q_DOT, -1)),
            ((0, Q_DOT, 1),),
            ((1, P_DOT, 1),),
            *(((equation, row, 1),) for equation in (0, 1) for row in (4, 5)),
        ),
        denominator=denominator,
        to_parameters=to_parameters,
        of_parameters=of_parameters,
        second=lambda c: np.array([[-c[2], c[3]], [c[4], -c[2]]]),
    ),
)
