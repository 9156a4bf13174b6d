"""The table of real logs is true: each is read again, and answered as `docs/logs.md` says."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

import pytest

from gcs.cli.listing import table
from gcs.errors import TippathError
from gcs.logs import Ingest, ingest

PAGE = Path(__file__).resolve().parents[2] / "docs" / "logs.md"
NO_LOGS = ("README.md",)


@dataclass(frozen=True)
class Row:
    """A line of the table."""

    log: str
    run: str
    maneuver: str
    hz: str
    answer: str
    words: str


def rows() -> dict[str, list[Row]]:
    """Log -> its lines."""
    found: dict[str, list[Row]] = {}
    for line in PAGE.read_text(encoding="utf-8").splitlines():
        cells = [cell.strip() for cell in line.strip("|").split("|")]
        if re.match(r"\|\s*\w+/", line):
            row = Row(*cells)
            found.setdefault(row.log, []).append(row)
    return found


def told(found: Ingest) -> list[tuple[str, str, str, str]]:
    return [
        (
            "#" + run.id.rpartition("#")[2],
            " ".join(word for word in (run.maneuver, run.axis) if word),
            "" if run.rate_hz is None else f"{run.rate_hz:.0f}",
            "usable" if run.usable else "not usable",
        )
        for run in found.runs
    ]


@pytest.mark.parametrize("log", rows())
def test_a_real_log_is_answered_as_the_table_says(log: str, shared_data: Path) -> None:
    path, lines = shared_data / log, rows()[log]
    if not path.exists():
        pytest.skip(f"NOT CHECKED: {path} is absent")
    if lines[0].answer == "not read":
        with pytest.raises(TippathError, match=re.escape(lines[0].words)):
            ingest([path])
        return
    found = ingest([path])
    assert told(found) == [(row.run, row.maneuver, row.hz, row.answer) for row in lines]
    printed = "\n".join(table(found))
    assert [row.words for row in lines if row.words not in printed] == []


def test_every_real_log_has_a_line(shared_data: Path) -> None:
    logs = {f"{path.parent.name}/{path.name}" for path in shared_data.glob("*/*") if path.is_file()}
    known = {log for log in logs if not log.endswith(NO_LOGS)}
    assert known <= set(rows()), "a log without a line in docs/logs.md"
