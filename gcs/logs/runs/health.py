"""Whether a run can be identified from, and if not, why and what to do about it.

Every check looks at the record alone and answers in sentences. A reason makes the run unusable; a note does not.
The thresholds are those of the fit: f_high is the highest frequency it uses, a gap is a spacing above
max(3 medians, 1/(4 f_high)), and pieces between gaps under 2 s are dropped.

Powers, coherence and correlation are taken on a grid of 4 f_high of the longest piece without a gap: all that a fit
uses lies below f_high, and a long run stays cheap.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from gcs.logs.runs.latency import Latency
from sysid.data.coherence import coherence
from sysid.data.record import CHANNELS, Record

FloatArray = NDArray[np.float64]

F_HIGH_HZ = 15.0
F_LOW_HZ = 0.3  # below it trim and wind, not the maneuver
SHORTEST_PIECE_S = 2.0
SHORTEST_RUN_S = 5.0
COMMAND_RMS = 0.002  # of full command: less is a trim change
RATE_RMS = 0.01  # rad/s: less is gyro noise on the bench
COMMAND_LIMIT = 1.05
SATURATED = 0.999
SATURATED_NOTE, SATURATED_REASON = 0.002, 0.1  # shares of the samples
FASTEST_RAD_S = 60.0  # no gyro measures more; values above are degrees
CLIPPED_SAMPLES = 5
FULL_SCALES = tuple(math.radians(scale) for scale in (125, 250, 500, 1000, 2000, 4000))
"""What gyros are set to, rad/s."""
FULL_SCALE_WITHIN = 0.02
JITTER_NOTE = 0.3
"""Standard deviation of the spacing over its median. A sound log has 0.01 to 0.05, one that skips every tenth sample
0.3; the stamps are right all the same, so it is no reason."""
JITTER_SHOWN = 0.02
GAPS_NAMED = 3
POWER_SHARE = 0.003
"""A command has power where its spectrum is within 25 dB of its peak: a sweep falls by 13 dB from 0.5 to 10 Hz."""
COHERENT = 0.6
ENOUGH_COHERENT = 0.5
"""Part of the command's band where the rates must follow, else it is noted: half of it tells nothing of the vehicle."""
SEGMENT_S = 4.0
"""Of the averaged spectra: 0.25 Hz resolution. (As `gcs.flight.verdict`, at the end of a run.)"""
FEWEST_SEGMENTS = 4
SHORTEST_SEGMENT_S = 1.0
"""Fewer and shorter ones make the coherence of noise large."""
TOGETHER = 0.9
"""Correlation of the two commands above which their effects cannot be told apart: 1/(1 - 0.9^2), five times the
variance of either."""
TOGETHER_SHOWN = 0.7

SWEEP = "fly a chirp: tippath sweep --connect LINK --axis roll, then pitch (and elevator in forward flight)"
LIKELY_HZ = (40.0, 5000.0)  # what vehicles log their rates at
TELEMETRY = ("ATTITUDE", "ATTITUDE_QUATERNION", "HIGHRES_IMU", "SCALED_IMU", "SCALED_IMU2", "RAW_IMU")
UNITS_OF_TIME = (("milliseconds", 1e-3), ("microseconds", 1e-6), ("nanoseconds", 1e-9))


@dataclass(frozen=True)
class Coherent:
    """Where the rates follow a command."""

    low_hz: float
    high_hz: float
    """Lowest and highest frequency with a coherence above `COHERENT`; both 0 where there is none."""
    share: float
    """Of the swept band, where it is known, else of the band in which the command has power, 0..1."""


@dataclass(frozen=True)
class Quiet:
    """A stretch of hover without a maneuver."""

    start_s: float
    duration_s: float
    where: str
    """`before` or `after` the run."""


