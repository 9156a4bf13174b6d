"""Logs to runs: what was flown, whether it can be used, and if not, why.

The log is the truth and is never changed; runs and records are cut from it by the same code whether it came over the
air, off an SD card, or from another program as CSV. `ingest` lists everything with reasons; `resolve_runs` turns the
words a user types for runs into usable records. What should be known of a run, the damage of its log included, travels
with its record, as `Record.notes`.
"""

from __future__ import annotations

import math
import os
import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

from gcs.errors import TippathError, UsageError
from gcs.logs import opening, reading
from gcs.logs.cache import Content
from gcs.logs.flight_files import beside, fetched, hidden_by, is_streamed, of_flight, streamed_after
from gcs.logs.formats.damage import Damage
from gcs.logs.formats.raw import unreadable
from gcs.logs.profile.choice import taking_one_of
from gcs.logs.profile.profiles import Profile, load
from gcs.logs.reading import Progress
from gcs.logs.runs.health import F_HIGH_HZ, up_to_words
from gcs.logs.runs.run import AnyWindow, FromStart, Run, Window, split_mark
from gcs.logs.runs.verdicts import named_all_the_same, with_verdicts
from gcs.logs.source import Source
from gcs.logs.words import printable
from sysid.data.record import Record

__all__ = [
    "AnyWindow",
    "Damage",
    "FromStart",
    "Ingest",
    "Profile",
    "Progress",
    "Run",
    "Source",
    "UnreadableError",
    "Window",
    "check_same_rate_source",
    "fitted_beside",
    "ingest",
    "ingest_joined",
    "logs_in",
    "parse_window",
    "resolve_runs",
    "split_run_word",
]


@dataclass(frozen=True)
class Ingest:
    """What one or several logs hold."""

    runs: tuple[Run, ...]
    sources: tuple[Source, ...]
    refused: Mapping[str, str] = field(default_factory=dict)
    """Path -> why it could not be read, of several logs of which others could."""
    left_out: Mapping[str, str] = field(default_factory=dict)
    """Flight folder -> which other logs in it are not listed, in words."""

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
        super().__init__("\n".join(map(printable, refused.values())))
        self.refused = dict(refused)
        """Path -> why."""


def parse_window(text: str) -> AnyWindow:
    """`START:STOP` in seconds of the log's own time; either may be empty. `@START:STOP`: from each run's start.

    Raises UsageError.
    """
    from_start = text.startswith("@")
    parts = text.removeprefix("@").split(":")
    if len(parts) != 2:
        raise UsageError(
            f"--window {text}: write START:STOP in seconds, such as 60:95, 60: or :95; @5:25 counts from each run's "
            "start"
        )
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
    if not from_start:
        return start, stop
    if min(start or 0.0, stop or 0.0) < 0:
        raise UsageError(f"--window {text}: seconds from a run's start are not negative")
    return FromStart(start, stop)


SHARED_S = 0.1  # parts that meet share a sample
NAMED = 4  # logs that are left out
LONGEST_REASON = 80  # characters
DEPTH = 4  # folders within folders, as /log/2026-11-20/*.ulg on a PX4 card


def logs_in(folder: Path) -> list[Path]:
    """The logs of a folder and of its subfolders; of each that is a flight folder its flight*.BIN alone, or where the
    log was fetched off the vehicle, that: whole, or else the runs' parts.

    Of files that differ in their ending only (a .BIN and the .log it was converted to) the one that holds most is
    taken. Hidden files and folders are left out. Raises TippathError where there is none, OSError where the folder
    cannot be read.
    """
    ranks = {suffix: rank for rank, suffix in enumerate(opening.suffixes())}
    best: dict[tuple[Path, str], Path] = {}
    records = False
    for files in _files_within(folder):
        logs = [path for path in files if path.suffix.lower() in ranks and path.is_file()]
        records |= any(path.suffix.lower() == ".npz" for path in files)
        flight = [path for path in logs if is_streamed(path)] or fetched(logs)
        for path in sorted(flight or logs, key=lambda path: (reading.size_of(path) == 0, ranks[path.suffix.lower()])):
            best.setdefault((path.parent, path.stem if path in flight else path.stem.lower()), path)
    if best:
        return sorted(best.values(), key=_in_order)
    known = ", ".join(sorted(ranks))
    do = "name the records in it one by one (*.npz)" if records else "name a flight folder or the log itself"
    raise TippathError(
        f"{folder}: no log ({known}) in this folder, nor in {DEPTH - 1} levels of folders below it; {do}"
    )


