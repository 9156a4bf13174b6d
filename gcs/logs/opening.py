"""The kinds of log that are read: how each is recognised and opened.

To read another kind, write its module in `gcs.logs.formats` (a class that is a `gcs.logs.formats.tables.Log`) and add
it to `FORMATS`.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path

from gcs.errors import TippathError
from gcs.logs.formats import (
    blackbox,
    blackbox_csv,
    crazyflie,
    dataflash,
    dataflash_text,
    mat,
    mcap,
    paparazzi,
    parquet,
    ulog,
)
from gcs.logs.formats.arrays import ArrayLog, columns_of
from gcs.logs.formats.csv import CsvFile
from gcs.logs.formats.csv_join import JoinedCsv, labels
from gcs.logs.formats.csv_table import CsvLog, open_table
from gcs.logs.formats.damage import Damage
from gcs.logs.formats.dataflash_join import JoinedLog
from gcs.logs.formats.dataflash_scan import HEAD
from gcs.logs.formats.dataflash_table import DataFlashTables, MessageLog
from gcs.logs.formats.joined import Joined
from gcs.logs.formats.raw import unreadable
from gcs.logs.formats.tables import FloatArray, Log
from gcs.logs.formats.ulog_table import UlogTables
from gcs.logs.profile.choice import choose, contract_profile, contract_profile_within
from gcs.logs.profile.cuts import cuts_by_settings
from gcs.logs.profile.profiles import Profile, bundled_profiles, named
from gcs.logs.profile.sources import fields_in, fields_of
from gcs.logs.runs.health import F_HIGH_HZ
from gcs.logs.words import printable
from sysid.data.record import CHANNELS, REQUIRED

HEAD_BYTES = 64
TLOG_MOTORS = "tlog_motors"
READ = (
    "DataFlash .BIN and .log, ULog .ulg, telemetry .tlog, Betaflight's, INAV's and Rotorflight's blackbox (.bbl, .bfl, "
    ".TXT), Crazyflie's uSD card, Paparazzi's .log and .data, CSV (.csv, .txt), MATLAB .mat, MCAP of ROS 2 (.mcap), "
    ".parquet, and records (.npz) of tippath ingest -o"
)


@dataclass(frozen=True, kw_only=True)
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
    joined: Joined | None = None
    """What came of reading it with others of the same flight; None where it was read alone."""
    apart: Mapping[str, str] = field(default_factory=dict)
    """Path of a log beside it -> why it was not joined."""
    cut: tuple[Profile, ...] = ()
    """For each boot the profile with the runs that the log itself cuts out of it; empty where it does not."""

    @property
    def parts(self) -> list[tuple[Log, Profile]]:
        """Each boot with the profile that it is read by."""
        return list(zip(self.boots, self.cut or [self.profile] * len(self.boots), strict=True))


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
    require_file(path)
    try:
        with path.open("rb") as stream:
            head = stream.read(HEAD_BYTES)
    except OSError as error:
        raise unreadable(path, error) from error
    for format in FORMATS:
        if format.recognises(head):
            return format.open(path, profile)
    for format in FORMATS:
        if suffix in format.suffixes:
            return format.open(path, profile)
    raise TippathError(f"{path}: unknown kind of log ({suffix or 'no ending'}). Read are: {READ}")


def require_file(path: Path) -> None:
    """Raises TippathError for what holds no bytes that can be read twice, and why; a pipe would be waited for."""
    if path.is_file():
        return
    if path.is_symlink() and not path.exists():
        raise TippathError(f"{path}: a link to what does not exist")
    if path.exists():
        raise TippathError(f"{path}: not a file but a pipe or a device; save what it gives and name that file")
    name, mark, number = path.name.rpartition("#")
    if mark and number.isdecimal() and path.with_name(name or mark).is_file():
        raise TippathError(f"{path}: no such file; {name} is one: all its runs are listed, name it without #{number}")
    raise TippathError(f"{path}: no such file or folder")


def suffixes() -> tuple[str, ...]:
    """The endings of logs in a folder, those that hold most first; .txt is too often something else."""
    return tuple(suffix for format in FORMATS for suffix in format.suffixes if suffix != ".txt")


def _never(head: bytes) -> bool:
    return False


def _is_dataflash(head: bytes) -> bool:
    return head[:2] == bytes(HEAD)


def _open_dataflash(path: Path, profile: Profile | None) -> Opened:
    log = dataflash.read(path)
    boots, chosen, notes = dataflash_boots(log.boots, path, profile)
    return Opened(boots=boots, kind="dataflash", sha256=log.sha256(), profile=chosen, damage=log.damage, notes=notes)


def _open_dataflash_text(path: Path, profile: Profile | None) -> Opened:
    log, sha256 = dataflash_text.read(path)
    boots, chosen, notes = dataflash_boots(log.boots, path, profile)
    return Opened(
        boots=boots,
        kind="dataflash",
        sha256=sha256,
        profile=chosen,
        damage=log.damage,
        notes=(*log.notes, *notes),
    )


def dataflash_boots(
    logs: Sequence[MessageLog], path: Path, profile: Profile | None
) -> tuple[tuple[DataFlashTables, ...], Profile, tuple[str, ...]]:
    """The boots of a DataFlash log, in whichever of its two spellings, its profile, and a note on several boots."""
    if any("TIME" in log.names and "StartTime" in log.formats["TIME"].columns for log in logs):
        raise TippathError(
            f"{path}: PX4's former log (sdlog2, .px4log), which is not read: its messages have no times of their own. "
            "Write it as CSV with PX4's sdlog2_dump.py, and name its columns in a profile ([time] source = "
            '"TIME_StartTime", scale = 1e-6)'
        )
    time = None if profile is None or profile.time_source is None else profile.time_source.rsplit(".", 1)[-1]
    scale = None if profile is None else profile.time_scale
    boots = tuple(DataFlashTables(boot, str(path), time, scale, sifted=isinstance(boot, JoinedLog)) for boot in logs)
    sampled = tuple(boot for boot in boots if boot.sampled) or boots[:1]
    notes: tuple[str, ...] = ()
    if len(boots) > 1:
        silent = len(boots) - len(sampled)
        without = f"; {silent} of them without samples" if silent else ""
        notes = (f"{len(boots)} boots in this log, each with its own clock{without}",)
    chosen = profile
    for boot in sampled:
        chosen = chosen or choose(boot, bundled_profiles())
    return sampled, chosen or named("arducopter"), notes


def _open_ulog(path: Path, profile: Profile | None) -> Opened:
    log = ulog.read(path)
    chosen = profile or choose(UlogTables(log, str(path)), bundled_profiles()) or named("px4")
    tables = UlogTables(log, str(path), chosen.time_source, chosen.time_scale)
    return Opened(
        boots=(tables,),
        kind="ulog",
        sha256=hashlib.sha256(log.data.data).hexdigest(),
        profile=chosen,
        damage=log.damage,
        notes=log.notes,
        hints=_ulog_advice(tables, chosen),
    )


def _ulog_advice(tables: UlogTables, profile: Profile) -> tuple[str, ...]:
    """What to set for the next flight, where PX4's usual settings have logged rates or commands too slowly."""
    slowest = 0.0
    for channel in ("p", "delta_x"):
        sources = profile.channels[channel].sources if channel in profile.channels else ()
        spacings = [tables.series(key).spacing_s for key in sources if tables.has(key)]
        slowest = max(slowest, min(spacings, default=0.0))
    if slowest <= 1 / (4 * F_HIGH_HZ):
        return ()
    return ("rates or commands are logged too slowly: set bit 3 (system identification) of PX4's SDLOG_PROFILE",)


