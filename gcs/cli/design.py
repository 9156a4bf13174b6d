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
    add_plot_option,
    parse_words,
    print_json,
    refuse_existing,
    refuse_plot,
    write_json,
    write_plot,
    write_text,
)

if TYPE_CHECKING:
    from gcs.analysis.clearance import Clearance
    from gcs.analysis.lqr import AskedDesign
    from gcs.analysis.standing import Standing
    from sysid.control.judgement import Limits
    from sysid.control.observers import RateNoise
    from sysid.control.regulator import Gains
    from sysid.fit.result import Fit
    from sysid.response.values import Responses

_JSON = (
    '--json prints {"format": "tippath.gains/1", "K", "observer_gain", "prefilter", "poles", '
    '"observer_poles", "elevator": {"K", "prefilter"} or null, "dynamic_prefilter": {"frequency_rad_s", '
    '"damping", "F"} or null, "margins", "margins_with", "margins_without", "drifts", "weights", "model", '
    '"diagnosis": {"state", "effects", "confidence", '
    '"not_modelled"}, "judged": {"verdict", "limits", "models": [{"role", "model", "held", "margins", "overshoot", '
    '"coupling", "rise_ms", "robustness", "without", "shortfalls"}], "bounds", "bounds_shortfalls", '
    '"measured_shortfalls", "measured", "noise", "noise_shortfalls"}, "judged_on", "identified": '
    '{"parameters", "changed", "battery_v", "rotor_rpm"} (of the vehicle in the fit\'s logs: `tippath push` '
    'compares)}, with --costs "over_costs": '
    '[{"input_cost", "K", "verdict", "margins", "overshoot", "coupling"}], '
    'with --observers "over_observers": [{"observer", "observer_gain", '
    '"observer_poles", "verdict", "margins", "overshoot", "coupling", "command_noise" (standard deviation of each, '
    'of full command), "gusts_left" (of p and q, share)}]; with '
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
    '"judged_flown", "margins_measured_flown" of the flown one; "identified"}.'
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
        "--flapping-cost",
        type=float,
        default=0.001,
        metavar="Q",
        help="of tilting the tip-path plane, where a rate's is 1 (default 0.001)",
    )
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
    _add_controller_options(parser)
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


def _add_controller_options(parser: argparse.ArgumentParser) -> None:
    """What the paper's controller may be beside the paper's, and what is listed side by side."""
    parser.add_argument(
        "--prefilter",
        choices=("steady", "dynamic"),
        default="steady",
        help="steady: the paper's, right in the long run (default); dynamic: each rate follows a model of its own and "
        "leaves the other axis alone on the way, too; margins stay, and the vehicle's bank must have it",
    )
    parser.add_argument(
        "--elevator",
        action="store_true",
        help="the elevator as a third command: of a fit of forward flight (--with angular_damping,elevator)",
    )
    parser.add_argument(
        "--costs",
        action="store_true",
        help="K and margins over input costs from 1 to 100, on every model that is left open",
    )
    add_plot_option(parser, "draw what --costs lists")
    parser.add_argument(
        "--observer",
        metavar="POLES|kalman",
        help="the observer's poles in 1/s (50,50,51,51, the paper's, where left out), or the Kalman filter for the "
        "gusts and the gyro noise that the fit's runs show",
    )
    parser.add_argument(
        "--observers",
        action="store_true",
        help="the paper's observer, slower and faster ones and the Kalman filter side by side: margins, noise of the "
        "commands, what the loop leaves of gusts",
    )


def run(args: argparse.Namespace) -> int:
    from gcs.analysis.clearance import by_measurement, clearance, gains_document
    from gcs.analysis.identified import identified
    from gcs.analysis.lqr import designed
    from gcs.analysis.rungs import load_fit
    from gcs.analysis.standing import beside
    from gcs.analysis.text.clearance import clearance_text
    from gcs.analysis.text.gains import gains_text, measured_text

    _refuse_wrong_usage(args)
    asked, limits, words = _asked(args), _limits(args.limits), parse_words(args.effects)
    fit = load_fit(args.fit, words)
    for text in fit.warnings:
        print(f"warning of the fit: {text}", file=sys.stderr)
    if args.autopilot:
        return _for_ardupilot(args, fit, beside(args.fit.parent, fit, words), limits)
    standing = beside(args.fit.parent, fit, words)
    noise = _noise(fit, asked) if args.observers or isinstance(asked.observer, str) else None
    gains = designed(fit, asked, [model for _, model in standing.models], limits, noise)
    measured = by_measurement(gains, fit.model, _responses(fit)) if args.measured else None
    cleared = clearance(gains, fit, standing, limits, measured=measured)
    document = gains_document(gains, cleared, identified(fit), Path() if args.output is None else args.output.parent)
    if measured is not None:
        document["margins_measured"] = measured.to_json()
    tables, text = _tables(args, fit, gains, cleared, noise)
    document |= tables
    if args.output:
        write_json(document, args.output)
        print(f"wrote {args.output}; `tippath push {args.output} --connect LINK` writes it", file=sys.stderr)
    if args.json:
        print_json(document)
    else:
        print(gains_text(gains))
        print(clearance_text(cleared))
        if args.prefilter == "steady" and cleared.judgement.answers_poorly:
            print("  prefilter     --prefilter dynamic mends the answer, and margins stay")
        if measured is not None:
            print(measured_text(measured, gains.margins))
        if text:
            print(text)
    return 0


