"""Blades that lead and lag: part of the hub's moment answers the disc's tilt through a lightly damped mode.

The mode is the regressive one, which a body sees near the difference of rotor speed and lag frequency; both axes share
it. Settled, the moment is what it was: `gain` is the share that goes through the mode.
Its peak lies below its dip; of inertia that swings along (`structural_mode`) the dip comes first.
"""

from __future__ import annotations

from collections.abc import Mapping
from math import pi
from typing import Any

from sysid.data.airframe import Airframe
from sysid.model.effect import Effect, Signals, Stage
from sysid.model.parameter import Parameter

SCANNED_HZ = (
    3.3, 3.6, 3.9, 4.2, 4.5, 4.9, 5.3, 5.7, 6.2, 6.6, 7.2, 7.8, 8.4, 9.0, 9.7, 10.5, 11.4, 12.3, 13.3, 14.3,
)  # fmt: skip
"""One apart by the width of a peak that is hardly damped: between two it would not show."""


def equations(s: Signals) -> Mapping[str, Any]:
    w = 2 * pi * s.frequency_lag
    changes: dict[str, Any] = {}
    for axis, tilt, stiffness, lag, moving in (
        ("p", s.b, s.L_b, s.lag_b, s.lag_b_rate),
        ("q", s.a, s.M_a, s.lag_a, s.lag_a_rate),
    ):
        name = "lag_b" if axis == "p" else "lag_a"
        changes[f"{name}_dot"] = moving
        changes[f"{name}_rate_dot"] = w**2 * (tilt - lag) - 2 * s.zeta_lag * w * moving
        changes[f"{axis}_dot"] = stiffness * s.gain * (lag - tilt)
    return changes


EFFECT = Effect(
    id="lead_lag",
    title="lead-lag mode of the blades",
    group="rotor",
    equation="y'' + 2 zeta_lag w y' + w^2 y = w^2 a, q_dot += M_a gain (y - a), w = 2 pi frequency_lag; the same with "
    "b, L_b, p_dot",
    source="Tischler and Remple 2012, chapter 15: regressive lead-lag, a dipole in the rates' responses",
    signature="a narrow peak and then a dip, at one frequency in both axes, that moves with the rotor speed",
    parameters=(
        Parameter(
            "frequency_lag",
            "Hz",
            "frequency of the regressive lag mode, seen from the body",
            plausible=(3.0, 15.0),  # rotor speed less lag frequency; beyond the band it shows no more
            bounds=(1.0, 40.0),
            typical=7.2,
            grid=SCANNED_HZ,
        ),
        Parameter(
            "zeta_lag",
            "-",
            "damping ratio of the lag mode",
            plausible=(0.01, 0.3),  # bolted grips to elastomeric dampers
            bounds=(1e-4, 1.0),  # without any, its answer has no end at its own frequency
            typical=0.08,
            grid=(0.03, 0.08),
        ),
        Parameter(
            "gain",
            "-",
            "share of the hub moment that goes through the mode",
            plausible=(0.0, 0.5),
            null=0.0,
            bounds=(0.0, 1.5),  # a share below zero is inertia that swings along: `structural_mode`
            typical=0.1,
        ),
    ),
    airframes=(Airframe.HELICOPTER,),
    stage=Stage.DYNAMICS,
    order=1,
    equations=equations,
    states=("lag_a", "lag_a_rate", "lag_b", "lag_b_rate"),
    needs=("flapping",),
    null_tolerance=1e-7,
)
