"""When a log was flown: by its own satellites' time, by flight.json beside it, by its name, or by the file's time."""

from __future__ import annotations

import re
from collections.abc import Iterator
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Literal

import numpy as np

from gcs import documents
from gcs.errors import TippathError
from gcs.flight.folder import flight_of
from gcs.logs.formats.dataflash_table import DataFlashTables
from gcs.logs.formats.tables import Log
from gcs.logs.formats.ulog_table import UlogTables

ToldBy = Literal["campaign.toml", "satellites", "flight.json", "name", "file"]
GPS_EPOCH = datetime(1980, 1, 6, tzinfo=UTC)
LEAP_S = 18.0
"""Satellites' time is ahead of UTC by so much since 2017."""
FIRST, LAST = datetime(2005, 1, 1, tzinfo=UTC), datetime(2100, 1, 1, tzinfo=UTC)
"""No log is from before or after these: a clock that was never set says 1980 or 1970."""
_NAMED = re.compile(r"(20\d\d)-?([01]\d)-?([0-3]\d)(?:[T_ -]?([0-2]\d)[-:_]?([0-5]\d))?")


class When(documents.Open, frozen=True, kw_only=True):
    """A time, and what tells it."""

    utc: str
    """ISO 8601, seconds."""
    told_by: ToldBy

    @classmethod
    def told(cls, time: datetime, by: ToldBy) -> When:
        """To the second."""
        return cls(utc=time.astimezone(UTC).isoformat(timespec="seconds"), told_by=by)

    @property
    def time(self) -> datetime:
        return datetime.fromisoformat(self.utc)

    @property
    def day(self) -> int:
        """Days since 1970."""
        return int(self.time.timestamp() // 86400)


def by_satellites(log: Log | None) -> When | None:
    """When a log was flown, by its own receivers; None where they said nothing."""
    found = _by_satellites(log)
    return None if found is None else When.told(found, "satellites")


def by_place(path: Path) -> When | None:
    """When a log was flown by what stands beside it, its name, or the file's time; None where there is no file."""
    found: tuple[tuple[ToldBy, Iterator[datetime]], ...] = (
        ("flight.json", _by_folder(path)),
        ("name", _by_name(path)),
        ("file", _by_file(path)),
    )
    for told_by, times in found:
        for time in times:
            if FIRST < time < LAST:
                return When.told(time, told_by)
    return None


def _by_satellites(log: Log | None) -> datetime | None:
    """The time that most of a log's receivers' words come to at its begin."""
    if isinstance(log, DataFlashTables) and log.has("GPS.GMS") and log.has("GPS.GWk"):
        week, ms = log.series("GPS.GWk"), log.series("GPS.GMS")
        good = week.values > 0
        if good.any():
            s = float(np.median(week.values[good] * 604800.0 + ms.values[good] / 1000.0))
            return _valid(GPS_EPOCH + timedelta(seconds=s - LEAP_S))
    if isinstance(log, UlogTables):
        for name in ("vehicle_gps_position.time_utc_usec", "sensor_gps.time_utc_usec"):
            if log.has(name):
                values = log.series(name).values
                if (values > 0).any():
                    return _valid(datetime.fromtimestamp(float(np.median(values[values > 0])) * 1e-6, UTC))
    return None


def _valid(time: datetime) -> datetime | None:
    return time if FIRST < time < LAST else None


def _by_folder(path: Path) -> Iterator[datetime]:
    try:
        about = flight_of(path).read()
    except TippathError:
        return
    for run in about.get("runs", ()):
        started = run.get("started") if isinstance(run, dict) else None
        if isinstance(started, str):
            try:
                time = datetime.fromisoformat(started)
            except ValueError:
                continue
            yield time if time.tzinfo is not None else time.replace(tzinfo=UTC)


def _by_name(path: Path) -> Iterator[datetime]:
    for word in (path.name, path.parent.name):
        named = _NAMED.search(word)
        if named is not None:
            year, month, day, hour, minute = (int(one or 0) for one in named.groups())
            try:
                yield datetime(year, month, day, min(hour, 23), minute, tzinfo=UTC)
            except ValueError:
                continue


def _by_file(path: Path) -> Iterator[datetime]:
    try:
        yield datetime.fromtimestamp(path.stat().st_mtime, UTC)
    except OSError:
        return
