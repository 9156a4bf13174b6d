"""`python -m sitl`: one simulated vehicle, until it is interrupted.

The first line on standard output says as JSON that it is ready and where the ground station reaches it. After that
standard input takes the pilot's lines and standard output their replies. What is hidden is sealed beside the logs
before it says anything, and neither the line nor the log tells it.
"""

from __future__ import annotations

import argparse
import json
import math
import os
import signal
import sys
from collections.abc import Callable
from pathlib import Path

from sitl.autopilot.clothes import CLOTHES
from sitl.autopilot.running import run
from sitl.autopilot.storage import DEFAULT_BYTES_PER_S, WAYS, LogStorage
from sitl.autopilot.vehicle import Vehicle, make_vehicle
from sitl.clock import FreeClock, WallClock
from sitl.faults import Faults, FaultyLink
from sitl.faults import words as fault_words
from sitl.faults.script import read_script
from sitl.hidden import HOVER, Hidden, draw, plant_one
from sitl.hidden.seal import FILE_NAME, seal_answer
from sitl.pilot import PilotLines, obey
from sitl.plants import PLANTS
from sitl.plants.conditions import CONDITIONS
from sitl.protocol.links import Link, LinkError, UdpLink, open_link
from sitl.protocol.server import Server
from sitl.protocol.signatures import Signatures, read_key

DEFAULT_LINK = "udpout:127.0.0.1:14550"


class _Refused(Exception):
    """Ends the program with a message and no traceback."""

    def __init__(self, message: str, status: int) -> None:
        super().__init__(message)
        self.status = status


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="python -m sitl", description="The simulated vehicle, until interrupted.")
    parser.add_argument(
        "--plant",
        choices=(*PLANTS, "quad"),
        help=f"what flies (default: hover; with --hidden and --condition {HOVER}; quad with --like ardupilot-quad)",
    )
    parser.add_argument("--like", choices=tuple(CLOTHES), help="as which autopilot it behaves, out of the box")
    parser.add_argument("--gain-switch", action="store_true", help="with the script of a second set of gains (--like)")
    parser.add_argument("--hidden", metavar="EFFECT|random|none", help="plant it and seal the answer in DIR")
    parser.add_argument("--condition", choices=tuple(CONDITIONS), help="how lively the flight is (default: calm)")
    parser.add_argument("--rpm", type=float, metavar="N", help="the governor holds this rotor speed (hover-ideal)")
    parser.add_argument(
        "--listen",
        metavar="LINK",
        help=f"udpout:HOST:PORT, udpin:HOST:PORT, tcpin:HOST:PORT or pty; port 0 is a free one ({DEFAULT_LINK})",
    )
    parser.add_argument("--seed", type=int, default=1, help="of gusts, sensors, noise and sizes (default: %(default)s)")
    parser.add_argument(
        "-o", "--directory", type=Path, default=Path("vehicle-logs"), metavar="DIR", help="its logs (%(default)s)"
    )
    parser.add_argument("--on-ground", action="store_true", help="start disarmed instead of hovering")
    parser.add_argument(
        "--set", dest="settings", action="append", default=[], metavar="NAME=VALUE", help="a parameter; repeatable"
    )
    parser.add_argument("--speed", metavar="N", help="N times real time, or max; without a link")
    parser.add_argument("--duration", type=float, metavar="S", help="end after S seconds of the vehicle's time")
    parser.add_argument("--until-input-ends", action="store_true", help="end when standard input is closed")
    parser.add_argument(
        "--logs-by",
        choices=("both", "log", "ftp", "none"),
        default="both",
        help="how the ground may fetch its logs: LOG_REQUEST_DATA, MAVFTP (%(default)s)",
    )
    parser.add_argument(
        "--log-rate",
        type=float,
        default=DEFAULT_BYTES_PER_S,
        metavar="RATE",
        help="bytes a second that fetching them takes of the link (%(default)s)",
    )
    parser.add_argument("--key", type=Path, metavar="FILE", help="sign all, and obey only what is signed with this key")
    parser.add_argument(
        "--faults", action="append", default=[], type=Path, metavar="FILE.toml", help="these options in a file"
    )
    fault_words.add_options(parser)
    return parser


def _arguments(words: list[str] | None) -> argparse.Namespace:
    """With what the scripts say behind what was given."""
    given = sys.argv[1:] if words is None else words
    arguments = _parser().parse_args(given)
    try:
        scripts = [option for path in arguments.faults for option in read_script(path)]
    except ValueError as error:
        raise _Refused(f"--faults {error}", 2) from error
    return _parser().parse_args([*given, *scripts]) if scripts else arguments


