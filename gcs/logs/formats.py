"""The kinds of log that are read: how each is recognised and opened.

To read another kind, write its module beside this one (a class that is a `gcs.logs.tables.Log`) and add it to
`FORMATS`.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType

from gcs.errors import TippathError
from gcs.logs import dataflash, profiles
from gcs.logs.csv import CsvFile
from gcs.logs.damage import Damage
from gcs.logs.dataflash_table import DataFlashTables
from gcs.logs.profiles import Profile
from gcs.logs.tables import Log
from gcs.logs.words import printable
from sysid.record import CHANNELS

HEAD_BYTES = 64
READ = "DataFlash .BIN, .csv, and records (.npz) that tippath ingest -o wrote"
NOT_YET: Mapping[str, str] = MappingProxyType(
    {
        ".ulg": "ULog is not read yet; convert it (ulog2csv of pyulog) and name the columns in a profile",
        ".tlog": "telemetry logs are not read yet; take the vehicle's own .BIN, it also has every sample",
        ".log": "text DataFlash is not read yet; take the .BIN that it was converted from",
    }
)


@dataclass(frozen=True)
class Opened:
    """A log that was read, before runs are looked for."""

    boots: tuple[Log, ...]
    """One for each boot of the vehicle, in the file's order; each has its own clock. At least one."""
    kind: str
    sha256: str
    """Of the file's bytes, hexadecimal."""
    profile: Profile
    """The one asked for, or the bundled one that suits the log best."""
    damage: Damage | None = None
    """None where the format has no way to tell."""
    notes: tuple[str, ...] = ()
    """What is wrong with the log and so with every run of it."""
    hints: tuple[str, ...] = ()
    """What whoever ingests it should know, but not whoever fits its runs."""


@dataclass(frozen=True)
class Format:
    """A kind of log."""

    name: str
    suffixes: tuple[str, ...]
    """In lower case."""
    recognises: Callable[[bytes], bool]
    """Whether the first `HEAD_BYTES` of a file are of this kind, whatever its name; no guesses."""
    open: Callable[[Path, Profile | None], Opened]
    """Raises TippathError for what cannot be read at all."""


def open_log(path: Path, profile: Profile | None) -> Opened:
    """Open a log by its first bytes, or its ending. Raises TippathError for what is no log that is read here."""
    suffix = path.suffix.lower()
    if not path.exists():
        raise TippathError(f"{path}: no such file or folder")
    try:
        with path.open("rb") as stream:
            head = stream.read(HEAD_BYTES)
    except OSError as error:
        raise TippathError(f"{path}: cannot be read ({error.strerror or error})") from error
    for format in FORMATS:
        if format.recognises(head):
            return format.open(path, profile)
    for format in FORMATS:
        if suffix in format.suffixes:
            return format.open(path, profile)
    if suffix in NOT_YET:
        raise TippathError(f"{path}: {NOT_YET[suffix]}. Read are: {READ}")
    raise TippathError(f"{path}: unknown kind of log ({suffix or 'no ending'}). Read are: {READ}")


def suffixes() -> tuple[str, ...]:
    """The endings of logs in a folder, those that hold most first; .txt is too often something else."""
    return tuple(suffix for format in FORMATS for suffix in format.suffixes if suffix != ".txt")


def _never(head: bytes) -> bool:
    return False


def _is_dataflash(head: bytes) -> bool:
    return head[:2] == bytes(dataflash.HEAD)


def _open_dataflash(path: Path, profile: Profile | None) -> Opened:
    log = dataflash.read(path)
    sha256 = hashlib.sha256(log.data.data).hexdigest()
    time = None if profile is None or profile.time_source is None else profile.time_source.rsplit(".", 1)[-1]
    table = DataFlashTables(log, str(path), time, None if profile is None else profile.time_scale)
    chosen = profile or profiles.choose(table, profiles.bundled_profiles())
    if chosen is None:
        chosen = next(one for one in profiles.bundled_profiles() if one.name == "arducopter")
    return Opened((table,), "dataflash", sha256, chosen, log.damage)


def _open_csv(path: Path, profile: Profile | None) -> Opened:
    try:
        raw = path.read_bytes()
    except OSError as error:
        raise TippathError(f"{path}: cannot be read ({error.strerror or error})") from error
    file = CsvFile.parse(raw, str(path))
    chosen = profile or _csv_profile(file)
    table = profiles.open_csv(file, chosen)
    if "t" not in file.header and chosen.time_source in (None, "t"):
        raise TippathError(
            f"{path}, line 1: column t missing; add the time in seconds as t, or name the time column in a profile "
            "([time] source = ..., scale = ...)"
        )
    hints: tuple[str, ...] = ()
    if profile is None and chosen.name == "channels":
        others = [name for name in file.header if name not in CHANNELS]
        if others:
            hints = (f"columns that are no channels are not used: {', '.join(map(printable, others[:8]))}",)
    return Opened((table,), "csv", hashlib.sha256(raw).hexdigest(), chosen, None, file.notes, hints)


def _csv_profile(file: CsvFile) -> Profile:
    """Of the bundled profiles the one whose columns are there; a header of channel names needs none."""
    own = profiles.contract_profile(file.header)
    if {"p", "q"} <= set(own.channels):
        return own
    columns = set(file.header)
    bundled = (one for one in profiles.bundled_profiles() if one.kind == "csv" and set(one.needs) <= columns)
    return next(bundled, own)


FORMATS = (
    Format("dataflash", (".bin",), _is_dataflash, _open_dataflash),
    Format("csv", (".csv", ".txt"), _never, _open_csv),
)
