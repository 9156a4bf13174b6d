"""What is on disk of a flight while it is flown: the vehicle's log, block by block, and the telemetry.

`flight.BIN` is the vehicle's own log, byte for byte: block n lies at byte 200 n, so a gap is a hole of zeros until the
block comes. `flight.tlog` holds the raw frames of both directions, each behind eight bytes of big-endian microseconds
since 1970, as MAVProxy writes them; the log's blocks are left out of it, because they are in the other file.

A name that exists is never written again: the next free number is taken. What is written reaches the disk itself once
a second. A full disk is a condition that is reported and that may pass; it never ends the link.
"""

from __future__ import annotations

import contextlib
import os
import shutil
import struct
from collections.abc import Callable
from dataclasses import dataclass
from io import FileIO
from pathlib import Path
from typing import Any

from gcs.errors import TippathError
from gcs.flight.syncing import Syncing, sync_folder
from gcs.link.decode import BLOCK_SIZE
from gcs.link.log_blocks import StreamResult
from gcs.link.log_end import NOT_JUDGED, EndState, LogEnd
from gcs.vehicle.autopilots import NO_LOG

HOW = "log blocks streamed by the vehicle (REMOTE_LOG_DATA_BLOCK), acknowledged one by one"
ON_CARD = "telemetry only: the log is on the vehicle's card"


@dataclass(slots=True)
class _Growing:
    """A file of this recording."""

    path: Path
    stream: FileIO
    size: int = 0


@dataclass(frozen=True, slots=True, kw_only=True)
class RecordedLog:
    """One log of the vehicle, as it came."""

    path: Path
    blocks: int
    expected: int
    missing: tuple[tuple[int, int], ...]
    """First and last block of each stretch that never came; its bytes are zero."""
    duplicates: int
    end: LogEnd = NOT_JUDGED
    """Whether more should have followed its last block. Not known unless it was shown."""
    in_two_versions: int = 0
    """Blocks that came again with other bytes; nobody knows which are the vehicle's."""
    impossible: int = 0
    """Blocks refused for a number that no sender can have come to: somebody else's."""

    @property
    def complete(self) -> bool:
        """Every block is there, in one version, and the log goes to the end of the recording."""
        return not self.missing and not self.in_two_versions and self.end.state is EndState.REACHED

    @property
    def problems(self) -> tuple[str, ...]:
        """What of it is missing, in words."""
        gaps = [f"{self.path.name}: {self.missing_blocks} of {self.expected} blocks missing"] if self.missing else []
        if self.in_two_versions:
            many = f"{self.in_two_versions} block{'s' if self.in_two_versions > 1 else ''}"
            gaps.append(f"{self.path.name}: {many} came in two versions, damaged or somebody else's; the first is kept")
        end = self.end.words(self.path.name)
        return (*gaps, end) if end else tuple(gaps)

    @property
    def missing_blocks(self) -> int:
        return sum(last - first + 1 for first, last in self.missing)

    @property
    def size(self) -> int:
        """Bytes, gaps included."""
        return self.expected * BLOCK_SIZE

    def to_json(self) -> dict[str, Any]:
        return {
            "path": str(self.path),
            "blocks": self.blocks,
            "bytes": self.size,
            "missing": [list(stretch) for stretch in self.missing],
            "duplicates": self.duplicates,
            "in_two_versions": self.in_two_versions,
            "impossible": self.impossible,
            "end": self.end.state.value,
            "end_cause": self.end.cause.value,
            "log_s": self.end.log_s,
            "vehicle_clock_s": self.end.clock_s,
            "short_s": self.end.short_s,
            "complete": self.complete,
        }


@dataclass(frozen=True, slots=True, kw_only=True)
class RecordingSummary:
    """What a recording left on disk."""

    directory: Path
    logs: tuple[RecordedLog, ...]
    """In order; more than one where the vehicle began anew."""
    tlog: Path | None
    tlog_frames: int
    how: str
    """The way the samples came."""
    problems: tuple[str, ...]
    """What the user should know, empty where everything was kept."""

    @property
    def log(self) -> Path | None:
        """The last log, or None where none came."""
        return self.logs[-1].path if self.logs else None

    @property
    def complete(self) -> bool:
        """Whether it is shown that everything was kept: a log came, no block is missing, every log goes to its end,
        and there is nothing to tell."""
        return bool(self.logs) and all(log.complete for log in self.logs) and not self.problems

    @property
    def missing_blocks(self) -> int:
        """Below the highest that came. 0 says nothing about the ends: see `complete`."""
        return sum(log.missing_blocks for log in self.logs)

    def to_json(self) -> dict[str, Any]:
        return {
            "logs": [log.to_json() for log in self.logs],
            "tlog": None if self.tlog is None else str(self.tlog),
            "tlog_frames": self.tlog_frames,
            "how": self.how,
            "complete": self.complete,
            "problems": list(self.problems),
        }


