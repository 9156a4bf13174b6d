"""Rates that stand at their largest value: clipped by the gyro, or by whoever filters it."""

from __future__ import annotations

import math

import numpy as np

from gcs.logs.formats.tables import FloatArray, stretches
from sysid.data.record import Record

CLIPPED_SAMPLES = 5
FULL_SCALES = tuple(math.radians(scale) for scale in (125, 250, 500, 1000, 2000, 4000))
"""What gyros are set to, rad/s."""
FULL_SCALE_WITHIN = 0.02


def clipped_words(record: Record, name: str, times: int) -> str:
    """That a rate was held at its largest value so often, and what may have clipped it."""
    values = np.abs(record.channels[name])
    largest = float(values.max())
    when = float(record.t[int(np.argmax(values == largest))])
    scale = next((full for full in FULL_SCALES if abs(largest - full) <= FULL_SCALE_WITHIN * full), None)
    held = (
        f"{name} stands at {'its largest value' if scale is None else 'full scale'}, {largest:.2f} rad/s, {times} times"
    )
    if scale is None:
        return f"{held}, first at {when:.2f} s of the log: clipped?"
    return f"{held}, first at {when:.2f} s of the log: clipped by the gyro's {math.degrees(scale):.0f} deg/s"


def times_clipped(values: FloatArray) -> int:
    """How often the largest magnitude is held, for longer than values are held elsewhere (a slow field, repeated)."""
    changes = 1 + int(np.count_nonzero(np.diff(values)))
    long = CLIPPED_SAMPLES * max(1.0, values.size / changes)
    size = np.abs(values)
    top = size == size.max()
    return sum(stop - start >= long for start, stop in stretches(top))
