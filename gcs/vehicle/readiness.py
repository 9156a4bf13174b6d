"""Whether an ArduPilot's own settings let a card be flown and logged: each as it is, what to set, and why.

Pure: settings in, items out. Nothing is proposed that the card does not need. A setting that the vehicle does not have
is no item of its own; one that is not known must not reach this place (`gcs.flight.settings.ask_together`).

Of ArduCopter 4.5 to 4.7. SIDD and RATE are written in every loop where LOG_BITMASK has both of ATTITUDE_FAST (bit 0)
and ATTITUDE_MED (bit 1), in every second with the first alone, every fourth with the second, else in every eighth.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from enum import Enum
from typing import Final

from gcs.vehicle.autopilots import LOG_BACKEND, LOG_BITMASK, LOOP_RATE, RENAMED, lean_limit_deg, link_loss
from gcs.vehicle.own_log import ENOUGH_BUFFER, SAMPLES_OF_A_PERIOD, cost_of
from gcs.vehicle.profile import VehicleProfile

BUFFER: Final = "LOG_MAV_BUFSIZE"
DISARMED: Final = "LOG_DISARMED"
LOGS_TO_CARD: Final = f"on ArduPilot {LOG_BACKEND} 1 or 3"
GYRO_FILTER: Final = "INS_GYRO_FILTER"
ARMING, ARMING_SKIPS = "ARMING_CHECK", "ARMING_SKIPCHK"
_LINK_LOSS: Final = ("FS_GCS_ENABLE", "FS_OPTIONS", "FS_GCS_TIMEOUT", "FS_THR_ENABLE")
OF_LOG: Final = (LOG_BACKEND, LOG_BITMASK, BUFFER, DISARMED, LOOP_RATE)
ASKED: Final = (
    *(*OF_LOG, GYRO_FILTER, ARMING, ARMING_SKIPS),
    *(*_LINK_LOSS, *(name for pair in RENAMED for name in pair)),
)
"""What is read, beside what a maneuver writes."""

_FILE, _STREAM, _ANY_FILE = 1, 2, 5
_FAST, _MEDIUM = 1, 2
_LOGGING_CHECK, _ALL_CHECKS = 1024, 1
_CONTINUE_PILOT_CONTROL = 16
BYTES_A_SAMPLE: Final = 285_000 / 400
"""What ArduPilot's log takes for each time that SIDD and RATE are written: 285 kB/s were measured at 400 Hz."""
LEAST_NEED: Final = 25_000
"""Bytes a second of the leanest log that was ever flown with."""
LARGEST_BUFFER_KB: Final = 53
"""Above it the vehicle's count of blocks overflows."""
HELD_S: Final = 0.1
"""What the buffer must hold: a block is sent again after as much."""


class Standing(Enum):
    """What an item means for a card."""

    MUST = "must be changed"
    BETTER = "could be better"
    FINE = "in order"


@dataclass(frozen=True, slots=True, kw_only=True)
class Item:
    """One thing looked at."""

    name: str
    standing: Standing
    value: str
    """As it is."""
    words: str
    """What to do, and why; or what it means."""
    wanted: tuple[tuple[str, float], ...] = ()
    """Settings that are proposed, to somebody who sets them himself."""
    restart: bool = False
    """They act after a restart of the autopilot."""

    @property
    def of_log(self) -> bool:
        """Whether it is a matter of the vehicle's log."""
        return self.name.startswith("LOG_") or self.name == "log"


@dataclass(frozen=True, slots=True, kw_only=True)
class Asked:
    """What a card asks of the vehicle, and over what it is flown."""

    f_stop_hz: float
    """The highest frequency swept."""
    stream: bool | None
    """The log comes over the link, or is taken from the vehicle afterwards; None: as the vehicle is set and the link
    allows."""
    carries: float | None
    """Bytes a second of the link, where its kind tells."""
    station: int
    """Our system id."""


def asked_of_log(carries: float | None) -> tuple[str, ...]:
    """What must be asked to know where the log goes, and whether a link that carries so much carries it, too."""
    return (LOG_BACKEND,) if carries is None else OF_LOG


def streams_log(settings: Mapping[str, float]) -> bool:
    """Whether the vehicle sends its log to a station that asks for it, as far as it tells."""
    return bool(int(settings.get(LOG_BACKEND, 0)) & _STREAM)


def tells_of_log(settings: Mapping[str, float]) -> bool:
    """Whether it says where its log goes."""
    return LOG_BACKEND in settings


def logged_hz(settings: Mapping[str, float]) -> float | None:
    """How often SIDD and RATE are written; None where the vehicle does not tell."""
    loop_hz, mask = settings.get(LOOP_RATE), settings.get(LOG_BITMASK)
    return None if loop_hz is None or mask is None else loop_hz / _every(int(mask))


def log_need(settings: Mapping[str, float]) -> float | None:
    """Bytes a second of the vehicle's log in a sweep, about; None where it does not tell."""
    hz = logged_hz(settings)
    return None if hz is None else max(LEAST_NEED, BYTES_A_SAMPLE * hz)


