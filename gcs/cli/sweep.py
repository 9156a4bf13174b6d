"""`tippath sweep`: fly a maneuver or a card without a screen, and record it.

On hardware somebody types a word before anything moves. A vehicle counts as simulated where the link ends on this very
machine and the vehicle offers Table 1's excitation, which the bundled one does; a radio that a router forwards to this
machine looks the same, so `--hardware` asks for the word in any case.
"""

from __future__ import annotations

import argparse
import ipaddress
import sys
import textwrap
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from gcs.cli import EXIT_DONE, EXIT_INTERRUPTED, EXIT_NO
from gcs.cli.options import print_json
from gcs.cli.push import add_dry_option, add_link_options, add_vehicle_option, station
from gcs.errors import TippathError, UsageError

if TYPE_CHECKING:
    from gcs.analysis.following import Following
    from gcs.cards.maneuver import TestCard
    from gcs.flight.connection import LogWay
    from gcs.flight.flown_card import SweepResult
    from gcs.flight.folder import FlightFolder
    from gcs.flight.resume import Earlier
    from gcs.flight.run import RunResult
    from gcs.flight.session import Session
    from gcs.vehicle.profile import VehicleProfile

CARDS = Path(__file__).parents[1] / "cards"
WORD = "fly"
LEAVE_OUT = "leave out"

_HELP = """\
-o DIR takes the flight's folder (default: the next flight-NNNN): flight.BIN is the vehicle's own log, flight.tlog the
telemetry, card.toml the card, flight.json the runs and verdicts.

Ctrl-C ends the excitation first: the mode before the run is sent again and again while the vehicle is in its excitation
mode, and never after the pilot chose another. Nothing here arms, takes off or lands. A lost link is waited for up to a
minute, to end the excitation then; Ctrl-C ends that wait, and the pilot takes over in any case.

Before it a vehicle is looked at with `tippath check`, on the ground. One that streams its log can be armed only while a
log client answers it: --wait does, until the pilot has taken off; where another station answers, it stays silent.

The probe: five quiet seconds, then a step of a fifth of the card's amplitude on each axis. It tells reversed or swapped
commands and gyros, lag, noise and a faulty log before 30 s are flown, and the amplitude up to which the card is
predicted to stay within its limits, an abort's delay included. Where something is wrong, the card is not flown.

--log card needs no more of a link than telemetry (57,600 baud): nothing of the log is sent. Limits, start and end come
from attitudes (10 to 50 a second, as many as the link carries), heartbeats and texts; the vehicle must keep its log by
itself (where it does not, the refusal names the setting) and tell of no failure, and dead telemetry ends a run as a
dead log does. Commands are not watched, there is no probe, and whether a run is worth keeping is known when the log was
read: `tippath fetch`, then `tippath ingest DIR`.

--resume DIR goes on with a flight that was cut off (kill -9, a dead laptop, a full disk) or ended early, in its own
folder: card.toml says what was to be flown, flight.json what was. Runs that were kept, and whose samples reached the
disk, are not flown again; the others are, in order, after the same checks, probe and typed word. Nothing starts by
itself. A vehicle that is still in its excitation mode is refused and never fought: the pilot takes it out, or `tippath
abort`. The log goes into the next free file (flight-2.BIN), and flight.json keeps what it said. What a run that nobody
lived to end left in the vehicle's parameters is put back, too. Another vehicle, a changed card, a damaged flight.json
or a folder that is being flown into are refused. Where nothing is left that is said, and the exit status is that of the
whole flight.

A card in the paper's words is flown as far as the vehicle can: what it cannot fly (on ArduPilot doublets and the noise)
is listed, and left out only after --leave-out or a typed answer. ArduPilot has cards of its own, ardupilot-heli and
ardupilot-quad, each with a -quick one; the one that fits is flown where no card is named.

A card is a TOML file. What is left out is the paper's Table 1:

  name = "my card"
  description = "what it is for"
  rest_s = 2                  # hover between two runs
  [limits]                    # beyond any of these a run is ended
  rate_rad_s = 3.0
  attitude_deg = 25
  command = 0.9               # of full command
  [[step]]                    # build-up before each maneuver; each step unlocks the next
  amplitude = 0.5             # part of the maneuver's own
  f_stop_hz = 5               # chirps: up to here
  [[maneuver]]
  kind = "chirp"              # chirp, doublet or quiet
  axis = "roll"               # roll, pitch, elevator or yaw
  amplitude = 0.1             # of full command; rad/s with target = "rate"
  duration_s = 30
  repeat = 2
  purpose = "fit"             # fit, validate, noise or build-up
  f_start_hz = 0.5            # chirps only, as f_stop_hz = 10, noise_fraction = 0.2, c1 = 4, fade_in_s, fade_out_s = 0
  [[maneuver]]
  kind = "doublet"
  axis = "pitch"
  amplitude = 0.1
  duration_s = 9
  target = "command"          # or "rate": added to the rate command, for the vehicle's controller to follow
  pulse_s = 0.25              # doublets only

A vehicle profile (--vehicle-profile) is a TOML file: which modes, axes and parameters fly a maneuver, and how large one
may be. Those that come with the package lie in gcs/vehicle/profiles; copy one and change it. The vehicle must have the
parameters that its "needs" names.

--json prints {"format": "tippath.sweep/1", "folder", "complete", "stopped", "ending", "reason" (where
it ends with 1: the ending, or "recording", which is not complete; else null), and what flight.json holds:
"card", "card_sha256", "left_out", "log", "boot", "vehicle", "settings" (the vehicle's own, around a maneuver),
"station", "link_loss", "limits", "started", "ended", "resumed" (when, where it was; "parts" tells of what was before),
"checks", "planned", "probe": {"ok", "wrong", "findings", "answers", "words"} or null, "runs": [{"label", "purpose",
"maneuver", "flew", "parameters", "ending", "reason", "mode_after", "started", "duration_s", "file", "log_start_s",
"log_start_within_s", "peaks", "verdict": {"keep", "reasons", "samples", "expected", "missing", "gaps",
"percent_of_limits", "coherent_hz"}}], "recording", "missing_blocks" (below the last that came; "recording":
{"complete", "problems", "logs": [{"end"}]} says whether the log goes to its end; with --log card "complete" and a clean
run's "keep" are null, and log_start_s is the vehicle's clock as the link told it, give or take log_start_within_s), and
"following": [{"axis", "correlation", "lag_s", "steady_share", "follows"}] of runs with target "rate"}. Exit status: 0
flown to the end and recorded whole, whatever the verdicts; 1 not; 130 ended by Ctrl-C.
"""