@dataclass(frozen=True)
class Health:
    """What the checks found."""

    rate_hz: float
    """1 / mean spacing outside gaps."""
    gaps: tuple[tuple[float, float], ...]
    """Start and stop of every gap, s of the log's own time."""
    duration_s: float
    longest_piece_s: float
    excitation: Mapping[str, tuple[float, float]]
    """Axis -> root mean square between 0.3 Hz and f_high of command (1) and rate (rad/s)."""
    saturated_share: Mapping[str, float]
    """Command channel -> share of samples at full command, where there are any."""
    usable: bool
    reasons: tuple[str, ...] = field(default=())
    notes: tuple[str, ...] = field(default=())
    jitter: float = 0.0
    """Standard deviation over median of the spacing outside gaps."""
    clipped: Mapping[str, int] = field(default_factory=dict)
    """Rate channel -> how often its largest value is held, where it is."""
    command_band_hz: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    """Axis -> where its command has power."""
    coherent: Mapping[str, Coherent] = field(default_factory=dict)
    """Axis -> where the rates follow its command; excited axes only."""
    input_correlation: float | None = None
    """Of delta_x and delta_y between 0.3 Hz and f_high, -1..1; None where one of them does not move."""
    quiet: tuple[Quiet, ...] = ()
    """Hover without a maneuver before and after the run, for the noise floor."""
    latency: tuple[Latency, ...] = ()
    """Fields of the log that show the same as the run's own, but later or earlier."""

    def words(self, axis: str | None = None) -> str:
        """In one line: `coherence 0.5-9.6 Hz   jitter 1 %   quiet 6.2 s before`; empty where nothing is known.

        Of the run's axis, or of every one where it is not known.
        """
        parts = []
        for name, one in self.coherent.items():
            if axis in (None, name):
                what = "coherence" if axis else f"{name} coherence"
                parts.append(f"{what} {one.low_hz:.1f}-{one.high_hz:.1f} Hz" if one.share else f"{what} none")
        for name, (low, high) in self.command_band_hz.items():
            if axis in (None, name):
                parts.append(f"{'power' if axis else f'{name} power'} {low:.1f}-{high:.1f} Hz")
        if self.jitter >= JITTER_SHOWN:
            parts.append(f"jitter {100 * self.jitter:.0f} %")
        if self.input_correlation is not None and abs(self.input_correlation) >= TOGETHER_SHOWN:
            parts.append(f"inputs correlated {self.input_correlation:+.2f}")
        parts += [f"quiet {one.duration_s:.1f} s {one.where}" for one in self.quiet]
        parts += [one.words for one in self.latency[:1]]
        return "   ".join(parts)


def gaps_in(t: FloatArray, f_high_hz: float = F_HIGH_HZ) -> NDArray[np.int64]:
    """Indices i where t[i] to t[i+1] is a gap."""
    spacing = np.diff(t)
    return np.flatnonzero(spacing > max(3 * float(np.median(spacing)), 1 / (4 * f_high_hz)))


def rate_of(t: FloatArray, f_high_hz: float = F_HIGH_HZ) -> float:
    """1 / mean spacing outside gaps, Hz."""
    spacing = np.delete(np.diff(t), gaps_in(t, f_high_hz))
    return float(1 / spacing.mean()) if spacing.size else float(1 / np.diff(t).mean())


