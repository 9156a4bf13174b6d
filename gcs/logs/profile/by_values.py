"""The scale of a column whose name tells none, by its values: what its unit must be for a vehicle to have flown so.

A guess, and told as one: the smallest change of unit that makes the values possible.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

LIKELY_HZ = (40.0, 5000.0)  # what vehicles log their rates at
TIMES = (("seconds", 1.0), ("milliseconds", 1e-3), ("microseconds", 1e-6), ("nanoseconds", 1e-9))
USUAL_RAD_S, LARGE_RAD_S = 1.0, 12.0
"""Median and largest size of a rate about its median in flight: one in rad/s does not pass both."""
MOST_RAD_S = 35.0
"""2000 deg/s, what gyros measure at most."""
PWM_US = (800.0, 2200.0)
FULL = (100.0, 500.0, 1000.0, 32767.0, 65535.0)
"""What full command is written as: percent, pulse widths about their middle and sums of PID loops, 16 bits."""
BY_VALUES = "by its values"


@dataclass(frozen=True)
class Guess:
    """A column times `scale`, plus `offset`, is the channel."""

    scale: float
    why: str
    offset: float = 0.0


def time_guess(values: FloatArray) -> Guess | None:
    """Of a column of times, shape (n,); None where they fit no unit."""
    spacing = np.diff(values[np.isfinite(values)])
    spacing = spacing[spacing > 0]
    if not spacing.size:
        return None
    step = float(np.median(spacing))
    for name, scale in TIMES:
        if LIKELY_HZ[0] <= 1 / (step * scale) <= LIKELY_HZ[1]:
            return Guess(scale, f"{name}: it goes on by {step:g}, which is {1 / (step * scale):.4g} Hz")
    return None


def rate_guess(values: FloatArray) -> Guess | None:
    """Of a body rate; None where there are no values."""
    found = values[np.isfinite(values)]
    if not found.size:
        return None
    size = np.abs(found - np.median(found))
    largest = float(np.max(size))
    passes = float(np.median(size)) > USUAL_RAD_S and largest > LARGE_RAD_S
    if not passes and largest <= MOST_RAD_S:
        return Guess(1.0, f"in rad/s {BY_VALUES}, up to {largest:.3g}?")
    if largest <= math.degrees(MOST_RAD_S):
        return Guess(math.pi / 180, f"deg/s to rad/s {BY_VALUES}, up to {largest:.3g}?")
    return Guess(1.0, f"values up to {largest:.3g} are no deg/s: give the scale of the gyro's counts")


def command_guess(values: FloatArray) -> Guess | None:
    """Of a command; None where there are no values."""
    found = values[np.isfinite(values)]
    if not found.size:
        return None
    low, high = float(np.min(found)), float(np.max(found))
    between = f"{low:.4g} to {high:.4g}"
    if low >= PWM_US[0] and high <= PWM_US[1]:
        return Guess(1 / 500, f"values of {between}: pulse widths, 1000 to 2000 us?", -3.0)
    largest = max(abs(low), abs(high))
    if largest <= 1.05:
        return Guess(1.0, f"values of {between}")
    full = next((each for each in FULL if largest <= each), None)
    if full is None:
        return Guess(1.0, f"values of {between}: give the scale, full command is 1")
    return Guess(1 / full, f"values of {between}: {full:g} for full command?")
