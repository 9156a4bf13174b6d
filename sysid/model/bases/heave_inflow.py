"""Heave with the rotor's inflow: thrust overshoots, until the flow through the disc has followed it.

A stepped collective meets the old inflow first and lifts fully; within `tau_i` the flow speeds up and takes back a
part, and half of the damping. Momentum theory in hover, air of the apparent mass m_a of Carpenter and Fridovich (NACA
TN 3044, 1953) being sped up, with n the change of the inflow v_0: m_a n' = dT - 4 rho A v_0 n + 2 rho A v_0 w, so that
with m = -Z_w n

    tau_i m' = -m - k_i az - Z_w w/2,   tau_T az' = -az + Z_w w + Z_col delta_c + m,
    tau_i = m_a/(4 rho A v_0) = 0.21 R/v_0,   k_i = -Z_w v_0/(2 g).
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from sysid.model.base import Base
from sysid.model.bases import heave
from sysid.model.effect import Signals
from sysid.model.parameter import Parameter


def equations(s: Signals) -> Mapping[str, Any]:
    steady = heave.equations(s)
    inflow = (-s.m - s.k_i * s.az - s.Z_w * s.w / 2) / s.tau_i
    return {**steady, "az_dot": steady["az_dot"] + s.m / s.tau_T, "m_dot": inflow}


BASE = Base(
    name="heave_inflow",
    title="Heave with Inflow",
    states=("w", "az", "m"),
    outputs=("az",),
    commands=("delta_c",),
    parameters=(
        *heave.BASE.parameters,
        Parameter(
            "k_i",
            "-",
            "thrust that settled inflow takes back, over what is left",
            plausible=(0.0, 1.5),  # aσ/(16 λ_0): 0.3 for small rotors at high thrust to 1 for light discs
            bounds=(-0.9, 10.0),  # at -1 the thrust runs away
            typical=0.5,
        ),
        Parameter(
            "tau_i",
            "s",
            "time constant of the inflow",
            plausible=(0.002, 0.3),  # 0.21 R/v_0: a small propeller, a full-sized rotor
            bounds=(5e-4, 3.0),
            typical=0.05,
            grid=(0.006, 0.02, 0.06, 0.2),
        ),
    ),
    equations=equations,
    uncoupled=(-1.0, 0.0, 0.03, 0.5, 0.1),  # a light helicopter's: far from it the search may end in another valley
    absorbs=heave.BASE.absorbs,
    watched=(*heave.BASE.watched, "k_i", "tau_i"),
)
