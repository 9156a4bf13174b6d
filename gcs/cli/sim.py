"""`tippath sim`: the bundled simulated vehicle, until it is interrupted. It runs as a process of its own."""

from __future__ import annotations

import argparse
import contextlib
import json
import os
import secrets
import signal
import subprocess
import sys
import threading
from pathlib import Path
from typing import Any

MODES = ("stabilize", "alt_hold", "rtl", "land", "systemid")
SWITCH = ("switch low", "switch middle", "switch high")
PILOT_LINES = ("takeoff", "land", "lqr on", "lqr off", *SWITCH, *(f"mode {name}" for name in MODES), "reboot", "quit")
"""What the simulated pilot hears, as the vehicle's own refusal of an unknown line lists it."""
AUTOPILOTS = ("ardupilot-heli", "ardupilot-quad")
CONDITIONS = ("calm", "rpm", "airspeed", "yaw", "collective", "stirring", "lively")
"""As the vehicle knows them."""
FAULTS = {
    "loss": ("SHARE", "of packets lost, such as 0.02"),
    "outage": ("WAY", "nothing passes up (to the vehicle), down or both ways; without @WHEN always"),
    "lag": ("S", "everything comes S seconds later, each way, in order"),
    "lag-up": ("S", "the same, only to the vehicle"),
    "lag-down": ("S", "the same, only to the ground"),
    "jitter": ("S", "everything comes up to S seconds later, each way, and may swap"),
    "bandwidth": ("RATE", "bytes a second that the link carries, each way; a 57,600 baud radio 5760"),
    "queue": ("BYTES", "wait for the bandwidth before packets are dropped (16384)"),
    "duplicate": ("SHARE", "of packets that come twice"),
    "duplicate-within": ("S", "the second one comes up to S seconds later (0)"),
    "reorder": ("SHARE", "of packets that others overtake"),
    "corrupt": ("SHARE", "of packets with a wrong byte"),
    "second-vehicle": ("MODE", "heartbeats of another vehicle with this id (stabilize); at a moment, @S, a single one"),
    "second-attitude": (None, "the second vehicle sends its attitude, too"),
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
"""What the vehicle's link and log can be made to suffer: handed on as given, and judged by the vehicle."""
FAULT_TIMES = (
    "Most take @WHEN behind the value (--lag 3.5@20:40): FROM:UNTIL in seconds of the vehicle's own time, which begins "
    "at 1; either end may be left out. With sweep+ before it (@sweep+3:8) it counts from the start of the first sweep, "
    "with order+ from the ground's first order to start one. Each may be given several times; drawn from --seed."
)
FAULT_SCRIPT = 'these options in a file: loss = 0.02, outage = ["up@20:24", "both@40:45"], second-attitude = true'
GRACE_S = 2.0
"""A Ctrl-C in the terminal reaches the vehicle by itself; after so long it is told once more."""


def add_parser(subparsers: Any) -> None:
    parser: argparse.ArgumentParser = subparsers.add_parser(
        "sim",
        help="the simulated vehicle, until interrupted",
        description="A simulated helicopter, in the air, that answers on a MAVLink link as ArduPilot does. Its pilot "
        f"reads lines from this terminal: {', '.join(PILOT_LINES)}. "
        "Plants: hover has physics that the models lack; hover-ideal is Table 4 exactly; forward is Table 5 in forward "
        "flight, with an elevator, airspeed and rotor speed wandering. With --hidden, one physical effect is planted "
        "in hover-ideal or forward and the answer sealed in DIR; its SHA-256 (salted: another one each time) commits "
        "to it, and `tippath reveal DIR` opens it. random may draw nothing, too, and flies everything in the lively "
        "condition, so that a moving rotor speed does not tell. --condition stirs rotor speed, airspeed, yaw or "
        "collective; by itself it hides nothing. "
        "With --like the vehicle is a stock ArduCopter: its parameters, log, sweeps, refusals and words. It flies "
        "hover or hover-ideal, or quad; hidden effects and conditions are the other vehicle's.",
        epilog='--json prints {"ready", "link", "ground_link", "plant", "like", "seed", "directory", "sealed": '
        '{"path", "sha256"} or null} once it is up.',
    )
    parser.add_argument(
        "--plant",
        choices=("hover", "hover-ideal", "forward", "quad"),
        help="default hover; with --hidden or --condition hover-ideal; quad only, and always, --like ardupilot-quad",
    )
    _add_stock(parser)
    parser.add_argument(
        "--hidden",
        metavar="EFFECT|random|none",
        help="hide an effect: an id of `tippath effects`, one of the vehicle's own draws, any, or nothing",
    )
    parser.add_argument(
        "--condition",
        choices=CONDITIONS,
        help="what moves beside the cyclic: default calm; a hidden effect's own where it needs one",
    )
    parser.add_argument(
        "--listen",
        default="udpout:127.0.0.1:14550",
        metavar="LINK",
        help="udpout:HOST:PORT sends there (default %(default)s), udpin: and tcpin: wait for the ground; "
        "port 0 takes a free one",
    )
    parser.add_argument(
        "--seed",
        type=int,
        metavar="N",
        help="wind, noise, sensors and what is drawn (default 1; with --hidden a new one, printed)",
    )
    parser.add_argument(
        "-o", "--output", type=Path, metavar="DIR", help="its own logs (default: the next vehicle-NNNN)"
    )
    parser.add_argument("--on-ground", action="store_true", help="start disarmed, waiting for takeoff")
    _add_log_ways(parser)
    _add_key(parser)
    parser.add_argument("--json", action="store_true", help="print one JSON document")
    _add_faults(parser)
    parser.set_defaults(run=run)


def _add_stock(parser: argparse.ArgumentParser) -> None:
    """Of a stock autopilot."""
    parser.add_argument(
        "--like",
        choices=AUTOPILOTS,
        help="a stock ArduCopter with default parameters; on the ground it can be armed 42 s after it has booted",
    )
    parser.add_argument(
        "--gain-switch",
        action="store_true",
        help="the stock ArduCopter has the script on its card that holds a second set of rate gains behind the pilot's "
        "switch (`switch high`)",
    )


def _add_log_ways(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--logs-by",
        choices=("both", "log", "ftp", "none"),
        help="how `tippath fetch` may have its logs: LOG_REQUEST_DATA, MAVFTP (default both)",
    )
    parser.add_argument("--log-rate", metavar="RATE", help="bytes a second that it sends of them (default 250000)")


def _add_key(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--key",
        type=Path,
        metavar="FILE",
        help="sign all that it says, and obey only what is signed with this key; the line `refused` counts the rest",
    )


def _add_faults(parser: argparse.ArgumentParser) -> None:
    group = parser.add_argument_group("faults", FAULT_TIMES)
    for name, (word, text) in FAULTS.items():
        options: dict[str, Any] = {"action": "append_const", "const": ""}
        if word is not None:
            options = {"action": "append", "metavar": word}
        if name == "second-vehicle":
            options |= {"nargs": "?", "const": ""}
        group.add_argument(f"--{name}", default=[], help=text, **options)
    group.add_argument("--faults", action="append", default=[], type=Path, metavar="FILE.toml", help=FAULT_SCRIPT)


def _faults(args: argparse.Namespace) -> list[str]:
    """As the vehicle is told them: a word after an equals sign cannot be taken for an option."""
    given = [(name, word) for name in FAULTS for word in getattr(args, name.replace("-", "_"))]
    scripts = [f"--faults={path}" for path in args.faults]
    return [*scripts, *(f"--{name}={word}" if word else f"--{name}" for name, word in given)]


def run(args: argparse.Namespace) -> int:
    """The vehicle's own exit status."""
    directory = args.output if args.output is not None else next_directory(Path())
    seed = args.seed
    if seed is None:
        seed = 1 if args.hidden is None else secrets.randbelow(10_000)
    command = [sys.executable, "-m", "sitl", "--until-input-ends", "--listen", args.listen]
    command += ["--seed", str(seed), "-o", str(directory), *_faults(args)]
    for option in ("plant", "like", "hidden", "condition", "logs_by", "log_rate", "key"):
        given = getattr(args, option)
        command += [] if given is None else [f"--{option.replace('_', '-')}={given}"]
    command += ["--on-ground"] if args.on_ground else []
    command += ["--gain-switch"] if args.gain_switch else []
    # The pilot's lines come to the vehicle through us, so that it hears when we are gone, killed even, and ends too.
    vehicle = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE)
    if sys.stdin is not None and not sys.stdin.closed:
        with contextlib.suppress(OSError, ValueError):  # it is no file
            threading.Thread(target=_hand_on, args=(sys.stdin.fileno(), vehicle), name="pilot", daemon=True).start()
    before = {
        number: signal.signal(number, lambda number, _: _pass_on(vehicle, number))
        for name in ("SIGTERM", "SIGHUP")
        if (number := getattr(signal, name, None)) is not None
    }
    try:
        return _follow(vehicle, args.json)
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
        _end(vehicle)


