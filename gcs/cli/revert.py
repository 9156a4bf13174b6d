"""`tippath revert`: back to the gains before the last push."""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import Any

from gcs.cli.push import add_dry_option, add_link_options, station


def add_parser(subparsers: Any) -> None:
    parser: argparse.ArgumentParser = subparsers.add_parser(
        "revert",
        help="go back to the gains before the last push",
        description="Make the vehicle's previous bank of gains the active one again. The vehicle must be disarmed; in "
        "the air the pilot's switch is the way back. On a stock ArduPilot the set behind the script's switch is "
        "forgotten; BEFORE.json, which a push of rate gains past any switch has kept, puts the gains before it back, "
        "a half-written set included.",
        epilog='--json prints {"format": "tippath.revert/1", "crc", "checksum", "reverted_crc", "reverted_checksum"}: '
        "the checksums of the bank that is active now and of the one that was, as numbers (0: none) and in six "
        'hexadecimal digits; by a BEFORE.json {"format", "parameters": {NAME: value}} of what was put back. Where it '
        'ends with 1: {"format", "reason", "error"}, as of `tippath push`.',
    )
    parser.add_argument(
        "before", type=Path, nargs="?", metavar="BEFORE.json", help="what a push of rate gains has kept"
    )
    parser.add_argument("--why", metavar="WORDS", help="why gains are put back that somebody else has changed since")
    add_link_options(parser)
    add_dry_option(parser)
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    # here, because --help should not wait for MAVLink
    from gcs.cli.dry_run import print_revert
    from gcs.flight.gains import checksum, planned_revert, revert
    from gcs.flight.rate_push import forget_behind, has_switch
    from gcs.flight.session import Session

    if args.before is not None:
        from gcs.cli import push_rates

        return push_rates.revert(args, station(args))
    with Session.open(args.connect, **station(args)) as session:
        if args.dry_run:
            print_revert(planned_revert(session), as_json=args.json)
            return 0
        if has_switch(session):
            was = forget_behind(session)
            about = {"crc": 0, "checksum": None, "reverted_crc": was, "reverted_checksum": checksum(was)}
            words = f"{checksum(was)} is behind the switch no more; the autopilot's own gains fly"
            print(json.dumps({"format": "tippath.revert/1"} | about, indent=2) if args.json else words)
            return 0
        result = revert(session)
    if args.json:
        print(json.dumps(result.to_json(), indent=2, allow_nan=False))
        return 0
    now = f"{checksum(result.crc)} is active again" if result.crc else "no LQR is active, as before the first push"
    print(f"{now}; {checksum(result.reverted_crc)} is kept as the one to go back to")
    return 0