def _is_tlog(head: bytes) -> bool:
    """A time in us since 1970, and behind it what begins a MAVLink frame; the next frame too, where the head has it."""
    if len(head) < 18 or head[0] != 0 or head[1] >= 0x0F or not any(head[1:8]) or head[8] not in (0xFD, 0xFE):
        return False
    if head[8] == 0xFD and head[10] > 1:
        return False
    length = 8 + head[9] if head[8] == 0xFE else 12 + head[9] + 13 * head[10]
    return len(head) <= 16 + length or head[16 + length] in (0xFD, 0xFE)


def _open_tlog(path: Path, profile: Profile | None) -> Opened:
    """By the profile asked for, or the one of the package that suits the longest boot.

    That for the four motors of an X frame is none unless the vehicle says that it has them.
    """
    from gcs.logs.formats import tlog  # MAVLink's dialects: 0.3 s that no other kind of log needs

    log = tlog.read(path)
    boot = max(log.boots, key=lambda boot: boot.sampled_s)
    fitting = [each for each in bundled_profiles() if each.name != TLOG_MOTORS or boot.is_quad_x]
    return Opened(
        boots=log.boots,
        kind="tlog",
        sha256=log.sha256,
        profile=profile or choose(boot, fitting) or named("tlog"),
        damage=log.damage,
        notes=log.notes,
        hints=log.hints,
    )


def _open_csv(path: Path, profile: Profile | None) -> Opened:
    try:
        raw = path.read_bytes()
    except OSError as error:
        raise unreadable(path, error) from error
    file = CsvFile.parse(raw, str(path))
    chosen = profile or _csv_profile([file])
    log = _csv_log(file, chosen)
    hints = [*file.layout.hints]
    if profile is None and chosen.name == "channels":
        others = [name for name in file.layout.names if name and name not in CHANNELS]
        if others:
            hints.append(f"columns that are no channels are not used: {', '.join(map(printable, others[:8]))}")
    cut, uncut = _cut(log.boots, chosen)
    hints += uncut
    return Opened(
        boots=log.boots,
        kind="csv",
        sha256=hashlib.sha256(raw).hexdigest(),
        profile=chosen,
        damage=log.damage,
        notes=log.notes,
        hints=tuple(hints),
        cut=cut,
    )


