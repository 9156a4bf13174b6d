"""`tippath fit`: runs to a model with numbers, errors and warnings."""

from __future__ import annotations

import argparse
import math
import sys
from collections.abc import Sequence
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
        "--with",
        dest="effects",
        action="append",
        default=[],
        metavar="EFFECT,...",
        help="physical effects to add, in this order: ids of `tippath effects`, or paths of your own files; "
        "forward flight is --with angular_damping,elevator",
    )
    parser.add_argument(
        "--fix", action="append", default=[], metavar="NAME=VALUE,...", help="hold parameters at these values"
    )
    parser.add_argument(
        "--fix-from",
        action="append",
        default=[],
        metavar="FIT.json:NAME,...",
        help="hold parameters at another fit's values (the paper held L_b and M_a in forward flight)",
    )
    parser.add_argument(
        "--vehicle", metavar="VEHICLE.toml", help="k_beta, mass, arm, inertias: print what the fit implies beside them"
    )
    parser.add_argument(
        "--validate", nargs="+", default=[], metavar="RUN", help="runs that only judge; they never enter the fit"
    )
    add_band_option(parser)
    add_log_options(parser)
    add_output_options(parser, "FIT.json")
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    from gcs.analysis import fit_text, implied_text, load_vehicle
    from gcs.errors import TippathError
    from gcs.logs import parse_window, resolve_runs
    from sysid.checks import eigenfrequency_checks
    from sysid.identify import identify
    from sysid.implied import implied, rotor_speed
    from sysid.structures import compose

    band = parse_band(args.band)
    window = None if args.window is None else parse_window(args.window)
    profile = parse_profile(args.profile)
    refuse_existing(args.output, args.force)
    vehicle = None if args.vehicle is None else load_vehicle(Path(args.vehicle))
    validation = resolve_runs(args.validate, profile, window, f_high_hz=band[1]) if args.validate else []
    judging = {(record.path, record.id) for record in validation}
    records = [
        record
        for record in resolve_runs(args.runs, profile, window, f_high_hz=band[1])
        if (record.path, record.id) not in judging and record.maneuver != "quiet"
    ]
    if not records:
        raise TippathError("no run is left to fit: they are quiet hover or validation runs")
    effects = [word for group in args.effects for word in group.split(",") if word]
    fit = identify(
        compose(args.model),
        records,
        validation,
        band,
        effects=effects,
        fixed=parse_fixed(args.fix, args.fix_from),
        profile=args.profile,
        window_s=window,
    )
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
        if vehicle is not None:
            print("\n" + implied_text(implied(fit.model, vehicle, rotor_speed(records))))
    return 0


def parse_fixed(words: Sequence[str], files: Sequence[str]) -> dict[str, float]:
    """`NAME=VALUE,...` and `FIT.json:NAME,...` to held values. Raises UsageError for words that are neither."""
    from gcs.errors import UsageError
    from sysid.result import Fit

    held: dict[str, float] = {}
    for word in words:
        for part in word.split(","):
            name, mark, value = part.partition("=")
            try:
                held[name] = float(value)
            except ValueError:
                mark = ""
            if not mark or not name or not math.isfinite(held.get(name, math.inf)):
                raise UsageError(f"--fix {part}: wants NAME=VALUE, such as L_b=147.5")
    for word in files:
        path, mark, names = word.rpartition(":")
        if not mark or not path or not names:
            raise UsageError(f"--fix-from {word}: wants FIT.json:NAME,...")
        fit = Fit.load(Path(path))
        for name in names.split(","):
            if name not in fit.model.structure.names:
                listed = ", ".join(fit.model.structure.names)
                raise UsageError(f"--fix-from {word}: {path} has no parameter {name}; there are {listed}")
            held[name] = fit.model[name]
    return held
