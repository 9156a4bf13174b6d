"""How the rates followed their commands in a maneuver with `target = "rate"`, from the vehicle's log.

Two numbers for each run: the correlation of the measured with the commanded rate at the lag that suits them best, and
how much of the command is reached once the answer has settled.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from gcs.errors import TippathError

if TYPE_CHECKING:
    from gcs.flight.run import RunResult

FloatArray = NDArray[np.float64]

MOST_LAG_S = 0.3
SETTLED_S = 0.25
"""After a step of the rate command its answer is taken for steady."""
FOLLOWS_CORRELATION = 0.8
FOLLOWS_SHARE = (0.75, 1.25)


@dataclass(frozen=True, slots=True)
class Following:
    """How one rate followed its command."""

    axis: str
    correlation: float
    """Of measured and commanded rate at the best lag."""
    lag_s: float
    steady_share: float
    """Measured over commanded once the answer has settled, each at the lag; 1 is perfect."""

    @property
    def follows(self) -> bool:
        low, high = FOLLOWS_SHARE
        return self.correlation >= FOLLOWS_CORRELATION and low <= self.steady_share <= high

    @property
    def words(self) -> str:
        return (
            f"{self.axis}: correlation {self.correlation:.2f} at a lag of {1000 * self.lag_s:.0f} ms, "
            f"steady {100 * self.steady_share:.0f} %" + ("" if self.follows else "   does not follow")
        )

    def to_json(self) -> dict[str, Any]:
        return {
            "axis": self.axis,
            "correlation": round(self.correlation, 4),
            "lag_s": round(self.lag_s, 4),
            "steady_share": round(self.steady_share, 4),
            "follows": self.follows,
        }


def measure_following(path: Path, flown: Sequence[RunResult]) -> list[Following]:
    """How the rates followed in those of the runs that were commanded as rates. Raises TippathError without samples."""
    # reading logs: only where one was flown
    from gcs.logs.formats import dataflash
    from gcs.logs.formats.dataflash_table import DataFlashTables

    runs = [result for result in flown if result.run.maneuver.target == "rate"]
    log = DataFlashTables(dataflash.read(path).boots[-1], str(path)) if runs else None
    found = []
    for result in runs:
        assert log is not None
        maneuver, label = result.run.maneuver, result.run.label
        letter = {"roll": "R", "pitch": "P"}.get(maneuver.axis)
        fields = (f"RATE.{letter}Des", f"RATE.{letter}", "SIDD.Targ")
        if letter is None or result.log_start_s is None or not all(log.has(field) for field in fields):
            raise TippathError(f"{label}: no samples of the commanded rate in {path}")
        start = result.log_start_s + result.plan.lead_s
        commanded, measured, target = (log.series(field).part(start, start + maneuver.duration_s) for field in fields)
        if commanded.t.size < 100 or target.t.size < 100:
            raise TippathError(f"{label}: no samples of the commanded rate in {path}")
        pulse = np.interp(commanded.t, target.t, target.values)
        found.append(following(maneuver.axis, commanded.t, commanded.values, measured.values, pulse))
    return found


def following(axis: str, t: FloatArray, commanded: FloatArray, measured: FloatArray, pulse: FloatArray) -> Following:
    """How `measured` follows `commanded`: rates of one unit at times t, all of shape (n,).

    `pulse` is what the maneuver adds to the command; where it has been constant and not zero for `SETTLED_S`, the
    answer counts as steady.
    """
    dt = float(np.median(np.diff(t)))
    best, lag = -1.0, 0
    for shift in range(round(MOST_LAG_S / dt) + 1):
        a, b = commanded[: commanded.size - shift], measured[shift:]
        spread = float(a.std() * b.std())
        r = float(((a - a.mean()) * (b - b.mean())).mean() / spread) if spread > 0 else 0.0
        if r > best:
            best, lag = r, shift
    n = round(SETTLED_S / dt)
    steady = np.zeros(t.size, dtype=bool)
    # Constant over the last n samples: no step inside them.
    steps = np.concatenate(([0], np.cumsum(np.abs(np.diff(pulse)) > 1e-6)))
    steady[n:] = (steps[n:] == steps[:-n]) & (pulse[n:] != 0)
    # The command itself moves on while the answer comes: compare each answer with what it answers to.
    steady[t.size - lag :] = False
    at = np.flatnonzero(steady)
    power = float((commanded[at] ** 2).sum())
    share = float((commanded[at] * measured[at + lag]).sum() / power) if power > 0 else 0.0
    return Following(axis, best, lag * dt, share)
