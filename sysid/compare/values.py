"""What a comparison found, as values: the error of each axis divided in several ways, beside what noise allows.

Every division adds up to one for each axis, so that shares may be set beside each other.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from sysid.compare.finding_kinds import Finding, Suspicion
from sysid.compare.metrics import Mismatch
from sysid.data.preprocess import ComplexArray
from sysid.fit.result import finite
from sysid.model.structure import FloatArray
from sysid.response.values import BoolArray

GROWTH_RATIO = 1.4
"""Between the smallest and the largest amplitude."""
GROWTH_LEAST = 1.15
GROWTH_ERRORS = 3.0


@dataclass(frozen=True, kw_only=True)
class BandError:
    """One axis's error in a band of frequency."""

    axis: str
    low_hz: float
    high_hz: float
    error_share: float
    """Of the axis's error; the bands of an axis add up to 1."""
    noise_share: float | None
    """Of this band's error."""
    coherence: Mapping[str, float]
    """Command -> share of this band's error that it alone explains."""
    coherence_together: float
    """Share that all commands together explain."""

    @property
    def beyond_noise(self) -> float:
        """Share of the axis's error that sits here and is not noise, as far as that is known."""
        return self.error_share * (1 - (self.noise_share or 0.0))

    def to_json(self) -> dict[str, Any]:
        return asdict(self)


@dataclass(frozen=True)
class WindowError:
    """One axis's error in a window of a run."""

    axis: str
    run: str
    start_s: float
    """In the log's own time."""
    stop_s: float
    error_share: float
    """The windows of all runs add up to 1 for each axis."""


@dataclass(frozen=True, kw_only=True)
class LevelError:
    """One axis's error while a channel was between two values; the levels of a channel hold like numbers of samples."""

    axis: str
    channel: str
    low: float
    high: float
    time_share: float
    error_share: float


@dataclass(frozen=True, kw_only=True)
class RunError:
    """One run's part of the error."""

    id: str
    maneuver: str
    axis: str | None
    duration_s: float
    nrmse_percent: Mapping[str, float]
    error_share: Mapping[str, float]
    """By output; the runs add up to 1."""
    noise_share: Mapping[str, float] | None
    """Of the run's own error; None where it is too short to tell."""
    command_rms: Mapping[str, float]
    conditions: Mapping[str, float]
    """Mean omega, airspeed where logged."""

    def to_json(self) -> dict[str, Any]:
        return {
            "id": self.id,
            "maneuver": self.maneuver,
            "axis": self.axis,
            "duration_s": self.duration_s,
            "nrmse_percent": {name: finite(x) for name, x in self.nrmse_percent.items()},
            "error_share": dict(self.error_share),
            "noise_share": None if self.noise_share is None else dict(self.noise_share),
            "command_rms": dict(self.command_rms),
            "conditions": dict(self.conditions),
        }


@dataclass(frozen=True, kw_only=True)
class Growth:
    """How the noise-free error of one output grows with one command's amplitude."""

    axis: str
    command: str
    at_least: bool
    """In the smallest motion no error is seen: `per_doubling` is a lower bound."""
    low: float
    high: float
    """Root mean squares of the command, smallest and largest."""
    per_doubling: float
    """Beyond the linear: 1 where the error is proportional to the command."""
    standard_error: float
    """Of the logarithm of `per_doubling`."""
    changes: float
    """Share of the error that goes away when the response may differ between amplitudes."""

    @property
    def significant(self) -> bool:
        """Beyond its standard errors, and enough to matter."""
        log = float(np.log(self.per_doubling))
        known = log if self.at_least else abs(log)
        return known > max(GROWTH_ERRORS * self.standard_error, float(np.log(GROWTH_LEAST)))

    def to_json(self) -> dict[str, Any]:
        return {**asdict(self), "significant": self.significant}


@dataclass(frozen=True, kw_only=True)
class Trend:
    """How one axis's error goes with a flight condition, repeats of a maneuver set beside each other in time.

    Within one run the condition's drift and the sweep's frequency cannot be told apart.
    """

    axis: str
    channel: str
    low: float
    high: float
    factor: float
    """Of the error's power from `low` to `high`."""
    correlation: float
    significant: bool


