"""`tippath check`: whether a card can be flown with a vehicle as it is set, on the ground, before anything flies."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import Any

from gcs.cli import EXIT_DONE, EXIT_NO
from gcs.cli.options import print_json, refuse_existing, write_text
from gcs.cli.push import add_link_options, add_vehicle_option, station

_HELP = """\
Reads, and says of each as it is, what to set, and why: where the vehicle's log goes, how often it is written and how
much of it is held back (LOG_BACKEND_TYPE, LOG_BITMASK, LOG_MAV_BUFSIZE, LOG_DISARMED), the checks before arming, what a
lost link and a lost transmitter do (FS_*), what SID_* was left at, loop and gyro filter, and what the link carries and
how late it is against what the card needs; battery, rotor speed and mode. No answer is never taken for "has none".

-o writes the proposed changes as NAME,VALUE lines with # comments, as Mission Planner, QGroundControl and MAVProxy load
them; what would only be better stands behind a #. Nothing is set by this command.

A vehicle that streams its log (LOG_BACKEND_TYPE with bit 2) cannot be armed before a log client answers it ("PreArm:
Logging failed"). This command does while it runs, `tippath sweep --wait` until the vehicle flies, and the app from
connecting on; none does where another station answers already.

--json prints {"format": "tippath.check/1", "link", "vehicle", "card", "log": "stream" or "card", "ready", "reason",
"changes": {NAME: value}, "better": {NAME: value}, "restart", "parameter_file", "items": [{"name", "standing": "must be
changed" | "could be better" | "in order", "value", "words", "set": {NAME: value}, "restart"}]}. Exit status 0 where the
card can be flown with the vehicle as it is set, 1 where something must be changed, or the vehicle does not answer.
"""


def add_parser(subparsers: Any) -> None:
    parser: argparse.ArgumentParser = subparsers.add_parser(
        "check",
        help="readiness on the ground: settings, link, log",
        description="Look, on the ground or in the air, whether a card can be flown with this vehicle as it is set.",
        epilog=_HELP,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    add_link_options(parser)
    add_vehicle_option(parser)
    parser.add_argument(
        "--card", metavar="CARD.toml|NAME", help="the test card to be flown (default: one chirp to 10 Hz)"
    )
    parser.add_argument(
        "--log",
        choices=("stream", "card"),
        help="how the log comes: over the link, or from the vehicle's card afterwards (default: as the vehicle is set, "
        "where the link carries it)",
    )
    parser.add_argument("-o", "--output", type=Path, metavar="NAME.param", help="write the proposed changes here")
    parser.add_argument("--force", action="store_true", help="overwrite the file")
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Exit status 0 where the card can be flown, else 1. Raises TippathError where there is no vehicle."""
    from gcs.cards.maneuver import Maneuver, load_card, single_card  # here: --help does not wait for MAVLink
    from gcs.flight.connection import WallClock
    from gcs.flight.readiness import look
    from gcs.flight.readiness_words import closing, document, page, parameter_file
    from gcs.flight.session import Session
    from gcs.logs.words import printable
    from gcs.vehicle.profile import load_profile

    refuse_existing(args.output, args.force)
    chirp = Maneuver(kind="chirp", axis="roll", amplitude=0.1, duration_s=30.0)
    card = single_card(chirp) if args.card is None else load_card(args.card)
    profiles = () if args.vehicle_profile is None else (load_profile(args.vehicle_profile),)
    stream = None if args.log is None else args.log == "stream"
    with Session.open(args.connect, **station(args)) as session:
        print(" asking the vehicle", file=sys.stderr)
        found = look(session, WallClock(), card, link=args.connect, profiles=profiles, stream=stream)
    if args.output is not None:
        write_text(parameter_file(found), args.output)
    if args.json:
        print_json(document(found, None if args.output is None else str(args.output)))
    else:
        print("\n".join(printable(line) for line in page(found)))
        print(f" {closing(found)}")
        if args.output is not None:
            print(f" proposed changes: {args.output}")
    return EXIT_DONE if found.ready else EXIT_NO
