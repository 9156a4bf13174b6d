"""`tippath fly`: the terminal app, on a vehicle, on the bundled simulated one, or on recorded flights."""

from __future__ import annotations

import argparse
import contextlib
import gc
import shlex
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

from gcs.cli.push import add_vehicle_option, add_voice_options
from gcs.cli.served import add_serve_options, in_browser, require_serve_words, serve
from gcs.errors import TippathError, UsageError

if TYPE_CHECKING:
    from gcs.tui.connections import Connection
    from gcs.tui.reconnect import Reconnecting

PLANTS = ("hover", "hover-ideal", "forward")
THEMES = ("dark", "light", "sun", "contrast")
FASTEST = 1000.0
"""A replay."""


def add_parser(subparsers: Any) -> argparse.ArgumentParser:
    """Add the command to argparse's subparsers."""
    parser: argparse.ArgumentParser = subparsers.add_parser(
        "fly",
        help="the terminal app",
        description="Fly a card run by run, fit the flight, find what is missing, design gains and push them, on the "
        "keys of a terminal. Without --connect and --sim it asks where to connect; recorded flights need no vehicle.",
        epilog="F12 aborts from anywhere. NO_COLOR=1 switches colours off.",
    )
    _add_flight(parser)
    _add_screen(parser)
    parser.set_defaults(run=run)
    return parser


def _add_flight(parser: argparse.ArgumentParser) -> None:
    """What is flown, where to connect, where results go."""
    parser.add_argument(
        "flight",
        nargs="*",
        metavar="FLIGHT",
        help="a flight folder or a log to open at once; several together, as a roll log and a pitch log",
    )
    parser.add_argument(
        "--replay",
        nargs="?",
        type=_speed,
        const=1.0,
        metavar="SPEED",
        help="watch FLIGHT again on the Fly screen, so many times as fast as it was (default 1); nothing is connected",
    )
    where = parser.add_mutually_exclusive_group()
    where.add_argument(
        "--connect",
        metavar="LINK",
        help="udpin:HOST:PORT, udpout:HOST:PORT, tcp:HOST:PORT, /dev/ttyUSB0,921600 or COM5,57600",
    )
    where.add_argument(
        "--sim",
        metavar="PLANT",
        choices=PLANTS,
        help="start a simulated vehicle, ended with the app: hover, hover-ideal or forward",
    )
    parser.add_argument(
        "-o", dest="output", metavar="DIR", type=Path, default=Path(), help="where the flights' folders are made"
    )
    parser.add_argument(
        "--card",
        metavar="CARD",
        help="a TOML file or a bundled card (default: the vehicle's own on ArduPilot, else hover)",
    )
    parser.add_argument(
        "--log",
        choices=("stream", "card"),
        default="stream",
        help="as of `tippath sweep`: card where the link carries telemetry only",
    )
    parser.add_argument(
        "--leave-out", action="store_true", help="leave out of the card what the vehicle cannot fly, without asking"
    )
    add_vehicle_option(parser)
    parser.add_argument(
        "--primary",
        action="store_true",
        help="be the station whose heartbeat holds the vehicle's ground failsafe (system id 255); with --sim always",
    )
    add_voice_options(parser)
    parser.add_argument(
        "--probe",
        action=argparse.BooleanOptionalAction,
        help="before a card a small step on each axis, and the card only if the vehicle answers as it should (default "
        "on every vehicle that the app does not simulate itself)",
    )
    parser.add_argument("--seed", type=int, metavar="N", help="of the simulated vehicle's gusts and noise")
    parser.add_argument("--on-ground", action="store_true", help="the simulated vehicle begins on the ground")


def _add_screen(parser: argparse.ArgumentParser) -> None:
    """How it looks, and where."""
    parser.add_argument(
        "--plot",
        choices=("braille", "block", "ascii"),
        default="braille",
        help="how the strips are drawn; block or ascii where the font lacks braille (ascii: nothing else anywhere)",
    )
    parser.add_argument(
        "--theme",
        choices=THEMES,
        default="dark",
        help="colours: dark, light, sun (black on white) or contrast (white on black); F9 changes them (default dark)",
    )
    parser.add_argument("--no-bell", action="store_true", help="do not ring")
    parser.add_argument(
        "--say",
        metavar="COMMAND",
        nargs="?",
        const="",
        help="speak start, half, three, two, one, end, limit, abort and verdicts, by the system's voice, or by a "
        "command such as 'espeak-ng -s 180 {}'",
    )
    add_serve_options(parser)


def _speed(word: str) -> float:
    """How many times as fast."""
    try:
        speed = float(word.removesuffix("x"))
    except ValueError:
        speed = 0.0
    if not 0.0 < speed <= FASTEST:
        raise argparse.ArgumentTypeError(f"{word}: a speed above 0 up to {FASTEST:g} is wanted, such as 4")
    return speed


