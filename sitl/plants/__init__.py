"""The plants that the simulated vehicle can be: one name, one recipe; two of them can carry other parts."""

from __future__ import annotations

from dataclasses import replace
from typing import Protocol

from sitl.plants.conditions import CALM, Condition
from sitl.plants.forward import ForwardPlant
from sitl.plants.hover import BEYOND_TPP, LIGHT_GUSTS, NOTHING_MISSING, HoverPlant
from sitl.plants.rotorcraft import AIRFRAMES, Parts, Rotorcraft


class Plant(Protocol):
    """What flies. True values in SI; rates in body axes; commands in -1..1."""

    p: float
    q: float
    r: float
    phi: float
    theta: float
    a: float
    b: float
    omega: float
    airspeed: float
    ax: float
    ay: float
    az: float
    nominal_rpm: float
    has_pitot: bool
    """Whether the vehicle measures its airspeed; in hover a Pitot tube has nothing to measure."""

    def reset(self) -> None: ...

    def step(self, delta_x: float, delta_y: float, delta_e: float, delta_c: float, delta_r: float = 0.0) -> None: ...


PLANTS = ("hover", "hover-ideal", "forward")


def make_plant(
    name: str, seed: int, *, parts: Parts | None = None, condition: Condition = CALM, gust_scale: float = 1.0
) -> Plant:
    """The plant of that name with gusts drawn from the seed, `gust_scale` times as strong.

    Raises ValueError for an unknown name, and where that plant takes no parts or knows only the calm condition.
    """
    if name not in PLANTS:
        raise ValueError(f"unknown plant {name!r}; there are {', '.join(PLANTS)}")
    gusts = replace(LIGHT_GUSTS, roll=gust_scale * LIGHT_GUSTS.roll, pitch=gust_scale * LIGHT_GUSTS.pitch)
    if parts is not None or condition != CALM:
        if name not in AIRFRAMES:
            raise ValueError(f"{name} flies as it is; parts and conditions belong to {' and '.join(AIRFRAMES)}")
        return Rotorcraft(AIRFRAMES[name], parts, gusts, seed, condition)
    if name == "forward":
        return ForwardPlant(gusts, seed)
    return HoverPlant(BEYOND_TPP if name == "hover" else NOTHING_MISSING, gusts, seed)
