"""`tippath ingest`: list the runs in logs with their health, and write records.

The listing is for people unless --json asks for the `tippath.runs/1` document. Nothing is written before it is certain
that everything can be: an existing file stops the command, not half of its work. With --json the document is printed
also where no log could be read: `refused` says why.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from gcs.cli.options import add_loop_option, refuse_existing, write_text

if TYPE_CHECKING:
    from gcs.logs import Ingest
    from gcs.logs.runs.of_flight import FlightRuns

_FORMAT_HELP = """\
--json prints {"format": "tippath.runs/1", "runs": [{"id", "path", "maneuver", "axis", "start_s", "duration_s",
"rate_hz", "gaps": [[start_s, stop_s]], "usable", "usable_to_hz" (up to which frequency it would be, where it is not),
"reasons", "notes", "rate_source", "swept_band_hz", "excitation", "health": {"jitter", "clipped", "saturated_share",
"command_band_hz": {axis: [low, high]}, "coherence": {axis: {"band_hz", "share"}}, "input_correlation", "quiet":
[{"where", "start_s", "duration_s"}], "latency": [{"field", "against", "late_ms", "correlation"}]}, "record"}],
"damage": {path: {"total_bytes", "skipped_bytes", "resyncs", "unknown", "tail_cut"}}, "sources", "refused": {path:
reason}, "left_out": {flight folder: other logs in it}}. start_s and duration_s are the maneuver's; a record also
holds up to 0.5 s before and 1 s after it. Each source has "joined": null, or of logs that were read together
{"files": [{"path", "sha256", "samples", "filled", "damage"}], "samples", "shared", "unlike", "missing", "stretches":
[[start_s, stop_s]], "complete": true, false or null (not shown)}, and "apart": {path: why it was not read with them}.
With --explain each source also has "channels": {channel: {"unit", "source", "scale", "offset"}}, "absent": {channel:
reason} and "fields".

What was read is kept beside the log in a folder .tippath and taken from there the next time, as long as log, profile
and window are the same; it may be removed at any time. TIPPATH_CACHE=off in the environment does without it.

A flight's flight.BIN and what was fetched of the same flight are read together, as flight.BIN: a sample that one of
them lacks is taken from the other. They are of one flight where samples of the same time are equal to the last byte;
where a few differ, the fetched ones are taken, and counted. The files stay as they are. A fetched-N.BIN that is named
is read alone.

--join is for converters that write a CSV for each topic: `tippath ingest --join gyro.csv cmd.csv --profile FILE.toml
-o DIR`, then `tippath fit DIR/gyro-1.npz`. Each has its own clock, in the time column and the unit that [time] names. A
column is called by its name where no other file has it, and by FILE.column always (`source = "gyro.x"`, FILE without
what all names begin with); commands are brought onto the clock of the rates as in any log.

--flight FOLDER is for a log off the vehicle's card, of a flight with `--log card`: its runs are matched to the flight's
by the vehicle's clock, and it is read together with what FOLDER has of the flight; with --json "flight": {"matches":
[{"label", "run", "off_s"}], "problem"}. A log of another boot has other times: that is said, and the exit status is 1.

A file of frequency responses is a run for each command: .csv with columns frequency_hz or omega (rad/s), real and
imaginary or db and deg, and coherence, bound_db, output, input where there are such; .mat of such arrays; the .json and
.txt of `tippath response`. [response] of a profile names what is not told (input, output, columns).

