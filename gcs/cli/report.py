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

BESIDE = Path()
"""No name: beside the page, called as it is."""


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
    parser.add_argument("fits", nargs="*", type=Path, metavar="FIT.json")
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
        "--pdf",
        nargs="?",
        type=Path,
        const=BESIDE,
        metavar="FILE.pdf",
        help="the same as PDF as well, for paper and mail: into this file, or beside the page",
    )
    parser.add_argument("--force", action="store_true", help="overwrite the file")
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    from gcs.analysis.pages.page import page
    from gcs.analysis.pages.report import flight_document
    from gcs.cli.counting import Counting

    fits, paper = _named(args)
    for path in (args.output, paper):
        refuse_existing(path, args.force)
    with Counting("report") as say:
        document = flight_document(
            fits,
            parse_words(args.effects),
            args.gains,
            diagnosing=not args.no_diagnosis,
            say=lambda what, _: say(what),
            warn=lambda words: print(f"warning: {words}", file=sys.stderr),
        )
        files = [(args.output, page(document).encode())]
        if paper is not None:
            from gcs.analysis.pages.pdf import pdf  # fonts are read: only where it is asked for

            say("the PDF")
            files.append((paper, pdf(document, datetime.now(UTC))))
    for path, content in files:
        write_whole(content, path)
        print(f"wrote {path}", file=sys.stderr)
    return 0


def _named(args: argparse.Namespace) -> tuple[list[Path], Path | None]:
    """The fits, and the PDF's file where one is asked for. Raises UsageError."""
    fits, paper = list(args.fits), args.pdf
    if args.output.suffix.lower() == ".pdf":
        raise UsageError(f"-o {args.output}: the page is HTML, such as report.html; its PDF is --pdf {args.output}")
    if paper is not None and paper.suffix.lower() == ".json":  # the option took the first fit
        fits, paper = [paper, *fits], BESIDE
    if not fits:
        raise UsageError("name the fits that the report is about: FIT.json, as `tippath fit ... -o FIT.json` writes it")
    if paper is BESIDE:
        return fits, args.output.with_suffix(".pdf")
    if paper is not None and paper.suffix.lower() != ".pdf":
        raise UsageError(f"--pdf {paper}: name a file that ends in .pdf, or none: it stands beside the page then")
    return fits, paper
