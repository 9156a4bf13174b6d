"""The on-board excitation: chirps, doublets and quiet stretches, with noise on every axis.

Written independently of the ground's signal laws on purpose: what flies here is judged by what the ground makes of it.
Two chirp laws: Tischler's exponential sweep with the paper's Table 1 settings, and ArduPilot's own.
"""

from __future__ import annotations

import math
import random
from dataclasses import dataclass, replace

KINDS = ("chirp", "doublet", "quiet")
AXES = ("roll", "pitch", "yaw", "thrust", "elevator", "rate_roll", "rate_pitch")
PULSES_PER_DOUBLET = 6  # two pulses, then four of rest, so that the answer dies out


@dataclass(frozen=True, kw_only=True)
class ExcitationSettings:
    """What to fly. Magnitude in parts of full command, or rad/s for the rate axes."""

    kind: str
    law: str
    """`tischler` or `ardupilot`."""
    axis: str
    magnitude: float
    f_start_hz: float = 0.5
    f_stop_hz: float = 10.0
    fade_in_s: float = 0.0
    duration_s: float = 30.0
    fade_out_s: float = 0.0
    c1: float = 4.0
    noise: float = 0.2
    """Standard deviation of the white noise over the magnitude, before its low-pass at f_stop_hz."""
    pulse_s: float = 0.3
    dt: float = 0.002

    def problem(self) -> str | None:
        """Why this cannot be flown, or None."""
        numbers = (self.magnitude, self.f_start_hz, self.f_stop_hz, self.fade_in_s, self.duration_s, self.fade_out_s)
        if self.kind not in KINDS or self.axis not in AXES or self.law not in ("tischler", "ardupilot"):
            return "unknown kind, axis or law"
        if not all(math.isfinite(x) for x in (*numbers, self.c1, self.noise, self.pulse_s)):
            return "a setting is not a finite number"
        if self.magnitude < 0 or self.noise < 0 or self.fade_in_s < 0 or self.fade_out_s < 0:
            return "a setting is negative"
        if self.duration_s <= 0:
            return "no duration"
        if self.f_stop_hz < 0:
            return "a frequency is negative"
        if self.kind == "chirp":
            if not 0 < self.f_start_hz < self.f_stop_hz < 0.5 / self.dt:
                return "the start frequency must lie below the stop frequency"
            if self.law == "ardupilot" and self.duration_s <= 2 / self.f_start_hz:
                return "shorter than two periods of the start frequency"
            if self.law == "tischler" and not 0 < self.c1 < 50:
                return "C1 out of range"
        if self.kind == "doublet" and self.pulse_s < self.dt:
            return "no pulse"
        return None


@dataclass(frozen=True, kw_only=True)
class ExcitationSample:
    """What is added in one sample: x, y, e on the commands (or x, y on the rate commands for rate axes).

    Yaw and thrust have no noise, and only `target`.
    """

    x: float
    y: float
    e: float
    target: float
    """The deterministic part on the excited axis, as SIDD.Targ logs it."""
    frequency_hz: float
    done: bool


class Excitation:
    """One maneuver, sample by sample. The first sample is at time zero of the maneuver."""

    def __init__(self, settings: ExcitationSettings, seed: int) -> None:
        problem = settings.problem()
        if problem is not None:
            raise ValueError(problem)
        self.settings = settings
        self._random = random.Random(f"excitation {seed}")
        self._sample = 0
        self._end_s = settings.duration_s
        self._noise = [0.0, 0.0, 0.0]
        corner = 2 * math.pi * settings.f_stop_hz * settings.dt
        self._alpha = corner / (1 + corner)

    def change(self, settings: ExcitationSettings) -> None:
        """What an autopilot reads in every loop: magnitude, axis, noise, and an end that is now earlier.

        The law keeps what it was begun with: frequencies, fades, its own duration.
        """
        self.settings = replace(self.settings, magnitude=settings.magnitude, axis=settings.axis, noise=settings.noise)
        self._end_s = min(self.settings.duration_s, settings.duration_s)

    def step(self) -> ExcitationSample:
        s = self.settings
        t = self._sample * s.dt
        self._sample += 1
        if t >= self._end_s - 0.5 * s.dt:
            return ExcitationSample(
                x=0.0, y=0.0, e=0.0, target=0.0, frequency_hz=s.f_stop_hz if s.kind == "chirp" else 0.0, done=True
            )
        target, frequency_hz = 0.0, 0.0
        x = y = e = 0.0
        if s.kind == "chirp":
            wave, frequency_hz = (_tischler if s.law == "tischler" else _ardupilot)(s, t)
            target = s.magnitude * _window(s, t) * wave
            if s.law == "tischler" and s.noise > 0:
                x, y, e = self._filtered_noise()
        elif s.kind == "doublet":
            target = s.magnitude * _doublet(s, t)
        if s.axis.endswith("roll"):
            x += target
        elif s.axis == "elevator":
            e += target
        elif s.axis.endswith("pitch"):
            y += target
        return ExcitationSample(x=x, y=y, e=e, target=target, frequency_hz=frequency_hz, done=False)

    def _filtered_noise(self) -> tuple[float, float, float]:
        deviation = self.settings.noise * self.settings.magnitude
        for axis in range(3):
            white = self._random.gauss(0.0, deviation)
            self._noise[axis] += self._alpha * (white - self._noise[axis])
        return self._noise[0], self._noise[1], self._noise[2]


def _tischler(s: ExcitationSettings, t: float) -> tuple[float, float]:
    """Tischler and Remple: omega = omega_0 + C2 (exp(C1 t/T) - 1)(omega_1 - omega_0), phase integrated exactly."""
    w0, w1, T = 2 * math.pi * s.f_start_hz, 2 * math.pi * s.f_stop_hz, s.duration_s
    c2 = 1 / (math.exp(s.c1) - 1)
    growth = math.exp(s.c1 * t / T)
    omega = w0 + c2 * (growth - 1) * (w1 - w0)
    phase = w0 * t + c2 * (w1 - w0) * (T / s.c1 * (growth - 1) - t)
    return math.sin(phase), omega / (2 * math.pi)


def _ardupilot(s: ExcitationSettings, t: float) -> tuple[float, float]:
    """Constant start frequency for two periods, then exponential to the stop frequency."""
    w0, constant_s = 2 * math.pi * s.f_start_hz, 2 / s.f_start_hz
    if t <= constant_s:
        return math.sin(w0 * (t - constant_s)), s.f_start_hz
    B = math.log(s.f_stop_hz / s.f_start_hz)
    span = s.duration_s - constant_s
    growth = math.exp(B * (t - constant_s) / span)
    return math.sin(w0 * span / B * (growth - 1)), s.f_start_hz * growth


def _window(s: ExcitationSettings, t: float) -> float:
    if t < s.fade_in_s:
        return 0.5 - 0.5 * math.cos(math.pi * t / s.fade_in_s)
    left = s.duration_s - t
    if left < s.fade_out_s:
        return 0.5 - 0.5 * math.cos(math.pi * left / s.fade_out_s)
    return 1.0


def _doublet(s: ExcitationSettings, t: float) -> float:
    pulse = int(t / s.pulse_s + 1e-9) % PULSES_PER_DOUBLET
    return (1.0, -1.0)[pulse] if pulse < 2 else 0.0
