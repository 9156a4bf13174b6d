"""Exact flapping of a centrally hinged blade with a root spring, in multi-blade coordinates.

In the rotating frame a blade obeys beta'' + gamma Omega/8 beta' + nu^2 Omega^2 beta = gamma Omega^2/8 (feathering).
The disc's tilt (a, b) is relative to the shaft; its motion in space is w_a = a' + q, w_b = b' + p. Inertia and flap
damping act on the motion in space, spring and feathering on the tilt relative to the shaft:
    w_a' =  2 Omega w_b - gamma Omega/8 w_a - (nu^2 - 1) Omega_0^2 a + gamma Omega^2/8 (b - theta_c)
    w_b' = -2 Omega w_a - gamma Omega/8 w_b - (nu^2 - 1) Omega_0^2 b - gamma Omega^2/8 (a - theta_s)
Without w' and the small gamma/8 beside 2 this is the base with tau_f = 16/(gamma Omega) and
B_a = -A_b = 8 (nu^2 - 1)/gamma. The spring's moment does not change with rotor speed, hence Omega_0 there.
The sense of rotation is the one with A_b < 0 < B_a; a rotor that turns the other way is logged with omega < 0.
"""

from __future__ import annotations

from collections.abc import Mapping
from math import pi, sqrt
from typing import Any

from sysid.data.airframe import Airframe
from sysid.model.effect import Effect, Signals, Stage, magnitude
from sysid.model.parameter import Parameter

NOMINAL = 1650 * pi / 30
"""rad/s, the paper's rotor, where omega is not logged."""


def equations(s: Signals) -> Mapping[str, Any]:
    Omega_0 = s.Omega_0 if s.has("Omega_0") else NOMINAL
    Omega = s.Omega if s.has("Omega") else Omega_0
    speed = magnitude(Omega)
    damping = s.lock_number * speed / 8
    spring = (s.flap_frequency_ratio**2 - 1) * Omega_0**2
    return {
        "a_dot": s.a_rate - s.q,
        "b_dot": s.b_rate - s.p,
        "a_rate_dot": 2 * Omega * s.b_rate - damping * (s.a_rate - Omega * (s.b - s.theta_c)) - spring * s.a,
        "b_rate_dot": -2 * Omega * s.a_rate - damping * (s.b_rate + Omega * (s.a - s.theta_s)) - spring * s.b,
        "tau_f": 2 / damping,  # for effects that add to a_dot and b_dot
    }


def start(parent: Mapping[str, float], constants: Mapping[str, float]) -> Mapping[str, float]:
    """What the parent's first-order flapping implies."""
    if not {"tau_f", "A_b", "B_a"} <= parent.keys():
        return {}
    Omega = constants.get("Omega_0", NOMINAL)
    lock_number = 16 / (parent["tau_f"] * abs(Omega))
    coupling = (parent["B_a"] - parent["A_b"]) / 2 * (1 if Omega > 0 else -1)
    return {"lock_number": lock_number, "flap_frequency_ratio": sqrt(max(1 + coupling * lock_number / 8, 0.64))}


EFFECT = Effect(
    id="second_order_flapping",
    title="exact second-order flapping",
    group="rotor",
    equation="w_a' = 2 Omega w_b - gamma Omega/8 w_a - (nu^2 - 1) Omega_0^2 a + gamma Omega^2/8 (b - theta_c), "
    "w_b' = -2 Omega w_a - gamma Omega/8 w_b - (nu^2 - 1) Omega_0^2 b - gamma Omega^2/8 (a - theta_s), "
    "a_dot = w_a - q, b_dot = w_b - p; gamma Lock number, nu flap frequency ratio",
    source="Bramwell, Bramwell's Helicopter Dynamics: flapping with a root spring in multi-blade coordinates; "
    "Omega is the logged mean, else 1650 RPM",
    signature="the upper mode's frequency is some 3 % and its damping up to 9 % off, from 3 Hz on",
    parameters=(
        Parameter(
            "lock_number",
            "-",
            "aerodynamic over inertial flap moment; 16/(tau_f Omega)",
            plausible=(0.3, 15.0),  # heavy-tipped model blades to light full-size ones
            bounds=(0.02, 50.0),
            typical=1.0,
            grid=(0.5, 1.0, 2.0, 5.0),
        ),
        Parameter(
            "flap_frequency_ratio",
            "-",
            "flap frequency over rotor speed; 1 for a free central hinge",
            plausible=(1.0, 1.6),  # a stiff propeller blade on a rigid hub at most
            bounds=(0.8, 2.0),
            typical=1.086,
        ),
    ),
    airframes=(Airframe.HELICOPTER,),
    stage=Stage.DYNAMICS,
    order=-1,
    equations=equations,
    states=("a_rate", "b_rate"),
    needs=("flapping",),
    replaces=("tau_f", "A_b", "B_a"),
    slot="rotor",
    start=start,
)
