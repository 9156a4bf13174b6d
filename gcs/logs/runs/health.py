"""Whether a run can be identified from, and if not, why and what to do about it.

The record is measured once (`_Measured`); every check looks at that alone and answers in sentences. A reason makes the
run unusable; a note does not. The thresholds are those of the fit: f_high is the highest frequency it uses, gaps are
those of `sysid.data.preprocess`, and pieces between gaps under 2 s are dropped.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from gcs.logs.profile.by_values import LIKELY_HZ, TIMES
from gcs.logs.profile.mapping import FASTEST_RAD_S
from gcs.logs.runs.clipped import clipped_words, times_clipped
from gcs.logs.runs.latency import Latency
from gcs.logs.runs.spectra import ANSWERS, COMMAND_RMS, COMMANDS, Coherent, Spectra, spectra, strength
from gcs.vehicle.sweeps import ANY
from sysid.data.preprocess import DEFAULT_BAND_HZ, MINIMUM_SEGMENT_S, gap_places, rate_hz
from sysid.data.record import CHANNELS, RATES, Record

F_HIGH_HZ = DEFAULT_BAND_HZ[1]
SHORTEST_PIECE_S = MINIMUM_SEGMENT_S
SHORTEST_RUN_S = 5.0
BESIDE = frozenset({"yaw", "thrust"})
"""Axes that are fitted by themselves: roll and pitch may rest while they are swept."""
RATE_RMS = 0.01  # rad/s: less is gyro noise on the bench
COMMAND_LIMIT = 1.05
BEYOND_REASON = 0.1
"""Share of samples beyond it that no mixer is asked for: the scale is wrong."""
SATURATED = 0.999
SATURATED_NOTE, SATURATED_REASON = 0.002, 0.1  # shares of the samples
JITTER_NOTE = 0.3
"""Standard deviation of the spacing over its median. A sound log has 0.01 to 0.05, one that skips every tenth sample
0.3; the stamps are right all the same, so it is no reason."""
JITTER_SHOWN = 0.02
GAPS_NAMED = 3
ENOUGH_COHERENT = 0.5
"""Part of the command's band where the rates must follow, else it is noted: half of it tells nothing of the vehicle."""
TOGETHER = 0.9
"""Correlation of the two commands above which their effects cannot be told apart: 1/(1 - 0.9^2), five times the
variance of either."""
TOGETHER_SHOWN = 0.7
MOST_OF_IT = 0.8
"""Of a run, in one piece."""
LOWEST_BAND_HZ = 3
"""A fit of less of a hovering vehicle's band tells little."""
BAND_FROM_HZ = 0.3
"""Where a band begins that is named to the user: below it pilots and controllers show more than the vehicle."""

TELEMETRY = ("ATTITUDE", "ATTITUDE_QUATERNION", "HIGHRES_IMU", "SCALED_IMU", "SCALED_IMU2", "RAW_IMU")


@dataclass(frozen=True)
class Quiet:
    """A stretch of hover without a maneuver."""

    start_s: float
    duration_s: float
    where: str
    """`before` or `after` the run."""


