"""Whether a run can be identified from, and if not, why and what to do about it.

Every check looks at the record alone and answers in sentences. A reason makes the run unusable; a note does not.
The thresholds are those of the fit: f_high is the highest frequency it uses, a gap is a spacing above
max(3 medians, 1/(4 f_high)), and pieces between gaps under 2 s are dropped.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from sysid.record import CHANNELS, Record

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

SWEEP = "fly a chirp: tippath sweep --connect LINK --axis roll, then pitch (and elevator in forward flight)"
LIKELY_HZ = (40.0, 5000.0)  # what vehicles log their rates at
UNITS_OF_TIME = (("milliseconds", 1e-3), ("microseconds", 1e-6), ("nanoseconds", 1e-9))


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
    longest = max(float(t[stop - 1] - t[start]) for start, stop in pairwise(edges.tolist()))
    excitation = {
        axis: (_band_rms(t, record.channels[command], f_high_hz), _band_rms(t, record.channels[rate], f_high_hz))
        for axis, command, rate in (("roll", "delta_x", "p"), ("pitch", "delta_y", "q"), ("elevator", "delta_e", "q"))
        if axis != "elevator" or (record.axis == axis and command in record.channels)
    }
    commands = [name for name in ("delta_x", "delta_y", "delta_e") if name in record.channels]
    saturated = {name: float(np.mean(np.abs(record.channels[name]) >= SATURATED)) for name in commands}
    saturated = {name: share for name, share in saturated.items() if share > 0}

    reasons: list[str] = []
    notes: list[str] = []
    needed_hz = 4 * f_high_hz
    mistaken = _mistaken_time(record, rate_hz)
    if mistaken is not None:
        reasons.append(mistaken)
    elif rate_hz < needed_hz * (1 - 1e-6):
        advice = "switch fast attitude logging on (LOG_BITMASK bit 0 on ArduPilot), or log faster"
        reasons.append(
            f"the rates are logged at {rate_hz:.1f} Hz; up to {f_high_hz:g} Hz at least {needed_hz:.0f} Hz are needed: "
            + ("log faster" if record.rate_source == "csv" else advice)
        )
    for name in ("delta_x", "delta_y"):
        spacing = (slow_channels or {}).get(name, 0.0)
        if spacing > 1 / needed_hz * (1 + 1e-6):
            reasons.append(
                f"{name} is logged at {1 / spacing:.0f} Hz only; at least {needed_hz:.0f} Hz are needed: "
                "log the command in every control loop"
            )
    reasons += _values(record, commands, saturated, notes)
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
        longest_gap = max(stop - start for start, stop in gaps)
        word = "gap" if len(gaps) == 1 else "gaps"
        notes.append(f"{len(gaps)} {word} in the samples, the longest {longest_gap:.2f} s: pieces are fitted apart")
    if longest < SHORTEST_PIECE_S:
        reasons.append(
            f"no piece of {SHORTEST_PIECE_S:g} s without a gap (the longest is {longest:.2f} s): "
            "log to a faster medium or take the log from the vehicle instead of the telemetry"
        )
    elif record.duration_s < SHORTEST_RUN_S:
        reasons.append(f"only {record.duration_s:.1f} s long; at least {SHORTEST_RUN_S:g} s are needed: fly it again")
    if planned_s is not None and maneuver_s is not None and maneuver_s < planned_s - 0.5:
        notes.append(f"cut short: {maneuver_s:.1f} s of {planned_s:.1f} s were flown")
    return Health(
        rate_hz, gaps, record.duration_s, longest, excitation, saturated, not reasons, tuple(reasons), tuple(notes)
    )


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


def _values(record: Record, commands: list[str], saturated: Mapping[str, float], notes: list[str]) -> list[str]:
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
        elif (clipped := _clipped(values)) > 0:
            notes.append(
                f"{name} stands at its largest value {clipped} times for {CLIPPED_SAMPLES} samples or more: clipped?"
            )
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


def _clipped(values: FloatArray) -> int:
    """How often the largest magnitude is held for some samples in a row."""
    top = np.abs(values) == np.abs(values).max()
    edges = np.flatnonzero(np.diff(np.concatenate(([0], top.astype(np.int8), [0]))))
    return int(np.count_nonzero(edges[1::2] - edges[::2] >= CLIPPED_SAMPLES))


def _band_rms(t: FloatArray, values: FloatArray, f_high_hz: float) -> float:
    """Root mean square of what lies between 0.3 Hz and f_high, on a uniform grid over gaps."""
    count = max(4, min(t.size, 1 << 18))
    grid = np.linspace(t[0], t[-1], count)
    spectrum = np.fft.rfft(np.interp(grid, t, values - values.mean()))
    hz = np.fft.rfftfreq(count, (t[-1] - t[0]) / (count - 1))
    band = (hz >= F_LOW_HZ) & (hz <= f_high_hz)
    return float(np.sqrt(2 * np.sum(np.abs(spectrum[band]) ** 2)) / count)
