"""What a log's settings tell of the filters that the logged rates went through, as constants of a structure.

ArduPilot filters its gyros by a Butterworth low-pass of second order (INS_GYRO_FILTER, Hz) and by up to two harmonic
notches (INS_HNTCH_*, INS_HNTC2_*). The rates of its RATE messages are behind these; those of SIDD are not: they are
made of the angles that the sensor turned by, before any filter.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence

from sysid.data.record import Record

BUTTERWORTH = math.sqrt(0.5)
"""Damping ratio."""
CORNER = "gyro_corner_hz"
NOTCHES = 4
"""At most so many of those that are told are taken, the lowest."""
FILTERED = ("RATE",)
"""Messages whose rates are behind the filters."""
NOTCH_PREFIXES = ("INS_HNTCH", "INS_HNTC2")
_FIXED = 0
"""INS_HNTCH_MODE of a notch that follows nothing."""
_PLAIN = 0
"""INS_HNTCH_OPTS of one notch for each harmonic, not two or three side by side."""
NOTCH_WORDS = ("ENABLE", "MODE", "OPTS", "HMNCS", "FREQ", "BW", "ATT")
SETTINGS = ("INS_GYRO_FILTER", *(f"{prefix}_{word}" for prefix in NOTCH_PREFIXES for word in NOTCH_WORDS))
"""Read from `Record.vehicle`."""


def notch_names(number: int) -> tuple[str, str, str]:
    """Of the constants of a notch, 1 to NOTCHES: frequency and width in Hz, and what it leaves at its frequency."""
    return f"gyro_notch{number}_hz", f"gyro_notch{number}_width_hz", f"gyro_notch{number}_left"


def told_filters(records: Sequence[Record]) -> dict[str, float]:
    """The filters that all these runs were logged behind, by the names of constants; empty where they differ, where no
    log tells, and where the rates were logged before any filter."""
    each = [_of_run(record) for record in records]
    return each[0] if each and all(one == each[0] for one in each) else {}


def _of_run(record: Record) -> dict[str, float]:
    if record.rate_source not in FILTERED:
        return {}
    settings = {name: _number(record.vehicle[name]) for name in SETTINGS if name in record.vehicle}
    told: dict[str, float] = {}
    corner = settings.get("INS_GYRO_FILTER", 0.0)
    if corner > 0:
        told[CORNER] = corner
    for number, notch in enumerate(sorted(_notches(settings))[:NOTCHES], 1):
        told |= dict(zip(notch_names(number), notch, strict=True))
    return told


def _number(text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        return 0.0
    return value if math.isfinite(value) else 0.0


def _notches(settings: Mapping[str, float]) -> Iterator[tuple[float, float, float]]:
    """Frequency, width (of the first harmonic's Q, as all have it) and what is left; of those that stand still."""
    for prefix in NOTCH_PREFIXES:
        enabled, mode, options, harmonics, frequency, width, attenuation = (
            settings.get(f"{prefix}_{word}", 0.0) for word in NOTCH_WORDS
        )
        if not enabled or mode != _FIXED or options != _PLAIN or not 0 < width < 2 * frequency:
            continue
        octaves = 2 * math.log2(frequency / (frequency - width / 2))
        per_hz = (2.0**octaves - 1) / math.sqrt(2.0**octaves)  # 1/Q
        left = 10 ** (-attenuation / 20)
        for harmonic in range(1, 17):
            if int(harmonics) >> (harmonic - 1) & 1:
                yield harmonic * frequency, harmonic * frequency * per_hz, left
