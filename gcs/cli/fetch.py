"""`tippath fetch`: a log off the vehicle after the flight, byte for byte."""

from __future__ import annotations

import argparse
import contextlib
import sys
import textwrap
import time
from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any, TextIO

from gcs.cli.options import print_json
from gcs.cli.push import add_link_options, station
from gcs.cli.terminal import REDRAW, control
from gcs.errors import TippathError, UsageError

if TYPE_CHECKING:
    from gcs.flight.fetching.fetch import Fetched, Progress
    from gcs.flight.fetching.of_flight import Wanted
    from gcs.flight.fetching.ways import VehicleLog
    from gcs.flight.folder import FlightFolder
    from gcs.logs.formats.joined import Joined

_HELP = """\
Into a flight's folder (one with a flight.json) comes the log (of a flight that was resumed those of each part) that
covers that flight's runs on the vehicle's clock, as fetched-NNNNNNNN.BIN, beside what was streamed; flight.json names
it, and both are read together from then on, each for what the other lacks, where they are shown to be of one flight.
Into any other folder comes the newest log, or --log NUMBER, as NNNNNNNN.BIN. Where a flight's whole log would take more
than a minute, its head and what it holds around the flight's runs come alone, as fetched-NNNNNNNN.runs-only.BIN, or
with --run N that run's, as fetched-NNNNNNNN.run-N-only.BIN; --whole fetches all of it. How long it will take is said
first.

A fetch that was cut (Ctrl-C, a lost link, a full disk) leaves NNNNNNNN.BIN.part; the same command goes on with it, if
pieces of it are still the vehicle's, else it begins another file. Nothing is written over. What came by MAVFTP, or from
a vehicle that has it, is checked by the vehicle's own CRC32.

--json prints {"format": "tippath.fetch/1", "file", "log", "on_vehicle", "bytes", "by", "seconds", "bytes_per_s",
"resumed_from", "crc32", "checked", "grows" (the vehicle was still writing), "already" (it was there), "run" or null,
"runs" (those that came alone) or null, "chosen", "joined" (with the streamed log, as `ingest` has it) or null, "apart"
(why it is not of one flight with it) or null, "more" (the same of each further log, where a resumed flight lies in
several)}, with --list {"format", "logs": [{"log", "on_vehicle", "bytes", "written"}]}, or {"format", "reason"}. Exit
status: 0 fetched; 1 the vehicle or the disk says no; 2 wrong usage; 130 ended by Ctrl-C.
"""
EVERY_S, REDRAW_S = 5.0, 0.2
FORMAT = "tippath.fetch/1"


