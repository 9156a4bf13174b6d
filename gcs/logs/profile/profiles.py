"""Log profiles: which field of a log is which channel, with scale, offset and arithmetic.

A profile is a TOML file. Those that come with the package are chosen by what the log holds (`gcs.logs.profile.choice`);
`--profile` names another. How channels are made of it: `gcs.logs.profile.mapping`.

[axes] says how the log's body axes lie where they are not ours (x forward, y right, z down); it turns the signs of all
channels that are measured along or about them. [settings] names the fields that hold what was flown: the log is then
cut into the stretches in which `active` is not zero (`gcs.logs.profile.cuts`).
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cache
from importlib import resources
from pathlib import Path
from types import MappingProxyType
from typing import Annotated, Literal

from msgspec import Meta

from gcs import documents
from gcs.document_faults import nearest
from gcs.documents import Strict
from gcs.errors import TippathError
from gcs.logs.formats.tables import Log
from gcs.logs.words import printable
from sysid.data.airframe import Airframe
from sysid.data.chirp import Law
from sysid.data.record import CHANNELS

Kind = Literal["dataflash", "ulog", "tlog", "csv", "blackbox", "crazyflie", "paparazzi", "mat", "mcap", "parquet"]
Maneuver = Literal["chirp", "doublet", "quiet", "unknown"]
Axis = Literal["roll", "pitch", "elevator", "yaw", "thrust"]

ALONG: Mapping[str, tuple[str, ...]] = MappingProxyType(
    {"x": ("p", "phi", "ax", "u"), "y": ("q", "theta", "ay", "v"), "z": ("r", "az", "w")}
)
"""Axis -> channels measured along or about it."""


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


class Cut(Strict, frozen=True):
    """[[runs]]: a run that the profile cuts out of the log, in seconds of the log's own time.

    With the law of its chirp the excitation can be rebuilt where it is not logged; the chirp then begins at `start_s`,
    give or take a second, and lasts until `stop_s`.
    """

    start_s: float = -math.inf
    stop_s: float = math.inf
    maneuver: Maneuver = "unknown"
    axis: Axis | None = None
    swept_band_hz: tuple[float, float] | None = None
    law: Law | None = None
    c1: Annotated[float, Meta(gt=0, lt=50)] = 4.0
    """Of Tischler's law."""
    fade_in_s: Annotated[float, Meta(ge=0)] = 0.0
    fade_out_s: Annotated[float, Meta(ge=0)] = 0.0
    amplitude: float | None = None


class Settings(Strict, frozen=True):
    """[settings]: fields (or arithmetic on fields) that hold what was flown."""

    active: str = ""
    """Not zero while a maneuver is flown."""
    axis: str | None = None
    """The number of the excited axis: a place, from 0, in `axes`."""
    axes: tuple[Axis | Literal["other"], ...] = ("roll", "pitch")
    """`other` is one that is excited but not identified."""
    f_start_hz: str | None = None
    f_stop_hz: str | None = None
    amplitude: str | None = None
    maneuver: Maneuver = "chirp"
    law: Law | None = None
    """Of the chirps, as in [[runs]], with what goes with it."""
    c1: Annotated[float, Meta(gt=0, lt=50)] = 4.0
    fade_in_s: Annotated[float, Meta(ge=0)] = 0.0
    fade_out_s: Annotated[float, Meta(ge=0)] = 0.0

    @property
    def sources(self) -> tuple[str, ...]:
        named = (self.active, self.axis, self.f_start_hz, self.f_stop_hz, self.amplitude)
        return tuple(text for text in named if text is not None)


