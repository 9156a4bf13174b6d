"""A rotor speed that nobody logged: collective pulls it down, the governor brings it back, and the rotor follows it.

Where the rotor speed is logged it is measured, and `rotor_speed` reads it.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from sysid.data.airframe import Airframe
from sysid.effects.second_order_flapping import NOMINAL
from sysid.model.effect import Effect, Signals, Stage
from sysid.model.parameter import Parameter

USUAL_TIME_S = 0.5


def equations(s: Signals) -> Mapping[str, Any]:
    """tau_f as Omega^-1, A_b and B_a as Omega^-2: the paper's section 4.3."""
    ratio = 1 - s.k_g * s.loaded
    changed = {"loaded_dot": (s.delta_c - s.loaded) / s.tau_o}
    if s.has("tau_f"):
        changed |= {"tau_f": s.tau_f / ratio, "A_b": s.A_b / ratio**2, "B_a": s.B_a / ratio**2}
    else:  # second-order flapping has none of its own: it reads Omega
        changed["Omega"] = (s.Omega_0 if s.has("Omega_0") else NOMINAL) * ratio
    return changed


def start(_known: Mapping[str, float], _constants: Mapping[str, float]) -> Mapping[str, float]:
    """One valley: every look at another beginning would cost as much as the search from this one."""
    return {"tau_o": USUAL_TIME_S}


EFFECT = Effect(
    id="governor",
    title="rotor speed under a governor",
    group="rotor",
    equation="tau_o o' = delta_c - o; Omega = Omega_0 (1 - k_g o), tau_f as Omega^-1, A_b and B_a as Omega^-2",
    source="drivetrain: a motor or engine that collective slows down before its governor answers",
    signature="damping and coupling come and go some tenths of a second behind the collective",
    parameters=(
        Parameter(
            "k_g",
            "-",
            "share of the rotor speed that full collective takes away",
            plausible=(0.0, 0.8),  # a good governor holds 5 %, none at all loses half
            null=0.0,
            bounds=(-5.0, 5.0),
            typical=0.3,
        ),
        Parameter(
            "tau_o",
            "s",
            "time constant of the drivetrain behind its governor",
            plausible=(0.05, 3.0),
            bounds=(0.005, 30.0),
            typical=USUAL_TIME_S,
            grid=(USUAL_TIME_S,),
        ),
    ),
    airframes=(Airframe.HELICOPTER,),
    stage=Stage.SCHEDULE,
    equations=equations,
    start=start,
    states=("loaded",),
    channels=("delta_c",),
    unless_logged=("omega",),
    needs=("flapping",),
    linear=False,
)
