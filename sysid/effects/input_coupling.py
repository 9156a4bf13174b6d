"""Moments of commands other than the two cyclic ones, one pair of parameters for each that is logged."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import cache
from typing import Any

from sysid.model.effect import Effect, Signals, Stage, Surroundings, Words
from sysid.model.parameter import Parameter

OTHERS = {
    "delta_c": "collective",
    "delta_r": "yaw command",
    "delta_a": "aileron",
    "delta_e": "elevator",
}


def adapt(around: Surroundings) -> Effect:
    """Every logged command; delta_e is left to `elevator` where that is composed."""
    channels = [name for name in OTHERS if name in around.available]
    if "elevator" in around.effects and len(channels) > 1:
        channels = [name for name in channels if name != "delta_e"]
    return _of(tuple(channels)) if channels else EFFECT


@cache
def _of(channels: tuple[str, ...]) -> Effect:
    def equations(s: Signals) -> Mapping[str, Any]:
        return {
            "p_dot": sum(getattr(s, f"L_{name}") * getattr(s, name) for name in channels),
            "q_dot": sum(getattr(s, f"M_{name}") * getattr(s, name) for name in channels),
        }

    parameters = tuple(one for name in channels for one in _parameters(name))
    return replace(EFFECT, parameters=parameters, channels=channels, equations=equations)


def _parameters(channel: str) -> tuple[Parameter, ...]:
    return tuple(
        Parameter(
            f"{letter}_{channel}",
            "1/s^2",
            f"{axis} acceleration per {OTHERS[channel]}",
            plausible=(-200.0, 200.0),  # of the size of the cyclic's own, at most
            null=0.0,
            bounds=(-1e4, 1e4),
            typical=10.0,
        )
        for letter, axis in (("L", "roll"), ("M", "pitch"))
    )


EFFECT = Effect(
    id="input_coupling",
    title="moments of the other commands",
    group="fuselage",
    equation="p_dot += L_c u_c, q_dot += M_c u_c for any logged command or its filtered thrust; here for every "
    "logged command u_c of delta_c, delta_r, delta_a, delta_e, parameters L_<channel>, M_<channel>",
    source="collective, tip propellers, elevons in the slipstream, in hover too",
    signature="the error is coherent with a command that the model does not read",
    parameters=tuple(one for name in OTHERS for one in _parameters(name)),
    on_multirotor=Words(
        title="moments of the other commands",
        source="throttle and yaw, which the motors share with roll and pitch",
    ),
    stage=Stage.DYNAMICS,
    equations=None,  # made by adapt
    channels=("|".join(OTHERS),),
    adapt=adapt,
)
