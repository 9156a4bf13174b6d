"""A profile applied: the channels of a stretch of a log, on one clock.

p and q come from one kind of message, and its clock becomes the record's. Every other channel is brought onto that
clock without inventing anything: fields of the same clock as they are; fields of the same rate by the nearest sample
within half a sample; slower commands hold their last value, as the vehicle held it, unless its loop is known to have
moved them meanwhile; those and other slow fields (rotor speed, attitude) are interpolated. A row whose required
channels have no partner is left out and becomes a gap.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from gcs.errors import TippathError
from gcs.logs.formats.tables import TABLES, FloatArray, Log, Series, stretches
from gcs.logs.profile.profiles import ChannelSource, Profile
from gcs.logs.profile.sources import Stretch, bind
from sysid.data.preprocess import EVERY_LOOP
from sysid.data.record import CHANNELS, RATES, REQUIRED

COMMANDS = ("delta_", "excitation_")
ABSURD = 1e6  # in any channel's unit
MOST: Mapping[str, float] = MappingProxyType({"rad/s": 500.0, "-1..1": 10.0})
"""By unit; rotors are quicker than gyros."""
FASTEST_RAD_S = 60.0
"""No gyro measures more."""
USUAL_RAD_S = 1.0
"""Median of a rate in flight at most: where it is more, the unit is wrong and not the samples."""
MOST_BAD = 0.1
"""Share of samples that no gyro can have measured, of a rate whose other ones are believed."""
FEW = 0.01  # share of rows that may be given up for an optional channel
FEWEST_BETWEEN = 8  # samples of a command from which on it is followed between them
SLOWER = 1.5  # a field is slower than the clock when its spacing is this much longer


@dataclass(frozen=True, eq=False, kw_only=True)
class Mapped:
    """The channels of one stretch of a log."""

    channels: Mapping[str, FloatArray]
    """`t` and the channels found, equal lengths."""
    sources: Mapping[str, str]
    """Channel -> field or arithmetic that it came from."""
    absent: Mapping[str, str]
    """Channel of the profile -> why it is not there."""
    rate_source: str
    """The kind of message p and q came from."""
    spacing_s: Mapping[str, float]
    """Channel -> median spacing of the field it came from, where that is slower than the record."""
    rows_dropped: int
    """Samples left out because a required channel had no partner."""
    notes: tuple[str, ...] = ()
    """What was left out beside these, and why."""


class ChannelsMissing(TippathError):
    """A required channel cannot be had from this log."""


class OutsideLog(TippathError):
    """The log has no samples at that time."""

    def __init__(self, text: str, first_s: float, last_s: float) -> None:
        super().__init__(text)
        self.first_s = first_s
        self.last_s = last_s
        """Times of the first and last sample of the rates."""


def apply(
    profile: Profile, log: Log, start_s: float = -math.inf, stop_s: float = math.inf, *, loop_s: float | None = None
) -> Mapped:
    """The channels between two times of the log's own clock; `loop_s` is how long the vehicle held a command.

    Raises ChannelsMissing where a required channel is not in the log, OutsideLog where the log does not reach there,
    TippathError where the profile makes no sense.
    """
    missing = [name for name in REQUIRED if name != "t" and name not in profile.channels]
    if missing:
        raise ChannelsMissing(_what_is_missing(profile, log, missing))
    stretch = Stretch(log, start_s, stop_s)
    _require_overlap((*profile.channels["p"].sources, *profile.channels["q"].sources), stretch)
    p, q = _rates(profile, stretch)
    base = bind(p, log).fields[0]
    clock = log.series(_time_key(profile, log) or base).part(start_s, stop_s)
    if clock.t.size < 2:
        raise ChannelsMissing(f"{log.path}: fewer than two samples of {base}{_between(stretch)}")
    aligned: dict[str, _Aligned] = {}
    absent: dict[str, str] = {}
    valid = np.ones(clock.t.size, np.bool_)
    unmeasured = np.zeros(clock.t.size, np.bool_)
    notes: list[str] = []
    for channel in sorted(profile.channels.values(), key=lambda channel: channel.channel not in REQUIRED):
        name = channel.channel
        texts = {"p": (p,), "q": (q,)}.get(name, channel.sources)
        values = _aligned(channel, texts, clock, stretch, loop_s, late_s=profile.commands_late_s)
        if isinstance(values, str):
            absent[name] = values
            continue
        good = _possible(name, values.values)
        if name in RATES and (bad := _no_gyro(values.values)).any():
            notes.append(_no_gyro_in_words(name, clock.t, values.values, bad))
            unmeasured |= bad
            good |= bad
        lost = float(np.mean(~good[valid])) if valid.any() else 0.0
        if name not in REQUIRED and lost > FEW:
            absent[name] = f"{values.source} has no value for {100 * lost:.0f} % of the samples"
            continue
        valid &= good
        aligned[name] = values
    no_partner = int(np.count_nonzero(~valid & ~unmeasured))
    valid &= ~unmeasured
    if np.count_nonzero(valid) < 2:
        raise ChannelsMissing(
            f"{log.path}: no sample has {', '.join(REQUIRED[1:])} together between {clock.t[0]:.3f} and "
            f"{clock.t[-1]:.3f} s; the messages they come from do not overlap, or hold no finite numbers"
        )
    return Mapped(
        channels={"t": clock.t[valid], **{name: each.values[valid] for name, each in aligned.items()}},
        sources={name: each.source for name, each in aligned.items()},
        absent=absent,
        rate_source="csv" if log.kind == "csv" else base.split(".")[0].split("[")[0],
        spacing_s={n: each.spacing_s for n, each in aligned.items() if each.spacing_s > SLOWER * clock.spacing_s},
        rows_dropped=no_partner,
        notes=tuple(notes),
    )


def _rates(profile: Profile, stretch: Stretch) -> tuple[str, str]:
    """The sources of p and q: the first pair of one kind of message that covers half of what the longest does.

    Raises ChannelsMissing where there is none, or no command.
    """
    pairs = [
        (p, q, min(stretch.covered_s(p), stretch.covered_s(q)))
        for p, q in zip(profile.channels["p"].sources, profile.channels["q"].sources, strict=False)
        if stretch.has(p) and stretch.has(q)
    ]
    absent = [name for name in REQUIRED[1:] if stretch.first_of(profile.channels[name].sources) is None]
    if absent or not pairs:
        raise ChannelsMissing(_what_is_missing(profile, stretch.log, absent or ["p", "q"]))
    most = max(covered for _, _, covered in pairs)
    return next((p, q) for p, q, covered in pairs if covered >= 0.5 * most)


@dataclass(frozen=True, eq=False)
class _Aligned:
    """A channel on the record's clock."""

    values: FloatArray
    """Shape of the clock; not finite where there is none."""
    source: str
    spacing_s: float
    """Of the slowest field it came from."""


