"""The band of a fit that nobody named: what was swept.

Below a sweep the controller moves the commands, above it hardly anything does, and there a model is fitted to what it
does not describe. A chirp flown with noise on it, as the paper's, moves more than it sweeps, and has the paper's band;
but not in a log that lost samples of it: noise from between those folds back, and is most of what it has beyond.
"""

from __future__ import annotations

import enum
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from sysid.data.preprocess import DEFAULT_BAND_HZ, lost_commands
from sysid.data.record import Record

Band = tuple[float, float]
NARROWEST = 2.0
"""High over low: in less than an octave hardly anything can be told."""
SAMPLES_OF_A_PERIOD = 4.0
"""At the band's upper end, at least: what a run is asked for before it is fitted."""


class BandFrom(enum.StrEnum):
    """Why a fit has its band."""

    GIVEN = "given"
    """The user named it."""
    SWEPT = "swept"
    NOISE = "noise"
    """Noise was flown with the chirps."""
    NOISE_LOST = "noise, samples lost"
    """The same, in a log that has not every sample of it."""
    COHERENT = "coherent"
    """Nothing was swept; there the rates follow the commands."""
    USUAL = "usual"
    """Nothing tells of another."""


@dataclass(frozen=True, slots=True)
class ChosenBand:
    """A band and why it was taken."""

    hz: Band
    source: BandFrom


USUAL = ChosenBand(DEFAULT_BAND_HZ, BandFrom.USUAL)


def swept_band(records: Sequence[Record]) -> ChosenBand | None:
    """What the sweeps among the runs to fit have in common, axis beside axis; None where there is no sweep.

    The elevator's count only where nothing else was swept.
    """
    sweeps = [record for record in records if record.swept_band_hz is not None]
    cyclic = [record for record in sweeps if record.axis != "elevator"]
    by_axis: dict[str, list[Band]] = {}
    for record in cyclic or sweeps:
        assert record.swept_band_hz is not None
        by_axis.setdefault(str(record.axis), []).append(record.swept_band_hz)
    if not by_axis:
        return None
    common = common_band(by_axis)
    if any(record.chirp_noise for record in sweeps):
        low_hz, high_hz = DEFAULT_BAND_HZ
        lost = any(lost_commands(record.duration_s / (record.t.size - 1), record) for record in sweeps)
        if lost and common is not None and common[1] < high_hz:
            return ChosenBand((low_hz, common[1]), BandFrom.NOISE_LOST)
        return ChosenBand(DEFAULT_BAND_HZ, BandFrom.NOISE)
    return USUAL if common is None else ChosenBand(_carried(common, records), BandFrom.SWEPT)


def common_band(by_axis: Mapping[str, Sequence[Band]]) -> Band | None:
    """From the lowest to the highest frequency of each axis, as far as they have it in common; None for too little."""
    low = max((min(band[0] for band in bands) for bands in by_axis.values()), default=0.0)
    high = min((max(band[1] for band in bands) for bands in by_axis.values()), default=0.0)
    return (low, high) if high >= max(NARROWEST * low, 1e-3) else None


def _carried(band: Band, records: Sequence[Record]) -> Band:
    """Beyond the usual band's end only as far as every run has samples for it."""
    rate_hz = min((record.t.size - 1) / record.duration_s for record in records)
    return band[0], min(band[1], max(rate_hz / SAMPLES_OF_A_PERIOD, DEFAULT_BAND_HZ[1]))
