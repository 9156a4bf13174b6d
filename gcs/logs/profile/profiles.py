"""Log profiles: which field of a log is which channel, with scale, offset and arithmetic.

A profile is a TOML file. Those that come with the package are chosen by what the log holds; `--profile` names another.
p and q come from one kind of message, and its clock becomes the record's. Every other channel is brought onto that
clock without inventing anything: fields of the same clock as they are; fields of the same rate by the nearest sample
within half a sample; slower commands hold their last value, as the vehicle held it; other slow fields (rotor speed,
attitude) are interpolated. A row whose required channels have no partner is left out and becomes a gap.

[axes] says how the log's body axes lie where they are not ours (x forward, y right, z down); it turns the signs of all
channels that are measured along or about them. [settings] names the fields that hold what was flown: the log is then
cut into the stretches in which `active` is not zero.
"""

from __future__ import annotations

import difflib
import math
import tomllib
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from importlib import resources
from itertools import pairwise
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gcs.errors import TippathError
from gcs.logs.formats.csv import CsvFile, CsvLog, open_table
from gcs.logs.formats.tables import Log, Series
from gcs.logs.profile.expression import Expression
from gcs.logs.profile.units import factor_or_ask
from sysid.data.record import CHANNELS, REQUIRED

FloatArray = NDArray[np.float64]

KINDS = ("dataflash", "ulog", "tlog", "csv")
COMMANDS = ("delta_", "excitation_")
MANEUVERS = ("chirp", "doublet", "quiet", "unknown")
AXES = ("roll", "pitch", "elevator")
OTHER = "other"  # an axis that is excited but not identified: yaw, thrust
ABSURD = 1e6  # in any channel's unit
MOST: Mapping[str, float] = MappingProxyType({"rad/s": 500.0, "-1..1": 10.0})
"""By unit; rotors are quicker than gyros."""
FEW = 0.01  # share of rows that may be given up for an optional channel
OUR_AXES: Mapping[str, tuple[str, str]] = MappingProxyType(
    {"x": ("forward", "backward"), "y": ("right", "left"), "z": ("down", "up")}
)
"""Axis -> how ours lies, and the other way."""
ALONG: Mapping[str, tuple[str, ...]] = MappingProxyType(
    {"x": ("p", "phi", "ax", "u"), "y": ("q", "theta", "ay", "v"), "z": ("r", "az", "w")}
)
"""Axis -> channels measured along or about it."""
SLOWER = 1.5  # a field is slower than the clock when its spacing is this much longer


@dataclass(frozen=True)
class ChannelSource:
    """value = scale * source + offset."""

    channel: str
    sources: tuple[str, ...]
    """Alternatives, best first: fields or arithmetic on fields."""
    scale: float = 1.0
    offset: float = 0.0
    min_rate_hz: float = 0.0
    """An optional channel that is logged more slowly is left out."""


@dataclass(frozen=True)
class Cut:
    """A run that the profile cuts out of the log, in seconds of the log's own time."""

    start_s: float
    stop_s: float
    maneuver: str = "unknown"
    axis: str | None = None
    swept_band_hz: tuple[float, float] | None = None


@dataclass(frozen=True)
class Settings:
    """Fields (or arithmetic on fields) that hold what was flown."""

    active: str
    """Not zero while a maneuver is flown."""
    axis: str | None = None
    """The number of the excited axis: a place, from 0, in `axes`."""
    axes: tuple[str, ...] = ("roll", "pitch")
    """One of `AXES` each, or `other`."""
    f_start_hz: str | None = None
    f_stop_hz: str | None = None
    amplitude: str | None = None
    maneuver: str = "chirp"

    @property
    def sources(self) -> tuple[str, ...]:
        named = (self.active, self.axis, self.f_start_hz, self.f_stop_hz, self.amplitude)
        return tuple(text for text in named if text is not None)


