"""What a card wants to be asked before it is flown: questions, and answers of the kind that each wants.

    [[checklist]]
    ask = "Wind"
    answer = "number"    # yes (where left out) | number | text
    unit = "m/s"
    most = 6             # and least: beyond them the card is not begun

A question that wants a yes and hears a no, or a number beyond its limits, keeps the card on the ground.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import datetime
from typing import Annotated, Any, Literal

from msgspec import Meta

from gcs import documents
from gcs.errors import TippathError

YES, NO = ("yes", "y", "ok", "done"), ("no", "n")
Value = bool | float | str


class QuestionDocument(documents.Strict, frozen=True, kw_only=True):
    """A `[[checklist]]` of a card's TOML."""

    ask: Annotated[str, Meta(min_length=1, max_length=200)]
    answer: Literal["yes", "number", "text"] = "yes"
    unit: Annotated[str, Meta(max_length=20)] = ""
    least: float | None = None
    most: float | None = None

    def question(self) -> Question:
        return Question(ask=self.ask, kind=self.answer, unit=self.unit, least=self.least, most=self.most)


@dataclass(frozen=True, slots=True, kw_only=True)
class Question:
    """One line of a checklist."""

    ask: str
    kind: Literal["yes", "number", "text"] = "yes"
    unit: str = ""
    least: float | None = None
    most: float | None = None

    @property
    def problem(self) -> str | None:
        """Why this is nonsense; None where it is sound."""
        if self.kind != "number" and (self.unit or self.least is not None or self.most is not None):
            return f'unit, least and most are of a number: answer = "number", not "{self.kind}"'
        if self.least is not None and self.most is not None and self.least > self.most:
            return f"least, {self.least:g}, lies above most, {self.most:g}"
        return None

    @property
    def hint(self) -> str:
        """How it is answered: `a number in m/s, at most 6`."""
        if self.kind != "number":
            return "yes or no" if self.kind == "yes" else "a few words"
        within = [f"at least {self.least:g}"] if self.least is not None else []
        within += [f"at most {self.most:g}"] if self.most is not None else []
        return ", ".join([f"a number{f' in {self.unit}' if self.unit else ''}", *within])

    def value(self, word: str) -> Value:
        """The answer in a word that was typed. Raises TippathError where it is none, or speaks against flying."""
        text = " ".join(word.split())
        if self.kind == "text":
            if not text:
                raise TippathError(f"{self.ask}: a few words are wanted")
            return text
        if self.kind == "yes":
            if text.lower() in NO:
                raise TippathError(f"{self.ask}: no. The card is not begun until it is yes")
            if text.lower() not in YES:
                raise TippathError(f"{self.ask}: yes or no is wanted, not {text or 'nothing'}")
            return True
        return self._number(text)

    def _number(self, text: str) -> float:
        try:
            number = float(text.replace(",", ".").removesuffix(self.unit).strip())
        except ValueError:
            raise TippathError(f"{self.ask}: {self.hint} is wanted, not {text or 'nothing'}") from None
        if not math.isfinite(number):
            raise TippathError(f"{self.ask}: {self.hint} is wanted, not {text}")
        if self.least is not None and number < self.least:
            raise TippathError(f"{self.ask}: {number:g} {self.unit} is below {self.least:g}; the card is not begun")
        if self.most is not None and number > self.most:
            raise TippathError(f"{self.ask}: {number:g} {self.unit} is above {self.most:g}; the card is not begun")
        return number


@dataclass(frozen=True, slots=True)
class Answer:
    """What was answered, or that nobody was there to."""

    question: Question
    value: Value | None
    time: str
    """ISO 8601, UTC."""

    def to_json(self) -> dict[str, Any]:
        """For flight.json."""
        return {"ask": self.question.ask, "answer": self.value, "unit": self.question.unit, "time": self.time}


def answered(question: Question, word: str, now: datetime) -> Answer:
    """A typed answer. Raises as `Question.value`."""
    return Answer(question, question.value(word), now.isoformat(timespec="seconds"))


def unanswered(questions: Sequence[Question], now: datetime) -> list[Answer]:
    """That nobody was asked."""
    return [Answer(question, None, now.isoformat(timespec="seconds")) for question in questions]