@dataclass(frozen=True, kw_only=True)
class Profile:
    """Where the channels of a kind of log come from."""

    name: str
    channels: Mapping[str, ChannelSource]
    path: str = ""
    """The file it was read from."""
    kind: str | None = None
    """A `Kind`; None fits any."""
    needs: tuple[str, ...] = ()
    """Fields that a log must hold for the profile to be chosen unasked."""
    priority: int = 0
    time_source: str | None = None
    time_scale: float | None = None
    cuts: tuple[Cut, ...] = ()
    settings: Settings | None = None
    notes: tuple[str, ...] = field(default=())
    """What a user of the profile must know; goes into every record."""
    airframe: Airframe | None = None
    """What flew, where such logs are of one kind only; the log is asked where it is left out."""
    loop_rate_hz: float | None = None
    """How often the vehicle's loop gave a command, where the log has fewer of them and does not tell."""
    loop_told_by: str = "profile"
    commands_late_s: float = 0.0
    """By which the log stamps commands too late, as its clock for rates has it."""
    response: ResponseTable | None = None
    """What a file of a frequency response holds."""

    def fits(self, log: Log) -> bool:
        """Whether the log holds everything this profile needs."""
        return self.kind in (None, log.kind) and all(log.has(key) for key in self.needs)


# ------------------------------------------------------------------------------------------------ the document


class LogTable(Strict, frozen=True):
    """[log]: which logs it is for."""

    kind: Kind | None = None
    needs: tuple[str, ...] = ()
    priority: Annotated[int, Meta(ge=-1000, le=1000)] = 0


class TimeTable(Strict, frozen=True):
    """[time]: where a CSV's or another clock's time comes from, and its unit in s."""

    source: str | None = None
    scale: Annotated[float, Meta(gt=0)] | None = None
    loop_rate_hz: Annotated[float, Meta(gt=0, le=1e5)] | None = None
    """How often the vehicle's loop gives a command, which it holds until the next."""
    commands_late_s: Annotated[float, Meta(ge=-0.1, le=0.1)] = 0.0
    """By which commands are stamped too late beside the rates."""


class AxesTable(Strict, frozen=True):
    """[axes]: how the log's body axes lie; ours first."""

    x: Literal["forward", "backward"] = "forward"
    y: Literal["right", "left"] = "right"
    z: Literal["down", "up"] = "down"

    @property
    def turned(self) -> tuple[str, ...]:
        """Those that lie the other way."""
        ours = AxesTable()
        return tuple(axis for axis in ALONG if getattr(self, axis) != getattr(ours, axis))


class ChannelTable(Strict, frozen=True):
    """[channels.p] and the others."""

    source: str | tuple[str, ...]
    scale: float = 1.0
    offset: float = 0.0
    min_rate_hz: Annotated[float, Meta(ge=0, le=1e5)] = 0.0

    @property
    def sources(self) -> tuple[str, ...]:
        return (self.source,) if isinstance(self.source, str) else self.source


class ResponseTable(Strict, frozen=True):
    """[response]: what a file of a frequency response holds, and of what it is the response."""

    input: str
    """A command."""
    output: str
    """What answers it."""
    columns: tuple[str, ...] = ()
    """Names of all columns of a file without a header."""
    frequency: str | None = None
    """The name of its column, as of the others; those of usual names need none."""
    unit: Literal["Hz", "rad/s"] = "Hz"
    """Of `frequency`."""
    real: str | None = None
    imaginary: str | None = None
    db: str | None = None
    deg: str | None = None
    coherence: str | None = None
    response: str | None = None
    """Complex numbers, in a .mat."""
    scale: float = 1.0
    """Of the response: with a minus where the channel has the other sign."""


class Document(Strict, frozen=True):
    """A profile as it is written."""

    name: str | None = None
    """The file's name where left out."""
    airframe: Airframe | None = None
    log: LogTable = LogTable()
    time: TimeTable = TimeTable()
    axes: AxesTable = AxesTable()
    channels: dict[str, ChannelTable] = {}
    settings: Settings | None = None
    runs: tuple[Cut, ...] | None = None
    response: ResponseTable | None = None
    notes: tuple[str, ...] = ()


def load(path: Path) -> Profile:
    """Read a profile. A name without a file is looked for among those of the package (`arducopter_rate`).

    Raises TippathError that names the file, the key and what is allowed.
    """
    if not path.exists() or path.is_dir():
        bundled = {profile.name: profile for profile in bundled_profiles()}
        if str(path) in bundled:
            return bundled[str(path)]
        raise TippathError(f"{path}: no such profile; give a TOML file, or one of {', '.join(sorted(bundled))}")
    return parse(documents.read_text(path, "profile"), str(path))