@dataclass(frozen=True)
class Profile:
    """Where the channels of a kind of log come from."""

    name: str
    channels: Mapping[str, ChannelSource]
    path: str = ""
    """The file it was read from."""
    kind: str | None = None
    """One of `KINDS`; None fits any."""
    needs: tuple[str, ...] = ()
    """Fields that a log must hold for the profile to be chosen unasked."""
    priority: int = 0
    time_source: str | None = None
    time_scale: float | None = None
    cuts: tuple[Cut, ...] = ()
    settings: Settings | None = None
    notes: tuple[str, ...] = field(default=())
    """What a user of the profile must know; goes into every record."""

    def fits(self, log: Log) -> bool:
        """Whether the log holds everything this profile needs."""
        return self.kind in (None, log.kind) and all(log.has(key) for key in self.needs)


@dataclass(frozen=True, eq=False)
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


class ChannelsMissing(TippathError):
    """A required channel cannot be had from this log."""


class OutsideLog(TippathError):
    """The log has no samples at that time."""


# ------------------------------------------------------------------------------------------------ reading


def load(path: Path) -> Profile:
    """Read a profile. A name without a file is looked for among those of the package (`arducopter_rate`).

    Raises TippathError that names the file, the key and what is allowed.
    """
    if not path.exists() or path.is_dir():
        bundled = {profile.name: profile for profile in bundled_profiles()}
        if str(path) in bundled:
            return bundled[str(path)]
        raise TippathError(f"{path}: no such profile; give a TOML file, or one of {', '.join(sorted(bundled))}")
    try:
        text = path.read_text("utf-8")
    except OSError as error:
        raise TippathError(f"{path}: cannot be read as a profile ({error.strerror or error})") from error
    except UnicodeDecodeError as error:
        raise TippathError(f"{path}: cannot be read as a profile: not text in UTF-8") from error
    return parse(text, str(path))


def parse(text: str, path: str) -> Profile:
    """A profile from TOML text; see `load`."""
    try:
        document = tomllib.loads(text)
    except (tomllib.TOMLDecodeError, RecursionError) as error:
        raise TippathError(f"{path}: not TOML: {error}") from error
    _known(document, ("name", "log", "time", "axes", "channels", "settings", "runs", "notes"), path, "")
    log, time = _table(document, "log", path), _table(document, "time", path)
    _known(log, ("kind", "needs", "priority"), path, "[log] ")
    _known(time, ("source", "scale"), path, "[time] ")
    kind = log.get("kind")
    if kind not in (None, *KINDS):
        raise TippathError(f"{path}: [log] kind is one of {', '.join(KINDS)}, not {kind!r}")
    channels = {}
    for name, entry in _table(document, "channels", path).items():
        if name not in CHANNELS or name == "t":
            hint = "time has its own table [time]" if name == "t" else _nearest(name, [c for c in CHANNELS if c != "t"])
            raise TippathError(f"{path}: [channels.{name}]: no such channel; {hint}")
        channels[name] = _channel(name, entry, path)
    for channel in _turned(_table(document, "axes", path), path):
        if channel in channels:
            turned = channels[channel]
            channels[channel] = replace(turned, scale=-turned.scale, offset=-turned.offset)
    if "settings" in document and "runs" in document:
        raise TippathError(f"{path}: [settings] and [[runs]] both say where the runs are; keep one of them")
    if not channels:
        raise TippathError(f"{path}: no [channels.*]; a profile needs at least p, q, delta_x and delta_y")
    source = time.get("source")
    if source is not None and not isinstance(source, str):
        raise TippathError(f"{path}: [time] source is the name of one field")
    return Profile(
        name=_text(document.get("name", Path(path).stem), path, "name"),
        channels=channels,
        path=path,
        kind=kind,
        needs=_texts(log.get("needs", []), path, "[log] needs"),
        priority=int(_number(log.get("priority", 0), path, "[log] priority")),
        time_source=source,
        time_scale=_number(time["scale"], path, "[time] scale") if "scale" in time else None,
        cuts=_cuts(document.get("runs", []), path),
        settings=_settings(_table(document, "settings", path), path) if "settings" in document else None,
        notes=_texts(document.get("notes", []), path, "notes"),
    )


