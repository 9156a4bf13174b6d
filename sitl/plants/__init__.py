"""The plants that the simulated vehicle can be: one name, one recipe."""

from __future__ import annotations

from typing import Protocol

from sitl.plants.forward import ForwardPlant
from sitl.plants.hover import BEYOND_TPP, LIGHT_GUSTS, NOTHING_MISSING, HoverPlant


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

    def step(self, delta_x: float, delta_y: float, delta_e: float, delta_c: float) -> None: ...


PLANTS = ("hover", "hover-ideal", "forward")


def make_plant(name: str, seed: int) -> Plant:
    """The plant of that name with gusts drawn from the seed. Raises ValueError for an unknown name."""
    if name == "hover":
        return HoverPlant(BEYOND_TPP, LIGHT_GUSTS, seed)
    if name == "hover-ideal":
        return HoverPlant(NOTHING_MISSING, LIGHT_GUSTS, seed)
    if name == "forward":
        return ForwardPlant(LIGHT_GUSTS, seed)
    raise ValueError(f"unknown plant {name!r}; there are {', '.join(PLANTS)}")
