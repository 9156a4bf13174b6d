"""`tippath response`: measured frequency responses with error bounds."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import Any

from gcs.cli.options import (
    add_band_option,
    add_log_options,
    add_loop_option,
    add_plot_option,
    parse_band,
    parse_profile,
    print_json,
    refuse_existing,
    refuse_plot,
    write_plot,
)

_FORMAT_HELP = """\
RUN is a flight folder or a log (all its usable runs), LOG#n (its n-th run, as `tippath ingest` numbers them), or a
record written by ingest. All runs are taken together: of a run that sweeps one axis nobody can tell what the other
command did, so give sweeps of both.

-o FILE writes every frequency; its ending says how: .csv (output, input, frequency_hz, db, deg, coherence, bound_db,
bound_deg, real, imaginary, window_hz, valid), .json (the document of --json), .mat (MATLAB 5: H, db, deg, coherence,
bound_db, bound_deg, valid as outputs x inputs x frequencies, frequency_hz, omega_rad_s), .txt (CIFER's columns: rad/s,
dB, degrees, coherence, random error).

--json prints {"format": "tippath.response/1", "inputs", "outputs", "frequency_hz", "references",
"feedback_kept_out_by": {input: "excitation logged", "excitation rebuilt" or "commands"}, "bounds_percent",
"responses": [{"output", "input", "unit", "valid_hz": [low, high] or null, "reason", "db", "deg", "real", "imaginary",
"coherence" (partial), "bound_db", "bound_deg", "window_hz", "valid"}], "multiple_coherence", "runs", "band_hz",
"remarks", "warnings"}. Responses are those of the vehicle to the command as its loop held it: the hold is taken out.
Bounds hold 95 of 100 times; window_hz is how far the windows reached to either side, on average.
"""


def add_parser(subparsers: Any) -> None:
    parser: argparse.ArgumentParser = subparsers.add_parser(
        "response",
        help="measured frequency responses with error bounds",
        description="Measure the frequency responses of the rates to the commands from several runs together, each "
        "conditioned on the other commands, in windows of several widths, with coherence and error bounds.",
        epilog=_FORMAT_HELP,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("runs", nargs="+", metavar="RUN")
    parser.add_argument(
        "--inputs",
        metavar="COMMAND,...",
        help="which commands (default: delta_x and delta_y as far as they move, and delta_e where it moves as much)",
    )
    parser.add_argument("--outputs", metavar="CHANNEL,...", help="which answers (default: p,q)")
    add_band_option(parser)
    add_log_options(parser)
    add_loop_option(parser)
    add_plot_option(parser)
    parser.add_argument(
        "-o", "--output", type=Path, metavar="FILE", help="write them as .csv, .json, .mat, or .txt as CIFER lists them"
    )
    parser.add_argument("--force", action="store_true", help="overwrite the files")
    parser.add_argument("--json", action="store_true", help="print one JSON document")
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    from gcs.analysis.axes import asked_of
    from gcs.analysis.band import chosen_band
    from gcs.analysis.notes import note_lines
    from gcs.analysis.pages.responses import responses_picture
    from gcs.analysis.response_files import KINDS
    from gcs.analysis.text.response import response_document, response_text
    from gcs.analysis.vehicles import doubted
    from gcs.cli.fit import print_notes, with_warnings
    from gcs.errors import TippathError, UsageError
    from gcs.files import write_whole
    from gcs.logs import parse_window, resolve_runs
    from sysid.data.record import RATES
    from sysid.response.flown import flown_responses

    refuse_plot(args.plot, args.force)
    if args.output is not None and args.output.suffix.lower() not in KINDS:
        raise UsageError(f"-o {args.output}: name a file that ends in {', '.join(KINDS)}")
    refuse_existing(args.output, args.force)
    asked = None if args.band is None else parse_band(args.band)
    window = None if args.window is None else parse_window(args.window)
    inputs, outputs = (parse_channels(words) for words in (args.inputs, args.outputs))
    high_hz = 15.0 if asked is None else asked[1]
    read = resolve_runs(args.runs, parse_profile(args.profile), window, f_high_hz=high_hz, loop_rate_hz=args.loop_rate)
    records = [record for record in read if record.maneuver != "quiet"]
    if not records:
        raise TippathError("quiet hover shows no response: name a sweep")
    if inputs == outputs == ():
        records, inputs, outputs = asked_of(records)
    print_notes(note_lines(records))
    found = flown_responses(records, asked or chosen_band(records).hz, inputs, outputs or RATES)
    doubts = doubted(records)
    document = response_document(found, doubts)
    text = with_warnings(response_text(found), doubts)
    write_plot(args.plot, lambda: responses_picture(found), "tippath response", text)
    if args.output is not None:
        write_whole(KINDS[args.output.suffix.lower()](document), args.output)
        print(f"wrote {args.output}", file=sys.stderr)
    if args.json:
        print_json(document)
    else:
        print(text)
    return 0 if any(found.why_not(*pair) is None for pair in found.pairs) else 1


def parse_channels(text: str | None) -> tuple[str, ...]:
    """`p,q` to names of channels; none where nothing is asked for. Raises UsageError."""
    from gcs.errors import UsageError
    from sysid.data.record import CHANNELS

    names = tuple(() if text is None else (word.strip() for word in text.split(",")))
    for name in names:
        if name not in CHANNELS or name == "t":
            raise UsageError(f"{name or 'an empty name'}: is no channel; there are {', '.join(CHANNELS)}")
    return names
