"""From records to what a fit works on: uniform segments without gaps, and their Fourier bins inside the band.

The paper's ideal low-pass and centring become a choice of bins: by Parseval, least squares over the low-passed
samples is least squares over the bins up to the cut-off, and leaving out bin zero removes every constant trim.
A gap splits the run; it is never interpolated over.

Commands are held by the vehicle's loop. Where a log has not every loop, its samples are still those of a command that
moves on between them: their bins inside the band are the command's, and what holds it is `held_s`, not the sample.
"""

from __future__ import annotations

from collections.abc import Hashable, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from sysid.data.first_bins import first_bins
from sysid.data.record import FloatArray, Record

ComplexArray = NDArray[np.complex128]
MINIMUM_SEGMENT_S = 2.0
OFF_CLOCK = 0.1  # of a sample
SLOW_S = 1 / 220
"""Samples of a log that no loop of a flying vehicle is likely to share."""
EVERY_LOOP = 0.8
"""Of a sample: a loop that takes longer was logged whole, but for a few samples."""
STEP, STEP_SHARE, REACH = 3.0, 0.2, 3
"""Between two samples a command steps that changes by so many times what it does on either side, and by so much of its
range; for so many samples around it a spline is not drawn, which would shoot beyond."""
DEFAULT_BAND_HZ = (0.0, 15.0)
EXCITATIONS = ("excitation_x", "excitation_y", "excitation_e", "excitation_c", "excitation_r")
RESPONSE = "response"
"""The maneuver of a record that was made of a measured frequency response (`sysid.data.of_response`)."""


def excitation_of(command: str) -> str:
    """The channel of what was added to a command: `excitation_x` for `delta_x`."""
    return f"excitation_{command.removeprefix('delta_')}"


def gusts_kept_out(references: Sequence[str]) -> bool:
    """Whether each command stands beside a logged excitation, which no gust reaches."""
    return all(name in EXCITATIONS for name in references)


@dataclass(frozen=True, eq=False, kw_only=True)
class Segment:
    """A gap-free, uniformly sampled part of a run."""

    record: Record
    start_s: float
    dt: float
    channels: dict[str, FloatArray]
    """Name -> samples, shape (n,)."""
    resampled: int
    """Samples whose time was off the uniform grid by more than a tenth of a sample and were interpolated."""
    _as_held: dict[tuple[str, ...], FloatArray] = field(default_factory=dict, init=False)
    _logged_bins: dict[tuple[tuple[str, ...], int], ComplexArray] = field(default_factory=dict, init=False)

    @property
    def samples(self) -> int:
        return next(iter(self.channels.values())).size

    @property
    def duration_s(self) -> float:
        return self.samples * self.dt

    @property
    def t(self) -> FloatArray:
        return np.asarray(self.start_s + self.dt * np.arange(self.samples))

    @property
    def held_s(self) -> float:
        """How long a command was held, s."""
        return held_s(self.dt, self.record)

    @property
    def finer(self) -> int:
        """Loops in a sample."""
        return max(1, round(self.dt / self.held_s))

    @property
    def loop_dt(self) -> float:
        """Spacing of `as_held`, s."""
        return self.dt / self.finer

    def as_held(self, names: Sequence[str]) -> FloatArray:
        """Commands as the loop held them, (names, n finer): what acts on their samples is simulated on these.

        Worked out once: every simulation begins here, and none changes it.
        """
        key = tuple(names)
        if key not in self._as_held:
            logged = np.stack([self.channels[name] for name in names])
            self._as_held[key] = logged if self.finer == 1 else self._between(logged)
        return self._as_held[key]

    def _between(self, logged: FloatArray) -> FloatArray:
        """Samples (rows, n) of what moves on between them, at every loop."""
        # heavier than NumPy itself to load: only where it is needed
        from scipy.interpolate import CubicSpline, PchipInterpolator

        at = np.minimum(np.arange(self.samples * self.finer) / self.finer, self.samples - 1)
        number, interval = np.arange(self.samples), np.minimum(at.astype(int), self.samples - 2)
        between = np.asarray(CubicSpline(number, logged, axis=1)(at))
        for row, one in enumerate(logged):
            stepping = _beside_steps(one)[interval]
            if np.any(stepping):  # a spline shoots beyond a step, and play would follow it there
                between[row, stepping] = PchipInterpolator(number, one)(at[stepping])
        return between

    def bins(self, rows: FloatArray, count: int) -> ComplexArray:
        """Samples (rows, n), or those of `as_held`, to so many Fourier bins from zero on, (rows, count)."""
        made = first_bins(rows, count)
        return made if rows.shape[1] == self.samples else made * (self.samples / rows.shape[1])

    def logged_bins(self, names: Sequence[str], count: int) -> ComplexArray:
        """So many bins of channels as they were logged, (names, count). Worked out once, and not to be changed."""
        key = tuple(names), count
        if key not in self._logged_bins:
            self._logged_bins[key] = self.bins(np.stack([self.channels[name] for name in names]), count)
        return self._logged_bins[key]

    def changed_bins(self, names: Sequence[str], acting: FloatArray, count: int) -> ComplexArray:
        """Commands that act where these were logged, samples (names, n finer), to so many bins from zero on, (names,
        count).

        A log of every loop has them all. Of another its own bins are changed by as much as the samples between, which
        nobody logged: what changes nothing predicts the same as if it were not there.
        """
        if acting is self.as_held(names):
            return self.logged_bins(names, count).copy()
        if self.finer == 1:
            return self.bins(acting, count)
        return self.logged_bins(names, count) + self.bins(acting - self.as_held(names), count)


