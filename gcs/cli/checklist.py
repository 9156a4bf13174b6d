"""A card's checklist in a shell: asked on a terminal, and kept as not asked where nobody sits there."""

from __future__ import annotations

import sys
from datetime import UTC, datetime
from typing import Any

from gcs.cards.checklist import Answer, answered, unanswered
from gcs.cards.maneuver import TestCard
from gcs.errors import TippathError


def typed_checklist(card: TestCard) -> dict[str, Any]:
    """For flight.json; empty where the card has none. Raises TippathError where an answer speaks against flying, or
    there is none."""
    if not card.checklist:
        return {}
    if not sys.stdin.isatty():
        print(f" the card's checklist ({len(card.checklist)} questions) is not asked: no terminal", file=sys.stderr)
        answers = unanswered(card.checklist, datetime.now(UTC))
    else:
        answers = [_typed(card, i) for i in range(len(card.checklist))]
    return {"checklist": [one.to_json() for one in answers]}


def _typed(card: TestCard, number: int) -> Answer:
    question = card.checklist[number]
    print(
        f" {number + 1}/{len(card.checklist)} {question.ask} ({question.hint}): ", end="", file=sys.stderr, flush=True
    )
    try:
        word = input()
    except EOFError:
        raise TippathError("the checklist was left: nothing was flown") from None
    return answered(question, word, datetime.now(UTC))