def _channel(name: str, entry: Any, path: str) -> ChannelSource:
    where = f"[channels.{name}]"
    if not isinstance(entry, dict):
        raise TippathError(f"{path}: {where}: write a table with source = ...")
    _known(entry, ("source", "scale", "offset", "min_rate_hz"), path, f"{where} ")
    if "source" not in entry:
        raise TippathError(f"{path}: {where}: source is missing")
    source = entry["source"]
    sources = (source,) if isinstance(source, str) else _texts(source, path, f"{where} source")
    if not sources or not all(text.strip() for text in sources):
        raise TippathError(f"{path}: {where}: source is empty")
    return ChannelSource(
        name,
        sources,
        _number(entry.get("scale", 1.0), path, f"{where} scale"),
        _number(entry.get("offset", 0.0), path, f"{where} offset"),
        _number(entry.get("min_rate_hz", 0.0), path, f"{where} min_rate_hz"),
    )


def _turned(axes: Mapping[str, Any], path: str) -> tuple[str, ...]:
    """The channels whose signs the log's axes turn."""
    _known(axes, tuple(OUR_AXES), path, "[axes] ")
    turned = []
    for axis, allowed in OUR_AXES.items():
        word = axes.get(axis, allowed[0])
        if word not in allowed:
            raise TippathError(f"{path}: [axes] {axis} is {' or '.join(allowed)}, not {word!r}")
        if word == allowed[1]:
            turned.append(axis)
    if len(turned) % 2:
        left_handed = " or ".join("xyz".replace(turned[0], "")) if len(turned) == 1 else "one"
        raise TippathError(
            f"{path}: [axes] these axes are left-handed: turn {left_handed} as well, or give the signs by scale = -..."
        )
    return tuple(channel for axis in turned for channel in ALONG[axis])


def _settings(table: Mapping[str, Any], path: str) -> Settings:
    names = ("active", "axis", "axes", "f_start_hz", "f_stop_hz", "amplitude", "maneuver")
    _known(table, names, path, "[settings] ")
    fields = {
        name: _text(table[name], path, f"[settings] {name}") for name in names if name != "axes" and name in table
    }
    if not fields.get("active", "").strip():
        raise TippathError(
            f"{path}: [settings] active is missing: the field that is not zero while a maneuver is flown"
        )
    if fields.get("maneuver", "chirp") not in MANEUVERS:
        raise TippathError(f"{path}: [settings] maneuver is one of {', '.join(MANEUVERS)}")
    axes = _texts(table.get("axes", ["roll", "pitch"]), path, "[settings] axes")
    for axis in axes:
        if axis not in (*AXES, OTHER):
            raise TippathError(f"{path}: [settings] axes: {axis!r}: {_nearest(axis, (*AXES, OTHER))}")
    if ("f_start_hz" in fields) != ("f_stop_hz" in fields):
        raise TippathError(f"{path}: [settings] f_start_hz and f_stop_hz go together")
    return Settings(axes=axes, **fields)


def _cuts(entries: Any, path: str) -> tuple[Cut, ...]:
    if not isinstance(entries, list) or not all(isinstance(entry, dict) for entry in entries):
        raise TippathError(f"{path}: runs are written as [[runs]] with start_s and stop_s")
    cuts = []
    for number, entry in enumerate(entries, 1):
        where = f"[[runs]] {number}"
        _known(entry, ("start_s", "stop_s", "maneuver", "axis", "swept_band_hz"), path, f"{where} ")
        start = _number(entry.get("start_s", -math.inf), path, f"{where} start_s", finite=False)
        stop = _number(entry.get("stop_s", math.inf), path, f"{where} stop_s", finite=False)
        if not start < stop:
            raise TippathError(f"{path}: {where}: start_s must lie before stop_s")
        maneuver, axis, band = entry.get("maneuver", "unknown"), entry.get("axis"), entry.get("swept_band_hz")
        if maneuver not in MANEUVERS:
            raise TippathError(f"{path}: {where}: maneuver is one of {', '.join(MANEUVERS)}")
        if axis not in (None, *AXES):
            raise TippathError(f"{path}: {where}: axis is one of {', '.join(AXES)}")
        if band is not None and not (isinstance(band, list) and len(band) == 2):
            raise TippathError(f"{path}: {where}: swept_band_hz is [first, last]")
        low_high = None if band is None else tuple(_number(f, path, f"{where} swept_band_hz") for f in band)
        cuts.append(Cut(start, stop, maneuver, axis, None if low_high is None else (low_high[0], low_high[1])))
    return tuple(cuts)


