"""Paparazzi's logs: a .data of text lines (time, aircraft, message, values), and a .log beside it that names them.

The .log is XML: the messages' definitions, the airframes, and the name of its .data. Only names of messages, of their
fields and of an airframe's commands are taken from it, by their tags, so that a damaged one still serves; what nothing
names is called by its place. Without a .log the messages that profiles need are named as paparazzi's messages.xml does.

Fields are `MESSAGE.field` and `MESSAGE.field[2]`; of COMMANDS also `COMMANDS.ROLL`, where the airframe tells the order.
"""

from __future__ import annotations

import hashlib
import re
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from types import MappingProxyType

import numpy as np

from gcs.errors import TippathError
from gcs.logs.formats.columns import Column, ColumnLog
from gcs.logs.formats.damage import Damage
from gcs.logs.formats.raw import unreadable
from gcs.logs.formats.tables import FloatArray, increasing
from gcs.logs.words import printable

AXES = ("gp", "gq", "gr")
BY_PLACE: Mapping[tuple[str, int], tuple[str, ...]] = MappingProxyType(
    {
        ("IMU_GYRO", 3): AXES,
        ("IMU_GYRO", 4): ("id", *AXES),
        ("IMU_GYRO_SCALED", 3): AXES,
        ("IMU_GYRO_SCALED", 4): ("id", *AXES),
        ("IMU_ACCEL", 3): ("ax", "ay", "az"),
        ("IMU_ACCEL", 4): ("id", "ax", "ay", "az"),
        ("ATTITUDE", 3): ("phi", "psi", "theta"),
        ("ROTORCRAFT_CMD", 4): ("cmd_roll", "cmd_pitch", "cmd_yaw", "cmd_thrust"),
        ("COMMANDS", 1): ("values",),
        ("ACTUATORS", 1): ("values",),
        ("CHIRP", 12): (
            *("active", "percentage_done", "current_frequency", "axis", "amplitude", "fstart", "fstop"),
            *("noise_onaxis_ratio", "noise_offaxis", "current_value", "fade_in", "exponential"),
        ),
    }
)
"""Message and number of its values -> their names, where no .log names them."""
MOST_VALUES = 256
LONGEST_LINE = 4096
FEWEST = 10
"""Lines of a log."""
WRONG = 0.5
"""Share of lines that are none, above which a file is no log."""

_LINE = re.compile(r"(\d{1,10}(?:\.\d{1,9})?) (\d{1,5}) ([A-Z][A-Z0-9_]{0,60})(?: (.*))?")
_HEAD = re.compile(rb"\s*\d{1,10}\.\d{1,9} \d{1,5} [A-Z][A-Z0-9_]{2,60}[ \r\n]")
_MESSAGE = re.compile(r"<message\b[^>]*\bname=\"([^\"]+)\"[^>]*>(.*?)</message>", re.DOTALL | re.IGNORECASE)
_FIELD = re.compile(r"<field\b[^>]*\bname=\"([^\"]+)\"", re.IGNORECASE)
_DATA_FILE = re.compile(r"\bdata_file=\"([^\"]+)\"", re.IGNORECASE)
_AIRCRAFT = re.compile(r"<(?:aircraft|airframe)\b[^>]*\bac_id=\"(\d+)\"", re.IGNORECASE)
_COMMANDS = re.compile(r"<commands\b[^>]*>(.*?)</commands>", re.DOTALL | re.IGNORECASE)
_AXIS = re.compile(r"<axis\b[^>]*\bname=\"([^\"]+)\"", re.IGNORECASE)


@dataclass(frozen=True, eq=False)
class Names:
    """What a .log says."""

    fields: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    """Message -> its fields."""
    commands: Mapping[int, tuple[str, ...]] = field(default_factory=dict)
    """Aircraft -> its commands, in their order."""


@dataclass(frozen=True, eq=False, kw_only=True)
class PaparazziFile:
    """A log, as one for each aircraft."""

    logs: tuple[ColumnLog, ...]
    """At least one."""
    damage: Damage
    sha256: str
    """Of the .data with its .log, never of one file alone: `gcs.logs.cache` keeps only what one file decides."""
    notes: tuple[str, ...]
    """What is wrong with it."""
    hints: tuple[str, ...]


def recognises(head: bytes) -> bool:
    """A .data by its first line, a .log by what its XML is of, whatever comes before."""
    return _HEAD.match(head) is not None or b"<configuration" in head


def read(path: Path) -> PaparazziFile:
    """A .data with the .log beside it, or the .data that a .log names. Raises TippathError."""
    raw = _bytes(path)
    xml: bytes | None = None
    if b"<configuration" in raw[:4096]:
        xml, path = raw, _data_of(path, raw)
        raw = _bytes(path)
    elif (beside := path.with_suffix(".log")).is_file():
        xml = _bytes(beside)
        xml = xml if b"<configuration" in xml[:4096] else None
    names = Names() if xml is None else _names(xml.decode("utf-8", "replace"))
    lines, skipped, breaks = _lines(raw, path)
    logs = [_log(path, number, messages, names) for number, messages in sorted(lines.items())]
    notes = []
    if len(logs) > 1:
        notes.append(f"{len(logs)} aircraft in this log: {', '.join(str(number) for number in sorted(lines))}")
    hints = []
    if xml is None:
        hints.append(
            f"{printable(path.with_suffix('.log').name)} is not beside it: messages and the order of commands are "
            "taken as paparazzi's rotorcraft have them"
        )
    return PaparazziFile(
        logs=tuple(logs),
        damage=Damage(len(raw), skipped, breaks),
        sha256=hashlib.sha256(raw + (b"no .log" if xml is None else xml)).hexdigest(),
        notes=tuple(notes),
        hints=tuple(hints),
    )