def open_csvs(paths: Sequence[Path], profile: Profile | None) -> Opened:
    """Several CSVs as one log, joined by time. Raises TippathError where they cannot be read, or do not overlap."""
    names = labels(paths)
    raws = []
    for path in paths:
        require_file(path)
        try:
            raws.append(path.read_bytes())
        except OSError as error:
            raise unreadable(path, error) from error
    files = [CsvFile.parse(raw, str(path)) for raw, path in zip(raws, paths, strict=True)]
    chosen = profile or _csv_profile(files)
    time, scale = chosen.time_source or "t", chosen.time_scale or 1.0
    logs = [open_table(file, time, scale, [], [name for name in file.header if name]) for file in files]
    for path, log in zip(paths, logs, strict=True):
        if len(log.boots) > 1:
            raise TippathError(f"{path}: its clock begins anew; cut it there, and join the parts of one boot")
    joined = JoinedCsv({name: log.boots[0] for name, log in zip(names, logs, strict=True)}, time)
    beside = ", ".join(printable(path.name) for path in paths[1:])
    return Opened(
        boots=(joined,),
        kind="csv",
        sha256=hashlib.sha256(b"".join(hashlib.sha256(raw).digest() for raw in raws)).hexdigest(),
        profile=chosen,
        notes=tuple(
            f"{printable(path.name)}: {note}" for path, log in zip(paths, logs, strict=True) for note in log.notes
        ),
        hints=(f"joined by time with {beside}", *(hint for file in files for hint in file.layout.hints)),
    )


def _cut(boots: Sequence[Log], chosen: Profile) -> tuple[tuple[Profile, ...], list[str]]:
    """For each boot the profile with the runs that the profile's settings cut out of it, and why they cut none."""
    if chosen.settings is None:
        return (), []
    cuts_and_notes = [cuts_by_settings(chosen, boot) for boot in boots]
    return (
        tuple(
            replace(chosen, cuts=cuts, notes=(*chosen.notes, *(notes if cuts else ())))
            for cuts, notes in cuts_and_notes
        ),
        [note for cuts, notes in cuts_and_notes if not cuts for note in notes],
    )


def _open_blackbox(read: Callable[[Path], blackbox.BlackboxFile], path: Path, profile: Profile | None) -> Opened:
    """Each log of the file by itself: one of them may have chirps, and each was flown with settings of its own."""
    file = read(path)
    best, profiles, hints = _for_each(file.logs, profile, "blackbox")
    told = [
        replace(chosen, loop_rate_hz=log.loop_rate_hz, loop_told_by="looptime and pid_process_denom")
        if chosen.loop_rate_hz is None
        else chosen
        for log, chosen in zip(file.logs, profiles, strict=True)
    ]
    return Opened(
        boots=file.logs,
        kind="blackbox",
        sha256=file.sha256,
        profile=best,
        damage=file.damage,
        notes=file.notes,
        hints=hints,
        cut=tuple(
            replace(chosen, airframe=chosen.airframe or log.airframe)
            for log, chosen in zip(file.logs, told, strict=True)
        ),
    )


def _open_decoded(path: Path, profile: Profile | None) -> Opened:
    """A blackbox decoded to CSV; as its columns stand there where a profile names one of them for the time."""
    if profile is not None and profile.time_source is not None:
        return _open_csv(path, profile)
    return _open_blackbox(blackbox_csv.read, path, profile)


def _for_each(
    logs: Sequence[Log], profile: Profile | None, otherwise: str
) -> tuple[Profile, tuple[Profile, ...], tuple[str, ...]]:
    """The profile that suits a file best; that of each of its logs, with the runs that its settings cut; why none."""
    each = [profile or choose(log, bundled_profiles()) or named(otherwise) for log in logs]
    cut: list[Profile] = []
    hints: list[str] = []
    for log, chosen in zip(logs, each, strict=True):
        with_cuts, uncut = _cut((log,), chosen)
        cut += with_cuts or (chosen,)
        hints += uncut
    return max(each, key=lambda chosen: chosen.priority), tuple(cut), tuple(dict.fromkeys(hints))


def _open_paparazzi(path: Path, profile: Profile | None) -> Opened:
    file = paparazzi.read(path)
    best, profiles, hints = _for_each(file.logs, profile, "paparazzi_data")
    return Opened(
        boots=file.logs,
        kind="paparazzi",
        sha256=file.sha256,
        profile=best,
        damage=file.damage,
        notes=file.notes,
        hints=(*file.hints, *hints),
        cut=profiles,
    )


