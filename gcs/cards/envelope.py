"""The limits a maneuver must stay within: what was seen, in percent of them, and what broke them.

Pure. Peaks are taken from the vehicle's own samples where its log arrives live, and from telemetry otherwise. A value
that is not known is None and can break no limit; the link's age makes up for it, because silence is itself a violation.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from gcs.link.clock import LOST_AFTER_S

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Limits:
    """Beyond any of these a maneuver is ended. The defaults suit a small helicopter in hover."""

    rate: float = 3.0
    """rad/s, of p and q each, and of r in a maneuver on yaw."""
    attitude: float = math.radians(25.0)
    """rad, of roll and pitch each."""
    command: float = 0.9
    """Of full cyclic command, excitation, feedback and trim together: at 1 the servo would clip the excitation."""
    link_age_s: float = LOST_AFTER_S
    """Nothing heard for this long."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Peaks:
    """The largest absolute values so far; None where nothing was known."""

    p: float | None = None
    """rad/s."""
    q: float | None = None
    r: float | None = None
    """Of a maneuver on yaw only."""
    roll: float | None = None
    """rad."""
    pitch: float | None = None
    delta_x: float | None = None
    """-1..1."""
    delta_y: float | None = None

    def with_samples(self, p: FloatArray, q: FloatArray, delta_x: FloatArray, delta_y: FloatArray) -> Peaks:
        """With samples of the log, each of shape (n,)."""
        return replace(
            self,
            p=_larger(self.p, _peak(p)),
            q=_larger(self.q, _peak(q)),
            delta_x=_larger(self.delta_x, _peak(delta_x)),
            delta_y=_larger(self.delta_y, _peak(delta_y)),
        )

    def with_telemetry(
        self,
        p: float | None = None,
        q: float | None = None,
        roll: float | None = None,
        pitch: float | None = None,
        r: float | None = None,
    ) -> Peaks:
        """With one message's rates (rad/s) and attitude (rad)."""
        return replace(
            self,
            p=_larger(self.p, p),
            q=_larger(self.q, q),
            r=_larger(self.r, r),
            roll=_larger(self.roll, roll),
            pitch=_larger(self.pitch, pitch),
        )

    @property
    def rate(self) -> float | None:
        return _larger(_larger(self.p, self.q), self.r)

    @property
    def attitude(self) -> float | None:
        return _larger(self.roll, self.pitch)

    @property
    def command(self) -> float | None:
        return _larger(self.delta_x, self.delta_y)


@dataclass(frozen=True, slots=True)
class Use:
    """How much of the envelope was used, in percent of each limit; None where not known."""

    rate: float | None
    attitude: float | None
    command: float | None
    link: float | None = None

    @property
    def largest(self) -> float:
        return max((x for x in (self.rate, self.attitude, self.command) if x is not None), default=0.0)

    def to_json(self) -> dict[str, float | None]:
        def rounded(x: float | None) -> float | None:
            return None if x is None else round(x, 1)

        return {"rate": rounded(self.rate), "attitude": rounded(self.attitude), "command": rounded(self.command)}


def use(limits: Limits, peaks: Peaks, link_age_s: float | None = None) -> Use:
    """The share of each limit that the peaks reached, in percent."""
    return Use(
        _percent(peaks.rate, limits.rate),
        _percent(peaks.attitude, limits.attitude),
        _percent(peaks.command, limits.command),
        _percent(link_age_s, limits.link_age_s),
    )


def violations(limits: Limits, peaks: Peaks, link_age_s: float | None = None) -> tuple[str, ...]:
    """What is beyond its limit, in words; empty inside the envelope."""
    broken = []
    rates = (("p", peaks.p), ("q", peaks.q), ("r", peaks.r))
    broken += [
        f"{name} {value:.2f} rad/s is beyond {limits.rate:.2f}"
        for name, value in rates
        if value is not None and value > limits.rate
    ]
    attitudes = (("roll", peaks.roll), ("pitch", peaks.pitch))
    broken += [
        f"{name} {math.degrees(value):.1f}° is beyond {math.degrees(limits.attitude):.1f}°"
        for name, value in attitudes
        if value is not None and value > limits.attitude
    ]
    commands = (("delta_x", peaks.delta_x), ("delta_y", peaks.delta_y))
    broken += [
        f"{name} {value:.2f} is beyond {limits.command:.2f} of full command"
        for name, value in commands
        if value is not None and value > limits.command
    ]
    if link_age_s is not None and link_age_s > limits.link_age_s:
        broken.append(f"nothing heard for {link_age_s:.1f} s")
    return tuple(broken)


def _percent(value: float | None, limit: float) -> float | None:
    return None if value is None else 100.0 * value / limit


def _peak(values: FloatArray) -> float | None:
    known = np.abs(values[np.isfinite(values)])
    return float(known.max()) if known.size else None


def _larger(a: float | None, b: float | None) -> float | None:
    known = [abs(x) for x in (a, b) if x is not None and math.isfinite(x)]
    return max(known, default=None)
