"""`tippath shadow`: gains judged over recorded flights, without authority."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING, Any

from gcs.cli.options import (
    add_band_option,
    add_effects_option,
    add_log_options,
    add_loop_option,
    add_plot_option,
    parse_band,
    parse_profile,
    parse_words,
    print_json,
    refuse_plot,
    write_plot,
)

if TYPE_CHECKING:
    from sysid.control.judgement import Limits

_HELP = """\
The loop is broken at both commands and closed on paper with the measured responses of the flights' sweeps: margins, a
disk margin, and Nyquist's count of roots to the right. The verdict is `cleared` where that loop is stable with the
margins asked for, whatever the 95 % bound of the response, and small where the sweeps end; `refused` where it is not,
or the command would be beyond full while nothing is excited, or a vehicle that ran the gains did otherwise; `not
measured` where the flights cannot tell, with how far to sweep. The model in GAINS.json only stands below the sweeps
and counts the open loop's unstable poles.

A vehicle with the bank can run it without authority while the pilot's switch is off: its observer gets the command
that was sent, and what it would have put out is logged. Push the gains, set the parameter that the answer names, fly a
sweep, and name that flight too: signs, axes, scales, timing and innovations of what ran are checked. That can refuse,
and never clears.

--json prints {"format": "tippath.shadow/1", "verdict", "checksum", "model", "limits", "runs", "band_hz", "loop_s",
"measured": {"verdict", "roots_to_the_right", "unstable_poles", "band_hz", "bound" (1: the 95 % bound reaches -1),
"margins" (each "value", "bound", "frequency_hz"), "disk", "shortfalls", "not_measured": [{"why": axes | excitation |
low | bound | edge | near, "frequency_hz", "sweep_to_hz"}]}, "outputs": [{"axis", "rms", "largest", "saturated",
"saturated_at_rest", "rate", "largest_rate", "noise", "flown_rms", "flown_rate", "flown_noise", "innovation"}],
"targets_told", "faults": [{"kind", "place", "axis", "value"}], "beside": [{"path", "checksum", "seconds", "outputs",
"faults"}]}.
"""


def add_parser(subparsers: Any) -> None:
    parser: argparse.ArgumentParser = subparsers.add_parser(
        "shadow",
        help="gains judged over recorded flights without authority",
        description="Run a GAINS.json of `tippath design` over recorded flights, without authority: what it would "
        "have commanded, whether the loop that was measured holds it, and whether a vehicle that ran it beside did so "
        "right.",
        epilog=_HELP,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("gains", type=Path, metavar="GAINS.json")
    parser.add_argument("flights", nargs="+", metavar="FLIGHT", help="flight folders, logs, or their runs (LOG#n)")
    parser.add_argument(
        "--limits",
        metavar="LIMITS",
        help="what is asked of margins where it is more than in GAINS.json (6dB,45deg,10ms)",
    )
    add_effects_option(parser, "paths of your own files (their code runs) that the gains' models use")
    add_band_option(parser)
    add_log_options(parser)
    add_loop_option(parser)
    add_plot_option(parser, "draw the broken loop")
    parser.add_argument("--force", action="store_true", help="overwrite the file")
    parser.add_argument("--json", action="store_true", help="print one JSON document")
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    from gcs.analysis.band import chosen_band
    from gcs.analysis.clearance import designed
    from gcs.analysis.notes import note_lines
    from gcs.analysis.pages.shadow import shadow_picture
    from gcs.analysis.shadow import refuse_rate_gains, shadow_flight
    from gcs.analysis.text.shadow import shadow_text
    from gcs.analysis.vehicles import different_vehicles
    from gcs.cli.fit import print_notes
    from gcs.errors import TippathError
    from gcs.flight.gains import load_gains
    from gcs.logs import parse_window, resolve_runs

    refuse_plot(args.plot, args.force)
    asked = None if args.band is None else parse_band(args.band)
    window = None if args.window is None else parse_window(args.window)
    limits = _limits(args.limits)
    refuse_rate_gains(args.gains)
    crc = load_gains(args.gains).crc
    gains, model, usual = designed(args.gains, parse_words(args.effects))
    high_hz = 15.0 if asked is None else asked[1]
    records = resolve_runs(
        args.flights, parse_profile(args.profile), window, f_high_hz=high_hz, loop_rate_hz=args.loop_rate
    )
    if (doubt := different_vehicles(records)) is not None:
        raise TippathError(doubt.replace("fit them apart", "judge the gains on each alone"))
    print_notes(note_lines(records))
    flown = [one for one in records if one.maneuver != "quiet"] or records
    found = shadow_flight(
        (gains, model, usual if limits is None else usual.or_stricter(limits)),
        crc,
        records,
        asked or chosen_band(flown).hz,
    )
    text = shadow_text(found)
    write_plot(args.plot, lambda: shadow_picture(found), "tippath shadow", text)
    if args.json:
        print_json(found.to_json())
    else:
        print(text)
    return 0


def _limits(words: str | None) -> Limits | None:
    """What is asked. Raises UsageError for words that say no limits."""
    from gcs.errors import UsageError
    from sysid.control.judgement import parse_limits

    try:
        return None if words is None else parse_limits(words)
    except ValueError as error:
        raise UsageError(f"--limits {words}: wants such as 6dB,45deg,10ms") from error