class Recorder:
    """Writes the files of one flight into `directory`. For one thread; nothing it does raises after it is made.

    `wall_clock` gives seconds since 1970. Raises TippathError where the folder cannot be made.
    """

    def __init__(self, directory: Path, wall_clock: Callable[[], float], stem: str = "flight") -> None:
        self.directory = directory
        self.problem: str | None = None
        """Why something is not being kept at present."""
        self._stem = stem
        self._wall_clock = wall_clock
        self._logs: dict[int, _Growing] = {}
        self._tlog: _Growing | None = None
        self._tlog_frames = 0
        self._syncing = Syncing()
        self._problems: list[str] = []
        try:
            directory.mkdir(parents=True, exist_ok=True)
            self._tlog = self._new_file(".tlog")
        except OSError as error:
            raise TippathError(
                f"cannot record into {directory} ({error.strerror or error}); choose another folder with -o"
            ) from error

    @property
    def log_path(self) -> Path | None:
        """The log that grows, None before its first block."""
        return self._logs[max(self._logs)].path if self._logs else None

    def disk_free(self) -> int | None:
        """Bytes free where the files are, None where the system does not tell."""
        try:
            return shutil.disk_usage(self.directory).free
        except OSError:
            return None

    def store(self, file: int, number: int, data: bytes) -> bool:
        """Write one block of the vehicle's `file`-th log at its place; false where the disk did not take it."""
        at = number * BLOCK_SIZE
        try:
            if file not in self._logs:
                self._end_earlier()
                self._logs[file] = self._new_file(".BIN")
            log = self._logs[file]
            log.stream.seek(at)
            written = log.stream.write(data)
        except OSError as error:
            self._report(f"the log is not being kept: {error.strerror or error}")
            return False
        if written != len(data):
            self._report("the log is not being kept: no space left on device")
            with contextlib.suppress(OSError):
                if at >= log.size:
                    log.stream.truncate(log.size)  # half a block would be taken for the log's end
            return False
        log.size = max(log.size, at + len(data))
        self._syncing.written(log.stream)
        self.problem = None
        return True

    def _end_earlier(self) -> None:
        """A log that another one follows is whole, or as whole as it gets."""
        for log in self._logs.values():
            self._end(log)

    def _end(self, growing: _Growing) -> None:
        if growing.stream.closed:
            return
        try:
            os.fsync(growing.stream.fileno())
        except OSError as error:
            self._report(f"{growing.path.name}: {error.strerror or error}")
        with contextlib.suppress(OSError):
            growing.stream.close()

    def frame(self, raw: bytes) -> None:
        """Write one MAVLink frame, stamped now."""
        if self._tlog is None:
            return
        stamped = struct.pack(">Q", int(self._wall_clock() * 1e6)) + raw
        tlog = self._tlog
        try:
            written = tlog.stream.write(stamped)
            if written != len(stamped):
                raise OSError(28, "no space left on device")
        except OSError as error:
            self._report(f"telemetry is not being kept: {error.strerror or error}")
            # Half a frame would spoil what follows it.
            with contextlib.suppress(OSError):
                tlog.stream.truncate(tlog.size)
                tlog.stream.seek(tlog.size)
            return
        tlog.size += len(stamped)
        self._tlog_frames += 1
        self._syncing.written(tlog.stream)

    def finish(self, streams: tuple[StreamResult, ...], *, on_card: bool = False) -> RecordingSummary:
        """Close the files; `streams` is what the receiver of blocks knows about each. With `on_card` none was asked
        for: the log stays on the vehicle."""
        logs = []
        known = {stream.file: stream for stream in streams}
        for file, log in sorted(self._logs.items()):
            stream = known.get(file, StreamResult(file=file, blocks=0, expected=0, missing=(), duplicates=0))
            logs.append(
                RecordedLog(
                    path=log.path,
                    blocks=stream.blocks,
                    expected=stream.expected,
                    missing=stream.missing,
                    duplicates=stream.duplicates,
                    end=stream.end,
                    in_two_versions=stream.in_two_versions,
                    impossible=stream.impossible,
                )
            )
        self._syncing.close()
        for growing in [*self._logs.values(), *([self._tlog] if self._tlog else [])]:
            self._end(growing)
        problems = list(self._problems)
        if not logs and not on_card:
            problems.append(f"no block of the log came: {NO_LOG}")
        problems += [problem for one in logs for problem in one.problems]
        if len(logs) > 1:
            problems.append(f"the vehicle began a new log {len(logs) - 1} time(s) while it was recorded")
        return RecordingSummary(
            directory=self.directory,
            logs=tuple(logs),
            tlog=self._tlog.path if self._tlog else None,
            tlog_frames=self._tlog_frames,
            how=ON_CARD if on_card else HOW,
            problems=tuple(problems),
        )

    def _report(self, problem: str) -> None:
        self.problem = problem
        if problem not in self._problems:
            self._problems.append(problem)

    def _new_file(self, suffix: str) -> _Growing:
        number = 1
        while True:
            name = f"{self._stem}{suffix}" if number == 1 else f"{self._stem}-{number}{suffix}"
            path = self.directory / name
            try:
                made = _Growing(path, FileIO(path, "x"))
                sync_folder(self.directory)
                return made
            except FileExistsError:
                number += 1