def _aligned(
    channel: ChannelSource,
    texts: Sequence[str],
    clock: Series,
    stretch: Stretch,
    loop_s: float | None,
    *,
    late_s: float,
) -> _Aligned | str:
    """A channel on the record's clock, or why there is none."""
    text = stretch.first_of(texts)
    if text is None:
        return f"the log has no {' or '.join(channel.sources)}"
    expression = bind(text, stretch.log)
    series = {key: stretch.log.series(key) for key in expression.fields}
    coarsest = max((spacing_near(clock, each) for each in series.values() if each.t.size > 1), default=clock.spacing_s)
    if channel.channel not in REQUIRED and channel.min_rate_hz and coarsest > 1 / channel.min_rate_hz:
        return f"{text} is logged at {1 / coarsest:.0f} Hz, {channel.min_rate_hz:.0f} Hz are needed"
    command = channel.channel.startswith(COMMANDS)
    held = command and (loop_s is None or loop_s >= EVERY_LOOP * coarsest)
    if command and (late_s or not held):
        result = expression.evaluate({key: moving_onto(clock, each, late_s) for key, each in series.items()})
    else:
        result = expression.evaluate({key: onto(clock, each, held) for key, each in series.items()})
    return _Aligned(np.broadcast_to(channel.scale * result + channel.offset, clock.t.shape), text, coarsest)