def _settings(words: list[str]) -> dict[str, float]:
    settings = {}
    for word in words:
        name, _, text = word.partition("=")
        try:
            settings[name] = float(text)
        except ValueError as error:
            raise _Refused(f"--set {word}: NAME=VALUE is wanted, with a number", 2) from error
    return settings


def _hidden(arguments: argparse.Namespace) -> Hidden | None:
    word = arguments.hidden
    if word is None:
        return None
    try:
        if word == "random":
            return draw(arguments.seed, arguments.plant)
        return plant_one(word, arguments.seed, arguments.plant)
    except ValueError as error:
        raise _Refused(f"--hidden {word}: {error}", 2) from error


def _vehicle(arguments: argparse.Namespace, hidden: Hidden | None) -> Vehicle:
    settings, storage = _settings(arguments.settings), _storage(arguments)
    try:
        arguments.directory.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise _Refused(f"{arguments.directory}: {error.strerror}; choose another directory with -o", 1) from error
    try:
        if hidden is not None and (arguments.directory / FILE_NAME).exists():
            raise _Refused(f"{arguments.directory} holds a sealed answer already; choose another directory with -o", 2)
        vehicle = make_vehicle(
            arguments.plant,
            arguments.seed,
            directory=arguments.directory,
            on_ground=arguments.on_ground,
            parameters=settings,
            hidden=hidden,
            condition=arguments.condition,
            rpm=arguments.rpm,
            like=arguments.like,
            gain_switch=arguments.gain_switch,
        )
    except ValueError as error:
        option = "like" if arguments.like is not None else "condition" if arguments.rpm is None else "rpm"
        raise _Refused(f"--{option} {getattr(arguments, option)}: {error}", 2) from error
    except KeyError as error:
        raise _Refused(f"--set: this vehicle has no parameter {error.args[0]}, or not with that value", 2) from error
    vehicle.storage = storage
    return vehicle


def _storage(arguments: argparse.Namespace) -> LogStorage:
    if not (arguments.log_rate > 0 and math.isfinite(arguments.log_rate)):
        raise _Refused(f"--log-rate {arguments.log_rate:g}: a positive number of bytes a second is wanted", 2)
    ways = {"both": WAYS, "none": ()}.get(arguments.logs_by, (arguments.logs_by,))
    return LogStorage(arguments.directory, ways, arguments.log_rate)


def _air(arguments: argparse.Namespace, sweep_s: Callable[[], float]) -> tuple[Link, Faults] | None:
    """The link, and what goes wrong on it; None where the vehicle flies alone."""
    given = fault_words.given(arguments)
    if arguments.speed is not None:
        if arguments.listen is not None:
            raise _Refused("--speed flies without a link: a ground station cannot follow; leave out --listen", 2)
        if given:
            raise _Refused(f"--speed flies without a link, so nothing can go wrong on it; leave out {given[0]}", 2)
        return None
    try:
        faults = fault_words.read(arguments, sweep_s)
        link = open_link(arguments.listen or DEFAULT_LINK)
    except (ValueError, LinkError) as error:
        raise _Refused(str(error), 2) from error
    of_datagrams = fault_words.given(arguments, fault_words.DATAGRAMS)
    if of_datagrams and not isinstance(link, UdpLink):
        link.close()
        raise _Refused(f"{of_datagrams[0]} is a fault of datagrams: use a udpout or udpin link with it", 2)
    return link, faults


def _server(vehicle: Vehicle, air: tuple[Link, Faults] | None, signatures: Signatures | None) -> Server | None:
    if air is None:
        return None
    link, faults = air
    return Server(vehicle, FaultyLink(link, faults, lambda: vehicle.elapsed_s), faults.on_board, signatures)


def _signatures(path: Path | None) -> Signatures | None:
    try:
        return None if path is None else Signatures(read_key(path))
    except (OSError, ValueError) as error:
        raise _Refused(f"--key {path}: no key ({getattr(error, 'strerror', None) or error})", 2) from error


def _seal(hidden: Hidden, arguments: argparse.Namespace) -> dict[str, str]:
    """Where the answer lies and what commits to it."""
    try:
        path, sha256 = seal_answer(hidden, arguments.seed, arguments.directory)
    except OSError as error:
        raise _Refused(f"{arguments.directory}: the answer cannot be sealed there ({error.strerror})", 1) from error
    return {"path": str(path), "sha256": sha256}


