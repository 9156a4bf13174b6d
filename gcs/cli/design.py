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
    from gcs.analysis.standing import Standing
    from sysid.control.judgement import Limits
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
        "input cost that does is told. They are judged, too, on every model that the fit's diagnosis leaves open (what "
        "is missing, what could not be told from it; `tippath diagnose` keeps its answer beside the fit), and over 500 "
        "samples of the fit's errors. Verdicts: holds; poor, where an answer to a doublet overshoots or couples more "
        "than asked; fails, where a margin is less than asked, and `tippath push` refuses.",
        epilog='--json prints {"format": "tippath.gains/1", "K", "observer_gain", "prefilter", "poles", '
        '"observer_poles", "margins", "margins_with", "margins_without", "drifts", "weights", "model", '
        '"diagnosis": {"state", "effects", "confidence", '
        '"not_modelled"}, "judged": {"verdict", "limits", "models": [{"role", "model", "held", "margins", "overshoot", '
        '"coupling", "rise_ms", "robustness", "without", "shortfalls"}], "bounds", "bounds_shortfalls", '
        '"measured_shortfalls"}, "judged_on", "identified": {"parameters", "changed", "battery_v", "rotor_rpm"} (of '
        "the vehicle in the fit's logs: `tippath push` compares)}, with --costs "
        '"over_costs": [{"input_cost", "K", "verdict", "margins", "overshoot", "coupling"}]; with '
        '--measured also "margins_measured": {"band_hz", "phase_deg", "delay_ms", "gain_db"}, each {"value", "bound", '
        '"frequency_hz"}, or null where the loop does not cross in the measured band, "unstable_poles" (of the open '
        'loop, by the model), "sweep_to_hz" (to measure what the model crosses beyond); null as a whole where the '
        "runs do not measure it well enough. With --for ardupilot: "
        '{"format": "tippath.rate_gains/1", "parameters": {NAME: {"flown", "new"}}, "flown", "new", "asked", '
        '"feed_forward", "repeated", "gyro_filter_hz", "in_the_vehicle", "diagnosis", "identified"}.',
    )
    parser.add_argument("fit", type=Path, metavar="FIT.json")
    parser.add_argument("--input-cost", type=float, default=5.0, metavar="R", help="lower is faster (default 5)")
    parser.add_argument(
        "--measured",
        action="store_true",
        help="beside the model's margins those that the measured responses of the fit's runs show, with 95 %% bounds",
    )
    parser.add_argument(
        "--limits",
        metavar="LIMITS",
        help="what is asked (6dB,45deg,10ms,overshoot=25,coupling=25, percent, where left out; of delay at least half "
        "of what the model has)",
    )
    parser.add_argument(
        "--costs",
        action="store_true",
        help="K and margins over input costs from 1 to 100, on every model that is left open",
    )
    _add_ardupilot(parser)
    add_effects_option(parser, NAMED)
    add_output_options(parser, "GAINS.json")
    parser.set_defaults(run=run)


def _add_ardupilot(parser: argparse.ArgumentParser) -> None:
    """The options of the other controller."""
    parser.add_argument(
        "--for",
        dest="autopilot",
        choices=("ardupilot",),
        help="P, I, D and FF for the rate loops that flew (ArduCopter 4.5 and later) instead of the paper's "
        "controller: from the parameters in the fit's own logs, within 6 dB, 45 degrees and 10 ms, or half of the "
        "model's delay, none above 1.3 times the flown one; -o NAME.param takes the new values as a parameter file",
    )
    parser.add_argument(
        "--script",
        type=Path,
        metavar="FILE.lua",
        help="with --for ardupilot: write the script for the vehicle's card that holds both sets behind the pilot's "
        "switch; `tippath push` puts the new one there",
    )


