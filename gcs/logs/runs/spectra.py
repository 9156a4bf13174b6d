"""What the spectra of a record show: how strong it was excited, where commands have power and rates follow them.

Powers, coherence and correlation are taken on a grid of 4 f_high of the longest piece without a gap: all that a fit
uses lies below f_high, and a long run stays cheap.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from gcs.logs.formats.tables import FloatArray
from sysid.data.coherence import coherence
from sysid.data.record import CYCLIC, RATES, Record

F_LOW_HZ = 0.3  # below it trim and wind, not the maneuver
COMMAND_RMS = 0.002  # of full command: less is a trim change
POWER_SHARE = 0.003
"""A command has power where its spectrum is within 25 dB of its peak: a sweep falls by 13 dB from 0.5 to 10 Hz."""
COHERENT = 0.6
SEGMENT_S = 4.0
"""Of the averaged spectra: 0.25 Hz resolution. (As `gcs.flight.verdict`, at the end of a run.)"""
FEWEST_SEGMENTS = 4
SHORTEST_SEGMENT_S = 1.0
"""Fewer and shorter ones make the coherence of noise large."""
COMMANDS = (
    ("roll", "delta_x"),
    ("pitch", "delta_y"),
    ("elevator", "delta_e"),
    ("yaw", "delta_r"),
    ("thrust", "delta_c"),
)
ANSWERS = {"roll": "p", "pitch": "q", "elevator": "q", "yaw": "r", "thrust": "az"}
"""What shows best that an axis was excited."""


@dataclass(frozen=True)
class Coherent:
    """Where the rates follow a command."""

    low_hz: float
    high_hz: float
    """Lowest and highest frequency with a coherence above `COHERENT`; both 0 where there is none."""
    share: float
    """Of the swept band, where it is known, else of the band in which the command has power, 0..1."""


@dataclass(frozen=True)
class Spectra:
    """Where commands have power, and where rates follow them."""

    command_band_hz: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    """Axis -> where its command has power."""
    coherent: Mapping[str, Coherent] = field(default_factory=dict)
    """Axis -> where the rates follow its command; excited axes only."""
    input_correlation: float | None = None
    """Of delta_x and delta_y between 0.3 Hz and f_high, -1..1; None where one of them does not move."""


def strength(record: Record, f_high_hz: float) -> dict[str, tuple[float, float]]:
    """Axis -> root mean square between 0.3 Hz and f_high of command (1) and rate (rad/s).

    Of axes beside roll and pitch where they were swept, and where nobody says what was while both rest; thrust is
    answered by a specific force, m/s^2.
    """
    beside = {record.axis} if record.axis is not None or not both_rest(record) else set(ANSWERS) - {"elevator"}
    return {
        axis: (
            _band_rms(record.t, record.channels[command], f_high_hz),
            _band_rms(record.t, record.channels[ANSWERS[axis]], f_high_hz),
        )
        for axis, command in COMMANDS
        if axis in ("roll", "pitch") or (axis in beside and {command, ANSWERS[axis]} <= set(record.channels))
    }


def both_rest(record: Record) -> bool:
    """Whether neither the roll nor the pitch command ever changes."""
    return not any(np.ptp(record.channels[name]) for name in CYCLIC)


def spectra(
    record: Record, excitation: Mapping[str, tuple[float, float]], edges: NDArray[np.int64], f_high_hz: float
) -> Spectra:
    """The spectra of the longest piece; nothing where that is too short.

    excitation: of `strength`; edges: first sample of each piece without a gap, and the one behind the last.
    """
    grid = _Grid.of(record, edges, f_high_hz)
    if grid is None:
        return Spectra()
    bands: dict[str, tuple[float, float]] = {}
    coherent: dict[str, Coherent] = {}
    commands: dict[str, FloatArray] = {}
    for axis, name in COMMANDS:
        if axis not in excitation or excitation[axis][0] < COMMAND_RMS:
            continue
        commands[axis] = grid.values(name)
        put_in = _put_in(record, axis, name, grid)
        if put_in is not None:
            bands[axis], coherent[axis] = _follows(record, axis, put_in, grid)
    together = _together(commands["roll"], commands["pitch"], grid) if {"roll", "pitch"} <= set(commands) else None
    return Spectra(bands, coherent, together)


@dataclass(frozen=True, eq=False, kw_only=True)
class _Grid:
    """The longest piece of a record on a uniform grid of 4 f_high."""

    record: Record
    first: int
    """Of its samples, and the one behind the last."""
    stop: int
    f_high_hz: float
    count: int
    """Cells of the grid."""
    n: int
    """Cells of a segment."""
    _kept: dict[str, FloatArray] = field(default_factory=dict)

    @classmethod
    def of(cls, record: Record, edges: NDArray[np.int64], f_high_hz: float) -> _Grid | None:
        """None where the piece is too short, or has too few samples."""
        t = record.t
        first, stop = max(pairwise(edges.tolist()), key=lambda piece: t[piece[1] - 1] - t[piece[0]])
        rate_hz = 4 * f_high_hz
        count = int((t[stop - 1] - t[first]) * rate_hz)
        n = int(min(SEGMENT_S * rate_hz, count / FEWEST_SEGMENTS))
        if n < SHORTEST_SEGMENT_S * rate_hz or stop - first < count / 4:
            return None
        return cls(record=record, first=first, stop=stop, f_high_hz=f_high_hz, count=count, n=n)

    @property
    def rate_hz(self) -> float:
        return 4 * self.f_high_hz

    def values(self, name: str) -> FloatArray:
        """A channel as means over the cells, straight lines between, (count,)."""
        if name not in self._kept:
            t, values = self.record.t[self.first : self.stop], self.record.channels[name][self.first : self.stop]
            cell = np.minimum(((t - t[0]) * self.rate_hz).astype(np.int64), self.count - 1)
            held = np.bincount(cell, minlength=self.count)
            sums = np.bincount(cell, values, minlength=self.count)
            at = np.flatnonzero(held)
            self._kept[name] = np.interp(np.arange(self.count), at, sums[at] / held[at])
        return self._kept[name]


def _put_in(record: Record, axis: str, command: str, grid: _Grid) -> FloatArray | None:
    """What went in on an axis: the excitation where it is logged, else the command; None for feedback alone."""
    name = command.replace("delta_", "excitation_")
    if name not in record.channels:
        return grid.values(command)
    if np.any(record.channels[name]):
        return grid.values(name)
    return grid.values(command) if record.axis in (None, axis) else None


def _follows(record: Record, axis: str, put_in: FloatArray, grid: _Grid) -> tuple[tuple[float, float], Coherent]:
    """Where the input of an axis has power, and where the better of the two rates, or its own answer, follows it."""
    n = grid.n
    hz = np.fft.rfftfreq(n, 1 / grid.rate_hz)
    inside = (hz >= F_LOW_HZ) & (hz <= grid.f_high_hz)
    power = np.where(inside, _power(put_in, n), 0.0)
    strong = power >= POWER_SHARE * power.max()
    band = (float(hz[strong][0]), float(hz[strong][-1]))
    answers = RATES if ANSWERS[axis] in RATES else (ANSWERS[axis],)
    best = np.max([coherence(put_in, grid.values(name), n) for name in answers], axis=0)
    if record.axis == axis and record.swept_band_hz is not None:
        low, high = record.swept_band_hz
        strong = inside & (hz >= low - hz[1] / 2) & (hz <= high + hz[1] / 2)
    follows = strong & (best >= COHERENT)
    if not follows.any():
        return band, Coherent(0.0, 0.0, 0.0)
    at = hz[follows]
    return band, Coherent(float(at[0]), float(at[-1]), float(follows.sum() / strong.sum()))


def _together(delta_x: FloatArray, delta_y: FloatArray, grid: _Grid) -> float | None:
    """Correlation of the two commands inside the band; None where one has no power there."""
    x, y = (_spectrum_in_band(command, grid.rate_hz, grid.f_high_hz) for command in (delta_x, delta_y))
    size = math.sqrt(float(np.sum(np.abs(x) ** 2) * np.sum(np.abs(y) ** 2)))
    return float(np.sum(x.conj() * y).real) / size if size > 0 else None


def _power(values: FloatArray, n: int) -> FloatArray:
    """Averaged over Hann pieces of n samples, half overlapping, (n // 2 + 1,)."""
    starts = np.arange(0, values.size - n + 1, max(1, n // 2))
    pieces = (values - values.mean())[starts[:, None] + np.arange(n)] * np.hanning(n)
    return np.asarray(np.mean(np.abs(np.fft.rfft(pieces, axis=1)) ** 2, axis=0))


def _spectrum_in_band(values: FloatArray, rate_hz: float, f_high_hz: float) -> NDArray[np.complex128]:
    spectrum = np.fft.rfft(values - values.mean())
    hz = np.fft.rfftfreq(values.size, 1 / rate_hz)
    return np.asarray(spectrum[(hz >= F_LOW_HZ) & (hz <= f_high_hz)])


def _band_rms(t: FloatArray, values: FloatArray, f_high_hz: float) -> float:
    """Root mean square of what lies between 0.3 Hz and f_high, on a uniform grid over gaps."""
    count = max(4, min(t.size, 1 << 18))
    grid = np.linspace(t[0], t[-1], count)
    spectrum = np.fft.rfft(np.interp(grid, t, values - values.mean()))
    hz = np.fft.rfftfreq(count, (t[-1] - t[0]) / (count - 1))
    band = (hz >= F_LOW_HZ) & (hz <= f_high_hz)
    return float(np.sqrt(2 * np.sum(np.abs(spectrum[band]) ** 2)) / count)
