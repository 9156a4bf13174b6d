"""What can go wrong that a user should read: every message says what is wrong and what to do next."""

from __future__ import annotations

import shlex
import sys


def to_install(*packages: str) -> str:
    """The command that installs packages for the Python that runs: another's pip would not help."""
    return shlex.join([sys.executable, "-m", "pip", "install", *packages])


class TippathError(Exception):
    """The data or the vehicle says no: exit status 1."""

    reason = "no"
    """In a word or two, for programs; the message is for people."""

    def __init__(self, *words: object, reason: str | None = None) -> None:
        super().__init__(*words)
        if reason is not None:
            self.reason = reason


class UsageError(TippathError):
    """The command itself makes no sense: exit status 2."""

    reason = "usage"


class LinkError(TippathError):
    """No vehicle, or it went away."""

    reason = "link"
