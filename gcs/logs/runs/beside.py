"""What a controller saw, loop by loop: rates, commands and targets of runs, and what a bank put out that ran beside the
controller that flew.

A vehicle of this project's that was asked to logs it as LQRO: targets in rad/s, outputs of full command.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np

from gcs.errors import TippathError
from gcs.logs.formats.dataflash_table import DataFlashTables
from gcs.logs.formats.tables import FloatArray
from gcs.vehicle.autopilots import ACTIVE_CRC
from sysid.control.shadow import SHORTEST_S, OverStretch, RanStretch
from sysid.data.preprocess import excitation_of
from sysid.data.record import CYCLIC, RATES, Record

LONGEST_GAP = 1.5
"""Loops; a longer one begins a new stretch."""
TARGETS = ("RATE.RDes", "RATE.PDes")
FLOWN = ("RATE.R", "RATE.P", "RATE.ROut", "RATE.POut")
EXCITED = ("TPEX.EX", "TPEX.EY")
PUT_OUT = ("LQRO.PDes", "LQRO.QDes", "LQRO.X", "LQRO.Y")
US = 1e6
NEAR_S = 0.1
"""By which messages of one moment may be apart."""


@dataclass(frozen=True, eq=False, kw_only=True)
class RanBeside:
    """A bank that ran without authority on one flight."""

    path: str
    dt: float
    """s, of one loop."""
    crc: int | None
    """Of the bank, 24 bits; None where the log does not tell."""
    stretches: tuple[RanStretch, ...]


def ran_beside(log: DataFlashTables) -> RanBeside | None:
    """What a log tells of it; None where nothing ran. Raises TippathError where that has too little without a gap."""
    if not all(map(log.has, (*FLOWN, *PUT_OUT, *EXCITED))):
        return None
    t, columns = _together(log, (*FLOWN, *PUT_OUT, *EXCITED))
    dt = float(np.median(np.diff(t))) if t.size > 1 else np.nan
    stretches = tuple(_stretch(columns[:, rows]) for rows in _without_gaps(t, dt))
    if not stretches:
        raise TippathError(
            f"{Path(log.path).name}: what the bank put out is nowhere logged for {SHORTEST_S:g} s without a gap: take "
            "the whole log off the card"
        )
    crc = log.parameters(float(t[-1])).get(ACTIVE_CRC)
    return RanBeside(path=log.path, dt=dt, crc=None if crc is None else int(crc), stretches=stretches)


def seen_by_controllers(
    records: Sequence[Record], logs: Mapping[str, Sequence[DataFlashTables]]
) -> tuple[list[OverStretch], float, bool]:
    """What runs hold without a gap, the spacing of its samples in s, and whether all targets were logged; where they
    were not they are 0. `logs`: by path, of those that have any. Raises TippathError where nothing is long enough."""
    dt = float(np.median([np.median(np.diff(one.channels["t"])) for one in records]))
    stretches, told = [], True
    for record in records:
        t = record.channels["t"]
        targets = _targets(logs.get(record.path, ()), t)
        told = told and targets is not None
        rows: dict[str, tuple[str, ...]] = {"rates": RATES, "commands": CYCLIC}
        excitation = tuple(map(excitation_of, CYCLIC))
        if set(excitation) <= set(record.channels):
            rows["excitation"] = excitation
        columns = {name: np.array([record.channels[one] for one in each]) for name, each in rows.items()}
        columns["targets"] = np.zeros((2, t.size)) if targets is None else targets
        for part in _without_gaps(t, float(np.median(np.diff(t)))):
            even = np.arange(t[part][0], t[part][-1], dt)
            rows_of = {name: [np.interp(even, t[part], row[part]) for row in each] for name, each in columns.items()}
            stretches.append(OverStretch(**{name: np.stack(each, axis=1) for name, each in rows_of.items()}))
    if not stretches:
        raise TippathError(f"no run has {SHORTEST_S:g} s without a gap: take the whole log off the card")
    return stretches, dt, told


def _targets(logs: Sequence[DataFlashTables], t: FloatArray) -> FloatArray | None:
    """(2, n), rad/s, at these times; None where no log has them."""
    for log in logs:
        if all(map(log.has, TARGETS)):
            each = [log.series(name) for name in TARGETS]
            if all(one.t[0] <= t[0] + NEAR_S and t[-1] <= one.t[-1] + NEAR_S for one in each):
                return np.radians([np.interp(t, one.t, one.values) for one in each])
    return None


def _together(log: DataFlashTables, names: Sequence[str]) -> tuple[FloatArray, FloatArray]:
    """Times (n,) that all have, and the columns (len(names), n)."""
    each = [log.series(name) for name in names]
    clocks = [np.round(one.t * US).astype(np.int64) for one in each]
    common = clocks[0]
    for clock in clocks[1:]:
        common = np.intersect1d(common, clock)
    columns = np.array([one.values[np.searchsorted(clock, common)] for one, clock in zip(each, clocks, strict=True)])
    told = np.all(np.isfinite(columns), axis=0)
    return common[told] / US, columns[:, told]


def _stretch(columns: FloatArray) -> RanStretch:
    return RanStretch(
        rates=np.radians(columns[0:2]).T,
        commands=columns[2:4].T,
        targets=columns[4:6].T,
        output=columns[6:8].T,
        excitation=columns[8:10].T,
    )


def _without_gaps(t: FloatArray, dt: float) -> list[slice]:
    """Rows of stretches that are long enough."""
    ends = np.concatenate([[0], np.flatnonzero(np.diff(t) > LONGEST_GAP * dt) + 1, [t.size]])
    parts = [slice(int(a), int(b)) for a, b in pairwise(ends) if b > a]
    return [part for part in parts if t[part][-1] - t[part][0] >= SHORTEST_S]
