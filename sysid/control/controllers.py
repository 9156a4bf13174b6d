"""Controllers that a loop is judged with, whatever they are made of: each answers the same questions of a model."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from sysid.control.loop import AxisAnswer, following
from sysid.control.regulator import Gains
from sysid.control.robustness import Robustness, robustness
from sysid.control.sampled import RateController
from sysid.control.stability import ClosedLoop, Edges, closed_loop, edges, from_rates, unstable_poles
from sysid.data.preprocess import ComplexArray
from sysid.model.structure import FloatArray, Model


class Controller(Protocol):
    """Of both cyclic commands, from both rates."""

    def held(self, model: Model) -> ClosedLoop:
        """Whether the loop with this model is stable, and its margins."""
        ...

    def answers(self, model: Model) -> tuple[AxisAnswer, AxisAnswer]:
        """Of roll and pitch to what is asked of their rate; of a loop that is held."""
        ...

    def robustness(self, model: Model) -> Robustness:
        """Of a loop that is held."""
        ...

    def edges(self, model: Model) -> Edges:
        """Where margins are decided; of a loop that is held."""
        ...

    def unstable_poles(self, model: Model) -> int:
        """Of the open loop."""
        ...

    def from_rates(self, frequency_hz: FloatArray) -> ComplexArray:
        """C(j w), u = -C y, of the model's rates, (f, 2, 2)."""
        ...


@dataclass(frozen=True, eq=False)
class PaperController:
    """LQR, observer and prefilter, in continuous time; it answers doublets of the rate command."""

    gains: Gains

    def held(self, model: Model) -> ClosedLoop:
        return closed_loop(self.gains, model)

    def answers(self, model: Model) -> tuple[AxisAnswer, AxisAnswer]:
        found = following(self.gains, model)
        return found.roll.worth, found.pitch.worth

    def robustness(self, model: Model) -> Robustness:
        return robustness(self.gains, model)

    def edges(self, model: Model) -> Edges:
        return edges(self.gains, model)

    def unstable_poles(self, model: Model) -> int:
        return unstable_poles(self.gains, model)

    def from_rates(self, frequency_hz: FloatArray) -> ComplexArray:
        return from_rates(self.gains, 2j * np.pi * frequency_hz)


AnyGains = Gains | RateController


def controller_of(gains: AnyGains) -> Controller:
    """The paper's gains, or rate loops, as a controller."""
    return PaperController(gains) if isinstance(gains, Gains) else gains