A flight.json beside a log is believed: a run that it says is to be flown again (aborted, link lost, limits left) is
listed as not usable; `tippath fit LOG#n` takes it all the same.
"""


def add_parser(subparsers: Any) -> argparse.ArgumentParser:
    """Add the command to argparse's subparsers."""
    parser: argparse.ArgumentParser = subparsers.add_parser(
        "ingest",
        help="list the runs in logs with their health; write records",
        description="List the runs in logs with their health; write records. Reads DataFlash .BIN and .log, ULog .ulg, "
        "telemetry .tlog, Betaflight's, INAV's and Rotorflight's blackbox (.bbl, .bfl, .TXT), the Crazyflie's uSD "
        "card, Paparazzi's .log with .data, .csv, MATLAB's .mat, MCAP of ROS 2 and .parquet, whole or damaged. A "
        "folder is searched for them, and so are those in it; of a flight folder its flight*.BIN are taken, with what "
        "`tippath fetch` brought of the same flight, or that alone.",
        epilog=_FORMAT_HELP,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("logs", nargs="+", metavar="LOG", type=Path, help="a log, a flight folder or a record")
    parser.add_argument(
        "--flight",
        metavar="FOLDER",
        type=Path,
        help="the flight that a log off the vehicle's card is of: which runs are",
    )
    parser.add_argument(
        "--join", action="store_true", help="the CSVs named are one flight's, joined by time; -o writes its record"
    )
    parser.add_argument(
        "-o",
        dest="output",
        metavar="DIR",
        type=Path,
        help="write the usable runs there as records; with --explain a FILE.toml, the proposed profile",
    )
    parser.add_argument("--explain", action="store_true", help="channels found, not found, and what to write")
    parser.add_argument("--profile", metavar="FILE.toml", type=Path, help="where the channels come from")
    parser.add_argument(
        "--window",
        metavar="[@]START:STOP",
        help="seconds of the log's own time, or with @ from each run's start (@5:25); ends may be left open",
    )
    add_loop_option(parser)
    parser.add_argument("--force", action="store_true", help="overwrite records that exist")
    parser.add_argument("--json", action="store_true", help="one JSON document on stdout")
    parser.set_defaults(run=run)
    return parser


def run(args: argparse.Namespace) -> int:
    """Exit status 0, or 1 where no run is usable. Raises TippathError for what a user can put right."""
    from gcs.cli.listing import explanation, proposed_profile, write_records
    from gcs.logs import Ingest, UnreadableError
    from gcs.logs.runs.health import F_HIGH_HZ
    from gcs.logs.runs.of_flight import of_flight
    from gcs.logs.words import printable

    profile = _asked_profile(args)
    refuse_existing(profile, args.force)
    try:
        found = _read(args)
    except UnreadableError as error:
        if not (args.json or args.explain):
            raise
        found = Ingest((), (), error.refused)
    joined_csvs = [Path(log) for log in args.logs] if args.join else []
    joined = {source.path: source.joined for source in found.sources if source.joined is not None}
    flight = None if args.flight is None else of_flight(found.runs, args.flight, joined)
    if flight is not None:
        found = replace(found, runs=flight.runs)
    written: dict[str, str] = {}
    if profile is not None:
        write_text(proposed_profile(explanation(found, joined_csvs)), profile)
        print(f"wrote {profile}", file=sys.stderr)
    elif args.output is not None:
        written = write_records(found, args.output, args.force)
    if args.json:
        print(json.dumps(_document(found, written, flight, explain=args.explain), indent=1, allow_nan=False))
    else:
        _print(found, written, flight, explain=args.explain, joined=joined_csvs)
    for reason in found.refused.values():
        print(f"not read: {printable(reason)}", file=sys.stderr)
    if flight is not None and flight.problem:
        print(f"not the log of {args.flight}", file=sys.stderr)
        return 1
    if not found.usable:
        lower = any(run.usable_to_hz is not None for run in found.runs)
        print(f"no run is usable{f' up to {F_HIGH_HZ:g} Hz' if lower else ''}", file=sys.stderr)
        return 1
    return 0


def _asked_profile(args: argparse.Namespace) -> Path | None:
    """Where the proposed profile goes; None where records, or nothing, are to be written."""
    toml = args.explain and args.output is not None and args.output.suffix == ".toml"
    return args.output if toml else None


def _read(args: argparse.Namespace) -> Ingest:
    """What the logs hold. Raises UnreadableError, and UsageError for options that exclude each other."""
    from gcs.cli.counting import ReadingBar
    from gcs.errors import UsageError
    from gcs.logs import ingest, ingest_joined, parse_window

    window = None if args.window is None else parse_window(args.window)
    if args.join and args.flight is not None:
        raise UsageError("--join is of CSVs, --flight of a log off the vehicle's card: name one of them")
    if args.join:
        return ingest_joined(args.logs, args.profile, window, loop_rate_hz=args.loop_rate)
    with ReadingBar() as bar:
        return ingest(args.logs, args.profile, window, loop_rate_hz=args.loop_rate, flight=args.flight, progress=bar)


def _print(
    found: Ingest,
    written: Mapping[str, str],
    flight: FlightRuns | None,
    *,
    explain: bool,
    joined: Sequence[Path],
) -> None:
    from gcs.cli.listing import explanation, table  # as in `run`
    from gcs.logs.words import printable

    if found.runs or found.sources:
        print("\n".join(table(found)))
    for words in [] if flight is None else [flight.problem] if flight.problem else flight_words(flight):
        print(f" {words}")
    for path in written.values():
        print(f" wrote {printable(path)}")
    if explain and (lines := explanation(found, joined)):
        print("\n".join(lines))


def flight_words(flight: FlightRuns) -> list[str]:
    """Which of the flight's runs is which of the log."""
    return [match.words for match in flight.matches]


def _document(found: Ingest, written: Mapping[str, str], flight: FlightRuns | None, *, explain: bool) -> dict[str, Any]:
    from gcs.cli.listing import document

    made = document(found, dict(written), explain=explain)
    return made if flight is None else {**made, "flight": flight.to_json()}
