"""Chirps in a command, found by its spectrum over time.

A chirp is the only thing a vehicle's commands ever do that keeps nearly all power at one frequency while that frequency
moves one way over octaves: gusts, pilots and limit cycles spread their power or keep their frequency. The commands are
seen through wavelets of `CYCLES` per standard deviation; where the strongest frequency holds most of the power and goes
one way, there is a chirp.

What does not show: frequencies that a sweep passes within a second or while it is still faded. The low end of a linear
sweep, and both ends of a short one with long fades, are found too narrow.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from gcs.logs.formats.tables import FloatArray

GRID_HZ = 48.0
"""What the commands are averaged to: chirps of rotorcraft end at 10 to 15 Hz."""
HOP = 12
"""Grid samples from one look to the next: 0.25 s, an eighth of an octave of the fastest usual sweep."""
LOWEST_HZ, HIGHEST_HZ = 0.25, 20.0
PER_OCTAVE = 10
CYCLES = 4.0
"""Centre frequency over the wavelet's bandwidth (both as standard deviations): 1.3 s long at 0.5 Hz."""
REACH = 4.0
"""Standard deviations of the wavelet's bandwidth beyond which nothing is left of it."""
RIDGE_OCTAVES = 0.5
"""Half the width of the ridge: all of a sine's power at this bandwidth, 0.95 with the noise of Table 1."""
DOMINANT = 0.65
"""Share of the power on the ridge. Sweeps with noise, gusts and feedback have 0.8 and more, pilots 0.3 to 0.9."""
MEAN_DOMINANT = 0.75
INTERRUPTED_S = 1.0
"""A ridge may be lost so long, in a gust."""
BACK_OCTAVES = 0.25
"""The ridge may go back by so much, as noise makes it."""
JUMP_OCTAVES = 0.75
"""And on by no more from look to look, 3 octaves per second."""
OCTAVES = math.log2(3.0)
"""A chirp covers at least a factor 3; less is a controller that changes its mind."""
ONE_WAY = 0.75
"""Net change over the whole way of the ridge. A pilot's wandering frequency has 0.5 at most over 4 s."""
SHORTEST_S = 4.0
SMOOTH = 0.12
"""Octaves rms off a smooth sweep: sweeps under Table 1's noise have 0.02 to 0.1, frequencies that wander 0.1 to 0.2."""
LEAST = 0.005
"""Of full command, at the strongest: less excites nothing."""
HELD = 0.8
"""Share of the looks of a chirp that are on its ridge."""
EDGE_OCTAVES = 0.4
EDGE_CYCLES = (0.5, 2.0, 5.0)
"""Periods that a sine is fitted to there: after the beginning, and after the ridge is believed, at least; at most."""
EDGE_FACTORS = (0.85, 0.9, 0.95, 1.0, 1.05, 1.1, 1.15)
EDGE_FADES_S = (0.0, 1.0, 2.0, 3.5, 5.0, 8.0)
"""Cosine fades tried."""
FADE_PRICE = 0.995
"""A fade must explain so much more: else every beginning is a little earlier and faded."""
UNSEEN = 0.05
"""Of a fade: its beginning is somewhere in twice that, where its amplitude is below 2.5 %."""
EDGE_FLOOR = 0.05
"""Of the strength at the edge, see `_edge`."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Sweep:
    """A chirp in a command."""

    start_s: float
    stop_s: float
    band_hz: tuple[float, float]
    times: FloatArray
    frequency_hz: FloatArray
    """Of the ridge, shape of `times`."""
    high_power: float
    """Mean power in the third of the time at the highest frequencies."""


def sweeps_in(t: FloatArray, values: FloatArray) -> list[Sweep]:
    """The chirps of a command, shape (n,) as its times."""
    grid, x, known = _gridded(t, values)
    spacing = float(np.median(np.diff(t)))
    frequency = _frequencies(min(HIGHEST_HZ, 0.4 / spacing))
    if frequency.size < PER_OCTAVE * OCTAVES or x.size < HOP * 8 or np.ptp(x) == 0:
        return []
    power = _wavelet_power(x, frequency)
    times = grid[0] + np.arange(power.shape[1]) * HOP / GRID_HZ
    best = np.argmax(power, axis=0)
    half = round(RIDGE_OCTAVES * PER_OCTAVE)
    added = np.concatenate((np.zeros((1, times.size)), np.cumsum(power, axis=0)))
    look = np.arange(times.size)
    on = added[np.minimum(best + half + 1, frequency.size), look] - added[np.maximum(best - half, 0), look]
    dominance = on / np.maximum(added[-1], np.finfo(np.float64).tiny)
    inside = (best > 0) & (best < frequency.size - 1)
    good = (dominance >= DOMINANT) & inside & known[look * HOP]
    octave = np.log2(_between_bins(frequency, power, best))
    ridge = _Ridge(grid=grid, x=x, times=times, strength=np.sqrt(power.max(axis=0)), octave=octave)
    sweeps = []
    for sign in (1.0, -1.0):
        for chain in _one_way(sign * octave, good):
            clear = float(np.mean(dominance[chain[0] : chain[-1] + 1])) >= MEAN_DOMINANT
            if clear and float(power[:, chain].max()) >= LEAST**2:
                sweep = _measured(ridge, chain)
                sweeps += [] if sweep is None else [sweep]
    return sweeps


def _gridded(t: FloatArray, values: FloatArray) -> tuple[FloatArray, FloatArray, NDArray[np.bool_]]:
    """Means over the cells of a uniform grid, straight lines between, and where there was something to average."""
    count = max(1, int((t[-1] - t[0]) * GRID_HZ))
    cell = np.minimum(((t - t[0]) * GRID_HZ).astype(np.int64), count - 1)
    samples = np.bincount(cell, minlength=count)
    held = samples > 0
    grid = t[0] + (np.arange(count) + 0.5) / GRID_HZ
    sums = np.bincount(cell, values, minlength=count)
    x = np.interp(grid, grid[held], sums[held] / samples[held])
    # Unknown where the nearest sample is further than the highest frequency that the log can show allows.
    allowed = max(2, round(2 * float(np.median(np.diff(t))) * GRID_HZ))
    places = np.flatnonzero(held)
    nearest = np.searchsorted(places, np.arange(count))
    ahead = places[np.minimum(nearest, places.size - 1)] - np.arange(count)
    behind = np.arange(count) - places[np.maximum(nearest - 1, 0)]
    return grid, x, np.minimum(np.abs(ahead), np.abs(behind)) <= allowed


def _frequencies(highest_hz: float) -> FloatArray:
    count = max(0, math.floor(PER_OCTAVE * math.log2(max(highest_hz, LOWEST_HZ) / LOWEST_HZ)) + 1)
    return np.asarray(LOWEST_HZ * 2 ** (np.arange(count) / PER_OCTAVE))


def _wavelet_power(x: FloatArray, frequency_hz: FloatArray) -> FloatArray:
    """Power around each frequency at every look, shape (frequencies, looks); a sine of amplitude A has A^2 on top.

    Every look of a wavelet is needed, but no sample between: the spectrum is folded to the looks' rate before it is
    transformed back, which gives the same numbers.
    """
    looks = math.ceil((x.size + 4 * GRID_HZ) / HOP)  # what lies beyond the end must not come in at the start
    n = looks * HOP
    spectrum = np.fft.rfft(x - x.mean(), n)
    hz_per_bin = GRID_HZ / n
    power = np.empty((frequency_hz.size, x.size // HOP))
    for row, centre in enumerate(frequency_hz.tolist()):
        width = centre / CYCLES
        low = max(1, math.floor((centre - REACH * width) / hz_per_bin)) // looks * looks
        high = min(spectrum.size, math.ceil((centre + REACH * width) / hz_per_bin) + 1)
        f = np.arange(low, high) * hz_per_bin
        seen = spectrum[low:high] * np.exp(-0.5 * ((f - centre) / width) ** 2)
        if low == 0:
            seen[0] = 0.0
        folded = np.pad(seen, (0, -seen.size % looks)).reshape(-1, looks).sum(axis=0)
        power[row] = np.abs(2 / HOP * np.fft.ifft(folded)[: power.shape[1]]) ** 2
    return power


def _between_bins(frequency_hz: FloatArray, power: FloatArray, best: NDArray[np.intp]) -> FloatArray:
    """The ridge's frequency by a parabola through the logarithms of the power at the best bin and its neighbours."""
    at = np.clip(best, 1, frequency_hz.size - 2)
    look = np.arange(best.size)
    below, here, above = (np.log(np.maximum(power[at + k, look], 1e-300)) for k in (-1, 0, 1))
    bend = below - 2 * here + above
    shift = np.where(bend < 0, 0.5 * (below - above) / np.where(bend < 0, bend, 1.0), 0.0)
    return np.asarray(frequency_hz[at] * 2 ** (np.clip(shift, -0.5, 0.5) / PER_OCTAVE))


