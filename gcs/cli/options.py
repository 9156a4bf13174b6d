"""Options that several commands share, and how results reach files and standard output."""

from __future__ import annotations

import argparse
import json
import os
from pathlib import Path
from typing import Any

from gcs.errors import TippathError, UsageError


def add_log_options(parser: argparse.ArgumentParser) -> None:
    """--profile and --window, of every command that reads logs."""
    parser.add_argument("--profile", metavar="FILE.toml", help="which fields of the log are which channels")
    parser.add_argument(
        "--window", metavar="START:STOP", help="seconds of the log's own t, applied to every run; open ends allowed"
    )


def add_band_option(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--band", metavar="LOW:HIGH", default="0:15", help="Hz, the frequencies that count (default 0:15)"
    )


def add_output_options(parser: argparse.ArgumentParser, metavar: str) -> None:
    """-o, --force and --json."""
    parser.add_argument("-o", "--output", type=Path, metavar=metavar, help="write the result to this file")
    parser.add_argument("--force", action="store_true", help="overwrite the file")
    parser.add_argument("--json", action="store_true", help="print one JSON document")


def parse_band(text: str) -> tuple[float, float]:
    """`LOW:HIGH` in Hz. Raises UsageError."""
    low, mark, high = text.partition(":")
    try:
        band = (float(low or 0), float(high))
    except ValueError:
        band = (0.0, 0.0)
    if not mark or not 0 <= band[0] < band[1] < float("inf"):
        raise UsageError(f"--band {text}: wants LOW:HIGH in Hz, such as 0:15")
    return band


def parse_profile(text: str | None) -> Path | None:
    return None if text is None else Path(text)


def refuse_existing(path: Path | None, force: bool) -> None:
    """Before long work: no command overwrites a file without --force."""
    if path is not None and path.exists() and not force:
        raise TippathError(f"{path} exists; name another file or add --force")


def write_json(document: Any, path: Path) -> None:
    """Whole or not at all: written aside, then moved into place."""
    part = path.with_name(path.name + ".part")
    part.write_text(json.dumps(document, indent=1, allow_nan=False) + "\n", encoding="utf-8")
    os.replace(part, path)


def print_json(document: Any) -> None:
    print(json.dumps(document, indent=1, allow_nan=False))
