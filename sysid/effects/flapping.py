"""First-order flapping of the rotor: what turns Cylinder Dynamics into the Tip-Path-Plane model.

Its equations are the base `tpp` itself; `sysid.model.compose` takes that base in place of `cd`.
"""

from __future__ import annotations

from sysid.data.airframe import Airframe
from sysid.model.bases import cd, tpp
from sysid.model.effect import Effect, Stage

EFFECT = Effect(
    id="flapping",
    title="first-order flapping, CD becomes TPP",
    group="rotor",
    equation="p_dot = L_b b, q_dot = M_a a, a_dot = -q + (-a + A_b b + theta_s)/tau_f, b_dot = -p + (-b + B_a a + "
    "theta_c)/tau_f; theta_s = A_lat delta_x + A_lon delta_y, theta_c = B_lat delta_x + B_lon delta_y",
    source="the paper, eq. 5-7; Mettler 2003, section 2.3",
    signature="CD follows the slow mode only: above 2 Hz the error is a second resonance near 5 Hz, mostly in pitch",
    parameters=tpp.BASE.parameters,
    airframes=(Airframe.HELICOPTER,),
    stage=Stage.DYNAMICS,
    absorbed_by=("tpp",),
    replaces=tuple(parameter.name for parameter in cd.BASE.parameters),
    slot="rotor",
)
