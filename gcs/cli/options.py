"""Options that several commands share, and how results reach files and standard output."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from gcs.errors import UsageError
from gcs.files import write_whole
from sysid.data.airframe import Airframe

if TYPE_CHECKING:
    from gcs.logs import AnyWindow


def add_log_options(parser: argparse.ArgumentParser) -> None:
    """--profile and --window, of every command that reads logs."""
    parser.add_argument("--profile", metavar="FILE.toml", help="which fields of the log are which channels")
    parser.add_argument(
        "--window",
        metavar="[@]START:STOP",
        help="seconds of the log's own t, or with @ from each run's start (@5:25), applied to every run; open ends "
        "allowed. For one run behind its name: LOG#2@5:25",
    )


def add_loop_option(parser: argparse.ArgumentParser) -> None:
    """--loop-rate, of commands that make records of logs."""
    parser.add_argument(
        "--loop-rate",
        metavar="HZ",
        type=parse_rate,
        help="how often the vehicle's control loop gave a command, where the log has fewer of them and does not say "
        "(ArduPilot's and PX4's say it)",
    )


def parse_rate(text: str) -> float:
    """A rate in Hz. Raises argparse.ArgumentTypeError."""
    try:
        rate_hz = float(text)
    except ValueError:
        rate_hz = 0.0
    if not 1 <= rate_hz <= 1e5:
        raise argparse.ArgumentTypeError(f"{text}: wants a rate in Hz, such as 400")
    return rate_hz


def add_band_option(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--band",
        metavar="LOW:HIGH",
        help="Hz, the frequencies that count (default: what was swept; where noise was flown with the chirps, 0:15, in "
        "a log that lost samples of it up to the sweep's end; where nothing was swept, where the rates follow the "
        "commands)",
    )


def add_airframe_option(parser: argparse.ArgumentParser) -> None:
    """--airframe, of every command that asks for effects."""
    parser.add_argument(
        "--airframe",
        choices=[one.value for one in Airframe],
        help="what flew, where the log does not tell: what it cannot have is not offered",
    )


def parse_airframe(args: argparse.Namespace) -> Airframe | None:
    """As given; None where the logs' own word counts."""
    return None if args.airframe is None else Airframe(args.airframe)


def add_reading_options(parser: argparse.ArgumentParser) -> None:
    """--band, --profile and --window, of commands that read runs for a fit that has its own."""
    parser.add_argument("--band", metavar="LOW:HIGH", help="Hz, the frequencies that count (default: the fit's)")
    add_log_options(parser)


def parse_reading(args: argparse.Namespace) -> tuple[tuple[float, float] | None, AnyWindow | None, Path | None]:
    """Band, window and profile as given; None where the fit's own count. Raises UsageError."""
    from gcs.logs import parse_window

    return (
        None if args.band is None else parse_band(args.band),
        None if args.window is None else parse_window(args.window),
        parse_profile(args.profile),
    )


def add_output_options(parser: argparse.ArgumentParser, metavar: str) -> None:
    """-o, --force and --json."""
    parser.add_argument("-o", "--output", type=Path, metavar=metavar, help="write the result to this file")
    parser.add_argument("--force", action="store_true", help="overwrite the file")
    parser.add_argument("--json", action="store_true", help="print one JSON document")


def add_plot_option(parser: argparse.ArgumentParser, what: str = "draw it") -> None:
    """--plot, of every command that draws."""
    parser.add_argument("--plot", type=Path, metavar="FILE", help=f"{what}: .png, .svg, or .html")


def refuse_plot(path: Path | None, force: bool) -> None:
    """Before long work. Raises UsageError for a file that can be no picture, or is there already."""
    if path is None:
        return
    from gcs.analysis.pages.pictures import picture_kind  # half a second to load: only where something is drawn

    picture_kind(path)
    refuse_existing(path, force)


def write_plot(path: Path | None, draw: Callable[[], Any], title: str, text: str) -> None:
    """The figure that is drawn, into the file where one is named; a page holds the text as well.

    Raises TippathError where the disk does not take it.
    """
    if path is None:
        return
    from gcs.analysis.pages.pictures import write_picture  # as in `refuse_plot`

    write_picture(path, draw(), title, text)
    print(f"wrote {path}", file=sys.stderr)


def add_effects_option(parser: argparse.ArgumentParser, help_text: str) -> None:
    """--with, of every command that takes effects or reads fits that may hold a user's own."""
    parser.add_argument("--with", dest="effects", action="append", default=[], metavar="EFFECT,...", help=help_text)


NAMED = "the paths of your own files that the fit uses, base or effects: they are code, and run only where named"


def parse_words(groups: Sequence[str]) -> list[str]:
    """`A,B` and repeated options to words. Raises UsageError for an empty word."""
    words = [word.strip() for group in groups for word in group.split(",")]
    if not all(words):
        raise UsageError(f"--with {','.join(groups)}: an empty name between commas")
    return words


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
    """Before long work: no command overwrites a file without --force, and only regular files are written."""
    if path is None:
        return
    if path.exists() and not force:
        raise UsageError(f"{path} exists; name another file or add --force")
    if path.is_symlink() or (path.exists() and not path.is_file()):
        raise UsageError(f"{path} is not a regular file; name one")
    if not path.parent.is_dir():
        raise UsageError(f"{path}: there is no folder {path.parent}")


def write_json(document: Any, path: Path) -> None:
    """As `write_text`."""
    write_text(json.dumps(document, indent=1, allow_nan=False) + "\n", path)


def write_text(text: str, path: Path) -> None:
    """Whole or not at all. Raises TippathError where the disk does not take it."""
    write_whole(text.encode(), path)


def print_json(document: Any) -> None:
    print(json.dumps(document, indent=1, allow_nan=False))