def _known(table: Mapping[str, Any], names: Sequence[str], path: str, where: str) -> None:
    for name in table:
        if name not in names:
            raise TippathError(f"{path}: {where}{name}: unknown; {_nearest(name, names)}")


def _nearest(name: str, names: Sequence[str]) -> str:
    close = difflib.get_close_matches(name, names, 1)
    return f"did you mean {close[0]}?" if close else f"allowed are {', '.join(names)}"


def _table(document: Mapping[str, Any], name: str, path: str) -> dict[str, Any]:
    table = document.get(name, {})
    if not isinstance(table, dict):
        raise TippathError(f"{path}: {name} must be a table")
    return table


def _number(value: Any, path: str, where: str, finite: bool = True) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or (finite and not math.isfinite(value)):
        raise TippathError(f"{path}: {where} must be a number, not {value!r}")
    return float(value)


def _text(value: Any, path: str, where: str) -> str:
    if not isinstance(value, str):
        raise TippathError(f"{path}: {where} must be text")
    return value


def _texts(value: Any, path: str, where: str) -> tuple[str, ...]:
    if not isinstance(value, list) or not all(isinstance(text, str) for text in value):
        raise TippathError(f"{path}: {where} must be text, or a list of texts")
    return tuple(value)


# ------------------------------------------------------------------------------------------------ choosing


def bundled_profiles() -> tuple[Profile, ...]:
    """The profiles of the package, highest priority first."""
    folder = resources.files("gcs.logs.profile") / "bundled"
    found = [
        parse(entry.read_text("utf-8"), entry.name)
        for entry in sorted(folder.iterdir(), key=lambda entry: entry.name)
        if entry.name.endswith(".toml")
    ]
    return tuple(sorted(found, key=lambda profile: -profile.priority))


def taking_one_of(kinds: Collection[str]) -> str:
    """`--profile NAME` of the bundled profile that takes the rates from one of these kinds of message alone."""
    for profile in reversed(bundled_profiles()):  # the plainest last
        sources = {source.split(".")[0] for name in ("p", "q") for source in profile.channels[name].sources}
        if len(sources) == 1 and sources <= set(kinds):
            return f"--profile {profile.name}"
    return "--profile FILE.toml"


def contract_profile(header: Sequence[str], units: Mapping[str, str] | None = None, path: str = "") -> Profile:
    """For a CSV whose columns carry the channels' own names.

    units: column -> unit as the file writes it, where it does; others are taken to be the channel's own. Raises
    TippathError for a unit that is not known.
    """
    names = [name for name in header if name in CHANNELS]
    where = f"{path}, line 1" if path else "line 1"
    written = {name: (units or {}).get(name, "") for name in names}
    scales = {name: factor_or_ask(name, written[name], f"{where}, column {name}") for name in names}
    said = [f"{name} from {written[name]}" for name in names if scales[name] != 1.0]
    channels = {name: ChannelSource(name, (name,), scales[name]) for name in names if name != "t"}
    notes = (f"units converted as the header gives them: {', '.join(said)}",) if said else ()
    return Profile("channels", channels, kind="csv", time_source="t", time_scale=scales.get("t"), notes=notes)


def choose(log: Log, candidates: Sequence[Profile]) -> Profile | None:
    """The fitting profile of the highest priority, unless another has rates and commands at least twice as often.

    (Old logs keep RATE at 10 Hz, and the gyro itself and the motors at 50.) None where none fits.
    """
    fitting = [(profile, _spacing(profile, log)) for profile in candidates if profile.fits(log)]
    if not fitting:
        return None
    fastest = min(spacing for _, spacing in fitting)
    return next(profile for profile, spacing in fitting if spacing <= 2 * fastest or math.isinf(fastest))


