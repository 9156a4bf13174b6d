"""What people said of a flight, as flight.json keeps it: notes with the time of flight, the checklist, readiness.

notes       [{"time", "text", "air_s": s in the air, "run": label of the run that flew, "run_s": s of it}]
checklist   [{"ask", "answer": true, a number, words, or null where nobody was asked, "unit", "time"}]
readiness   as `tippath check --json`, with "time": what the vehicle was set to when it was last looked at
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from datetime import datetime
from typing import Any

from gcs.vehicle.readiness import Standing


@dataclass(frozen=True, slots=True, kw_only=True)
class SessionNote:
    """One note, and the moment at which somebody began to write it."""

    time: datetime
    text: str
    air_s: float | None = None
    """Seconds in the air; None on the ground before the first flight."""
    run: str = ""
    """Label of the run that flew; empty between two."""
    run_s: float | None = None
    """Seconds of it."""

    @property
    def more(self) -> dict[str, Any]:
        """What flight.json has of it beside time and text."""
        told: dict[str, Any] = {} if self.air_s is None else {"air_s": round(self.air_s, 1)}
        if self.run and self.run_s is not None:
            told |= {"run": self.run, "run_s": round(self.run_s, 1)}
        return told


@dataclass(frozen=True, slots=True)
class ToldNote:
    """A note as it is read again."""

    time: str
    """ISO 8601, UTC; empty where flight.json has none."""
    text: str
    air_s: float | None = None
    run: str = ""
    run_s: float | None = None


@dataclass(frozen=True, slots=True)
class ToldAnswer:
    """A line of the checklist as it is read again."""

    ask: str
    answer: bool | float | str | None
    """None where nobody was asked."""
    unit: str = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class ToldSession:
    """What people said of a flight; all of it may be empty."""

    notes: tuple[ToldNote, ...] = ()
    checklist: tuple[ToldAnswer, ...] = ()
    ready: bool | None = None
    """Whether nothing had to be changed on the vehicle when it was last looked at; None where nobody looked."""
    to_change: tuple[str, ...] = ()
    """Names of what had to be."""


def told_session(about: Mapping[str, Any]) -> ToldSession:
    """From what flight.json says. What is of another kind than it should be is left out."""
    readiness = about.get("readiness")
    looked = readiness if isinstance(readiness, dict) else {}
    ready = looked.get("ready")
    items = (one for one in _dicts(looked.get("items")) if one.get("standing") == Standing.MUST.value)
    return ToldSession(
        notes=tuple(_note(one) for one in _dicts(about.get("notes")) if isinstance(one.get("text"), str)),
        checklist=tuple(_answer(one) for one in _dicts(about.get("checklist")) if isinstance(one.get("ask"), str)),
        ready=ready if isinstance(ready, bool) else None,
        to_change=tuple(str(one.get("name", "")) for one in items),
    )


def _dicts(value: object) -> list[dict[str, Any]]:
    return [one for one in value if isinstance(one, dict)] if isinstance(value, list) else []


def _note(one: Mapping[str, Any]) -> ToldNote:
    run = one.get("run")
    return ToldNote(
        str(one.get("time", "")), one["text"], _number(one.get("air_s")), run if isinstance(run, str) else "",
        _number(one.get("run_s")),
    )  # fmt: skip


def _answer(one: Mapping[str, Any]) -> ToldAnswer:
    answer, unit = one.get("answer"), one.get("unit")
    return ToldAnswer(
        one["ask"],
        answer if isinstance(answer, bool | int | float | str) else None,
        unit if isinstance(unit, str) else "",
    )


def _number(value: object) -> float | None:
    return float(value) if isinstance(value, int | float) and not isinstance(value, bool) else None
