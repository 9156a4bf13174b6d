"""What is known of the vehicle that a fit's runs were flown with: its settings, battery and rotor speed."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from pathlib import Path

import numpy as np

from gcs.errors import TippathError
from gcs.flight.folder import flight_of
from gcs.flight.identified import Identified, same
from gcs.logs.formats.dataflash_table import DataFlashTables
from gcs.logs.formats.tables import Log
from gcs.logs.formats.ulog_table import UlogTables
from gcs.logs.opening import open_log
from gcs.logs.runs import systemid
from gcs.vehicle.identity import is_simulated, standing_on
from sysid.fit.result import Fit

VOLTS = "BAT.Volt"
ROTOR = ("RPM.rpm1", "ESC.RPM")
Stretch = tuple[float, float]
"""First and last second of the log's own time."""
Range = tuple[float, float]


def identified(fit: Fit) -> Identified:
    """By the logs of the fit's own runs, as far as they are still there and tell."""
    told: dict[str, float] = {}
    changed: set[str] = set()
    volts: list[Range] = []
    rotor: list[Range] = []
    for path in dict.fromkeys(Path(one.path) for one in fit.records if one.path):
        for here in _settings(path, volts, rotor):
            for name, value in standing_on(here).items():
                if not math.isfinite(value):
                    continue
                if not same(told.setdefault(name, value), value):
                    changed.add(name)
    return Identified(
        parameters={name: value for name, value in told.items() if name not in changed},
        changed=tuple(sorted(changed)),
        battery_v=_over(volts),
        rotor_rpm=_over(rotor),
    )


def simulated(paths: Iterable[Path]) -> bool:
    """Whether one of these logs is of a vehicle that only a computer flew, as far as its parameters tell."""
    for path in paths:
        try:
            boots = open_log(path, None).boots
        except (TippathError, OSError):
            continue
        for log in boots:
            if isinstance(log, DataFlashTables) and is_simulated(log.parameters(math.inf)):
                return True
    return False


def _settings(path: Path, volts: list[Range], rotor: list[Range]) -> Iterable[Mapping[str, float]]:
    """Of each run, as far as the log knows its runs; what else was logged goes into the lists."""
    try:
        boots = open_log(path, None).boots
    except (TippathError, OSError):
        return
    for log in boots:
        runs = _runs(log)
        logged = _ranges(log, (VOLTS,), runs), _ranges(log, ROTOR, runs)
        telemetry = () if all(logged) else _at_the_start(path)
        for into, found, word in zip((volts, rotor), logged, ("battery_v", "rotor_rpm"), strict=True):
            into += found or [(value, value) for name, value in telemetry if name == word]
        if isinstance(log, DataFlashTables):
            yield from (log.parameters(start_s) for start_s, _ in runs)
        elif isinstance(log, UlogTables):
            yield log.parameters()


def _runs(log: Log) -> list[Stretch]:
    """All of a log that does not tell of its runs."""
    spans = systemid.find(log) if isinstance(log, DataFlashTables) else []
    found = [(span.start_s, span.stop_s) for span in spans if not span.reasons]
    return found or [(-math.inf, math.inf)]


def _ranges(log: Log, fields: Iterable[str], runs: Iterable[Stretch]) -> list[Range]:
    """Of the first of these fields that the log has."""
    name = next((field for field in fields if log.has(field)), None)
    if name is None:
        return []
    series = log.series(name)
    found = []
    for start_s, stop_s in runs:
        values = series.values[(series.t >= start_s) & (series.t <= stop_s) & (series.values > 0)]
        values = values[np.isfinite(values)]
        if values.size:
            found.append((float(np.min(values)), float(np.max(values))))
    return found


def _at_the_start(path: Path) -> list[tuple[str, float]]:
    """What the flight's own file says that telemetry told when its card began."""
    try:
        vehicle = flight_of(path).read().get("vehicle")
    except TippathError:
        return []
    told = vehicle if isinstance(vehicle, dict) else {}
    each = ((name, told.get(name)) for name in ("battery_v", "rotor_rpm"))
    return [(name, float(v)) for name, v in each if isinstance(v, int | float) and math.isfinite(v) and v > 0]


def _over(ranges: list[Range]) -> Range | None:
    return None if not ranges else (min(low for low, _ in ranges), max(high for _, high in ranges))
