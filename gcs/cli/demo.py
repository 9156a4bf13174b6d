"""`tippath demo`: the whole flight test on the simulated vehicle, unattended and without a terminal."""

from __future__ import annotations

import argparse
import sys
import time
from pathlib import Path
from typing import Any


def add_parser(subparsers: Any) -> None:
    parser: argparse.ArgumentParser = subparsers.add_parser(
        "demo",
        help="the whole flight test on the simulated vehicle, in six minutes",
        description="Start the simulated vehicle, fly the hover card, prove that every byte of its log arrived, fit "
        "TPP and CD, print the paper's tables with ours beside, name the effect that TPP lacks and add it, design "
        "gains on that, push them while it stands on the ground, fly the LQR and see whether it follows, land, revert. "
        "Leaves the flight's folder with log, fits, diagnosis, gains and report.",
        epilog='--json prints {"format": "tippath.demo/1", "folder", "plant", "seed", "runs", "missing_blocks", '
        '"byte_identical_to", "nrmse_percent", "validation_nrmse_percent", "modes", "checks", "pushed", "reverted_to", '
        '"following", "discovery", "files", "duration_s"}. Exit status 1 where something that must hold does not.',
    )
    parser.add_argument("--plant", default="hover", choices=("hover", "hover-ideal"), help="default %(default)s")
    parser.add_argument("--seed", type=int, default=1, metavar="N", help="wind, noise and sensors (default 1)")
    parser.add_argument("-o", "--output", type=Path, metavar="DIR", help="the flight's folder; never overwritten")
    parser.add_argument("--json", action="store_true", help="print one JSON document")
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Exit status 0. Raises TippathError where something that must hold does not."""
    from gcs.cards.envelope import Limits
    from gcs.cli.interrupts import interrupts
    from gcs.cli.options import print_json
    from gcs.cli.progress import ProgressLines
    from gcs.demo.demo import fly_demo
    from gcs.flight import folder as flightdir

    began = time.monotonic()
    lines = ProgressLines(Limits(), bell=False)

    def say(words: str) -> None:
        minutes, seconds = divmod(int(time.monotonic() - began), 60)
        print(f"{minutes}:{seconds:02d}  {words}", file=sys.stderr, flush=True)

    folder = flightdir.create(args.output)
    with interrupts() as wishes:
        found = fly_demo(
            folder,
            args.plant,
            args.seed,
            say=say,
            on_progress=lines,
            on_briefing=lines.briefing,
            aborted=wishes,
            interruptions=lambda: wishes.pressed,
        )
    if args.json:
        print_json(found.to_json())
    else:
        print(found.tables())
        print(f"report: {folder.path / 'report.html'}")
    return 0