@dataclass(frozen=True, kw_only=True)
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
    usable_to_hz: int | None = None
    """Up to which frequency it is usable, where it is not up to the one asked for but would be up to a lower one."""
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

    in_pieces: bool = False
    """Whether the longest piece, of which powers and coherence are, is much shorter than the run."""

    def words(self, axis: str | None = None) -> str:
        """In one line: `coherence 0.5-9.6 Hz   jitter 1 %   quiet 6.2 s before`; empty where nothing is known.

        Of the run's axis, or of every one where it is not known.
        """
        parts = []
        for name, follows in self.coherent.items():
            if axis in (None, name):
                what = "coherence" if axis else f"{name} coherence"
                parts.append(
                    f"{what} {follows.low_hz:.1f}-{follows.high_hz:.1f} Hz" if follows.share else f"{what} none"
                )
        for name, (low, high) in self.command_band_hz.items():
            if axis in (None, name):
                parts.append(f"{'power' if axis else f'{name} power'} {low:.1f}-{high:.1f} Hz")
        if parts and self.in_pieces:
            parts.append(f"(of the longest piece, {self.longest_piece_s:.1f} s)")
        if self.jitter >= JITTER_SHOWN:
            parts.append(f"jitter {100 * self.jitter:.0f} %")
        if self.input_correlation is not None and abs(self.input_correlation) >= TOGETHER_SHOWN:
            parts.append(f"inputs correlated {self.input_correlation:+.2f}")
        parts += [f"quiet {quiet.duration_s:.1f} s {quiet.where}" for quiet in self.quiet]
        parts += [latency.words for latency in self.latency[:1]]
        return "   ".join(parts)


@dataclass(frozen=True, eq=False, kw_only=True)
class _Measured:
    """A record, and all that the checks look at."""

    record: Record
    f_high_hz: float
    rate_hz: float
    edges: NDArray[np.int64]
    """First sample of each piece without a gap, and the one behind the last."""
    jitter: float
    excitation: Mapping[str, tuple[float, float]]
    commands: tuple[str, ...]
    saturated: Mapping[str, float]
    clipped: Mapping[str, int]
    spectra: Spectra
    planned_s: float | None
    maneuver_s: float | None
    slow_channels: Mapping[str, float]
    sweep: str

    @property
    def gaps(self) -> tuple[tuple[float, float], ...]:
        t = self.record.t
        return tuple((float(t[i - 1]), float(t[i])) for i in self.edges[1:-1].tolist())

    @property
    def longest_s(self) -> float:
        """Of the pieces without a gap."""
        t = self.record.t
        return max(float(t[stop - 1] - t[start]) for start, stop in pairwise(self.edges.tolist()))

    @property
    def used_s(self) -> float:
        """Of the pieces without a gap that are long enough for a fit."""
        t = self.record.t
        lengths = (float(t[stop - 1] - t[start]) for start, stop in pairwise(self.edges.tolist()))
        return sum(length for length in lengths if length >= SHORTEST_PIECE_S)

    @property
    def in_pieces(self) -> bool:
        """Whether the longest piece is so short that its spectra are not those of the run."""
        return self.longest_s < MOST_OF_IT * self.record.duration_s

    @property
    def mistaken_time(self) -> str | None:
        return _mistaken_time(self.record, self.rate_hz)


@dataclass(frozen=True)
class _Finding:
    text: str
    reason: bool = True
    """Whether it makes the run unusable; else it is a note."""


def _note(text: str) -> _Finding:
    return _Finding(text, reason=False)


def check(
    record: Record,
    *,
    planned_s: float | None = None,
    maneuver_s: float | None = None,
    slow_channels: Mapping[str, float] | None = None,
    f_high_hz: float = F_HIGH_HZ,
    sweep: str = ANY,
) -> Health:
    """Check one record.

    planned_s and maneuver_s: how long the maneuver was to last and lasted, where known. slow_channels: median spacing
    of the fields behind channels that were logged more slowly than the rates. sweep: how a chirp is flown with what
    logged it.
    """
    edges, rate = _pieces(record, f_high_hz)
    inside_s = np.delete(np.diff(record.t), edges[1:-1] - 1)
    excitation = strength(record, f_high_hz)
    commands = tuple(name for name in ("delta_x", "delta_y", "delta_e") if name in record.channels)
    saturated = {name: float(np.mean(np.abs(record.channels[name]) >= SATURATED)) for name in commands}
    run = _Measured(
        record=record,
        f_high_hz=f_high_hz,
        rate_hz=rate,
        edges=edges,
        jitter=float(np.std(inside_s) / np.median(inside_s)) if inside_s.size else 0.0,
        excitation=excitation,
        commands=commands,
        saturated={name: share for name, share in saturated.items() if share > 0},
        clipped={name: times for name in RATES if (times := times_clipped(record.channels[name])) > 0},
        spectra=spectra(record, excitation, edges, f_high_hz),
        planned_s=planned_s,
        maneuver_s=maneuver_s,
        slow_channels=slow_channels or {},
        sweep=sweep,
    )
    findings = [finding for checked in CHECKS for finding in checked(run)]
    reasons = tuple(finding.text for finding in findings if finding.reason)
    return Health(
        rate_hz=run.rate_hz,
        gaps=run.gaps,
        duration_s=record.duration_s,
        longest_piece_s=run.longest_s,
        excitation=run.excitation,
        saturated_share=run.saturated,
        usable=not reasons,
        reasons=reasons,
        usable_to_hz=_usable_to_hz(run) if reasons else None,
        notes=tuple(finding.text for finding in findings if not finding.reason),
        jitter=run.jitter,
        clipped=run.clipped,
        command_band_hz=run.spectra.command_band_hz,
        coherent=run.spectra.coherent,
        input_correlation=run.spectra.input_correlation,
        in_pieces=run.in_pieces,
    )