def add_parser(subparsers: Any) -> None:
    parser: argparse.ArgumentParser = subparsers.add_parser(
        "sweep",
        help="fly maneuvers and record them",
        description="Fly one chirp (--axis) or a test card (--card) with the vehicle that the pilot has in the air.",
        epilog=_HELP,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    add_link_options(parser)
    add_dry_option(parser)
    add_vehicle_option(parser)
    there = sorted(path.stem for path in CARDS.glob("*.toml"))
    bundled = f"{', '.join(there[:-1])} and {there[-1]}"
    parser.add_argument(
        "--card", metavar="CARD.toml|NAME", help=f"a test card (default on ArduPilot: its own); {bundled} are there"
    )
    parser.add_argument("--axis", choices=("roll", "pitch", "elevator", "yaw"), help="of a single chirp by Table 1")
    parser.add_argument("--amplitude", type=float, metavar="A", help="of full command (default 0.1)")
    parser.add_argument("--duration", type=float, metavar="S", help="seconds (default 30)")
    parser.add_argument("-o", "--output", type=Path, metavar="DIR", help="the flight's folder; never overwritten")
    parser.add_argument("--resume", type=Path, metavar="DIR", help="go on with the flight in this folder")
    parser.add_argument(
        "--log",
        choices=("stream", "card"),
        help="how the vehicle's log comes: streamed while it is flown (default), or off the vehicle's card afterwards, "
        "for links that do not carry it",
    )
    parser.add_argument(
        "--leave-out", action="store_true", help="leave out of the card what this vehicle cannot fly, without asking"
    )
    parser.add_argument(
        "--wait",
        action="store_true",
        help="wait until the pilot has the vehicle in the air; a log that it streams is answered meanwhile, so that it "
        "can be armed",
    )
    parser.add_argument("--hardware", action="store_true", help="ask for the typed word even on this machine's link")
    parser.add_argument(
        "--probe",
        action=argparse.BooleanOptionalAction,
        help="fly a small step on each axis first, and the card only if the vehicle answers as it should (default on "
        "hardware)",
    )
    parser.add_argument("--yes", action="store_true", help="do not ask; refused on hardware")
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Exit status 0 flown to the end, 130 ended by Ctrl-C, 1 otherwise. Raises TippathError for what a user meets."""
    from gcs.cli.dry_run import print_sweep
    from gcs.cli.interrupts import interrupts  # as below: --help answers at once without pymavlink and numpy
    from gcs.cli.progress import ProgressLines
    from gcs.flight import folder as flightdir
    from gcs.flight.flown_card import Briefing
    from gcs.flight.prepare import prepared
    from gcs.flight.session import Session
    from gcs.flight.sweep import fly_card
    from gcs.logs.words import printable
    from gcs.vehicle.profile import load_profile

    card, log, earlier = asked(args)
    if earlier is not None and not earlier.left:
        return tell_nothing_left(earlier, as_json=args.json)
    profiles = () if args.vehicle_profile is None else (load_profile(args.vehicle_profile),)

    def consent(left_out: Sequence[str]) -> bool:
        return args.leave_out or typed_leaving_out(left_out)

    with interrupts() as wishes, Session.open(args.connect, **station(args)) as session:
        stream = log == "stream"
        if args.wait and not waited(session, args.connect, profiles, lambda: wishes() is not None, stream=stream):
            return EXIT_INTERRUPTED
        ready = prepared(session, card, profiles=profiles, consent=consent, log=log, link=args.connect)
        card, profile = ready.card, ready.profile
        if args.dry_run:
            print_sweep(session, ready, earlier, as_json=args.json)
            return EXIT_DONE
        lines = ProgressLines(card.limits)
        simulated = not args.hardware and is_loopback(args.connect) and profile.offers_our_law
        told = told_before(card, simulated=simulated, yes=args.yes)

        def confirm(briefing: Briefing) -> bool:
            lines.briefing(briefing)
            print("".join(f"   left out: {printable(words)}\n" for words in ready.left_out), end="", file=sys.stderr)
            return simulated or typed_confirmation()

        folder = flightdir.create(args.output) if earlier is None else earlier.folder
        result = fly_card(
            session,
            card,
            profile,
            folder=folder,
            confirm=confirm,
            on_progress=lines,
            aborted=wishes,
            interruptions=lambda: wishes.pressed,
            about={"link": args.connect, **told},
            probe=stream and (not simulated if args.probe is None else args.probe),
            log=log,
            left_out=ready.left_out,
            earlier=earlier,
        )
        tell_of_failsafe(result, armed=session.snapshot().armed)
    args.flown = folder.path
    tell(result, as_json=args.json)
    return exit_status(result, wishes() is not None, say_why=args.json)


def tell_of_failsafe(result: SweepResult, *, armed: bool) -> None:
    """Where we hold the vehicle's failsafe, and are about to leave."""
    loss = result.link_loss
    if loss is not None and loss.ends_sweep and armed:
        print(f" the vehicle is still in the air and {loss.answer} once this program has ended", file=sys.stderr)


def asked(args: argparse.Namespace) -> tuple[TestCard | None, LogWay, Earlier | None]:
    """What to fly, how its log comes, and the flight that is to go on. Raises UsageError where options do not fit."""
    earlier = resumed(args)
    card = card_of(args) if earlier is None else earlier.card
    log: LogWay = args.log or "stream" if earlier is None else earlier.log
    if log == "card" and args.probe:
        raise UsageError("--probe judges the commands in the log, and with --log card none come; leave one of them out")
    return card, log, earlier


def resumed(args: argparse.Namespace) -> Earlier | None:
    """The flight that is to go on; None for a new one. Raises UsageError where options ask for both."""
    from gcs.flight.resume import unfinished

    if args.resume is None:
        return None
    for name in ("card", "axis", "amplitude", "duration", "output"):
        if getattr(args, name) is not None:
            raise UsageError(f"--resume flies what is left of the card in its folder; leave out --{name}")
    earlier = unfinished(args.resume)
    if args.log not in (None, earlier.log):
        raise UsageError(f"the flight in {args.resume} was begun with --log {earlier.log}, and goes on so")
    return earlier


def tell_nothing_left(earlier: Earlier, *, as_json: bool) -> int:
    """Print that there is nothing to go on with; the exit status of the whole flight."""
    from gcs.flight.log_way import log_words, rest_words
    from gcs.logs.words import printable

    if as_json:
        head = document_head(earlier.folder, earlier.complete)
        reason = "recording" if earlier.complete is False else None
        print_json({**head, "ending": None, "reason": reason, **earlier.document, "following": []})
    else:
        print(f" {earlier.folder.path}: {earlier.words}; nothing is left to fly")
        for problem in earlier.problems:
            print(f"   {printable(problem)}")
        if earlier.complete is None:
            print(f"   the {log_words(earlier.folder.path)}")
        elif not earlier.complete:
            print(textwrap.indent(rest_words(earlier.folder.path), "   "))
    return EXIT_NO if earlier.complete is False else EXIT_DONE


def document_head(folder: FlightFolder, complete: bool | None) -> dict[str, Any]:
    """What every document of a sweep begins with."""
    return {"format": "tippath.sweep/1", "folder": str(folder.path), "complete": complete}


def tell(result: SweepResult, *, as_json: bool) -> None:
    """Print what was flown, and how the rates followed where a card asked for rates."""
    from gcs.logs.words import printable  # as in `run`

    followed, unknown = rates_followed(result)
    if as_json:
        print_document(result, followed)
    else:
        print_result(result, followed)
    if unknown:
        print(f" how the rates followed is not known: {printable(unknown)}", file=sys.stderr)


def waited(
    session: Session,
    link: str,
    profiles: Sequence[VehicleProfile],
    ended: Callable[[], bool],
    *,
    stream: bool,
) -> bool:
    """Wait for the pilot's take-off, with the vehicle's log answered so that it can be armed, where it is to be
    streamed; False where ended.

    Raises at once what stands against any card whoever flies.
    """
    from gcs.flight.connection import WallClock
    from gcs.flight.flyable import require_flyable, wait_for_pilot
    from gcs.flight.prepare import NOTHING
    from gcs.flight.readiness import answer_where_needed
    from gcs.logs.words import printable

    clock = WallClock()
    profile = require_flyable(session, NOTHING, clock, profiles=profiles, in_the_air=False, stream=stream, link=link)
    if stream:
        answer_where_needed(session, clock, link)
    return wait_for_pilot(
        session,
        clock,
        profile,
        tell=lambda words: print(f" {printable(words)}", file=sys.stderr, flush=True),
        ended=ended,
    )


def card_of(args: argparse.Namespace) -> TestCard | None:
    """What to fly; None where the options leave it to the vehicle. Raises UsageError where they say it twice."""
    from gcs.cards.maneuver import Maneuver, load_card, single_card

    single = [name for name in ("axis", "amplitude", "duration") if getattr(args, name) is not None]
    if args.card is not None and single:
        raise UsageError(f"--card says what to fly; leave out --{single[0]}")
    if args.card is not None:
        return load_card(args.card)
    if args.axis is None and single:
        raise UsageError(f"--{single[0]} of which axis? Give --axis roll|pitch|elevator|yaw, or --card hover")
    if args.axis is None:
        return None
    amplitude = 0.1 if args.amplitude is None else args.amplitude
    duration_s = 30.0 if args.duration is None else args.duration
    return single_card(Maneuver(kind="chirp", axis=args.axis, amplitude=amplitude, duration_s=duration_s))


def print_document(result: SweepResult, followed: Sequence[Following]) -> None:
    """The sweep as one JSON document."""
    complete = None if result.log == "card" and result.flown else result.complete
    head = document_head(result.folder, complete)
    ending = None if result.ending is None else result.ending.value
    reason = None if result.done else ending or "recording"
    rest = result.document
    print_json({**head, "ending": ending, "reason": reason, **rest, "following": [one.to_json() for one in followed]})


def print_result(result: SweepResult, followed: Sequence[Following]) -> None:
    """The sweep in lines: where it was recorded, whether whole, and how rates followed."""
    from gcs.flight.log_way import log_words, rest_words
    from gcs.logs.words import printable

    ended = f"   stopped: {printable(result.stopped)}" if result.stopped else ""
    count = f"{result.tried} of {result.planned} runs"
    recorded = result.recording is not None and result.recording.logs
    log = result.recording.logs[0].path if result.recording and recorded else result.folder.path
    print(f" recorded {log}  {count}  {result.missing_words}{ended}")
    if result.log == "card" and result.runs:
        print(f"   the {log_words(result.folder.path)}")
    for problem in result.problems:
        print(f"   {printable(problem)}")
    if result.log == "stream" and result.runs and result.recording is not None and not result.recording.complete:
        print(textwrap.indent(rest_words(result.folder.path), "   "))
    if followed:
        print(" how the rates followed their commands")
    for one in followed:
        print(f"   {one.words}")


def exit_status(result: SweepResult, interrupted: bool, *, say_why: bool) -> int:
    """What the shell is told; with `say_why` also why, where the sweep is not complete."""
    from gcs.flight.run_state import Ending
    from gcs.logs.words import printable

    if result.done:
        return EXIT_DONE
    if say_why:
        print(f"stopped: {printable(result.stopped or 'the recording is not complete')}", file=sys.stderr)
    return EXIT_INTERRUPTED if interrupted and result.ending is Ending.ABORTED else EXIT_NO


def rates_followed(result: SweepResult) -> tuple[list[Following], str]:
    """How the rates followed where rates were commanded, and why that is not known."""
    from gcs.analysis.following import measure_following

    flown = [one for one in result.runs if _follows(one)]
    if not flown or result.recording is None or result.recording.log is None:
        return [], ""
    try:
        return measure_following(result.recording.log, flown), ""
    except TippathError as error:
        return [], str(error)


def _follows(run: RunResult) -> bool:
    """A doublet on the rate command was flown, which a controller was to follow."""
    maneuver = run.run.maneuver
    return run.ending.value == "finished" and maneuver.target == "rate" and maneuver.kind == "doublet"


def is_loopback(link: str) -> bool:
    """Whether a LINK ends on this machine. Raises LinkError where it is no link."""
    from gcs.link.transport import parse_link

    word = parse_link(link)
    if word.kind == "serial":
        return False
    if word.host == "localhost":
        return True
    try:
        return ipaddress.ip_address(word.host).is_loopback
    except ValueError:
        return False


def typed_leaving_out(left_out: Sequence[str]) -> bool:
    """Ask on the terminal whether the rest of the card is to be flown; false where nobody could answer."""
    if not sys.stdin.isatty():
        return False
    from gcs.logs.words import printable

    print(" This vehicle cannot fly all of the card. It would leave out:", file=sys.stderr)
    for words in left_out:
        print(f"   {printable(words)}", file=sys.stderr)
    print(f" Type {LEAVE_OUT} to go on with the rest, anything else to stop: ", end="", file=sys.stderr, flush=True)
    return sys.stdin.readline().strip() == LEAVE_OUT


def told_before(card: TestCard, *, simulated: bool, yes: bool) -> dict[str, Any]:
    """The card's checklist for flight.json, asked where somebody sits; on hardware somebody must. Raises as both."""
    from gcs.cli.checklist import typed_checklist

    if not simulated:
        require_terminal(yes)
    return typed_checklist(card)


def require_terminal(yes: bool) -> None:
    """Raises UsageError where nobody could type the word, or where `--yes` would answer in his place."""
    if yes:
        raise UsageError(f"--yes does not fly hardware: somebody types {WORD}")
    if not sys.stdin.isatty():
        raise UsageError(f"this is no simulated vehicle of ours: somebody must type {WORD} on a terminal")


def typed_confirmation() -> bool:
    """Ask for the word on the terminal."""
    print(
        f" This vehicle is real. Type {WORD} to start, anything else to leave it: ", end="", file=sys.stderr, flush=True
    )
    return sys.stdin.readline().strip() == WORD
