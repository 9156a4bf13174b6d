"""How fast the vehicle's control loop ran, which held its commands: from its settings in the log, or as it was told."""

from __future__ import annotations

from dataclasses import dataclass

from gcs.logs.formats.dataflash_table import DataFlashTables
from gcs.logs.formats.tables import Log
from gcs.logs.formats.ulog_table import UlogTables
from gcs.logs.profile.profiles import Profile
from gcs.vehicle import own_log
from sysid.data.preprocess import EVERY_LOOP
from sysid.data.record import Record

TOLD = "--loop-rate"
"""Who says a rate that the user gives."""


@dataclass(frozen=True, slots=True)
class Loop:
    """A control loop's rate, and who says so."""

    rate_hz: float
    told_by: str

    @property
    def dt_s(self) -> float:
        return 1 / self.rate_hz


def loop_of(log: Log, profile: Profile, at_s: float) -> Loop | None:
    """The loop's rate as the profile, or the log at a time, tells it; None where neither does."""
    if profile.loop_rate_hz is not None:
        return Loop(profile.loop_rate_hz, profile.loop_told_by)
    settings: dict[str, float] = {}
    if isinstance(log, DataFlashTables):
        settings = log.parameters(at_s)
    elif isinstance(log, UlogTables):
        settings = log.parameters()
    told = own_log.loop_rate(settings)
    return None if told is None else Loop(told[1], told[0])


def held(record: Record, rate_hz: float) -> str | None:
    """That commands were held for less than a sample of a log of `rate_hz`; None where they were not, or may not."""
    loop_s = record.loop_dt_s
    if loop_s is None or loop_s * rate_hz >= EVERY_LOOP:
        return None
    return (
        f"commands were held for {1000 * loop_s:.3g} ms (the vehicle's loop: {record.loop_told_by} {1 / loop_s:.4g}) "
        f"and logged every {1000 / rate_hz:.3g} ms: fits take them so"
    )
