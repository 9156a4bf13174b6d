"""`tippath compare`: measured against simulated, and where a model fails."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from gcs.cli.options import (
    NAMED,
    add_effects_option,
    add_plot_option,
    add_reading_options,
    parse_reading,
    parse_words,
    print_json,
    refuse_plot,
    write_plot,
)

_FORMAT_HELP = """\
RUN is a flight folder or a log (all its usable runs), LOG#n (its n-th run, as `tippath ingest` numbers them), or a
record; without RUN the model is compared with the runs it was fitted to. Quiet hover among the runs, or in the fit's
own logs, measures the noise.

--json prints {"format": "tippath.compare/1", "nrmse_percent", "bands": [{"axis", "low_hz", "high_hz", "error_share",
"noise_share", "coherence": {channel: 0..1}, "coherence_together"}], "windows": [{"axis", "run", "start_s", "stop_s",
"error_share"}], "more_than_noise" (or null where the runs are too short to tell), "band_hz", "distortion" (share of the
error that is neither as in quiet hover nor linear in the commands), "quiet_ratio" or null, "references" (by which
signal each command is told), "noise_share", "noise_share_is": "measured" or "upper bound, closed loop", "noise_from",
"noise_floor_percent", "findings": [text], "responses" (model less measured with "noticed_hz", the bands where it lies
above what noise allows), "amplitude": {"levels", "growth"}, "conditions", "trends", "controls", "runs", "suspicions":
[{"kind", "runs", "text"}], "remarks", "warnings"}. Error shares add up to 1 for each axis over the bands, and over the
windows of all runs.
"""


def add_parser(subparsers: Any) -> None:
    parser: argparse.ArgumentParser = subparsers.add_parser(
        "compare",
        help="measured against simulated: where it fails",
        description="Set a fitted model beside flown runs, tell noise from error, and say in which band of frequency, "
        "in which runs and at which amplitudes the error sits.",
        epilog=_FORMAT_HELP,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("fit", type=Path, metavar="FIT.json")
    parser.add_argument("runs", nargs="*", metavar="RUN")
    add_effects_option(parser, NAMED)
    add_reading_options(parser)
    add_plot_option(parser)
    parser.add_argument("--force", action="store_true", help="overwrite the file")
    parser.add_argument("--json", action="store_true", help="print one JSON document")
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    from dataclasses import replace

    from gcs.analysis.comparison import flown
    from gcs.analysis.notes import note_lines
    from gcs.analysis.pages.pictures import compare_picture
    from gcs.analysis.rungs import load_fit
    from gcs.analysis.text.comparison import compare_text
    from gcs.analysis.text.documents import comparison_document
    from gcs.analysis.vehicles import doubted
    from gcs.cli.fit import print_notes, with_warnings
    from sysid.compare.compare import compare

    band, window, profile = parse_reading(args)
    refuse_plot(args.plot, args.force)
    fit = load_fit(args.fit, parse_words(args.effects))
    if band is not None:
        fit = replace(fit, band_hz=band)
    records, quiet = flown(fit, args.runs, profile, window)
    print_notes(note_lines([*records, *quiet]))
    found = compare(fit.model, records, fit.band_hz, quiet, own_runs=not args.runs)
    doubts = doubted(records)
    text = with_warnings(compare_text(found, fit), doubts)
    write_plot(args.plot, lambda: compare_picture(found), f"tippath compare: {args.fit.name}", text)
    if args.json:
        print_json(comparison_document(found, doubts))
    else:
        print(text)
    return 0