def add_parser(subparsers: Any) -> None:
    parser: argparse.ArgumentParser = subparsers.add_parser(
        "fetch",
        help="a log off the vehicle, after the flight",
        description="Fetch a log from the vehicle's card over the link, by MAVFTP or LOG_REQUEST_DATA, whichever it "
        "answers and is quicker. The vehicle must be disarmed.",
        epilog=_HELP,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    add_link_options(parser)
    parser.add_argument("--list", action="store_true", help="only say which logs there are")
    parser.add_argument("--log", type=int, metavar="NUMBER", help="this log, whatever flight it is of")
    parser.add_argument(
        "--run", dest="number", type=int, metavar="N", help="what is needed for run N of the flight in DIR"
    )
    parser.add_argument("--whole", action="store_true", help="the whole log of a flight, however long it takes")
    parser.add_argument("--by", choices=("ftp", "log"), help="one way only: MAVFTP, or LOG_REQUEST_DATA")
    parser.add_argument("-o", "--output", type=Path, metavar="DIR", help="a flight's folder, or any other")
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Exit status 0. Raises TippathError for what a user meets; with --json its words are in the document, too."""
    try:
        return _run(args)
    except UsageError:
        raise
    except TippathError as error:
        if args.json:
            print_json({"format": FORMAT, "reason": str(error)})
        raise


def _run(args: argparse.Namespace) -> int:
    from gcs.flight.fetching.fetch import Fetching, require_disarmed
    from gcs.flight.fetching.of_flight import Asked, bring, choose, note, size_words
    from gcs.flight.fetching.ways import list_logs
    from gcs.flight.session import Session

    flight = None if args.list else _flight(args)
    lines = ProgressLines()
    with Session.open(args.connect, **station(args)) as session:
        require_disarmed(session)
        lines.say("asking the vehicle for its logs")
        logs = list_logs(session)
        if args.list:
            _print_logs(logs, args.json)
            return 0
        fetching = Fetching(session=session, by=args.by, on_progress=lines)
        asked = Asked(output=args.output, flight=flight, log=args.log, run=args.number, whole=args.whole)
        wanted = choose(asked, fetching, logs, lines.say)
        came: list[tuple[Wanted, Fetched]] = []
        for one in wanted:
            lines.say(f"log {one.choice.log.number} ({one.choice.words}): {size_words(one.choice.log.size)}")
            try:
                done = bring(asked, fetching, one, lines.say)
            except KeyboardInterrupt:
                lines.say(
                    "ended; the vehicle sends no more. What came is kept as .part: the same command goes on with it"
                )
                raise
            finally:
                lines.end()
            came.append((one, done))
            if flight is not None:
                note(flight, done, one.of)
    documents = [_told(args, flight, one, done) for one, done in came]
    if args.json:
        more = {"more": documents[1:]} if len(documents) > 1 else {}
        print_json({"format": FORMAT, **documents[0], **more})
    return 0


def _told(args: argparse.Namespace, flight: FlightFolder | None, wanted: Wanted, done: Fetched) -> dict[str, Any]:
    """Print what came, unless a document is wanted, and give that."""
    joined, apart = (None, None) if flight is None else _with_streamed(flight, done.path)
    if not args.json:
        _print_result(done)
        if joined is not None:
            print(_indented(f"with the streamed log: {joined.words}"))
        if apart is not None:
            print(_indented(f"not read with the streamed log: {apart}"))
    together = {"joined": None if joined is None else joined.to_json(), "apart": apart}
    return {**done.to_json(), "chosen": wanted.choice.words, **together}


def _indented(text: str) -> str:
    return textwrap.fill(text, 78, initial_indent="   ", subsequent_indent="   ", break_on_hyphens=False)


def _with_streamed(flight: FlightFolder, came: Path) -> tuple[Joined | None, str | None]:
    """What the file makes with the flight's streamed logs, or why it is not read with them; neither without them."""
    from gcs.logs.flight_files import is_streamed
    from gcs.logs.joining import open_joined

    apart = None
    for log in sorted(path for path in flight.path.iterdir() if is_streamed(path)):
        try:
            opened = open_joined(log, [came], None)
        except TippathError as error:
            apart = str(error)
            continue
        if opened.joined is not None:
            return opened.joined, None
        apart = opened.apart.get(str(came))
    return None, apart


def _flight(args: argparse.Namespace) -> FlightFolder | None:
    """The flight in DIR, which is made where it is not there; None where DIR is no flight's. Raises UsageError."""
    from gcs.flight.folder import FlightFolder

    if args.output is None:
        raise UsageError("say with -o DIR where the log goes: a flight's folder, or any other")
    folder = FlightFolder(args.output)
    if args.output.exists() and not args.output.is_dir():
        raise UsageError(f"{args.output} is a file; name a folder with -o DIR")
    flown = folder.about.is_file()
    if args.number is not None and not flown:
        raise UsageError(
            f"--run {args.number} is of a flight, and {args.output} is no flight's folder (no flight.json)"
        )
    if args.number is not None and not 1 <= args.number <= len(folder.runs()):
        raise UsageError(f"--run {args.number}: the flight in {args.output} has {len(folder.runs())} run(s)")
    try:
        args.output.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise TippathError(
            f"{args.output} cannot be made ({error.strerror or error}); choose another -o DIR"
        ) from error
    return folder if flown else None


def _print_logs(logs: Sequence[VehicleLog], as_json: bool) -> None:
    from gcs.flight.fetching.of_flight import size_words

    if as_json:
        entries = [
            {"log": log.number, "on_vehicle": log.path, "bytes": log.size, "written": _written(log)} for log in logs
        ]
        print_json({"format": FORMAT, "logs": entries})
        return
    for log in logs:
        size, written = size_words(log.size), _written(log) or "time not known"
        print(f"{log.number:>6}  {size:>10}  {written}  {log.path or ''}".rstrip())
    if not logs:
        print("the vehicle has no logs")


def _written(log: VehicleLog) -> str | None:
    if log.utc_s == 0:
        return None
    with contextlib.suppress(OverflowError, OSError, ValueError):
        return datetime.fromtimestamp(log.utc_s, UTC).isoformat(timespec="seconds")
    return None


def _print_result(done: Fetched) -> None:
    from gcs.flight.fetching.of_flight import size_words

    if done.already:
        print(f" {done.path} is there already, and is the vehicle's")
    else:
        from_before = f", {size_words(done.resumed_from)} of them from before" if done.resumed_from else ""
        how = f"{size_words(done.size)}{from_before}, in {done.seconds:.1f} s"
        print(f" fetched {done.path}  {how}")
    if done.runs:
        print(f"   {_runs(done.runs)} alone; --whole fetches the rest, too")
    elif done.checked:
        print(f"   CRC32 {done.crc32:08x}, as on the vehicle")
    elif done.grows:
        print("   the vehicle still writes this log: here is what it had")
    else:
        print(f"   CRC32 {done.crc32:08x}; the vehicle does not tell its own, so only the size is checked")


def _runs(numbers: Sequence[int]) -> str:
    listed = ", ".join(str(number) for number in numbers)
    return f"run {listed}" if len(numbers) == 1 else f"runs {listed}"


class ProgressLines:
    """How far it is, in lines on standard error; on a terminal drawn over each other."""

    def __init__(self, stream: TextIO | None = None) -> None:
        self._stream = stream or sys.stderr
        self._terminal = self._stream.isatty()
        self._next = 0.0
        self._open = False
        self._told: tuple[int, str] | None = None

    def __call__(self, progress: Progress) -> None:
        from gcs.flight.fetching.of_flight import size_words
        from gcs.flight.fetching.ways import NAMES

        now = time.monotonic()
        if progress.rate and self._told != (progress.log.number, progress.way) and progress.lost_s is None:
            self._told = (progress.log.number, progress.way)
            self.say(f"by {NAMES[progress.way]}: {size_words(round(progress.rate))}/s, about {_duration(progress)}")
        if now < self._next:
            return
        self._next = now + (REDRAW_S if self._terminal else EVERY_S)
        if progress.lost_s is not None:
            text = f" ✗ link lost for {progress.lost_s:.0f} s, waiting; Ctrl-C ends, and what came is kept"
        elif progress.rate is None:
            return
        else:
            share = 100 * progress.at // max(1, progress.size)
            at, rate = size_words(progress.at), size_words(round(progress.rate))
            text = f" {at}  {share} %  {rate}/s  {_duration(progress)} left"
        if self._terminal:
            control(self._stream, REDRAW)
        self._stream.write(text if self._terminal else f"{text}\n")
        self._open = self._terminal
        self._stream.flush()

    def say(self, text: str) -> None:
        self.end()
        self._stream.write(f" {text}\n")
        self._stream.flush()

    def end(self) -> None:
        """No line stays half drawn."""
        if self._open:
            control(self._stream, REDRAW)
            self._open = False


def _duration(progress: Progress) -> str:
    from gcs.flight.fetching.of_flight import time_words

    return "an unknown time" if progress.left_s is None else time_words(progress.left_s)
