"""The rotor's parameters follow its speed as it wanders."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from sysid.data.airframe import Airframe
from sysid.model.effect import Effect, Signals, Stage
from sysid.model.parameter import Parameter


def equations(s: Signals) -> Mapping[str, Any]:
    ratio = s.omega / s.Omega_0
    moment = ratio**s.n
    changed = {"L_b": s.L_b * moment, "M_a": s.M_a * moment, "Omega": s.Omega_0 * ratio**s.k}
    if s.has("tau_f"):  # second-order flapping has none of its own: it reads Omega
        coupling = ratio ** (-2 * s.k)
        changed |= {"tau_f": s.tau_f * ratio ** (-s.k), "A_b": s.A_b * coupling, "B_a": s.B_a * coupling}
    return changed


EFFECT = Effect(
    id="rotor_speed",
    title="parameters change with rotor speed",
    group="rotor",
    equation="tau_f times (Omega/Omega_0)^-k, A_b and B_a times (Omega/Omega_0)^-2k, L_b and M_a times "
    "(Omega/Omega_0)^n; Omega_0 = mean over the fitted runs, stored",
    source="the paper, section 4.3; Mettler 2003, section 2.3",
    signature="the error comes and goes with the rotor speed: damping and coupling fit at its mean and nowhere else",
    parameters=(
        Parameter(
            "k",
            "-",
            "exponent of the flapping; theory 1",
            plausible=(0.0, 1.5),  # theory 1; inflow and blade stiffness leave somewhat less or more
            null=0.0,
            bounds=(-10.0, 10.0),
            typical=1.0,
        ),
        Parameter(
            "n",
            "-",
            "exponent of the hub moment; 0 for a spring, 2 for an offset hinge",
            plausible=(0.0, 2.0),
            null=0.0,
            bounds=(-10.0, 10.0),
            typical=1.0,
        ),
    ),
    airframes=(Airframe.HELICOPTER,),
    stage=Stage.SCHEDULE,
    equations=equations,
    channels=("omega",),
    needs=("flapping",),
    linear=False,
)