def too_slow(settings: Mapping[str, float], carries: float | None) -> bool:
    """Whether a link that carries so many bytes a second at most certainly does not carry the log."""
    return carries is not None and carries < (log_need(settings) or LEAST_NEED)


def way_of_log(settings: Mapping[str, float], asked: Asked) -> bool:
    """Whether the log comes over the link: as asked for, else as the vehicle is set, where the link carries it."""
    if asked.stream is not None:
        return asked.stream
    return (LOG_BACKEND not in settings or streams_log(settings)) and not too_slow(settings, asked.carries)


def items(settings: Mapping[str, float], asked: Asked, profile: VehicleProfile | None) -> tuple[Item, ...]:
    """All that the settings say, the log first. `profile` is None where the vehicle flies no maneuver at all."""
    stream = way_of_log(settings, asked)
    found = [
        _backend(settings, asked, stream),
        _bitmask(settings, asked, stream),
        _buffer(settings, stream, profile),
        _while_disarmed(settings),
        _arming(settings, stream),
        _lost_link(settings, asked),
        _lost_transmitter(settings),
        *([] if profile is None else [_left_ready(settings, profile)]),
        _loop(settings, asked),
        _gyro(settings),
        _lean(settings),
    ]
    return tuple(item for item in found if item is not None)


# ------------------------------------------------------------------------------------------------ the log


def _backend(settings: Mapping[str, float], asked: Asked, stream: bool) -> Item | None:
    value = settings.get(LOG_BACKEND)
    if value is None:
        return None
    bits, slow = int(value), too_slow(settings, asked.carries)
    standing, words, wanted = Standing.FINE, "", bits
    if stream and not bits & _STREAM:
        standing, wanted = Standing.MUST, bits | _STREAM
        words = "with bit 2 it streams its log; it is then armed only while a log client answers, as the app, "
        words += "`tippath check` and `tippath sweep --wait` do"
    elif stream:
        words = "it streams its log" + (", and keeps it on its card" if bits & _FILE else "")
    elif not bits & _ANY_FILE:
        standing, wanted = Standing.MUST, bits & ~_STREAM | _FILE
        words = "without bit 1 no log is kept on the vehicle's card, from which it is to be taken"
    elif bits & _STREAM:
        standing, wanted = (Standing.MUST if slow else Standing.BETTER), bits & ~_STREAM
        words = "its log would fill this link, and orders wait behind it, an abort too" if slow else "nobody needs "
        words += "" if slow else "the stream, and it is armed only while a log client answers it"
        words += "; log to the card alone, and fly `tippath sweep --log card`"
    else:
        words = "the log stays on the card: fly `tippath sweep --log card`, `tippath fetch` brings it after landing"
        words += "" if slow else f"; {bits | _STREAM} would stream it"
    return Item(
        name=LOG_BACKEND,
        standing=standing,
        value=f"{bits}",
        words=words,
        wanted=((LOG_BACKEND, float(wanted)),) if wanted != bits else (),
        restart=wanted != bits,
    )


def _every(mask: int) -> int:
    """Loops from one record to the next."""
    return {3: 1, 1: 2, 2: 4, 0: 8}[mask & (_FAST | _MEDIUM)]


def _bitmask(settings: Mapping[str, float], asked: Asked, stream: bool) -> Item | None:
    value, loop_hz, hz = settings.get(LOG_BITMASK), settings.get(LOOP_RATE), logged_hz(settings)
    if value is None or loop_hz is None or hz is None:
        return None
    needed = SAMPLES_OF_A_PERIOD * asked.f_stop_hz
    wanted = float(int(value) | _FAST | _MEDIUM)
    carried = not stream or asked.carries is None or asked.carries >= BYTES_A_SAMPLE * loop_hz
    standing, words = Standing.FINE, "every loop is logged"
    if hz < min(needed, loop_hz):
        standing = Standing.MUST
        words = f"a sweep to {asked.f_stop_hz:g} Hz needs {min(needed, loop_hz):g} Hz: set bits 0 and 1"
    elif hz < loop_hz:
        standing = Standing.BETTER if carried else Standing.FINE
        words = f"enough for a sweep to {asked.f_stop_hz:g} Hz, but {cost_of(hz, loop_hz)}"
        words += "; bit 0 logs every loop" if carried else "; this link does not carry every loop"
    return Item(
        name=LOG_BITMASK,
        standing=standing,
        value=f"{int(value)}: SIDD and RATE at {hz:g} Hz",
        words=words,
        wanted=() if standing is Standing.FINE else ((LOG_BITMASK, wanted),),
    )


