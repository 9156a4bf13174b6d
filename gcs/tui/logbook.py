"""What people say of a flight while it is prepared and flown: answers to the card's checklist, and notes.

A note that is written before there is a flight waits for its folder. Nothing here waits for anybody.
"""

from __future__ import annotations

import threading
from collections.abc import Callable
from datetime import datetime
from pathlib import Path
from typing import Any

from gcs.cards.checklist import Answer, answered
from gcs.cards.maneuver import TestCard
from gcs.errors import TippathError
from gcs.flight.folder import FlightFolder, stamp
from gcs.flight.readiness_words import document
from gcs.flight.session_notes import SessionNote
from gcs.tui.moment import Moment


class Logbook:
    """Of one link; its answers are those to the card that is next."""

    def __init__(self, moment: Moment, now: Callable[[], datetime]) -> None:
        self._moment = moment
        self._now = now
        self._lock = threading.Lock()
        self._waiting: list[SessionNote] = []

    def ask(self, card: TestCard) -> None:
        """Another card, or the same once more: its checklist is to be answered anew."""
        self._moment.set(checklist=card.checklist, answers=(None,) * len(card.checklist))

    def answer(self, number: int, word: str) -> None:
        """The answer to question `number`, from 0. Raises TippathError where it is none, or speaks against flying."""
        with self._moment.lock:
            now = self._moment.now
            if now.stage.under_way:
                raise TippathError("the card is being flown: its checklist was answered")
            given: list[Answer | None] = list(now.answers)
            given[number] = None
            self._moment.set(answers=tuple(given))
            given[number] = answered(now.checklist[number], word, self._now())
            self._moment.set(answers=tuple(given))

    def document(self) -> dict[str, Any]:
        """For flight.json: the checklist, and what the vehicle was set to; keys only of what there is."""
        now = self._moment.now
        told: dict[str, Any] = {}
        if now.checklist:
            told["checklist"] = [one.to_json() for one in now.answers if one is not None]
        if now.readiness is not None:
            told["readiness"] = {"time": stamp(self._now()), **document(now.readiness, None)}
        return told

    def note(self, note: SessionNote) -> None:
        """Write it into the flight under way or the last one, else keep it until there is one. Raises TippathError
        where the disk does not take it."""
        now = self._moment.now
        if now.flight is None or not FlightFolder(now.flight).about.exists():
            with self._lock:
                self._waiting.append(note)
            self._moment.set(said=f"noted; it goes into the next flight's folder: {note.text}")
            return
        _write(now.flight, note)
        self._moment.set(said=f"noted in {now.flight.name}: {note.text}")

    @property
    def waiting(self) -> tuple[str, ...]:
        """Notes that no flight has taken yet."""
        with self._lock:
            return tuple(note.text for note in self._waiting)

    def begun(self, flight: Path) -> None:
        """There is a flight: what waited goes into it. Raises TippathError; what was not taken waits on."""
        with self._lock:
            while self._waiting:
                _write(flight, self._waiting[0])
                self._waiting.pop(0)


def _write(flight: Path, note: SessionNote) -> None:
    FlightFolder(flight).note(note.time, note.text, note.more)
