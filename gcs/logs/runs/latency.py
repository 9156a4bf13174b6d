"""How much later one message of a log shows the same quantity than another: what a fitted delay includes.

Two fields of the same quantity (a gyro rate straight from the sensor and the filtered one, a mixer's input and what
went to the motors) are laid over each other: the shift of largest correlation, between samples by a parabola. Which
fields mean the same is what the profiles of this kind of log say: every source they have for one channel.

Ignored: that a filter delays frequencies differently; the shift is that of the band where the run has its power.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache

import numpy as np

from gcs.logs.formats.tables import FloatArray, Log, Series
from gcs.logs.profile.expression import Expression
from gcs.logs.profile.mapping import ABSURD
from gcs.logs.profile.profiles import Profile, bundled_profiles
from gcs.logs.profile.sources import keys_of
from sysid.data.record import CYCLIC, RATES

SLOWEST_S = 1 / 25
"""A field that comes more seldom tells nothing about milliseconds."""
LONGEST_S = 0.15
"""No filter or message is later; beyond it the correlation of a slow sweep has its next peak."""
LONGEST_RUN_S = 120.0
BAND_HZ = (0.3, 15.0)
GRID_S = 0.002
ALIKE = 0.9
"""Correlation at the best shift below which the two fields are not the same quantity (another frame's motors)."""
LEAST = (0.002, 0.01)
"""Of full command, rad/s rms: below it the two fields share little more than the sensor's noise."""
WORTH_SAYING_S = 0.002
"""One sample at 500 Hz: less is time stamps."""


@dataclass(frozen=True)
class Latency:
    """One field against another of the same quantity."""

    field: str
    against: str
    late_s: float
    """Positive: `field` shows it later."""
    correlation: float
    """At that shift, -1..1."""

    @property
    def words(self) -> str:
        way = "later" if self.late_s > 0 else "earlier"
        return f"{self.field} is {1000 * abs(self.late_s):.1f} ms {way} than {self.against}"


def measure(
    log: Log,
    profile: Profile,
    sources: Mapping[str, str],
    excitation: Mapping[str, tuple[float, float]],
    at: tuple[float, float],
) -> tuple[Latency, ...]:
    """The fields of a run against others of the same quantity, on the axis that moves most.

    sources: channel -> field it was taken from; excitation: axis -> rms of (command, rate); at: start and stop, s.
    """
    start_s, stop_s = at[0], min(at[1], at[0] + LONGEST_RUN_S)
    measured = []
    for channels, place in ((RATES, 1), (CYCLIC, 0)):
        moved = {"roll": channels[0], "pitch": channels[1]}
        strength = {axis: excitation[axis][place] for axis in moved if axis in excitation}
        if not strength or max(strength.values()) < LEAST[place]:
            continue
        channel = moved[max(strength, key=lambda axis: strength[axis])]
        used = sources.get(channel)
        if used is None:
            continue
        for other in _others(log.kind, channel, profile):
            latency = _compare(log, used, other, start_s, stop_s)
            if latency is not None and abs(latency.late_s) >= WORTH_SAYING_S:
                measured.append(latency)
    return tuple(measured)


def _others(kind: str, channel: str, profile: Profile) -> tuple[str, ...]:
    own = profile.channels[channel].sources if channel in profile.channels else ()
    return tuple(dict.fromkeys((*own, *_bundled(kind, channel))))


@cache
def _bundled(kind: str, channel: str) -> tuple[str, ...]:
    """Every source of a channel in the profiles that come along."""
    sources: list[str] = []
    for profile in bundled_profiles():
        if profile.kind == kind and channel in profile.channels:
            sources += profile.channels[channel].sources
    return tuple(dict.fromkeys(sources))


def _compare(log: Log, used: str, other: str, start_s: float, stop_s: float) -> Latency | None:
    """None where they share their fields, one is missing, too slow, or not the same quantity."""
    ours, theirs = _on_its_clock(log, used, start_s, stop_s), _on_its_clock(log, other, start_s, stop_s)
    if ours is None or theirs is None or set(keys_of(used, log)) & set(keys_of(other, log)):
        return None
    shifted = shift(ours, theirs)
    return None if shifted is None or abs(shifted[1]) < ALIKE else Latency(other, used, *shifted)


def _on_its_clock(log: Log, text: str, start_s: float, stop_s: float) -> Series | None:
    """A field, or arithmetic on fields of one message."""
    keys = keys_of(text, log)
    if not keys or not all(log.has(key) for key in keys):
        return None
    parts = {key: log.series(key).part(start_s, stop_s) for key in keys}
    first = next(iter(parts.values()))
    if len({part.clock for part in parts.values()}) > 1 or first.t.size < 50 or first.spacing_s > SLOWEST_S:
        return None
    if log.has(text):
        return first
    values = Expression.parse(text).evaluate({key: part.values for key, part in parts.items()})
    return Series(first.t, np.broadcast_to(values, first.t.shape), first.clock)


def shift(ours: Series, theirs: Series) -> tuple[float, float] | None:
    """By how many s `theirs` is later than `ours`, and how alike they are then; None where that cannot be told."""
    low, high = max(ours.t[0], theirs.t[0]), min(ours.t[-1], theirs.t[-1])
    if high - low < 2.0:
        return None
    grid = np.arange(low, high, GRID_S)
    a, b = (_in_band(grid, series) for series in (ours, theirs))
    power = math.sqrt(float(np.sum(np.abs(a) ** 2) * np.sum(np.abs(b) ** 2)))
    if power == 0 or not math.isfinite(power):
        return None
    correlation = np.fft.irfft(a.conj() * b, grid.size) * grid.size / (2 * power)
    most = round(LONGEST_S / GRID_S)
    near = np.concatenate((correlation[-most:], correlation[: most + 1]))
    best = int(np.argmax(np.abs(near)))
    if best in (0, near.size - 1):
        return None
    below, here, above = (float(v) for v in near[best - 1 : best + 2])
    bend = below - 2 * here + above
    between = 0.5 * (below - above) / bend if bend else 0.0
    return (best - most + between) * GRID_S, here


def _in_band(grid: FloatArray, series: Series) -> FloatArray:
    """The spectrum of a field between the ends of the band, zero elsewhere."""
    good = np.isfinite(series.values) & (np.abs(series.values) < ABSURD)
    if np.count_nonzero(good) < 2:
        return np.zeros(grid.size // 2 + 1)
    values = np.interp(grid, series.t[good], series.values[good])
    spectrum = np.fft.rfft((values - values.mean()) * np.hanning(grid.size))
    hz = np.fft.rfftfreq(grid.size, GRID_S)
    spectrum[(hz < BAND_HZ[0]) | (hz > BAND_HZ[1])] = 0
    return np.asarray(spectrum)