def _buffer(settings: Mapping[str, float], stream: bool, profile: VehicleProfile | None) -> Item | None:
    value, need = settings.get(BUFFER), log_need(settings)
    if value is None or not stream:
        return None
    held_s = None if need is None else 1024 * value / need
    standing, words = Standing.FINE, "" if held_s is None else f"holds {held_s:.2f} s of the log"
    if value > LARGEST_BUFFER_KB and not (profile is not None and profile.offers_our_law):
        standing, words = Standing.MUST, f"above {LARGEST_BUFFER_KB} the vehicle's count of blocks overflows"
    elif held_s is not None and held_s < HELD_S:
        standing = Standing.MUST
        words = f"holds {held_s:.2f} s of the log: what waits longer is dropped (DMS.Dp counts it)"
    elif value < ENOUGH_BUFFER:
        standing = Standing.BETTER
        words += "; 50 rides out more of a poor link, and is needed where every loop is logged"
    return Item(
        name=BUFFER,
        standing=standing,
        value=f"{value:g} kB",
        words=words,
        wanted=() if standing is Standing.FINE else ((BUFFER, float(ENOUGH_BUFFER)),),
        restart=standing is not Standing.FINE,
    )


def _while_disarmed(settings: Mapping[str, float]) -> Item | None:
    value = settings.get(DISARMED)
    if value is None:
        return None
    words = "logs on the ground too" if value else "nothing is logged before it is armed"
    return Item(name=DISARMED, standing=Standing.FINE, value=f"{value:g}", words=words)


# ------------------------------------------------------------------------------------------------ around a maneuver


def _arming(settings: Mapping[str, float], stream: bool) -> Item | None:
    name = ARMING if ARMING in settings else ARMING_SKIPS
    if name not in settings:
        return None
    value = int(settings[name])
    checked = bool(value & (_ALL_CHECKS | _LOGGING_CHECK)) if name == ARMING else not value & _LOGGING_CHECK
    standing, words = Standing.FINE, "the log is checked before arming" if checked else "the log is not checked"
    if name == ARMING and value == 0:
        standing, words = Standing.BETTER, "nothing at all is checked before arming; 1 checks all"
    elif stream and checked:
        words += ', else "Logging failed": `tippath` answers it so that it can be armed'
    return Item(name=name, standing=standing, value=f"{value}", words=words)


def _lost_link(settings: Mapping[str, float], asked: Asked) -> Item:
    loss = link_loss(settings, asked.station)
    wanted: list[tuple[str, float]] = []
    if loss.ends_sweep is False:
        if not settings.get("FS_GCS_ENABLE"):
            wanted.append(("FS_GCS_ENABLE", 1.0))
        options = int(settings.get("FS_OPTIONS", 0))
        if options & _CONTINUE_PILOT_CONTROL:
            wanted.append(("FS_OPTIONS", float(options & ~_CONTINUE_PILOT_CONTROL)))
    holds = "with these, and `--primary`, it would return" if wanted else ""
    return Item(
        name="lost link",
        standing=Standing.BETTER if loss.ends_sweep is False else Standing.FINE,
        value=loss.answer,
        words=holds,
        wanted=tuple(wanted),
    )


def _lost_transmitter(settings: Mapping[str, float]) -> Item | None:
    value = settings.get("FS_THR_ENABLE")
    if value is None:
        return None
    if value:
        return Item(
            name="FS_THR_ENABLE", standing=Standing.FINE, value=f"{value:g}", words="notices a lost transmitter"
        )
    words = "a lost transmitter is not noticed, and nobody could end a sweep; 1 returns"
    return Item(
        name="FS_THR_ENABLE", standing=Standing.BETTER, value="0", words=words, wanted=(("FS_THR_ENABLE", 1.0),)
    )


def _left_ready(settings: Mapping[str, float], profile: VehicleProfile) -> Item | None:
    names = profile.parameters["axis"], profile.parameters["amplitude"]
    if not all(name in settings for name in names):
        return None
    axis, magnitude = (settings[name] for name in names)
    dangerous = profile.dangerous(axis, magnitude)
    words = "a sweep writes them, and puts them back"
    if dangerous:
        words = f"dangerous, should anybody enter {profile.name}'s mode by a switch; axis 0 refuses that"
    return Item(
        name=names[0],
        standing=Standing.BETTER if dangerous else Standing.FINE,
        value=f"{axis:g}, {names[1]} {magnitude:g}",
        words=words,
        wanted=((names[0], 0.0),) if dangerous else (),
    )


def _loop(settings: Mapping[str, float], asked: Asked) -> Item | None:
    hz = settings.get(LOOP_RATE)
    if not hz:
        return None
    words = f"{hz / asked.f_stop_hz:.0f} loops in a period of {asked.f_stop_hz:g} Hz"
    return Item(name=LOOP_RATE, standing=Standing.FINE, value=f"{hz:g} Hz", words=words)


def _gyro(settings: Mapping[str, float]) -> Item | None:
    hz = settings.get(GYRO_FILTER)
    if hz is None:
        return None
    late_ms = 1000 * math.sqrt(2) / (2 * math.pi * hz) if hz > 0 else 0.0
    words = f"RATE's gyro is {late_ms:.0f} ms late by it; it is part of what is fitted" if hz > 0 else "unfiltered"
    return Item(name=GYRO_FILTER, standing=Standing.FINE, value=f"{hz:g} Hz", words=words)


def _lean(settings: Mapping[str, float]) -> Item | None:
    degrees = lean_limit_deg(settings)
    if degrees is None:
        return None
    return Item(name="lean stop", standing=Standing.FINE, value=f"{degrees:.0f}°", words="beyond it a sweep ends")