def _hand_on(descriptor: int, vehicle: subprocess.Popen[bytes]) -> None:
    """Lines to the vehicle as they come; where they end, it flies on."""
    assert vehicle.stdin is not None
    if hasattr(signal, "pthread_sigmask") and hasattr(
        signal, "SIGTTIN"
    ):  # a shell's background has no terminal's input
        signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGTTIN})
    with contextlib.suppress(OSError, ValueError):
        while data := os.read(descriptor, 4096):
            vehicle.stdin.write(data)
            vehicle.stdin.flush()


def next_directory(parent: Path) -> Path:
    """The first `vehicle-NNNN` that does not exist in `parent`."""
    number = 1
    while (parent / f"vehicle-{number:04d}").exists():
        number += 1
    return parent / f"vehicle-{number:04d}"


def _follow(vehicle: subprocess.Popen[bytes], as_json: bool) -> int:
    assert vehicle.stdout is not None
    first = True
    try:
        for raw in vehicle.stdout:
            text = raw.decode("utf-8", "replace").rstrip("\n")
            if first:
                first = False
                print(text if as_json else banner(text), flush=True)
            elif as_json:  # standard output holds one document
                print(f" pilot: {text}", file=sys.stderr, flush=True)
            else:
                print(f" pilot: {text}", flush=True)
        return vehicle.wait()
    except KeyboardInterrupt:
        with contextlib.suppress(subprocess.TimeoutExpired, KeyboardInterrupt):
            vehicle.wait(GRACE_S)
        return 0


