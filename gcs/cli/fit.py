"""`tippath fit`: runs to a model with numbers, errors and warnings."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import Any

from gcs.cli.options import (
    add_band_option,
    add_log_options,
    add_output_options,
    parse_band,
    parse_profile,
    print_json,
    refuse_existing,
    write_json,
)


def add_parser(subparsers: Any) -> None:
    parser: argparse.ArgumentParser = subparsers.add_parser(
        "fit",
        help="fit a model to runs",
        description="Fit the Tip-Path-Plane (tpp) or Cylinder-Dynamics (cd) model to several runs together.",
        epilog="RUN is a flight folder or a log (all its usable runs), LOG#n (its n-th run, as `tippath ingest` "
        "numbers them), or a record written by ingest. A CSV with columns t, p, q, delta_x, delta_y is one run.",
    )
    parser.add_argument("runs", nargs="+", metavar="RUN")
    parser.add_argument("--model", choices=("cd", "tpp"), required=True, help="the structure to fit")
    parser.add_argument(
        "--validate", nargs="+", default=[], metavar="RUN", help="runs that only judge; they never enter the fit"
    )
    add_band_option(parser)
    add_log_options(parser)
    add_output_options(parser, "FIT.json")
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    from gcs.analysis import fit_text
    from gcs.errors import TippathError
    from gcs.logs import parse_window, resolve_runs
    from sysid.checks import eigenfrequency_checks
    from sysid.identify import identify
    from sysid.structures import STRUCTURES

    band = parse_band(args.band)
    window = None if args.window is None else parse_window(args.window)
    profile = parse_profile(args.profile)
    refuse_existing(args.output, args.force)
    validation = resolve_runs(args.validate, profile, window, f_high_hz=band[1]) if args.validate else []
    judging = {(record.path, record.id) for record in validation}
    records = [
        record
        for record in resolve_runs(args.runs, profile, window, f_high_hz=band[1])
        if (record.path, record.id) not in judging and record.maneuver != "quiet"
    ]
    if not records:
        raise TippathError("no run is left to fit: they are quiet hover or validation runs")
    fit = identify(STRUCTURES[args.model], records, validation, band, args.profile, window)
    document = fit.to_json(args.output.parent if args.output else Path.cwd())
    if args.output:
        write_json(document, args.output)
        print(f"wrote {args.output}", file=sys.stderr)
    if args.json:
        print_json(document)
        for text in fit.warnings:
            print(f"warning: {text}", file=sys.stderr)
    else:
        print(fit_text(fit, eigenfrequency_checks(fit.model, records, band)))
    return 0
