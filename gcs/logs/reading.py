"""From files to runs: one log, or many side by side; what was read before is taken from the cache."""

from __future__ import annotations

import hashlib
import multiprocessing
import os
import signal
import zipfile
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import Future, ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass, field, replace
from pathlib import Path

from gcs.errors import TippathError
from gcs.logs import cache, opening
from gcs.logs.cache import Content
from gcs.logs.formats import mat
from gcs.logs.formats.dataflash_table import DataFlashTables
from gcs.logs.formats.raw import unreadable
from gcs.logs.formats.tables import Log
from gcs.logs.joining import open_joined
from gcs.logs.profile import responses
from gcs.logs.profile.profiles import Profile
from gcs.logs.runs import cutting, runs
from gcs.logs.runs import responses as of_responses
from gcs.logs.runs.loop import TOLD
from gcs.logs.runs.run import AnyWindow, Run
from gcs.logs.source import Source
from gcs.logs.words import printable
from sysid.data.record import DAMAGED, Record, RecordError

SIDE_BY_SIDE_BYTES = 64 << 20  # below it, starting processes costs more than they save
MOST_PROCESSES = 8
RESPONSES = (".csv", ".txt", ".mat", ".json")
"""Endings of files that may hold frequency responses instead of a log."""


@dataclass(frozen=True)
class Reading:
    """How logs are to be read."""

    profile: Profile | None
    window: AnyWindow | None
    f_high_hz: float
    loop_rate_hz: float | None = None
    """How often the vehicle's loop gave a command, where the user says so."""
    beside: Mapping[Path, tuple[Path, ...]] = field(default_factory=dict)
    """Log -> others that may be of the same flight, to be read with it."""


@dataclass(frozen=True)
class Progress:
    """How far a folder has been read."""

    done: int
    total: int
    done_bytes: int
    total_bytes: int
    path: Path
    """The log that was finished last."""


def read(path: Path, how: Reading) -> Content:
    """Everything in one log. Raises TippathError where it cannot be read, RecordError for a record that is none."""
    if path.suffix.lower() == ".npz":
        opening.require_file(path)
        if not _is_record(path):
            raise TippathError(f"{path}: not a record; records are the .npz files that tippath ingest -o writes")
        record = replace(Record.load(path), path=str(path))  # its log may be gone, and holds it in no window
        return Content(
            Source(path=str(path), sha256=record.sha256, kind="record"),
            (cutting.of_record(record, how.window, how.f_high_hz, how.loop_rate_hz),),
        )
    kept: Path | None = None
    sha256 = ""
    if cache.wanted() and path.is_file():
        try:
            sha256 = cache.digest_of(path)
            others = [(str(other), cache.digest_of(other)) for other in how.beside.get(path, ()) if other.is_file()]
        except OSError as error:
            raise unreadable(path, error) from error
        kept = cache.place(path, sha256, (replace(how, beside={}), *others))
        content = cache.load(kept)
        if content is not None:
            return content
    content = _parse(path, how)
    if kept is not None and sha256 in _digests(content.source):  # else it grew meanwhile
        cache.save(kept, content)
    return content


def _digests(source: Source) -> set[str]:
    return {source.sha256, *(one.sha256 for one in (source.joined.files if source.joined else ()))}


def _is_record(path: Path) -> bool:
    """Whether it has what every record has. Raises TippathError where it cannot be opened."""
    try:
        with zipfile.ZipFile(path) as archive:
            return "about.npy" in archive.namelist()
    except OSError as error:
        raise unreadable(path, error) from error
    except DAMAGED:
        return False


def _of_responses(path: Path, how: Reading) -> Content | None:
    """What a file of frequency responses holds; None for what is none. Raises TippathError."""
    table = None if how.profile is None else how.profile.response
    suffix = path.suffix.lower()
    if suffix not in RESPONSES or not path.is_file():
        return None
    try:
        raw = path.read_bytes()
    except OSError as error:
        raise unreadable(path, error) from error
    try:
        if suffix == ".json":
            found = responses.of_json(raw, str(path))
        elif suffix == ".mat":
            found = responses.of_mat(mat.read(path), str(path), table)
        else:
            found = responses.of_csv(raw, str(path), table)
    except responses.NoResponseError:
        return None
    if how.window is not None:
        raise TippathError(f"{path}: a frequency response has no seconds to cut: name a band, --band LOW:HIGH")
    sha256 = hashlib.sha256(raw).hexdigest()
    source = Source(path=str(path), sha256=sha256, kind="response", profile=how.profile)
    return Content(source, of_responses.runs_of(found, printable(path.name), str(path), sha256))


def read_as_one(paths: Sequence[Path], how: Reading) -> Content:
    """Several CSVs as one log, called after the first. Raises TippathError where they cannot be joined."""
    return _content(paths[0], opening.open_csvs(paths, how.profile), how)


def _parse(path: Path, how: Reading) -> Content:
    content = _of_responses(path, how)
    if content is not None:
        return content
    beside = how.beside.get(path, ())
    opened = open_joined(path, beside, how.profile) if beside else opening.open_log(path, how.profile)
    return _content(path, opened, how)