def banner(line: str) -> str:
    """What to do with the vehicle that is up, from its own first line; that line itself where it is another."""
    try:
        about = json.loads(line)
        forward = about["plant"] == "forward"
        what = "--card forward, or --axis roll|pitch|elevator" if forward else "--card quick, or --axis roll|pitch"
        stock = about.get("like")
        if stock is not None:  # its own card, and its log stays on the vehicle by default
            what = "--log card"
        plant = about["plant"] if stock is None else f"{about['plant']} · like {stock}"
        sealed = about.get("sealed")
        seal = (
            ""
            if sealed is None
            else f"something may be hidden (sealed in {sealed['path']}), seed {about['seed']}\n"
            f"  SHA-256 {sealed['sha256']}\n"
            f"  tippath reveal {about['directory']}, when all is said\n"
        )
        return (
            f"vehicle on {about['link']} · plant {plant} · its logs in {about['directory']}\n{seal}"
            f"  tippath {'fly' if stock is None else 'check'} --connect {about['ground_link']}\n"
            f"  tippath sweep --connect {about['ground_link']} {what}\n"
            f"  the pilot hears: {', '.join(PILOT_LINES)}; Ctrl-C ends"
        )
    except (ValueError, KeyError, TypeError):
        return line


def _pass_on(vehicle: subprocess.Popen[bytes], number: int) -> None:
    with contextlib.suppress(OSError):
        vehicle.send_signal(number)


def _end(vehicle: subprocess.Popen[bytes]) -> None:
    for insist in (vehicle.terminate, vehicle.kill):
        if vehicle.poll() is not None:
            break
        insist()
        with contextlib.suppress(subprocess.TimeoutExpired):
            vehicle.wait(GRACE_S)
    for pipe in (vehicle.stdin, vehicle.stdout):
        with contextlib.suppress(OSError):
            if pipe is not None:
                pipe.close()
