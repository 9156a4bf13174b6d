"""A stabiliser bar over the rotor: a gyroscope that lags behind the body and moves the cyclic.

Mettler's c' = -c/tau_b - q + C delta_y/tau_b, of which A_lon (delta_y + K c) reaches the rotor, is this with k_b = K
and d_b = K C.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from sysid.data.airframe import Airframe
from sysid.model.effect import Effect, Signals, Stage
from sysid.model.parameter import Parameter


def equations(s: Signals) -> Mapping[str, Any]:
    return {
        "c_bar_dot": (s.d_b * s.delta_y - s.c_bar) / s.tau_b - s.k_b * s.q,
        "d_bar_dot": (s.d_b * s.delta_x - s.d_bar) / s.tau_b - s.k_b * s.p,
        "delta_x": s.delta_x + s.d_bar,
        "delta_y": s.delta_y + s.c_bar,
    }


EFFECT = Effect(
    id="stabiliser_bar",
    title="stabiliser bar",
    group="rotor",
    equation="tau_b c' = -c - tau_b k_b q + d_b delta_y, delta_y becomes delta_y + c; the same for roll",
    source="Mettler 2003, chapter 4: Bell and Hiller bars, flybars of model helicopters",
    signature="rates are damped from some tenths of a hertz on, and slow commands reach further than quick ones",
    parameters=(
        Parameter(
            "k_b",
            "-",
            "cyclic per angle that the bar lags behind the body",
            plausible=(0.0, 1.0),
            null=0.0,
            bounds=(-3.0, 3.0),
            typical=0.3,
        ),
        Parameter(
            "d_b",
            "-",
            "cyclic that the bar adds, settled, to a cyclic of one",
            plausible=(-0.5, 2.0),  # paddles that are steered themselves add as much as the blades' own
            null=0.0,
            bounds=(-0.9, 3.0),  # beyond, the blades would hardly be steered but by the bar: a lag of the servos
            typical=0.2,
        ),
        Parameter(
            "tau_b",
            "s",
            "time constant of the bar",
            plausible=(0.1, 1.0),  # 16/(Lock number of the paddles, rotor speed)
            bounds=(0.05, 20.0),
            typical=0.3,
            grid=(0.15, 0.3, 0.8),
        ),
    ),
    airframes=(Airframe.HELICOPTER,),
    stage=Stage.COMMAND,
    order=7,
    equations=equations,
    states=("c_bar", "d_bar"),
)
