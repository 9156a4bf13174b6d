"""What a hidden effect is: one recipe draws sizes from a physical range and says which parts carry it.

Truth is written twice on purpose: nothing here is shared with the catalogue that has to find it. Parameter names are
the catalogue's where a recipe builds what the catalogue says, and the recipe's own where it builds the cause of it.
"""

from __future__ import annotations

import math
import random
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

from sitl.plants.actuators import Each, Element
from sitl.plants.rotorcraft import AIRFRAMES, Airframe, Parts

HOVER, FORWARD = "hover-ideal", "forward"
BOTH = (HOVER, FORWARD)

CATALOGUE, BELOW, BEYOND = "catalogue", "below", "beyond"

I_X, I_Y, I_Z = 0.641, 0.133, 0.70
"""kg m^2: what Table 4 and the paper's blade spring of 88 N m/rad imply; a winged body is nearly flat, so I_z is a
little less than the sum."""


@dataclass(frozen=True, kw_only=True)
class Hidden:
    """One effect at one size, for one plant. Made by `sitl.hidden.draw` and `plant_one`."""

    id: str
    """The draw's own name; `none` where nothing is hidden."""
    plant: str
    """`hover-ideal` or `forward`."""
    answer: str | None
    """The catalogue's id that a perfect diagnosis names; None where the catalogue has none, or nothing is hidden."""
    accepts: tuple[str, ...]
    """Other ids that are physically the same thing on these data."""
    sizes: Mapping[str, float]
    """Name -> value, SI."""
    expect: Mapping[str, float]
    """Catalogue's parameter of `answer` -> what it should come near, where known."""
    level: str
    """`catalogue`: built as the catalogue writes it; `below`: built from its cause; `beyond`: not in the catalogue;
    `none`."""
    condition: str
    """Of `sitl.plants.conditions`, in which it shows."""
    sentence: str
    """For whoever opens the seal."""
    build: Callable[[], Parts] = field(compare=False, repr=False)
    """Fresh parts for one vehicle."""

    def to_json(self) -> dict[str, Any]:
        """All of it but the parts."""
        return {
            "plant": self.plant,
            "hidden": self.id,
            "answer": self.answer,
            "accepts": list(self.accepts),
            "sizes": dict(self.sizes),
            "expect": dict(self.expect),
            "level": self.level,
            "condition": self.condition,
            "sentence": self.sentence,
        }


class Sizes:
    """Draws sizes; the same seed draws the same. `scale` makes the effect stronger or weaker than its range."""

    def __init__(self, plant: str, source: random.Random, scale: float) -> None:
        self.plant = plant
        self.airframe: Airframe = AIRFRAMES[plant]
        self._random = source
        self._scale = scale

    def _evenly(self, low: float, high: float) -> float:
        """On a logarithmic scale; both bounds of one sign."""
        size = math.exp(self._random.uniform(math.log(abs(low)), math.log(abs(high))))
        return math.copysign(size, low)

    def between(self, low: float, high: float) -> float:
        """More is a stronger effect: times the scale."""
        return self._evenly(low, high) * self._scale

    def at_most(self, low: float, high: float) -> float:
        """Less is a stronger effect, as of a limit or a servo's frequency: over the scale."""
        return self._evenly(low, high) / self._scale

    def fixed(self, low: float, high: float) -> float:
        """It says where or how, not how much: whatever the scale."""
        return self._evenly(low, high)

    def spread(self, value: float, share: float) -> float:
        """A part from the same box: within that share of the value."""
        return value * (1 + share * self._random.uniform(-1.0, 1.0))

    def sign(self) -> float:
        return self._random.choice((-1.0, 1.0))


@dataclass(frozen=True)
class Made:
    """What a recipe's function returns."""

    sizes: Mapping[str, float]
    build: Callable[[], Parts]
    sentence: str
    expect: Mapping[str, float] | None = None
    """None: the sizes themselves. Empty where nothing is known."""


@dataclass(frozen=True, kw_only=True)
class Recipe:
    """One kind of hidden effect."""

    id: str
    answer: str | None
    make: Callable[[Sizes], Made]
    plants: tuple[str, ...] = BOTH
    accepts: tuple[str, ...] = ()
    level: str = CATALOGUE
    condition: str = "calm"

    def draw(self, plant: str, source: random.Random, scale: float = 1.0) -> Hidden:
        """Raises ValueError where it makes no sense on that plant."""
        if plant not in self.plants:
            raise ValueError(f"{self.id} makes no sense on {plant}: it belongs to {' and '.join(self.plants)}")
        made = self.make(Sizes(plant, source, scale))
        return Hidden(
            id=self.id,
            plant=plant,
            answer=self.answer,
            accepts=self.accepts,
            sizes=made.sizes,
            expect=self._expected(made),
            level=self.level,
            condition=self.condition,
            sentence=made.sentence,
            build=made.build,
        )

    def _expected(self, made: Made) -> Mapping[str, float]:
        if self.answer is None:
            return {}
        return made.sizes if made.expect is None else made.expect


def on_each(make: Callable[[], Element], *, moves: bool = False) -> Callable[[], Parts]:
    """The same element on every command."""
    return lambda: Parts(actuators=(Each(make, moves=moves),))
