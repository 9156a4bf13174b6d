"""On which axes runs are fitted: those that were named, or the one that alone was excited."""

from __future__ import annotations

from collections.abc import Sequence

from gcs.errors import TippathError
from sysid.data.dataset import Dataset
from sysid.data.record import Record
from sysid.fit.axes import excited_alone
from sysid.model.base import Base
from sysid.model.compose import compose


def of_axes(records: Sequence[Record], base: Base) -> tuple[list[Record], list[str]]:
    """Runs that swept an axis of this base, or none that is known; and a note on the others, if there are any.

    The elevator's count to pitch. Raises TippathError where there are only others.
    """
    own = {None, *base.axes, *(("elevator",) if "pitch" in base.axes else ())}
    kept = [record for record in records if record.axis in own]
    others = [f"{record.id} ({record.axis})" for record in records if record.axis not in own]
    if records and not kept:
        raise TippathError(f"no run swept {' or '.join(base.axes)}, which {base.label} is of: {', '.join(others)}")
    return kept, [f"left out, of an axis that {base.label} is not of: {', '.join(others)}"] if others else []


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