def run(args: argparse.Namespace) -> int:
    from gcs.analysis.clearance import clearance
    from gcs.analysis.identified import identified
    from gcs.analysis.standing import beside
    from gcs.analysis.text.clearance import clearance_text, costs_text
    from gcs.analysis.text.gains import gains_text, measured_text
    from gcs.errors import UsageError
    from sysid.control.over_costs import over_costs
    from sysid.control.regulator import design
    from sysid.fit.result import Fit

    refuse_existing(args.output, args.force)
    refuse_existing(args.script, args.force)
    if args.script is not None and not args.autopilot:
        raise UsageError("--script goes with --for ardupilot: the bank of the other has a switch of its own")
    if not (args.input_cost > 0 and math.isfinite(args.input_cost)):
        raise UsageError("--input-cost: wants a positive number; the paper's is 5")
    limits, words = _limits(args.limits), parse_words(args.effects)
    fit = Fit.load(args.fit, words)
    for text in fit.warnings:
        print(f"warning of the fit: {text}", file=sys.stderr)
    if args.autopilot:
        return _for_ardupilot(args, fit, beside(args.fit.parent, fit, words))
    gains = design(fit.model, args.input_cost)
    measured = by_measurement(fit, gains) if args.measured else None
    cleared = clearance(gains, fit, beside(args.fit.parent, fit, words), limits, measured=measured)
    document = gains.to_json() | cleared.to_json(Path() if args.output is None else args.output.parent)
    document["identified"] = identified(fit).to_json()
    if args.measured:
        document["margins_measured"] = None if measured is None else measured.to_json()
    costs = over_costs(fit.model, cleared.models, limits, args.input_cost) if args.costs else ()
    if costs:
        document["over_costs"] = [one.to_json() for one in costs]
    if args.output:
        write_json(document, args.output)
        print(f"wrote {args.output}; `tippath push {args.output} --connect LINK` writes it", file=sys.stderr)
    if args.json:
        print_json(document)
    else:
        print(gains_text(gains))
        print(clearance_text(cleared))
        if args.measured:
            print(measured_text(measured, gains.margins))
        if costs:
            print(costs_text(costs, args.input_cost))
    return 0


def _limits(words: str | None) -> Limits | None:
    """What is asked. Raises UsageError for words that say no limits."""
    from gcs.errors import UsageError
    from sysid.control.judgement import parse_limits

    try:
        return None if words is None else parse_limits(words)
    except ValueError as error:
        raise UsageError(f"--limits {words}: wants such as 6dB,45deg,10ms,overshoot=25,coupling=25") from error


def _for_ardupilot(args: argparse.Namespace, fit: Fit, standing: Standing) -> int:
    from gcs.analysis.identified import identified
    from gcs.analysis.rate_gains import ardupilot_gains, parameter_file
    from gcs.analysis.text.blocks import wrapped
    from gcs.analysis.text.clearance import standing_words
    from gcs.analysis.text.rate_gains import rate_gains_text
    from gcs.errors import UsageError
    from gcs.vehicle.gain_switch import SCRIPT

    given = {"--measured": args.measured, "--costs": args.costs, "--limits": args.limits is not None}
    if others := [option for option, is_given in given.items() if is_given]:
        raise UsageError(f"{others[0]} goes with the paper's controller; leave it out, or --for")
    gains = ardupilot_gains(fit)
    document = gains.to_json() | {"diagnosis": standing.to_json(), "identified": identified(fit).to_json()}
    if args.output is not None:
        if args.output.suffix == ".json":
            write_json(document, args.output)
        else:
            write_text(parameter_file(gains.changes), args.output)
        print(f"wrote {args.output}", file=sys.stderr)
    if args.script is not None:
        write_text(SCRIPT.read_text("utf-8"), args.script)
        print(f"wrote {args.script}: into APM/scripts on the vehicle's card", file=sys.stderr)
    if args.json:
        print_json(document)
    else:
        print(rate_gains_text(gains, fit.model))
        print("\n".join(wrapped(f"the fit: {standing_words(standing)}")))
    return 0


def by_measurement(fit: Fit, gains: Gains) -> MeasuredMargins | None:
    """Margins by the responses that the fit's own runs show. Raises NoResponseError, TippathError."""
    from gcs.analysis.comparison import flown
    from sysid.control.measured_margins import measured_margins, with_model
    from sysid.response.flown import flown_responses

    records, _ = flown(fit)
    found = measured_margins(gains, flown_responses(records, fit.band_hz).responses)
    return None if found is None else with_model(found, gains, fit.model)
