"""`tippath add`: a physical effect more, and the error falls or does not."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import Any

from gcs.cli.exporting import EXPORT_HELP, add_export_option, refuse_results, write_export
from gcs.cli.options import (
    add_airframe_option,
    add_effects_option,
    add_output_options,
    add_plot_option,
    add_reading_options,
    parse_airframe,
    parse_reading,
    parse_words,
    print_json,
    refuse_plot,
    write_json,
    write_plot,
)

_EPILOG = """\
The ladder shows each rung on fitted and on validation runs, beside the noise floor. The placebo is the best wrong
effect with at most as many parameters: the error falls with it, too. Three signs tell a real effect: the error falls on
runs that were not fitted, sets of runs agree better on the base's parameters, and the size is physically plausible.

FIT2.json and --json have, beside the keys every fit has, "noise_floor_percent", "placebo" (as a candidate of
`tippath diagnose`) and "signs": [{"key": "validation" | "agreement" | "plausible", "name", "seen": true, false, or
null where these runs cannot show it, "text"}].
"""


def add_parser(subparsers: Any) -> None:
    parser: argparse.ArgumentParser = subparsers.add_parser(
        "add",
        help="add an effect, refit, show the error fall",
        description="Refit a fit's structure with one physical effect more, from the values it had.",
        epilog=_EPILOG + "\n" + EXPORT_HELP,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("fit", type=Path, metavar="FIT.json")
    parser.add_argument("effect", metavar="EFFECT", help="an id of `tippath effects`, or the path of your own file")
    parser.add_argument("runs", nargs="*", metavar="RUN", help="other runs than the fit's own")
    parser.add_argument(
        "--validate", nargs="+", default=[], metavar="RUN", help="runs that only judge; they never enter the fit"
    )
    add_effects_option(parser, "paths of your own files that the fit uses already, base or effects (their code runs)")
    add_reading_options(parser)
    add_airframe_option(parser)
    add_plot_option(parser, "draw the ladder")
    add_output_options(parser, "FIT2.json")
    add_export_option(parser)
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    from gcs.analysis.addition import add_effect
    from gcs.analysis.comparison import flown_with_validation
    from gcs.analysis.ladder import rungs_of
    from gcs.analysis.notes import note_lines
    from gcs.analysis.pages.ladder import ladder_picture
    from gcs.analysis.rungs import load_fit
    from gcs.analysis.text.addition import addition_document, addition_text
    from gcs.cli.asking import AskingLine
    from gcs.cli.fit import print_notes
    from gcs.desk.ladder import effect_to_add
    from gcs.errors import UsageError

    band, window, profile = parse_reading(args)
    refuse_plot(args.plot, args.force)
    refuse_results(args, args.plot)
    words = parse_words(args.effects)
    fit = load_fit(args.fit, words)
    used = {Path(one).resolve() for one in fit.model.structure.files}
    strange = [word for word in words if Path(word).resolve() not in used]
    if strange:
        raise UsageError(f"--with {strange[0]}: {args.fit} does not use it; what to add is named without --with")
    effect = effect_to_add(fit, args.effect, str(args.fit))
    records, validation, _ = flown_with_validation(fit, args.runs, args.validate, profile, window, parse_airframe(args))
    print_notes(note_lines([*records, *validation]))
    with AskingLine() as say:
        found = add_effect(fit, effect, records, validation, band_hz=band, say=say)
    text = addition_text(found, str(args.fit), None if args.output is None else str(args.output))
    rungs = rungs_of(found.after.model.structure.base_, found.after.lineage)
    floor, placebo = found.noise_floor_percent, found.placebo_rung
    write_plot(args.plot, lambda: ladder_picture(rungs, floor, placebo=placebo), f"tippath add: {args.effect}", text)
    document = addition_document(found, args.output.parent if args.output else Path.cwd())
    if args.output:
        write_json(document, args.output)
        print(f"wrote {args.output}", file=sys.stderr)
    write_export(args.export, found.after, records)
    if args.json:
        print_json(document)
        for warning in found.after.warnings:
            print(f"warning: {warning}", file=sys.stderr)
    else:
        print(text)
    return 0
