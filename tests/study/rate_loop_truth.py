"""Quadrotors of three sizes that a stock autopilot flies with its default gains, and what their loops really hold.

The truth is flown, not computed: the simulated vehicle's own plant, gyro filter and controllers, in air that stands
still, are given a pulse on a measured rate or on a command, and what comes of it is transformed. No code of `sysid` has
a part in it.
"""

from __future__ import annotations

import math
import random
from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

from sitl.autopilot.clothes import CLOTHES
from sitl.autopilot.modes import Mode, Reason
from sitl.autopilot.parameters import Parameters
from sitl.autopilot.stock_laws import StockControllers
from sitl.autopilot.systemid import NOTHING
from sitl.autopilot.vehicle import Vehicle
from sitl.plants.hover import Gusts
from sitl.plants.sensors import RateFilter
from sitl.plants.stock import Quadrotor, QuadSize

Array = npt.NDArray[np.float64]
Complex = npt.NDArray[np.complex128]
DT = 0.0025
LIKE = CLOTHES["ardupilot-quad"]
SIZES: Mapping[str, tuple[float, float]] = {"small": (250.0, 0.018), "medium": (90.0, 0.035), "large": (35.0, 0.080)}
"""rad/s^2 per full command, and s of the rotors: about 0.5, 2 and 10 kg."""
SPREAD = 1.6
"""Largest factor on either."""
DAMPING = (0.5, 4.0)
LATE_LOOPS = 6
"""At most, of the commands."""
GUSTS = (0.02, 0.10)
FLOWN_DB = 3.0
"""Gain margin below which nobody would fly a sweep with the default gains; drawn again."""
PULSE, SECONDS, BEGINS = 1e-3, 20.0, 4
PADDED_S = 80.0
"""Of what is transformed: it has died out by then."""
SWEEP = {
    "SID_MAGNITUDE": 0.08,
    "SID_F_STOP_HZ": 15.0,
    "SID_T_REC": 20.0,
    "SID_T_FADE_IN": 1.0,
    "SID_T_FADE_OUT": 0.5,
    "LOG_BITMASK": 180223.0,
}
AXES = (10, 11)


@dataclass(frozen=True, kw_only=True)
class Quad:
    """What flies."""

    name: str
    size: QuadSize
    late_loops: int
    gusts: float
    """rad/s^2, of each axis."""
    seed: int

    def plant(self, dt: float, *, still: bool = False) -> LateQuadrotor:
        gusts = 0.0 if still else self.gusts
        return LateQuadrotor(self.size, Gusts(roll=gusts, pitch=gusts, corner_hz=1.5), self.seed, dt, self.late_loops)


class LateQuadrotor(Quadrotor):
    """The quadrotor, its commands some loops late."""

    def __init__(self, size: QuadSize, gusts: Gusts, seed: int, dt: float, late_loops: int) -> None:
        self._late = late_loops
        super().__init__(size, gusts, seed, dt)

    def reset(self) -> None:
        super().reset()
        self._under_way = deque([(0.0, 0.0)] * self._late)

    def step(self, delta_x: float, delta_y: float, delta_e: float, delta_c: float, delta_r: float = 0.0) -> None:
        self._under_way.append((delta_x, delta_y))
        x, y = self._under_way.popleft()
        super().step(x, y, delta_e, delta_c, delta_r)


def drawn(seed: int) -> Quad:
    """A vehicle that default gains fly."""
    rng = random.Random(seed)
    while True:
        name = sorted(SIZES)[seed % len(SIZES)]
        power, tau = SIZES[name]

        def about(value: float) -> float:
            return value * math.exp(rng.uniform(-1, 1) * math.log(SPREAD))

        size = QuadSize(
            L_p=-rng.uniform(*DAMPING),
            M_q=-rng.uniform(*DAMPING),
            L_lat=about(power),
            M_lon=about(power),
            tau=about(tau),
        )
        one = Quad(name=name, size=size, late_loops=rng.randint(0, LATE_LOOPS), gusts=rng.uniform(*GUSTS), seed=seed)
        held = truth(one, {})
        if held is not None and held.gain_db >= FLOWN_DB:
            return one


def flown(one: Quad, folder: Path) -> Path:
    """The log of a sweep of each axis, with default gains in gusts."""
    folder.mkdir()
    vehicle = Vehicle(
        one.plant(DT),
        seed=one.seed,
        directory=folder,
        name="quad",
        parameters=SWEEP,
        clothes=LIKE,
        rebuild=one.plant,
    )
    for axis in AXES:
        vehicle.write_parameter("SID_AXIS", axis)
        if not vehicle.set_mode(Mode.SYSTEMID, Reason.GROUND):
            raise RuntimeError("the vehicle does not fly the sweep")
        for _ in range(round(27 / vehicle.dt)):
            vehicle.step()
        vehicle.set_mode(Mode.STABILIZE, Reason.GROUND)
        for _ in range(round(2 / vehicle.dt)):
            vehicle.step()
    vehicle.close()
    (path,) = folder.rglob("*.BIN")
    return path


