"""`tippath key`: keys for signed links, made and told apart; never shown."""

from __future__ import annotations

import argparse
import getpass
import sys
from pathlib import Path
from typing import Any

from gcs.cli.options import print_json
from gcs.errors import UsageError

_HELP = """The vehicle needs the same key. On ArduPilot it is set once, over USB, by a ground station that can (in
MAVProxy: signing setup WORDS; in Mission Planner: Setup, Advanced, MAVLink signing), from a passphrase: make the file
here with --passphrase and the same words. Its first port (USB) accepts unsigned messages for ever, by its design; all
others refuse them from then on. A file beside the key, FILE.state, keeps the time that must not go backwards.

--json prints {"format": "tippath.key/1", "path", "id"}; the key itself is never printed."""
LEAST_WORDS = 8
"""Letters of a passphrase; what is shorter is guessed."""


def add_parser(subparsers: Any) -> None:
    parser: argparse.ArgumentParser = subparsers.add_parser(
        "key",
        help="signing keys: new, show-id",
        description="A key with which messages to and from a vehicle are signed (MAVLink 2), for --key of the commands "
        "that connect.",
    )
    actions = parser.add_subparsers(dest="action", metavar="new|show-id", required=True)
    new = actions.add_parser(
        "new",
        help="make a key",
        description="Write a new key, which nobody but you may read.",
        epilog=_HELP,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    new.add_argument("file", metavar="FILE", type=Path)
    new.add_argument(
        "--passphrase",
        action="store_true",
        help="of words that are asked for (or read from standard input), as MAVProxy and Mission Planner make theirs, "
        "instead of a random one",
    )
    show = actions.add_parser(
        "show-id",
        help="what tells a key from others",
        description="Print an id of the key: the same on both sides if the keys are, and it gives nothing away.",
    )
    show.add_argument("file", metavar="FILE", type=Path)
    for one in (new, show):
        one.add_argument("--json", action="store_true", help="print one JSON document")
        one.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Raises UsageError where a key is there already, or none is."""
    from gcs.link.key_file import drawn, of_passphrase, read_key, write_key

    if args.action == "new":
        key = of_passphrase(_words()) if args.passphrase else drawn()
        write_key(key, args.file)
    else:
        key = read_key(args.file)
    if args.json:
        print_json({"format": "tippath.key/1", "path": str(args.file), "id": key.id})
    else:
        print(f"{args.file}: key {key.id}")
    return 0


def _words() -> str:
    """The passphrase. Raises UsageError."""
    if not sys.stdin.isatty():
        words = sys.stdin.readline().rstrip("\r\n")
    else:
        words = getpass.getpass("passphrase: ")
        if getpass.getpass("once more: ") != words:
            raise UsageError("the two are not the same; no key was written")
    if len(words) < LEAST_WORDS:
        raise UsageError(f"a passphrase of less than {LEAST_WORDS} letters is guessed; no key was written")
    return words
