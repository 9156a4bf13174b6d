"""A card as it is asked for in the app: its word, and the options of `tippath sweep` that may stand behind it."""

from __future__ import annotations

import shlex
from dataclasses import dataclass

from gcs.desk.shell import word
from gcs.errors import UsageError
from gcs.flight.connection import LogWay

SHOWN_FIRST = "hover"
"""The card that is shown until the vehicle, which may have its own, is known."""
MEANT = "a card, and behind it, where wanted, --leave-out and --log card; or --resume DIR alone"


@dataclass(frozen=True, slots=True)
class AskedCard:
    """What is to be flown, and how."""

    card: str = ""
    """Its file, or the name of one that comes along; empty where the vehicle's own is meant."""
    log: LogWay = "stream"
    leave_out: bool = False
    """By this consent what the vehicle cannot fly is left out."""
    resume: str = ""
    """The folder of a flight that is to go on, with its own card; empty for a new one."""

    @property
    def options(self) -> str:
        """As a shell takes them."""
        if self.resume:
            return f"--resume {word(self.resume)}"
        words = [f"--card {word(self.card)}"] if self.card else []
        words += ["--log card"] if self.log == "card" else []
        return " ".join([*words, *(["--leave-out"] if self.leave_out else [])])


def asked_card(text: str) -> AskedCard:
    """From what was typed, or given to `tippath fly`: `hover --leave-out`. Raises UsageError."""
    try:
        words = shlex.split(text)
    except ValueError as error:
        raise UsageError(f"{text}: {error}; {MEANT}") from error
    if len(words) == 2 and words[0] == "--resume":
        return AskedCard(resume=words[1])
    card, log, leave_out = "", "stream", False
    while words:
        first = words.pop(0)
        if first == "--leave-out":
            leave_out = True
        elif first == "--log" and words and words[0] in ("stream", "card"):
            log = words.pop(0)
        elif first.startswith("-") or card:
            raise UsageError(f"{first} is not known here: {MEANT}")
        else:
            card = first
    return AskedCard(card, "card" if log == "card" else "stream", leave_out)
