"""The hover vehicle: Table 4's tip-path-plane dynamics in light gusts, with or without what that model leaves out.

`hover-ideal` is Table 4 exactly. `hover` adds physics that a TPP structure lacks; each size below has its reason.
Sizes were taken from the ranges given there, servo and play within them such that a TPP fit of the paper's
maneuvers lands near the paper's 78 / 77 %.
"""

from __future__ import annotations

import math
import random
from dataclasses import dataclass

from sitl.plants.actuators import Backlash, Delay, SecondOrderServo, clip
from sitl.plants.table4 import NOMINAL_RPM, TABLE_4, TipPathPlane

DT = 0.002
G = 9.80665


@dataclass(frozen=True, kw_only=True)
class Missing:
    """Physics beyond TPP. Zero or None switches a part off."""

    servo_frequency_hz: float | None = None
    servo_zeta: float = 0.7
    delay_samples: int = 0
    backlash_half_width: float = 0.0
    inflow_gain: float = 0.0
    inflow_time_s: float = 0.03


@dataclass(frozen=True)
class Gusts:
    """Angular accelerations of the fuselage, each a first-order filtered white noise."""

    roll: float
    """Standard deviation, rad/s^2."""
    pitch: float
    corner_hz: float


NOTHING_MISSING = Missing()

BEYOND_TPP = Missing(
    # Fast digital cyclic servos: small-signal bandwidth of 10-20 Hz, well damped; 15 ms of lag at low frequency.
    servo_frequency_hz=16.0,
    servo_zeta=0.75,
    # Control loop, bus and one 333 Hz servo frame: 4-8 ms.
    delay_samples=3,
    # Ball links and gears of this size: 0.05-0.1 degree of play each way of 10-12 degrees at full command.
    backlash_half_width=0.008,
    # Pitt and Peters, first harmonic: gain near 0.3 at this loading, time constant of some 10 ms.
    inflow_gain=0.3,
    inflow_time_s=0.02,
)

# Indoors, in the rotor's own recirculation. Standard deviations roughly as the inverse inertias, 1 : 4.8.
LIGHT_GUSTS = Gusts(roll=0.16, pitch=0.7, corner_hz=1.5)


