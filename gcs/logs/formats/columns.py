"""A log whose samples were all read at once: named columns, several of them on a clock."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gcs.logs.formats.tables import FloatArray, Series


@dataclass(frozen=True, eq=False)
class Column:
    """A field as it is stored; its values are scale * stored."""

    clock: str
    stored: NDArray[Any]
    """(n,)"""
    scale: float = 1.0


@dataclass(frozen=True, eq=False, kw_only=True)
class ColumnLog:
    """One boot; a `gcs.logs.formats.tables.Log`."""

    path: str
    kind: str
    clocks: Mapping[str, FloatArray]
    """Clock -> times in s, increasing, (n,)."""
    columns: Mapping[str, Column]
    said: Sequence[tuple[float, str]] = ()
    """Texts, made printable."""
    entered: Sequence[tuple[float, int]] = ()
    """Modes."""
    dropped: Mapping[str, int] = field(default_factory=dict)
    """Clock -> samples thrown out for an impossible time stamp."""

    def has(self, key: str) -> bool:
        return key in self.columns and self.clocks[self.columns[key].clock].size > 0

    def series(self, key: str) -> Series:
        column = self.columns[key]
        with np.errstate(all="ignore"):  # damage can be any number
            values = column.scale * column.stored.astype(np.float64)
        return Series(self.clocks[column.clock], values, column.clock)

    def fields(self) -> tuple[str, ...]:
        return tuple(key for key in self.columns if self.has(key))

    @property
    def sampled_s(self) -> float:
        return max((float(t[-1] - t[0]) for t in self.clocks.values() if t.size > 1), default=0.0)

    def texts(self) -> Sequence[tuple[float, str]]:
        return self.said

    def modes(self) -> Sequence[tuple[float, int]]:
        return self.entered

    def armed(self) -> Sequence[tuple[float, bool]]:
        return ()
