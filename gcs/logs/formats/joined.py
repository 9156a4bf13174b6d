"""What came of reading two or more logs of one flight together."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any


@dataclass(frozen=True, slots=True, kw_only=True)
class JoinedFile:
    """One of the logs that were read together."""

    path: str
    sha256: str
    samples: int
    """Of the kinds of message that are in all of them."""
    filled: int
    """That none of those before it has."""
    damage: str = ""
    """What of it could not be read, in words; empty where all could."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Joined:
    """Logs of one flight as one."""

    files: tuple[JoinedFile, ...]
    """The streamed one first."""
    samples: int
    """Of all together, each once."""
    shared: int
    """Samples by which they were shown to be of one flight: equal to the last byte, and unlike those before them."""
    unlike: int
    """Samples that two of them tell differently; the later one's are taken."""
    missing: int
    """Samples that none has, by the rate of the others of their kind."""
    stretches: tuple[tuple[float, float], ...]
    """Where in each of them something may be missing, s of the vehicle's clock."""

    @property
    def complete(self) -> bool | None:
        """Whether between the first sample and the last nothing is missing; None where that is not shown."""
        return False if self.missing else None if self.stretches else True

    @property
    def words(self) -> str:
        """In one sentence: what each had, and what none has."""
        first, *others = self.files
        had = f"{first.samples:,} of {self.samples:,} samples in {_name(first)}"
        filled = ", ".join(f"{one.filled:,} more in {_name(one)}" for one in others)
        differ = f"; of {_samples(self.unlike)} told differently {_name(others[-1])}'s are taken" if self.unlike else ""
        return f"{had}, {filled}, {self._missing}{differ}"

    @property
    def _missing(self) -> str:
        seconds = sum(stop - start for start, stop in self.stretches)
        count = "1 stretch" if len(self.stretches) == 1 else f"{len(self.stretches)} stretches"
        match self.complete:
            case True:
                return "0 missing"
            case False:
                return f"about {self.missing:,} missing in all of them ({count}, {seconds:.2f} s)"
        return f"none seen missing, but not shown for {seconds:.2f} s"

    def to_json(self) -> dict[str, Any]:
        """As `tippath ingest --json` has it."""
        return {
            "files": [
                {
                    "path": one.path,
                    "sha256": one.sha256,
                    "samples": one.samples,
                    "filled": one.filled,
                    "damage": one.damage or None,
                }
                for one in self.files
            ],
            "samples": self.samples,
            "shared": self.shared,
            "unlike": self.unlike,
            "missing": self.missing,
            "stretches": [[round(start, 6), round(stop, 6)] for start, stop in self.stretches],
            "complete": self.complete,
        }


def _name(file: JoinedFile) -> str:
    return Path(file.path).name


def _samples(count: int) -> str:
    return "1 sample" if count == 1 else f"{count:,} samples"
