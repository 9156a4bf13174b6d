"""What a log tells about a run beyond its record: armed or not, quiet hover beside it, actuators that are not there.

A record has no place for these, and without them its verdict is often the wrong one: rates that do not move are a
vehicle on the bench, commands that never change are motors that all got the same.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from gcs.errors import TippathError
from gcs.logs.formats.tables import FloatArray, Log, Series, stretches
from gcs.logs.profile import mapping
from gcs.logs.profile.profiles import Profile
from gcs.logs.profile.sources import keys_of
from gcs.logs.runs.health import F_HIGH_HZ, Quiet, too_slow
from gcs.logs.runs.spectra import COMMAND_RMS
from sysid.data.record import RATES

KNOWN_LATE_S = 5.0
"""A state of arming that is told so soon after the first sample was that of the start."""
QUIET_S = 5.0
"""Shorter, and the noise floor's lowest frequencies have no periods."""
QUIET_WITHIN_S = 60.0
"""Of the run: later the wind is another."""
QUIET_SHARE = 0.3
"""Of the rates' rms in the run, over any second: more is a maneuver, or a gust as large as one."""
QUIET_RATE = 0.02
"""rad/s: what hover in still air has anyway, and so is always quiet."""
SAME_OUTPUT = 1e-6
"""Of their size; motor outputs come as whole microseconds or as float32."""
LISTED = 6
MESSAGES = 60
"""Kinds that are looked at for a first sample or a rate; all of them are there in any log."""
MOTORS = (
    ("RCOU.C1", "RCOU.C2", "RCOU.C3", "RCOU.C4"),
    ("RCOU.Ch1", "RCOU.Ch2", "RCOU.Ch3", "RCOU.Ch4"),
    tuple(f"SERVO_OUTPUT_RAW.servo{i}_raw" for i in (1, 2, 3, 4)),
    tuple(f"actuator_motors.control[{i}]" for i in range(4)),
    tuple(f"actuator_outputs.output[{i}]" for i in range(4)),
)
"""Where autopilots log what goes to four motors, or to a swashplate and a tail: never all equal in flight."""


_DIGITS = re.compile(r"\d+")


def disarmed(log: Log, start_s: float, stop_s: float) -> str | None:
    """Why the run is worth nothing, where the vehicle was disarmed throughout it; None where it was armed, or unknown.

    Ends may be infinite.
    """
    told = sorted(log.armed())
    if not told:
        return None
    ever = any(state for _, state in told)
    at_start = next((state for t, state in reversed(told) if t <= start_s), None)
    if at_start is None or not ever:
        # A vehicle's own events tell of changes, so before the first it was the other way; elsewhere it is a state.
        began = _first_sample(log) if log.kind == "dataflash" else None
        known = began is None or told[0][0] <= began + KNOWN_LATE_S
        initially = told[0][1] if known else not told[0][1]
        if not initially and not ever:
            return "disarmed throughout: the vehicle was never armed in this log; log a flight"
        at_start = initially if at_start is None else at_start
    if at_start or any(state for t, state in told if start_s < t <= stop_s):
        return None
    return "disarmed throughout this run: the vehicle was armed only in other parts of the log"


def _first_sample(log: Log) -> float | None:
    clocks = [series.t for series in _one_of_each(log).values() if series.t.size > 1]
    return min((float(t[0]) for t in clocks), default=None)


def _one_of_each(log: Log) -> dict[str, Series]:
    """The first field of each kind of message."""
    firsts: dict[str, str] = {}
    for key in log.fields():
        firsts.setdefault(key.split(".")[0], key)
    return {name: log.series(key) for name, key in list(firsts.items())[:MESSAGES] if log.has(key)}


def quiet(
    log: Log,
    profile: Profile,
    at: tuple[float, float],
    rms: float,
    others: Sequence[tuple[float, float]],
) -> tuple[Quiet, ...]:
    """The longest quiet stretch before a run and after it, each of at least `QUIET_S`.

    at: its start and stop, s. rms: of the run's rates, rad/s. others: start and stop of the other runs of the log.
    """
    start_s, stop_s = at
    earlier = max((stop for start, stop in others if start < start_s), default=-math.inf)
    later = min((start for start, stop in others if stop > stop_s), default=math.inf)
    quiet_ones = []
    for where, low, high in (
        ("before", max(start_s - QUIET_WITHIN_S, earlier), start_s),
        ("after", stop_s, min(stop_s + QUIET_WITHIN_S, later)),
    ):
        if high - low < QUIET_S or not math.isfinite(high - low):
            continue
        only = {name: profile.channels[name] for name in ("p", "q", "delta_x", "delta_y") if name in profile.channels}
        try:
            channels = mapping.apply(replace(profile, channels=only), log, low, high).channels
        except TippathError:
            continue
        stretch = _longest_quiet(channels, max(QUIET_RATE, QUIET_SHARE * rms))
        if stretch is not None and disarmed(log, *stretch) is None:
            quiet_ones.append(Quiet(stretch[0], stretch[1] - stretch[0], where))
    return tuple(quiet_ones)


