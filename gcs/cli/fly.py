"""`tippath fly`: the terminal app, on a vehicle or on the bundled simulated one."""

from __future__ import annotations

import argparse
import contextlib
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from gcs.tui.engine import FlightEngine

DEFAULT_PLANT = "hover"
PLANTS = ("hover", "hover-ideal", "forward")


def add_parser(subparsers: Any) -> argparse.ArgumentParser:
    """Add the command to argparse's subparsers."""
    parser: argparse.ArgumentParser = subparsers.add_parser(
        "fly",
        help="the terminal app",
        description="Fly a card run by run, fit the flight, design gains and push them, on the keys of a terminal. "
        "Without --connect a simulated vehicle is started, hovering, and ended with the app.",
        epilog="F12 aborts from anywhere. NO_COLOR=1 switches colours off.",
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
        help=f"start a simulated vehicle: hover, hover-ideal or forward (default {DEFAULT_PLANT})",
    )
    parser.add_argument(
        "-o", dest="output", metavar="DIR", type=Path, default=Path(), help="where the flights' folders are made"
    )
    parser.add_argument("--card", metavar="CARD", default="hover", help="a TOML file or a bundled card (default hover)")
    parser.add_argument(
        "--primary",
        action="store_true",
        help="be the station whose heartbeat holds the vehicle's ground failsafe (system id 255); with --sim always",
    )
    parser.add_argument("--seed", type=int, metavar="N", help="of the simulated vehicle's gusts and noise")
    parser.add_argument("--on-ground", action="store_true", help="the simulated vehicle begins on the ground")
    parser.add_argument(
        "--plot",
        choices=("braille", "block", "ascii"),
        default="braille",
        help="how the strips are drawn; block or ascii where the font lacks braille (ascii: nothing else anywhere)",
    )
    parser.add_argument("--no-bell", action="store_true", help="do not ring")
    parser.set_defaults(run=run)
    return parser


def run(args: argparse.Namespace) -> int:
    """Exit status 0, or 1 where the app itself failed. Raises TippathError where the app cannot begin."""
    from gcs.errors import TippathError, UsageError

    if args.connect is not None and (args.seed is not None or args.on_ground):
        raise UsageError("--seed and --on-ground are the simulated vehicle's; leave them out with --connect")
    from gcs.link.transport import parse_link
    from gcs.maneuver import load_card

    # Before anything is started, and before it is asked where: words that make no sense do so anywhere.
    if args.connect is not None:
        parse_link(args.connect)
    load_card(args.card)
    if not (sys.stdin.isatty() and sys.stdout.isatty()):
        raise TippathError("the app needs a terminal; `tippath sweep` and `tippath demo` do without")
    try:
        args.output.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise TippathError(f"{args.output}: {error.strerror or error}; choose another folder with -o") from error

    from gcs.pilot import SimulatedVehicle
    from gcs.tui.app import TippathApp
    from gcs.tui.engine import FlightEngine

    plant = None if args.connect is not None else args.sim or DEFAULT_PLANT
    with contextlib.ExitStack() as ends:
        start_vehicle = None
        if plant is not None:
            print(f"starting the simulated vehicle ({plant})", file=sys.stderr)
            vehicle = ends.enter_context(
                SimulatedVehicle(plant, args.output / "vehicle-logs", seed=args.seed, on_ground=args.on_ground)
            )

            def start_vehicle() -> SimulatedVehicle:
                return vehicle

        engine = FlightEngine(
            args.connect,
            plant=plant,
            start_vehicle=start_vehicle,
            folder=args.output,
            primary=args.primary or plant is not None,
            card=args.card,
        )
        ends.callback(_close, engine)
        app = TippathApp(engine, args.plot, bell=not args.no_bell)
        app.run()
    commands = engine.state().commands
    if commands:
        print("\n".join(["what was done, as a shell does it:", *commands]))
    return app.return_code or 0


def _close(engine: FlightEngine) -> None:
    """However the app ends: a run under way is ended before the link is let go, also past an impatient Ctrl-C."""
    if engine.state().stage.under_way:
        print("ending the run: waiting until the vehicle is out of it", file=sys.stderr)
    try:
        engine.close()
    except KeyboardInterrupt:
        engine.close()