def _content(path: Path, opened: opening.Opened, how: Reading) -> Content:
    name = printable(path.name)
    parts = opened.parts
    if how.loop_rate_hz is not None:
        told = [replace(profile, loop_rate_hz=how.loop_rate_hz, loop_told_by=TOLD) for _, profile in parts]
        parts = [(log, profile) for (log, _), profile in zip(parts, told, strict=True)]
    flown = runs.runs_of(parts, name, opened.sha256, how.window, how.f_high_hz)
    fields = dict.fromkeys(field for log in opened.boots for field in log.fields())
    hints: list[str] = []
    # Asked for after the runs: what breaks the order of time is found when a series is read.
    notes = [*opened.notes]
    for log in opened.boots:
        notes += [
            f"{count} messages of {name} left out: their time stamps break the order of the others"
            for name, count in sorted(log.dropped.items())
        ]
    if opened.joined is not None:  # what one of them lacks the other may have: the runs' gaps tell what is left
        hints = [f"with others of the same flight: {opened.joined.words}"]
        hints += [f"{Path(one.path).name}: {one.damage}" for one in opened.joined.files if one.damage]
    elif opened.damage is not None and opened.damage.any:
        notes.append(opened.damage.describe())
    source = Source(
        path=str(path),
        sha256=opened.sha256,
        kind=opened.kind,
        profile=opened.profile,
        damage=opened.damage,
        fields=tuple(fields),
        notes=tuple(notes),
        hints=(*opened.hints, *hints, *flown.elsewhere, *_left_out(opened.boots)),
        joined=opened.joined,
        apart=opened.apart,
    )
    return Content(source, tuple(_told(run, source) for run in flown.runs))


def _left_out(boots: Sequence[Log]) -> list[str]:
    """What of the messages that were read is not believed because a gap follows it; nothing where there is none."""
    counts: Counter[str] = Counter()
    for log in boots:
        if isinstance(log, DataFlashTables):
            counts.update(log.before_gaps)
    if not counts:
        return []
    listed = ", ".join(f"{count} of {name}" for name, count in sorted(counts.items()))
    return [f"left out before gaps: {listed}: the last message before a gap may be made of two halves"]


def _told(run: Run, source: Source) -> Run:
    """With what is wrong with the whole log among the notes of its record."""
    if run.record is None or not source.notes:
        return run
    notes = (*run.record.notes, *(f"{printable(Path(source.path).name)}: {note}" for note in source.notes))
    return replace(run, record=replace(run.record, notes=notes))


Refusal = TippathError | RecordError
Outcome = Content | Refusal


def read_all(
    paths: Sequence[Path], how: Reading, progress: Callable[[Progress], None] | None = None
) -> Iterator[tuple[Path, Outcome]]:
    """Each log with what was read, or why it could not be, in the order given; several side by side where it pays."""
    sizes = {path: size_of(path) for path in paths}
    total, so_far, done = sum(sizes.values()), 0, 0

    def told(path: Path) -> None:
        nonlocal so_far, done
        so_far, done = so_far + sizes[path], done + 1
        if progress is not None:
            progress(Progress(done, len(paths), so_far, total, path))

    processes = min(MOST_PROCESSES, len(paths), os.cpu_count() or 1)
    if processes < 2 or total < SIDE_BY_SIDE_BYTES:
        for path in paths:
            outcome = _outcome(path, how)
            told(path)
            yield path, outcome
        return
    outcomes: dict[Path, Outcome] = {}
    others = set(multiprocessing.active_children())
    pool = ProcessPoolExecutor(processes, multiprocessing.get_context("spawn"), _leave_interrupts_to_the_parent)
    try:
        largest_first = sorted(paths, key=lambda path: -sizes[path])
        futures: dict[Future[bytes | Refusal | None], Path] = {
            pool.submit(_packed_outcome, path, how): path for path in largest_first
        }
        for future in as_completed(futures):
            path = futures[future]
            try:
                result = future.result()
                if result is None:
                    outcomes[path] = _outcome(path, how)
                else:
                    outcomes[path] = cache.unpacked(result) if isinstance(result, bytes) else result
            except BrokenProcessPool:  # the system ended a process, for want of memory as a rule
                outcomes[path] = _outcome(path, how)
            told(path)
    except BaseException:  # interrupted: nobody waits for a log that is half read
        for process in set(multiprocessing.active_children()) - others:
            process.terminate()
        raise
    finally:
        pool.shutdown(wait=True, cancel_futures=True)
    yield from ((path, outcomes[path]) for path in paths)


def _outcome(path: Path, how: Reading) -> Outcome:
    try:
        return read(path, how)
    except (TippathError, RecordError) as error:
        return error


def _packed_outcome(path: Path, how: Reading) -> bytes | Refusal | None:
    """None where it cannot be sent: the name is no text."""
    outcome = _outcome(path, how)
    try:
        return cache.packed(outcome) if isinstance(outcome, Content) else outcome
    except UnicodeEncodeError:
        return None


def size_of(path: Path) -> int:
    """Bytes; 0 where nobody can tell."""
    try:
        return path.stat().st_size
    except OSError:
        return 0


def _leave_interrupts_to_the_parent() -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)
