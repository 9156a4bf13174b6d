"""What is put in: chirps, doublets, noise on the commands, gusts of four kinds, the gyro's noise."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from planted import REST_S, Array
from scipy.signal import lfilter

from strangers.vehicles import Vehicle

GUSTS = ("coloured", "white", "slow", "bursts")
ODDS = (0.5, 0.15, 0.15, 0.2)
CORNER_HZ = {"coloured": 1.5, "slow": 0.25, "bursts": 1.5}
BURST_S = (0.5, 3.0)
CALM_S = (2.0, 8.0)
IN_CALM = 0.3
"""Of the gusts' size, between bursts; in them so much that the whole is as large as said."""
NOISE_ON_CHIRP = 0.2
"""Of the chirp's amplitude, below 10 Hz, on all axes."""
GYRO = 0.004
"""rad/s, of a gyro's sample at 500 Hz."""


@dataclass(frozen=True, kw_only=True)
class Weather:
    """Gusts and noise of a flight."""

    gusts: float
    kind: str
    gyro: float
    vibration: float
    """rad/s, of the rotor's own line on the gyros."""
    chirp_noise: float


@dataclass(frozen=True, kw_only=True)
class Maneuver:
    """One run's excitation."""

    kind: str
    axis: int
    """0 roll, 1 pitch."""
    amplitude: float
    """Of the chirp's usual."""
    duration_s: float
    fitted: bool


def chirp(size: float, duration_s: float, band_hz: tuple[float, float], dt: float) -> Array:
    """Table 1's law between two frequencies: slow ones last longest."""
    t = np.arange(round(duration_s / dt)) * dt
    low, high = (2 * math.pi * one for one in band_hz)
    share = (duration_s / 4 * np.expm1(4 * t / duration_s) - t) / math.expm1(4.0)
    return np.asarray(size * np.sin(low * t + (high - low) * share))


def doublets(size: float, duration_s: float, slowest: float, dt: float) -> Array:
    """Up and down for half a period of the slowest mode each, again and again after as long a rest."""
    t = np.arange(round(duration_s / dt)) * dt
    half = math.pi / slowest
    phase = np.mod(t, 4 * half)
    return np.asarray(size * np.where(phase < half, 1.0, np.where(phase < 2 * half, -1.0, 0.0)))


def excitation(
    rng: np.random.Generator, vehicle: Vehicle, maneuver: Maneuver, noise: float, samples: int, dt: float
) -> Array:
    """(samples, 3): x, y, e."""
    size = vehicle.amplitudes[maneuver.axis] * maneuver.amplitude
    if maneuver.kind == "chirp":
        wave = chirp(size, maneuver.duration_s, vehicle.band_hz, dt)
    else:
        wave = doublets(size, maneuver.duration_s, vehicle.slowest, dt)
    found = np.zeros((samples, 3))
    begin = round(REST_S / dt)
    during = slice(begin, begin + wave.size)
    if maneuver.kind == "chirp":
        corner = 2 * math.pi * 10.0 * dt
        alpha = corner / (1 + corner)
        white = rng.normal(0.0, noise * size * math.sqrt(0.002 / dt), (wave.size, 2))
        found[during, :2] = lfilter([alpha], [1.0, alpha - 1.0], white, axis=0)
    found[during, maneuver.axis] += wave
    return found


def coloured(rng: np.random.Generator, corner_hz: float, samples: int, dt: float) -> Array:
    """First-order filtered noise of unit deviation, stationary from the first sample on."""
    pole = math.exp(-2 * math.pi * corner_hz * dt)
    white = rng.standard_normal(samples) * math.sqrt(1 - pole * pole)
    white[0] = rng.standard_normal()
    return np.asarray(lfilter([1.0], [1.0, -pole], white))


def gusts(rng: np.random.Generator, vehicle: Vehicle, weather: Weather, samples: int, dt: float) -> Array:
    """(samples, 2): angular accelerations, rad/s^2."""
    if weather.kind == "white":  # as strong below 1.5 Hz as the coloured ones
        both = rng.standard_normal((samples, 2)) / math.sqrt(2 * math.pi * CORNER_HZ["coloured"] * 0.5 * dt) * 0.5
    else:
        both = np.stack([coloured(rng, CORNER_HZ[weather.kind], samples, dt) for _ in range(2)], axis=1)
    if weather.kind == "bursts":
        both *= _bursts(rng, samples, dt)[:, None]
    return np.asarray(weather.gusts * vehicle.gust * both)


def _bursts(rng: np.random.Generator, samples: int, dt: float) -> Array:
    """How strong the gusts are from sample to sample, their mean square 1."""
    strength, k = np.full(samples, IN_CALM), 0
    while k < samples:
        k += round(float(rng.uniform(*CALM_S)) / dt)
        length = round(float(rng.uniform(*BURST_S)) / dt)
        strength[k : k + length] = 2.0
        k += length
    return strength / max(1e-9, float(np.sqrt(np.mean(strength**2))))


def gyro_noise(rng: np.random.Generator, vehicle: Vehicle, weather: Weather, samples: int, dt: float) -> Array:
    """(samples, 2) on p and q, rad/s: white, and a line at the rotor's speed."""
    white = weather.gyro * math.sqrt(0.002 / dt) * rng.standard_normal((samples, 2))
    t, phases = np.arange(samples) * dt, rng.uniform(0, 2 * math.pi, 2)
    line = weather.vibration * np.sin(vehicle.table["omega"] * t[:, None] + phases)
    return np.asarray(white + line)
