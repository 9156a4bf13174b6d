"""What a command did in a flight's folder, noted in its audit.jsonl, so that the folder tells how it came about."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path


def audit(args: argparse.Namespace, words: Sequence[str]) -> None:
    """Note a command that succeeded, where it wrote into a flight's folder, or pushed gains out of one.

    A command that makes the folder itself says so in `args.flown`.
    """
    from gcs.desk import shell
    from gcs.errors import TippathError
    from gcs.flight.folder import FlightFolder

    flown = getattr(args, "flown", None)
    written = getattr(args, "output", None)
    pushed = getattr(args, "gains", None) if args.command == "push" else None
    if isinstance(flown, Path):
        folder, did = FlightFolder(flown), "flew a card"
    elif isinstance(pushed, Path):
        folder, did = FlightFolder(pushed.parent), f"pushed {pushed.name}"
    elif isinstance(written, Path) and written.is_file():
        folder, did = FlightFolder(written.parent), f"{args.command}: wrote {written.name}"
    else:
        return
    if not folder.about.is_file():
        return
    try:
        folder.audit(datetime.now(UTC), did, shell.words(["tippath", *words]))
    except TippathError as error:
        print(f"note: {error}", file=sys.stderr)