def _spacing(profile: Profile, log: Log) -> float:
    """Median spacing of rates or commands, whichever are logged more slowly; infinite where either is not."""
    worst = 0.0
    for name in ("p", "delta_x"):
        spacings = [math.inf]
        for text in profile.channels[name].sources if name in profile.channels else ():
            keys = keys_of(text, log)
            if keys and all(log.has(key) for key in keys):
                spacings.append(max(log.series(key).spacing_s for key in keys))
        worst = max(worst, min(spacings))
    return worst


def keys_of(text: str, log: Log) -> tuple[str, ...]:
    """The fields that a source asks for: one where the log has it by that name; none where it makes no sense."""
    return (text,) if log.has(text) else _fields(text)


def fields_of(profile: Profile) -> tuple[str, ...]:
    """Every field a profile may ask for."""
    keys: dict[str, None] = dict.fromkeys([profile.time_source] if profile.time_source else [])
    its_settings = () if profile.settings is None else profile.settings.sources
    for texts in (*(channel.sources for channel in profile.channels.values()), its_settings):
        for text in texts:
            keys[text] = None
            try:
                keys.update(dict.fromkeys(Expression.parse(text).fields))
            except TippathError:
                continue  # the name of a column that is no arithmetic; `apply` complains where it is none either
    return tuple(keys)


def found_in(profile: Profile, fields: Collection[str]) -> tuple[dict[str, str], dict[str, str]]:
    """Channel -> the first of its sources of which all fields are there; channel -> that there is none."""
    found, absent = {}, {}
    for name, channel in profile.channels.items():
        there = (
            text for text in channel.sources if text in fields or ((keys := _fields(text)) and set(keys) <= set(fields))
        )
        text = next(there, None)
        if text is None:
            absent[name] = f"the log has no {' or '.join(channel.sources)}"
        else:
            found[name] = text
    return found, absent


def open_csv(file: CsvFile, profile: Profile) -> CsvLog:
    """A CSV seen through a profile, its columns read in one pass. Raises TippathError for what is wrong in it."""
    needed: dict[str, None] = {}
    for name in REQUIRED:
        for text in profile.channels[name].sources if name in profile.channels else ():
            fields = (text,) if file.column(text) is not None else _fields(text)
            if fields and all(file.column(key) is not None for key in fields):
                needed.update(dict.fromkeys(fields))
                break
    others = [key for key in fields_of(profile) if file.column(key) is not None and key not in needed]
    return open_table(file, profile.time_source or "t", profile.time_scale or 1.0, list(needed), others)


def _fields(text: str) -> tuple[str, ...]:
    try:
        return Expression.parse(text).fields
    except TippathError:
        return ()  # `apply` complains


def cuts_by_settings(profile: Profile, log: Log) -> tuple[tuple[Cut, ...], tuple[str, ...]]:
    """The stretches in which the profile's settings say that a maneuver was flown, and what to tell about them.

    Raises TippathError where a field that holds a setting is missing.
    """
    settings = profile.settings
    if settings is None:
        return (), ()
    for text in settings.sources:
        for key in _bind(text, log).fields:
            if not log.has(key):
                raise TippathError(
                    f"{log.path}: {key} of [settings] in profile {profile.name} is missing; the log has "
                    f"{', '.join(log.fields()[:12])}"
                )
    clock = log.series(_bind(settings.active, log).fields[0])

    def values(text: str | None) -> FloatArray | None:
        if text is None:
            return None
        expression = _bind(text, log)
        aligned = {key: _onto(clock, log.series(key), held=True) for key in expression.fields}
        return np.broadcast_to(expression.evaluate(aligned), clock.t.shape)

    active = values(settings.active)
    assert active is not None
    on = np.isfinite(active) & (active != 0)
    axis, low, high, amplitude = (
        values(text) for text in (settings.axis, settings.f_start_hz, settings.f_stop_hz, settings.amplitude)
    )
    changes = np.diff(on.astype(np.int8)) != 0
    if axis is not None:
        changes |= on[1:] & on[:-1] & (np.diff(axis) != 0)
    edges = [0, *(np.flatnonzero(changes) + 1).tolist(), on.size]
    cuts: list[Cut] = []
    told: list[str] = []
    for start, stop in pairwise(edges):
        if not on[start] or stop - start < 2:
            continue
        name = None if axis is None else _axis_named(settings, axis[start])
        band = None if low is None or high is None else (float(low[start]), float(high[start]))
        good = band is not None and 0 < band[0] < band[1] < math.inf
        maneuver = "unknown" if name == OTHER else settings.maneuver
        cuts.append(
            Cut(
                float(clock.t[start]),
                float(clock.t[stop - 1]),
                maneuver,
                None if name == OTHER else name,
                band if good and maneuver == "chirp" else None,
            )
        )
        if amplitude is not None:
            told.append(f"{float(amplitude[start]):g}")
    if not cuts:
        return (), (f"{settings.active} is zero throughout: by its settings no maneuver was flown",)
    return tuple(cuts), (f"amplitudes by the settings of the runs in order: {', '.join(told)}",) if told else ()