def parse(text: str, path: str) -> Profile:
    """A profile from TOML text; see `load`."""
    document = documents.parse_toml(text, Document, path)
    problem = _problem(document)
    if problem is not None:
        raise TippathError(f"{path}: {problem}")
    turned = {channel for axis in document.axes.turned for channel in ALONG[axis]}
    return Profile(
        name=printable(Path(path).stem if document.name is None else document.name),
        channels={
            channel: _source(channel, table, -1.0 if channel in turned else 1.0)
            for channel, table in document.channels.items()
        },
        path=path,
        kind=document.log.kind,
        needs=document.log.needs,
        priority=document.log.priority,
        time_source=document.time.source,
        time_scale=document.time.scale,
        loop_rate_hz=document.time.loop_rate_hz,
        commands_late_s=document.time.commands_late_s,
        cuts=document.runs or (),
        settings=document.settings,
        response=document.response,
        notes=tuple(map(printable, document.notes)),
        airframe=document.airframe,
    )


def _source(channel: str, table: ChannelTable, sign: float) -> ChannelSource:
    return ChannelSource(channel, table.sources, sign * table.scale, sign * table.offset, table.min_rate_hz)


def _problem(document: Document) -> str | None:
    """What is wrong with a profile whose keys are all there and of the right kind; None where nothing is."""
    if document.settings is not None and document.runs is not None:
        return "[settings] and [[runs]] both say where the runs are; keep one of them"
    if not document.channels and document.response is None:
        return "no [channels.*]; a profile needs at least p, q, delta_x and delta_y"
    problems = (
        *(_channel_problem(name, table) for name, table in document.channels.items()),
        _axes_problem(document.axes),
        None if document.settings is None else _settings_problem(document.settings),
        *(
            f"[[runs]] {number}: start_s must lie before stop_s"
            for number, cut in enumerate(document.runs or (), 1)
            if not cut.start_s < cut.stop_s
        ),
    )
    return next((problem for problem in problems if problem is not None), None)


def _channel_problem(name: str, table: ChannelTable) -> str | None:
    known = [channel for channel in CHANNELS if channel != "t"]
    if name == "t":
        return "[channels.t]: no such channel; time has its own table [time]"
    if name not in known:
        hint = nearest(name, known, otherwise=f"allowed are {', '.join(known)}")
        return f"[channels.{printable(name[:40])}]: no such channel; {hint}"
    if not table.sources or not all(text.strip() for text in table.sources):
        return f"[channels.{name}]: source is empty"
    return None


def _axes_problem(axes: AxesTable) -> str | None:
    turned = axes.turned
    if len(turned) % 2 == 0:
        return None
    missing = " or ".join("xyz".replace(turned[0], "")) if len(turned) == 1 else "one"
    return f"[axes] these axes are left-handed: turn {missing} as well, or give the signs by scale = -..."


def _settings_problem(settings: Settings) -> str | None:
    if not settings.active.strip():
        return "[settings] active is missing: the field that is not zero while a maneuver is flown"
    if (settings.f_start_hz is None) != (settings.f_stop_hz is None):
        return "[settings] f_start_hz and f_stop_hz go together"
    return None


@cache
def bundled_profiles() -> tuple[Profile, ...]:
    """The profiles of the package, highest priority first."""
    folder = resources.files("gcs.logs.profile") / "bundled"
    profiles = [
        parse(entry.read_text("utf-8"), entry.name)
        for entry in sorted(folder.iterdir(), key=lambda entry: entry.name)
        if entry.name.endswith(".toml")
    ]
    return tuple(sorted(profiles, key=lambda profile: -profile.priority))


def named(name: str) -> Profile:
    """The bundled profile of that name. Raises KeyError."""
    return {profile.name: profile for profile in bundled_profiles()}[name]