def _possible(name: str, values: FloatArray) -> NDArray[np.bool_]:
    """Which values can have been measured, shape (n,): a flipped bit makes numbers that nothing takes.

    Where many are beyond what a vehicle does, the unit is wrong and not the sample: they stay, and the health says so.
    """
    possible = np.isfinite(values) & (np.abs(values) < ABSURD)
    limit = MOST.get(CHANNELS[name])
    if limit is not None:
        beyond = possible & (np.abs(values) > limit)
        if np.mean(beyond) <= FEW:
            possible &= ~beyond
    return possible


def _no_gyro(values: FloatArray) -> NDArray[np.bool_]:
    """Which samples of a rate in rad/s a gyro cannot have measured, shape (n,), with the ramps to and from them.

    None where most samples are large: then the unit is wrong, and the health says so.
    """
    size = np.abs(values)
    with np.errstate(invalid="ignore"):
        bad = size > FASTEST_RAD_S
    if not bad.any() or np.mean(bad) > MOST_BAD or not np.nanmedian(size) <= USUAL_RAD_S:
        return np.zeros(values.shape, np.bool_)
    for start, stop in stretches(bad):
        while start > 0 and USUAL_RAD_S < size[start - 1] < size[start]:
            start -= 1
            bad[start] = True
        while stop < size.size and USUAL_RAD_S < size[stop] < size[stop - 1]:
            bad[stop] = True
            stop += 1
    return bad


def _no_gyro_in_words(name: str, t: FloatArray, values: FloatArray, bad: NDArray[np.bool_]) -> str:
    where = stretches(bad)
    first, last = where[0][0], where[-1][1] - 1
    at_end = len(where) == 1 and last == bad.size - 1
    count = int(np.count_nonzero(bad))
    which = f"the last {count} samples, from {t[first]:.2f} s on," if at_end else f"{count} samples"
    between = "" if at_end else f" (between {t[first]:.2f} and {t[last]:.2f} s)"
    return (
        f"{which} left out{between}: {name} reaches {np.nanmax(np.abs(values[bad])):.0f} rad/s there, which no gyro "
        f"measures, while half of all samples are below {np.nanmedian(np.abs(values)):.2g} rad/s"
    )


def _require_overlap(sources: Sequence[str], stretch: Stretch) -> None:
    """Raises OutsideLog where the rates are logged, but not in this stretch."""
    log = stretch.log
    fields = {key for text in sources for key in bind(text, log).fields if log.has(key)}
    clocks = [t for t in (log.series(key).t for key in sorted(fields)) if t.size]
    if not clocks:
        return
    first, last = min(float(t[0]) for t in clocks), max(float(t[-1]) for t in clocks)
    if stretch.stop_s < first or stretch.start_s > last:
        text = f"{log.path}: no samples{_between(stretch)}: the log runs from {first:.3f} to {last:.3f} s"
        raise OutsideLog(text, first, last)


def _between(stretch: Stretch) -> str:
    start_s, stop_s = stretch.start_s, stretch.stop_s
    if math.isinf(start_s) and math.isinf(stop_s):
        return ""
    if math.isinf(start_s):
        return f" before {stop_s:g} s"
    return f" after {start_s:g} s" if math.isinf(stop_s) else f" between {start_s:g} and {stop_s:g} s"


def _time_key(profile: Profile, log: Log) -> str | None:
    """The field whose clock the profile asks for, where it names its message too."""
    key = profile.time_source
    return key if key is not None and log.kind not in TABLES and log.has(key) else None


