"""Logs to runs: what was flown, whether it can be used, and if not, why.

The log is the truth and is never changed; runs and records are cut from it by the same code whether it came over the
air, off an SD card, or from another program as CSV. `ingest` lists everything with reasons; `resolve_runs` turns the
words a user types for runs into usable records. What should be known of a run, the damage of its log included, travels
with its record, as `Record.notes`.
"""

from __future__ import annotations

import hashlib
import math
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from types import MappingProxyType

from gcs.errors import TippathError, UsageError
from gcs.logs import dataflash, health, profiles, runs
from gcs.logs.csv import CsvFile
from gcs.logs.dataflash import Damage, printable
from gcs.logs.profiles import Profile
from gcs.logs.runs import Run, Window
from gcs.logs.tables import DataFlashTables, Log
from gcs.logs.verdicts import named_all_the_same, with_verdicts
from sysid.record import CHANNELS, Record, RecordError

__all__ = [
    "Damage",
    "Ingest",
    "Profile",
    "Run",
    "Source",
    "UnreadableError",
    "Window",
    "check_same_rate_source",
    "ingest",
    "logs_in",
    "parse_window",
    "resolve_runs",
    "split_run_word",
]

READ = "DataFlash .BIN, .csv, and records (.npz) that tippath ingest -o wrote"
NOT_YET: Mapping[str, str] = MappingProxyType(
    {
        ".ulg": "ULog is not read yet; convert it (ulog2csv of pyulog) and name the columns in a profile",
        ".tlog": "telemetry logs are not read yet; take the vehicle's own .BIN, it also has every sample",
        ".log": "text DataFlash is not read yet; take the .BIN that it was converted from",
    }
)


@dataclass(frozen=True)
class Source:
    """A log as it was read."""

    path: str
    sha256: str
    kind: str
    """`dataflash`, `csv` or `record`."""
    profile: Profile | None = None
    damage: Damage | None = None
    """None where the format has no way to tell."""
    fields: tuple[str, ...] = ()
    """What the log holds, for writing a profile."""
    notes: tuple[str, ...] = ()


@dataclass(frozen=True)
class Ingest:
    """What one or several logs hold."""

    runs: tuple[Run, ...]
    sources: tuple[Source, ...]
    refused: Mapping[str, str] = field(default_factory=dict)
    """Path -> why it could not be read, of several logs of which others could."""

    @property
    def usable(self) -> tuple[Run, ...]:
        return tuple(run for run in self.runs if run.usable)

    @property
    def damage(self) -> dict[str, Damage]:
        """Path -> what could not be read, of damaged logs only."""
        return {s.path: s.damage for s in self.sources if s.damage is not None and s.damage.any}


class UnreadableError(TippathError):
    """None of the logs could be read."""

    def __init__(self, refused: Mapping[str, str]) -> None:
        super().__init__("\n".join(refused.values()))
        self.refused = dict(refused)
        """Path -> why."""


def parse_window(text: str) -> Window:
    """`START:STOP` in seconds of the log's own time; either may be empty. Raises UsageError."""
    parts = text.split(":")
    if len(parts) != 2:
        raise UsageError(f"--window {text}: write START:STOP in seconds, such as 60:95, 60: or :95")
    ends: list[float | None] = []
    for part in parts:
        try:
            value = float(part) if part.strip() else None
        except ValueError:
            raise UsageError(f"--window {text}: {part!r} is not a number of seconds") from None
        if value is not None and not math.isfinite(value):
            raise UsageError(f"--window {text}: {part} is not a number of seconds")
        ends.append(value)
    start, stop = ends
    if start is not None and stop is not None and start >= stop:
        raise UsageError(f"--window {text}: START must lie before STOP")
    return start, stop


def logs_in(folder: Path) -> list[Path]:
    """The logs of a flight folder: flight*.BIN, else every .BIN. Raises TippathError where there is none."""

    def order(path: Path) -> tuple[object, ...]:
        pieces = re.split(r"(\d+)", path.stem.lower())
        return (*(int(piece) if piece.isdigit() else piece for piece in pieces), path.name)

    found = [path for path in folder.iterdir() if path.suffix.lower() == ".bin" and path.is_file()]
    flight = [path for path in found if path.stem.lower().startswith("flight")]
    if not found:
        raise TippathError(f"{folder}: no .BIN in this folder; name a flight folder or the log itself")
    return sorted(flight or found, key=order)


