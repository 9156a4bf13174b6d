"""A profile to start from: the channels that were found in a log, and guesses by name for the others.

A guess is no answer: it is marked as one, and sign, unit and order of motors are for the user to check. The text is
valid TOML and is accepted by `--profile` as it stands.
"""

from __future__ import annotations

import json
import math
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from types import MappingProxyType

from gcs.logs.formats.tables import TABLES
from gcs.logs.profile.by_values import BY_VALUES, FloatArray, Guess, command_guess, rate_guess, time_guess
from gcs.logs.profile.profiles import ChannelSource
from gcs.logs.profile.units import factor
from gcs.logs.words import printable
from sysid.data.record import CHANNELS, REQUIRED

FIRST_LINE = "# save as mine.toml (-o mine.toml does), correct it, and name it: --profile mine.toml"
_LETTERS = {"p": ("p", "x", "roll"), "q": ("q", "y", "pitch"), "r": ("r", "z", "yaw")}
ARRAYS = ("mat", "parquet")
"""Kinds of log whose names say where an array stands: `flight.imu.tout`."""
_CONTROL = r"(cmd|command|ctrl|control|out|output|cyclic|cyc|servo|stick|input|delta|u)"


def _rates(letter: str, axis: str, name: str) -> tuple[str, ...]:
    index = "xyz".index(axis)
    return (
        rf"^rate\.{name[0]}$",
        rf"(^|[ _]){letter}$",
        rf"{name}[ ._]?(rate|speed|vel)$",
        rf"rate[ ._]?({letter}|{name}|{axis})$",
        rf"gyro?s?([ ._]\w+)?[ ._]?({axis}|{letter})([ ._]|$)",
        rf"(^|[ ._])(g|w|omega[ ._]?){axis}$",
        rf"(angular_velocity|gyro)\w*\.\w+\[{index}\]$",
        rf"{name}speed$",
        rf"(angular_velocity|gyro)\w*\.{axis}$",
        rf"(^|[ ._])gyro\w*\[{index}\]$",
        rf"(^|[ ._])r_{name}$",
    )


def _commands(name: str, letter: str, other: str, index: int) -> tuple[str, ...]:
    return (
        rf"{_CONTROL}[ ._]?{name}$",
        rf"{name}[ ._]?{_CONTROL}$",
        rf"^rate\.{letter}out$",
        rf"(^|[ ._])({other})([ ._]?{_CONTROL})?$",
        rf"(torque_setpoint|actuator_controls_0)(_\d+)?\.(xyz|control)\[{index}\]$",
        rf"^u[ ._]?{index + 1}$",
        rf"(^|[ ._])(cmd|command|control|torque|input|u)s?\[{index}\]$",
        rf"^axissum\[{index}\]$",
        rf"^axisp\[{index}\]$",
    )


GUESSES: Mapping[str, tuple[str, ...]] = MappingProxyType(
    {
        **{channel: _rates(*letters) for channel, letters in _LETTERS.items()},
        "delta_x": _commands("roll", "r", "ail|aileron|lat|lateral|lat_cyc", 0),
        "delta_y": _commands("pitch", "p", "ele|elevator|lon|longitudinal|lon_cyc", 1),
        "omega": (r"(^|[ ._])rpm([ ._]?1)?$", r"rotor[ ._]?speed$"),
    }
)
"""Channel -> patterns of names (in lower case, without the unit behind it), likeliest first."""

