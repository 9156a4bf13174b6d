"""What gusts and a noisy gyro make of the commands: of the gains that flew, and of others in their place.

What the commands did not cause in the measured rates, N = Y - P U by the fitted vehicle P, is what disturbs them,
whatever flies. Under a controller C it becomes commands -C (I + P C)^-1 N: so many rms, and so many a second that
actuators are to follow. Of runs that excite the vehicle, what the model does not explain of that is in N, too.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from sysid.control.sampled import RateController, SampledVehicle
from sysid.data.preprocess import ComplexArray, pieces
from sysid.data.record import CYCLIC, RATES, FloatArray, Record
from sysid.model.structure import Model

WINDOW_S = 4.0
LOWEST_HZ = 0.5
"""Slower is trim."""
SIGMAS = 3.0
"""Of a command's rate, that an actuator of known speed is to follow."""
SERVO_SPEED = ("servo_rate_limit", "rate")
"""The effect that knows it, and its parameter, full command a second."""


@dataclass(frozen=True, eq=False, kw_only=True)
class RateDisturbance:
    """One-sided spectrum of what disturbs the rates of a vehicle, whatever flies it."""

    frequency_hz: FloatArray
    """(f,)"""
    spectrum: ComplexArray
    """(f, 2, 2), (rad/s)^2 per Hz."""

    def commands(self, law: RateController, vehicle: SampledVehicle) -> Moved:
        """Of loops that hold this vehicle."""
        f = self.frequency_hz
        through = law.taken_of_disturbance(vehicle, f)
        power = np.einsum("fij,fjk,fik->fi", through, self.spectrum, through.conj()).real
        step = f[1] - f[0]
        rate = np.abs(1 - np.exp(-2j * np.pi * f * law.dt)) / law.dt
        roll, pitch = np.sqrt(step * np.sum(power, axis=0))
        roll_rate, pitch_rate = np.sqrt(step * np.sum(power * rate[:, None] ** 2, axis=0))
        return Moved(
            rms=(float(roll), float(pitch)),
            rate_rms=(float(roll_rate), float(pitch_rate)),
            band_hz=(float(f[0]), float(f[-1])),
        )


@dataclass(frozen=True, kw_only=True)
class Moved:
    """What disturbances make of both commands, roll then pitch."""

    rms: tuple[float, float]
    """Of full command."""
    rate_rms: tuple[float, float]
    """Of full command a second."""
    band_hz: tuple[float, float]


@dataclass(frozen=True, kw_only=True)
class CommandNoise:
    """Of gains, beside that of those that flew."""

    own: Moved
    flown: Moved
    servo_speed: float | None = None
    """Full command a second, where a model knows it."""

    @property
    def times_flown(self) -> float | None:
        """The largest of what it is of the flown one's, in either axis, of commands and of their rate."""
        mine, theirs = ((*one.rms, *one.rate_rms) for one in (self.own, self.flown))
        return max((own / flown for own, flown in zip(mine, theirs, strict=True) if flown > 0), default=None)

    @property
    def of_servo_speed(self) -> float | None:
        """`SIGMAS` of the faster command over what the servos do."""
        return None if not self.servo_speed else SIGMAS * max(self.own.rate_rms) / self.servo_speed

    def to_json(self) -> dict[str, Any]:
        """`own` and `flown`, each `rms`, `rate_rms`, `band_hz`; `servo_speed`, `times_flown`, `of_servo_speed`."""
        return asdict(self) | {"times_flown": self.times_flown, "of_servo_speed": self.of_servo_speed}


def rate_noise(records: Sequence[Record], vehicle: SampledVehicle) -> RateDisturbance | None:
    """By these runs under the loops that flew; None where they are too short.

    Commands that were logged more slowly than the loops ran are taken as held between samples.
    """
    dt = vehicle.plant.core.dt
    found: list[tuple[FloatArray, ComplexArray]] = []
    for record in records:
        for piece in pieces(record, (LOWEST_HZ, 0.4 / float(np.median(np.diff(record.t)))))[0]:
            segment = piece.segment((*RATES, *CYCLIC))
            count = round(WINDOW_S / segment.dt)
            window = np.hanning(count)
            f: FloatArray = np.asarray(np.fft.rfftfreq(count, segment.dt), dtype=np.float64)
            kept = (f >= LOWEST_HZ) & (f <= 0.45 * min(1 / segment.dt, 1 / dt))
            for start in range(0, segment.samples - count + 1, count // 2):
                Y, U = (
                    np.stack([_bins(segment.channels[name][start : start + count], window) for name in names], axis=1)
                    for names in (RATES, CYCLIC)
                )
                late = vehicle.plant.response(f[kept])[:, 2:]
                N = Y[kept] - np.einsum("fij,fj->fi", late, U[kept])
                scale = 2 * segment.dt / np.sum(window**2)
                found.append((f[kept], np.asarray(scale * N[:, :, None] * N[:, None, :].conj())))
    if not found:
        return None
    top = min(float(f[-1]) for f, _ in found)
    grid = found[0][0][found[0][0] <= top]
    mean = np.mean([_on(grid, f, each) for f, each in found], axis=0)
    return RateDisturbance(frequency_hz=grid, spectrum=np.asarray(mean))


def servo_speed(models: Sequence[Model]) -> float | None:
    """The slowest that any of these models knows; None where none does."""
    effect, parameter = SERVO_SPEED
    known = [one[parameter] for one in models if effect in one.structure.effects]
    return min((speed for speed in known if np.isfinite(speed)), default=None)


def _bins(values: FloatArray, window: FloatArray) -> ComplexArray:
    return np.asarray(np.fft.rfft((values - values.mean()) * window))


def _on(grid: FloatArray, f: FloatArray, spectrum: ComplexArray) -> ComplexArray:
    """The same bins on a grid that may be of another clock."""
    if f.size == grid.size and np.allclose(f, grid):
        return spectrum
    at = np.searchsorted(f, grid).clip(0, f.size - 1)
    return np.asarray(spectrum[at])
