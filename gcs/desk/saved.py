"""Results saved beside a log in earlier sessions: the fits that were kept, and the ladder they make.

The newest fit says which runs were used; of the fits of just these runs, those that it grew from are the ladder. A fit
that uses a user's effect file is not opened by itself, because that file is code.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from gcs.analysis.fits import PAIR, on_cd
from gcs.analysis.rungs import lineage, used_by
from gcs.logs.words import printable
from sysid.data.record import RATES, Record
from sysid.errors import SysidError
from sysid.fit.result import FORMAT, Fit
from sysid.model.paper import CD, TPP

MOST_BYTES = 4 << 20
MOST_FILES = 500


@dataclass(frozen=True, eq=False)
class Kept:
    """A fit that was kept."""

    path: Path
    fit: Fit
    time_ns: int


@dataclass(frozen=True, eq=False)
class SavedResults:
    """What is there to go on with."""

    ladder: tuple[Kept, ...]
    """Bottom first; empty where nothing was kept."""
    tpp: Kept | None
    """Fitted to the ladder's runs, without effects but those that the ladder began with,"""
    cd: Kept | None
    """and its neighbour."""
    unread: tuple[str, ...]


NOTHING = SavedResults((), None, None, ())


def look(folder: Path, records: Sequence[Record]) -> SavedResults:
    """The fits in a folder that were made from these records."""
    known = {(Path(one.path).resolve(), one.id): one.sha256 for one in records}
    found: list[Kept] = []
    unread: list[str] = []
    try:
        files = sorted(folder.glob("*.json"))[:MOST_FILES]
    except OSError:
        return NOTHING
    for path in files:
        document = _document(path)
        if document is None:
            continue
        try:
            fit = Fit.from_json(document, path.parent)
            time_ns = path.stat().st_mtime_ns
        except (SysidError, OSError, ValueError, ArithmeticError) as error:
            unread.append(printable(f"{path.name} was not opened: {error}"))
            continue
        if fit.model.structure.base not in PAIR or fit.model.structure.outputs != RATES:
            measured = ", ".join(fit.model.structure.outputs)
            unread.append(
                printable(f"{path.name} was not opened: it is {fit.model.structure.title} of {measured}, not TPP or CD")
            )
            continue
        used = [*fit.records, *fit.validation]
        if any((Path(one.path).resolve(), one.id) in known for one in used):
            if all(known.get((Path(one.path).resolve(), one.id)) == one.sha256 for one in used):
                found.append(Kept(path, fit, time_ns))
            else:
                unread.append(printable(f"{path.name} was not opened: it was made from other runs too, or other bytes"))
    if not found:
        return SavedResults((), None, None, tuple(unread))
    newest = max(found, key=lambda one: one.time_ns)
    group = [one for one in found if used_by(one.fit) == used_by(newest.fit)]
    group.sort(key=lambda one: one.time_ns)
    tip = newest
    if _bare_cd(tip):  # it is written beside the TPP, which the ladder goes on from
        tip = next((one for one in reversed(group) if not _bare_cd(one)), tip)
    ladder = _below(tip, group)
    tpp, cd = _pair(ladder[0], group)
    return SavedResults(tuple(ladder), tpp, cd, tuple(unread))


def windowed(folder: Path) -> list[str]:
    """Ids of the runs that the newest fit in a folder was made of, those with a window."""
    found: list[tuple[int, list[str]]] = []
    try:
        for path in sorted(folder.glob("*.json"))[:MOST_FILES]:
            document = _document(path)
            if document is not None:
                used = [*(document.get("records") or ()), *(document.get("validation_records") or ())]
                ids = [one.get("id") for one in used if isinstance(one, dict)]
                found.append((path.stat().st_mtime_ns, [id for id in ids if isinstance(id, str) and "@" in id]))
    except (OSError, TypeError):
        return []
    return max(found)[1] if found else []


def _document(path: Path) -> Any:
    """What a file holds that says it is a fit; None of any other."""
    try:
        if path.stat().st_size > MOST_BYTES:
            return None
        document = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError):
        return None
    return document if isinstance(document, dict) and document.get("format") == FORMAT else None


def _bare_cd(one: Kept) -> bool:
    structure = one.fit.model.structure
    return structure.base == CD.base and all(effect.id == "elevator" for effect in structure.composed)


def _below(tip: Kept, group: Sequence[Kept]) -> list[Kept]:
    """The kept fits that this one grew from, bottom first, and itself."""
    rungs = lineage(tip.fit)
    newest: dict[int, Kept] = {}
    for one in group:  # oldest first
        own = lineage(one.fit)
        if len(own) <= len(rungs) and own == rungs[: len(own)]:
            newest[len(own)] = one
    newest[len(rungs)] = tip
    return [newest[count] for count in sorted(newest)]


def _pair(bottom: Kept, group: Sequence[Kept]) -> tuple[Kept | None, Kept | None]:
    """TPP and CD of the same runs: the bottom and its newest neighbour of the other base."""
    own = bottom.fit.model.structure
    for other in reversed(group):
        structure = other.fit.model.structure
        if structure.base == own.base:
            continue
        pair = (bottom, other) if own.base == TPP.base else (other, bottom)
        if sorted(on_cd(pair[0].fit.model.structure.effects)) == sorted(pair[1].fit.model.structure.effects):
            return pair
    return None, None
