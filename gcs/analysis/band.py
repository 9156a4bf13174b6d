"""The band of a fit that nobody named: what was swept, else where the rates follow the commands.

Above and below it a fit would explain what nothing excited. It is told with its reason, and kept in the fit.
"""

from __future__ import annotations

from collections.abc import Sequence

from gcs.logs.runs import health
from sysid.data.band import USUAL, Band, BandFrom, ChosenBand, common_band, swept_band
from sysid.data.record import Record


def chosen_band(records: Sequence[Record]) -> ChosenBand:
    """The band for a fit to these runs, as `tippath ingest` shows what it is made from."""
    swept = swept_band(records)
    if swept is not None:
        return swept
    common = common_band(_coherent(records))
    return USUAL if common is None else ChosenBand(common, BandFrom.COHERENT)


def _coherent(records: Sequence[Record]) -> dict[str, list[Band]]:
    """Axis -> where the rates follow its command, run by run."""
    found: dict[str, list[Band]] = {}
    for record in records:
        for axis, one in health.check(record).coherent.items():
            if one.share >= health.ENOUGH_COHERENT:
                found.setdefault(axis, []).append((one.low_hz, one.high_hz))
    return found
