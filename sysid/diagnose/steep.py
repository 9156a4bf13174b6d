"""Slow gusts: steep within a window of the noise's spectrum, and known by few frequencies.

What turns slowly with the commands, as a drift of the hover does, shows at the lowest frequencies alone. A window of
the noise's spectrum is wide there: gusts are louder in its lowest part than it says, and how loud is known by a handful
of draws. So what an entry explains is held against noise that is as loud as it is there, and as badly known.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from sysid.data.instrument import Causes
from sysid.diagnose.evidence import Stepped
from sysid.diagnose.shown import AROUND, STEEP_BELOW_HZ, louder_by
from sysid.fit.bursts import as_known
from sysid.fit.noise import WINDOW_HZ
from sysid.fit.whitening import Whitening
from sysid.model.structure import FloatArray


@dataclass(frozen=True, eq=False)
class Steep:
    """White rows' noise, as loud as it is, in cells of frequency in which it is known by as many draws as there are."""

    power: FloatArray
    """(N,), 1 where the metric says it;"""
    cell: NDArray[np.intp]
    """(N,), number of the cell that each value is in;"""
    values: FloatArray
    """(cells,), how many there are in each."""

    def gram(self, rows: FloatArray) -> FloatArray:
        """The covariance of inner products of rows (c, N) with such noise, (c, c)."""
        return (rows * self.power) @ rows.T

    def surely(self, chi_squared: float, degrees: int, rows: FloatArray) -> float:
        """The chi squared that noise of known power would exceed as often as noise that is known so badly does this
        one, along rows (c, N)."""
        size = np.maximum(np.einsum("ij,ij->i", rows, rows), 1e-300)
        met = self.power * np.einsum("ij,i->j", rows**2, 1 / size)
        each = np.bincount(self.cell, met, minlength=self.values.size)
        spread = float(np.sum(each**2 / np.maximum(self.values, 1.0)))
        return as_known(chi_squared, degrees, float(np.sum(each)) ** 2 / max(spread, 1e-300))


@lru_cache(maxsize=4)
def steep(stepped: Stepped, whitening: Whitening, by: Causes) -> Steep:
    """Of what a candidate leaves, in the white rows of a metric."""
    frequency = np.concatenate([group.frequency_hz for group in whitening.stacks])
    lowest = float(np.min(frequency))
    slow = np.floor(np.log(frequency / lowest) / np.log(AROUND))
    window = np.ceil(np.log(STEEP_BELOW_HZ / lowest) / np.log(AROUND)) + np.floor(frequency / WINDOW_HZ)
    _, cell = np.unique(np.where(frequency < STEEP_BELOW_HZ, slow, window), return_inverse=True)
    outputs = len(whitening.stacks[0].Y)

    def row(values: FloatArray) -> FloatArray:
        return whitening.row(np.tile(values * (1 + 1j), (outputs, 1)))

    cells = row(cell.astype(float)).astype(np.intp)
    power = row(louder_by(whitening, stepped.residual, by) ** 2)
    return Steep(power, cells, np.bincount(cells).astype(float))
