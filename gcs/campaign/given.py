"""`campaign.toml`: what logs do not say of themselves, which vehicle they are of, how it was set up, when it flew.

[[logs]]
files = ["heli-a/**"]           # names and patterns from this file's folder; ** any folders
vehicle = "heli A"
[[logs]]
files = ["heli-a/flight-00[3-9]*"]
configuration = "new blades"    # later tables add to, and go before, earlier ones
date = 2026-05-03
"""

from __future__ import annotations

import os
import re
from collections.abc import Iterable
from dataclasses import dataclass, field
from datetime import UTC, date, datetime
from fnmatch import translate
from pathlib import Path
from typing import Annotated

from msgspec import Meta

from gcs import documents

NAME = "campaign.toml"
_Name = Annotated[str, Meta(min_length=1, max_length=60, pattern=r"^[^/\n\r\t]+$")]


class LogsTable(documents.Strict, frozen=True, kw_only=True):
    """What is known of some logs."""

    files: Annotated[tuple[Annotated[str, Meta(min_length=1, max_length=400)], ...], Meta(min_length=1)]
    vehicle: _Name | None = None
    configuration: _Name | None = None
    date: date | None = None


class CampaignDocument(documents.Strict, frozen=True, kw_only=True):
    """All of it."""

    logs: tuple[LogsTable, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class About:
    """What is given of one log; None where nothing is."""

    vehicle: str | None = None
    configuration: str | None = None
    time: datetime | None = None


@dataclass(frozen=True)
class Given:
    """What a campaign.toml says; of none, nothing."""

    folder: Path = field(default_factory=Path)
    tables: tuple[LogsTable, ...] = ()

    def about(self, path: Path) -> About:
        """Of one log, or of the flight folder that it lies in."""
        vehicle, configuration, time = None, None, None
        for table in self.tables:
            if any(self._names(pattern, path) for pattern in table.files):
                vehicle = table.vehicle or vehicle
                configuration = table.configuration or configuration
                time = time if table.date is None else _time(table.date)
        return About(vehicle=vehicle, configuration=configuration, time=time)

    def unmatched(self, paths: Iterable[Path]) -> list[str]:
        """Patterns that name none of these logs: misspelt, as a rule."""
        paths = list(paths)
        patterns = dict.fromkeys(pattern for table in self.tables for pattern in table.files)
        return [one for one in patterns if not any(self._names(one, path) for path in paths)]

    def _names(self, pattern: str, path: Path) -> bool:
        try:
            words = Path(os.path.relpath(path, self.folder)).as_posix()
        except ValueError:  # on another drive
            words = path.as_posix()
        pattern = pattern.replace("\\", "/").removeprefix("./").rstrip("/")
        return any(re.match(translate(one), words) is not None for one in (pattern, f"{pattern}/*"))


def load(path: Path) -> Given:
    """Raises DocumentError."""
    document = documents.read_toml(path, CampaignDocument, what="campaign.toml")
    return Given(path.parent, document.logs)


def _time(given: date) -> datetime:
    """The day's noon, UTC."""
    return datetime(given.year, given.month, given.day, 12, tzinfo=UTC)
