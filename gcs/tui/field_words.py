"""Words for the flight line: time in the air, and how a checklist was answered. Pure."""

from __future__ import annotations

from gcs.cards.checklist import Answer
from gcs.tui.state import State


def minutes(seconds: float) -> str:
    """`3:12`."""
    whole = int(max(0.0, seconds))
    return f"{whole // 60}:{whole % 60:02d}"


def answer_words(answer: Answer) -> str:
    """As it was typed, or could have been."""
    if answer.value is None:
        return "not asked"
    if answer.value is True:
        return "yes"
    return f"{answer.value:g} {answer.question.unit}".strip() if isinstance(answer.value, float) else str(answer.value)


def answer_lines(state: State) -> list[str]:
    """Each question and its answer."""
    pairs = zip(state.checklist, state.answers, strict=True)
    lines = [f"{question.ask}: {answer_words(answer) if answer else 'open'}" for question, answer in pairs]
    return lines or ["this card has none"]