def _refuse_wrong_usage(args: argparse.Namespace) -> None:
    """Raises UsageError."""
    from gcs.errors import UsageError

    refuse_existing(args.script, args.force)
    if args.script is not None and not args.autopilot:
        raise UsageError("--script goes with --for ardupilot: the bank of the other has a switch of its own")
    if not (args.input_cost > 0 and math.isfinite(args.input_cost)):
        raise UsageError("--input-cost: wants a positive number; the paper's is 5")
    if not (args.flapping_cost >= 0 and math.isfinite(args.flapping_cost)):
        raise UsageError("--flapping-cost: wants a number, not negative; the paper's is 0.001")
    if args.measured and args.elevator:
        raise UsageError("--measured knows a loop of two commands: leave it out, or --elevator")
    if args.plot is not None and not args.costs:
        raise UsageError("--plot draws what --costs lists: name both")
    refuse_plot(args.plot, args.force)
    refuse_existing(args.output, args.force)


def _asked(args: argparse.Namespace) -> AskedDesign:
    """Raises UsageError for an observer that is none."""
    from gcs.analysis.lqr import AskedDesign, parse_observer
    from gcs.errors import UsageError

    try:
        observer = parse_observer(args.observer)
    except ValueError as error:
        raise UsageError(f"--observer {args.observer}: wants kalman or such as 50,50,51,51 ({error})") from error
    return AskedDesign(
        input_cost=args.input_cost,
        flapping_cost=args.flapping_cost,
        observer=observer,
        dynamic=args.prefilter == "dynamic",
        elevator=args.elevator,
    )


def _noise(fit: Fit, asked: AskedDesign) -> RateNoise | None:
    """What the fit's runs flew in. Without it there is no Kalman filter; others are compared, and that is said."""
    from gcs.analysis.lqr import noise_of
    from gcs.errors import TippathError
    from sysid.errors import SysidError

    try:
        return noise_of(fit)
    except (TippathError, SysidError) as error:
        if isinstance(asked.observer, str):
            raise
        print(f"the noise of the fit's runs is not known: {error}", file=sys.stderr)
        return None


def _tables(
    args: argparse.Namespace, fit: Fit, gains: Gains, cleared: Clearance, noise: RateNoise | None
) -> tuple[dict[str, Any], str]:
    """What --observers and --costs ask for: for the document, and as text; --plot is written."""
    from gcs.analysis.lqr import at_costs
    from gcs.analysis.pages.costs import costs_picture
    from gcs.analysis.text.clearance import costs_text, observers_text
    from sysid.control.observers import over_observers
    from sysid.control.over_costs import over_costs

    document: dict[str, Any] = {}
    texts = []
    limits = cleared.judgement.limits
    if args.observers:
        observers = over_observers(gains, cleared.models, noise, limits)
        document["over_observers"] = [one.to_json() for one in observers]
        texts.append(observers_text(observers))
    if args.costs:
        others, asked = [model for _, model in cleared.models[1:]], _asked(args)
        costs = over_costs(
            cleared.models, limits, args.input_cost, lambda cost: at_costs(fit, asked, others, limits, noise, cost)
        )
        document["over_costs"] = [one.to_json() for one in costs]
        texts.append(costs_text(costs, args.input_cost))
        title = f"tippath design --costs: {args.fit.name}"
        write_plot(args.plot, lambda: costs_picture(costs, args.input_cost, limits), title, texts[-1])
    return document, "\n".join(texts)


def _limits(words: str | None) -> Limits | None:
    """What is asked. Raises UsageError for words that say no limits."""
    from gcs.errors import UsageError
    from sysid.control.judgement import parse_limits

    try:
        return None if words is None else parse_limits(words)
    except ValueError as error:
        raise UsageError(f"--limits {words}: wants such as 6dB,45deg,10ms,overshoot=25,coupling=25") from error


def _for_ardupilot(args: argparse.Namespace, fit: Fit, standing: Standing, limits: Limits | None) -> int:
    from gcs.analysis.identified import identified
    from gcs.analysis.rate_gains import ardupilot_gains, parameter_file
    from gcs.analysis.text.rate_gains import rate_gains_text
    from gcs.errors import UsageError
    from gcs.vehicle.gain_switch import SCRIPT

    given = {
        "--costs": args.costs,
        "--prefilter": args.prefilter != "steady",
        "--elevator": args.elevator,
        "--flapping-cost": args.flapping_cost != 0.001,
        "--observer": args.observer is not None,
        "--observers": args.observers,
    }
    if others := [option for option, is_given in given.items() if is_given]:
        raise UsageError(f"{others[0]} goes with the paper's controller; leave it out, or --for")
    gains = ardupilot_gains(fit, standing, limits, measured=args.measured)
    document = gains.to_json(Path() if args.output is None else args.output.parent)
    document["identified"] = identified(fit).to_json()
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
    return 0


def _responses(fit: Fit) -> Responses:
    """Those that the fit's own runs show. Raises NoResponseError, TippathError."""
    from gcs.analysis.comparison import flown
    from sysid.response.flown import flown_responses

    records, _ = flown(fit)
    return flown_responses(records, fit.band_hz).responses
