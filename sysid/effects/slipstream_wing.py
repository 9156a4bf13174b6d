"""A wing in the rotor's wake: the wake keeps its direction in space while it runs down, and the wing follows late.

The wake's tilt against the body, w, is that of the disc when it left: w = (a + theta)/(1 + tau_w s) - theta.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from sysid.data.airframe import Airframe
from sysid.model.effect import Effect, Signals, Stage
from sysid.model.parameter import Parameter


def equations(s: Signals) -> Mapping[str, Any]:
    return {
        "wake_a_dot": (s.a - s.wake_a) / s.tau_w - s.q,
        "wake_b_dot": (s.b - s.wake_b) / s.tau_w - s.p,
        "p_dot": s.L_w * s.wake_b,
        "q_dot": s.M_w * s.wake_a,
    }


def _moment(name: str, axis: str, tilt: str) -> Parameter:
    return Parameter(
        name,
        "1/s^2",
        f"{axis} acceleration per {tilt} tilt of the wake",
        plausible=(-500.0, 500.0),  # at most of the hub moment's own size
        null=0.0,
        bounds=(-1500.0, 1500.0),
        typical=60.0,
    )


EFFECT = Effect(
    id="slipstream_wing",
    title="wing in the rotor's wake",
    group="fuselage",
    equation="tau_w w' = a - tau_w q - w, q_dot += M_w w; the same with b, p, L_w",
    source="a wake that keeps its direction in space; tail-sitters whose rotor blows over the wing",
    signature="one axis, mostly pitch, answers again what the disc did some tenths of a second before",
    parameters=(
        _moment("L_w", "roll", "lateral"),
        _moment("M_w", "pitch", "longitudinal"),
        Parameter(
            "tau_w",
            "s",
            "time that the wake takes to the wing",
            plausible=(0.02, 0.3),  # half a rotor radius to two, over the induced velocity
            bounds=(0.01, 1.0),
            typical=0.1,
            grid=(0.05, 0.1, 0.25),
        ),
    ),
    airframes=(Airframe.HELICOPTER,),
    stage=Stage.DYNAMICS,
    equations=equations,
    states=("wake_a", "wake_b"),
    needs=("flapping",),
)