@dataclass(frozen=True, kw_only=True)
class Truth:
    """What gains really hold; the worse of both axes, which know nothing of each other."""

    gain_db: float
    phase_deg: float
    delay_ms: float
    rejection_hz: tuple[float, float]
    """Of roll and pitch: up to where less than -3 dB of a disturbance of the rate is left."""
    peak_db: float

    def has(self, gain_db: float, phase_deg: float, delay_ms: float) -> bool:
        return self.gain_db >= gain_db and self.phase_deg >= phase_deg and self.delay_ms >= delay_ms


def truth(one: Quad, gains: Mapping[str, float]) -> Truth | None:
    """With these parameters beside the defaults; None where the vehicle is not held."""
    n = round(PADDED_S / DT)
    f: Array = np.asarray(np.fft.rfftfreq(n, DT)[1:], dtype=np.float64)
    seen, sent = _after_pulse(one, gains, on_rates=True), _after_pulse(one, gains, on_rates=False)
    if seen is None or sent is None:
        return None
    given = PULSE * np.exp(-2j * np.pi * f * DT * BEGINS)[:, None]
    left, whole = (np.fft.rfft(each, n, axis=0)[1:] / given for each in (seen, sent))
    margins = [_margins(f, 1 / whole[:, axis] - 1) for axis in range(2)]
    size = 20 * np.log10(np.abs(left))
    return Truth(
        gain_db=min(each[0] for each in margins),
        phase_deg=min(each[1] for each in margins),
        delay_ms=min(each[2] for each in margins),
        rejection_hz=(_rejected(f, size[:, 0]), _rejected(f, size[:, 1])),
        peak_db=float(size.max()),
    )


class _Seen:
    """The attitude that a pulse on the rates turns, too."""

    def __init__(self, plant: Quadrotor, turned: list[float]) -> None:
        self.phi, self.theta = plant.phi + turned[0], plant.theta + turned[1]


def _after_pulse(one: Quad, gains: Mapping[str, float], *, on_rates: bool) -> Array | None:
    """(n, 2): measured rates, or commands as the plant gets them, after a pulse on one or the other, on both axes;
    None where it does not die out."""
    parameters = Parameters(lambda _: None, table=LIKE.table, after_reboot=LIKE.after_reboot)
    for name, value in gains.items():
        if parameters.write(name, value, armed=False) is None:
            raise KeyError(name)
    plant, law = one.plant(DT, still=True), StockControllers(parameters, DT)
    gyro = RateFilter(parameters.__getitem__, DT)
    turned, out = [0.0, 0.0], np.zeros((round(SECONDS / DT), 2))
    for k in range(len(out)):
        pulse = PULSE if k == BEGINS else 0.0
        rates = (plant.p + pulse, plant.q + pulse, 0.0) if on_rates else (plant.p, plant.q, 0.0)
        x, y, *_ = law.step(_Seen(plant, turned), gyro.step(rates), NOTHING, False)  # type: ignore[arg-type]
        if on_rates:
            out[k] = rates[:2]
            turned = [angle + DT * pulse for angle in turned]
        else:
            x, y = x + pulse, y + pulse
            out[k] = x, y
        if not abs(plant.p) + abs(plant.q) < 1.0:
            return None
        plant.step(x, y, 0.0, 0.0)
    return out if np.abs(out[-len(out) // 8 :]).max() < 1e-2 * np.abs(out).max() else None


def _margins(f: Array, loop: Complex) -> tuple[float, float, float]:
    """dB, degrees and ms, of one axis's loop at Hz."""
    size, turn = np.log(np.abs(loop)), np.unwrap(np.angle(loop))
    real = np.flatnonzero(np.diff(np.floor((turn / np.pi - 1) / 2)) != 0)
    gain = min((-20 / math.log(10) * max(size[i], size[i + 1]) for i in real if size[i] < 0), default=math.inf)
    units = np.flatnonzero(np.diff(size > 0))
    angles = [(float(np.mod(turn[i] - np.pi, 2 * np.pi)), float(f[i])) for i in units]
    phase = min((math.degrees(min(angle, 2 * np.pi - angle)) for angle, _ in angles), default=math.inf)
    return float(gain), phase, min((1000 * angle / (2 * np.pi * hz) for angle, hz in angles), default=math.inf)


def _rejected(f: Array, size: Array) -> float:
    above = np.flatnonzero(size > -3)
    if not above.size or above[0] == 0:
        return 0.0
    at = above[0] - 1
    return float(f[at] * (f[at + 1] / f[at]) ** ((-3 - size[at]) / (size[at + 1] - size[at])))