def _open_crazyflie(path: Path, profile: Profile | None) -> Opened:
    file = crazyflie.read(path)
    return Opened(
        boots=(file.log,),
        kind="crazyflie",
        sha256=file.sha256,
        profile=profile or choose(file.log, bundled_profiles()) or named("crazyflie_usd"),
        damage=file.damage,
        notes=file.notes,
    )


def _csv_profile(files: Sequence[CsvFile]) -> Profile:
    """Of the bundled profiles the one whose columns are there; headers of channel names need none."""
    units = {
        name: file.layout.units[place]
        for file in files
        for name in file.layout.names
        if (place := file.column(name)) is not None
    }
    if {"p", "q"} <= set(units):
        return contract_profile(list(units), units, files[0].path)
    columns = {name for file in files for name in file.header}
    bundled = (each for each in bundled_profiles() if each.kind == "csv" and set(each.needs) <= columns)
    return next(bundled, contract_profile(list(units), {}, files[0].path))


def _csv_log(file: CsvFile, profile: Profile) -> CsvLog:
    """A CSV seen through a profile, its columns read in one pass. Raises TippathError for what is wrong in it."""
    needed: dict[str, None] = {}
    for name in REQUIRED:
        for text in profile.channels[name].sources if name in profile.channels else ():
            fields = (text,) if file.column(text) is not None else fields_in(text)
            if fields and all(file.column(key) is not None for key in fields):
                needed.update(dict.fromkeys(fields))
                break
    others = [key for key in fields_of(profile) if file.column(key) is not None and key not in needed]
    return open_table(file, profile.time_source or "t", profile.time_scale or 1.0, list(needed), others)


def _open_mat(path: Path, profile: Profile | None) -> Opened:
    file = mat.read(path)
    return _of_arrays(path, profile, "mat", columns_of(file.arrays), sha256=file.sha256, hints=mat.left_out(file))


def _open_mcap(path: Path, profile: Profile | None) -> Opened:
    file = mcap.read(path)
    return _of_arrays(path, profile, "mcap", file.columns, sha256=file.sha256, hints=file.notes, damage=file.damage)


def _open_parquet(path: Path, profile: Profile | None) -> Opened:
    file = parquet.read(path)
    return _of_arrays(path, profile, "parquet", file.columns, sha256=file.sha256)


def _of_arrays(
    path: Path,
    profile: Profile | None,
    kind: str,
    columns: Mapping[str, FloatArray],
    *,
    sha256: str,
    hints: tuple[str, ...] = (),
    damage: Damage | None = None,
) -> Opened:
    """Named arrays by the profile asked for, by the channels' own names, or by those that are usual."""
    chosen = profile or contract_profile_within(columns, kind)
    if profile is None and not chosen.channels:
        usual = ArrayLog(path=str(path), kind=kind, columns=columns, time=None, scale=1.0)
        chosen = choose(usual, bundled_profiles()) or chosen
    log = ArrayLog(path=str(path), kind=kind, columns=columns, time=chosen.time_source, scale=chosen.time_scale or 1.0)
    cut, told = _cut((log,), chosen)
    notes: tuple[str, ...] = ()
    if not any(log.clock_of(name) for name in columns):
        notes = (
            f"no vector of times called {chosen.time_source} of as many samples as another array; name it in a "
            "profile: [time] source = ..., scale = ...",
        )
    return Opened(
        boots=(log,),
        kind=kind,
        sha256=sha256,
        profile=chosen,
        damage=damage,
        notes=notes,
        hints=(*hints, *told),
        cut=cut,
    )


FORMATS = (
    Format("dataflash", (".bin",), _is_dataflash, _open_dataflash),
    Format("ulog", (".ulg",), ulog.is_ulog, _open_ulog),
    Format("dataflash", (".log",), dataflash_text.recognises, _open_dataflash_text),
    Format("tlog", (".tlog",), _is_tlog, _open_tlog),
    Format("blackbox", (".bbl", ".bfl"), blackbox.recognises, partial(_open_blackbox, blackbox.read)),
    Format("blackbox", (), blackbox_csv.recognises, _open_decoded),
    Format("paparazzi", (".data",), paparazzi.recognises, _open_paparazzi),
    Format("crazyflie", (), crazyflie.recognises, _open_crazyflie),
    Format("mat", (".mat",), mat.recognises, _open_mat),
    Format("mcap", (".mcap",), mcap.recognises, _open_mcap),
    Format("parquet", (".parquet",), parquet.recognises, _open_parquet),
    Format("csv", (".csv", ".txt"), _never, _open_csv),
)
