"""Frequency responses as runs: one for each command that they are answers to."""

from __future__ import annotations

from collections.abc import Sequence

from gcs.logs.runs.run import Run, unread
from sysid.data.of_response import Response, record_of
from sysid.data.record import Record, RecordError


def runs_of(responses: Sequence[Response], name: str, path: str, sha256: str) -> tuple[Run, ...]:
    """`name` is that of the file. A command whose responses are too few points is a run that is not usable."""
    runs = []
    for number, command in enumerate(dict.fromkeys(one.command for one in responses), 1):
        id = f"{name}#{number}"
        own = [one for one in responses if one.command == command]
        try:
            runs.append(of_response(record_of(own, id, path, sha256)))
        except RecordError as error:
            runs.append(unread(id, path, "response", str(error)))
    return tuple(runs)


def of_response(record: Record) -> Run:
    """The run of a response's record. Its samples are made up: nothing of their health is worth a look."""
    return Run(
        record=record,
        id=record.id,
        path=record.path,
        maneuver=record.maneuver,
        axis=record.axis,
        start_s=0.0,
        duration_s=record.duration_s,
        rate_hz=1 / float(record.t[1]),
        gaps=(),
        usable=True,
        reasons=(),
        notes=record.notes,
        rate_source=record.rate_source,
        swept_band_hz=record.swept_band_hz,
    )
