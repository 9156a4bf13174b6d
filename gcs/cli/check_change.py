"""`tippath check-change`: did the vehicle change between two sets of flights?"""

from __future__ import annotations

import argparse
import sys
from typing import Any

from gcs.cli.log_settings import add_settings_options, parse_settings
from gcs.cli.options import print_json

_HELP = """\
The mean of each set, the spread between days told from the errors within a flight, and of what is claimed over all
parameters 1 % false. Days are compared, since flights of one day share weather, battery and mass; where a set has
fewer than three days, flights are, and then a difference between two days looks like a change of the vehicle. What
goes with rotor speed or airspeed is taken out where all logs tell them. Fits must be of one structure.

Exit status: 0 changed, or nothing changed beyond what is said; 1 it cannot be told, or no flight is usable; 2 wrong
usage.

--json prints {"format": "tippath.change/1", "verdict": "changed" | "nothing changed" | "cannot tell", "sentence",
"limit_percent", "compared": "days" | "flights", "flights": [first, second], "parameters": [{"parameter", "unit",
"before", "size", "error", "chance" (adjusted for all parameters), "beyond" (95 %), "counts", "changed",
"needed_in_each_set"}], "left_out": [text]}.
"""
LIMIT_PERCENT = 10.0


def add_parser(subparsers: Any) -> None:
    parser: argparse.ArgumentParser = subparsers.add_parser(
        "check-change",
        help="did the vehicle change between two sets of flights",
        description="Did this firmware, blade or gain change the vehicle? Two sets of flights, logs or saved fits, in "
        "one sentence: what changed, or beyond what nothing did, or how many flights could tell.",
        epilog=_HELP,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    sets = "a folder, a file, or a pattern in quotes: saved fits (FIT.json), or logs, which are fitted"
    parser.add_argument("first", metavar="A", help=f"before: {sets}")
    parser.add_argument("second", metavar="B", help="after: the same")
    parser.add_argument(
        "--limit", type=_percent, default=LIMIT_PERCENT, metavar="PERCENT", help="the change that matters (default: 10)"
    )
    add_settings_options(parser)
    parser.add_argument("--json", action="store_true", help="print one JSON document")
    parser.set_defaults(run=run)


def _percent(text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = 0.0
    if not 0.01 <= value <= 100:
        raise argparse.ArgumentTypeError(f"{text}: wants percent, such as 5")
    return value


def run(args: argparse.Namespace) -> int:
    from gcs.analysis.text.blocks import wrapped
    from gcs.campaign.check_change import checked, read_set, sentence

    settings = parse_settings(args)
    first, second = (read_set(word, settings) for word in (args.first, args.second))
    found = checked(first, second, args.limit)
    for words in found.left_out:
        print(f"left out: {words}", file=sys.stderr)
    if args.json:
        print_json(found.to_json())
    else:
        print("\n".join(wrapped(sentence(found))))
        if not found.by_days:
            print("\n".join(wrapped("Flights are compared, not days: two days apart may differ by as much.")))
    return 1 if found.verdict == "cannot tell" else 0