def _longest_quiet(channels: Mapping[str, FloatArray], most: float) -> tuple[float, float] | None:
    """The longest run of seconds in which both rates stay below `most` rms about their mean, and the commands move."""
    t = channels["t"]
    second = np.floor(t - t[0]).astype(np.int64)
    count = int(second[-1]) + 1
    samples = np.bincount(second, minlength=count)
    usual = float(np.median(samples[samples > 0]))
    good = samples >= 0.5 * usual
    for name in RATES:
        values = channels[name] - float(np.median(channels[name]))
        mean_square = np.bincount(second, values**2, minlength=count) / np.maximum(samples, 1)
        good &= mean_square <= most**2
    for a, b in sorted(stretches(good), key=lambda piece: piece[0] - piece[1]):
        start, stop = float(t[0]) + a, min(float(t[0]) + b, float(t[-1]))
        inside = (t >= start) & (t <= stop)
        flies = np.ptp(channels["delta_x"][inside]) > 0 or np.ptp(channels["delta_y"][inside]) > 0
        if stop - start >= QUIET_S and flies:
            return start, stop
    return None


def slow_rates(log: Log, profile: Profile, f_high_hz: float = F_HIGH_HZ) -> str | None:
    """That the rates of a log from which no record can be cut are too slow besides; None where they are not."""
    rates = _rates(log, profile)
    if not rates:
        return None
    best = min(rates, key=lambda key: log.series(key).spacing_s)
    series = log.series(best)
    return None if series.t.size < 2 else too_slow(best.split(".")[0], 1 / series.spacing_s, f_high_hz)


def no_actuators(log: Log, profile: Profile) -> str | None:
    """That a log with rates lacks the commands; None where it has them, or no rates either."""
    wanted = [name for name in ("delta_x", "delta_y") if not _had(log, profile, name)]
    if not wanted or not _rates(log, profile):
        return None
    asked = dict.fromkeys(
        key.split(".")[0]
        for name in wanted
        if name in profile.channels
        for text in profile.channels[name].sources
        for key in keys_of(text, log)
    )
    return (
        f"actuators not logged: no {' or '.join(asked) or 'commands'} for {', '.join(wanted)} "
        f"(there is {_listed(log)}); log what goes to the servos or motors in every control loop, or name its "
        "fields in a profile: --profile FILE.toml (ingest --explain shows how)"
    )


def _rates(log: Log, profile: Profile) -> list[str]:
    return [key for channel in RATES for key in _had(log, profile, channel)]


def _had(log: Log, profile: Profile, channel: str) -> list[str]:
    """The first field of each source of a channel of which all fields are there."""
    if channel not in profile.channels:
        return []
    keys = [keys_of(text, log) for text in profile.channels[channel].sources]
    return [fields[0] for fields in keys if fields and all(log.has(key) for key in fields)]


def _listed(log: Log) -> str:
    """`RATE at 400 Hz, ATT at 10 Hz`: the fastest messages."""
    clocks = _one_of_each(log)
    rates = {name: 1 / clock.spacing_s for name, clock in clocks.items() if clock.t.size > 2 and clock.spacing_s > 0}
    fastest = sorted(rates, key=lambda name: -rates[name])[:LISTED]
    return ", ".join(f"{name} at {rates[name]:.3g} Hz" for name in fastest) or "nothing that is logged regularly"


def equal_motors(
    log: Log, sources: Mapping[str, str], excitation: Mapping[str, tuple[float, float]], start_s: float, stop_s: float
) -> str | None:
    """That all motors got the same throughout, so that no moment acted, whatever was commanded; else None.

    Of the outputs that the commands are worked out from, or, where commands that move are logged apart, of the usual
    ones. excitation: axis -> rms of (command, rate).
    """
    worked_out = [keys_of(sources[name], log) for name in ("delta_x", "delta_y") if name in sources]
    worked_out = [keys for keys in worked_out if len(keys) > 1]
    if worked_out:
        families = [tuple(dict.fromkeys(key for keys in worked_out for key in keys))]
    elif max((command for command, _ in excitation.values()), default=0.0) >= COMMAND_RMS:
        families = [keys for keys in MOTORS if all(log.has(key) for key in keys)][:1]
        families = [keys for keys in families if not _others_move(log, keys, start_s, stop_s)]
    else:
        families = []
    return next((reason for keys in families if (reason := _all_equal(log, keys, start_s, stop_s))), None)


def _others_move(log: Log, keys: Sequence[str], start_s: float, stop_s: float) -> bool:
    """Whether further outputs of the same message move: the motors are on those."""
    alike = [key for key in log.fields() if key not in keys and _DIGITS.sub("#", key) == _DIGITS.sub("#", keys[0])]
    values = [log.series(key).part(start_s, stop_s).values for key in alike if log.has(key)]
    return any(np.ptp(output[np.isfinite(output)]) > 0 for output in values if np.isfinite(output).any())


def _all_equal(log: Log, keys: Sequence[str], start_s: float, stop_s: float) -> str | None:
    parts = [log.series(key).part(start_s, stop_s) for key in keys if log.has(key)]
    if len(parts) < 2 or len({part.t.size for part in parts}) > 1 or not parts[0].t.size:
        return None
    outputs = np.stack([part.values for part in parts])
    outputs = outputs[:, np.all(np.isfinite(outputs), axis=0)]
    if not outputs.size or np.any(np.ptp(outputs, axis=0) > SAME_OUTPUT * np.abs(outputs).max()):
        return None
    low, high = float(outputs.min()), float(outputs.max())
    at = f"at {low:g}" if high - low <= SAME_OUTPUT * abs(high) else f"between {low:g} and {high:g}"
    return (
        f"roll commands and motors equal: no moment ({', '.join(keys)} are all the same throughout, {at}); "
        "the vehicle did not fly here, or the profile names the wrong outputs"
    )
