"""`tippath revert`: back to the gains before the last push."""

from __future__ import annotations

import argparse
import json
from typing import Any

from gcs.cli.push import add_dry_option, add_link_options, station


def add_parser(subparsers: Any) -> None:
    parser: argparse.ArgumentParser = subparsers.add_parser(
        "revert",
        help="go back to the gains before the last push",
        description="Make the vehicle's previous bank of gains the active one again. The vehicle must be disarmed; in "
        "the air the pilot's switch is the way back.",
        epilog='--json prints {"format": "tippath.revert/1", "crc", "checksum", "reverted_crc", "reverted_checksum"}: '
        "the checksums of the bank that is active now and of the one that was, as numbers (0: none) and in six "
        'hexadecimal digits. Where it ends with 1: {"format", "reason", "error"}, as of `tippath push`.',
    )
    add_link_options(parser)
    add_dry_option(parser)
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    # here, because --help should not wait for MAVLink
    from gcs.cli.dry_run import print_revert
    from gcs.flight.gains import checksum, planned_revert, revert
    from gcs.flight.session import Session

    with Session.open(args.connect, **station(args)) as session:
        if args.dry_run:
            print_revert(planned_revert(session), as_json=args.json)
            return 0
        result = revert(session)
    if args.json:
        print(json.dumps(result.to_json(), indent=2, allow_nan=False))
        return 0
    now = f"{checksum(result.crc)} is active again" if result.crc else "no LQR is active, as before the first push"
    print(f"{now}; {checksum(result.reverted_crc)} is kept as the one to go back to")
    return 0