def _files_within(folder: Path) -> Iterator[list[Path]]:
    """The files of a folder and of those below it, folder by folder; nothing below a flight folder."""

    def unless_below(error: OSError) -> None:
        if error.filename == str(folder):
            raise error

    seen: set[str] = set()
    for at, below, names in os.walk(folder, onerror=unless_below, followlinks=True):
        place, real = Path(at), os.path.realpath(at)
        files = [] if real in seen else [place / name for name in names if not name.startswith(".")]
        deep = len(place.parts) - len(folder.parts) >= DEPTH - 1
        done = deep or real in seen or any(is_streamed(path) for path in files)
        below[:] = [] if done else [name for name in below if not name.startswith(".")]
        seen.add(real)
        yield files


def _in_order(path: Path) -> tuple[object, ...]:
    """By folder and name, with the numbers in names as numbers: every second piece is one."""
    pieces = re.split(r"(\d+)", path.stem.lower())
    return path.parent, tuple(int(piece) if place % 2 else piece for place, piece in enumerate(pieces)), path.name


def ingest(
    paths: Iterable[Path | str],
    profile: Path | Profile | None = None,
    window: AnyWindow | None = None,
    *,
    f_high_hz: float = F_HIGH_HZ,
    loop_rate_hz: float | None = None,
    flight: Path | None = None,
    join: bool = True,
    progress: Callable[[Progress], None] | None = None,
) -> Ingest:
    """Find the runs in logs and flight folders, cut their records, check their health.

    A log that cannot be read goes into `refused`; where all are, UnreadableError is raised. A file that occurs twice in
    one folder (equal bytes) is read once. `profile` is a TOML file, the name of a bundled one, or a Profile; without it
    one is chosen by what each log holds. Runs that the flight.json beside a log says are to be flown again are not
    usable. `loop_rate_hz`, how often the vehicle's loop gave a command, goes before what a log tells.

    A streamed log of a flight and what was fetched of the same one are read together, unless `join` is false; a log
    from elsewhere with those in the folder of its `flight`. Raises TippathError for a profile that makes no sense.
    """
    chosen = load(Path(profile)) if isinstance(profile, Path | str) else profile
    paths = list(paths)
    refused: dict[str, str] = {}
    logs = _logs_of(paths, refused)
    if not logs and not refused:
        raise UsageError("name at least one log, flight folder or record")
    together = _together(logs, flight) if join else {}
    how = reading.Reading(chosen, window, f_high_hz, loop_rate_hz, together)
    folders = [Path(word) for word in paths if Path(word).is_dir()]
    sources: list[Source] = []
    later = [log for log in logs if any(log in others for others in together.values())]
    runs = _read([log for log in logs if log not in later], how, progress, sources, refused)
    for log in later:
        if str(log) not in _taken(sources):
            runs += _read([log], how, None, sources, refused)
    # A streamed log that cannot be read is none: what was fetched speaks for the flight.
    instead = [other for path in logs if str(path) in refused for other in together.get(path, ()) if other not in logs]
    runs += _read(instead, replace(how, beside={}), None, sources, refused)
    if not sources:
        raise UnreadableError(refused)
    return Ingest(tuple(runs), tuple(_with_apart(sources)), refused, _left_out(logs, folders))


def ingest_joined(
    paths: Sequence[Path | str],
    profile: Path | Profile | None = None,
    window: AnyWindow | None = None,
    *,
    f_high_hz: float = F_HIGH_HZ,
    loop_rate_hz: float | None = None,
) -> Ingest:
    """Several CSVs of one flight as one log, joined by time; a run is called after the first, its record to be saved.

    Raises UnreadableError where they cannot be read or do not overlap in time, UsageError where there is but one, or
    one is no CSV.
    """
    csvs = [Path(path) for path in paths]
    others = [path.name for path in csvs if path.suffix.lower() not in (".csv", ".txt")]
    if others or len(csvs) < 2:
        raise UsageError(
            f"--join joins two CSVs or more by time, {f'{others[0]} is none' if others else 'name several'}"
        )
    chosen = load(Path(profile)) if isinstance(profile, Path | str) else profile
    try:
        content = reading.read_as_one(csvs, reading.Reading(chosen, window, f_high_hz, loop_rate_hz))
    except UsageError:
        raise
    except TippathError as error:
        raise UnreadableError({str(csvs[0]): str(error)}) from error
    return Ingest(content.runs, (content.source,))


def _logs_of(paths: Iterable[Path | str], refused: dict[str, str]) -> list[Path]:
    """The logs that paths name, each once; why one has none is added to `refused`."""
    logs: list[Path] = []
    for word in paths:
        path = Path(word)
        try:
            its_logs = logs_in(path) if path.is_dir() else [path]
        except OSError as error:
            refused[str(path)] = str(unreadable(path, error))
        except TippathError as error:
            refused[str(path)] = str(error)
        else:
            logs += [log for log in its_logs if log not in logs]
    return logs


