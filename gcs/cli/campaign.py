"""`tippath campaign`: many logs, each fitted once, put together by vehicle and configuration."""

from __future__ import annotations

import argparse
import sys
import textwrap
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any, TextIO

from gcs.cli.counting import Bar
from gcs.cli.log_settings import add_settings_options, parse_settings
from gcs.cli.options import print_json, write_json
from gcs.errors import UsageError

if TYPE_CHECKING:
    from gcs.campaign.given import Given
    from gcs.campaign.workers import Progress

EVERY_S = 30.0
"""Between two lines of progress where the output is no terminal."""

_HELP = """\
What is done is kept in the campaign's folder (-o), by the log's bytes, the settings and this program's code: called
again, with more logs or after anything was cut off, it goes on and does nothing twice. A log that cannot be used is
told with its reason, which are counted. Logs that hold the same flight, whole or cut, count once.

Flights are put together by vehicle and by what a model stands on (loop rate, filters, rotor speed, mixer), as their
logs tell it. A campaign.toml in the folder of the logs, or --about FILE, says what they do not tell; later tables add
to, and go before, earlier ones:
  [[logs]]
  files = ["heli-a/**"]            # names and patterns, from this file's folder
  vehicle = "heli A"
  [[logs]]
  files = ["heli-a/flight-003*"]
  configuration = "new blades"
  date = 2026-05-03                # else: the log's satellites, its flight.json, name, or the file's time

--scheduler is the address of a Dask cluster (`dask scheduler`, and on each computer `dask worker ADDRESS --nthreads 1`
from the Python that has this same tippath); the workers must see the logs under the same paths. Whoever reaches a
scheduler can run programs on its workers: keep it in a network of your own.

dataset/ in the folder has Parquet tables, joined by "key" (pandas.read_parquet, polars.read_parquet, duckdb):
  logs        of each log: group, copy_of, flown, airframe, reason and words where there is no fit, omega, airspeed
  runs        of each run: maneuver, axis, start_s, duration_s, usable, reasons
  health      of each run and axis: rate_hz, gaps, gaps_s, jitter, saturated_share, follows_low_hz, follows_high_hz,
              follows_share
  fits        of each output: structure, band, nrmse_percent, validation_..., predicted_... (by another flight's model)
  parameters  value, unit, standard_error, model_error, and its row of the covariance, in the order of "place"
  verdicts    with --diagnose: verdict, effect, stands_in, indistinguishable, indistinguishable_pairs, confidence,
              explained_share

campaign.json, and --json, is {"format": "tippath.campaign/1", "folder", "logs", "fitted", "version", "copies": {log:
log}, "reasons": [{"reason", "words", "count", "logs"}], "groups": [{"name", "structure", "flights": [{"log", "key",
"flown", "flown_told_by", "nrmse_percent", "predicted_nrmse_percent", "verdict", "effect"}], "parameters": {name:
{"mean", "unit", "standard_error", "between", "within_days", "flights", "days"}}}], "findings": a
tippath.findings/1 document: what changed, when, and what goes with rotor speed or airspeed}. "between" is the standard
deviation between days beyond the flights' own errors, "within_days" that between flights of one day (null where no day
has two).

A parameter of a flight is taken as a mean, plus what goes with rotor speed and airspeed where they differ and there are
days enough (straight lines), plus a deviation of its day, plus one of the flight, plus the error that its fit states: a
mixed model of which the days are the random effect. A step or a drift is counted among orders of the days; days that
lie apart are told and left out of the mean. What a fit ended at its bound (a delay at 0) counts there, as well known as
other flights know it; what all ended there has no course.
"""


