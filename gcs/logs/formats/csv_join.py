"""Several CSVs of one flight as one log, each on its own clock: a file for each topic, as converters write them.

A column is named as in its file where no other file has one of that name, and always as `FILE.column`, FILE without its
ending and without what all the names begin with. Nothing is merged here: a profile takes its channels from series on
different clocks as from any log (`gcs.logs.profile.mapping`).
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path

from gcs.errors import TippathError
from gcs.logs.formats.csv_table import CsvTable
from gcs.logs.formats.tables import SavedTable, Series


def labels(paths: Sequence[Path]) -> list[str]:
    """What the files are called in sources, identifiers all. Raises TippathError where two would be called the same."""
    pieces = [path.stem.split("_") for path in paths]
    most = min(map(len, pieces)) - 1
    same = next((at for at in range(most) if len({each[at] for each in pieces}) > 1), most)
    names = [re.sub(r"^(?=\d)", "_", re.sub(r"\W", "_", "_".join(each[same:]))) for each in pieces]
    twice = [str(path) for path, name in zip(paths, names, strict=True) if names.count(name) > 1]
    if twice:
        raise TippathError(f"--join: {' and '.join(twice)} would be called the same in a profile; rename one")
    return names


class JoinedCsv(SavedTable):
    """One boot, of which each file tells a part; a `gcs.logs.formats.tables.Log`."""

    kind = "csv"

    def __init__(self, tables: Mapping[str, CsvTable], time_column: str) -> None:
        """tables: label -> the table. Raises TippathError where no time lies in all of them."""
        first = next(iter(tables.values()))
        self.path = first.path
        self.dropped: dict[str, int] = {}
        self._tables = tables
        counts = Counter(name for table in tables.values() for name in table.names)
        self._plain = {
            name: label
            for label, table in tables.items()
            for name in table.names
            if counts[name] == 1 and name != time_column
        }
        spans = {label: table.span_s for label, table in tables.items()}
        if max(start for start, _ in spans.values()) >= min(stop for _, stop in spans.values()):
            listed = ", ".join(f"{label} {start:.3f} to {stop:.3f} s" for label, (start, stop) in spans.items())
            raise TippathError(
                f"--join: no time lies in all of them ({listed}): they must be of one flight and one clock, in "
                "one unit of time"
            )

    def _place(self, key: str) -> tuple[str, str] | None:
        """Label and column of a key."""
        if key in self._plain:
            return self._plain[key], key
        label, _, column = key.partition(".")
        return (label, column) if label in self._tables else None

    def has(self, key: str) -> bool:
        place = self._place(key)
        return place is not None and self._tables[place[0]].has(place[1])

    def series(self, key: str) -> Series:
        place = self._place(key)
        if place is None:
            raise KeyError(key)
        found = self._tables[place[0]].series(place[1])
        return Series(found.t, found.values, f"{place[0]}:{found.clock}")

    def fields(self) -> tuple[str, ...]:
        return tuple(
            name if self._plain.get(name) == label else f"{label}.{name}"
            for label, table in self._tables.items()
            for name in table.fields()
        )

    @property
    def sampled_s(self) -> float:
        spans = [table.span_s for table in self._tables.values()]
        return min(stop for _, stop in spans) - max(start for start, _ in spans)