def _bytes(path: Path) -> bytes:
    try:
        return path.read_bytes()
    except OSError as error:
        raise unreadable(path, error) from error


def _data_of(log: Path, xml: bytes) -> Path:
    """The .data that a .log names, in its own folder, or the one of its own name."""
    named = _DATA_FILE.search(xml[:65536].decode("utf-8", "replace"))
    files = [log.with_suffix(".data")]
    if named is not None:
        files.insert(0, log.parent / Path(named[1].replace("\\", "/")).name)
    found = next((path for path in files if path.is_file()), None)
    if found is None:
        raise TippathError(
            f"{log}: names messages only; their samples are in {printable(files[0].name)}, which is not beside it: "
            "copy both"
        )
    return found


def _names(xml: str) -> Names:
    fields: dict[str, tuple[str, ...]] = {}
    for name, body in _MESSAGE.findall(xml):
        fields.setdefault(name, tuple(_FIELD.findall(body)))  # telemetry is the first class of messages
    commands: dict[int, tuple[str, ...]] = {}
    aircraft = list(_AIRCRAFT.finditer(xml))
    for place, one in enumerate(aircraft):
        until = aircraft[place + 1].start() if place + 1 < len(aircraft) else len(xml)
        listed = _COMMANDS.search(xml, one.end(), until)
        if listed is not None:
            commands.setdefault(int(one[1]), tuple(name.upper() for name in _AXIS.findall(listed[1])))
    return Names(fields, commands)


Lines = dict[int, dict[str, list[tuple[float, str]]]]
"""Aircraft -> message -> times in s and the values as written."""


def _lines(raw: bytes, path: Path) -> tuple[Lines, int, int]:
    """What stands in a .data, the bytes of lines that are none, and in how many places they stand."""
    found: Lines = {}
    good = wrong = skipped = breaks = 0
    broken = False
    for line in raw.splitlines(keepends=True):
        match = _LINE.fullmatch(line.decode("utf-8", "replace").rstrip()) if len(line) <= LONGEST_LINE else None
        if match is None:
            if line.strip():
                wrong, skipped = wrong + 1, skipped + len(line)
                breaks += not broken
                broken = True
            continue
        good, broken = good + 1, False
        found.setdefault(int(match[2]), {}).setdefault(match[3], []).append((float(match[1]), match[4] or ""))
    if good < FEWEST or wrong > WRONG * (good + wrong):
        raise TippathError(
            f"{path}: not a .data of Paparazzi: {good} of {good + wrong} lines are a time, an aircraft and a message; "
            "copy it from the ground station again"
        )
    most = max(sum(map(len, messages.values())) for messages in found.values())
    real = {number: each for number, each in found.items() if sum(map(len, each.values())) > 0.01 * most}
    return real, skipped, breaks


def _log(path: Path, aircraft: int, messages: Mapping[str, Sequence[tuple[float, str]]], names: Names) -> ColumnLog:
    clocks: dict[str, FloatArray] = {}
    columns: dict[str, Column] = {}
    dropped: dict[str, int] = {}
    for message, lines in messages.items():
        t, fields = _values(message, lines, names)
        if t.size < 2 or not fields:
            continue
        keep = increasing(t)
        if not keep.all():
            dropped[message] = int(np.count_nonzero(~keep))
        clocks[message] = t[keep]
        columns |= {f"{message}.{name}": Column(message, values[keep]) for name, values in fields.items()}
    commands = names.commands.get(aircraft, ())
    for place, name in enumerate(commands):
        if f"COMMANDS.values[{place}]" in columns:
            columns[f"COMMANDS.{name}"] = columns[f"COMMANDS.values[{place}]"]
    return ColumnLog(path=str(path), kind="paparazzi", clocks=clocks, columns=columns, dropped=dropped)


def _values(
    message: str, lines: Sequence[tuple[float, str]], names: Names
) -> tuple[FloatArray, Mapping[str, FloatArray]]:
    """Times and the numbers of a message by their fields; of lines that are not like most, nothing."""
    shapes = Counter(_shape(text) for _, text in lines[:1000])
    shape = shapes.most_common(1)[0][0]
    total = sum(shape)
    if not shape or total > MOST_VALUES:
        return np.empty(0), {}
    rows = []
    for t, text in lines:
        words = text.replace(",", " ").split()
        if len(words) == total:
            rows.append([t, *(_number(word) for word in words)])
    table = np.array(rows, np.float64).reshape(-1, 1 + total)
    fields = dict(zip(_field_names(message, shape, names), table.T[1:], strict=True))
    if "id" in fields and np.isfinite(fields["id"]).any():  # several sensors: the one that speaks most
        which, often = np.unique(fields["id"][np.isfinite(fields["id"])], return_counts=True)
        mine = fields["id"] == which[np.argmax(often)]
        return table[mine, 0], {name: values[mine] for name, values in fields.items()}
    return table[:, 0], {name: values for name, values in fields.items() if np.isfinite(values).any()}


def _shape(text: str) -> tuple[int, ...]:
    """How many values each word of a line holds."""
    return tuple(word.count(",") + 1 for word in text.split())


def _field_names(message: str, shape: Sequence[int], names: Names) -> list[str]:
    known = names.fields.get(message) or BY_PLACE.get((message, len(shape))) or ()
    if known and len(shape) > len(known):  # the last is an array without commas
        shape = (*shape[: len(known) - 1], sum(shape[len(known) - 1 :]))
    named = [known[place] if place < len(known) else f"value{place}" for place in range(len(shape))]
    return [
        name if size == 1 and name != "values" else f"{name}[{k}]"
        for name, size in zip(named, shape, strict=True)
        for k in range(size)
    ]


def _number(word: str) -> float:
    try:
        return float(word)
    except ValueError:
        return float("nan")
