"""What the vehicle's own settings and counters tell: which vehicle it is, how a run was logged, and what was dropped.

ArduPilot logs every parameter (PARM), what its MAVLink log could not send (DMS.Dp) and what its card did not take
(DSF.Dp). Where a log has none of them there is nothing to tell.
"""

from __future__ import annotations

import re

import numpy as np

from gcs.logs.formats.dataflash_table import DataFlashTables
from gcs.logs.formats.tables import Log
from gcs.logs.words import printable
from gcs.vehicle.log_rate import ENOUGH_BUFFER, EVERY_LOOP, LOG_EVERY_LOOP, SLOWER, slower_than_loop

BACKEND_MAVLINK = 2
"""The bit of LOG_BACKEND_TYPE that sends the log over the link."""


_FRAME = re.compile(r"Frame: (\S+)")
_FIRMWARE = re.compile(r"(Ardu[A-Z]\w+|APM:\w+|PX4)\b")
SYSTEM_IDS = ("MAV_SYSID", "SYSID_THISMAV")
SETUP = ("FRAME_CLASS", "FRAME_TYPE", "SCHED_LOOP_RATE", "INS_GYRO_FILTER", "H_SW_TYPE", "H_CYC_MAX", "MOT_THST_EXPO")
"""Settings that make another vehicle of one, or another command of the same number."""


def vehicle_of(log: Log, at_s: float) -> dict[str, str]:
    """What a log says of the vehicle and how it was set up at a time, by name; empty where it says nothing."""
    if not isinstance(log, DataFlashTables):
        return {}
    known: dict[str, str] = {}
    for name, pattern in (("frame", _FRAME), ("firmware", _FIRMWARE)):
        said = next((match[1] for _, text in log.texts() if (match := pattern.match(text))), None)
        if said is not None:
            known[name] = printable(said)
    settings = log.parameters(at_s)
    system = next((settings[name] for name in SYSTEM_IDS if name in settings), None)
    if system is not None:
        known["system id"] = f"{system:g}"
    if settings.get("BRD_SERIAL_NUM"):
        known["BRD_SERIAL_NUM"] = f"{settings['BRD_SERIAL_NUM']:g}"
    return known | {name: f"{settings[name]:g}" for name in SETUP if name in settings}


def dropped(log: Log, start_s: float, stop_s: float) -> str | None:
    """Why samples are missing between two times, where the vehicle itself did not write them; None where unknown."""
    if not isinstance(log, DataFlashTables):
        return None
    settings = log.parameters(stop_s)
    over_link, on_card = (_grew(log, key, start_s, stop_s) for key in ("DMS.Dp", "DSF.Dp"))
    buffer = settings.get("LOG_MAV_BUFSIZE")
    has = "" if buffer is None else f" (it is {buffer:g})"
    do = f"set LOG_MAV_BUFSIZE to {ENOUGH_BUFFER}{has}, or take the vehicle's own file from its card"
    if over_link:
        return (
            f"the vehicle itself dropped {over_link} messages of its log in this run (DMS.Dp), for want of room: {do}"
        )
    if on_card:
        return (
            f"the vehicle itself dropped {on_card} messages of its log in this run (DSF.Dp), because its card was too "
            "slow: raise LOG_FILE_BUFSIZE, log less beside the rates (LOG_BITMASK), or take a faster card"
        )
    told = log.has("DMS.Dp") or log.has("DSF.Dp")
    sends = int(settings.get("LOG_BACKEND_TYPE", 0.0)) & BACKEND_MAVLINK
    if told or not sends or buffer is None or buffer >= ENOUGH_BUFFER:
        return None
    return f"what is missing in gaps was most likely dropped by the vehicle itself, before it sent its log: {do}"


def _grew(log: DataFlashTables, key: str, start_s: float, stop_s: float) -> int:
    """By how much a counter grew from the last time it was told before a run to the first after it."""
    if not log.has(key):
        return 0
    counter = log.series(key)
    first = max(0, int(np.searchsorted(counter.t, start_s, "right")) - 1)
    last = min(counter.t.size - 1, int(np.searchsorted(counter.t, stop_s, "left")))
    steps = np.diff(counter.values[first : last + 1])
    return int(np.sum(steps[steps > 0]))  # it begins at zero again where a log is begun again


def thinned(log: Log, start_s: float, rate_hz: float) -> str | None:
    """What a log slower than the vehicle's loop is enough for, and what it costs; None where it has every loop."""
    if not isinstance(log, DataFlashTables):
        return None
    settings = log.parameters(start_s)
    loop_hz = settings.get("SCHED_LOOP_RATE", 0.0)
    if not 0 < rate_hz < SLOWER * loop_hz:
        return None
    told = int(settings.get("LOG_BITMASK", EVERY_LOOP))
    do = "" if told & EVERY_LOOP else f"; {LOG_EVERY_LOOP}"
    return f"{slower_than_loop(rate_hz, loop_hz)}{do}"