def check(
    record: Record,
    *,
    planned_s: float | None = None,
    maneuver_s: float | None = None,
    slow_channels: Mapping[str, float] | None = None,
    f_high_hz: float = F_HIGH_HZ,
) -> Health:
    """Check one record.

    planned_s and maneuver_s: how long the maneuver was to last and lasted, where known. slow_channels: median spacing
    of the fields behind channels that were logged more slowly than the rates.
    """
    t = record.t
    at = gaps_in(t, f_high_hz)
    gaps = tuple((float(t[i]), float(t[i + 1])) for i in at)
    rate_hz = rate_of(t, f_high_hz)
    edges = np.concatenate(([0], at + 1, [t.size]))
    spacing_s = np.delete(np.diff(t), at)
    jitter = float(np.std(spacing_s) / np.median(spacing_s)) if spacing_s.size else 0.0
    longest = max(float(t[stop - 1] - t[start]) for start, stop in pairwise(edges.tolist()))
    excitation = {
        axis: (_band_rms(t, record.channels[command], f_high_hz), _band_rms(t, record.channels[rate], f_high_hz))
        for axis, command, rate in (("roll", "delta_x", "p"), ("pitch", "delta_y", "q"), ("elevator", "delta_e", "q"))
        if axis != "elevator" or (record.axis == axis and command in record.channels)
    }
    commands = [name for name in ("delta_x", "delta_y", "delta_e") if name in record.channels]
    saturated = {name: float(np.mean(np.abs(record.channels[name]) >= SATURATED)) for name in commands}
    saturated = {name: share for name, share in saturated.items() if share > 0}
    clipped = {name: times for name in ("p", "q") if (times := _clipped(record.channels[name])) > 0}

    reasons: list[str] = []
    notes: list[str] = []
    needed_hz = 4 * f_high_hz
    mistaken = _mistaken_time(record, rate_hz)
    slow = too_slow(record.rate_source, rate_hz, f_high_hz)
    if mistaken is not None:
        reasons.append(mistaken)
    elif slow is not None:
        reasons.append(slow)
    for name in ("delta_x", "delta_y"):
        spacing = (slow_channels or {}).get(name, 0.0)
        if spacing > 1 / needed_hz * (1 + 1e-6):
            reasons.append(
                f"{name} is logged at {1 / spacing:.0f} Hz only; at least {needed_hz:.0f} Hz are needed: "
                "log the command in every control loop"
            )
    reasons += _values(record, commands, saturated, clipped, notes)
    # With another unit of time the band from 0.3 Hz to f_high is not where it seems.
    if (
        record.maneuver != "quiet"
        and mistaken is None
        and not any(command >= COMMAND_RMS and rate >= RATE_RMS for command, rate in excitation.values())
    ):
        reasons.append(
            "no excitation: "
            + "; ".join(
                f"{axis} command {command:.2g} of full and rate {rate:.2g} rad/s rms"
                for axis, (command, rate) in excitation.items()
            )
            + f"; {SWEEP}"
        )
    if gaps:
        notes.append(_gaps_in_words(gaps))
    if jitter > JITTER_NOTE:
        notes.append(
            f"the samples come irregularly: spacing {1000 / rate_hz:.1f} ms with a standard deviation of "
            f"{100 * jitter:.0f} %; they are resampled by their time stamps"
        )
    band, coherent, together = _spectra(record, excitation, edges, f_high_hz)
    if record.maneuver == "chirp":
        notes += [
            f"the rates follow the {axis} command in only {100 * one.share:.0f} % of the band where it has power: "
            "more amplitude, or less wind"
            for axis, one in coherent.items()
            if one.share < ENOUGH_COHERENT and record.axis in (None, axis)
        ]
    if together is not None and abs(together) > TOGETHER and record.maneuver != "quiet":
        notes.append(
            f"delta_x and delta_y move together (correlation {together:+.2f}): the two inputs cannot be separated in "
            "this run, join it with another in which they move otherwise"
        )
    if gaps and longest < SHORTEST_PIECE_S:
        reasons.append(
            f"no piece of {SHORTEST_PIECE_S:g} s without a gap (the longest is {longest:.2f} s): "
            "log to a faster medium or take the log from the vehicle instead of the telemetry"
        )
    elif record.duration_s < SHORTEST_RUN_S:
        reasons.append(
            f"only {record.duration_s:.1f} s long; at least {SHORTEST_RUN_S:g} s are needed: fly it longer, or widen "
            "the window that cuts it"
        )
    if planned_s is not None and maneuver_s is not None and maneuver_s < planned_s - 0.5:
        notes.append(f"cut short: {maneuver_s:.1f} s of {planned_s:.1f} s were flown")
    return Health(
        rate_hz,
        gaps,
        record.duration_s,
        longest,
        excitation,
        saturated,
        not reasons,
        tuple(reasons),
        tuple(notes),
        jitter,
        clipped,
        band,
        coherent,
        together,
    )


def too_slow(kind: str, rate_hz: float, f_high_hz: float = F_HIGH_HZ) -> str | None:
    """Why rates from this kind of message at that rate are not enough; None where they are."""
    needed_hz = 4 * f_high_hz
    if rate_hz >= needed_hz * (1 - 1e-6):
        return None
    what = f"the rates are logged at {rate_hz:.1f} Hz" if kind == "csv" else f"{kind} at {rate_hz:.3g} Hz"
    do = "log faster"
    if kind in ("RATE", "IMU", "ATT", "SIDD", "GYR"):
        do = "switch fast attitude logging on (LOG_BITMASK bit 0 on ArduPilot), or log faster"
    elif kind in TELEMETRY:
        do = "ask for it faster (MAV_CMD_SET_MESSAGE_INTERVAL), or take the vehicle's own log"
    return (
        f"{what}: too slow for attitude identification; "
        f"up to {f_high_hz:g} Hz at least {needed_hz:.0f} Hz are needed: {do}"
    )


