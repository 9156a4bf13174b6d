"""`tippath proof`: does the vehicle fly as it was predicted to with these gains?"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from gcs.cli.options import (
    NAMED,
    add_effects_option,
    add_plot_option,
    parse_words,
    print_json,
    refuse_plot,
    write_plot,
)


def add_parser(subparsers: Any) -> None:
    parser: argparse.ArgumentParser = subparsers.add_parser(
        "proof",
        help="flown against predicted: does it fly as designed?",
        description="Compare flights with pushed gains (the card `proof`, or any runs in which a rate was asked for) "
        "with what was predicted: NRMSE of the rate up to 15 Hz, and, of a step of the rate as each run shows it, "
        "rise, delay, overshoot and the other axis. The rates that were asked for drive the prediction, loop by loop, "
        "with the model that the gains were judged on, completed by its diagnosis where there is one. A quantity is "
        "accepted where its mean over the runs of an axis lies, 95 of 100 times, within what is allowed (NRMSE from "
        "85 %, rise within 15 %, delay within 10 ms, overshoot within 10 points, other axis within 5), not accepted "
        "where it surely lies beyond; else there are too few runs to say. The gains are accepted where all of both "
        "axes are. Runs that flew other gains are left out and told.",
        epilog='--json prints {"format": "tippath.proof/1", "verdict": "accepted" | "not accepted" | "too few to '
        'say", "model", "completed", "evidence": [{"axis", "quantity", "predicted", "flown", "difference", "bounds", '
        '"allowed", "verdict"}], "runs": [{"id", "axis", "nrmse_percent", "nrmse_percent_other_axis"}], "left_out": '
        '[{"run", "why"}], "ask": "diagnose" where it is not accepted, else null}; quantities are nrmse_percent, '
        "rise_ms, delay_ms, overshoot and coupling, flown has a value for each run (null: not reached), bounds are of "
        "the mean difference (of the mean for nrmse_percent).",
    )
    parser.add_argument("gains", type=Path, metavar="GAINS.json", help="as it was pushed")
    parser.add_argument("flights", type=Path, nargs="+", metavar="FLIGHT", help="flight folders, or logs")
    parser.add_argument(
        "--fit",
        type=Path,
        metavar="FIT.json",
        help="predict with this fit instead of the models in the file of gains; rate gains of an ArduPilot need it",
    )
    add_effects_option(parser, NAMED)
    add_plot_option(parser, "draw it (the paper's Figure 5, and the steps)")
    parser.add_argument("--force", action="store_true", help="overwrite the file")
    parser.add_argument("--json", action="store_true", help="print one JSON document")
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    from gcs.analysis.pages.proof import proof_picture
    from gcs.analysis.proof import prove_flights
    from gcs.analysis.text.proof import proof_document, proof_text

    refuse_plot(args.plot, args.force)
    found = prove_flights(args.gains, args.flights, args.fit, parse_words(args.effects))
    text = proof_text(found)
    write_plot(args.plot, lambda: proof_picture(found), "tippath proof", text)
    if args.json:
        print_json(proof_document(found))
    else:
        print(text)
    return 0