def _pieces(record: Record, f_high_hz: float) -> tuple[NDArray[np.int64], float]:
    """First sample of each piece without a gap and the one behind the last, and the rate outside the gaps, Hz."""
    at = gap_places(np.diff(record.t), f_high_hz)
    gaps = [(float(record.t[i - 1]), float(record.t[i])) for i in at.tolist()]
    return np.concatenate(([0], at, [record.t.size])), rate_hz(record.t, gaps)


def _usable_to_hz(run: _Measured) -> int | None:
    """The frequency up to which a run that is not usable would be: the highest one that uses most of it, or any."""
    if any(finding.reason for checked in CHECKS if checked not in BY_BAND for finding in checked(run)):
        return None
    below = []
    for f_high_hz in range(math.ceil(run.f_high_hz) - 1, LOWEST_BAND_HZ - 1, -1):
        edges, rate = _pieces(run.record, f_high_hz)
        lower = replace(run, f_high_hz=f_high_hz, edges=edges, rate_hz=rate)
        if not any(finding.reason for checked in BY_BAND for finding in checked(lower)):
            below.append(lower)
    enough = [lower for lower in below if lower.used_s >= MOST_OF_IT * run.record.duration_s]
    return next((round(lower.f_high_hz) for lower in (*enough, *below)), None)


def up_to_words(f_high_hz: int) -> str:
    """`usable up to 10 Hz: --band 0.3:10`."""
    return f"usable up to {f_high_hz} Hz: --band {BAND_FROM_HZ:g}:{f_high_hz}"


# ------------------------------------------------------------------------------------------------ the checks


def _sample_rate(run: _Measured) -> Iterator[_Finding]:
    wrong = run.mistaken_time or too_slow(run.record.rate_source, run.rate_hz, run.f_high_hz)
    if wrong is not None:
        yield _Finding(wrong)


def _slow_commands(run: _Measured) -> Iterator[_Finding]:
    needed_hz = 4 * run.f_high_hz
    for name in ("delta_x", "delta_y"):
        spacing = run.slow_channels.get(name, 0.0)
        if spacing > 1 / needed_hz * (1 + 1e-6):
            yield _Finding(
                f"{name} is logged at {1 / spacing:.0f} Hz only; at least {needed_hz:.0f} Hz are needed: "
                "log the command in every control loop"
            )


def _gyros(run: _Measured) -> Iterator[_Finding]:
    for name in RATES:
        values = run.record.channels[name]
        largest = float(np.abs(values).max())
        if values.min() == values.max():
            yield _Finding(f"{name} never changes ({values[0]:g}): the gyro was not logged, or is dead")
        elif largest > FASTEST_RAD_S:
            yield _Finding(
                f"{name} reaches {largest:.0f} rad/s: are these degrees? Give scale = 0.017453292519943295 in a profile"
            )
        elif name in run.clipped:
            yield _note(clipped_words(run.record, name, run.clipped[name]))


