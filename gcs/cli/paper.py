"""`tippath paper`: the paper's tables and figures from flights of the simulated vehicle, ours beside the printed."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import Any


def add_parser(subparsers: Any) -> None:
    parser: argparse.ArgumentParser = subparsers.add_parser(
        "paper",
        help="the paper's tables and figures from simulated flights, beside the printed",
        description="Fly the simulated vehicle over the link, record as any flight is recorded, and make Tables 1 to 6 "
        "and Figures 4 to 10 of the paper from the logs, ours beside the printed numbers, with where each difference "
        "comes from. Half an hour, in real time. Interrupted, the same command goes on where it was.",
        epilog='Leaves DIR/paper.html and DIR/paper.json: {"format": "tippath.paper/1", "quick", "flights", '
        '"chapters"}, which --json prints.',
    )
    parser.add_argument("-o", "--output", type=Path, default=Path("paper"), metavar="DIR", help="default %(default)s")
    parser.add_argument("--quick", action="store_true", help="shorter chirps than the paper's, for a look")
    parser.add_argument("--json", action="store_true", help="print one JSON document")
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Exit status 0. Raises TippathError where a flight fails, or a file cannot be written."""
    import msgspec

    from gcs.cards.envelope import Limits
    from gcs.cli.interrupts import interrupts
    from gcs.cli.options import print_json
    from gcs.cli.progress import ProgressLines
    from gcs.paper.flights import Hangar
    from gcs.paper.regenerate import regenerate
    from gcs.paper.words import paper_text

    def say(words: str) -> None:
        print(words, file=sys.stderr, flush=True)

    with interrupts() as wishes:
        hangar = Hangar(
            path=args.output / "flights",
            quick=args.quick,
            say=say,
            on_progress=ProgressLines(Limits(), bell=False),
            aborted=wishes,
            interruptions=lambda: wishes.pressed,
        )
        try:
            found = regenerate(args.output, hangar, say)
        except KeyboardInterrupt:
            say("what is done is kept: the same command goes on there")
            raise
    if args.json:
        print_json(msgspec.to_builtins(found))
    else:
        print(paper_text(found))
        print(f"page: {args.output / 'paper.html'}")
    return 0
