"""A servo does not move for a small change of its command."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from sysid.data.airframe import Airframe
from sysid.data.record import FloatArray
from sysid.model.effect import Effect, Stage
from sysid.model.parameter import Parameter

BLOCK = 16
"""Samples that are passed over together where none of them moves the servo."""


def samples(commands: FloatArray, dt: float, parameters: Mapping[str, float]) -> FloatArray:
    """Commands (c, n) -> positions (c, n); the first command is taken."""
    width = parameters["width"]
    acting = np.empty_like(commands)
    for row, command in enumerate(commands):
        moved = np.array(_moved(command, width))
        acting[row] = np.repeat(command[moved], np.diff(moved, append=command.size))
    return acting


def _moved(command: FloatArray, width: float) -> list[int]:
    """Numbers of the samples (n,) that the servo moved to, the first among them."""
    begins = range(0, command.size, BLOCK)
    lowest, highest = (bound.reduceat(command, begins).tolist() for bound in (np.minimum, np.maximum))
    targets, held, moved = command.tolist(), command[0].item(), [0]
    for begin, low, high in zip(begins, lowest, highest, strict=True):
        if -width <= low - held and high - held <= width:
            continue
        for number, target in enumerate(targets[begin : begin + BLOCK], begin):
            if not -width <= target - held <= width:
                held = target
                moved.append(number)
    return moved


EFFECT = Effect(
    id="servo_deadband",
    title="dead band of the servos",
    group="actuators",
    equation="v holds while |delta - v| <= width, else goes to delta, on every command channel",
    source="digital servos ignore changes of their pulse below some microseconds",
    signature="small commands are answered in steps or not at all; the error's share falls as amplitude grows",
    parameters=(
        Parameter(
            "width",
            "-",
            "smallest change that moves a servo",
            plausible=(0.0, 0.05),  # 1 to 8 us of 500 us, and worn ones
            null=0.0,
            bounds=(0.0, 1.0),
            typical=0.01,
            grid=(0.002, 0.005, 0.01, 0.02, 0.05),
        ),
    ),
    airframes=(Airframe.HELICOPTER,),
    stage=Stage.COMMAND,
    order=3,
    linear=False,
    samples=samples,
    rests_within="width",
)