_WANTED = re.compile(r"des(ired)?$|[ ._]sp$|rate_?setpoint|target|[ ._]ref$")
_MOTORS = re.compile(r"^(?:m|motors?[ ._]?|pwm[ ._]?|mot[ ._]?)([1-4])$")
_PID_SUMS = re.compile(r"axis(sum|p)\[\d\]$")
_TIMES = (
    (re.compile(r"(time|stamp|^t)\w*_?(us|usec|micros)$|^(micros|timeus)$"), 1e-6),
    (re.compile(r"(time|stamp|^t)\w*_?(ms|msec|millis)$|^(millis|timems)$"), 1e-3),
    (re.compile(r"(time|stamp|^t)\w*_?(ns|nsec)$"), 1e-9),
    (re.compile(r"^(t|tout|time|time_?s|seconds|secs?|elapsed)$"), 1.0),
    (re.compile(r"^timestamp$"), 1e-6),
    (re.compile(r"time|stamp"), 1.0),
    (re.compile(r"(^|[ ._])ticks?$"), 1e-3),
)
_UNIT = re.compile(r"^(.*?\S)\s*[\[(](?!\d+[\])])([^\[\]()]*)[\])]$")
_DEGREES = re.compile(r"deg|dps|°")
_IN_DEGREES = ("RATE.", "SIDD.", "PIDR.", "PIDP.", "PIDY.")


ROS_AXES = (
    "[axes]   # of bodies in ROS (REP 103); leave it out where the gyro's y is to the right and its z down",
    'x = "forward"',
    'y = "left"',
    'z = "up"',
    "",
)
Values = Callable[[str], FloatArray | None]
"""The values of a field, shape (n,); None where they cannot be read."""


Proposed = tuple[str, ChannelSource, str]
"""A field or arithmetic, how it becomes a channel, and why."""


def propose(
    fields: Sequence[str],
    kind: str,
    found: Mapping[str, ChannelSource],
    time: tuple[str | None, float | None] = (None, None),
    values: Values | None = None,
) -> str:
    """TOML text of a profile for a log with these fields.

    found: channel -> where it came from, for those that were found; they stay as they are. time: source and scale, as
    the profile in use has them. values: of a field, by which scales are guessed that no name tells.
    """
    lines = [FIRST_LINE, 'name = "mine"', ""]
    looked = values or _unseen
    lines += _time(fields, kind, time, looked)
    guesses = _of_one_gyro({channel: _guess(channel, fields, looked) for channel in (*REQUIRED[1:], "r", "omega")})
    pitching = guesses["q"]
    if kind == "mcap" and "q" not in found and pitching is not None and pitching[0].endswith(".y"):
        lines += ROS_AXES
    for channel in dict.fromkeys((*REQUIRED[1:], *found, "r", "omega")):
        if channel in found:
            lines += _entry(channel, found[channel].sources[0], found[channel], "found")
            continue
        guess = guesses.get(channel)
        if guess is not None:
            lines += _entry(channel, *guess)
        elif channel in REQUIRED:
            lines += [
                f"[channels.{channel}]   # {CHANNELS[channel]}; no name in this log looks like it",
                'source = "FIELD"   # write a field, or arithmetic on fields such as "(m3 + m4 - m1 - m2) / 2"',
                "",
            ]
    return "\n".join(lines)


def _of_one_gyro(guesses: Mapping[str, Proposed | None]) -> dict[str, Proposed | None]:
    """The guesses, all rates in the unit of the one that moved most: slow deg/s look like rad/s."""
    told = [guess for name in ("p", "q", "r") if (guess := guesses[name]) is not None and BY_VALUES in guess[2]]
    if all(guess[1].scale == 1.0 for guess in told):
        return dict(guesses)
    field, source, why = next(guess for guess in told if guess[1].scale != 1.0)
    return {
        name: (one[0], replace(one[1], scale=source.scale), f"{why}, as {field}" if one[0] != field else why)
        if one in told
        else one
        for name, one in guesses.items()
    }


def _unseen(field: str) -> None:
    return None


def _time(fields: Sequence[str], kind: str, time: tuple[str | None, float | None], values: Values) -> list[str]:
    source, scale = time
    why = "to seconds"
    if source is None and (kind not in TABLES or kind == "mcap"):
        clock = "each topic's own clock" if kind == "mcap" else "the log's own clock"
        return [f"# time: {clock}, no [time] needed", ""]
    if source is None or source not in (*fields, *(_plain(name) for name in fields)):
        named = [(field, _plain(field).lower()) for field in fields]
        if kind in ARRAYS:
            named = [(field, name.rpartition(".")[2]) for field, name in named]
        guess = next(((field, s) for pattern, s in _TIMES for field, name in named if pattern.search(name)), None)
        if guess is None:
            return ["[time]   # no name in this log looks like it", 'source = "TIME_COLUMN"', "scale = 1.0", ""]
        source, scale = guess
        written = factor("t", _unit(source))
        if _unit(source) and written is not None:
            scale = written
        elif (column := values(source)) is not None and (told := time_guess(column)) is not None:
            scale, why = told.scale, f"to seconds; guessed: {told.why}"
    return ["[time]", f"source = {_quoted(source)}", f"scale = {scale or 1.0:.12g}   # {why}", ""]