def add_parser(subparsers: Any) -> None:
    parser: argparse.ArgumentParser = subparsers.add_parser(
        "campaign",
        help="many logs: fitted, put together by vehicle, predicted by each other",
        description="Find runs in many logs, fit each log, put them together by vehicle and configuration, see whether "
        "one flight's model predicts another, and keep it all as tables. On all cores, or on a Dask cluster.",
        epilog=_HELP,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("logs", nargs="+", type=Path, metavar="DIR|LOG", help="logs, or folders that hold some")
    add_settings_options(parser)
    parser.add_argument("--diagnose", action="store_true", help="ask of each fit what it lacks: takes seconds for each")
    parser.add_argument("--about", type=Path, metavar="FILE.toml", help="a campaign.toml that lies elsewhere")
    parser.add_argument(
        "--scheduler", metavar="ADDRESS", help="a Dask cluster, as tcp://HOST:8786 (default: own cores)"
    )
    parser.add_argument("--workers", type=int, metavar="N", help="processes on this computer (default: its cores)")
    parser.add_argument(
        "-o", "--output", type=Path, default=Path("campaign"), metavar="DIR", help="the campaign's folder (campaign)"
    )
    parser.add_argument("--json", action="store_true", help="print one JSON document")
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    from gcs.campaign.campaign import ABOUT, found_logs, refuse_strangers, refuse_without_extra, run_campaign
    from gcs.campaign.dataset import write_dataset
    from gcs.campaign.findings import found
    from gcs.campaign.page import write_page
    from gcs.campaign.sentences import told
    from gcs.campaign.summary import document, text
    from gcs.logs.words import printable

    if args.workers is not None and (args.workers < 1 or args.scheduler is not None):
        raise UsageError("--workers wants a number of processes on this computer; a cluster has its own")
    settings = parse_settings(args, diagnose=args.diagnose)
    refuse_without_extra()
    refuse_strangers(args.output)
    logs = found_logs(args.logs)
    given = _given(args)
    for pattern in given.unmatched(logs):
        print(f"note: {printable(pattern)} in campaign.toml names none of these logs", file=sys.stderr)
    args.output.mkdir(parents=True, exist_ok=True)
    if not (args.output / ABOUT).is_file():
        write_json({"format": "tippath.campaign/1", "folder": str(args.output)}, args.output / ABOUT)
    with CampaignBar() as bar:
        try:
            campaign = run_campaign(
                logs, settings, given, args.output, scheduler=args.scheduler, workers=args.workers, on_progress=bar
            )
        except KeyboardInterrupt:
            bar.close()
            print(f"{bar.words}; the same command goes on from there", file=sys.stderr)
            raise
    findings = found(campaign.groups, known_copies=campaign.copies)
    made = document(campaign, findings, args.output) | {"findings": findings.to_json()}
    write_dataset(campaign.outcomes, campaign.groups, campaign.copies, args.output)
    write_page(findings, campaign.groups, campaign.failed, args.output / "campaign.html")
    write_json(made, args.output / ABOUT)
    if args.json:
        print_json(made)
    else:
        print(text(campaign, findings))
        print("\n" + "\n".join(textwrap.fill(printable(one), 78, subsequent_indent="  ") for one in told(findings)))
        print(f"\nkept in {args.output}: campaign.html, campaign.json, dataset/")
    return 0 if campaign.groups else 1


def _given(args: argparse.Namespace) -> Given:
    """What campaign.toml says: the one that is named, or that lies in a folder of the logs."""
    from gcs.campaign.given import NAME, Given, load

    there = [args.about] if args.about is not None else [one / NAME for one in args.logs if (one / NAME).is_file()]
    if len(there) > 1:
        raise UsageError(f"{there[0]} and {there[1]}: name one with --about")
    return load(there[0]) if there else Given()


class CampaignBar:
    """How far it is, as a bar on a terminal's standard error; elsewhere a line now and then."""

    def __init__(self, stream: TextIO | None = None) -> None:
        self._stream = stream or sys.stderr
        self._bar = Bar(self._stream)
        self._next = time.monotonic() + EVERY_S
        self._begun: set[str] = set()
        self.words = "nothing is done yet"

    def __enter__(self) -> CampaignBar:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def __call__(self, progress: Progress) -> None:
        self.words = progress_words(progress)
        if self._stream.isatty():
            self._bar.draw(progress.done / max(1, progress.of), self.words)
            return
        if progress.kept and progress.what not in self._begun:
            self._write(f"{progress.kept} of {progress.of} {progress.what} were done before")
        self._begun.add(progress.what)
        if time.monotonic() >= self._next:
            self._next = time.monotonic() + EVERY_S
            self._write(self.words)

    def _write(self, words: str) -> None:
        self._stream.write(f" {words}\n")
        self._stream.flush()

    def close(self) -> None:
        """Leave an empty line."""
        self._bar.close()


def progress_words(progress: Progress) -> str:
    """`12 of 200 logs, 5 of them before   2.1 a second   1 min 30 s left`."""
    words = f"{progress.done} of {progress.of} {progress.what}"
    if progress.kept:
        words += f", {progress.kept} of them before"
    worked = progress.done - progress.kept
    if progress.waiting_for:
        return f"{words}   waiting for a {progress.waiting_for}"
    if progress.left_s is None or not progress.seconds:
        return words
    rate = worked / progress.seconds
    pace = f"{rate:.1f} a second" if rate >= 1 else f"{60 * rate:.1f} a minute"
    return f"{words}   {pace}   {_duration(progress.left_s)} left"


def _duration(seconds: float) -> str:
    minutes, rest = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours} h {minutes} min" if hours else f"{minutes} min {rest} s" if minutes else f"{rest} s"