@dataclass(frozen=True, eq=False, kw_only=True)
class ResponseError:
    """A model's response to one command less the measured one, at every frequency that the runs tell of."""

    mismatch: Mismatch
    """Where the coherence is good, with the engineers' cost."""
    frequency_hz: FloatArray
    """(f,)"""
    decibels: FloatArray
    """(f,), NaN where the runs tell nothing."""
    degrees: FloatArray
    """(f,)"""
    allowed_db: FloatArray
    """(f,), what noise allows at three standard errors; NaN where it allows anything."""
    allowed_deg: FloatArray
    """(f,)"""
    noticed: tuple[tuple[float, float], ...]
    """Bands in Hz where the difference lies above what noise allows."""
    measured: ComplexArray
    """(f,), the measured response, rad/s per unit of command; NaN where the runs tell nothing."""

    @property
    def modelled(self) -> ComplexArray:
        """(f,), the model's, measured in the same way."""
        return np.asarray(self.measured * 10 ** (self.decibels / 20) * np.exp(1j * np.radians(self.degrees)))

    @property
    def off(self) -> FloatArray:
        """(f,), how far the model's response is from the measured one, in its unit."""
        return np.abs(self.modelled - self.measured)

    @property
    def outside(self) -> BoolArray:
        """(f,), within the bands where the difference lies above what noise allows, and is a number."""
        inside = [(self.frequency_hz >= low) & (self.frequency_hz <= high) for low, high in self.noticed]
        return np.any(inside, axis=0) & np.isfinite(self.off) if inside else np.zeros(self.off.shape, dtype=bool)

    def to_json(self) -> dict[str, Any]:
        return {**self.mismatch.to_json(), "noticed_hz": [list(band) for band in self.noticed]}


@dataclass(frozen=True, eq=False)
class Trace:
    """One gap-free part of a run in time, inside the band, trims and end states taken out."""

    run: str
    t: FloatArray
    """(n,), the log's own time."""
    measured: FloatArray
    """(k, n), rad/s."""
    residual: FloatArray
    """(k, n)"""
    commands: Mapping[str, FloatArray]
    """Name -> (n,), as recorded inside the band, -1..1."""

    @property
    def modelled(self) -> FloatArray:
        return self.measured - self.residual


@dataclass(frozen=True, eq=False)
class Densities:
    """Spectra, one-sided, in rad/s per root Hz; (w, k) each."""

    frequency_hz: FloatArray
    """(w,)"""
    measured: FloatArray
    residual: FloatArray
    noise: FloatArray


@dataclass(frozen=True, eq=False, kw_only=True)
class Comparison:
    """A model beside the measurement, and where the two part."""

    outputs: tuple[str, ...]
    commands: tuple[str, ...]
    references: tuple[str, ...]
    band_hz: tuple[float, float]
    nrmse_percent: Mapping[str, float]
    noise_share: Mapping[str, float] | None
    """Of the error; None where the runs are too short to tell."""
    noise_floor_percent: Mapping[str, float] | None
    """NRMSE that a model which leaves nothing but noise would reach."""
    noise_share_is: str
    noise_from: str
    """`quiet hover`, `logged excitation` or `commands`: the best source there was."""
    quiet_ratio: Mapping[str, float] | None
    """Noise in quiet hover over what the commands leave unexplained."""
    distortion: Mapping[str, float]
    """Share of the error that is neither as in quiet hover nor linear in the commands."""
    more: Mapping[str, bool]
    """Whether there is more than noise on each axis."""
    explained: bool | None
    """Whether there is more than noise, at 1 %; None where the runs are too short to tell."""
    bands: tuple[BandError, ...]
    windows: tuple[WindowError, ...]
    levels: tuple[LevelError, ...]
    """By amplitude of own command and own rate."""
    conditions: tuple[LevelError, ...]
    """By rotor speed and airspeed, where they varied."""
    trends: tuple[Trend, ...]
    runs: tuple[RunError, ...]
    growth: tuple[Growth, ...]
    controls: Mapping[str, Mapping[str, float]]
    """Other logged controls -> output -> share of the error that they explain beyond the commands."""
    responses: tuple[ResponseError, ...]
    densities: Densities
    traces: tuple[Trace, ...]
    suspicions: tuple[Suspicion, ...]
    remarks: tuple[str, ...]
    """What was dropped or mended on the way."""
    findings: tuple[Finding, ...]
    """Mistakes in the data first, then the worst axis first."""
