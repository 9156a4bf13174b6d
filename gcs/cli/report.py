"""`tippath report`: fits as a self-contained page with plots."""

from __future__ import annotations

import argparse
import sys
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from gcs.cli.options import NAMED, add_effects_option, parse_words, refuse_existing
from gcs.errors import UsageError
from gcs.files import write_whole


def add_parser(subparsers: Any) -> None:
    parser: argparse.ArgumentParser = subparsers.add_parser(
        "report",
        help="a self-contained page with plots",
        description="One HTML file about one or more fits, which needs no network and prints: a summary, the "
        "flight with its notes, the ladder of effects that were added and what the diagnosis of each rung found, where "
        "the model fails, values, measured against modelled rates of every run, and where all of it comes from. Of "
        "several fits the one with the longest ladder, the first of equals, is compared; its lower rungs and their "
        "diagnoses are read from the files beside it, and only what nobody asked yet is asked. "
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
    parser.add_argument(
        "--pdf", action="store_true", help="the same as PDF as well, beside the page: REPORT.pdf, for paper and mail"
    )
    parser.add_argument("--force", action="store_true", help="overwrite the file")
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    from gcs.analysis.pages.page import page
    from gcs.analysis.pages.report import flight_document
    from gcs.cli.counting import Counting

    beside = args.output.with_suffix(".pdf")
    for path in (args.output, *([beside] if args.pdf else ())):
        refuse_existing(path, args.force)
    if args.pdf and beside == args.output:
        raise UsageError(f"-o {args.output}: name the page, such as report.html; --pdf writes its PDF beside it")
    with Counting("report") as say:
        document = flight_document(
            args.fits,
            parse_words(args.effects),
            args.gains,
            diagnosing=not args.no_diagnosis,
            say=lambda what, _: say(what),
            warn=lambda words: print(f"warning: {words}", file=sys.stderr),
        )
        files = [(args.output, page(document).encode())]
        if args.pdf:
            from gcs.analysis.pages.pdf import pdf  # fonts are read: only where it is asked for

            say("the PDF")
            files.append((beside, pdf(document, datetime.now(UTC))))
    for path, content in files:
        write_whole(content, path)
        print(f"wrote {path}", file=sys.stderr)
    return 0