def _gaps_in_words(gaps: Sequence[tuple[float, float]]) -> str:
    longest = max(stop - start for start, stop in gaps)
    order = sorted(gaps, key=lambda gap: gap[0] - gap[1])[:GAPS_NAMED]
    where = ", ".join(f"{start:.2f}-{stop:.2f}" for start, stop in sorted(order))
    word = "gap" if len(gaps) == 1 else "gaps"
    most = "the longest " if len(gaps) > GAPS_NAMED else ""
    return (
        f"{len(gaps)} {word} in the samples, the longest {longest:.2f} s: pieces are fitted apart "
        f"({most}at {where} s of the log)"
    )


def _spectra(
    record: Record, excitation: Mapping[str, tuple[float, float]], edges: NDArray[np.int64], f_high_hz: float
) -> tuple[dict[str, tuple[float, float]], dict[str, Coherent], float | None]:
    """Where commands have power, where rates follow them, and how alike the two commands are, in the longest piece."""
    t = record.t
    first, stop = max(pairwise(edges.tolist()), key=lambda piece: t[piece[1] - 1] - t[piece[0]])
    rate_hz = 4 * f_high_hz
    count = int((t[stop - 1] - t[first]) * rate_hz)
    n = int(min(SEGMENT_S * rate_hz, count / FEWEST_SEGMENTS))
    if n < SHORTEST_SEGMENT_S * rate_hz or stop - first < count / 4:
        return {}, {}, None

    def gridded(name: str) -> FloatArray:
        values = record.channels[name][first:stop]
        cell = np.minimum(((t[first:stop] - t[first]) * rate_hz).astype(np.int64), count - 1)
        held = np.bincount(cell, minlength=count)
        sums = np.bincount(cell, values, minlength=count)
        at = np.flatnonzero(held)
        return np.interp(np.arange(count), at, sums[at] / held[at])

    hz = np.fft.rfftfreq(n, 1 / rate_hz)
    inside = (hz >= F_LOW_HZ) & (hz <= f_high_hz)
    p, q = gridded("p"), gridded("q")
    bands: dict[str, tuple[float, float]] = {}
    coherent: dict[str, Coherent] = {}
    commands = {}
    for axis, name in (("roll", "delta_x"), ("pitch", "delta_y"), ("elevator", "delta_e")):
        if axis not in excitation or excitation[axis][0] < COMMAND_RMS:
            continue
        command = commands[axis] = gridded(name)
        logged = record.channels.get(name.replace("delta_", "excitation_"))
        if record.axis not in (None, axis) and logged is not None and not np.any(logged):
            continue  # nothing was put in here: it is feedback
        put_in = gridded(name.replace("delta_", "excitation_")) if logged is not None and np.any(logged) else command
        power = np.where(inside, _power(put_in, n), 0.0)
        strong = power >= POWER_SHARE * power.max()
        bands[axis] = (float(hz[strong][0]), float(hz[strong][-1]))
        best = np.maximum(coherence(put_in, p, n), coherence(put_in, q, n))
        if record.axis == axis and record.swept_band_hz is not None:
            low, high = record.swept_band_hz
            strong = inside & (hz >= low - hz[1] / 2) & (hz <= high + hz[1] / 2)
        follows = strong & (best >= COHERENT)
        if follows.any():
            at = hz[follows]
            coherent[axis] = Coherent(float(at[0]), float(at[-1]), float(follows.sum() / strong.sum()))
        else:
            coherent[axis] = Coherent(0.0, 0.0, 0.0)
    together = None
    if "roll" in commands and "pitch" in commands:
        x, y = (_spectrum_in_band(commands[axis], rate_hz, f_high_hz) for axis in ("roll", "pitch"))
        size = math.sqrt(float(np.sum(np.abs(x) ** 2) * np.sum(np.abs(y) ** 2)))
        together = float(np.sum(x.conj() * y).real) / size if size > 0 else None
    return bands, coherent, together


