"""A streamed log and what was fetched of the same flight, opened as one."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

from gcs.errors import TippathError
from gcs.logs.flight_files import is_streamed
from gcs.logs.formats import dataflash
from gcs.logs.formats.dataflash import DataFlashLog
from gcs.logs.formats.dataflash_join import AnyLog, JoinedLog, join
from gcs.logs.formats.joined import Joined, JoinedFile
from gcs.logs.opening import Opened, dataflash_boots
from gcs.logs.profile.profiles import Profile


@dataclass(frozen=True, slots=True)
class _File:
    path: Path
    log: DataFlashLog
    streamed: bool


@dataclass
class _Joining:
    """One log's boots, and what comes to them."""

    boots: list[AnyLog]
    samples: dict[Path, int] = field(default_factory=dict)
    filled: dict[Path, int] = field(default_factory=dict)
    shared: int = 0
    adds: bool = False

    def take(self, file: _File, base: _File) -> str:
        """Join a file's boots to those that they are of; why none was, empty where one was."""
        problem, taken = "", False
        for other in file.log.boots:
            for k, boot in enumerate(self.boots):
                both = join(other, boot) if file.streamed else join(boot, other)
                if isinstance(both, str):
                    problem = max(problem, both, key=len)
                    continue
                self._count(both, boot, file, base)
                self.boots[k], taken = both, True
                break
        return "" if taken else problem

    def _count(self, both: JoinedLog, boot: AnyLog, new: _File, base: _File) -> None:
        ours, theirs = both.filled if new.streamed else both.filled[::-1]
        listed_first = new.streamed and not base.streamed
        counts = [(new.path, theirs, 0 if listed_first else ours)]
        if isinstance(boot, DataFlashLog):
            counts.append((base.path, ours, theirs if listed_first else 0))
        for path, others_alone, filled in counts:
            self.samples[path] = self.samples.get(path, 0) + both.samples - others_alone
            self.filled[path] = self.filled.get(path, 0) + filled
        self.shared += both.shared
        self.adds |= both.added[not new.streamed]


def open_joined(path: Path, beside: Sequence[Path], profile: Profile | None) -> Opened:
    """A DataFlash .BIN with what those beside it hold of the same flight. Raises TippathError where it is none."""
    base = _File(path, dataflash.read(path), is_streamed(path))
    joining = _Joining([*base.log.boots])
    joined_files: list[_File] = []
    apart: dict[str, str] = {}
    for other in beside:
        try:
            file = _File(other, dataflash.read(other), is_streamed(other))
            problem = joining.take(file, base)
        except TippathError as error:
            problem = str(error)
        if problem:
            apart[str(other)] = problem
        else:
            joined_files.append(file)
    boots, chosen, notes = dataflash_boots(joining.boots, path, profile)
    files = [base, *joined_files]
    if not base.streamed:
        files.sort(key=lambda file: not file.streamed)
    digests = {file.path: file.log.sha256() for file in files}
    joined = _joined(joining, files, digests) if joined_files else None
    all_of_them = hashlib.sha256("".join(digests.values()).encode()).hexdigest()
    return Opened(
        boots=boots,
        kind="dataflash",
        sha256=all_of_them if joining.adds else digests[path],
        profile=chosen,
        damage=base.log.damage,
        notes=notes,
        joined=joined,
        apart=apart,
    )


def _joined(joining: _Joining, files: Sequence[_File], digests: dict[Path, str]) -> Joined:
    logs = [boot for boot in joining.boots if isinstance(boot, JoinedLog)]
    return Joined(
        files=tuple(
            JoinedFile(
                path=str(file.path),
                sha256=digests[file.path],
                samples=joining.samples[file.path],
                filled=joining.filled[file.path],
                damage=file.log.damage.describe(),
            )
            for file in files
        ),
        samples=sum(log.samples for log in logs),
        shared=joining.shared,
        unlike=sum(log.unlike for log in logs),
        missing=sum(log.missing for log in logs),
        stretches=tuple((start, stop) for log in logs for start, stop in log.lost.inside.tolist()),
    )
