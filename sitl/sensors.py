"""The gyro: true rates plus the rotor's vibration and white noise."""

from __future__ import annotations

import math
import random

VIBRATION = 0.035  # rad/s at one per revolution; visible beside a chirp, gone after the 15 Hz low-pass
SECOND_HARMONIC = 0.010  # rad/s at two per revolution, from the two blades
YAW_VIBRATION = 0.01  # rad/s; the shaft direction is the stiff one
NOISE = 0.004  # rad/s per sample; a MEMS gyro at 500 Hz with its own filter open


class Gyro:
    """Body rates as the autopilot sees them."""

    def __init__(self, seed: int) -> None:
        self._gauss = random.Random(seed).gauss

    def measure(self, p: float, q: float, r: float, rotor_angle: float) -> tuple[float, float, float]:
        """True rates in rad/s and the rotor's azimuth in rad -> measured rates in rad/s."""
        sine, cosine = math.sin(rotor_angle), math.cos(rotor_angle)
        second = SECOND_HARMONIC * math.sin(2 * rotor_angle)
        gauss = self._gauss
        return (
            p + VIBRATION * cosine + second + gauss(0.0, NOISE),
            q + VIBRATION * sine - second + gauss(0.0, NOISE),
            r + YAW_VIBRATION * sine + gauss(0.0, NOISE),
        )
