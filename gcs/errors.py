"""What can go wrong that a user should read: every message says what is wrong and what to do next."""

from __future__ import annotations


class TippathError(Exception):
    """The data or the vehicle says no: exit status 1."""


class UsageError(TippathError):
    """The command itself makes no sense: exit status 2."""


class LinkError(TippathError):
    """No vehicle, or it went away."""