def ingest(
    paths: Iterable[Path | str],
    profile: Path | Profile | None = None,
    window: Window | None = None,
    *,
    f_high_hz: float = health.F_HIGH_HZ,
) -> Ingest:
    """Find the runs in logs and flight folders, cut their records, check their health.

    A log that cannot be read goes into `refused`; where all are, UnreadableError is raised. A file that occurs twice in
    one folder (equal bytes) is read once. `profile` is a TOML file, the name of a bundled one, or a Profile; without it
    one is chosen by what each log holds. Runs that the flight.json beside a log says are to be flown again are not
    usable. Raises TippathError for a profile that makes no sense.
    """
    chosen = profiles.load(Path(profile)) if isinstance(profile, Path | str) else profile
    logs: list[Path] = []
    refused: dict[str, str] = {}
    for word in paths:
        path = Path(word)
        try:
            its_logs = logs_in(path) if path.is_dir() else [path]
        except OSError as error:
            refused[str(path)] = f"{path}: cannot be read ({error.strerror or error})"
        except TippathError as error:
            refused[str(path)] = str(error)
        else:
            logs += [one for one in its_logs if one not in logs]
    if not logs and not refused:
        raise UsageError("name at least one log, flight folder or record")
    found: list[Run] = []
    sources: list[Source] = []
    folders: set[tuple[Path, str]] = set()
    for path in logs:
        try:
            source, its_runs = _read(path, chosen, window, f_high_hz)
        except (TippathError, RecordError) as error:
            refused[str(path)] = str(error)
            continue
        if (path.parent, source.sha256) in folders and path.suffix.lower() == ".bin":
            continue
        folders.add((path.parent, source.sha256))
        sources.append(source)
        found += its_runs
    if not sources:
        raise UnreadableError(refused)
    return Ingest(tuple(found), tuple(sources), refused)


def _read(path: Path, profile: Profile | None, window: Window | None, f_high_hz: float) -> tuple[Source, list[Run]]:
    suffix = path.suffix.lower()
    if not path.exists():
        raise TippathError(f"{path}: no such file or folder")
    try:
        with path.open("rb") as stream:
            head = stream.read(2)
    except OSError as error:
        raise TippathError(f"{path}: cannot be read ({error.strerror or error})") from error
    if suffix == ".npz":
        record = Record.load(path)
        run = runs.of_record(record, window, f_high_hz)
        return Source(str(path), record.sha256, "record"), [run]
    if suffix == ".bin" or head == bytes(dataflash.HEAD):
        return _read_dataflash(path, profile, window, f_high_hz)
    if suffix in NOT_YET:
        raise TippathError(f"{path}: {NOT_YET[suffix]}. Read are: {READ}")
    if suffix not in (".csv", ".txt"):
        raise TippathError(f"{path}: unknown kind of log ({suffix or 'no ending'}). Read are: {READ}")
    return _read_csv(path, profile, window, f_high_hz)


def _read_dataflash(
    path: Path, profile: Profile | None, window: Window | None, f_high_hz: float
) -> tuple[Source, list[Run]]:
    log = dataflash.read(path)
    sha256 = hashlib.sha256(log.data.data).hexdigest()
    time = None if profile is None or profile.time_source is None else profile.time_source.rsplit(".", 1)[-1]
    table = DataFlashTables(log, str(path), time, None if profile is None else profile.time_scale)
    chosen = profile or profiles.choose(table, profiles.bundled_profiles())
    if chosen is None:
        chosen = next(one for one in profiles.bundled_profiles() if one.name == "arducopter")
    its_runs = with_verdicts(runs.runs_of(table, chosen, printable(path.name), sha256, window, f_high_hz), path)
    notes = [
        f"{count} messages of {name} left out: their time stamps break the order of the others"
        for name, count in sorted(table.dropped.items())
    ]
    if log.damage.any:
        notes.append(log.damage.describe())
    source = Source(str(path), sha256, "dataflash", chosen, log.damage, table.fields(), tuple(notes))
    return source, [_told(run, source) for run in its_runs]


def _told(run: Run, source: Source) -> Run:
    """With what is wrong with the whole log among the notes of its record."""
    if run.record is None or not source.notes:
        return run
    notes = (*run.record.notes, *(f"{printable(Path(source.path).name)}: {note}" for note in source.notes))
    return replace(run, record=replace(run.record, notes=notes))