def _power(values: FloatArray, n: int) -> FloatArray:
    """Averaged over Hann pieces of n samples, half overlapping, (n // 2 + 1,)."""
    starts = np.arange(0, values.size - n + 1, max(1, n // 2))
    pieces = (values - values.mean())[starts[:, None] + np.arange(n)] * np.hanning(n)
    return np.asarray(np.mean(np.abs(np.fft.rfft(pieces, axis=1)) ** 2, axis=0))


def _spectrum_in_band(values: FloatArray, rate_hz: float, f_high_hz: float) -> NDArray[np.complex128]:
    spectrum = np.fft.rfft(values - values.mean())
    hz = np.fft.rfftfreq(values.size, 1 / rate_hz)
    return np.asarray(spectrum[(hz >= F_LOW_HZ) & (hz <= f_high_hz)])


def _mistaken_time(record: Record, rate_hz: float) -> str | None:
    """Whether the times of a CSV look as if they were not seconds, and what to write then."""
    if record.rate_source != "csv":
        return None
    for name, scale in UNITS_OF_TIME:
        if LIKELY_HZ[0] <= rate_hz / scale <= LIKELY_HZ[1]:
            return (
                f"time goes on by {1 / rate_hz:g} from row to row, which would be {rate_hz:.3g} Hz: is it in {name}? "
                f"t is in seconds; convert it, or name it in a profile: [time] source = ..., scale = {scale:g} "
                "(where it is in seconds, log faster)"
            )
    return None


def _values(
    record: Record,
    commands: list[str],
    saturated: Mapping[str, float],
    clipped: Mapping[str, int],
    notes: list[str],
) -> list[str]:
    reasons = []
    for name in ("p", "q"):
        values = record.channels[name]
        largest = float(np.abs(values).max())
        if values.min() == values.max():
            reasons.append(f"{name} never changes ({values[0]:g}): the gyro was not logged, or is dead")
        elif largest > FASTEST_RAD_S:
            reasons.append(
                f"{name} reaches {largest:.0f} rad/s: are these degrees? Give scale = 0.017453292519943295 in a profile"
            )
        elif name in clipped:
            notes.append(_clipped_in_words(record, name, clipped[name]))
    still = [name for name in ("delta_x", "delta_y") if np.ptp(record.channels[name]) == 0]
    if len(still) == 2 and record.maneuver != "quiet":
        reasons.append(
            f"neither delta_x nor delta_y ever changes ({record.channels['delta_x'][0]:g}, "
            f"{record.channels['delta_y'][0]:g}): the commands were not logged, or the profile names the wrong fields"
        )
    elif still:
        notes.append(f"{still[0]} never changes: this run tells nothing about it, join it with one on the other axis")
    for name in commands:
        largest = float(np.abs(record.channels[name]).max())
        share = saturated.get(name, 0.0)
        if largest > COMMAND_LIMIT:
            reasons.append(
                f"{name} reaches {largest:.4g}; commands are {CHANNELS[name]} of full command: "
                "give a scale in a profile (--profile FILE.toml)"
            )
        elif share > SATURATED_REASON:
            reasons.append(f"{name} is at full command in {100 * share:.0f} % of the samples: fly with less amplitude")
        elif share > SATURATED_NOTE:
            notes.append(f"{name} is at full command in {100 * share:.1f} % of the samples")
    return reasons


def _clipped_in_words(record: Record, name: str, times: int) -> str:
    values = np.abs(record.channels[name])
    largest = float(values.max())
    when = float(record.t[int(np.argmax(values == largest))])
    scale = next((one for one in FULL_SCALES if abs(largest - one) <= FULL_SCALE_WITHIN * one), None)
    held = (
        f"{name} stands at {'its largest value' if scale is None else 'full scale'}, {largest:.2f} rad/s, {times} times"
    )
    if scale is None:
        return f"{held}, first at {when:.2f} s of the log: clipped?"
    return f"{held}, first at {when:.2f} s of the log: clipped by the gyro's {math.degrees(scale):.0f} deg/s"


def _clipped(values: FloatArray) -> int:
    """How often the largest magnitude is held, for longer than values are held elsewhere (a slow field, repeated)."""
    changes = 1 + int(np.count_nonzero(np.diff(values)))
    long = CLIPPED_SAMPLES * max(1.0, values.size / changes)
    size = np.abs(values)
    top = size == size.max()
    edges = np.flatnonzero(np.diff(np.concatenate(([0], top.astype(np.int8), [0]))))
    return int(np.count_nonzero(edges[1::2] - edges[::2] >= long))


def _band_rms(t: FloatArray, values: FloatArray, f_high_hz: float) -> float:
    """Root mean square of what lies between 0.3 Hz and f_high, on a uniform grid over gaps."""
    count = max(4, min(t.size, 1 << 18))
    grid = np.linspace(t[0], t[-1], count)
    spectrum = np.fft.rfft(np.interp(grid, t, values - values.mean()))
    hz = np.fft.rfftfreq(count, (t[-1] - t[0]) / (count - 1))
    band = (hz >= F_LOW_HZ) & (hz <= f_high_hz)
    return float(np.sqrt(2 * np.sum(np.abs(spectrum[band]) ** 2)) / count)