def _taken(sources: Sequence[Source]) -> set[str]:
    """The paths of the logs that were read together with others."""
    return {one.path for source in sources if source.joined for one in source.joined.files}


def _together(logs: Sequence[Path], flight: Path | None) -> dict[Path, tuple[Path, ...]]:
    """For each log the others that may be of the same flight, where there are any."""
    found: dict[Path, tuple[Path, ...]] = {}
    for log in logs:
        if is_streamed(log):
            came = [other for other in beside(log) if other not in logs]
            # A log that was streamed in two is one on the card: it is not to be read twice.
            found[log] = (*came, *streamed_after(log)) if came else ()
        elif flight is not None and log.suffix.lower() == ".bin":
            found[log] = of_flight(flight, log)
    return {log: others for log, others in found.items() if others}


def _read(
    logs: Sequence[Path],
    how: reading.Reading,
    progress: Callable[[Progress], None] | None,
    sources: list[Source],
    refused: dict[str, str],
) -> list[Run]:
    """The runs of these logs; what was read of them, or why nothing was, is added to `sources` and `refused`."""
    runs: list[Run] = []
    known = {(Path(source.path).parent, source.sha256): place for place, source in enumerate(sources)}
    for path, content in reading.read_all(logs, how, progress):
        if not isinstance(content, Content):
            refused[str(path)] = str(content)
            continue
        source = content.source
        if source.kind != "record":
            place = known.setdefault((path.parent, source.sha256), len(sources))
            if place < len(sources):
                again = f"{printable(path.name)} holds the same bytes and is left out"
                sources[place] = replace(sources[place], hints=(*sources[place].hints, again))
                continue
        sources.append(source)
        runs += with_verdicts(content.runs, path, source.joined)
    return runs


def _with_apart(sources: Sequence[Source]) -> list[Source]:
    """The sources, those beside which logs lie that no log of the flight was joined with say so."""
    told = {source.path for source in sources} | _taken(sources)
    out = []
    for source in sources:
        apart = {path: why for path, why in source.apart.items() if path not in told}
        told |= set(apart)
        hints = [
            f"{printable(Path(path).name)} is not read with it: {printable(why)}; it stays as it is, and is read by "
            "itself where it is named"
            for path, why in apart.items()
        ]
        out.append(replace(source, apart=apart, hints=(*source.hints, *hints)))
    return out


def _left_out(logs: Sequence[Path], folders: Sequence[Path]) -> dict[str, str]:
    """Flight folder that was found in folders -> the other logs in it, which are not listed."""
    found: dict[str, str] = {}
    for log in logs:
        folder = log.parent
        if str(folder) in found or not is_streamed(log) or not any(log.is_relative_to(each) for each in folders):
            continue
        names = [printable(str(path.relative_to(folder))) for path in hidden_by(log, opening.suffixes())]
        if names:
            more = f" and {len(names) - NAMED} more" if len(names) > NAMED else ""
            found[str(folder)] = (
                f"left out of {printable(str(folder))}: {', '.join(names[:NAMED])}{more}; {printable(log.name)} makes "
                "it the folder of one flight: name other logs by themselves"
            )
    return found


def split_run_word(word: str) -> tuple[Path, int | None]:
    """`LOG#2` -> (LOG, 2), `LOG` -> (LOG, None). A file of exactly that name goes before a number."""
    if not word:
        raise UsageError("an empty name is no run: name a flight folder, LOG, LOG#n or a record")
    path = Path(word)
    if path.exists():
        return path, None
    name, mark, number = word.rpartition("#")
    if not mark:
        return path, None
    if re.fullmatch("[0-9]{1,9}", number) is None or int(number) < 1:
        raise UsageError(f"{word}: after # stands the number of a run, from 1")
    return Path(name), int(number)


def resolve_runs(
    words: Sequence[str],
    profile: Path | Profile | None = None,
    window: AnyWindow | None = None,
    *,
    f_high_hz: float = F_HIGH_HZ,
    loop_rate_hz: float | None = None,
) -> list[Record]:
    """RUN words to usable records, in the order given, each run once.

    A word is a flight folder or a log (all its usable runs), LOG#n (that run, which must be usable, but for the
    flight's own verdict on it), or a record (.npz); behind each @START:STOP may say which seconds from its start are
    taken, and goes before `window`. All records take p and q from the same kind of message. What the
    user should know of each (cut short, gaps, damage of the log), and what of a folder cannot be read, is in
    `Record.notes`. Raises TippathError with the reasons.
    """
    if not words:
        raise UsageError("name at least one run: a flight folder, LOG, LOG#n or a record")
    read: dict[tuple[Path, AnyWindow | None], Ingest] = {}
    records: dict[tuple[object, ...], Record] = {}
    for word in words:
        plain, own_window = _with_window(word)
        its_window = own_window or window
        path, number = split_run_word(plain)
        if (path, its_window) not in read:
            read[path, its_window] = ingest([path], profile, its_window, f_high_hz=f_high_hz, loop_rate_hz=loop_rate_hz)
        found = read[path, its_window]
        meant = found.runs if number is None else _numbered(found.runs, number, word, its_window)
        usable = [run.record for run in meant if run.usable and run.record is not None]
        if not usable:
            listed = "\n".join(
                f"  {run.id}: {reason}"
                for run in meant
                for reason in (*run.reasons, *([] if run.usable_to_hz is None else [up_to_words(run.usable_to_hz)]))
            )
            raise TippathError(f"{word}: not usable, because\n{listed}")
        unread = [f"left out of {word}: {reason}" for reason in found.refused.values()]
        unread += [*found.left_out.values(), *_not_taken(word, meant)]
        for place, record in enumerate(usable):
            records.setdefault(_identity(record), _with_notes(record, [] if place else unread))
    check_same_rate_source(records.values())
    return list(records.values())