def _read_csv(path: Path, profile: Profile | None, window: Window | None, f_high_hz: float) -> tuple[Source, list[Run]]:
    try:
        raw = path.read_bytes()
    except OSError as error:
        raise TippathError(f"{path}: cannot be read ({error.strerror or error})") from error
    file = CsvFile.parse(raw, str(path))
    sha256 = hashlib.sha256(raw).hexdigest()
    chosen = profile or _csv_profile(file)
    table: Log = profiles.open_csv(file, chosen)
    if "t" not in file.header and chosen.time_source in (None, "t"):
        raise TippathError(
            f"{path}, line 1: column t missing; add the time in seconds as t, or name the time column in a profile "
            "([time] source = ..., scale = ...)"
        )
    notes = list(file.notes)
    if profile is None and chosen.name == "channels":
        others = [name for name in file.header if name not in CHANNELS]
        if others:
            notes.append(f"columns that are no channels are not used: {', '.join(map(printable, others[:8]))}")
    its_runs = runs.runs_of(table, chosen, printable(path.name), sha256, window, f_high_hz)
    source = Source(str(path), sha256, "csv", chosen, None, file.header, tuple(notes))
    told = replace(source, notes=file.notes)  # which columns are not used is no news to whoever fits
    return source, [_told(run, told) for run in its_runs]


def _csv_profile(file: CsvFile) -> Profile:
    """Of the bundled profiles the one whose columns are there; a header of channel names needs none."""
    own = profiles.contract_profile(file.header)
    if {"p", "q"} <= set(own.channels):
        return own
    columns = set(file.header)
    bundled = (one for one in profiles.bundled_profiles() if one.kind == "csv" and set(one.needs) <= columns)
    return next(bundled, own)


def split_run_word(word: str) -> tuple[Path, int | None]:
    """`LOG#2` -> (LOG, 2), `LOG` -> (LOG, None). A file of exactly that name goes before a number."""
    path = Path(word)
    if path.exists():
        return path, None
    name, mark, number = word.rpartition("#")
    if not mark:
        return path, None
    if not number.isdigit() or int(number) < 1:
        raise UsageError(f"{word}: after # stands the number of a run, from 1")
    return Path(name), int(number)


def resolve_runs(
    words: Sequence[str],
    profile: Path | Profile | None = None,
    window: Window | None = None,
    *,
    f_high_hz: float = health.F_HIGH_HZ,
) -> list[Record]:
    """RUN words to usable records, in the order given, each run once.

    A word is a flight folder or a log (all its usable runs), LOG#n (that run, which must be usable, but for the
    flight's own verdict on it), or a record (.npz). All records take p and q from the same kind of message. What the
    user should know of each (cut short, gaps, damage of the log) is in `Record.notes`. Raises TippathError with the
    reasons.
    """
    if not words:
        raise UsageError("name at least one run: a flight folder, LOG, LOG#n or a record")
    read: dict[Path, Ingest] = {}
    records: list[Record] = []
    seen: set[tuple[str, str]] = set()
    for word in words:
        path, number = split_run_word(word)
        if path not in read:
            read[path] = ingest([path], profile, window, f_high_hz=f_high_hz)
        found = read[path].runs
        if number is not None:
            found = tuple(run for run in found if run.id.rpartition("#")[2] == str(number))
            if not found:
                has = ", ".join(run.id for run in read[path].runs)
                raise TippathError(f"{word}: no such run{' in this window' if window else ''}; the log has {has}")
            found = tuple(named_all_the_same(run) for run in found)
        usable = [run for run in found if run.usable and run.record is not None]
        if not usable:
            listed = "\n".join(f"  {run.id}: {reason}" for run in found for reason in run.reasons)
            raise TippathError(f"{word}: not usable, because\n{listed}")
        for run in usable:
            assert run.record is not None
            if (run.path, run.id) not in seen:
                seen.add((run.path, run.id))
                records.append(run.record)
    check_same_rate_source(records)
    return records


def check_same_rate_source(records: Iterable[Record]) -> None:
    """Raises TippathError where records take p and q from different kinds of message."""
    kinds: dict[str, list[str]] = {}
    for record in records:
        kinds.setdefault(record.rate_source, []).append(record.id)
    if len(kinds) > 1:
        listed = "; ".join(f"{kind}: {', '.join(ids)}" for kind, ids in sorted(kinds.items()))
        raise TippathError(
            f"these runs take p and q from different messages ({listed}), which differ by some 10 ms: fit runs of one "
            "kind, or take all from RATE with --profile arducopter_rate"
        )
