"""Rotor speed as a drivetrain gives it: the rotor's inertia, drag that grows with collective, a governed motor.

The governor is slow enough to let the rotor sag under collective; the pilot moves its set speed now and then. Numbers
are for a rotor of 0.05 kg m^2 that takes 500 W in hover. Left out: blade flapping's share, the motor's current limit.
"""

from __future__ import annotations

import math
import random

INERTIA_TIME_S = 3.0
"""Rotor's angular momentum over hover torque: 0.05 kg m^2 * 173 rad/s / 2.9 N m."""
MOTOR_LAG_S = 0.1
PROPORTIONAL = 8.0
"""Hover torques per relative speed error."""
INTEGRAL = 6.0
PROFILE_SHARE = 0.4
"""Of the hover torque: drag at zero lift. The rest grows with collective."""
SLEW_PER_S = 0.06
"""The set speed moves by this share of nominal in a second."""
STEP_EVERY_S = (5.0, 12.0)


class Drivetrain:
    """Rotor speed in rad/s, advanced by `dt`. The pilot's set speeds are drawn between two bounds in RPM."""

    def __init__(self, rpm: tuple[float, float], nominal_rpm: float, seed: str, dt: float) -> None:
        self._random = random.Random(f"drivetrain {seed}")
        self._low, self._high = (bound / nominal_rpm for bound in rpm)
        self._nominal = nominal_rpm * 2 * math.pi / 60
        self._dt = dt
        self._wanted = self._random.uniform(self._low, self._high)
        self._set = self._speed = self._wanted
        self._torque = self._integral = self._speed**2
        self._until_step_s = self._random.uniform(*STEP_EVERY_S)

    @property
    def omega(self) -> float:
        return self._speed * self._nominal

    def step(self, lift: float) -> None:
        """`lift` is collective over that of hover: 1 in hover."""
        dt = self._dt
        self._until_step_s -= dt
        if self._until_step_s <= 0:
            self._until_step_s = self._random.uniform(*STEP_EVERY_S)
            self._wanted = self._random.uniform(self._low, self._high)
        way = self._wanted - self._set
        self._set += max(-SLEW_PER_S * dt, min(SLEW_PER_S * dt, way))
        error = self._set - self._speed
        self._integral += INTEGRAL * error * dt
        self._torque += (self._integral + PROPORTIONAL * error - self._torque) * dt / MOTOR_LAG_S
        drag = self._speed**2 * (PROFILE_SHARE + (1 - PROFILE_SHARE) * max(0.0, lift))
        self._speed += (self._torque - drag) * dt / INERTIA_TIME_S
