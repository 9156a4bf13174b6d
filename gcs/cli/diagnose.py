"""`tippath diagnose`: which physical effect a fit lacks."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import Any

from gcs.cli.options import (
    add_effects_option,
    add_log_options,
    add_output_options,
    parse_band,
    parse_profile,
    parse_words,
    print_json,
    refuse_existing,
    write_json,
    write_text,
)

_EPILOG = """\
RUN is a flight folder or a log (all its usable runs), LOG#n (its n-th run, as `tippath ingest` numbers them), or a
record. Without RUN the fit's own runs count, and its own validation runs; given, the fit's structure is refitted to
them first. Validation runs, of another maneuver or amplitude, never enter a fit: they tell an effect that is there
from one that only follows the noise.

Verdicts: "complete", what the model leaves is noise; "missing", one effect or a chain of two explains at least 80 % of
what can be explained, on fitted and validation runs, at plausible values; "unexplained", there is something, and
nothing in the catalogue does it. An effect that explains it at values that physics does not allow "stands in" for
something else. With --repeat the effect is added and the question asked again, until the answer is another one;
-o then keeps the last fit.

--json prints {"format": "tippath.diagnosis/1", "verdict", "effect", "chain", "stands_in", "indistinguishable",
"confidence", "explained_share", "candidates": [{"effect", "explained_share", "delta_bic", "nrmse_percent",
"validation_nrmse_percent", "parameters", "standard_errors", "implausible", "not_testable", ...}], best first, "pairs",
"placebo", "noise_floor_percent", "could_hide", "character", "next_maneuver", "explanation", "suspicions", and with
--repeat "rungs"}.
"""


def add_parser(subparsers: Any) -> None:
    parser: argparse.ArgumentParser = subparsers.add_parser(
        "diagnose",
        help="which physical effect is missing",
        description="Ask every effect of the catalogue whether it would explain what a fit leaves, refit the serious "
        "ones, and say which is missing, how sure that is, and what would make it surer.",
        epilog=_EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("fit", type=Path, metavar="FIT.json")
    parser.add_argument("runs", nargs="*", metavar="RUN")
    parser.add_argument(
        "--validate", nargs="+", default=[], metavar="RUN", help="runs that only judge; they never enter a fit"
    )
    parser.add_argument("--repeat", action="store_true", help="add the answer and ask again, showing each rung")
    parser.add_argument(
        "--suggest",
        type=Path,
        metavar="FILE.py",
        help="write the simple term that explains most as an effect file of your own, to try with `tippath add`",
    )
    add_effects_option(
        parser, "paths of your own effect files (their code runs): those that the fit uses, others are asked as well"
    )
    parser.add_argument("--band", metavar="LOW:HIGH", help="Hz, the frequencies that count (default: the fit's)")
    add_log_options(parser)
    parser.add_argument("--plot", type=Path, metavar="FILE", help="draw it: .png, .svg, or .html")
    add_output_options(parser, "FIT2.json")
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    from gcs.cli.fit import print_notes
    from gcs.cli.progress import Counting
    from gcs.diagnosis import diagnose_fit, diagnosis_text, drawn, flown_with_validation
    from gcs.logs import parse_window
    from gcs.pictures import picture_kind, write_picture
    from sysid.effect import load
    from sysid.result import Fit

    band = None if args.band is None else parse_band(args.band)
    window = None if args.window is None else parse_window(args.window)
    profile = parse_profile(args.profile)
    if args.plot is not None:
        picture_kind(args.plot)
    for path in (args.plot, args.output, args.suggest):
        refuse_existing(path, args.force)
    words = parse_words(args.effects)
    fit = Fit.load(args.fit, words)
    mine = [load(Path(word)) for word in words if word not in fit.model.structure.effects]
    records, validation, quiet = flown_with_validation(fit, args.runs, args.validate, profile, window)
    print_notes([*records, *validation])
    with Counting("asking") as say:
        found = diagnose_fit(
            fit,
            records,
            validation,
            quiet,
            effects=mine,
            band_hz=band,
            repeat=args.repeat,
            suggesting=args.suggest is not None,
            say=say,
        )
    text = diagnosis_text(found)
    if args.plot is not None:
        write_picture(args.plot, drawn(found), f"tippath diagnose: {args.fit.name}", text)
        print(f"wrote {args.plot}", file=sys.stderr)
    if args.output is not None:
        document = found.fit_json(args.output.parent)
        if document is None:
            print(f"{args.output} not written: nothing was found to add", file=sys.stderr)
        else:
            write_json(document, args.output)
            print(f"wrote {args.output}", file=sys.stderr)
    if args.suggest is not None:
        if found.suggestion is None:
            print(f"{args.suggest} not written: no simple term explains anything that is left", file=sys.stderr)
        else:
            write_text(found.suggestion.text, args.suggest)
            if found.suggestion.warning is not None:
                print(f"warning: {found.suggestion.warning}", file=sys.stderr)
            print(f"wrote {args.suggest}", file=sys.stderr)
    if args.json:
        print_json(found.to_json())
    else:
        print(text)
    return 0