def _clock(speed: str | None) -> WallClock | FreeClock:
    try:
        return FreeClock() if speed == "max" else WallClock(1.0 if speed is None else float(speed))
    except ValueError as error:
        raise _Refused(f"--speed {speed}: a positive number or max is wanted", 2) from error


def _say(line: str) -> None:
    try:
        print(line, flush=True)
    except OSError:  # whoever started the vehicle has stopped listening; it flies on
        os.dup2(os.open(os.devnull, os.O_WRONLY), 1)


class _End:
    """Whether the flight is to end: by a signal, the pilot's word, or the end of his lines."""

    def __init__(self) -> None:
        self.wanted = False

    def __call__(self, *_: object) -> None:
        self.wanted = True


def _obey_signals(end: _End) -> None:
    for name in ("SIGINT", "SIGTERM", "SIGHUP", "SIGBREAK"):
        number = getattr(signal, name, None)
        if number is not None and signal.getsignal(number) != signal.SIG_IGN:
            signal.signal(number, end)
    if hasattr(signal, "SIGTTIN"):  # in a shell's background the terminal's input ends; it must not stop the vehicle
        signal.signal(signal.SIGTTIN, signal.SIG_IGN)


def _ready(arguments: argparse.Namespace, server: Server | None, sealed: dict[str, str] | None) -> str:
    """The first line, as JSON."""
    return json.dumps(
        {
            "ready": True,
            "link": None if server is None else server.link.name,
            "ground_link": None if server is None else server.link.ground_link,
            "plant": arguments.plant,
            "like": arguments.like,
            "seed": arguments.seed,
            "directory": str(arguments.directory),
            "sealed": sealed,
        }
    )


def _obey_pilot(lines: PilotLines, vehicle: Vehicle, end: _End, signatures: Signatures | None) -> None:
    for line in lines.take():
        if line.lower() == "quit":
            end()
            _say("ok")
        elif line.lower() == "refused" and signatures is not None:
            _say(signatures.told())
        else:
            _say(obey(vehicle, line))


def _made(
    arguments: argparse.Namespace,
) -> tuple[Vehicle, tuple[Link, Faults] | None, dict[str, str] | None]:
    """The vehicle, its link, and where its sealed answer lies; nothing of them stays open where one is refused."""
    if arguments.plant is None and arguments.like is not None:
        arguments.plant = CLOTHES[arguments.like].plants[0]
    elif arguments.plant is None:
        arguments.plant = "hover" if arguments.hidden is None and arguments.condition is None else HOVER
    if arguments.like is None and arguments.plant not in PLANTS:
        raise _Refused(f"--plant {arguments.plant}: {arguments.plant} flies only with --like ardupilot-quad", 2)
    if arguments.gain_switch and arguments.like is None:
        raise _Refused("--gain-switch: only a stock autopilot (--like) has the script; this vehicle has a bank", 2)
    hidden = _hidden(arguments)
    air = _air(arguments, lambda: vehicle.systemid.first_s)  # asked in flight
    try:
        vehicle = _vehicle(arguments, hidden)  # after the link: a taken port must not leave a log behind
        return vehicle, air, None if hidden is None else _seal(hidden, arguments)
    except _Refused:
        if air is not None:
            air[0].close()
        raise


def _fly(arguments: argparse.Namespace) -> None:
    clock = _clock(arguments.speed)
    signatures = _signatures(arguments.key)
    vehicle, air, sealed = _made(arguments)
    server = _server(vehicle, air, signatures)
    end = _End()
    _obey_signals(end)
    pilot = None
    if sys.stdin is not None and not sys.stdin.closed:
        pilot = PilotLines(sys.stdin.fileno(), end if arguments.until_input_ends else None)
    stop_us = math.inf if arguments.duration is None else vehicle.time_us + arguments.duration * 1e6
    _say(_ready(arguments, server, sealed))

    def between() -> None:
        if pilot is not None:
            _obey_pilot(pilot, vehicle, end, signatures)
        if server is not None:
            server.poll()

    try:
        run(vehicle, clock, between, lambda: end.wanted or vehicle.time_us >= stop_us)
    finally:
        if server is not None:
            server.close()
        else:
            vehicle.close()


def main(words: list[str] | None = None) -> int:
    """Returns the exit status."""
    try:
        _fly(_arguments(words))
    except _Refused as refusal:
        print(f"sitl: {refusal}", file=sys.stderr)
        return refusal.status
    return 0


if __name__ == "__main__":
    sys.exit(main())
