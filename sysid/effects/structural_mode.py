"""One flexible mode on each axis, shaken by the body's acceleration and pulling back on it.

p_dot and q_dot are the body's whole accelerations, the mode's own pull included. So the frequency is the one that a
clamped body would show; in free flight it is higher by sqrt(1 + kappa), and so is the damping ratio.
"""

from __future__ import annotations

from collections.abc import Mapping
from math import pi
from typing import Any

from sysid.model.effect import Effect, Signals, Stage
from sysid.model.parameter import Parameter

TYPICAL_KAPPA = 0.1
SCANNED_HZ = (3.6, 4.0, 4.5, 5.0, 5.6, 6.3, 7.1, 8.0, 9.0, 10.0, 11.2, 12.6, 14.2)
"""One apart by the width of a damped peak."""


def equations(s: Signals) -> Mapping[str, Any]:
    changes: dict[str, Any] = {}
    axes = (
        ("roll", s.p_dot, "p_dot", s.frequency_roll, s.zeta_roll, s.kappa_roll, s.e_roll, s.e_rate_roll),
        ("pitch", s.q_dot, "q_dot", s.frequency_pitch, s.zeta_pitch, s.kappa_pitch, s.e_pitch, s.e_rate_pitch),
    )
    for axis, shaken, rate, frequency, zeta, kappa, e, e_rate in axes:
        w = 2 * pi * frequency
        back = w**2 * e + 2 * zeta * w * e_rate
        pull = kappa * back
        changes |= {f"e_{axis}_dot": e_rate, f"e_rate_{axis}_dot": -back - (shaken + pull), rate: pull}
    return changes


def _parameters(axis: str) -> tuple[Parameter, ...]:
    return (
        Parameter(
            f"frequency_{axis}",
            "Hz",
            f"natural frequency of the mode in {axis}",
            plausible=(3.0, 60.0),  # wings and booms of small aircraft; above the band it only adds a little lag
            bounds=(0.3, 200.0),
            typical=8.0,
            grid=SCANNED_HZ,
        ),
        Parameter(
            f"zeta_{axis}",
            "-",
            f"damping ratio of the mode in {axis}",
            plausible=(0.002, 0.2),  # metal and carbon 0.5 to 3 %, foam and joints up to 10 %
            bounds=(1e-4, 3.0),  # without any, its answer has no end at its own frequency
            typical=0.06,  # broader than real ones, so that a search begun beside the peak finds it
            grid=(0.02, 0.06),
        ),
        Parameter(
            f"kappa_{axis}",
            "-",
            f"share of the inertia that swings in {axis}",
            plausible=(0.0, 0.7),  # a share of the whole body's inertia
            null=0.0,
            bounds=(-2.0, 5.0),
            typical=TYPICAL_KAPPA,
        ),
    )


def start(known: Mapping[str, float], _constants: Mapping[str, float]) -> Mapping[str, float]:
    """Below the mode the swinging share moves along: what the parent took for the body was the whole."""
    return {name: known[name] * (1 + TYPICAL_KAPPA) for name in ("L_b", "M_a") if name in known}


EFFECT = Effect(
    id="structural_mode",
    title="flexible mode on each axis",
    group="fuselage",
    equation="per axis e'' + 2 zeta w e' + w^2 e = -p_dot, p_dot += kappa (w^2 e + 2 zeta w e')",
    source="wing bending and torsion, tip masses; the axes do not share a frequency",
    signature="a narrow peak and dip side by side in one axis, at a frequency that no rigid mode has",
    parameters=(*_parameters("roll"), *_parameters("pitch")),
    stage=Stage.DYNAMICS,
    order=10,
    equations=equations,
    start=start,
    states=("e_roll", "e_rate_roll", "e_pitch", "e_rate_pitch"),
)
