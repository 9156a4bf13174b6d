"""White rows where the excitation shows: what tells models apart, and how loud slow noise is beside it."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np

from sysid.data.instrument import Causes
from sysid.fit.noise import Caused
from sysid.fit.whitening import Whitening
from sysid.model.structure import FloatArray

STEEP_BELOW_HZ = 1.5
"""Three windows of the noise's spectrum: below, what wanders slowly tells models apart by chance, and it is asked how
loud the noise is among frequencies within"""
AROUND = 1.5
"""times each."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Shown:
    """White rows, divided into what lies where the excitation shows, and the rest."""

    by: Causes
    whitening: Whitening

    @cached_property
    def span(self) -> Caused:
        return Caused.by(self.by, self.whitening.stacks)

    @cached_property
    def lowest(self) -> Caused:
        """The same of the lowest frequencies alone."""
        return Caused.by(self.by, self.whitening.stacks, STEEP_BELOW_HZ)

    def told(self, rows: FloatArray) -> FloatArray:
        """Rows (r, N) without what lies beside that at the lowest frequencies: gusts are slow there, and move models
        far apart in a loop."""
        return self.whitening.less(rows, self.lowest.order, self.lowest.beyond_there)

    def caused(self, row: FloatArray) -> FloatArray:
        """Of a row (N,) what lies there."""
        return self.span.of(self.whitening.bins(row))

    def beyond(self, row: FloatArray) -> FloatArray:
        """Of a row (N,) what lies beside that, but for the lowest frequencies."""
        rest = self.span.beyond(self.whitening.bins(row))
        rest[:, self.lowest.order] = 0
        return self.whitening.row(rest)


@lru_cache(maxsize=8)
def shown_by(whitening: Whitening, by: Causes) -> Shown:
    return Shown(by=by, whitening=whitening)


def as_loud_as_it_is(metric: Whitening, left: FloatArray, by: Causes) -> Whitening:
    """The metric with its lowest frequencies as loud as what a model leaves (N,) there beside the excitation: slow
    gusts are steep within a window."""
    return metric.louder(louder_by(metric, left, by))


def louder_by(metric: Whitening, left: FloatArray, by: Causes) -> FloatArray:
    """By how much, (bins,), in standard deviations."""
    frequency = np.concatenate([group.frequency_hz for group in metric.stacks])
    low = np.flatnonzero(frequency < STEEP_BELOW_HZ)
    near = np.abs(np.log(frequency[low] / frequency[low][:, None])) <= np.log(AROUND)
    count, white = np.sum(near, axis=1), metric.bins(left)
    power = near @ shown_by(metric, by).span.power_beyond(white)[low] / (2 * len(white) * count)
    times = np.ones(frequency.size)
    times[low] = np.sqrt(np.maximum(1.0, power * (1 - 1 / np.sqrt(count * len(white)))))
    return times
