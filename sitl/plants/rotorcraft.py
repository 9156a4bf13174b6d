"""A vehicle put together from parts: Table 4's in hover or Table 5's in forward flight, with any part exchanged.

The order is the block diagram's: commands -> actuators -> rotor -> fuselage -> rates and attitude; sensors are the
vehicle's (`sitl.plants.sensors`). Without parts it flies exactly as `hover-ideal` and `forward` do, which are written
out by themselves because they fly most. To add a part, write it in `sitl.plants.actuators`, `rotors`, `fuselages` or
`sitl.plants.sensors` and let a recipe in `sitl.hidden` use it.

Yaw is not simulated but flown: the tip propellers turn the vehicle as commanded, with a lag. Left out: large angles.
"""

from __future__ import annotations

import math
import random
from collections.abc import Sequence
from dataclasses import dataclass

from sitl.plants.actuators import Stage, clip
from sitl.plants.conditions import CALM, Condition
from sitl.plants.drivetrain import Drivetrain
from sitl.plants.forward import AIRSPEED, ROTOR_RPM, ForwardPlant, Wander
from sitl.plants.fuselages import ForwardFuselage, Inertia, Load, Now
from sitl.plants.hover import DT, LIGHT_GUSTS, G, Gusts
from sitl.plants.rotors import Disc, Rotor
from sitl.plants.sensors import Mount
from sitl.plants.table4 import NOMINAL_RPM, TABLE_4, TipPathPlane
from sitl.plants.table5 import TABLE_5, TABLE_5_FUSELAGE, Fuselage

HOVER_COLLECTIVE = 0.2
"""Of full command."""
YAW_RATE_PER_COMMAND = 2.0  # rad/s
YAW_LAG_S = 0.3
NOMINAL_AIRSPEED = 0.5 * (AIRSPEED[0] + AIRSPEED[1])


@dataclass(frozen=True)
class Airframe:
    """What a plant is before anything is exchanged."""

    table: TipPathPlane
    nominal_rpm: float
    fuselage: Fuselage | None
    """None in hover: nothing damps and there is no elevator."""


AIRFRAMES = {
    "hover-ideal": Airframe(TABLE_4, NOMINAL_RPM, None),
    "forward": Airframe(TABLE_5, ForwardPlant.nominal_rpm, TABLE_5_FUSELAGE),
}
"""The plants that can carry parts, by their names."""


@dataclass(kw_only=True)
class Parts:
    """What is exchanged or added. Parts have states: every vehicle gets its own."""

    actuators: Sequence[Stage] = ()
    """In the order of the commands' way."""
    rotor: Rotor | None = None
    fuselage: ForwardFuselage | None = None
    """In forward flight, in place of the airframe's own."""
    loads: Sequence[Load] = ()
    inertia: Inertia | None = None
    gyro: Sequence[Mount] = ()
    """For the vehicle, from the airframe to the chip."""


