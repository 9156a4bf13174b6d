"""A card as it is asked for in the app: its word, and the options of `tippath sweep` that may stand behind it."""

from __future__ import annotations

import shlex
from dataclasses import dataclass
from pathlib import Path

from gcs.cards.maneuver import bundled_cards, load_card, parse_card
from gcs.desk.shell import word
from gcs.errors import UsageError
from gcs.flight.connection import LogWay

SHOWN_FIRST = "hover"
"""The card that is shown until the vehicle, which may have its own, is known."""
MOST_WRITTEN = 20
"""Files of a folder that are looked at."""
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


def offered_cards(folder: Path | None, first: str = "") -> list[tuple[str, str]]:
    """What can be taken without typing, each with what it is: what is proposed, the cards that a diagnosis wrote into a
    flight's folder, the newest first, and those that come along.
    """
    offers = [(first, "the rest of the flight that was cut off")] if first.startswith("--resume") else []
    for path in _written(folder):
        try:
            card = load_card(str(path))
        except UsageError as error:
            offers.append((word(path), f"no card: {error}"))
            continue
        offers.append((word(path), f"written by the diagnosis: {card.name}"))
    for name, text in bundled_cards().items():
        card = parse_card(text, f"card {name}")
        offers.append((name, f"{len(card.runs())} runs: {card.description or card.name}"))
    return offers


def _written(folder: Path | None) -> list[Path]:
    """`next.toml`, `next-2.toml` of a flight, the newest first."""
    if folder is None:
        return []
    found: list[tuple[int, Path]] = []
    try:
        found = [(path.stat().st_mtime_ns, path) for path in sorted(folder.glob("next*.toml"))[:MOST_WRITTEN]]
    except OSError:
        return []
    return [path for _, path in sorted(found, key=lambda one: -one[0])]


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
