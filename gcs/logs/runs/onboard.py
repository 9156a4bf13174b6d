"""What the vehicle's own settings and counters tell: which vehicle it is, how a run was logged, and what was dropped.

ArduPilot logs every parameter (PARM), what its MAVLink log could not send (DMS.Dp) and what its card did not take
(DSF.Dp). Where a log has none of them there is nothing to tell.
"""

from __future__ import annotations

import re

import numpy as np

from gcs.logs.formats.dataflash_table import DataFlashTables
from gcs.logs.formats.tables import Log
from gcs.logs.runs.autotune import flown_as
from gcs.logs.words import printable
from gcs.vehicle import own_log
from gcs.vehicle.autopilots import airframe_of_type
from sysid.data.airframe import Airframe

FLOWN_AS = {1: "rotary wing", 2: "fixed wing"}
"""PX4's vehicle_type."""
_FRAME = re.compile(r"Frame: (\S+)")
_FIRMWARE = re.compile(r"(Ardu[A-Z]\w+|APM:\w+|PX4)\b")


def vehicle_of(log: Log, at_s: float) -> dict[str, str]:
    """What a log says of the vehicle and how it was set up at a time, by name; empty where it says nothing."""
    if log.kind == "ulog":
        flown = FLOWN_AS.get(flown_as(log, at_s) or 0)
        return {} if flown is None else {"flown as": flown}
    if not isinstance(log, DataFlashTables):
        return {}
    known: dict[str, str] = {}
    for name, pattern in (("frame", _FRAME), ("firmware", _FIRMWARE)):
        said = next((match[1] for _, text in log.texts() if (match := pattern.match(text))), None)
        if said is not None:
            known[name] = printable(said)
    return known | own_log.identity(log.parameters(at_s))


def airframe_of(log: Log, at_s: float) -> Airframe | None:
    """What kind of rotorcraft the log says it is of; None where it does not say."""
    if isinstance(log, DataFlashTables):
        frame = vehicle_of(log, at_s).get("frame", "")
        known = own_log.airframe(log.parameters(at_s), frame)
        tilts = any(name.startswith(f"{own_log.SWASHPLATE}.") for name in log.fields())
        return Airframe.HELICOPTER if known is None and not frame and tilts else known
    types = (log.series(key).values[-1] for key in own_log.TYPES if log.has(key))
    return next((airframe_of_type(int(number)) for number in types if np.isfinite(number)), None)


def dropped(log: Log, start_s: float, stop_s: float) -> str | None:
    """Why samples are missing between two times, where the vehicle itself did not write them; None where unknown."""
    if not isinstance(log, DataFlashTables):
        return None
    counts = {key: _grew(log, key, start_s, stop_s) for key in own_log.DROPPED if log.has(key)}
    return own_log.dropped(counts, log.parameters(stop_s))


def _grew(log: DataFlashTables, key: str, start_s: float, stop_s: float) -> int:
    """By how much a counter grew from the last time it was told before a run to the first after it."""
    counter = log.series(key)
    first = max(0, int(np.searchsorted(counter.t, start_s, "right")) - 1)
    last = min(counter.t.size - 1, int(np.searchsorted(counter.t, stop_s, "left")))
    steps = np.diff(counter.values[first : last + 1])
    return int(np.sum(steps[steps > 0]))  # it begins at zero again where a log is begun again


def thinned(log: Log, start_s: float, rate_hz: float) -> str | None:
    """What a log slower than the vehicle's loop is enough for, and what it costs; None where it has every loop."""
    return own_log.thinned(rate_hz, log.parameters(start_s)) if isinstance(log, DataFlashTables) else None
