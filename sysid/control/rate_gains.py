"""Better gains for an autopilot's own rate loops: the fastest within asked margins, near those that were flown.

Only P, I and D move, each by a factor of its own, and filters, angle gain and limits stay as flown. The feed-forward is
no feedback: it is set first, from how fast the vehicle turns for a command, and is in the loop that is judged, because
an angle that is held asks for rates.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np

from sysid.control.judgement import OF_DELAY
from sysid.control.regulator import DesignError
from sysid.control.sampled import SampledLoop, sampled_loop
from sysid.control.stability import SENSIBLE_GAIN_DB, SENSIBLE_MS, SENSIBLE_PHASE_DEG
from sysid.model.structure import Model
from sysid.rate_loop.settings import AxisLoop

MOST = 1.3
"""Of a flown gain: what one flight's model vouches for."""
STEP = MOST**0.5
LEAST_STEP = -16
"""About a tenth."""
MOST_STEP = 2
ROUNDS = 12
TUNED = ("p", "i", "d")
Loops = tuple[AxisLoop, AxisLoop]
Steps = tuple[int, ...]
"""Of p, i, d of roll, then of pitch: exponents of `STEP`."""


@dataclass(frozen=True, kw_only=True)
class Asked:
    """Margins that the new gains must have."""

    gain_db: float = SENSIBLE_GAIN_DB
    phase_deg: float = SENSIBLE_PHASE_DEG
    delay_ms: float = SENSIBLE_MS
    peak_db: float = 5.0
    """The most by which a disturbance of a rate may be raised, or what it was raised by in flight where that is more;
    ADS-33's of disturbance rejection."""

    def of(self, vehicle: Model, flown: SampledLoop) -> Asked:
        """With at least half of the delay that the model has, and as much of a peak as the loop that flew."""
        return replace(
            self,
            delay_ms=max(self.delay_ms, 1000 * OF_DELAY * vehicle.input_delay_s[0]),
            peak_db=max(self.peak_db, flown.peak_db if flown.held else 0.0),
        )

    def met(self, loop: SampledLoop) -> bool:
        return self.share(loop) >= 1

    def share(self, loop: SampledLoop) -> float:
        """Of what is asked, the part that the loop has where it has least; 1 and more where it has all."""
        margins = loop.margins
        if margins is None:
            return 0.0
        return min(
            margins.gain_db / self.gain_db,
            margins.phase_deg / self.phase_deg,
            margins.delay_ms / self.delay_ms,
            self.peak_db / max(loop.peak_db, 1e-9),
        )


@dataclass(frozen=True, eq=False, kw_only=True)
class RateGains:
    """The flown loops and new ones, both judged on one model."""

    flown: Loops
    new: Loops
    flown_loop: SampledLoop
    new_loop: SampledLoop
    asked: Asked
    dt: float


def faster(
    flown: Loops,
    dt: float,
    vehicle: Model,
    *,
    gyro_corner_hz: float = 0.0,
    feed_forward: Mapping[int, float] | None = None,
    asked: Asked | None = None,
) -> RateGains:
    """The gains of which disturbances of both rates are rejected up to the highest frequencies, within margins.

    `feed_forward`: by axis (0, 1), full command per rad/s; it is taken to at most `MOST` times the flown one. Raises
    DesignError where no gains near the flown ones have the margins, and NotSampledError as `sampled_plant` does.
    """
    as_flown = sampled_loop(flown, dt, vehicle, gyro_corner_hz)
    asked = (asked or Asked()).of(vehicle, as_flown)
    told = feed_forward or {}
    roll, pitch = (replace(loop, ff=min(MOST * loop.ff, told.get(axis, loop.ff))) for axis, loop in enumerate(flown))
    begun = (roll, pitch)
    known: dict[Steps, SampledLoop] = {}

    def judged(steps: Steps) -> SampledLoop:
        if steps not in known:
            known[steps] = sampled_loop(_scaled(begun, steps), dt, vehicle, gyro_corner_hz)
        return known[steps]

    def worth(steps: Steps) -> float:
        """Hz, geometric mean of both axes; without the margins negative, the more the more is short."""
        loop = judged(steps)
        share = asked.share(loop)
        return float(np.sqrt(np.prod(loop.rejection_hz))) if share >= 1 else share - 1

    alike: list[Steps] = [(step,) * 6 for step in range(MOST_STEP, LEAST_STEP - 1, -1)]
    best = max(alike, key=worth)
    for _ in range(ROUNDS):
        better = max([best, *_neighbours(best)], key=worth)
        if better == best:
            break
        best = better
    if worth(best) < 0:
        raise DesignError(_refusal(asked, as_flown))
    return RateGains(
        flown=flown,
        new=_scaled(begun, best),
        flown_loop=as_flown,
        new_loop=judged(best),
        asked=asked,
        dt=dt,
    )


def _neighbours(steps: Steps) -> Iterator[Steps]:
    """One factor moved, or the same one of both axes."""
    for way in (-2, -1, 1, 2):
        for at in range(6):
            for moved in ((at,), (at, (at + 3) % 6)):
                new = tuple(step + way if i in moved else step for i, step in enumerate(steps))
                if max(new) <= MOST_STEP and min(new) >= LEAST_STEP:
                    yield new


def _scaled(loops: Loops, steps: Steps) -> Loops:
    roll, pitch = (
        replace(loop, **{name: STEP**step * getattr(loop, name) for name, step in zip(TUNED, own, strict=True)})
        for loop, own in zip(loops, (steps[:3], steps[3:]), strict=True)
    )
    return roll, pitch


def _refusal(asked: Asked, flown: SampledLoop) -> str:
    has = (
        "the flown gains do not hold this model" if flown.margins is None else f"those flown have {flown.margins.words}"
    )
    return (
        f"no gains between {STEP**LEAST_STEP:.1f} and {MOST:g} times the flown ones have the margins asked for "
        f"({asked.gain_db:g} dB, {asked.phase_deg:g}°, {asked.delay_ms:.0f} ms, no disturbance by more than "
        f"{asked.peak_db:.1f} dB): {has}; less delay, higher filter "
        "corners or a lower angle gain come first, or the model is not the vehicle's: `tippath diagnose` it"
    )
