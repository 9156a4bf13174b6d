"""Forward flight: Table 5's tip-path plane with the fuselage's rate terms and the elevator, in light gusts.

The axes stay those of hover: p turns about what is the vertical axis now, q about the wing. phi and theta are the
deviations from the trimmed attitude; the wings carry the weight along -x.

Airspeed and rotor speed wander slowly, as nobody holds them exactly: 17 to 19.5 m/s and 1550 to 1720 RPM, each a sum of
two sines below 0.1 Hz, so that they stay inside and can be logged far below the loop rate. Both are known without
error. By default nothing depends on them: the coefficients are Table 5's throughout, so that a fit of Table 5's
structure finds Table 5. `rotor_speed_power` makes the rotor follow its speed, 1 as theory has it.

Left out: angle of attack and sideslip as states, stall, and servos; a command acts as it is given.
"""

from __future__ import annotations

import math
import random
from dataclasses import dataclass

from sitl.plants.actuators import clip
from sitl.plants.hover import DT, LIGHT_GUSTS, G, Gusts
from sitl.plants.table4 import TipPathPlane
from sitl.plants.table5 import TABLE_5, TABLE_5_FUSELAGE, Fuselage

AIRSPEED = (17.0, 19.5)
"""m/s; the paper's flights."""
ROTOR_RPM = (1550.0, 1720.0)


@dataclass(frozen=True)
class Wander:
    """A value that moves between two bounds and has no frequencies but these two."""

    bounds: tuple[float, float]
    hz: tuple[float, float]
    """The slow frequency, then the fast one."""
    phases: tuple[float, float]
    """rad, of each at t = 0."""

    def at(self, t: float) -> float:
        """The value at t in seconds; the slow sine has three fifths of the range."""
        (low, high), (slow_hz, fast_hz), (slow_phase, fast_phase) = self.bounds, self.hz, self.phases
        slow = math.sin(2 * math.pi * slow_hz * t + slow_phase)
        fast = math.sin(2 * math.pi * fast_hz * t + fast_phase)
        return 0.5 * (low + high) + 0.5 * (high - low) * (0.6 * slow + 0.4 * fast)


class ForwardPlant:
    """States p, q, a, b and attitude, advanced by 2 ms with commands held."""

    nominal_rpm = 0.5 * (ROTOR_RPM[0] + ROTOR_RPM[1])
    has_pitot = True

    def __init__(
        self,
        gusts: Gusts = LIGHT_GUSTS,
        seed: int = 1,
        *,
        rotor: TipPathPlane = TABLE_5,
        fuselage: Fuselage = TABLE_5_FUSELAGE,
        rotor_speed_power: float = 0.0,
    ) -> None:
        """`rotor_speed_power` k: tau_f goes as Omega^-k, A_b and B_a as Omega^-2k, equal to `rotor` at nominal_rpm."""
        self.rotor = rotor
        self.fuselage = fuselage
        self.rotor_speed_power = rotor_speed_power
        source = random.Random(seed)
        self._gauss = source.gauss
        phases = [source.uniform(0.0, 2 * math.pi) for _ in range(4)]
        self._airspeed = Wander(AIRSPEED, (0.027, 0.071), (phases[0], phases[1]))
        self._rpm = Wander(ROTOR_RPM, (0.033, 0.083), (phases[2], phases[3]))
        self._gusts = gusts
        self._gust_pole = math.exp(-2 * math.pi * gusts.corner_hz * DT)
        self._gust_drive = math.sqrt(1 - self._gust_pole**2)
        self._samples = 0
        self.reset()

    def reset(self) -> None:
        """Trimmed, without rates; airspeed and rotor speed go on wandering."""
        self.p = self.q = self.r = 0.0
        self.a = self.b = 0.0
        self.phi = self.theta = 0.0
        self._gust_p = self._gust_q = 0.0
        self.ax, self.ay, self.az = -G, 0.0, 0.0
        self._look_at_the_air()

    def _look_at_the_air(self) -> None:
        t = self._samples * DT
        self.airspeed = self._airspeed.at(t)
        self.omega = self._rpm.at(t) * 2 * math.pi / 60

    def step(self, delta_x: float, delta_y: float, delta_e: float, delta_c: float, delta_r: float = 0.0) -> None:
        """One sample. Collective and tip propellers do nothing to p and q."""
        gauss, pole, drive = self._gauss, self._gust_pole, self._gust_drive
        self._gust_p = pole * self._gust_p + drive * self._gusts.roll * gauss(0.0, 1.0)
        self._gust_q = pole * self._gust_q + drive * self._gusts.pitch * gauss(0.0, 1.0)
        self._integrate(clip(delta_x), clip(delta_y), clip(delta_e))
        self._samples += 1
        self._look_at_the_air()
        self.r = 0.98 * self.r + gauss(0.0, 0.001)
        self.ax = -G * math.cos(self.theta)
        self.az = -G * math.sin(self.theta)

    def _integrate(self, x: float, y: float, e: float) -> None:
        """Runge-Kutta of fourth order over one sample; the rotor's speed hardly moves in 2 ms and is held."""
        R, F = self.rotor, self.fuselage
        faster = (self.omega * 60 / (2 * math.pi) / self.nominal_rpm) ** self.rotor_speed_power
        rate, A_b, B_a = faster / R.tau_f, R.A_b / faster**2, R.B_a / faster**2
        L_b, M_a, L_p, M_q = R.L_b, R.M_a, F.L_p, F.M_q
        theta_s = R.A_lat * x + R.A_lon * y
        theta_c = R.B_lat * x + R.B_lon * y
        push_p, push_q = self._gust_p, self._gust_q + F.M_elev * e

        def derivatives(p: float, q: float, a: float, b: float) -> tuple[float, float, float, float]:
            return (
                L_p * p + L_b * b + push_p,
                M_q * q + M_a * a + push_q,
                -q + (-a + A_b * b + theta_s) * rate,
                -p + (-b + B_a * a + theta_c) * rate,
            )

        p, q, a, b = self.p, self.q, self.a, self.b
        h, w = 0.5 * DT, DT / 6
        p1, q1, a1, b1 = derivatives(p, q, a, b)
        p2, q2, a2, b2 = derivatives(p + h * p1, q + h * q1, a + h * a1, b + h * b1)
        p3, q3, a3, b3 = derivatives(p + h * p2, q + h * q2, a + h * a2, b + h * b2)
        p4, q4, a4, b4 = derivatives(p + DT * p3, q + DT * q3, a + DT * a3, b + DT * b3)
        self.phi += DT * (p + h / 3 * (p1 + p2 + p3))
        self.theta += DT * (q + h / 3 * (q1 + q2 + q3))
        self.p = p + w * (p1 + 2 * (p2 + p3) + p4)
        self.q = q + w * (q1 + 2 * (q2 + q3) + q4)
        self.a = a + w * (a1 + 2 * (a2 + a3) + a4)
        self.b = b + w * (b1 + 2 * (b2 + b3) + b4)