def _still_commands(run: _Measured) -> Iterator[_Finding]:
    channels = run.record.channels
    if run.record.axis in BESIDE or any(run.excitation[axis][0] >= COMMAND_RMS for axis in BESIDE & {*run.excitation}):
        return
    still = [name for name in ("delta_x", "delta_y") if np.ptp(channels[name]) == 0]
    if len(still) == 2 and run.record.maneuver != "quiet":
        yield _Finding(
            f"neither delta_x nor delta_y ever changes ({channels['delta_x'][0]:g}, "
            f"{channels['delta_y'][0]:g}): the commands were not logged, or the profile names the wrong fields"
        )
    elif still:
        yield _note(f"{still[0]} never changes: this run tells nothing about it, join it with one on the other axis")


def _saturation(run: _Measured) -> Iterator[_Finding]:
    for name in run.commands:
        largest = float(np.abs(run.record.channels[name]).max())
        share = run.saturated.get(name, 0.0)
        beyond = int(np.count_nonzero(np.abs(run.record.channels[name]) > COMMAND_LIMIT))
        if beyond > BEYOND_REASON * run.record.t.size:
            yield _Finding(
                f"{name} reaches {largest:.4g}; commands are {CHANNELS[name]} of full command: "
                "give a scale in a profile (--profile FILE.toml)"
            )
        elif share > SATURATED_REASON:
            yield _Finding(f"{name} is at full command in {100 * share:.0f} % of the samples: fly with less amplitude")
        elif beyond:
            yield _note(
                f"{name} passes full command in {beyond} of {run.record.t.size} samples, by up to "
                f"{largest - 1:.2g}: a mixer is asked so, what the actuators do is limited (servo_saturation)"
            )
        elif share > SATURATED_NOTE:
            yield _note(f"{name} is at full command in {100 * share:.1f} % of the samples")


def _excitation(run: _Measured) -> Iterator[_Finding]:
    # With another unit of time the band from 0.3 Hz to f_high is not where it seems.
    if run.record.maneuver == "quiet" or run.mistaken_time is not None:
        return
    axis, excitation, sweep = run.record.axis, run.excitation, run.sweep
    if axis in BESIDE:
        command = next(name for each, name in COMMANDS if each == axis)
        lacking = [name for name in (command, ANSWERS[axis]) if name not in run.record.channels]
        if lacking:
            yield _Finding(f"{axis} was swept, but {' and '.join(lacking)} is not logged: nothing shows how it answers")
            return
        excitation, sweep = {axis: excitation[axis]}, "sweep it with more amplitude"
    if not any(command >= COMMAND_RMS and rate >= RATE_RMS for command, rate in excitation.values()):
        axes = "; ".join(
            f"{axis} command {command:.2g} of full and rate {rate:.2g} rad/s rms"
            for axis, (command, rate) in excitation.items()
        )
        yield _Finding(f"no excitation: {axes}; {sweep}")


def _irregular_samples(run: _Measured) -> Iterator[_Finding]:
    if run.gaps:
        yield _note(_gaps_in_words(run.gaps) + _used_in_words(run))
    if run.jitter > JITTER_NOTE:
        yield _note(
            f"the samples come irregularly: spacing {1000 / run.rate_hz:.1f} ms with a standard deviation of "
            f"{100 * run.jitter:.0f} %; they are resampled by their time stamps"
        )


def _coherence(run: _Measured) -> Iterator[_Finding]:
    if run.record.maneuver != "chirp" or run.in_pieces:
        return  # a piece of a sweep does not sweep the whole band
    for axis, coherent in run.spectra.coherent.items():
        if coherent.share < ENOUGH_COHERENT and run.record.axis in (None, axis):
            yield _note(
                f"the rates follow the {axis} command in only {100 * coherent.share:.0f} % of the band where it has "
                "power: more amplitude, or less wind"
            )


