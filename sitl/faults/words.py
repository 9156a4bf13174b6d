"""The faults as options of a command line, and what they mean.

Times are the vehicle's own seconds, which begin at 1; with `sweep+` before them they count from when the first sweep
began, with `order+` from when the ground first ordered one. FROM:UNTIL is a window, either end may be left out; a
single number is a moment. `sitl.faults.script` reads the same words from a file.
"""

from __future__ import annotations

import argparse
import itertools
import math
from collections.abc import Callable
from functools import partial
from typing import Any, TypeVar

from sitl.autopilot.modes import Mode
from sitl.faults.air import (
    QUEUE_BYTES,
    Bandwidth,
    Corruption,
    Duplicates,
    During,
    Faults,
    Lag,
    Loss,
    Reordering,
    Stage,
    Trouble,
    Voice,
)
from sitl.faults.impostor import Impostor, claim
from sitl.faults.on_board import ClockStep, DeadGyro, LogStop, Restart, SlowLog, WrongWrites
from sitl.faults.others import (
    Order,
    OtherStation,
    SecondVehicle,
    StartWatch,
    StrayHeartbeat,
    parameter_write,
    start_of_log,
)
from sitl.faults.windows import ALWAYS, Outage, Way, Window

TIMES = (
    "Most take @WHEN behind the value (--lag 3.5@20:40): FROM:UNTIL in seconds of the vehicle's own time, which begins "
    "at 1; either end may be left out. With sweep+ before it (@sweep+3:8) it counts from the start of the first sweep, "
    "with order+ from the ground's first order to start one. Each may be given several times; drawn from --seed."
)
MANY = {
    "loss": ("SHARE", "of packets lost, such as 0.02"),
    "outage": ("WAY", "nothing passes up (to the vehicle), down or both ways; without @WHEN always"),
    "lag": ("S", "everything comes S seconds later, each way, in order"),
    "lag-up": ("S", "the same, only to the vehicle"),
    "lag-down": ("S", "the same, only to the ground"),
    "jitter": ("S", "everything comes up to S seconds later, each way, and may swap"),
    "bandwidth": ("RATE", "bytes a second that the link carries, each way; a 57,600 baud radio 5760"),
    "duplicate": ("SHARE", "of packets that come twice"),
    "reorder": ("SHARE", "of packets that others overtake"),
    "corrupt": ("SHARE", "of packets with a wrong byte"),
    "second-vehicle": ("MODE", "heartbeats of another vehicle with this id (stabilize); at a moment, @S, a single one"),
    "other-station": ("ORDER", "another station writes NAME=VALUE@S, or takes the log: log@S"),
    "log-stops": ("S", "no log blocks from S on; S,silent does not say so; S,resumes takes a new START"),
    "log-slows": ("RATE", "bytes a second of the log that the vehicle manages to send; it writes 50 to 75 kB"),
    "alter-writes": ("SHARE", "of written parameters of which the vehicle stores another value"),
    "refuse-writes": ("SHARE", "of written parameters that stay as they are"),
    "reboot": ("S", "the vehicle starts anew at S, in the air or on the ground, and its clock with it"),
    "clock-step": ("S@WHEN", "its clock goes on by S seconds at a moment"),
    "gyro-nan": ("WHEN", "its gyro gives no numbers, FROM:UNTIL"),
    "forge": (
        "WHAT",
        "forged on this link: of the vehicle heartbeat=MODE, text=WORDS or block=N, of the ground mode=MODE or log; "
        "@S once, @FROM:UNTIL each second",
    ),
    "spoof": ("WHAT", "the same from another address with the same id"),
}
"""Options that can be given several times: what follows them, and the line of help."""
ONE = {
    "queue": ("BYTES", f"wait for the bandwidth before packets are dropped ({QUEUE_BYTES})"),
    "duplicate-within": ("S", "the second one comes up to S seconds later (0)"),
}
FLAGS = {"second-attitude": "the second vehicle sends its attitude, too"}
DATAGRAMS = ("loss", "outage", "jitter", "duplicate", "reorder", "corrupt", "spoof")
"""Faults that a stream of bytes without frames cannot have."""

_Word = TypeVar("_Word")
_Value = TypeVar("_Value")
_Clock = Callable[[], float]


def add_options(parser: argparse.ArgumentParser) -> None:
    group = parser.add_argument_group("faults", TIMES)
    for name, (word, text) in MANY.items():
        bare = {"nargs": "?", "const": ""} if name == "second-vehicle" else {}
        options: dict[str, Any] = {"action": "append", "default": [], "metavar": word, "help": text, **bare}
        group.add_argument(f"--{name}", **options)
    for name, (word, text) in ONE.items():
        group.add_argument(f"--{name}", metavar=word, help=text)
    for name, text in FLAGS.items():
        group.add_argument(f"--{name}", action="store_true", help=text)


