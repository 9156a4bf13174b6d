"""The vehicle with a hidden effect: what can be hidden, and how one is drawn.

    hidden = draw(seed, "hover-ideal")               # anything, or nothing; flown in the lively condition
    hidden = plant_one("servo_lag", seed, "forward") # one that is named, its size drawn; its own condition
    vehicle = make_vehicle(hidden.plant, seed, hidden=hidden)         # sitl.autopilot.vehicle
    names("hover-ideal")                             # all that can be named there

Three kinds, a file each: `catalogue` is built as the catalogue writes it, `below` from its cause (more than a third of
all random draws), `beyond` is what no entry explains. Whoever adds one writes a recipe there and, where no part carries
it yet, the part: `sitl.plants.actuators`, `sitl.plants.rotors`, `sitl.plants.fuselages`, `sitl.plants.sensors`.

`draw` flies everything, nothing included, in the `lively` condition: otherwise a moving rotor speed would tell.
"""

from __future__ import annotations

import difflib
import random
from dataclasses import replace

from sitl.hidden import below, beyond, catalogue
from sitl.hidden.recipe import BOTH, FORWARD, HOVER, Hidden, Made, Recipe
from sitl.plants.rotorcraft import Parts

__all__ = ["FORWARD", "HOVER", "NONE_SHARE", "PLANTS", "Hidden", "draw", "names", "plant_one"]

PLANTS = BOTH
"""That can carry something."""
NONE_SHARE = 0.15
"""Of the random draws: nothing is hidden."""
_KINDS = ((0.38, catalogue.RECIPES), (0.42, below.RECIPES), (0.20, beyond.RECIPES))
"""Shares of the rest."""

_NONE = Recipe(id="none", answer=None, make=lambda size: Made({}, Parts, "nothing is hidden"), level="none")
_ALL = {one.id: one for _, recipes in _KINDS for one in recipes} | {"none": _NONE}


def names(plant: str) -> tuple[str, ...]:
    """What `plant_one` takes there; `none` is the last."""
    return tuple(name for name, one in _ALL.items() if plant in one.plants)


def plant_one(name: str, seed: int, plant: str = HOVER, *, scale: float = 1.0) -> Hidden:
    """The named draw, its sizes from the seed; `scale` makes it that much stronger than its range.

    Raises ValueError for an unknown name, and for a plant that cannot carry it, with a sentence for the user.
    """
    _refuse(plant)
    recipe = _ALL.get(name)
    if recipe is None:
        near = difflib.get_close_matches(name, _ALL, 3, 0.5)
        meant = f"did you mean {' or '.join(near)}?" if near else f"there are {', '.join(names(plant))}"
        raise ValueError(f"{name} cannot be hidden; {meant}")
    return recipe.draw(plant, random.Random(f"hidden {name} {plant} {seed}"), scale)


def draw(seed: int, plant: str = HOVER) -> Hidden:
    """Anything that plant can carry, or nothing. Raises ValueError as `plant_one`."""
    _refuse(plant)
    source = random.Random(f"hidden {plant} {seed}")
    name = "none"
    if source.random() >= NONE_SHARE:
        (recipes,) = source.choices([recipes for _, recipes in _KINDS], [share for share, _ in _KINDS])
        name = source.choice([one.id for one in recipes if plant in one.plants])
    return replace(plant_one(name, seed, plant), condition="lively")


def _refuse(plant: str) -> None:
    if plant not in PLANTS:
        raise ValueError(f"nothing can be hidden in {plant}, but in {' and '.join(PLANTS)}")
