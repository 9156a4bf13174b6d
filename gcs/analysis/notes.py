"""What the readers of the logs want the user to know of the runs."""

from __future__ import annotations

from collections.abc import Iterable

from sysid.data.record import Record


def note_lines(records: Iterable[Record]) -> tuple[str, ...]:
    """Each note once, with the runs that it is about."""
    about: dict[str, list[str]] = {}
    for record in records:
        for note in record.notes:
            about.setdefault(note, []).append(record.id)
    return tuple(f"note: {note}  ({', '.join(ids)})" for note, ids in about.items())