class HoverPlant:
    """States p, q, a, b, inflow and attitude, advanced by `dt` (2 ms) with commands held."""

    nominal_rpm = NOMINAL_RPM
    has_pitot = False

    def __init__(
        self, missing: Missing, gusts: Gusts, seed: int, rotor: TipPathPlane = TABLE_4, *, dt: float = DT
    ) -> None:
        self.rotor = rotor
        self._dt = dt
        self.missing = missing
        self._gauss = random.Random(seed).gauss
        self._gusts = gusts
        pole = math.exp(-2 * math.pi * gusts.corner_hz * dt)
        self._gust_pole = pole
        self._gust_drive = math.sqrt(1 - pole * pole)
        self._delays = [Delay(missing.delay_samples) for _ in range(2)]
        self._servos = (
            [SecondOrderServo(missing.servo_frequency_hz, missing.servo_zeta, dt) for _ in range(2)]
            if missing.servo_frequency_hz is not None
            else None
        )
        self._play = [Backlash(missing.backlash_half_width) for _ in range(2)]
        self.reset()

    def reset(self) -> None:
        """At rest, level, rotor at speed; gusts and servos keep what they have."""
        self.p = self.q = self.r = 0.0
        self.a = self.b = 0.0
        self.phi = self.theta = 0.0
        self._inflow_s = self._inflow_c = 0.0
        self._gust_p = self._gust_q = 0.0
        self._swash = (0.0, 0.0)
        self._speed_wander = 0.0
        self.omega = NOMINAL_RPM * 2 * math.pi / 60
        self.airspeed = 0.0
        self.ax = self.ay = 0.0
        self.az = -G

    def step(self, delta_x: float, delta_y: float, delta_e: float, delta_c: float, delta_r: float = 0.0) -> None:
        """One sample. Elevator, collective and tip propellers do nothing to p and q in hover."""
        gauss, pole, drive = self._gauss, self._gust_pole, self._gust_drive
        self._gust_p = pole * self._gust_p + drive * self._gusts.roll * gauss(0.0, 1.0)
        self._gust_q = pole * self._gust_q + drive * self._gusts.pitch * gauss(0.0, 1.0)
        self._integrate(*self._swashplate(clip(delta_x), clip(delta_y)))
        # A governor holds the rotor within a fraction of a percent; yaw is held by the tip propellers.
        self._speed_wander = 0.999 * self._speed_wander + gauss(0.0, 0.005)
        self.omega = NOMINAL_RPM * 2 * math.pi / 60 + self._speed_wander
        self.r = 0.98 * self.r + gauss(0.0, 0.001)
        self.ax = -G * math.sin(self.theta)
        self.ay = G * math.sin(self.phi)
        self.az = -G * math.cos(self.phi) * math.cos(self.theta)

    def _swashplate(self, delta_x: float, delta_y: float) -> tuple[float, float]:
        """Commands to the cyclic that the blades feel, as its mean over the sample."""
        servos = self._servos
        if servos is None:
            return delta_x, delta_y
        before = self._swash
        x = self._play[0].step(servos[0].step(self._delays[0].step(delta_x)))
        y = self._play[1].step(servos[1].step(self._delays[1].step(delta_y)))
        self._swash = (x, y)
        return 0.5 * (before[0] + x), 0.5 * (before[1] + y)

    def _integrate(self, x: float, y: float) -> None:
        """Runge-Kutta of fourth order over one sample; written out, since this runs 500 times a second."""
        R = self.rotor
        L_b, M_a, rate, A_b, B_a = R.L_b, R.M_a, 1 / R.tau_f, R.A_b, R.B_a
        theta_s = R.A_lat * x + R.A_lon * y
        theta_c = R.B_lat * x + R.B_lon * y
        gain, inflow_rate = self.missing.inflow_gain, 1 / self.missing.inflow_time_s
        gust_p, gust_q = self._gust_p, self._gust_q

        def derivatives(
            p: float, q: float, a: float, b: float, ls: float, lc: float
        ) -> tuple[float, float, float, float, float, float]:
            return (
                L_b * b + gust_p,
                M_a * a + gust_q,
                -q + (-a + A_b * b + theta_s - ls) * rate,
                -p + (-b + B_a * a + theta_c - lc) * rate,
                (gain * (theta_s - a) - ls) * inflow_rate,
                (gain * (theta_c - b) - lc) * inflow_rate,
            )

        p, q, a, b, ls, lc = self.p, self.q, self.a, self.b, self._inflow_s, self._inflow_c
        dt = self._dt
        h = 0.5 * dt
        p1, q1, a1, b1, s1, c1 = derivatives(p, q, a, b, ls, lc)
        p2, q2, a2, b2, s2, c2 = derivatives(p + h * p1, q + h * q1, a + h * a1, b + h * b1, ls + h * s1, lc + h * c1)
        p3, q3, a3, b3, s3, c3 = derivatives(p + h * p2, q + h * q2, a + h * a2, b + h * b2, ls + h * s2, lc + h * c2)
        p4, q4, a4, b4, s4, c4 = derivatives(
            p + dt * p3, q + dt * q3, a + dt * a3, b + dt * b3, ls + dt * s3, lc + dt * c3
        )
        w = dt / 6
        self.phi += dt * (p + h / 3 * (p1 + p2 + p3))
        self.theta += dt * (q + h / 3 * (q1 + q2 + q3))
        self.p = p + w * (p1 + 2 * (p2 + p3) + p4)
        self.q = q + w * (q1 + 2 * (q2 + q3) + q4)
        self.a = a + w * (a1 + 2 * (a2 + a3) + a4)
        self.b = b + w * (b1 + 2 * (b2 + b3) + b4)
        self._inflow_s = ls + w * (s1 + 2 * (s2 + s3) + s4)
        self._inflow_c = lc + w * (c1 + 2 * (c2 + c3) + c4)
