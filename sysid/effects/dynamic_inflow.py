"""The flow through the rotor answers late to its change of lift."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from sysid.data.airframe import Airframe
from sysid.model.effect import Effect, Signals, Stage
from sysid.model.parameter import Parameter


def equations(s: Signals) -> Mapping[str, Any]:
    return {
        "l_s_dot": (s.k_l * (s.theta_s - s.a) - s.l_s) / s.tau_l,
        "l_c_dot": (s.k_l * (s.theta_c - s.b) - s.l_c) / s.tau_l,
        "a_dot": -s.l_s / s.tau_f,
        "b_dot": -s.l_c / s.tau_f,
    }


EFFECT = Effect(
    id="dynamic_inflow",
    title="dynamic inflow, first harmonic",
    group="rotor",
    equation="tau_l l_s' = -l_s + k_l (theta_s - a), a_dot += -l_s/tau_f; the same with l_c, theta_c, b",
    source="Pitt and Peters 1981, first order",
    signature="flapping overshoots at first and then loses part of its damping and control, alike on both axes",
    parameters=(
        Parameter(
            "k_l",
            "-",
            "share of the flapping moment that settled inflow takes back",
            plausible=(0.0, 0.6),  # momentum theory: near 0.3 for a lightly loaded rotor in hover
            null=0.0,
            bounds=(-5.0, 0.95),  # at 1 no flap damping is left
            typical=0.3,
        ),
        Parameter(
            "tau_l",
            "s",
            "time constant of the inflow",
            plausible=(0.003, 0.05),  # apparent mass over mass flow: some 10 ms
            bounds=(0.0005, 1.0),
            typical=0.01,
            grid=(0.005, 0.01, 0.03, 0.1),
        ),
    ),
    airframes=(Airframe.HELICOPTER,),
    stage=Stage.DYNAMICS,
    equations=equations,
    states=("l_s", "l_c"),
    needs=("flapping",),
)
