"""Maneuvers found by their excitation alone, in logs that say nothing about them.

A chirp is the only thing a vehicle's commands ever do that keeps nearly all power at one frequency while that frequency
moves one way over octaves: gusts, pilots and limit cycles spread their power or keep their frequency. The commands are
seen through wavelets of `CYCLES` per standard deviation; where the strongest frequency holds most of the power and goes
one way, there is a chirp. The commands include what the controller adds, so the axis is the one whose command is
strongest at the high end, where vehicles hardly answer and feedback is weakest; a logged excitation goes before them.

A doublet is a train of jumps of one height (or twice that) within a sample or two, up and down.

What does not show: frequencies that a sweep passes within a second or while it is still faded. The low end of a linear
sweep, and both ends of a short one with long fades, are found too narrow.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from gcs.errors import TippathError
from gcs.logs.formats.tables import FloatArray, Log
from gcs.logs.profile import profiles
from gcs.logs.profile.profiles import Profile
from gcs.logs.runs.span import Span

NOTE = "found by its excitation, no settings in the log"
COMMANDS = (("delta_x", "roll"), ("delta_y", "pitch"), ("delta_e", "elevator"))

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
SLOWEST_S = 0.1
"""Commands that come more seldom show no chirp; times in other units than seconds look so, too."""
LONGEST_LOG_S = 6 * 3600.0
"""No battery lasts longer: the clock of such a log has jumped, and the grid over it would fill the memory."""
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

REST_S = 0.5
"""A logged excitation that is zero for so long has ended; a sweep passes through zero within a sample."""
NEAR_S = 3.0
"""What the edges found may be off the true ones by, with a fade."""

JUMP = 0.02
"""Of full command: smaller steps excite nothing."""
ABOVE_REST = 8.0
"""A jump over the root mean square of all other steps from sample to sample."""
SAME_HEIGHT = 0.1
"""Relative, of the jumps of a train. The controller does not answer within a sample, so jumps are as commanded."""
PULSE_S = (0.08, 3.0)
"""From jump to jump: shorter is noise, longer another maneuver."""
FEWEST_JUMPS = 3
SAME_LENGTH = 0.05
"""Of a pulse, from jump to jump, beside one sample."""
BETWEEN = (0.3, 0.7)
"""Of a jump: where a command has steps of this size too, they come from a hand or a controller."""


@dataclass(frozen=True, eq=False)
class _Sweep:
    start_s: float
    stop_s: float
    band_hz: tuple[float, float]
    times: FloatArray
    frequency_hz: FloatArray
    """Of the ridge, shape of `times`."""
    high_power: float
    """Mean power in the third of the time at the highest frequencies."""


def find(log: Log, profile: Profile) -> list[Span]:
    """The maneuvers that the mapped commands of a log show, in order of time; none where they are not logged."""
    channels = _commands(log, profile)
    return [] if channels is None else find_in(channels)


def _commands(log: Log, profile: Profile) -> Mapping[str, FloatArray] | None:
    wanted = {"p", "q", *(name for name, _ in COMMANDS)}
    wanted |= {name.replace("delta_", "excitation_") for name, _ in COMMANDS}
    only = {name: source for name, source in profile.channels.items() if name in wanted}
    try:
        return profiles.apply(replace(profile, channels=only), log).channels
    except TippathError:
        return None


def find_in(channels: Mapping[str, FloatArray]) -> list[Span]:
    """The maneuvers in channels of shape (n,) on one clock `t`."""
    t = channels["t"]
    length_s = float(t[-1] - t[0])
    if t.size < 8 or not SHORTEST_S <= length_s <= LONGEST_LOG_S or float(np.median(np.diff(t))) > SLOWEST_S:
        return []
    logged = {
        axis: channels[name.replace("delta_", "excitation_")]
        for name, axis in COMMANDS
        if np.any(channels.get(name.replace("delta_", "excitation_"), np.zeros(1)))
    }
    signals = logged or {axis: channels[name] for name, axis in COMMANDS if name in channels}
    sweeps = [(sweep, axis) for axis, values in signals.items() for sweep in _sweeps(t, values)]
    if logged:
        sweeps = [(_where_it_is_not_zero(sweep, t, logged[axis]), axis) for sweep, axis in sweeps]
    spans = [_as_span(sweep, axis) for sweep, axis in _strongest(sweeps)]
    trains = [(train, axis) for axis, values in signals.items() for train in _trains(t, values)]
    for (start, stop, _), axis in _highest(trains):
        if not any(span.start_s < stop and start < span.stop_s for span in spans):
            spans.append(Span(start, stop, -math.inf, math.inf, "doublet", axis, notes=(NOTE,)))
    spans.sort(key=lambda span: span.start_s)
    edges = [-math.inf, *((a.stop_s + b.start_s) / 2 for a, b in pairwise(spans)), math.inf]
    return [replace(span, first_s=edges[i], last_s=edges[i + 1]) for i, span in enumerate(spans)]


def _where_it_is_not_zero(sweep: _Sweep, t: FloatArray, put_in: FloatArray) -> _Sweep:
    """A logged excitation is exactly zero before and after: the sweep from its first sample to its last."""
    on = np.flatnonzero(put_in)
    parts = np.split(on, np.flatnonzero(np.diff(t[on]) > REST_S) + 1)
    middle = (sweep.start_s + sweep.stop_s) / 2
    for part in parts:
        start, stop = float(t[part[0]]), float(t[part[-1]])
        if start <= middle <= stop and max(sweep.start_s - start, stop - sweep.stop_s) < NEAR_S:
            return replace(sweep, start_s=start, stop_s=stop)
    return sweep


def _as_span(sweep: _Sweep, axis: str) -> Span:
    band = sweep.band_hz
    track = (sweep.times, sweep.frequency_hz)
    note = f"{NOTE}; swept about {band[0]:.1f}-{band[1]:.1f} Hz"
    return Span(sweep.start_s, sweep.stop_s, -math.inf, math.inf, "chirp", axis, band, notes=(note,), track=track)


def _strongest(sweeps: Sequence[tuple[_Sweep, str]]) -> list[tuple[_Sweep, str]]:
    """Of sweeps at the same time the one with most power at its high end."""
    kept: list[tuple[_Sweep, str]] = []
    for sweep, axis in sorted(sweeps, key=lambda one: -one[0].high_power):
        if not any(sweep.start_s < other.stop_s and other.start_s < sweep.stop_s for other, _ in kept):
            kept.append((sweep, axis))
    return kept


# ------------------------------------------------------------------------------------------------ chirps


def _sweeps(t: FloatArray, values: FloatArray) -> list[_Sweep]:
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
    found = []
    for sign in (1.0, -1.0):
        for chain in _one_way(sign * octave, good):
            clear = float(np.mean(dominance[chain[0] : chain[-1] + 1])) >= MEAN_DOMINANT
            if clear and float(power[:, chain].max()) >= LEAST**2:
                sweep = _measured(grid, x, times, power, octave, chain)
                found += [] if sweep is None else [sweep]
    return found


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
    found: list[list[int]] = []
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
            found.append(chain)
            at = place + 1
        else:
            at += 1 if len(chain) < 2 else max(1, (place - at) // 2)
    return found


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
    return min(float(np.sqrt(np.mean(one**2))) for one in (in_octaves, in_hz))


def _measured(
    grid: FloatArray, x: FloatArray, times: FloatArray, power: FloatArray, octave: FloatArray, chain: list[int]
) -> _Sweep | None:
    strength = np.sqrt(power.max(axis=0)[chain])
    start, start_hz = _edge(grid, x, times[chain], octave[chain], strength)
    stop, stop_hz = _edge(-grid[::-1], x[::-1], -times[chain][::-1], octave[chain][::-1], strength[::-1])
    stop = -stop
    inside = np.asarray(chain)[(times[chain] >= start) & (times[chain] <= stop)]
    if inside.size < SHORTEST_S * GRID_HZ / HOP / 2:
        return None
    highest = inside[np.argsort(octave[inside])[-max(1, inside.size // 3) :]]
    # At high frequency the ridge is sharp; at low the wavelets see late what the fit to the edge gives a little high.
    ridge = 2 ** octave[inside]
    band = (math.sqrt(min(start_hz, stop_hz) * float(ridge.min())), float(ridge.max()))
    track = np.clip(ridge, *band)
    return _Sweep(start, stop, band, times[inside], track, float(np.mean(power.max(axis=0)[highest])))


def _edge(
    grid: FloatArray, x: FloatArray, times: FloatArray, octave: FloatArray, strength: FloatArray
) -> tuple[float, float]:
    """When the sweep began, and its frequency there: where a sine fading in from then on explains most of the samples.

    The wavelets smear the beginning over a second or two and show too low a frequency there. `times`, `octave`,
    `strength`: the ridge, its base-2 logarithm of frequency and amplitude.
    """
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
    low = max(float(grid[0]), min(float(times[0]), float(times[anchor]) - 3 / hz) - 1.0)
    high = min(float(times[stays]), float(times[anchor]) + EDGE_CYCLES[2] / hz)
    part = slice(int(np.searchsorted(grid, low)), int(np.searchsorted(grid, high)))
    t, y = grid[part], x[part]
    if t.size < 8:
        return float(times[0]), hz
    y = y - float(np.median(y))
    # A sweep whose strength grows or falls on its way is seen as one of even strength.
    y = y / np.maximum(np.interp(t, times, soon), EDGE_FLOOR * float(soon[anchor : stays + 1].max()))
    latest = min(float(times[anchor]) + 1 / hz, high - EDGE_CYCLES[0] / hz)
    coarse = 0.1 / hz
    best, found = -math.inf, (float(times[0]), hz)
    for factor in EDGE_FACTORS:
        frequency = np.maximum(np.interp(t, times, 2**octave), factor * hz)
        frequency[t < times[anchor]] = factor * hz
        phase = 2 * math.pi * np.concatenate(([0.0], np.cumsum(frequency[:-1] * np.diff(t))))
        waves = np.stack([np.sin(phase), np.cos(phase)])
        for fade in EDGE_FADES_S:
            if 0 < fade < 1 / hz:
                continue
            begins = np.arange(low, max(low, latest) + coarse, coarse)
            explained = _explained(t, y, waves, begins, fade)
            at = int(np.argmax(explained))
            value = float(explained[at]) * (1.0 if fade == 0 else FADE_PRICE)
            if value > best:
                best, found, finer = value, (float(begins[at]), factor * hz), (waves, fade)
    waves, fade = finer
    begins = found[0] + coarse * np.linspace(-1, 1, 21)
    begin = float(begins[int(np.argmax(_explained(t, y, waves, begins, fade)))])
    return begin + UNSEEN * fade, found[1]


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


# ------------------------------------------------------------------------------------------------ doublets

_Train = tuple[float, float, float]  # start, stop, height of the jumps


def _trains(t: FloatArray, values: FloatArray) -> list[_Train]:
    """Where a command jumps up and down by one height."""
    step = np.diff(values)
    size = np.abs(step)
    rest = size[size <= np.quantile(size, 0.99)]
    least = max(JUMP, ABOVE_REST * float(np.sqrt(np.mean(rest**2))))
    jumps: list[tuple[float, float, float]] = []  # before, after, height
    for i in np.flatnonzero(size >= least).tolist():
        if jumps and t[i] <= jumps[-1][1] and step[i] * jumps[-1][2] > 0:  # one jump over two steps
            jumps[-1] = (jumps[-1][0], float(t[i + 1]), jumps[-1][2] + float(step[i]))
        else:
            jumps.append((float(t[i]), float(t[i + 1]), float(step[i])))
    found: list[_Train] = []
    chain: list[tuple[float, float, float]] = []
    for jump in jumps:
        if chain and not PULSE_S[0] <= jump[1] - chain[-1][1] <= PULSE_S[1]:
            found += _train(chain, t, size)
            chain = []
        chain.append(jump)
    return found + _train(chain, t, size)


def _train(chain: Sequence[tuple[float, float, float]], t: FloatArray, size: FloatArray) -> list[_Train]:
    """The chain if its jumps are of one height or its small multiples and at multiples of one pulse's length.

    A chain is (before, after, height) of each jump; `size` those of all steps, (n - 1,), after `t`.
    """
    if len(chain) < FEWEST_JUMPS:
        return []
    heights = np.array([height for _, _, height in chain])
    own = np.abs(heights)
    one = float(np.median(own[own <= 1.5 * own.min()]))
    levels = np.round(own / one)
    regular = (levels >= 1) & (levels <= 3) & (np.abs(own / one - levels) <= SAME_HEIGHT)
    back = abs(float(heights.sum())) <= (1 + SAME_HEIGHT) * one
    ways = int(np.count_nonzero(np.diff(np.sign(heights))))
    waits = np.diff([after for _, after, _ in chain])
    pulse = float(np.median(waits[waits <= 1.5 * waits.min()]))
    allowed = SAME_LENGTH * pulse + float(np.median(np.diff(t)))
    in_time = np.abs(waits - pulse * np.round(waits / pulse)) <= allowed
    if not (np.all(regular) and back and ways >= 2 and np.all(in_time)):
        return []
    first, last = np.searchsorted(t, [chain[0][0] - 1.0, chain[-1][1] + 1.0])
    around = size[first:last]
    if np.any((around > BETWEEN[0] * one) & (around < BETWEEN[1] * one)):
        return []
    return [(chain[0][1], chain[-1][1] + pulse, one)]


def _highest(trains: Sequence[tuple[_Train, str]]) -> list[tuple[_Train, str]]:
    kept: list[tuple[_Train, str]] = []
    for train, axis in sorted(trains, key=lambda one: -one[0][2]):
        if not any(train[0] < other[1] and other[0] < train[1] for other, _ in kept):
            kept.append((train, axis))
    return kept
