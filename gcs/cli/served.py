"""`tippath fly --serve`: the app in a browser, on this computer, or with a token beyond it."""

from __future__ import annotations

import argparse
import os
import secrets
import sys
from typing import Any

from gcs.errors import TippathError, UsageError, to_install

PORT = 8000
TOKEN_VARIABLE = "TIPPATH_SERVE_TOKEN"
LEFT_OUT = frozenset({"serve", "serve_host", "serve_token"})


def add_serve_options(parser: argparse.ArgumentParser) -> None:
    """Where the app is served, and who may fly it."""
    parser.add_argument(
        "--serve",
        nargs="?",
        type=_port,
        const=PORT,
        metavar="PORT",
        help=f"the same app in a browser on this computer, http://127.0.0.1:PORT (default {PORT}): the first page "
        "flies, others watch, anybody aborts; needs the extra web",
    )
    parser.add_argument(
        "--serve-host",
        metavar="ADDRESS",
        help="serve it there, such as 192.168.1.5 or 0.0.0.0 for a tablet; wants a token, because whoever reaches the "
        "page can fly. It is not encrypted: in a network that others share use `ssh -L` instead",
    )
    parser.add_argument(
        "--serve-token",
        nargs="?",
        const="",
        metavar="TOKEN",
        help=f"what the page's address must carry (?token=TOKEN), 16 characters or more; without one it is made up and "
        f"printed. Better in the environment, {TOKEN_VARIABLE}, where other users do not see it",
    )


def _port(word: str) -> int:
    """A port of this computer; a host is refused, because whoever reaches the page can fly."""
    if not word.isdigit() or not 1 <= int(word) <= 65535:
        raise argparse.ArgumentTypeError(
            f"{word}: a port from 1 to 65535 is wanted; it is served on 127.0.0.1 only (--serve-host and a token say "
            "otherwise), because whoever reaches it can fly"
        )
    return int(word)


def in_browser() -> bool:
    """Whether this process is an app that is served: its terminal is a browser."""
    return os.environ.get("TEXTUAL_DRIVER", "").endswith("WebDriver")


def require_serve_words(args: argparse.Namespace) -> None:
    """Raises UsageError for what goes with --serve only."""
    if args.serve is None and (args.serve_host is not None or args.serve_token is not None):
        raise UsageError("--serve-host and --serve-token say how --serve does it; add --serve")


def serve(args: argparse.Namespace, parser: argparse.ArgumentParser) -> int:
    """Serve the app until interrupted. Raises TippathError where it cannot be."""
    try:
        from aiohttp import web

        from gcs.browser.app_process import app_words, environment_without
        from gcs.browser.server import Served, application
    except ImportError as error:
        raise TippathError(f"--serve needs aiohttp, which is not installed: {to_install('aiohttp')}") from error
    from gcs.browser.guard import LOOPBACK, Guard

    host, token = args.serve_host or LOOPBACK, _token(args)
    _require_token(host, token)
    guard = Guard(host, args.serve, token)
    served = Served(app_words(again(args, parser)), environment_without(TOKEN_VARIABLE), say=_say)
    shown = LOOPBACK if host == "0.0.0.0" else host
    about = f"serving on http://{shown}:{args.serve}{'' if token is None else f'/?token={token}'}; Ctrl-C ends it"
    try:
        web.run_app(application(served, guard), host=host, port=args.serve, print=lambda *_: _say(about))
    except OSError as error:
        why = str(error) if error.errno is None else os.strerror(error.errno)
        raise TippathError(
            f"port {args.serve} of {host} cannot be served ({why.lower()}); choose another: --serve 8001"
        ) from error
    return 0


def _say(words: str) -> None:
    print(words, file=sys.stderr, flush=True)


def _token(args: argparse.Namespace) -> str | None:
    """The one given, the environment's, one made up, or none."""
    if args.serve_token == "":
        return os.environ.get(TOKEN_VARIABLE) or secrets.token_urlsafe(18)
    return args.serve_token or os.environ.get(TOKEN_VARIABLE) or None


def _require_token(host: str, token: str | None) -> None:
    """Raises UsageError where anybody could fly."""
    from gcs.browser.guard import SHORTEST_TOKEN, is_loopback

    if token is None and not is_loopback(host):
        raise UsageError(
            f"--serve-host {host}: whoever reaches the page can fly; add --serve-token, which makes one up"
        )
    if token is not None and len(token) < SHORTEST_TOKEN:
        raise UsageError(f"the token of --serve has {len(token)} characters; {SHORTEST_TOKEN} or more are wanted")


def again(args: argparse.Namespace, parser: argparse.ArgumentParser) -> list[str]:
    """The options of a command line, less those of serving: whatever is not as it would be by itself."""
    words: list[str] = []
    positional: list[str] = []
    for action in parser._actions:  # argparse tells what it parses nowhere else
        value = getattr(args, action.dest, None)
        if action.dest in LEFT_OUT or value == action.default or value is None:
            continue
        words += _words(action, value) if action.option_strings else []
        positional += (
            [] if action.option_strings else [str(one) for one in (value if isinstance(value, list) else [value])]
        )
    return [*words, *(["--", *positional] if positional else [])]


def _words(action: argparse.Action, value: Any) -> list[str]:
    if isinstance(action, argparse.BooleanOptionalAction):
        return [next(word for word in action.option_strings if word.startswith("--no-") != bool(value))]
    if action.nargs == 0:
        return [action.option_strings[-1]]
    return (
        [f"{action.option_strings[-1]}={value}"]
        if action.option_strings[-1].startswith("--")
        else [
            action.option_strings[-1],
            str(value),
        ]
    )
