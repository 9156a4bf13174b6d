"""The command line: one module for each command, found here by name; imports happen when a command runs."""

from __future__ import annotations

import argparse
import functools
import importlib
import os
import signal
import sys
from collections.abc import Sequence

COMMANDS = (
    *("fly", "sim", "check", "sweep", "abort", "fetch", "ingest", "fit", "effects", "response", "compare", "diagnose"),
    *("add", "design", "shadow", "push", "proof", "revert", "report", "campaign", "check-change", "key", "reveal"),
    *("demo", "paper"),
)
"""In the order of the work, as `tippath --help` lists them."""

OF_A_VEHICLE = ("check", "sweep", "abort", "push", "revert")
"""Whose JSON says why where nothing came of it; `fetch` says it itself."""

EXIT_DONE, EXIT_NO, EXIT_USAGE, EXIT_INTERRUPTED = 0, 1, 2, 130


@functools.cache
def parser() -> argparse.ArgumentParser:
    """The whole command line; made once, for one who gives many commands in a process."""
    from importlib.metadata import version

    from gcs.cli.parsing import Parser

    top = Parser(
        prog="tippath",
        description="Flight-test identification of rotorcraft: fly a chirp, fit, design gains, push them, fly again.",
        epilog="Start with `tippath demo`, or `tippath fly --sim hover`. `tippath COMMAND --help` explains each.",
    )
    top.add_argument("--version", action="version", version=f"tippath {version('tippath')}")
    subparsers = top.add_subparsers(dest="command", metavar="COMMAND", required=True)
    for name in COMMANDS:
        importlib.import_module(f"gcs.cli.{name.replace('-', '_')}").add_parser(subparsers)
    return top


def main(argv: Sequence[str] | None = None) -> int:
    """Run one command; returns the exit status: 0 done, 1 data or vehicle says no, 2 wrong usage."""
    from gcs.cli.terminal import harmless_streams

    with harmless_streams():
        return _main(argv)


def _main(argv: Sequence[str] | None) -> int:
    from gcs.cli.namesakes import NamesakeError, refuse_namesakes
    from gcs.errors import TippathError, UsageError

    try:
        refuse_namesakes()
    except NamesakeError as error:
        print(f"tippath: {error}", file=sys.stderr)
        return EXIT_NO
    from sysid.errors import SysidError

    args = argparse.Namespace(command="")
    try:
        args = parser().parse_args(argv)
        status: int = args.run(args)
        if status == EXIT_DONE or hasattr(args, "flown"):
            from gcs.cli.audit import audit

            audit(args, sys.argv[1:] if argv is None else argv)
        if sys.stdout is not None:  # closed from the beginning
            sys.stdout.flush()
        return status
    except UsageError as error:
        print(f"tippath {args.command}: {error}", file=sys.stderr)
        return EXIT_USAGE
    except (TippathError, SysidError) as error:
        print(f"tippath {args.command}: {error}", file=sys.stderr)
        if args.command in OF_A_VEHICLE and args.json:
            _print_reason(args.command, error)
        return EXIT_NO
    except BrokenPipeError:
        # the reader of our output went away; keep the interpreter from complaining at exit
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return EXIT_NO
    except OSError as error:
        where = f" {error.filename}" if error.filename else ""
        print(f"tippath {args.command}: {error.strerror or error}{where}", file=sys.stderr)
        return EXIT_NO
    except KeyboardInterrupt:
        signal.signal(signal.SIGINT, signal.SIG_IGN)
        print(f"tippath {args.command}: interrupted", file=sys.stderr)
        return EXIT_INTERRUPTED


def _print_reason(command: str, error: Exception) -> None:
    """Why, as a document: a word for programs, and the message."""
    from gcs.cli.options import print_json
    from gcs.errors import TippathError

    reason = error.reason if isinstance(error, TippathError) else TippathError.reason
    print_json({"format": f"tippath.{command}/1", "reason": reason, "error": str(error)})