def _not_taken(word: str, runs: Sequence[Run]) -> list[str]:
    """That runs of a word are not usable, each with the first of the reasons; nothing where all are."""
    each = [f"{run.id} ({_first(run.reasons[0])})" for run in runs if not run.usable and run.reasons]
    return [f"left out of {word}, not usable: {'; '.join(each)}"] if each else []


def _first(reason: str) -> str:
    """Its beginning; `ingest` says all of it."""
    short = reason.partition("; ")[0]
    return short if len(short) <= LONGEST_REASON else f"{short[: LONGEST_REASON - 1]}…"


def _with_window(word: str) -> tuple[str, FromStart | None]:
    """`LOG#2@5:25` -> (`LOG#2`, its window). A file of exactly that name goes before a window. Raises UsageError."""
    if not word or Path(word).exists():
        return word, None
    plain, window = split_mark(word)
    if window is None:
        return word, None
    checked = parse_window(window.mark)
    assert isinstance(checked, FromStart)
    return plain, checked


def _numbered(runs: Sequence[Run], number: int, word: str, window: AnyWindow | None) -> list[Run]:
    """Those of one number, the flight's own verdict on them set aside. Raises TippathError where there is none."""
    meant = [named_all_the_same(run) for run in runs if split_mark(run.id)[0].rpartition("#")[2] == str(number)]
    if not meant:
        has = ", ".join(run.id for run in runs)
        raise TippathError(f"{word}: no such run{' in this window' if window else ''}; the log has {has}")
    return meant


def _with_notes(record: Record, notes: Iterable[str]) -> Record:
    return replace(record, notes=(*record.notes, *map(printable, notes)))


def fitted_beside(records: Sequence[Record], judging: Sequence[Record]) -> list[Record]:
    """The records that are not among those that judge. Raises TippathError where a part of one is: it may not do both.

    Equal are records of the same bytes, run and times, whether cut from the log or written before.
    """
    fitted = []
    for record in records:
        shared = {one.id: _shared_s(record, one) for one in judging}
        if any(_identity(record) == _identity(one) for one in judging):
            continue
        if max(shared.values(), default=0.0) > SHARED_S:
            other = max(shared, key=lambda id: shared[id])
            raise TippathError(
                f"{record.id} is to be fitted and {other} is to judge, and {shared[other]:.1f} s of the flight are in "
                f"both: name parts that do not overlap, such as {split_mark(record.id)[0]}@0:20 and "
                f"{split_mark(record.id)[0]}@20:40"
            )
        fitted.append(record)
    return fitted


def _identity(record: Record) -> tuple[object, ...]:
    """Equal for a run and a record that was written of it; several records may be parts of one run."""
    return (*_run_of(record), float(record.t[0]), float(record.t[-1]))


def _run_of(record: Record) -> tuple[str, str]:
    """Which run of which log it is, or is a part of."""
    return record.sha256 or record.path, split_mark(record.id)[0]


def _shared_s(one: Record, other: Record) -> float:
    """How much of a run is in both; 0 for different runs."""
    if _run_of(one) != _run_of(other):
        return 0.0
    return max(0.0, float(min(one.t[-1], other.t[-1]) - max(one.t[0], other.t[0])))


def check_same_rate_source(records: Iterable[Record]) -> None:
    """Raises TippathError where records take p and q from different kinds of message."""
    kinds: dict[str, list[str]] = {}
    for record in records:
        kinds.setdefault(record.rate_source, []).append(record.id)
    if len(kinds) > 1:
        listed = "; ".join(f"{kind}: {', '.join(ids)}" for kind, ids in sorted(kinds.items()))
        raise TippathError(
            f"these runs take p and q from different messages ({listed}), which differ by some 10 ms: fit runs of one "
            f"kind, or take all from one with {taking_one_of(kinds)}"
        )
