"""`tippath push`: a designed set of gains to the vehicle, proved bit for bit."""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path
from typing import Any

from gcs.cli.options import add_effects_option, parse_words


def add_parser(subparsers: Any) -> None:
    parser: argparse.ArgumentParser = subparsers.add_parser(
        "push",
        help="write gains to the vehicle as one verified set",
        description="Write a GAINS.json of `tippath design` to the vehicle's shadow bank, read it back bit for bit, "
        "and commit it with its checksum. The vehicle must be disarmed; whether the LQR flies is the pilot's switch. "
        "First the gains are judged again as `tippath design` judged them, on the models that stand in the file; where "
        "they fail nothing is asked of the vehicle, unless --why says why they are pushed all the same.",
        epilog='--json prints {"format": "tippath.push/1", "crc", "checksum", "previous_crc", "previous_checksum", '
        '"committed", "verified", "values", "switch_on"}: the checksums of the bank that is active now and of the one '
        "before, as numbers (0: none) and as they are written everywhere else, in six hexadecimal digits; whether "
        'anything had to be committed, how many values were read back equal, and those values; and "judged", '
        '"diagnosis", as `tippath design` writes them, "why". With --dry-run '
        '"changes": {name: {"now", "then"}}. Where it ends with 1: {"format", "reason", "error"}, reason one of link, '
        "no answer, refused, armed, no bank, differs, gains, margins.",
    )
    parser.add_argument("gains", type=Path, metavar="GAINS.json")
    parser.add_argument(
        "--why", metavar="WORDS", help="why gains that fail are pushed all the same; with --json it is printed"
    )
    add_effects_option(parser, "paths of your own files (their code runs) that the gains' models use")
    add_link_options(parser)
    add_dry_option(parser)
    parser.set_defaults(run=run)


def add_link_options(parser: argparse.ArgumentParser) -> None:
    """The options of every command that speaks to a vehicle."""
    parser.add_argument(
        "--connect",
        required=True,
        metavar="LINK",
        help="udpin:HOST:PORT, udpout:HOST:PORT, tcp:HOST:PORT, /dev/ttyUSB0,921600 or COM5,57600",
    )
    parser.add_argument(
        "--primary",
        action="store_true",
        help="be the station whose heartbeat holds the vehicle's ground failsafe (system id 255)",
    )
    add_voice_options(parser)
    parser.add_argument("--json", action="store_true", help="print one JSON document")


def add_voice_options(parser: argparse.ArgumentParser) -> None:
    """Whom to believe on a link."""
    parser.add_argument(
        "--key",
        type=Path,
        metavar="FILE",
        help="sign with this key and believe only what is signed with it (`tippath key new` makes one)",
    )
    parser.add_argument(
        "--system", type=_system, metavar="N", help="the vehicle's system id, where several speak on one link"
    )


def add_dry_option(parser: argparse.ArgumentParser) -> None:
    """--dry-run, of what writes or flies."""
    parser.add_argument(
        "--dry-run",
        action="store_true",
        help="ask and check all the same, say what would be done, and send nothing but questions",
    )


def _system(text: str) -> int:
    if not (text.isascii() and text.isdigit() and 1 <= int(text) <= 255):
        raise argparse.ArgumentTypeError(f"{text}: a system id is 1 to 255")
    return int(text)


def station(args: argparse.Namespace) -> dict[str, Any]:
    """How this station takes part in a link, as `Session.open` takes it."""
    about = {"primary": args.primary, "key": args.key, "system": args.system}
    return about | ({"dry": True} if getattr(args, "dry_run", False) else {})


def add_vehicle_option(parser: argparse.ArgumentParser) -> None:
    """--vehicle-profile, of what flies maneuvers."""
    parser.add_argument(
        "--vehicle-profile",
        metavar="FILE.toml|NAME",
        help="how this vehicle is told to fly a maneuver (default: what its parameters tell; arducopter and table1 are "
        "there)",
    )


def run(args: argparse.Namespace) -> int:
    # here, because --help should not wait for MAVLink
    from gcs.analysis.clearance import cleared_again
    from gcs.analysis.text.clearance import clearance_text, require_cleared
    from gcs.cli.dry_run import print_push
    from gcs.flight.gains import checksum, load_gains, planned_push, push
    from gcs.flight.session import Session

    gains = load_gains(args.gains)
    cleared = cleared_again(args.gains, parse_words(args.effects))
    print(clearance_text(cleared), file=sys.stderr)
    require_cleared(cleared, args.why)
    with Session.open(args.connect, **station(args)) as session:
        if args.dry_run:
            print_push(planned_push(session, gains), as_json=args.json)
            return 0
        result = push(session, gains, on_progress=lambda step: print(f" {step}", file=sys.stderr))
    if args.json:
        told = {"judged": cleared.judgement.to_json(), "diagnosis": cleared.standing.to_json(), "why": args.why}
        print(json.dumps(result.to_json() | told, indent=2, allow_nan=False))
        return 0
    if result.committed:
        print(f"committed {checksum(result.crc)}; {len(result.values)} of {len(result.values)} values read back equal")
    else:
        print(f"the vehicle had this set already ({checksum(result.crc)}); nothing was written")
    names = list(result.values)
    for row in ("K1", "K2", "K3", "L1", "L2", "L3", "L4", "G1", "G2", "G3", "W", "Z", "F1", "F2", "F3"):
        values = [result.values[n] for n in names if n[:-1] == row and n[-1].isdigit()]
        if any(values):
            print(f"  {row:4}" + " ".join(f"{value:12.6g}" for value in values))
    if result.committed and result.previous_crc:
        print(f"`tippath revert` goes back to the set before, {checksum(result.previous_crc)}")
    elif result.committed:
        print("it is the vehicle's first set: nothing to revert to until the next; the way back is the pilot's switch")
    switch = {True: "the LQR", False: "the autopilot's own controller", None: "unknown"}[result.switch_on]
    print(f"the pilot's switch selects: {switch}")
    return 0