class Rotorcraft:
    """States p, q, attitude, a, b and those of the parts, advanced by 2 ms with commands held."""

    def __init__(
        self,
        airframe: Airframe,
        parts: Parts | None = None,
        gusts: Gusts = LIGHT_GUSTS,
        seed: int = 1,
        condition: Condition = CALM,
    ) -> None:
        parts = Parts() if parts is None else parts
        self.nominal_rpm = airframe.nominal_rpm
        self.has_pitot = airframe.fuselage is not None
        self._actuators = tuple(parts.actuators)
        self.rotor = Disc(airframe.table, airframe.nominal_rpm) if parts.rotor is None else parts.rotor
        loads = list(parts.loads)
        if airframe.fuselage is not None:
            own = ForwardFuselage(*airframe.fuselage, NOMINAL_AIRSPEED)
            loads.insert(0, own if parts.fuselage is None else parts.fuselage)
        first = 6 + self.rotor.own_states
        self._loads: list[tuple[Load, int]] = []
        for load in loads:
            self._loads.append((load, first))
            first += load.own_states
        self._own_states = first - 6
        self._inertia = parts.inertia
        self._condition = condition
        source = random.Random(seed)
        self._gauss = source.gauss
        phases = [source.uniform(0.0, 2 * math.pi) for _ in range(4)]
        bounds = AIRSPEED if condition.airspeed is None else condition.airspeed
        self._air = Wander(bounds, (0.027, 0.071), (phases[0], phases[1]))
        self._rpm = Wander(ROTOR_RPM, (0.033, 0.083), (phases[2], phases[3]))
        self._drivetrain = (
            None if condition.rpm is None else Drivetrain(condition.rpm, airframe.nominal_rpm, f"{seed} drivetrain", DT)
        )
        self._gusts = gusts
        self._gust_pole = math.exp(-2 * math.pi * gusts.corner_hz * DT)
        self._gust_drive = math.sqrt(1 - self._gust_pole**2)
        self._samples = 0
        self._speed_wander = 0.0
        self.reset()

    def reset(self) -> None:
        """Trimmed, without rates; rotor speed and airspeed go on, actuators keep what they have."""
        self.p = self.q = self.r = 0.0
        self.a = self.b = 0.0
        self.phi = self.theta = 0.0
        self._own = [0.0] * self._own_states
        self._gust_p = self._gust_q = 0.0
        self._turning = self._unrest = 0.0
        self._feel()

    def _feel(self) -> None:
        """Rotor speed, airspeed and specific force at this instant."""
        t = self._samples * DT
        if self._drivetrain is not None:
            self.omega = self._drivetrain.omega
        elif self.has_pitot:
            self.omega = self._rpm.at(t) * 2 * math.pi / 60
        else:
            self.omega = self.nominal_rpm * 2 * math.pi / 60 + self._speed_wander
        if self.has_pitot:
            self.airspeed = self._air.at(t)
            self.ax, self.ay, self.az = -G * math.cos(self.theta), 0.0, -G * math.sin(self.theta)
        else:
            self.airspeed = 0.0
            self.ax, self.ay = -G * math.sin(self.theta), G * math.sin(self.phi)
            self.az = -G * math.cos(self.phi) * math.cos(self.theta)

    def step(self, delta_x: float, delta_y: float, delta_e: float, delta_c: float, delta_r: float = 0.0) -> None:
        """One sample."""
        gauss, pole, drive = self._gauss, self._gust_pole, self._gust_drive
        self._gust_p = pole * self._gust_p + drive * self._gusts.roll * gauss(0.0, 1.0)
        self._gust_q = pole * self._gust_q + drive * self._gusts.pitch * gauss(0.0, 1.0)
        x, y, e = clip(delta_x), clip(delta_y), clip(delta_e)
        collective = delta_c - HOVER_COLLECTIVE
        for stage in self._actuators:
            x, y, e = stage.step(x, y, e, collective)
        self.rotor.hold(x, y, self.omega, self.r)
        now = Now(e, collective, delta_r, self.r, self.airspeed)
        for load, _ in self._loads:
            load.hold(now)
        self._integrate()
        self._samples += 1
        self._turn(delta_r)
        if self._drivetrain is not None:
            self._drivetrain.step(1 + collective / HOVER_COLLECTIVE)
        elif not self.has_pitot:
            self._speed_wander = 0.999 * self._speed_wander + gauss(0.0, 0.005)
        self._feel()

    def _turn(self, delta_r: float) -> None:
        """The yaw rate: what the tip propellers were told, and a little unrest."""
        self._turning += (YAW_RATE_PER_COMMAND * delta_r - self._turning) * DT / YAW_LAG_S
        self._unrest = 0.98 * self._unrest + self._gauss(0.0, 0.001)
        self.r = self._turning + self._unrest

    def _integrate(self) -> None:
        """Runge-Kutta of fourth order over one sample."""
        rates, h, w = self._rates, 0.5 * DT, DT / 6
        s = [self.p, self.q, self.phi, self.theta, self.a, self.b, *self._own]
        k1 = rates(s)
        k2 = rates([x + h * k for x, k in zip(s, k1, strict=True)])
        k3 = rates([x + h * k for x, k in zip(s, k2, strict=True)])
        k4 = rates([x + DT * k for x, k in zip(s, k3, strict=True)])
        self.p, self.q, self.phi, self.theta, self.a, self.b, *self._own = [
            x + w * (d1 + 2 * (d2 + d3) + d4) for x, d1, d2, d3, d4 in zip(s, k1, k2, k3, k4, strict=True)
        ]

    def _rates(self, s: Sequence[float]) -> list[float]:
        p, q = s[0], s[1]
        N_p, N_q, *tilting = self.rotor.rates(s)
        N_p += self._gust_p
        N_q += self._gust_q
        own: list[float] = []
        for load, i in self._loads:
            L, M, *more = load.moments(s, i)
            N_p += L
            N_q += M
            own += more
        if self._inertia is not None:
            N_p, N_q = self._inertia.accelerations(N_p, N_q, p, q, self.r)
        # Seen from axes that yaw, a lean to one side turns into one ahead.
        return [N_p, N_q, p + self.r * s[3], q - self.r * s[2], *tilting, *own]
