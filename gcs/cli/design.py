"""`tippath design`: LQR gains, observer and prefilter from a fit."""

from __future__ import annotations

import argparse
import math
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

from gcs.cli.options import (
    NAMED,
    add_effects_option,
    add_output_options,
    parse_words,
    print_json,
    refuse_existing,
    write_json,
    write_text,
)

if TYPE_CHECKING:
    from sysid.control.measured_margins import MeasuredMargins
    from sysid.control.regulator import Gains
    from sysid.fit.result import Fit


def add_parser(subparsers: Any) -> None:
    parser: argparse.ArgumentParser = subparsers.add_parser(
        "design",
        help="LQR, observer, prefilter, margins",
        description="Design the paper's controller on a TPP fit: LQR with Q = diag(1, 1, 0.001, 0.001), R = 5 I, "
        "observer poles at -50, -50, -51, -51, and the prefilter that makes the steady rates follow. The loop is "
        "judged with the whole fit, its delay and lags; gains that do not hold it are refused (exit status 1), and the "
        "input cost that does is told.",
        epilog='--json prints {"format": "tippath.gains/1", "K", "observer_gain", "prefilter", "poles", '
        '"observer_poles", "margins", "margins_with", "margins_without", "drifts", "weights", "model"}; with '
        '--measured also "margins_measured": {"band_hz", "phase_deg", "delay_ms", "gain_db"}, each {"value", "bound", '
        '"frequency_hz"}, or null where the loop does not cross in the measured band; null as a whole where the '
        "runs do not measure it well enough. With --for ardupilot: "
        '{"format": "tippath.rate_gains/1", "parameters": {NAME: {"flown", "new"}}, "flown", "new", "asked", '
        '"feed_forward", "repeated", "gyro_filter_hz", "in_the_vehicle"}.',
    )
    parser.add_argument("fit", type=Path, metavar="FIT.json")
    parser.add_argument("--input-cost", type=float, default=5.0, metavar="R", help="lower is faster (default 5)")
    parser.add_argument(
        "--measured",
        action="store_true",
        help="beside the model's margins those that the measured responses of the fit's runs show, with 95 %% bounds",
    )
    parser.add_argument(
        "--for",
        dest="autopilot",
        choices=("ardupilot",),
        help="P, I, D and FF for the rate loops that flew (ArduCopter 4.5 and later) instead of the paper's "
        "controller: from the parameters in the fit's own logs, within 6 dB, 45 degrees and 10 ms, or half of the "
        "model's delay, none above 1.3 times the flown one; -o NAME.param takes the new values as a parameter file",
    )
    add_effects_option(parser, NAMED)
    add_output_options(parser, "GAINS.json")
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    from gcs.analysis.text.gains import gains_text, measured_text
    from gcs.errors import UsageError
    from sysid.control.regulator import design
    from sysid.fit.result import Fit

    refuse_existing(args.output, args.force)
    if not (args.input_cost > 0 and math.isfinite(args.input_cost)):
        raise UsageError("--input-cost: wants a positive number; the paper's is 5")
    fit = Fit.load(args.fit, parse_words(args.effects))
    for text in fit.warnings:
        print(f"warning of the fit: {text}", file=sys.stderr)
    if args.autopilot:
        return _for_ardupilot(args, fit)
    gains = design(fit.model, args.input_cost)
    document = gains.to_json()
    measured = by_measurement(fit, gains) if args.measured else None
    if args.measured:
        document["margins_measured"] = None if measured is None else measured.to_json()
    if args.output:
        write_json(document, args.output)
        print(f"wrote {args.output}; `tippath push {args.output} --connect LINK` writes it", file=sys.stderr)
    if args.json:
        print_json(document)
    else:
        print(gains_text(gains))
        if args.measured:
            print(measured_text(measured, gains.margins))
    return 0


def _for_ardupilot(args: argparse.Namespace, fit: Fit) -> int:
    from gcs.analysis.rate_gains import ardupilot_gains, parameter_file
    from gcs.analysis.text.rate_gains import rate_gains_text
    from gcs.errors import UsageError

    if args.measured:
        raise UsageError("--measured goes with the paper's controller; leave it out, or --for")
    gains = ardupilot_gains(fit)
    if args.output is not None:
        if args.output.suffix == ".json":
            write_json(gains.to_json(), args.output)
        else:
            write_text(parameter_file(gains.changes), args.output)
        print(f"wrote {args.output}", file=sys.stderr)
    if args.json:
        print_json(gains.to_json())
    else:
        print(rate_gains_text(gains, fit.model))
    return 0


def by_measurement(fit: Fit, gains: Gains) -> MeasuredMargins | None:
    """Margins by the responses that the fit's own runs show. Raises NoResponseError, TippathError."""
    from gcs.analysis.comparison import flown
    from sysid.control.measured_margins import measured_margins
    from sysid.response.flown import flown_responses

    records, _ = flown(fit)
    return measured_margins(gains, flown_responses(records, fit.band_hz).responses)