def _axis_named(settings: Settings, value: float) -> str:
    place = int(value) if math.isfinite(value) else -1
    return settings.axes[place] if 0 <= place < len(settings.axes) else OTHER


# ------------------------------------------------------------------------------------------------ applying


def apply(profile: Profile, log: Log, start_s: float = -math.inf, stop_s: float = math.inf) -> Mapped:
    """The channels between two times of the log's own clock.

    Raises ChannelsMissing where a required channel is not in the log, OutsideLog where the log does not reach there,
    TippathError where the profile makes no sense.
    """
    missing = [name for name in REQUIRED if name != "t" and name not in profile.channels]
    if missing:
        raise ChannelsMissing(_what_is_missing(profile, log, missing))
    p, q = profile.channels["p"], profile.channels["q"]
    _require_overlap((*p.sources, *q.sources), log, start_s, stop_s)
    pairs = [
        (a, b, min(_covered_s(a, log, start_s, stop_s), _covered_s(b, log, start_s, stop_s)))
        for a, b in zip(p.sources, q.sources, strict=False)
        if _available(a, log, start_s, stop_s) and _available(b, log, start_s, stop_s)
    ]
    most = max((covered for _, _, covered in pairs), default=0.0)
    pair = next(((a, b) for a, b, covered in pairs if covered >= 0.5 * most), None)
    absent = [c.channel for c in (p, q) if not any(_available(text, log, start_s, stop_s) for text in c.sources)]
    absent += [
        name
        for name in ("delta_x", "delta_y")
        if not any(_available(text, log, start_s, stop_s) for text in profile.channels[name].sources)
    ]
    if absent or pair is None:
        raise ChannelsMissing(_what_is_missing(profile, log, absent or ["p", "q"]))
    base = _bind(pair[0], log).fields[0]
    clock = log.series(_time_key(profile, log) or base).part(start_s, stop_s)
    if clock.t.size < 2:
        raise ChannelsMissing(f"{log.path}: fewer than two samples of {base}{_between(start_s, stop_s)}")

    found: dict[str, FloatArray] = {}
    sources: dict[str, str] = {}
    reasons: dict[str, str] = {}
    slow: dict[str, float] = {}
    valid = np.ones(clock.t.size, np.bool_)
    spacing = clock.spacing_s
    order = sorted(profile.channels.values(), key=lambda channel: channel.channel not in REQUIRED)
    for channel in order:
        name = channel.channel
        texts = {"p": pair[:1], "q": pair[1:]}.get(name, channel.sources)
        text = next((text for text in texts if _available(text, log, start_s, stop_s)), None)
        if text is None:
            reasons[name] = f"the log has no {' or '.join(channel.sources)}"
            continue
        expression = _bind(text, log)
        series = {key: log.series(key) for key in expression.fields}
        coarsest: float = max((one.spacing_s for one in series.values() if one.t.size > 1), default=spacing)
        if name not in REQUIRED and channel.min_rate_hz and coarsest > 1 / channel.min_rate_hz:
            reasons[name] = f"{text} is logged at {1 / coarsest:.0f} Hz, {channel.min_rate_hz:.0f} Hz are needed"
            continue
        held = name.startswith(COMMANDS)
        aligned = {key: _onto(clock, one, held) for key, one in series.items()}
        values = np.broadcast_to(channel.scale * expression.evaluate(aligned) + channel.offset, clock.t.shape)
        good = _possible(name, values)
        lost = float(np.mean(~good[valid])) if valid.any() else 0.0
        if name not in REQUIRED and lost > FEW:
            reasons[name] = f"{text} has no value for {100 * lost:.0f} % of the samples"
            continue
        valid &= good
        found[name], sources[name] = values, text
        if coarsest > SLOWER * spacing:
            slow[name] = coarsest
    if np.count_nonzero(valid) < 2:
        raise ChannelsMissing(
            f"{log.path}: no sample has {', '.join(REQUIRED[1:])} together between {clock.t[0]:.3f} and "
            f"{clock.t[-1]:.3f} s; the messages they come from do not overlap, or hold no finite numbers"
        )
    channels = {"t": clock.t[valid], **{name: values[valid] for name, values in found.items()}}
    kind = "csv" if log.kind == "csv" else base.split(".")[0].split("[")[0]
    return Mapped(channels, sources, reasons, kind, slow, int(np.count_nonzero(~valid)))


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


