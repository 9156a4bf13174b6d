"""`tippath abort`: end an excitation, whoever started it."""

from __future__ import annotations

import argparse
import json
from typing import Any

from gcs.cli.push import add_link_options, station

MODES = {"stabilize": 0, "acro": 1, "althold": 2, "loiter": 5}


def add_parser(subparsers: Any) -> None:
    parser: argparse.ArgumentParser = subparsers.add_parser(
        "abort",
        help="end an excitation",
        description="Ask the vehicle out of its excitation mode, again and again, until it shows another mode. In any "
        "other mode nothing is sent: then the pilot has it.",
        epilog='--json prints {"format": "tippath.abort/1", "was_excited", "ended", "mode_before", "mode_after", '
        '"asked", "reason"}. Exit status 0 where no excitation is left, else 1.',
    )
    add_link_options(parser)
    parser.add_argument(
        "--mode", choices=tuple(MODES), default="stabilize", help="the mode to go back to (default %(default)s)"
    )
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Exit status 0 where no excitation is left, else 1. Raises LinkError where there is no vehicle."""
    from gcs.flight.excitation import abort
    from gcs.flight.session import Session
    from gcs.logs.words import printable

    with Session.open(args.connect, **station(args)) as session:
        result = abort(session, MODES[args.mode])
    if args.json:
        about = {name: getattr(result, name) for name in result.__slots__}
        print(json.dumps({"format": "tippath.abort/1", **about}, indent=1, allow_nan=False))
    elif not result.was_excited:
        print(f"no excitation to end: the mode is {printable(result.mode_after)}; nothing was sent")
    elif result.ended:
        print(f"ended: the mode is {printable(result.mode_after)} (asked {result.asked} time(s))")
    else:
        print(f"not ended: {printable(result.reason)}")
    return 0 if result.ended else 1
