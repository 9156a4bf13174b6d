"""A flight that is opened again: its rungs with what was compared, asked and added in earlier sessions.

What its folder tells is taken where it is of these fits and these bytes of the logs; a comparison is made anew, which
takes no longer than reading one would, and has what is drawn.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

from gcs.analysis.answer import kept_answer
from gcs.analysis.kept_addition import kept_addition
from gcs.analysis.text.addition import addition_blocks
from gcs.analysis.text.comparison import compare_blocks
from gcs.desk.saved import Kept
from gcs.desk.state import Nrmse, Rung
from gcs.errors import TippathError
from sysid.compare.compare import compare
from sysid.data.dataset import prepared
from sysid.data.record import Record
from sysid.errors import SysidError
from sysid.fit.result import Fit

Flown = tuple[list[Record], list[Record], list[Record]]
"""Runs that were fitted, runs that judge, and quiet hover."""


def rungs(
    kept: Sequence[Kept], folder: Path, flown_by: Callable[[Fit], Flown], say: Callable[[str], None]
) -> list[Rung]:
    """The rungs of a ladder, bottom first, without names."""
    found: list[Rung] = []
    for number, one in enumerate(kept):
        say(f"comparing {one.path.name}")
        found.append(_rung(one, kept[number - 1] if number else None, folder, flown_by))
    return found


def _rung(one: Kept, below: Kept | None, folder: Path, flown_by: Callable[[Fit], Flown]) -> Rung:
    answer = kept_answer(folder, one.fit)
    floor: Nrmse | None = None if answer is None else answer.noise_floor_percent
    bare = Rung(name="", effect=None, fit=one.fit, path=one.path, answer=answer, noise_floor_percent=floor)
    try:
        records, _, quiet = flown_by(one.fit)
        runs = prepared(records, one.fit.band_hz)
        comparison = compare(one.fit.model, runs, one.fit.band_hz, quiet)
    except (TippathError, SysidError):
        return bare  # its runs are not these any more: what can be asked of it says so
    addition = None if below is None else kept_addition(one.path, below.fit, one.fit, runs)
    if floor is None:
        floor = comparison.noise_floor_percent if addition is None else addition.noise_floor_percent
    return Rung(
        name="",
        effect=None,
        fit=one.fit,
        path=one.path,
        noise_floor_percent=floor,
        addition=addition,
        addition_text=() if addition is None else addition_blocks(addition, written=str(one.path)),
        comparison=comparison,
        comparison_text=compare_blocks(comparison, one.fit),
        answer=answer,
    )