def _guess(channel: str, fields: Sequence[str], values: Values) -> Proposed | None:
    same = next((field for field in fields if _plain(field) == channel), None)
    if same is not None:
        told = _scale(channel, same, values)
        return same, ChannelSource(channel, (same,), told.scale, told.offset), f"by its name; {told.why}"
    for pattern in GUESSES.get(channel, ()):
        for field in fields:
            name = _plain(field).lower()
            name = (
                re.sub(r"[ ._]?(deg|rad|°)?[ ._/]?(per[ ._]?)?(s|sec)$|[ ._]?dps$", "", name)
                if _has_unit(name)
                else name
            )
            if re.search(pattern, name) and not _WANTED.search(name):
                told = _scale(channel, field, values)
                source = ChannelSource(channel, (field,), told.scale, told.offset)
                return field, source, f"guessed by name: check the sign; {told.why}"
    motors = {match[1]: field for field in fields if (match := _MOTORS.match(_plain(field).lower()))}
    if channel in ("delta_x", "delta_y") and len(motors) == 4 and all(m.isidentifier() for m in motors.values()):
        m1, m2, m3, m4 = (motors[number] for number in "1234")
        signs = f"-{m1} - {m2} + {m3} + {m4}" if channel == "delta_x" else f"{m1} - {m2} - {m3} + {m4}"
        why = "guessed: X frame with the motors in Bitcraze's order; check the order, divide by twice full command"
        return f"({signs}) / 2", ChannelSource(channel, (f"({signs}) / 2",)), why
    return None


def _has_unit(name: str) -> bool:
    return re.search(r"(deg|rad|°)[ ._/]?(per[ ._]?)?(s|sec)$|dps$", name) is not None


def _scale(channel: str, field: str, values: Values) -> Guess:
    """By the unit behind the name, by the name, or by the values."""
    unit = CHANNELS[channel]
    written = _unit(field)
    if written:
        known = factor(channel, written)
        return (
            Guess(1.0, f"unit {written} not known, in {unit}?")
            if known is None
            else Guess(known, f"{written} to {unit}")
        )
    if channel == "omega":
        return Guess(math.tau / 60, "1/min to rad/s") if "rpm" in field.lower() else Guess(1.0, "in rad/s?")
    if unit == "rad/s" and (_DEGREES.search(field.lower()) or field.startswith(_IN_DEGREES)):
        return Guess(math.pi / 180, "deg/s to rad/s")
    if _PID_SUMS.match(field.lower()):
        return Guess(1 / 500, "Betaflight's PID sums, 500 for full command")
    by_values = {"rad/s": rate_guess, "-1..1": command_guess}.get(unit)
    column = None if by_values is None else values(field)
    told = None if by_values is None or column is None else by_values(column)
    return told or Guess(1.0, f"in {unit}?")


def _entry(channel: str, text: str, source: ChannelSource, why: str) -> list[str]:
    lines = [f"[channels.{channel}]   # {CHANNELS[channel]}; {printable(why)}", f"source = {_quoted(text)}"]
    if source.scale != 1.0:
        lines.append(f"scale = {source.scale!r}")
    if source.offset:
        lines.append(f"offset = {source.offset!r}")
    return [*lines, ""]


def _plain(field: str) -> str:
    match = _UNIT.match(field)
    return field if match is None else match[1]


def _unit(field: str) -> str:
    match = _UNIT.match(field)
    return "" if match is None else match[2].strip()


def _quoted(text: str) -> str:
    """A TOML basic string."""
    return json.dumps(printable(text))