def onto(clock: Series, series: Series, held: bool) -> FloatArray:
    """A field's values at the clock's times, shape (n,); NaN where it has none."""
    if series.clock == clock.clock:
        first = int(np.searchsorted(series.t, clock.t[0]))
        if first + clock.t.size <= series.t.size and np.array_equal(series.t[first : first + clock.t.size], clock.t):
            return series.values[first : first + clock.t.size]
    spacing = clock.spacing_s
    if series.t.size == 0:
        return np.full(clock.t.shape, np.nan)
    if series.t.size > 1 and spacing_near(clock, series) <= SLOWER * spacing:
        right = np.clip(np.searchsorted(series.t, clock.t), 1, series.t.size - 1)
        nearest = right - (clock.t - series.t[right - 1] <= series.t[right] - clock.t)
        return np.where(np.abs(series.t[nearest] - clock.t) <= 0.5 * spacing, series.values[nearest], np.nan)
    if held:
        last = np.searchsorted(series.t, clock.t, "right") - 1
        return np.where(last >= 0, series.values[np.maximum(last, 0)], np.nan)
    beyond = 2 * series.spacing_s if series.t.size > 1 else np.inf
    values = np.interp(clock.t, series.t, series.values)
    inside = (clock.t >= series.t[0] - beyond) & (clock.t <= series.t[-1] + beyond)
    return np.where(inside, values, np.nan)


def moving_onto(clock: Series, series: Series, late_s: float = 0.0) -> FloatArray:
    """The values of a command that moved on between its samples, at the clock's times, shape (n,); NaN at its gaps.

    late_s: by which it was stamped too late.
    """
    clock = Series(clock.t + late_s, clock.values, clock.clock) if late_s else clock
    near = 4 * series.spacing_s
    part = series.part(float(clock.t[0]) - near, float(clock.t[-1]) + near)
    finite = np.isfinite(part.values)
    t, known = part.t[finite], part.values[finite]
    if t.size < FEWEST_BETWEEN or (not late_s and spacing_near(clock, series) <= SLOWER * clock.spacing_s):
        return onto(clock, series, held=True)
    # heavier than NumPy itself to load: only where it is needed
    from scipy.interpolate import CubicSpline

    behind = np.clip(np.searchsorted(t, clock.t), 1, t.size - 1)
    inside = (np.diff(t)[behind - 1] <= 3 * series.spacing_s) & (clock.t >= t[0]) & (clock.t <= t[-1])
    return np.where(inside, CubicSpline(t, known)(clock.t), np.nan)


def spacing_near(clock: Series, series: Series) -> float:
    """The median spacing of a field between the clock's ends, s: its rate may have been another before; else of all."""
    inside = series.part(float(clock.t[0]), float(clock.t[-1]))
    return inside.spacing_s if inside.t.size > 2 else series.spacing_s


def _what_is_missing(profile: Profile, log: Log, channels: Sequence[str]) -> str:
    parts = []
    for name in dict.fromkeys(channels):
        source = profile.channels.get(name)
        if source is None and profile.path:
            parts.append(f"{name} (not in the profile)")
        elif source is None or source.sources == (name,):
            parts.append(name)
        else:
            parts.append(f"{name} (from {' or '.join(source.sources)})")
    where = f"{log.path}, line 1" if log.kind == "csv" else log.path
    fields = log.fields()
    listed = ", ".join(fields[:12]) + (f" and {len(fields) - 12} more" if len(fields) > 12 else "")
    listed = listed or "no field with samples in it"
    word = "column" if log.kind == "csv" else "channel"
    return (
        f"{where}: {word} {', '.join(parts)} missing; profile {profile.name} does not find it. "
        f"The log has {listed}. Name the right fields in a profile: --profile FILE.toml (ingest --explain shows how)"
    )
