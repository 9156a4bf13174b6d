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
        description="Tables and measured-against-modelled plots of one or more fits in one HTML file. "
        "The logs that the fits were made from must still be where they were.",
    )
    parser.add_argument("fits", nargs="+", type=Path, metavar="FIT.json")
    add_effects_option(parser, NAMED)
    parser.add_argument("-o", "--output", type=Path, default=Path("report.html"), metavar="REPORT.html")
    parser.add_argument("--force", action="store_true", help="overwrite the file")
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    from gcs.analysis import assess, fit_text, runs_of
    from gcs.report import page, run_picture
    from sysid.record import Record
    from sysid.result import Fit

    refuse_existing(args.output, args.force)
    fits = [Fit.load(path, parse_words(args.effects)) for path in args.fits]
    sections: list[tuple[str, str, list[str]]] = []
    runs: dict[tuple[str, str], Record] = {}
    for path, fit in zip(args.fits, fits, strict=True):
        fitted = runs_of(fit, fit.records)
        for record in [*fitted, *runs_of(fit, fit.validation)]:
            runs[record.path, record.id] = record
        judged = assess(fit, fitted)
        sections.append((path.name, fit_text(fit, judged.checks, judged.responses), []))
    models = [(fit.model.structure.base.upper(), fit.model) for fit in fits]
    pictures = [run_picture(record, models, fits[0].band_hz) for record in runs.values()]
    sections.append(("Measured against modelled", "", pictures))
    write_text(page("tippath: " + ", ".join(path.stem for path in args.fits), sections), args.output)
    print(f"wrote {args.output}", file=sys.stderr)
    return 0