def given(arguments: argparse.Namespace, names: tuple[str, ...] = (*MANY, *ONE, *FLAGS)) -> list[str]:
    """Which of these options were given, as they are written."""
    return [f"--{name}" for name in names if getattr(arguments, name.replace("-", "_"))]


def read(arguments: argparse.Namespace, sweep_s: _Clock) -> Faults:
    """What the options say. `sweep_s` tells when the first sweep began, and is asked only in flight.

    Raises ValueError with the option and what is wrong with it.
    """
    reader = _Reader(arguments, sweep_s)
    return Faults(
        up=(reader.watch, *reader.stages(Way.UP)),
        down=reader.stages(Way.DOWN),
        vehicles=reader.vehicles(),
        stations=reader.stations(),
        on_board=reader.troubles(),
        forged=reader.impostors("forge"),
        spoofed=reader.impostors("spoof"),
    )


class _Reader:
    """Options into faults. Every stage draws from the seed, its name and its direction."""

    def __init__(self, arguments: argparse.Namespace, sweep_s: _Clock) -> None:
        self._arguments = arguments
        self.watch = StartWatch()
        self._zeros = {"sweep": sweep_s, "order": lambda: self.watch.first_s}
        self._outages = Loss(0.0, arguments.seed, self._all("outage", self._outage))
        self._losses = self._windows("loss", lambda share, seed: Loss(share, seed), int(arguments.seed))

    def _all(self, name: str, make: Callable[[str], _Value]) -> list[_Value]:
        """One value for each time that the option was given."""
        words = getattr(self._arguments, name.replace("-", "_"))
        words = words if isinstance(words, list) else [] if words is None else [words]
        return [_named(f"--{name}", word, make) for word in words]

    def _windows(self, name: str, make: Callable[[float, int], _Value], seed: int) -> list[tuple[_Value, Window]]:
        """What `make` makes of the number and a seed of its own, and when it is there; for each time that the option
        was given."""
        seeds = itertools.count(seed, 1 << 32)

        def made(word: str) -> tuple[_Value, Window]:
            text, window = self._windowed(word)
            return make(_number(text), next(seeds)), window

        return self._all(name, made)

    def _during(self, name: str, make: Callable[[float, int], Stage], way: Way) -> list[Stage]:
        seed = 2 * int(self._arguments.seed) + (way is Way.DOWN)
        return [During(stage, window) for stage, window in self._windows(name, make, seed)]

    def stages(self, way: Way) -> tuple[Stage, ...]:
        """As in a radio: what waits for the line comes before what is lost in the air, the lag after both."""
        within_s = sum(self._all("duplicate-within", _number))
        own, lost = ("lag-up", Loss.up) if way is Way.UP else ("lag-down", Loss.down)
        return (
            *self._during("duplicate", lambda share, seed: Duplicates(share, seed, within_s=within_s), way),
            *self._all("bandwidth", self._bandwidth),
            partial(lost, self._outages),
            *(During(partial(lost, loss), window) for loss, window in self._losses),
            *self._during("corrupt", Corruption, way),
            *self._during("reorder", Reordering, way),
            *self._all("lag", self._lag),
            *self._all(own, self._lag),
            *self._during("jitter", lambda jitter_s, seed: Lag(0.0, jitter_s=jitter_s, seed=seed), way),
        )

    def vehicles(self) -> tuple[Voice, ...]:
        return tuple(self._all("second-vehicle", self._second_vehicle))

    def stations(self) -> tuple[Voice, ...]:
        orders = self._all("other-station", self._order)
        return (OtherStation(orders),) if orders else ()

    def troubles(self) -> tuple[Trouble, ...]:
        return (
            *self._all("log-stops", self._log_stop),
            *self._all("log-slows", lambda word: SlowLog(*self._number_in_window(word))),
            *self._writes("alter-writes", refused=False),
            *self._writes("refuse-writes", refused=True),
            *self._all("reboot", lambda word: Restart(self._at(word))),
            *self._all("clock-step", self._clock_step),
            *self._all("gyro-nan", lambda word: DeadGyro(self._window(word))),
        )

    def _writes(self, name: str, *, refused: bool) -> list[WrongWrites]:
        seeds = itertools.count(int(self._arguments.seed), 1 << 32)

        def made(word: str) -> WrongWrites:
            share, window = self._number_in_window(word)
            return WrongWrites(share, next(seeds), window, refused=refused)

        return self._all(name, made)

    def impostors(self, name: str) -> tuple[Impostor, ...]:
        seeds = itertools.count(int(self._arguments.seed), 1 << 32)

        def made(word: str) -> Impostor:
            what, at, when = word.rpartition("@")
            if not at:
                raise ValueError("WHAT@S or WHAT@FROM:UNTIL is wanted, such as heartbeat=rtl@20")
            number = _mode(what.partition("=")[2]) if what.partition("=")[0] in ("heartbeat", "mode") else 0
            return Impostor(claim(what, number, next(seeds)), self._window(when), again=":" in when)

        return tuple(self._all(name, made))

    def _clock_step(self, word: str) -> ClockStep:
        text, at, when = word.partition("@")
        if not at:
            raise ValueError("S@WHEN is wanted, such as 3600@sweep+2")
        return ClockStep(_number(text), self._at(when))

    def _number_in_window(self, word: str) -> tuple[float, Window]:
        text, window = self._windowed(word)
        return _number(text), window

    def _at(self, when: str) -> Window:
        if ":" in when:
            raise ValueError("a moment is wanted, such as 20 or sweep+2")
        return self._window(when)

    def _outage(self, word: str) -> Outage:
        way, window = self._windowed(word)
        if way not in {known.value for known in Way}:
            raise ValueError("up, down or both is wanted, such as up or up@20:32")
        return Outage(window.start_s, window.stop_s, window.zero_s, Way(way))

    def _lag(self, word: str) -> Lag:
        text, window = self._windowed(word)
        return Lag(_number(text), window=window)

    def _bandwidth(self, word: str) -> Bandwidth:
        text, window = self._windowed(word)
        (queue,) = self._all("queue", _number) or [QUEUE_BYTES]
        return Bandwidth(_number(text), queue_bytes=int(queue), window=window)

    def _second_vehicle(self, word: str) -> Voice:
        mode, at, when = word.partition("@")
        number = _mode(mode)
        if at and ":" not in when:
            return StrayHeartbeat(number, self._window(when))
        window = self._window(when) if at else ALWAYS
        return SecondVehicle(number, window=window, attitude=self._arguments.second_attitude)

    def _order(self, word: str) -> Order:
        what, at, when = word.rpartition("@")
        name, equals, value = what.partition("=")
        if not at or ":" in when or (what != "log" and not equals):
            raise ValueError("NAME=VALUE@S or log@S is wanted, such as SID_MAGNITUDE=0.5@20")
        return Order(parameter_write(name, _number(value)) if equals else start_of_log(), self._window(when))

    def _log_stop(self, word: str) -> LogStop:
        when, *how = word.split(",")
        if ":" in when or not set(how) <= {"silent", "resumes"}:
            raise ValueError("a moment is wanted, then silent or resumes or both, such as 20 or 20,silent")
        at = self._window(when)
        if "silent" in how:
            return LogStop(at, reason=None, resumes="resumes" in how)
        return LogStop(at, resumes="resumes" in how)

    def _windowed(self, word: str) -> tuple[str, Window]:
        text, at, when = word.partition("@")
        if at and ":" not in when:
            raise ValueError("after @ FROM:UNTIL is wanted, such as 20:32, or 20: without an end")
        return text, self._window(when) if at else ALWAYS

    def _window(self, when: str) -> Window:
        """FROM:UNTIL, or a moment, which is a window without an end."""
        origin, plus, counted = when.rpartition("+")
        if plus and origin not in self._zeros:
            raise ValueError(f"times count from {' or '.join(self._zeros)}, such as sweep+3")
        start, _, stop = counted.partition(":")
        start_s = _number(start) if start or ":" not in counted else -math.inf
        window = (start_s, _number(stop) if stop else math.inf)
        if not window[0] < window[1]:
            raise ValueError("it ends before it begins")
        return Window(*window, self._zeros[origin]) if plus else Window(*window)


def _named(option: str, word: _Word, make: Callable[[_Word], _Value]) -> _Value:
    """The value of the word; what is wrong with it names the option."""
    try:
        return make(word)
    except ValueError as error:
        raise ValueError(f"{option} {word}: {error}") from error


def _number(text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise ValueError(f"{text!r} is no number")
    return value


def _mode(text: str) -> int:
    """A mode's name or number; Stabilize where there is none."""
    name = (text or "stabilize").upper()
    if name in Mode.__members__:
        return int(Mode[name])
    if text.isascii() and text.isdigit() and int(text) < 2**32:
        return int(text)
    raise ValueError("a mode is wanted: " + ", ".join(mode.name.lower() for mode in Mode) + ", or a number")
