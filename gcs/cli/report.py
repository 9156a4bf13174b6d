"""`tippath report`: fits as a self-contained page with plots."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import Any

from gcs.cli.options import NAMED, add_effects_option, parse_words, refuse_existing, write_text


def add_parser(subparsers: Any) -> None:
    parser: argparse.ArgumentParser = subparsers.add_parser(
        "report",
        help="a self-contained page with plots",
        description="One HTML file about one or more fits: tables, where the model fails, what it lacks, the ladder of "
        "effects that were added, and measured against modelled rates of every run. Of several fits the one with the "
        "longest ladder, the first of equals, is compared and diagnosed. "
        "The logs that the fits were made from must still be where they were.",
    )
    parser.add_argument("fits", nargs="+", type=Path, metavar="FIT.json")
    parser.add_argument(
        "--gains",
        type=Path,
        metavar="GAINS.json",
        help="show these gains, designed on one of the fits, and whether they hold it, as well",
    )
    parser.add_argument("--no-diagnosis", action="store_true", help="do not ask what is missing: saves some seconds")
    add_effects_option(parser, NAMED)
    parser.add_argument("-o", "--output", type=Path, default=Path("report.html"), metavar="REPORT.html")
    parser.add_argument("--force", action="store_true", help="overwrite the file")
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    from gcs.analysis.pages.report import flight_report
    from gcs.cli.counting import Counting

    refuse_existing(args.output, args.force)
    with Counting("report") as say:
        text = flight_report(
            args.fits,
            parse_words(args.effects),
            args.gains,
            diagnosing=not args.no_diagnosis,
            say=lambda what, _: say(what),
            warn=lambda words: print(f"warning: {words}", file=sys.stderr),
        )
    write_text(text, args.output)
    print(f"wrote {args.output}", file=sys.stderr)
    return 0
