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
    from sysid.fit.result import Fit
    from sysid.response.values import Responses

_JSON = (
    '--json prints {"format": "tippath.gains/1", "K", "observer_gain", "prefilter", "poles", '
    '"observer_poles", "margins", "margins_with", "margins_without", "drifts", "weights", "model", '
    '"diagnosis": {"state", "effects", "confidence", '
    '"not_modelled"}, "judged": {"verdict", "limits", "models": [{"role", "model", "held", "margins", "overshoot", '
    '"coupling", "rise_ms", "robustness", "without", "shortfalls"}], "bounds", "bounds_shortfalls", '
    '"measured_shortfalls", "measured", "noise", "noise_shortfalls"}, "judged_on"}, with --costs "over_costs": '
    '[{"input_cost", "K", "verdict", "margins", "overshoot", "coupling"}]; with '
    '--measured also "margins_measured": {"band_hz", "phase_deg", "delay_ms", "gain_db"}, each {"value", "bound", '
    '"frequency_hz"}, or null where the loop does not cross in the measured band, "disk" (its size in the band, '
    'the same), "unstable_poles" (of the open loop, by the model), and "needed", "missing" (margins that the model '
    'has, and which of them the band does not show), "sweep_to_hz", "sweep_from_hz" (to measure these), which '
    'stand as "judged": {"measured"}, too; "band_hz" null where the runs measure nothing well enough. With '
    "--for ardupilot: "
    '{"format": "tippath.rate_gains/1", "parameters": {NAME: {"flown", "new"}}, "flown", "new", "asked", '
    '"feed_forward", "repeated", "gyro_filter_hz", "in_the_vehicle", and of the new set "diagnosis", "judged", '
    '"judged_on" (with "loops"), "margins_measured" as above, "command_noise" ({"own", "flown"}, each '
    '{"rms", "rate_rms", "band_hz"}: what gusts and gyro make of both commands, of full command and a second, '
    '"servo_speed" where a model knows it, "times_flown", "of_servo_speed"; "judged": {"noise"} is the same); '
    '"judged_flown", "margins_measured_flown" of the flown one}.'
)


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
        "than asked, a disturbance is raised by more, or (--for ardupilot) moves the commands by more; fails, where a "
        "margin is less than asked, and `tippath push` refuses; not measured, where --measured was asked for and a "
        "margin that the model has lies outside the measured band: it says how far to sweep, and push refuses, too.",
        epilog=_JSON,
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
        help="what is asked (6dB,45deg,10ms,overshoot=25,coupling=25,peak=5dB,noise=1.3 where left out; overshoot "
        "and coupling in percent, of delay at least half of what the model has, peak the most by which disturbances "
        "may be raised, noise what these may move the commands by over what they did with the flown gains)",
    )
    parser.add_argument(
        "--costs",
        action="store_true",
        help="K and margins over input costs from 1 to 100, on every model that is left open",
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
    from gcs.analysis.clearance import by_measurement, clearance
    from gcs.analysis.standing import beside
    from gcs.analysis.text.clearance import clearance_text, costs_text
    from gcs.analysis.text.gains import gains_text, measured_text
    from gcs.errors import UsageError
    from sysid.control.over_costs import over_costs
    from sysid.control.regulator import design
    from sysid.fit.result import Fit

    refuse_existing(args.output, args.force)
    if not (args.input_cost > 0 and math.isfinite(args.input_cost)):
        raise UsageError("--input-cost: wants a positive number; the paper's is 5")
    limits, words = _limits(args.limits), parse_words(args.effects)
    fit = Fit.load(args.fit, words)
    for text in fit.warnings:
        print(f"warning of the fit: {text}", file=sys.stderr)
    if args.autopilot:
        return _for_ardupilot(args, fit, beside(args.fit.parent, fit, words), limits)
    gains = design(fit.model, args.input_cost)
    measured = by_measurement(gains, fit.model, _responses(fit)) if args.measured else None
    cleared = clearance(gains, fit, beside(args.fit.parent, fit, words), limits, measured=measured)
    document = gains.to_json() | cleared.to_json(Path() if args.output is None else args.output.parent)
    if measured is not None:
        document["margins_measured"] = measured.to_json()
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
        if measured is not None:
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


def _for_ardupilot(args: argparse.Namespace, fit: Fit, standing: Standing, limits: Limits | None) -> int:
    from gcs.analysis.rate_gains import ardupilot_gains, parameter_file
    from gcs.analysis.text.rate_gains import rate_gains_text
    from gcs.errors import UsageError

    if args.costs:
        raise UsageError("--costs goes with the paper's controller; leave it out, or --for")
    gains = ardupilot_gains(fit, standing, limits, measured=args.measured)
    document = gains.to_json(Path() if args.output is None else args.output.parent)
    if args.output is not None:
        if args.output.suffix == ".json":
            write_json(document, args.output)
        else:
            write_text(parameter_file(gains.changes), args.output)
        print(f"wrote {args.output}", file=sys.stderr)
    if args.json:
        print_json(document)
    else:
        print(rate_gains_text(gains, fit.model))
    return 0


def _responses(fit: Fit) -> Responses:
    """Those that the fit's own runs show. Raises NoResponseError, TippathError."""
    from gcs.analysis.comparison import flown
    from sysid.response.flown import flown_responses

    records, _ = flown(fit)
    return flown_responses(records, fit.band_hz).responses