def _one_way(octave: FloatArray, good: NDArray[np.bool_]) -> list[list[int]]:
    """The looks of each stretch in which the ridge rises far enough; what leaves the ridge is passed over for a while.

    Shape of both: (looks,).
    """
    patience = round(INTERRUPTED_S * GRID_HZ / HOP)
    looks = np.flatnonzero(good).tolist()
    stretches: list[list[int]] = []
    at = 0
    while at < len(looks):
        chain = [looks[at]]
        top = float(octave[chain[0]])
        place = at
        for i in range(at + 1, len(looks)):
            look = looks[i]
            waited = look - chain[-1]
            if waited > patience:
                break
            if -BACK_OCTAVES <= octave[look] - top <= JUMP_OCTAVES * min(waited, 2):
                chain.append(look)
                top = max(top, float(octave[look]))
                place = i
        if _far_enough(octave, chain):
            stretches.append(chain)
            at = place + 1
        else:
            at += 1 if len(chain) < 2 else max(1, (place - at) // 2)
    return stretches


def _far_enough(octave: FloatArray, chain: list[int]) -> bool:
    if len(chain) < SHORTEST_S * GRID_HZ / HOP:
        return False
    way = octave[chain]
    whole = float(np.abs(np.diff(way[:: round(GRID_HZ / HOP)])).sum())  # second by second: noise is no way back
    net = float(way[-1] - way[0])
    if net < OCTAVES or net < ONE_WAY * whole or len(chain) < HELD * (chain[-1] - chain[0] + 1):
        return False
    return _roughness(np.asarray(chain), way) <= SMOOTH


def _roughness(looks: NDArray[np.int64], way: FloatArray) -> float:
    """Octaves rms from the better of two smooth sweeps: a cubic in octaves or a quadratic in Hz."""
    place = (looks - looks[0]) / (looks[-1] - looks[0])
    hz = 2**way
    in_octaves = way - np.polynomial.Polynomial.fit(place, way, 3)(place)
    straight = np.polynomial.Polynomial.fit(place, hz, 2)(place)
    in_hz = way - np.log2(np.maximum(straight, 2.0**-6))
    return min(float(np.sqrt(np.mean(off**2))) for off in (in_octaves, in_hz))


@dataclass(frozen=True, eq=False)
class _Ridge:
    """The strongest frequency of a command over time."""

    grid: FloatArray
    """Times of the samples, (n,)."""
    x: FloatArray
    """The samples, (n,)."""
    times: FloatArray
    """Of the looks, (looks,)."""
    octave: FloatArray
    """Base-2 logarithm of the frequency, (looks,)."""
    strength: FloatArray
    """Amplitude, (looks,)."""

    def part(self, chain: list[int]) -> _Ridge:
        """At some of the looks."""
        return replace(self, times=self.times[chain], octave=self.octave[chain], strength=self.strength[chain])

    @property
    def backwards(self) -> _Ridge:
        """With time running back, so that its end becomes its beginning."""
        return _Ridge(-self.grid[::-1], self.x[::-1], -self.times[::-1], self.octave[::-1], self.strength[::-1])


def _measured(ridge: _Ridge, chain: list[int]) -> Sweep | None:
    """The sweep of some of the looks; None where too few lie between its edges."""
    start, start_hz = _edge(ridge.part(chain))
    stop, stop_hz = _edge(ridge.part(chain).backwards)
    stop = -stop
    inside = np.asarray(chain)[(ridge.times[chain] >= start) & (ridge.times[chain] <= stop)]
    if inside.size < SHORTEST_S * GRID_HZ / HOP / 2:
        return None
    highest = inside[np.argsort(ridge.octave[inside])[-max(1, inside.size // 3) :]]
    # At high frequency the ridge is sharp; at low the wavelets see late what the fit to the edge gives a little high.
    hz = 2 ** ridge.octave[inside]
    band = (math.sqrt(min(start_hz, stop_hz) * float(hz.min())), float(hz.max()))
    return Sweep(
        start_s=start,
        stop_s=stop,
        band_hz=band,
        times=ridge.times[inside],
        frequency_hz=np.clip(hz, *band),
        high_power=float(np.mean(ridge.strength[highest] ** 2)),
    )


def _edge(ridge: _Ridge) -> tuple[float, float]:
    """When the sweep began, and its frequency there: where a sine fading in from then on explains most of the samples.

    The wavelets smear the beginning over a second or two and show too low a frequency there.
    """
    times, octave, strength = ridge.times, ridge.octave, ridge.strength
    # The ridge is believed from where it is half as strong as soon after.
    ahead = [1 + round(3 * GRID_HZ / HOP / hz) for hz in (2**octave).tolist()]
    soon = np.array([float(strength[i : i + n].max()) for i, n in enumerate(ahead)])
    anchor = int(np.argmax(strength >= 0.5 * soon))
    hz = 2 ** float(np.median(octave[anchor : anchor + 3]))
    stays = anchor
    while stays + 1 < times.size and (
        abs(octave[stays + 1] - octave[anchor]) < EDGE_OCTAVES or times[stays + 1] < times[anchor] + EDGE_CYCLES[1] / hz
    ):
        stays += 1
    low = max(float(ridge.grid[0]), min(float(times[0]), float(times[anchor]) - 3 / hz) - 1.0)
    high = min(float(times[stays]), float(times[anchor]) + EDGE_CYCLES[2] / hz)
    part = slice(int(np.searchsorted(ridge.grid, low)), int(np.searchsorted(ridge.grid, high)))
    t, y = ridge.grid[part], ridge.x[part]
    if t.size < 8:
        return float(times[0]), hz
    y = y - float(np.median(y))
    # A sweep whose strength grows or falls on its way is seen as one of even strength.
    y = y / np.maximum(np.interp(t, times, soon), EDGE_FLOOR * float(soon[anchor : stays + 1].max()))
    latest = min(float(times[anchor]) + 1 / hz, high - EDGE_CYCLES[0] / hz)
    coarse = 0.1 / hz
    begins = np.arange(low, max(low, latest) + coarse, coarse)
    best = _Beginning(-math.inf, float(times[0]), 1.0, 0.0, np.empty((2, 0)))
    for factor in EDGE_FACTORS:
        frequency = np.maximum(np.interp(t, times, 2**octave), factor * hz)
        frequency[t < times[anchor]] = factor * hz
        phase = 2 * math.pi * np.concatenate(([0.0], np.cumsum(frequency[:-1] * np.diff(t))))
        waves = np.stack([np.sin(phase), np.cos(phase)])
        for fade in EDGE_FADES_S:
            if 0 < fade < 1 / hz:
                continue
            explained = _explained(t, y, waves, begins, fade)
            at = int(np.argmax(explained))
            value = float(explained[at]) * (1.0 if fade == 0 else FADE_PRICE)
            if value > best.explained:
                best = _Beginning(value, float(begins[at]), factor, fade, waves)
    begins = best.t + coarse * np.linspace(-1, 1, 21)
    begin = float(begins[int(np.argmax(_explained(t, y, best.waves, begins, best.fade_s)))])
    return begin + UNSEEN * best.fade_s, best.factor * hz


@dataclass(frozen=True, eq=False)
class _Beginning:
    """Where a sine fades in."""

    explained: float
    t: float
    factor: float
    """Its frequency over the ridge's."""
    fade_s: float
    waves: FloatArray


def _explained(t: FloatArray, y: FloatArray, waves: FloatArray, begins: FloatArray, fade: float) -> FloatArray:
    """Power of y (n,) that a sine and a cosine (2, n), begun at each of `begins` (b,), explain; (b,)."""
    since = t - begins[:, None]
    gain = (since > 0).astype(np.float64)
    if fade:
        gain *= 0.5 - 0.5 * np.cos(math.pi * np.clip(since / fade, 0, 1))
    rows = waves * gain[:, None, :]
    inner = rows @ rows.transpose(0, 2, 1)
    seen = rows @ y
    inner += 1e-9 * (1e-30 + np.trace(inner, axis1=1, axis2=2))[:, None, None] * np.eye(2)
    return np.asarray(np.sum(seen * np.linalg.solve(inner, seen[:, :, None])[:, :, 0], axis=1))
