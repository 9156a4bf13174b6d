"""What flies under a stock autopilot: any loop rate, and an answer on each of its four mixer axes.

The helicopter is the hover plant with yaw and collective added. The quadrotor is rates damped a little and turned by
rotors that take a moment: Cylinder Dynamics behind a lag, uncoupled, with no linkage and no flapping.
"""

from __future__ import annotations

import math
import random
from typing import NamedTuple

from sitl.plants.actuators import Lag, clip
from sitl.plants.hover import BEYOND_TPP, LIGHT_GUSTS, NOTHING_MISSING, G, Gusts, HoverPlant
from sitl.plants.rotorcraft import HOVER_COLLECTIVE, YAW_LAG_S, YAW_RATE_PER_COMMAND

LIFT_PER_COLLECTIVE = 2.0
"""Of the weight, per full command beside that of a hover."""


class StockHelicopter(HoverPlant):
    """The hover plant; the tail turns it as commanded, with a lag, and the collective lifts it."""

    def reset(self) -> None:
        super().reset()
        self._tail = Lag(YAW_LAG_S, self._dt)

    def step(self, delta_x: float, delta_y: float, delta_e: float, delta_c: float, delta_r: float = 0.0) -> None:
        unrest = self.r - self._tail.position
        self.r = unrest
        super().step(delta_x, delta_y, delta_e, delta_c, delta_r)
        self.r += self._tail.step(YAW_RATE_PER_COMMAND * delta_r)
        self.az *= 1 + LIFT_PER_COLLECTIVE * (delta_c - HOVER_COLLECTIVE)


class QuadSize(NamedTuple):
    """1/s, 1/s^2 per full command, s: dp/dt = L_p p + L_lat m_x, dm_x/dt = (delta_x - m_x) / tau."""

    L_p: float
    M_q: float
    L_lat: float
    M_lon: float
    tau: float


QUAD = QuadSize(L_p=-1.5, M_q=-1.8, L_lat=90.0, M_lon=80.0, tau=0.035)
"""Of a quadrotor of some 2 kg."""
QUAD_GUSTS = Gusts(roll=0.05, pitch=0.05, corner_hz=1.5)  # still air: its controller answers gusts, and hides them


class Quadrotor:
    """States p, q, r, attitude and the rotors' moments, advanced by `dt` with commands held."""

    nominal_rpm = 5400.0
    has_pitot = False

    def __init__(self, size: QuadSize, gusts: Gusts, seed: int, dt: float) -> None:
        self.size = size
        self._dt = dt
        self._gauss = random.Random(seed).gauss
        self._gusts = gusts
        self._gust_pole = math.exp(-2 * math.pi * gusts.corner_hz * dt)
        self._gust_drive = math.sqrt(1 - self._gust_pole**2)
        self.reset()

    def reset(self) -> None:
        """At rest and level, rotors at a hover's speed."""
        self.p = self.q = self.r = 0.0
        self.a = self.b = 0.0
        self.phi = self.theta = 0.0
        self.omega = self.nominal_rpm * 2 * math.pi / 60
        self.airspeed = self.ax = self.ay = 0.0
        self.az = -G
        self._gust_p = self._gust_q = 0.0
        self._rotors = [Lag(self.size.tau, self._dt) for _ in range(3)]

    def step(self, delta_x: float, delta_y: float, delta_e: float, delta_c: float, delta_r: float = 0.0) -> None:
        """One sample. There is no elevator."""
        gauss, pole, drive = self._gauss, self._gust_pole, self._gust_drive
        self._gust_p = pole * self._gust_p + drive * self._gusts.roll * gauss(0.0, 1.0)
        self._gust_q = pole * self._gust_q + drive * self._gusts.pitch * gauss(0.0, 1.0)
        before = [rotor.position for rotor in self._rotors]
        after = [rotor.step(clip(u)) for rotor, u in zip(self._rotors, (delta_x, delta_y, delta_r), strict=True)]
        x, y, _ = (0.5 * (old + new) for old, new in zip(before, after, strict=True))
        size = self.size
        p, q = self.p, self.q
        self.p = self._damped(p, size.L_p, size.L_lat * x + self._gust_p)
        self.q = self._damped(q, size.M_q, size.M_lon * y + self._gust_q)
        self.phi += 0.5 * self._dt * (p + self.p)
        self.theta += 0.5 * self._dt * (q + self.q)
        self.r = YAW_RATE_PER_COMMAND * after[2]
        self.ax, self.ay = -G * math.sin(self.theta), G * math.sin(self.phi)
        lift = 1 + LIFT_PER_COLLECTIVE * (delta_c - HOVER_COLLECTIVE)
        self.az = -G * math.cos(self.phi) * math.cos(self.theta) * lift

    def _damped(self, rate: float, damping: float, drive: float) -> float:
        """d rate/dt = damping rate + drive over one sample, exactly for a drive that is held."""
        left = math.exp(damping * self._dt)
        return left * rate + (left - 1) / damping * drive


STOCK_PLANTS = ("hover", "hover-ideal", "quad")


def make_stock_plant(name: str, seed: int, dt: float) -> StockHelicopter | Quadrotor:
    """The plant of that name, advanced by `dt` seconds a step. Raises ValueError for an unknown name."""
    if name == "quad":
        return Quadrotor(QUAD, QUAD_GUSTS, seed, dt)
    if name not in STOCK_PLANTS:
        raise ValueError(f"unknown plant {name!r}; there are {', '.join(STOCK_PLANTS)}")
    return StockHelicopter(BEYOND_TPP if name == "hover" else NOTHING_MISSING, LIGHT_GUSTS, seed, dt=dt)
