"""The pilot's hands beside the cyclic: collective and yaw, as first-order wanders at 100 Hz."""

from __future__ import annotations

import math
import random

from sitl.plants.conditions import Condition
from sitl.plants.rotorcraft import HOVER_COLLECTIVE

_YAW_POLE = 0.97  # at 100 Hz: corner near 0.5 Hz


class PilotHands:
    """How much they move is the condition's; what they do, the seed's."""

    def __init__(self, condition: Condition, seed: int) -> None:
        self.collective = 0.0
        self.yaw = 0.0
        """delta_r, to the tip propellers."""
        self._condition = condition
        self._random = random.Random(f"pilot {seed}")
        self._yaw_random = random.Random(f"{seed} yaw")

    def hover(self) -> None:
        """Take the collective of a hover."""
        self.collective = HOVER_COLLECTIVE

    def move(self) -> None:
        """10 ms have passed in the air."""
        condition = self._condition
        pole = condition.collective_pole
        wander = self.collective - HOVER_COLLECTIVE
        drive = condition.collective * math.sqrt(1 - pole**2)
        self.collective = HOVER_COLLECTIVE + pole * wander + self._random.gauss(0.0, drive)
        if condition.yaw > 0:
            drive = condition.yaw * math.sqrt(1 - _YAW_POLE**2)
            yaw = _YAW_POLE * self.yaw + self._yaw_random.gauss(0.0, drive)
            self.yaw = max(-1.0, min(1.0, yaw))
