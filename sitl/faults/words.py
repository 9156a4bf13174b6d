"""The faults as options of a command line, and what they mean.

Times are the vehicle's own seconds, which begin at 1; with `sweep+` before them they count from when the first sweep
began, with `order+` from when the ground first ordered one. FROM:UNTIL is a window, either end may be left out; a
single number is a moment.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Callable
from typing import Any, TypeVar

from sitl.autopilot.modes import Mode
from sitl.faults.air import (
    QUEUE_BYTES,
    Bandwidth,
    Corruption,
    Duplicates,
    Faults,
    Lag,
    Loss,
    Reordering,
    Stage,
    Trouble,
    Voice,
)
from sitl.faults.on_board import LogStop
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
    "with order+ from the ground's first order to start one. Drawn from --seed."
)
MANY = {
    "outage": ("WAY", "nothing passes up (to the vehicle), down or both ways; without @WHEN always; repeatable"),
    "lag": ("S", "everything comes S seconds later, each way, in order; repeatable"),
    "lag-up": ("S", "the same, only to the vehicle"),
    "lag-down": ("S", "the same, only to the ground"),
    "second-vehicle": ("MODE", "heartbeats of another vehicle with this id (stabilize); at a moment, @S, a single one"),
    "other-station": ("ORDER", "another station writes NAME=VALUE@S, or takes the log: log@S; repeatable"),
}
"""Options that can be given several times: what follows them, and the line of help."""
ONE = {
    "jitter": ("S", "everything comes up to S seconds later, each way, and may swap"),
    "bandwidth": ("RATE", "bytes a second that the link carries, each way; a 57,600 baud radio 5760"),
    "queue": ("BYTES", f"wait for the bandwidth before packets are dropped ({QUEUE_BYTES})"),
    "duplicate": ("SHARE", "of packets that come twice"),
    "duplicate-within": ("S", "the second one comes up to S seconds later (0)"),
    "reorder": ("SHARE", "of packets that others overtake"),
    "corrupt": ("SHARE", "of packets with a wrong byte"),
    "log-stops": ("S", "no log blocks from S on; S,silent does not say so; S,resumes takes a new START"),
}
FLAGS = {"second-attitude": "the second vehicle sends its attitude, too"}
DATAGRAMS = ("outage", "jitter", "duplicate", "reorder", "corrupt")
"""Faults that a stream of bytes without frames cannot have."""

_Word = TypeVar("_Word")
_Value = TypeVar("_Value")
_Clock = Callable[[], float]


def add_options(parser: argparse.ArgumentParser) -> None:
    group = parser.add_argument_group("faults", TIMES)
    group.add_argument("--loss", type=float, default=0.0, metavar="SHARE", help="of UDP packets, e.g. 0.02")
    for name, (word, text) in MANY.items():
        bare = {"nargs": "?", "const": ""} if name == "second-vehicle" else {}
        options: dict[str, Any] = {"action": "append", "default": [], "metavar": word, "help": text, **bare}
        group.add_argument(f"--{name}", **options)
    for name, (word, text) in ONE.items():
        group.add_argument(f"--{name}", metavar=word, help=text)
    for name, text in FLAGS.items():
        group.add_argument(f"--{name}", action="store_true", help=text)


def given(arguments: argparse.Namespace, names: tuple[str, ...] = (*MANY, *ONE, *FLAGS)) -> list[str]:
    """Which of these options were given, as they are written; --loss apart."""
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
    )


class _Reader:
    """Options into faults. Every stage draws from the seed, its name and its direction."""

    def __init__(self, arguments: argparse.Namespace, sweep_s: _Clock) -> None:
        self._arguments = arguments
        self.watch = StartWatch()
        self._zeros = {"sweep": sweep_s, "order": lambda: self.watch.first_s}
        outages = self._all("outage", self._outage)
        self._loss = _named("--loss", arguments.loss, lambda share: Loss(share, arguments.seed, outages))

    def _seed(self, way: Way) -> int:
        return 2 * int(self._arguments.seed) + (way is Way.DOWN)

    def _all(self, name: str, make: Callable[[str], _Value]) -> list[_Value]:
        """One value for each time that the option was given."""
        words = getattr(self._arguments, name.replace("-", "_"))
        words = words if isinstance(words, list) else [] if words is None else [words]
        return [_named(f"--{name}", word, make) for word in words]

    def stages(self, way: Way) -> tuple[Stage, ...]:
        """As in a radio: what waits for the line comes before what is lost in the air, the lag after both."""
        seed = self._seed(way)
        within_s = sum(self._all("duplicate-within", _number))
        own = "lag-up" if way is Way.UP else "lag-down"
        return (
            *self._all("duplicate", lambda word: Duplicates(_number(word), seed, within_s=within_s)),
            *self._all("bandwidth", self._bandwidth),
            self._loss.up if way is Way.UP else self._loss.down,
            *self._all("corrupt", lambda word: Corruption(_number(word), seed)),
            *self._all("reorder", lambda word: Reordering(_number(word), seed)),
            *self._all("lag", self._lag),
            *self._all(own, self._lag),
            *self._all("jitter", lambda word: Lag(0.0, jitter_s=_number(word), seed=seed)),
        )

    def vehicles(self) -> tuple[Voice, ...]:
        return tuple(self._all("second-vehicle", self._second_vehicle))

    def stations(self) -> tuple[Voice, ...]:
        orders = self._all("other-station", self._order)
        return (OtherStation(orders),) if orders else ()

    def troubles(self) -> tuple[Trouble, ...]:
        return tuple(self._all("log-stops", self._log_stop))

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