def run(args: argparse.Namespace) -> int:
    """Exit status 0, or 1 where the app itself failed. Raises TippathError where the app cannot begin."""
    _require_words(args)
    require_serve_words(args)
    if args.serve is not None:
        return serve(args, add_parser(argparse.ArgumentParser().add_subparsers()))
    if not (sys.stdin.isatty() and sys.stdout.isatty()) and not in_browser():
        raise TippathError("the app needs a terminal; `tippath sweep` and `tippath demo` do without")
    try:
        args.output.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise TippathError(f"{args.output}: {error.strerror or error}; choose another folder with -o") from error

    from gcs.tui.app import TippathApp  # as in every command: --help answers at once without textual
    from gcs.tui.connections import NOWHERE
    from gcs.tui.reconnect import Reconnecting
    from gcs.tui.speaking import Speaker, voice

    connection = _connection(args)
    opened = args.flight if args.replay is None else []
    first = "runs" if opened else "connect" if connection is NOWHERE else "fly"
    with contextlib.ExitStack() as ends:
        worker = Reconnecting(
            connection,
            folder=args.output,
            primary=args.primary,
            card=_asked(args),
            profile=args.vehicle_profile,
            probe=args.probe,
            key=args.key,
            system=args.system,
        )
        say = None if args.say is None else ends.enter_context(contextlib.closing(Speaker(voice(args.say)))).say
        ends.callback(_close, worker)
        app = TippathApp(
            worker,
            args.plot,
            bell=not args.no_bell,
            say=say,
            theme=args.theme,
            connections=worker,
            first=first,
            flights=opened,
        )
        gc.collect()
        gc.freeze()  # a full collection over all that was imported stops the keys for a tenth of a second
        app.run()
    for text in worker.waiting_notes:
        print(f"a note that no flight has taken: {text}", file=sys.stderr)
    commands = worker.state().commands
    if commands and not in_browser():
        with contextlib.suppress(OSError):
            print("\n".join(["what was done, as a shell does it:", *commands]))
    return app.return_code or 0


def _require_words(args: argparse.Namespace) -> None:
    """Before anything is started, and before it is asked where: words that make no sense do so anywhere.

    Raises UsageError or TippathError.
    """
    if args.replay is not None and (len(args.flight) != 1 or args.connect is not None or args.sim is not None):
        raise UsageError("--replay watches a FLIGHT again: name one folder or log before it, and leave out a vehicle")
    if args.sim is None and (args.seed is not None or args.on_ground):
        raise UsageError("--seed and --on-ground are the simulated vehicle's; use them with --sim")
    from gcs.cards.maneuver import load_card
    from gcs.link.key_file import read_key
    from gcs.link.transport import parse_link
    from gcs.tui.speaking import voice
    from gcs.vehicle.profile import load_profile

    if args.connect is not None:
        parse_link(args.connect)
    if args.sim is not None and (args.key is not None or args.system is not None):
        raise UsageError("--key and --system are for a vehicle of your own; --sim starts one that needs neither")
    if args.key is not None:
        read_key(args.key)
    if args.card is not None:
        load_card(args.card)
    if args.vehicle_profile is not None:
        load_profile(args.vehicle_profile)
    if args.say is not None:
        voice(args.say)
    for one in args.flight:
        if not Path(one).expanduser().exists():
            raise TippathError(f"{one}: no such folder or log")


def _asked(args: argparse.Namespace) -> str:
    """The card as the app takes it, with the options behind it."""
    from gcs.tui.asked_card import AskedCard

    card = "" if args.card is None else args.card
    return " ".join(filter(None, (shlex.quote(card) if card else "", AskedCard("", args.log, args.leave_out).options)))


def _connection(args: argparse.Namespace) -> Connection:
    """Where to connect to first."""
    from gcs.tui.connections import NOWHERE, Connection, simulated, typed

    if args.replay is not None:
        return Connection(name="replay", replay=Path(args.flight[0]).expanduser(), speed=args.replay)
    if args.connect is not None:
        return typed(args.connect)
    return NOWHERE if args.sim is None else simulated(args.sim, seed=args.seed, on_ground=args.on_ground)


def _close(worker: Reconnecting) -> None:
    """However the app ends: a run under way is ended before the link is let go, also past an impatient Ctrl-C."""
    if worker.state().stage.under_way:
        with contextlib.suppress(OSError):  # a terminal that was closed cannot be told; the vehicle must be
            print("ending the run: waiting until the vehicle is out of it", file=sys.stderr)
    try:
        worker.close()
    except KeyboardInterrupt:
        worker.close()
