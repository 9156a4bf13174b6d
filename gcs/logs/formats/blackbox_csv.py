"""Blackbox logs that were decoded to CSV: by blackbox_decode, or exported by the Blackbox Explorer.

The columns carry the header's names, blackbox_decode's with a unit behind some; the Explorer writes the log's settings
above them, a line each. They are read as any CSV and become the same series as those of the file they came from.
"""

from __future__ import annotations

import csv
import hashlib
import math
import re
import struct
from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType

from gcs.errors import TippathError
from gcs.logs.formats.blackbox import BlackboxFile
from gcs.logs.formats.blackbox_header import Header
from gcs.logs.formats.blackbox_table import ACCELEROMETERS, GYROS, MAIN, blackbox_log, scale_of
from gcs.logs.formats.columns import Column
from gcs.logs.formats.csv import CsvFile
from gcs.logs.formats.csv_table import open_table
from gcs.logs.formats.raw import unreadable

_HEAD = re.compile(rb'\s*(?:"?Product"?,"?Blackbox flight data recorder|"?loopIteration"?, ?"?time)')
_COLUMNS = re.compile(rb'(?m)^"?loopIteration"?,')
_WANTED = re.compile(
    r"(axis[A-Z]|gyro\w+|acc\w+|motor|servo|setpoint|rcCommand|mixer|debug|attitude|eRPM)\[\d\]|headspeed"
)
_NAMES: Mapping[str, str] = MappingProxyType({"pidSumLimit": "pidsum_limit", "pidSumLimitYaw": "pidsum_limit_yaw"})
"""As the Explorer calls them -> as the vehicle does."""
_UNITS: Mapping[str, float] = MappingProxyType(
    {"deg/s": 1.0, "rad/s": 180 / math.pi, "g": 1.0, "m/s2": 1 / 9.80665, "m/s/s": 1 / 9.80665}
)
_TIMES: Mapping[str, float] = MappingProxyType({"": 1e-6, "us": 1e-6, "s": 1.0})


def recognises(head: bytes) -> bool:
    return _HEAD.match(head) is not None


def read(path: Path) -> BlackboxFile:
    """Raises TippathError for what cannot be read as a decoded log."""
    try:
        raw = path.read_bytes()
    except OSError as error:
        raise unreadable(path, error) from error
    begins = _COLUMNS.search(raw)
    if begins is None:
        raise TippathError(f"{path}: no line of column names that begins with loopIteration; decode the log again")
    header = Header({}, _settings(raw[: begins.start()]), 0)
    file = CsvFile.parse(raw[begins.start() :], str(path))
    units = dict(zip(file.layout.names, file.layout.units, strict=True))
    if units.get("time", "?") not in _TIMES:
        raise TippathError(f"{path}: no column time in us or s behind loopIteration; decode the log again")
    names = [name for name in file.layout.names if _WANTED.fullmatch(name) and file.column(name) is not None]
    required = [name for name in names if name in ("gyroADC[0]", "gyroADC[1]")]
    table = open_table(file, "time", _TIMES[units["time"]], required, [name for name in names if name not in required])
    logs = []
    for boot in table.boots:
        columns = {
            name: Column(MAIN, boot.series(name).values, _scale(name, units[name], header))
            for name in names
            if boot.has(name) and boot.series(name).clock == boot.series(names[0]).clock
        }
        logs.append(blackbox_log(str(path), header, boot.series(names[0]).t, columns))
    return BlackboxFile(
        logs=tuple(logs), damage=table.damage, sha256=hashlib.sha256(raw).hexdigest(), notes=table.notes
    )


def _settings(raw: bytes) -> dict[str, str]:
    """The lines above the columns: a name, and what it is set to."""
    try:
        lines = list(csv.reader(raw.decode("utf-8", "replace").splitlines()))
    except csv.Error:
        return {}
    found = {_NAMES.get(cells[0], cells[0]): ",".join(cells[1:]) for cells in lines if len(cells) > 1}
    try:  # the Explorer has it in radians per microsecond
        found["gyro_scale"] = struct.pack(">f", float(found["gyroScale"]) * 180e6 / math.pi).hex()
    except (KeyError, ValueError, OverflowError):
        found.pop("gyro_scale", None)
    return found


def _scale(name: str, unit: str, header: Header) -> float:
    if unit in _UNITS and name.partition("[")[0] in (*GYROS, *ACCELEROMETERS):
        return _UNITS[unit]
    return scale_of(name, header)