def _separable(run: _Measured) -> Iterator[_Finding]:
    together = run.spectra.input_correlation
    if together is not None and abs(together) > TOGETHER and run.record.maneuver != "quiet":
        yield _note(
            f"delta_x and delta_y move together (correlation {together:+.2f}): the two inputs cannot be separated in "
            "this run, join it with another in which they move otherwise"
        )


def _length(run: _Measured) -> Iterator[_Finding]:
    if run.gaps and run.longest_s < SHORTEST_PIECE_S:
        yield _Finding(_no_piece_in_words(run))
    elif run.gaps and run.used_s < SHORTEST_RUN_S <= run.record.duration_s:
        yield _Finding(
            f"only {run.used_s:.1f} s lie in pieces of at least {SHORTEST_PIECE_S:g} s without a gap; at least "
            f"{SHORTEST_RUN_S:g} s are needed: {_without_gaps(run)}"
        )
    elif run.record.duration_s < SHORTEST_RUN_S:
        yield _Finding(
            f"only {run.record.duration_s:.1f} s long; at least {SHORTEST_RUN_S:g} s are needed: fly it longer, or "
            "widen the window that cuts it"
        )
    if run.planned_s is not None and run.maneuver_s is not None and run.maneuver_s < run.planned_s - 0.5:
        yield _note(f"cut short: {run.maneuver_s:.1f} s of {run.planned_s:.1f} s were flown")


CHECKS: tuple[Callable[[_Measured], Iterator[_Finding]], ...] = (
    _sample_rate,
    _slow_commands,
    _gyros,
    _still_commands,
    _saturation,
    _excitation,
    _irregular_samples,
    _coherence,
    _separable,
    _length,
)
"""In the order in which reasons and notes are told."""

BY_BAND = (_sample_rate, _slow_commands, _length)
"""Those whose reasons depend on how high the band reaches."""


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


def _no_piece_in_words(run: _Measured) -> str:
    spacing_s = float(np.median(np.diff(run.record.t)))
    share = min(1.0, run.record.t.size * spacing_s / run.record.duration_s)
    return (
        f"no piece of {SHORTEST_PIECE_S:g} s without a gap (the longest is {run.longest_s:.2f} s; {len(run.gaps)} gaps "
        f"of at most {1000 * max(stop - start for start, stop in run.gaps):.0f} ms, {100 * share:.0f} % of the samples "
        f"are there): {_without_gaps(run)}"
    )


def _without_gaps(run: _Measured) -> str:
    """What to do about a run with too many gaps."""
    if run.record.rate_source in TELEMETRY:
        return "take the vehicle's own log instead of the telemetry"
    return "log to a faster medium, or log less beside the rates"


def _used_in_words(run: _Measured) -> str:
    """How much of the run is left in pieces that a fit takes, where that is not all."""
    if run.used_s >= 0.99 * (run.record.duration_s - sum(stop - start for start, stop in run.gaps)):
        return ""
    return f"; {run.used_s:.1f} of {run.record.duration_s:.1f} s lie in pieces of at least {SHORTEST_PIECE_S:g} s"


def _mistaken_time(record: Record, rate_hz: float) -> str | None:
    """Whether the times of a CSV look as if they were not seconds, and what to write then."""
    if record.rate_source != "csv":
        return None
    for name, scale in TIMES[1:]:
        if LIKELY_HZ[0] <= rate_hz / scale <= LIKELY_HZ[1]:
            return (
                f"time goes on by {1 / rate_hz:g} from row to row, which would be {rate_hz:.3g} Hz: is it in {name}? "
                f"t is in seconds; convert it, or name it in a profile: [time] source = ..., scale = {scale:g} "
                "(where it is in seconds, log faster)"
            )
    return None
