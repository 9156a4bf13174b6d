"""The rate controller of one axis as ArduPilot 4.5 and later computes it: its settings, and what its filters are.

Facts of its documentation and source (AC_PID, AC_HELI_PID, AP_Filter; Copter 4.5 to 4.7-dev), in our own words. In
every loop of length dt, with the target r and the measured rate p, in rad/s:

    T  <- T + a(f_T) (notch_T(r) - T)            target, low-passed
    E  <- E + a(f_E) (notch_E(T - p) - E)        error, low-passed
    D  <- D + a(f_D) ((E - E_before) / dt - D)   its derivative, low-passed
    I  <- leak(I), then I + K_I dt E, held to +-IMAX; while the output is limited it may only shrink
    u  =  K_P E + K_D D, held to +-PDMX, + I + K_FF T + K_DFF (T - T_before) / dt

with a(f) = dt / (dt + 1 / (2 pi f)), and 1 where f is 0. A helicopter's integrator leaks by a fiftieth a loop of what
it is beyond ILMI, unless it flies fast. The gains are of full command per rad/s.
"""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass
from typing import Any

LEAK = 0.02
"""Part of what the integrator is beyond ILMI that a helicopter's loses in every loop, whatever the loop's length."""


@dataclass(frozen=True, kw_only=True)
class Notch:
    """A notch of second order."""

    frequency_hz: float
    quality: float
    attenuation_db: float

    def coefficients(self, dt: float) -> tuple[tuple[float, float, float], tuple[float, float]]:
        """(b0, b1, b2), (a1, a2) of y = b0 x + b1 x_1 + b2 x_2 - a1 y_1 - a2 y_2 in loops of dt seconds."""
        w = 2 * math.pi * self.frequency_hz * dt
        width = math.sin(w) / (2 * self.quality)
        left = width * 10 ** (-self.attenuation_db / 20)
        whole = 1 + width
        middle = -2 * math.cos(w) / whole
        return ((1 + left) / whole, middle, (1 - left) / whole), (middle, (1 - width) / whole)


@dataclass(frozen=True, kw_only=True)
class AxisLoop:
    """Settings of one axis. Full command per rad/s, per rad (I) and per rad/s^2 (D, D_FF)."""

    p: float
    i: float
    d: float
    ff: float = 0.0
    d_ff: float = 0.0
    i_max: float = math.inf
    leak_min: float | None = None
    """Beyond it the integrator leaks; None where it does not."""
    pd_max: float = math.inf
    target_hz: float = 0.0
    """Corners of the low-passes; 0 for none."""
    error_hz: float = 0.0
    derivative_hz: float = 0.0
    target_notch: Notch | None = None
    error_notch: Notch | None = None
    angle_p: float = 0.0
    """1/s: rate asked for per rad of attitude error; 0 where the pilot asks for rates."""
    output_max: float = math.inf
    """To which feedback, feed-forward and what is injected together are held."""

    def to_json(self) -> dict[str, Any]:
        """By names; limits that are none are left out."""
        return {name: value for name, value in asdict(self).items() if value != math.inf}


def low_pass(dt: float, corner_hz: float) -> float:
    """The part of a new value that a low-pass takes over in a loop of dt seconds."""
    return 1.0 if corner_hz <= 0 else dt / (dt + 1 / (2 * math.pi * corner_hz))
