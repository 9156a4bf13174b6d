"""On which axes runs are fitted: those that were named, or the one that alone was excited."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from gcs.errors import TippathError
from sysid.data.dataset import Dataset
from sysid.data.record import RATES, Record
from sysid.fit.axes import excited_alone
from sysid.model.base import Base, bases, find_base
from sysid.model.compose import compose


def of_axes(records: Sequence[Record], base: Base) -> list[Record]:
    """Runs that swept an axis of this base, or none that is known; the first bears a note on others that there were.

    The elevator's count to pitch. Raises TippathError where there are only others.
    """
    own = {None, *base.axes, *(("elevator",) if "pitch" in base.axes else ())}
    kept = [record for record in records if record.axis in own]
    others = [f"{record.id} ({record.axis})" for record in records if record.axis not in own]
    if records and not kept:
        raise TippathError(f"no run swept {' or '.join(base.axes)}, which {base.label} is of: {', '.join(others)}")
    if others:
        note = f"left out, of an axis that {base.label} is not of: {', '.join(others)}"
        kept[0] = replace(kept[0], notes=(*kept[0].notes, note))
    return kept


def asked_of(records: Sequence[Record]) -> tuple[list[Record], tuple[str, ...], tuple[str, ...]]:
    """Runs whose responses are measured where nobody says which, with commands and outputs, empty for the usual ones.

    Roll's and pitch's; where all swept one axis beside these, that one's.
    """
    swept = {record.axis for record in records}
    for base in bases().values():
        if {*base.axes} == swept and len(swept) == 1 and not {*base.outputs} <= {*RATES}:
            return [*records], base.commands, base.outputs
    return of_axes(records, find_base("cd")), (), ()


def lone_axis(base: Base, fitted: Dataset) -> str | None:
    """The one axis that these runs excited, where it can be fitted alone; else None."""
    bare = compose(base)
    measured = all(name in fitted.common for name in (*bare.outputs, *bare.inputs))
    return excited_alone(bare, fitted.viewed(bare.inputs, bare.outputs).spectra) if measured else None


def alone_words(base: Base, axis: str) -> str:
    """That one axis is fitted alone though nobody asked for it."""
    return (
        f"note: only {axis} was excited: fitted alone, {axis} by its own command; "
        f"--axes {','.join(base.axes)} asks for all"
    )