@dataclass(frozen=True, eq=False, kw_only=True)
class Spectrum:
    """The Fourier bins of one segment inside the band, without bin zero."""

    segment: Segment
    dt: float
    samples: int
    frequency_hz: FloatArray
    """(bins,)"""
    z: ComplexArray
    """exp(j omega dt), (bins,)."""
    U: ComplexArray
    """Inputs, (m, bins)."""
    Y: ComplexArray
    """Outputs, (k, bins)."""
    first: int
    """Number of the first bin kept."""
    inputs: tuple[str, ...]
    """Names of the rows of U."""
    acting: dict[Hashable, ComplexArray] = field(default_factory=dict, init=False)
    """What `sysid.model.acting` made of the commands last, by what acted."""

    def transform(self, rows: FloatArray) -> ComplexArray:
        """Samples (rows, n) of this segment, or `Segment.as_held`, to the same bins, (rows, bins)."""
        return self.segment.bins(rows, self._last)[:, self.first :]

    def changed(self, names: Sequence[str], acting: FloatArray) -> ComplexArray:
        """`Segment.changed_bins` of commands, (names, bins)."""
        return self.segment.changed_bins(names, acting, self._last)[:, self.first :]

    @property
    def _last(self) -> int:
        """Number of the first bin beyond."""
        return self.first + self.frequency_hz.size

    def in_time(self, bins: ComplexArray) -> FloatArray:
        """Bins (rows, bins) back to samples, (rows, n): nothing outside the band, no mean."""
        # heavier than NumPy itself to load: only where it is needed
        from scipy.fft import irfft

        whole = np.zeros((bins.shape[0], self.samples // 2 + 1), dtype=complex)
        whole[:, self.first : self.first + bins.shape[1]] = bins
        return np.asarray(irfft(whole, self.samples, axis=1))


def _beside_steps(row: FloatArray) -> NDArray[np.bool_]:
    """Intervals between samples (n,) that are near a step, (n - 1,)."""
    change = np.abs(np.diff(row))
    wide = np.concatenate([[0.0], change, [0.0]])
    steps = (change > STEP * np.maximum(wide[:-2], wide[2:])) & (change > STEP_SHARE * np.ptp(row))
    near = np.zeros(change.size, dtype=bool)
    for at in np.flatnonzero(steps):
        near[max(0, at - REACH) : at + REACH + 1] = True
    return near


def held_s(dt: float, record: Record) -> float:
    """How long a command was held, s: a sample, or the vehicle's loop where that is known to be shorter."""
    loop_s = record.loop_dt_s
    return dt if loop_s is None or loop_s >= EVERY_LOOP * dt else loop_s


def lost_commands(dt: float, record: Record) -> bool:
    """Whether the loop gave commands that a log of this sample, s, has not, or is likely to have: a slow one that does
    not tell."""
    return dt >= SLOW_S if record.loop_dt_s is None else held_s(dt, record) < dt


def gap_threshold_s(spacing: FloatArray, high_hz: float) -> float:
    """Spacing above which time stamps have a gap: three medians, or a quarter period of the band's upper end."""
    shortest = 1 / (4 * high_hz)
    if float(spacing.max()) <= shortest:
        return shortest  # no gap whatever the median
    return max(3 * float(np.median(spacing)), shortest)


def gap_places(spacing: FloatArray, high_hz: float) -> NDArray[np.intp]:
    """Numbers of the samples before which there is a gap, from the spacing of the time stamps."""
    threshold = gap_threshold_s(spacing, high_hz)
    if float(spacing.max()) <= threshold:
        return np.zeros(0, dtype=np.intp)
    return np.flatnonzero(spacing > threshold) + 1


def gaps(t: FloatArray, high_hz: float) -> tuple[tuple[float, float], ...]:
    """(start, stop) of every gap in the time stamps, s."""
    return tuple((float(t[i - 1]), float(t[i])) for i in gap_places(np.diff(t), high_hz))


def rate_hz(t: FloatArray, found: Sequence[tuple[float, float]]) -> float:
    """One over the mean spacing outside the gaps (start, stop) found."""
    inside = float(t[-1] - t[0]) - sum(stop - start for start, stop in found)
    return (t.size - 1 - len(found)) / inside


@dataclass(frozen=True, eq=False, kw_only=True)
class Piece:
    """A gap-free part of a run with its clock; channels are put on it, and transformed, when first asked for."""

    record: Record
    band_hz: tuple[float, float]
    part: slice
    """Of the record's samples."""
    dt: float
    grid: FloatArray
    """Times of the uniform clock, s, (n,)."""
    resampled: int
    """As `Segment.resampled`."""
    _channels: dict[str, FloatArray] = field(default_factory=dict)
    _bins: dict[str, ComplexArray] = field(default_factory=dict)

    def segment(self, names: Sequence[str]) -> Segment:
        """The part with these channels."""
        channels = {name: self._channel(name) for name in names}
        start_s = float(self.record.t[self.part.start])
        return Segment(record=self.record, start_s=start_s, dt=self.dt, channels=channels, resampled=self.resampled)

    def _channel(self, name: str) -> FloatArray:
        """Where a time stamp is off the grid commands are held, those of a thinned log and rates interpolated."""
        if name not in self._channels:
            values = self.record.channels[name][self.part]
            if self.resampled:
                t = self.record.t[self.part]
                held = _is_held(name) and held_s(self.dt, self.record) == self.dt
                values = _held(t, values, self.grid, self.dt) if held else np.interp(self.grid, t, values)
            self._channels[name] = values
        return self._channels[name]

    def spectrum(self, inputs: Sequence[str], outputs: Sequence[str]) -> Spectrum:
        """Its Fourier bins, with the logged excitation among the segment's channels."""
        logged = [name for name in EXCITATIONS if name in self.record.channels]
        return spectrum(self.segment((*inputs, *outputs, *logged)), inputs, outputs, self.band_hz, self._bins)


def pieces(record: Record, band_hz: tuple[float, float]) -> tuple[list[Piece], list[str]]:
    """Split at gaps. Returns the parts of at least 2 s and sentences about what was dropped."""
    t = record.t
    spacing = np.diff(t)
    edges = gap_places(spacing, band_hz[1])
    found: list[Piece] = []
    remarks: list[str] = []
    for start, stop in zip([0, *edges], [*edges, t.size], strict=True):
        part = t[start:stop]
        length = float(part[-1] - part[0])
        if length < MINIMUM_SEGMENT_S:
            remarks.append(f"{record.id}: {length:.2f} s from {part[0]:.2f} s left out, shorter than 2 s between gaps")
            continue
        dt = length / (part.size - 1)
        inside = spacing[start : stop - 1]
        # no stamp is further off than all deviations of the spacing together: a good clock needs no second look
        even = part.size * max(float(inside.max()) - dt, dt - float(inside.min())) <= OFF_CLOCK * dt
        grid = part if even else part[0] + dt * np.arange(part.size)
        off = 0 if even else int(np.count_nonzero(np.abs(part - grid) > OFF_CLOCK * dt))
        found.append(
            Piece(record=record, band_hz=band_hz, part=slice(int(start), int(stop)), dt=dt, grid=grid, resampled=off)
        )
    return found, remarks


def _is_held(name: str) -> bool:
    return name.startswith(("delta", "excitation"))


def _held(t: FloatArray, values: FloatArray, grid: FloatArray, dt: float) -> FloatArray:
    """What a command held from each sample to the next is on the mean between points of a uniform clock.

    So its integral, which is what moves the vehicle, is kept whatever the times of the samples.
    """
    integral = np.concatenate([[0.0], np.cumsum(values[:-1] * np.diff(t))])
    edges = np.append(grid, grid[-1] + dt)
    at = np.interp(edges, t, integral)
    at[-1] = at[-2] + values[-1] * dt
    return np.asarray(np.diff(at) / dt)


def spectrum(
    segment: Segment,
    inputs: Sequence[str],
    outputs: Sequence[str],
    band_hz: tuple[float, float] = DEFAULT_BAND_HZ,
    known: dict[str, ComplexArray] | None = None,
) -> Spectrum:
    """Fourier bins with low < f <= high; bin zero, the trim, is never among them.

    `known` are bins of this segment's channels in this band that need not be made again; what is made joins them.
    """
    # heavier than NumPy itself to load: only where it is needed
    from scipy.fft import rfft

    n, dt = segment.samples, segment.dt
    swept = segment.record.swept_band_hz
    if segment.record.maneuver == RESPONSE and swept is not None:  # nothing was measured beyond
        band_hz = max(band_hz[0], swept[0] - 0.5 / (n * dt)), min(band_hz[1], swept[1])
    # the Nyquist bin is real and would count twice
    last = min(int(band_hz[1] * n * dt + 1e-9), (n - 1) // 2)
    first = max(1, int(band_hz[0] * n * dt + 1e-9) + 1)
    frequency_hz = np.arange(first, last + 1) / (n * dt)

    bins = {} if known is None else known
    new = [name for name in dict.fromkeys((*inputs, *outputs)) if name not in bins]
    if new:
        made = rfft(np.stack([segment.channels[name] for name in new]), axis=1)[:, first : last + 1]
        bins.update(zip(new, np.ascontiguousarray(made), strict=True))

    z = np.exp(2j * np.pi * dt * frequency_hz)
    return Spectrum(
        segment=segment,
        dt=dt,
        samples=n,
        frequency_hz=frequency_hz,
        z=z,
        U=np.stack([bins[name] for name in inputs]),
        Y=np.stack([bins[name] for name in outputs]),
        first=first,
        inputs=tuple(inputs),
    )


def low_pass(values: FloatArray, dt: float, high_hz: float) -> FloatArray:
    """Ideal (brick-wall) low-pass of samples (n,) by their Fourier bins; the mean stays."""
    # heavier than NumPy itself to load: only where it is needed
    from scipy.fft import irfft, rfft, rfftfreq

    bins = rfft(values)
    bins[rfftfreq(values.size, dt) > high_hz] = 0
    return np.asarray(irfft(bins, values.size))


def spectra(
    records: Sequence[Record],
    inputs: Sequence[str],
    outputs: Sequence[str],
    band_hz: tuple[float, float] = DEFAULT_BAND_HZ,
) -> tuple[list[Spectrum], list[str]]:
    """All segments of all records as Fourier bins, and the remarks made on the way."""
    found: list[Spectrum] = []
    remarks: list[str] = []
    for record in records:
        parts, dropped = pieces(record, band_hz)
        remarks += dropped
        found += [part.spectrum(inputs, outputs) for part in parts]
    return found, remarks
