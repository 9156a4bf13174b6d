"""The rungs of a fit's ladder that lie beside it: the fits that it grew from, and what their diagnoses said.

All are known by what they hold: a fit by its lineage and its runs, a diagnosis by the digest of the fit that was asked.
"""

from __future__ import annotations

import shlex
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from gcs.analysis.standing import MOST_BYTES, MOST_FILES
from gcs.errors import UsageError
from gcs.logs.opening import suffixes
from gcs.logs.words import printable
from sysid.document import parsed
from sysid.errors import SysidError
from sysid.fit.result import FORMAT, Fit, RecordUsed


@dataclass(frozen=True, eq=False, slots=True)
class KeptFit:
    """A fit and its file."""

    path: Path
    fit: Fit


def rungs_below(path: Path, fit: Fit, given: Sequence[KeptFit], named: Sequence[str] = ()) -> list[KeptFit]:
    """The fits that this one grew from, bottom first, and itself: of those given, else of the files beside it.

    `named`: files of the user's effects, whose code may run. A rung whose fit is nowhere is left out.
    """
    steps = len(fit.lineage)
    found = {steps: KeptFit(path, fit)}
    known = {one.path.resolve() for one in (KeptFit(path, fit), *given)}
    for one in (*given, *(() if steps < 2 else _beside(path.parent, known, named))):
        count = len(one.fit.lineage)
        if count < steps and lineage(one.fit) == lineage(fit)[:count] and used_by(one.fit) == used_by(fit):
            found.setdefault(count, one)
    return [found[count] for count in sorted(found)]


def load_fit(path: Path, named: Sequence[str] = ()) -> Fit:
    """As `Fit.load`; a folder or a log in its place is told what to type. Raises UsageError for these."""
    what = "a folder" if path.is_dir() else "a log" if path.is_file() and path.suffix.lower() in suffixes() else None
    if what is None:
        return Fit.load(path, named)
    try:
        fits = [one.name for one in sorted(path.glob("*.json"))[:MOST_FILES] if _says(one, FORMAT)]
    except OSError:
        fits = []
    if fits:
        raise UsageError(f"{path} is {what}, no fit; name one that is in it: {', '.join(map(printable, fits))}")
    word = printable(shlex.quote(str(path)))
    raise UsageError(
        f"{path} is {what}, no fit: `tippath fit {word} --model tpp -o tpp.json` makes one (a multirotor's with "
        "--model multirotor); then the same with tpp.json"
    )


def _beside(folder: Path, known: Collection[Path], named: Sequence[str]) -> list[KeptFit]:
    """The other fits of a folder, the newest first."""
    found: list[tuple[int, KeptFit]] = []
    try:
        for path in sorted(folder.glob("*.json"))[:MOST_FILES]:
            if path.resolve() not in known and path.stat().st_size <= MOST_BYTES and _says(path, FORMAT):
                try:
                    found.append((path.stat().st_mtime_ns, KeptFit(path, Fit.load(path, named))))
                except SysidError:
                    continue  # damaged, or of an effect whose code nobody named
    except OSError:
        return []
    return [one for _, one in sorted(found, key=lambda each: -each[0])]


def _says(path: Path, what: str) -> bool:
    try:
        document = parsed(path)
    except (OSError, ValueError):
        return False
    return isinstance(document, dict) and document.get("format") == what


def lineage(fit: Fit) -> list[Any]:
    """What each rung had, and how well it did: two fits of one ladder begin alike."""
    return [(rung.effects, dict(rung.nrmse_percent)) for rung in fit.lineage]


def used_by(fit: Fit) -> Any:
    """The runs of a fit, by what is in them, and how they were fitted: hashable, equal for the rungs of one ladder."""

    def used(which: Sequence[RecordUsed]) -> frozenset[tuple[str, str, int]]:
        return frozenset((one.id, one.sha256, one.samples) for one in which)

    return used(fit.records), used(fit.validation), fit.band_hz, fit.fixed