def _require_overlap(sources: Sequence[str], log: Log, start_s: float, stop_s: float) -> None:
    """Raises OutsideLog where the rates are logged, but not in this stretch."""
    fields = {key for text in sources for key in _bind(text, log).fields if log.has(key)}
    clocks = [t for t in (log.series(key).t for key in sorted(fields)) if t.size]
    if not clocks:
        return
    first, last = min(float(t[0]) for t in clocks), max(float(t[-1]) for t in clocks)
    if stop_s < first or start_s > last:
        raise OutsideLog(
            f"{log.path}: no samples{_between(start_s, stop_s)}: the log runs from {first:.3f} to {last:.3f} s"
        )


def _between(start_s: float, stop_s: float) -> str:
    if math.isinf(start_s) and math.isinf(stop_s):
        return ""
    if math.isinf(start_s):
        return f" before {stop_s:g} s"
    return f" after {start_s:g} s" if math.isinf(stop_s) else f" between {start_s:g} and {stop_s:g} s"


def _time_key(profile: Profile, log: Log) -> str | None:
    """The field whose clock the profile asks for, where it names its message too."""
    key = profile.time_source
    return key if key is not None and log.kind != "csv" and log.has(key) else None


def _bind(text: str, log: Log) -> Expression:
    """A source as arithmetic on fields that the log has; a field's bare name may hold any characters."""
    if log.has(text):
        return Expression.field(text)
    expression = Expression.parse(text)
    if not expression.fields:
        raise TippathError(f"source {text!r} names no field; write a field of the log, such as {log.fields()[0]}")
    return expression


def _available(text: str, log: Log, start_s: float, stop_s: float) -> bool:
    """Whether every field has begun before the stretch ends, and one of them has samples in it."""
    keys = _bind(text, log).fields
    if not all(log.has(key) for key in keys):
        return False
    return all(log.series(key).t[0] <= stop_s for key in keys) and _covered_s(text, log, start_s, stop_s) > 0


def _covered_s(text: str, log: Log, start_s: float, stop_s: float) -> float:
    """How much of the stretch the best of its fields covers."""
    parts = [log.series(key).part(start_s, stop_s) for key in _bind(text, log).fields]
    return max((part.spacing_s * (part.t.size - 1) for part in parts if part.t.size > 1), default=0.0)


def _onto(clock: Series, series: Series, held: bool) -> FloatArray:
    """A field's values at the clock's times, shape (n,); NaN where it has none."""
    if series.clock == clock.clock:
        first = int(np.searchsorted(series.t, clock.t[0]))
        if first + clock.t.size <= series.t.size and np.array_equal(series.t[first : first + clock.t.size], clock.t):
            return series.values[first : first + clock.t.size]
    spacing = clock.spacing_s
    if series.t.size == 0:
        return np.full(clock.t.shape, np.nan)
    if series.t.size > 1 and series.spacing_s <= SLOWER * spacing:
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
